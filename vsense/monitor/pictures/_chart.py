"""Measures over time, drawn as charts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats
from vsense.base.canvas import GRID, MUTED, Canvas, Colour, width_of

CHART_PX = 300
LABEL = 0.45
_LEFT = 48
"""Room for the numbers on the left."""


@dataclass(frozen=True, slots=True)
class ChartSeries:
    """One measure over time: its name, (n,) values and its colour."""

    name: str
    values: NDArray[np.float64]
    colour: Colour


@dataclass(frozen=True, slots=True)
class Chart:
    """A chart of one measure or more.

    Attributes:
        unit: Label of the vertical axis.
        time_s: (n + 1,) when each timestep began, and when the last one ended.
        top: End of the vertical axis; it begins at 0 or at the smallest value below.
        marks: Events: time in s and words.
    """

    unit: str
    time_s: NDArray[np.float64]
    series: Sequence[ChartSeries]
    top: float
    marks: Sequence[tuple[float, str]] = ()


def draw_chart(canvas: Canvas, chart: Chart, left: float, top: float, width: float) -> None:
    """Draws a chart of `CHART_PX` px into a picture; left, top, width in px."""
    names = max(width_of(series.name, 0.5) for series in chart.series)
    axis = _Axis(chart, left + _LEFT, top, width - _LEFT - names - 20)
    axis.grid(canvas, chart.unit, left)
    for time_s, words in chart.marks:
        if 0.0 < time_s < chart.time_s[-1]:
            x = axis.at(time_s, 0.0)[0]
            canvas.lines(np.array([[x, top - 8], [x, axis.bottom]]), MUTED)
            canvas.text(words, x + 8, top - 2, MUTED, LABEL)
    ends = []
    for series in chart.series:
        times = np.repeat(chart.time_s, 2)[1:-1]
        stairs = zip(times, np.repeat(series.values, 2), strict=True)
        points = np.array([axis.at(time_s, value) for time_s, value in stairs])
        canvas.lines(points, series.colour, 2.0)
        ends.append((float(points[-1, 1]), series.name, series.colour))
    _line_names(canvas, ends, axis.right + 12)
    floor = np.array([[axis.left, axis.bottom], [axis.right, axis.bottom]])
    canvas.lines(floor, MUTED)


class _Axis:
    """Maps times and values to the picture."""

    def __init__(self, chart: Chart, left: float, top: float, width: float) -> None:
        lowest = min(float(series.values.min()) for series in chart.series)
        highest = max(float(series.values.max()) for series in chart.series)
        self.left, self.right = left, left + width
        self._top, self.bottom = top, top + CHART_PX
        self._low, self._high = min(lowest, 0.0), max(chart.top, highest, 1e-9)
        self._end_s = float(chart.time_s[-1])

    def at(self, time_s: float, value: float) -> tuple[float, float]:
        """The place of a value at a time."""
        x = self.left + (self.right - self.left) * time_s / self._end_s
        share = (value - self._low) / (self._high - self._low)
        return x, self.bottom - (self.bottom - self._top) * share

    def grid(self, canvas: Canvas, unit: str, left: float) -> None:
        """Draws numbers and lines along both axes."""
        for value in ticks(self._low, self._high, 5):
            y = self.at(0.0, value)[1]
            canvas.lines(np.array([[self.left, y], [self.right, y]]), GRID)
            label = f"{value:g}"
            canvas.text(label, self.left - 10 - width_of(label, LABEL), y + 5, MUTED, LABEL)
        for time_s in ticks(0.0, self._end_s, 4 + round((self.right - self.left) / 400)):
            x = self.at(time_s, 0.0)[0]
            canvas.lines(np.array([[x, self.bottom], [x, self.bottom + 6]]), MUTED)
            label = f"{time_s:g} s"
            canvas.text(label, x - width_of(label, LABEL) / 2, self.bottom + 24, MUTED, LABEL)
        canvas.text(unit, left, self._top - 14, MUTED, LABEL)


def _line_names(canvas: Canvas, ends: list[tuple[float, str, Colour]], x: float) -> None:
    """Names each line at its end, without overlaps."""
    lowest = -100.0
    for y, name, colour in sorted(ends, key=lambda end: end[0]):
        y = max(y, lowest + 20.0)
        canvas.text(name, x, y + 5.0, colour, 0.5)
        lowest = y


def ticks(low: float, high: float, most: int) -> Floats:
    """Round values between two ends, at most `most` steps of 1, 2 or 5 times a power of ten."""
    raw = (high - low) / most
    power = 10.0 ** np.floor(np.log10(raw))
    step = next(s * power for s in (1, 2, 5, 10) if s * power >= raw * (1.0 - 1e-9))
    first = np.ceil(low / step - 1e-9)
    count = np.floor(high / step + 1e-9) - first + 1
    return np.asarray((first + np.arange(count)) * step)
