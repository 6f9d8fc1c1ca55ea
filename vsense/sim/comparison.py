"""`results.png`: what every setting of a campaign gave, one row each, one panel per measure.

Every run is a dot; the box spans the middle half of the runs, the line in it is their median, and
the number beside it their mean.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from vsense.pictures.canvas import GRID, INK, MUTED, Canvas, Colour, Image, width_of

DOT: Colour = (160, 96, 40)
BOX: Colour = (60, 140, 245)
MEDIAN: Colour = (20, 90, 200)
STRIPE: Colour = (250, 248, 246)

MARGIN = 32
HEAD = 92
ROW = 34
PANEL = 300
"""Width of a panel's axis."""
MEAN = 64
"""Room for the mean beside it."""
GAP = 36
FOOT = 40
PANELS_IN_ROW = 2
TEXT = 0.45
DOT_RADIUS = 2.6
GOLDEN = 0.618034
LEAST_SHARE = 1e-9
"""Values that differ by less than this share of their size are the same to the eye."""
LEAST_SPAN = 1e-200

Floats = NDArray[np.float64]


def draw(
    title: str,
    settings: Sequence[Mapping[str, str]],
    measures: Mapping[str, Sequence[Sequence[float]]],
) -> Image:
    """Draws the comparison.

    Args:
        title: the experiment.
        settings: every combination of settings.
        measures: by name, for every combination what its runs gave.

    Returns:
        (h, w, 3) BGR image.
    """
    labels = [
        ", ".join(f"{key} {value}" for key, value in some.items()) or "as in the file"
        for some in settings
    ]
    left = MARGIN + max(round(max(width_of(label, TEXT) for label in labels)), 120) + 20
    band = len(labels) * ROW + FOOT + GAP
    columns = min(len(measures), PANELS_IN_ROW)
    bands = -(-len(measures) // PANELS_IN_ROW)
    width = left + columns * (PANEL + MEAN) + (columns - 1) * GAP + MARGIN
    canvas = Canvas(width, HEAD + bands * band + MARGIN)
    runs = [len(some) for some in next(iter(measures.values()))]
    canvas.text(title, MARGIN, 44, INK, 0.9)
    canvas.text(_subtitle(runs), MARGIN, 68, MUTED, TEXT)
    for place, (name, groups) in enumerate(measures.items()):
        row, column = divmod(place, PANELS_IN_ROW)
        top = HEAD + row * band + GAP
        x = left + column * (PANEL + MEAN + GAP)
        if column == 0:
            for number, label in enumerate(labels):
                canvas.text(label, MARGIN, top + (number + 0.5) * ROW + 5, INK, TEXT)
        _panel(canvas, x, top, name, [np.asarray(some, dtype=np.float64) for some in groups])
    return canvas.finished()


def _subtitle(runs: Sequence[int]) -> str:
    least, most = min(runs), max(runs)
    each = f"{least}" if least == most else f"{least} to {most}"
    noun = "run" if most == 1 else "runs"
    legend = "a dot is a run, the box the middle half, the number the mean"
    return f"{each} {noun} of each setting; {legend}"


def _panel(canvas: Canvas, x: int, top: int, name: str, groups: Sequence[Floats]) -> None:
    """One measure of all settings."""
    values = np.concatenate(groups)
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 1.0)
    marks = round_marks(low, high)
    low, high = marks[0], marks[-1]

    def at(value: float) -> float:
        return x + PANEL * (value - low) / (high - low)

    bottom = top + len(groups) * ROW
    canvas.text(name.replace("_", " "), x, top - 12, INK, 0.5)
    for number in range(0, len(groups), 2):
        canvas.fill(_corners(x, top + number * ROW, x + PANEL, top + (number + 1) * ROW), STRIPE)
    for mark in marks:
        canvas.lines(np.array([(at(mark), top), (at(mark), bottom)]), GRID)
        label = f"{mark:g}"
        canvas.text(label, at(mark) - width_of(label, TEXT) / 2, bottom + 20, MUTED, TEXT)
    canvas.lines(np.array([(x, bottom), (x + PANEL, bottom)]), MUTED)
    for number, some in enumerate(groups):
        if len(some):
            _row(canvas, at, top + (number + 0.5) * ROW, some)
            canvas.text(
                f"{some.mean():.3g}", x + PANEL + 12, top + (number + 0.5) * ROW + 5, INK, TEXT
            )


def _row(canvas: Canvas, at: Callable[[float], float], y: float, values: Floats) -> None:
    """The runs of one setting: box, median, and a dot each."""
    low, middle, high = (at(float(q)) for q in np.percentile(values, (25, 50, 75)))
    half = 0.34 * ROW
    canvas.fill(_corners(low - 1, y - half, high + 1, y + half), BOX, 0.25)
    canvas.lines(_corners(low - 1, y - half, high + 1, y + half), BOX, closed=True)
    for number, value in enumerate(values.tolist()):
        # Runs that gave the same lie beside each other: steps of the golden ratio spread them.
        offset = (number * GOLDEN) % 1.0 - 0.5
        canvas.dot(np.array((at(value), y + 1.4 * half * offset)), DOT_RADIUS, DOT)
    canvas.lines(np.array([(middle, y - half), (middle, y + half)]), MEDIAN, 2.0)


def _corners(left: float, top: float, right: float, bottom: float) -> Floats:
    return np.array([(left, top), (right, top), (right, bottom), (left, bottom)], dtype=np.float64)


def round_marks(low: float, high: float, most: int = 5) -> list[float]:
    """Round values that enclose low and high: steps of 1, 2 or 5 times a power of ten.

    Args:
        low: least value.
        high: greatest value.
        most: steps between the two, nearly.
    """
    size = max(abs(low), abs(high))
    span = high - low if high - low > LEAST_SHARE * size else size
    span = span if span > LEAST_SPAN else 1.0
    power = 10.0 ** math.floor(math.log10(span / most))
    step = next(some * power for some in (1, 2, 5, 10) if some * power >= span / most * (1 - 1e-9))
    first = math.floor(low / step + LEAST_SHARE)
    last = max(math.ceil(high / step - LEAST_SHARE), first + 1)
    return [number * step for number in range(first, last + 1)]
