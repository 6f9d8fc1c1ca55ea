"""Figures of studies: every run a point over its condition's notched box."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from vsense.monitor.pictures.run_figure import spoken
from vsense.studies.report import plot
from vsense.studies.report.plot import Drawing
from vsense.studies.report.study.effects import Spread
from vsense.studies.report.study.rank_tests import Floats
from vsense.studies.report.study.results import MeasureResult, StudyResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FEWEST = 5
"""Runs that a box needs."""
_MOST_UPRIGHT = 5
"""Conditions that stand side by side; more lie below each other, with their names in full."""
_HALF, _WAIST = 0.3, 0.15
"""Half of a box's width, and of its notch, in places of conditions."""
_WHISKER = 1.5
"""Interquartile ranges from the box that a whisker reaches at most (Tukey)."""
_GOLDEN = 0.618034
_ROW_IN, _FRAME_IN = 0.36, 0.65
_LETTERS = 30


def boxes(result: StudyResult, prefix: str) -> Iterator[Drawing]:
    """Draws each measure of a study; `prefix` begins the files' names."""
    for place, found in enumerate(result.measures, start=1):
        words = re.sub(r"[^A-Za-z0-9_]+", "-", found.measure)[:40].strip("-")
        yield _drawing(result, found, f"{prefix}{place:02d}-{words}")


def _drawing(result: StudyResult, found: MeasureResult, file: str) -> Drawing:
    count = len(found.values)
    upright = count <= _MOST_UPRIGHT
    labels = [
        plot.wrapped(plot.label(arm.label), _LETTERS if not upright else max(44 // count, 9))
        + f"\n(n = {len(values)})"
        for arm, values in zip(result.study.arms, found.values)
    ]
    lines = max(label.count("\n") + 1 for label in labels)
    height = None if upright else _FRAME_IN + count * max(_ROW_IN, 0.13 * lines)
    figure = plot.new_figure(height_in=height)
    axes = figure.subplots()
    for place, (values, spread) in enumerate(zip(found.values, found.spreads)):
        if spread is not None:
            _arm(_Pen(axes, place, upright), values, spread, f"C{place % 6}")
    _axes(axes, found, labels, upright)
    title = f"{spoken(found.measure)} of each run".capitalize()
    return Drawing(file, title, caption(result, found), figure)


def _axes(axes: Axes, found: MeasureResult, labels: Sequence[str], upright: bool) -> None:
    ends, measured = (-0.6, len(labels) - 0.4), plot.measure_label(found.measure)
    if upright:
        axes.set(xlim=ends, ylabel=textwrap.fill(measured, 26))
        axes.set_xticks(range(len(labels)), labels)
        axes.grid(False, axis="x")
        axes.margins(y=0.08)
    else:
        axes.set(ylim=ends[::-1], xlabel=measured)
        axes.set_yticks(range(len(labels)), labels)
        axes.grid(False, axis="y")
        axes.margins(x=0.05)


class _Pen:
    """Draws at a condition's place; values go up, or to the right."""

    def __init__(self, axes: Axes, place: float, upright: bool) -> None:
        self._axes, self._place, self._upright = axes, place, upright

    def line(self, across: Sequence[float], values: Sequence[float], **style: Any) -> None:
        """Draws a line, or dots; `across` is measured from the place."""
        x: Sequence[float] | Floats = [self._place + each for each in across]
        x, y = (x, values) if self._upright else (values, x)
        self._axes.plot(x, y, **style)

    def area(self, across: Sequence[float], values: Sequence[float], **style: Any) -> None:
        """Fills an area."""
        x: Sequence[float] | Floats = [self._place + each for each in across]
        x, y = (x, values) if self._upright else (values, x)
        self._axes.fill(x, y, **style)


def _arm(pen: _Pen, values: Floats, spread: Spread, colour: str) -> None:
    """The runs of one condition."""
    ink = plot.setting("text.color")
    waist = _HALF
    if spread.n >= FEWEST:
        across, along, waist = _outline(spread)
        pen.area(across, along, facecolor=colour, alpha=0.18, linewidth=0)
        pen.line([*across, across[0]], [*along, along[0]], color=colour, linewidth=0.8)
        for edge, end in zip(spread.quartiles, _whiskers(values, spread)):
            pen.line([0.0, 0.0], [edge, end], color=colour, linewidth=0.8)
    pen.line([-waist, waist], [spread.median] * 2, color=ink, linewidth=1.4)
    # Runs that gave the same lie beside each other: steps of the golden ratio spread them.
    offsets = 1.2 * _HALF * ((np.arange(len(values)) * _GOLDEN) % 1.0 - 0.5)
    style = {"linestyle": "none", "marker": "o", "markersize": 2.8, "markeredgewidth": 0.0}
    pen.line(offsets.tolist(), values.tolist(), color=colour, alpha=0.85, zorder=3, **style)


def _outline(spread: Spread) -> tuple[list[float], list[float], float]:
    """The corners of a box and its notch, and half of its waist's width.

    Where the notch is wider than the box, its corners fold over, as in R and Matplotlib.
    """
    low, high = spread.quartiles
    under, over = spread.notch or (low, high)
    side = [(_HALF, low), (_HALF, under), (_WAIST, spread.median), (_HALF, over), (_HALF, high)]
    whole = [*side, *((-x, y) for x, y in side[::-1])]
    return [x for x, _ in whole], [y for _, y in whole], _WAIST


def _folds(spread: Spread | None) -> bool:
    """Whether the notch is wider than the box, at one end at least."""
    if spread is None or spread.notch is None or spread.n < FEWEST:
        return False
    return spread.notch[0] < spread.quartiles[0] or spread.notch[1] > spread.quartiles[1]


def _whiskers(values: Floats, spread: Spread) -> tuple[float, float]:
    """The last runs within `_WHISKER` interquartile ranges of the box."""
    low, high = spread.quartiles
    reach = _WHISKER * (high - low)
    inside = values[(values >= low - reach) & (values <= high + reach)]
    return min(float(inside.min()), low), max(float(inside.max()), high)


def caption(result: StudyResult, found: MeasureResult) -> str:
    """What a figure shows, with the number of runs and of void ones."""
    arms = result.study.arms
    words = f"{result.study.title}. A dot is a run"
    boxed = [s is not None and s.n >= FEWEST for s in found.spreads]
    if any(boxed):
        words += (
            "; boxes: quartiles and median, whiskers to the last run within 1.5 interquartile"
            " ranges; notches: 95 % interval of the median"
        )
    if any(map(_folds, found.spreads)):
        words += ", beyond the box where its corners fold over"
    few = [a.label for a, box in zip(arms, boxed) if not box]
    if few:
        words += f"; line: median, no box of fewer than {FEWEST} runs ({', '.join(few)})"
    counts = [
        f"{arm.label} {len(values)} (void: {len(arm.voids)})"
        for arm, values in zip(arms, found.values)
    ]
    return f"{words}. n: {', '.join(counts)}. Void runs are not drawn."
