"""Figures for papers: Matplotlib in our style and in the user's, written as PNG, SVG or PDF.

Only functions that draw import Matplotlib, the extra `report`. Pyplot is never used: there is no
window and no global figure.
"""

from __future__ import annotations

import io
import logging
import os
import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from vsense.base.arena import Floats
from vsense.base.errors import UsageError, VsenseError
from vsense.base.terminal import spoken
from vsense.studies.report import can_draw

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_PLACES = 800
"""Places across a chart that can be told apart."""
_BREAKS = re.compile(r"(?<=[\s=/])|(?<=[._])(?![\d\s])")
"""Where a condition's words may break: in "sensor.noise=0.2" twice, in a number nowhere."""
_NO_SHEET = "expected a Matplotlib style sheet, or a name in matplotlib.style.available"
_WIDE = 7.16 / 3.5
"""A page's width in columns; IEEE's are 3.5 inches wide, and two with their gap 7.16 inches."""
_MOST_LETTERS = 44
_FRAME_IN = 0.6
"""Of a chart of runs, beside its rows."""
_TEX = str.maketrans(
    {
        **{sign: f"\\{sign}" for sign in "&%$#_{}"},
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "\\": r"\textbackslash{}",
    }
)

_STYLE: Mapping[str, Any] = {
    "figure.figsize": (3.5, 2.3),
    "figure.constrained_layout.use": True,
    "savefig.dpi": 300,
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.labelsize": 8,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "legend.fontsize": 7,
    "figure.titlesize": 9,
    # Okabe and Ito's colours: safe for the colour-blind.
    "axes.prop_cycle": (
        "cycler('color', ['0072B2', 'D55E00', '009E73', 'CC79A7', 'E69F00', '56B4E9'])"
    ),
    "image.cmap": "viridis_r",
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.xmargin": 0.0,
    "grid.color": "0.9",
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.2,
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    "legend.columnspacing": 1.2,
    "svg.fonttype": "none",
    "pdf.fonttype": 42,
    "agg.path.chunksize": 10_000,
}
"""Over Matplotlib's defaults, below the user's matplotlibrc and style sheet. Text stays text in
SVG; fonts of PDF are TrueType, as publishers want them."""

_FIXED: Mapping[str, Any] = {"svg.hashsalt": "vsense", "text.parse_math": False}
"""Over everything: the same files every time, and a dollar sign in a name is no formula."""

_METADATA: Mapping[str, dict[str, Any]] = {
    "png": {"Software": None},
    "svg": {"Date": None},
    "pdf": {"CreationDate": None},
}
"""Leaves out when a file was made."""


@dataclass(frozen=True, slots=True)
class Drawing:
    """A figure of a report.

    Attributes:
        name: of its file, without a suffix.
        caption: what it shows, understood without the text around it.
        wide: it is as wide as a page, else as a column.
    """

    name: str
    title: str
    caption: str
    figure: Figure
    wide: bool = False


class _Complaints(logging.Handler):
    """Keeps each different warning of Matplotlib."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.lines: dict[str, None] = {}

    def emit(self, record: logging.LogRecord) -> None:
        self.lines[record.getMessage().strip().splitlines()[0]] = None


@contextmanager
def styled(sheet: str | None = None) -> Iterator[None]:
    """Draws in our style, over it the user's matplotlibrc, over both a style sheet.

    Of a matplotlibrc in the current folder, which Matplotlib would take first, nothing counts: that
    folder may be somebody else's. `sheet` is a path, or a name that `matplotlib.style` knows;
    UsageError if there is none, or something in it is no setting. Warnings of Matplotlib, such as
    of a missing font, are logged once at the end.
    """
    import matplotlib
    from matplotlib import style

    complaints, log = _Complaints(), logging.getLogger("matplotlib")
    log.addHandler(complaints)
    try:
        own = _own_settings()
        complaints.lines.clear()  # Matplotlib told them when it was imported.
        with matplotlib.rc_context():
            style.use("default")
            matplotlib.rcParams.update({**_STYLE, **own})
            try:
                style.use(sheet or {})
            except OSError:
                raise UsageError(f"--style {sheet}: {_NO_SHEET}") from None
            except ValueError as error:
                complaints.lines = {str(error): None}
            if complaints.lines:
                line = next(iter(complaints.lines))
                complaints.lines.clear()
                raise UsageError(f"--style {sheet}: {line}")
            matplotlib.rcParams.update(_FIXED)
            yield
    finally:
        log.removeHandler(complaints)
        for line in complaints.lines:
            log.warning(line)


def _own_settings() -> Mapping[str, Any]:
    """What is in the user's matplotlibrc: where $MATPLOTLIBRC says, or in Matplotlib's folder."""
    import matplotlib

    named = os.environ.get("MATPLOTLIBRC", "")
    places = (named, f"{named}/matplotlibrc", f"{matplotlib.get_configdir()}/matplotlibrc")
    path = next(filter(os.path.isfile, places), None)
    return {} if path is None else matplotlib.rc_params_from_file(path, False, False)


def require_sheet(sheet: str | None) -> None:
    """Checks a style sheet before anything is read or simulated; raises as `styled` does."""
    if sheet is not None and can_draw():
        with styled(sheet):
            pass


def setting(name: str) -> Any:
    """The value of one of Matplotlib's settings."""
    import matplotlib

    return matplotlib.rcParams[name]


def new_figure(width_in: float | None = None, height_in: float | None = None) -> Figure:
    """An empty figure, by default of the size that the style gives a chart [inch]."""
    from matplotlib.figure import Figure

    width, height = setting("figure.figsize")
    return Figure((width_in or width, height_in or height))


def width_of(wide: bool) -> float:
    """Width of a page or a column [inch]."""
    width = float(setting("figure.figsize")[0])
    return _WIDE * width if wide else width


def encode(figure: Figure, form: str) -> bytes:
    """A figure as a file of one of `FORMATS`.

    VsenseError if it cannot be drawn, such as with LaTeX where there is none.
    """
    data = io.BytesIO()
    try:
        figure.savefig(data, format=form, metadata=_METADATA[form])
    except RuntimeError as error:
        line = (str(error).strip() or "unknown").splitlines()[0]
        raise VsenseError(f"charts cannot be drawn in this style: {line}") from None
    return data.getvalue()


def label(text: str) -> str:
    """Text made safe for drawing."""
    text = text.encode("utf-8", "replace").decode()
    return text.translate(_TEX) if setting("text.usetex") else text


def wrapped(text: str, letters: int) -> str:
    """Text in lines of about so many letters; names of settings break at '=', '.' and '_'.

    Half a word says little: what has no such place may be half as long again in one line.
    """
    most, lines = 3 * letters // 2, [""]
    for word in _BREAKS.split(text):
        for piece in (word[at : at + most] for at in range(0, len(word), most)):
            if len(lines[-1]) + len(piece.rstrip()) > letters and lines[-1]:
                lines.append("")
            lines[-1] += piece
    return "\n".join(line.strip() for line in lines)


def measure_label(name: str) -> str:
    """A measure's name and unit for an axis."""
    return label(spoken(name)[:_MOST_LETTERS])


def steps(axes: Axes, times: ArrayLike, values: ArrayLike, colour: str, **style: Any) -> None:
    """Draws values that last until the next; of many, the least and greatest at each place."""
    x, y = np.asarray(times, np.float64), np.asarray(values, np.float64)
    step = -(-len(x) // MOST_PLACES)
    if step > 2:
        indices = []
        for begin in range(0, len(x), step):
            part = y[begin : begin + step]
            indices.append(np.unique([0, part.argmin(), part.argmax(), len(part) - 1]) + begin)
        x, y = x[np.concatenate(indices)], y[np.concatenate(indices)]
    axes.step(x, y, colour, where="post", **style)


def from_zero(axes: Axes, values: Sequence[float]) -> None:
    """Makes an axis begin at 0, or below it where a value is; counts have whole numbers."""
    low, high = min(0.0, *values), max(0.0, *values)
    room = 0.08 * (high - low) or 1.0
    axes.set_ylim(low - (room if low < 0.0 else 0.0), high + room)
    _whole_ticks(axes.yaxis, values)


def _whole_ticks(axis: Any, values: Sequence[float]) -> None:
    from matplotlib.ticker import MaxNLocator

    if all(float(value).is_integer() for value in values):
        axis.set_major_locator(MaxNLocator("auto", integer=True))


FEWEST_BOXED = 5
"""Runs that a box needs."""
RUNS_LEGEND = "dot: a run; line: median; box: quartiles; diamond: mean"
_HALF = 0.32
"""Half of a box's height, in rows."""
_GOLDEN = 0.618034
_LINE_IN, _GAP_IN = 0.13, 0.14
"""Height of a line of a condition's name, and room between two conditions [inch]."""


def file_words(measure: str) -> str:
    """A measure's name as a part of a file's."""
    return re.sub(r"[^A-Za-z0-9_]+", "-", measure)[:40].strip("-")


def runs_figure(
    measure: str,
    groups: Sequence[tuple[str, Sequence[float]]],
    letters: int,
    colours: Sequence[str] = ("C0",),
) -> Figure:
    """What runs have measured, as `draw_runs`, with the names of groups in lines of `letters`."""
    labels = [f"{wrapped(label(name), letters)}\n(n = {len(values)})" for name, values in groups]
    figure = new_figure(height_in=_FRAME_IN + runs_height(labels))
    axes = figure.subplots()
    draw_runs(axes, measure, [values for _, values in groups], colours)
    axes.set_yticks(range(len(labels)), labels)
    return figure


def runs_height(labels: Sequence[str]) -> float:
    """How high the rows of `draw_runs` are [inch]."""
    return len(labels) * (_LINE_IN * max(text.count("\n") + 1 for text in labels) + _GAP_IN)


def draw_runs(
    axes: Axes, measure: str, groups: Sequence[Sequence[float]], colours: Sequence[str] = ("C0",)
) -> None:
    """Draws what runs have measured, a row for each group; the first on top.

    The axis begins at 0 where the values are near it, and has whole numbers for counts.
    """
    for place, values in enumerate(groups):
        if len(values):
            _row(axes, place, np.asarray(values, np.float64), colours[place % len(colours)])
    axes.set(xlabel=textwrap.fill(measure_label(measure), 40), ylim=(len(groups) - 0.5, -0.5))
    axes.grid(False, axis="y")
    axes.tick_params("y", length=0)
    every = [float(value) for values in groups for value in values]
    if every:
        axes.set_xlim(_span(min(every), max(every)))
        _whole_ticks(axes.xaxis, every)


def _span(least: float, most: float) -> tuple[float, float]:
    """An axis for values: from 0, unless they vary a little around much; with room at its ends."""
    low = 0.0 if least > 0.0 and (least < 0.6 * most or least == most) else least
    high = 0.0 if most < 0.0 and (most > 0.6 * least or least == most) else most
    high = low + 1.0 if high == low else high
    room = 0.04 * (high - low)
    return low - room * (low == least), high + room * (high == most)


def _row(axes: Axes, place: int, values: Floats, colour: str) -> None:
    """The runs of one group: box, median, a dot each, and their mean."""
    ink = setting("text.color")
    low, middle, high = np.percentile(values, (25, 50, 75))
    if len(values) >= FEWEST_BOXED:
        axes.barh(place, high - low, 2 * _HALF, low, facecolor=colour, alpha=0.2)
        axes.barh(place, high - low, 2 * _HALF, low, fill=False, edgecolor=colour, linewidth=0.8)
    axes.vlines(middle, place - _HALF, place + _HALF, color=ink, linewidth=1.4)
    # Runs that gave the same lie beside each other: steps of the golden ratio spread them.
    offsets = 1.4 * _HALF * ((np.arange(len(values)) * _GOLDEN) % 1.0 - 0.5)
    # What lies on the axis is whole, too.
    dots: dict[str, Any] = {
        "color": colour,
        "markersize": 2.8,
        "alpha": 0.85,
        "markeredgewidth": 0.0,
    }
    axes.plot(values, place + offsets, "o", clip_on=False, zorder=3, **dots)
    mean: dict[str, Any] = {"markerfacecolor": setting("axes.facecolor"), "markeredgecolor": ink}
    axes.plot(values.mean(), place, "D", clip_on=False, zorder=4, markersize=4.0, **mean)
