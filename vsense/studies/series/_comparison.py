"""The picture of a campaign: one panel per measure, one row per setting.

Every run is a dot; the box spans the middle half of the runs, the line in it is their median, and
the number beside it their mean.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vsense.studies.report._plot import label, measure_label, new_figure, setting, width_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PANELS_IN_ROW = 2
_LINE_IN, _GAP_IN = 0.13, 0.14
"""Height of a line of a setting's name, and room between two settings [inch]."""
_FRAME_IN, _HEAD_IN = 0.45, 0.6
"""Room for the numbers of a panel, and for title and legend [inch]."""
_HALF = 0.32
"""Half of a box's height, in rows."""
_LETTERS, _MOST_LINES = 26, 3
"""Of a setting's name and value: letters in a line, and lines."""
_GOLDEN = 0.618034
_LEGEND = "dot: a run; box: the middle half; line: median; number: mean"

Floats = NDArray[np.float64]


def draw(
    title: str,
    settings: Sequence[Mapping[str, str]],
    measures: Mapping[str, Sequence[Sequence[float]]],
) -> Figure:
    """Draws the comparison, in a style of `vsense.studies.report._plot`.

    `measures` are, by name, the values of the runs for every combination of `settings`; one measure
    at least.
    """
    names = [_name(values) for values in settings]
    if len(set(names)) < len(names):  # shortened, they may say the same
        names = [f"{number}. {name}" for number, name in enumerate(names, 1)]
    labels = [label(name) for name in names]
    row_in = _LINE_IN * max(text.count("\n") + 1 for text in labels) + _GAP_IN
    bands = -(-len(measures) // PANELS_IN_ROW)
    columns = min(len(measures), PANELS_IN_ROW)
    height_in = _HEAD_IN + bands * (row_in * len(labels) + _FRAME_IN)
    figure = new_figure(width_of(wide=columns > 1), height_in)
    panels = figure.subplots(bands, columns, sharey=True, squeeze=False)
    runs = [len(results) for results in next(iter(measures.values()))]
    figure.suptitle(label(f"{title}: {_count(runs)} of each setting"))
    figure.supxlabel(_LEGEND, fontsize=setting("xtick.labelsize"), color="0.4")
    for axes, (name, groups) in zip(panels.flat, measures.items()):
        _panel(axes, name, [np.asarray(results, dtype=np.float64) for results in groups])
    for axes in panels.flat[len(measures) :]:
        axes.remove()
    for axes in panels[:, 0]:
        axes.set_yticks(range(len(labels)), labels)
    return figure


def _name(values: Mapping[str, str]) -> str:
    """What tells a setting from others; long values, such as of a state machine, are shortened."""
    lines: list[str] = []
    for key, value in values.items():
        words = f"{key} = {value}"
        lines += textwrap.wrap(words, _LETTERS, max_lines=_MOST_LINES, placeholder=" ...")
    return "\n".join(lines) or "as in the file"


def _count(runs: Sequence[int]) -> str:
    least, most = min(runs), max(runs)
    count = f"{least}" if least == most else f"{least} to {most}"
    return f"{count} {'run' if most == 1 else 'runs'}"


def _panel(axes: Axes, name: str, groups: Sequence[Floats]) -> None:
    """One measure of all settings."""
    axes.set_xlabel(measure_label(name))
    axes.set_ylim(len(groups) - 0.5, -0.5)
    axes.grid(False, axis="y")
    axes.tick_params("y", length=0)
    axes.set_xmargin(0.05)
    for place, values in enumerate(groups):
        if len(values):
            _row(axes, place, values)


def _row(axes: Axes, place: int, values: Floats) -> None:
    """The runs of one setting: box, median, a dot each, and their mean."""
    low, middle, high = np.percentile(values, (25, 50, 75))
    axes.barh(place, high - low, 2 * _HALF, low, facecolor="C0", alpha=0.2)
    axes.barh(place, high - low, 2 * _HALF, low, fill=False, edgecolor="C0", linewidth=0.8)
    # Runs that gave the same lie beside each other: steps of the golden ratio spread them.
    offsets = (np.arange(len(values)) * _GOLDEN) % 1.0 - 0.5
    axes.plot(values, place + 1.4 * _HALF * offsets, "o", color="C0", markersize=2.5, alpha=0.8)
    axes.vlines(middle, place - _HALF, place + _HALF, color="C1", linewidth=1.6)
    axes.text(
        1.02,
        place,
        f"{values.mean():.3g}",
        transform=axes.get_yaxis_transform(),
        verticalalignment="center",
        fontsize=setting("ytick.labelsize"),
    )
