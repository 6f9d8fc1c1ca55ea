"""Axes with units, and what is drawn along them, on the canvas that all pictures share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsense.pictures import chart
from vsense.pictures.canvas import GRID, INK, MUTED, SCALE, Canvas, Colour, Floats, width_of

TEXT = 0.46
SMALL = 0.42
WIDE_PX, HALF_PX = 920, 450
"""Widths of pictures: a page's, and of two side by side."""

# Okabe and Ito's colours (blue, green, red): told apart by everybody.
BLUE: Colour = (178, 114, 0)
ORANGE: Colour = (0, 94, 213)
GREEN: Colour = (115, 158, 0)
PINK: Colour = (167, 121, 204)
AMBER: Colour = (0, 159, 230)
SKY: Colour = (233, 180, 86)
COLOURS = (BLUE, ORANGE, GREEN, PINK, AMBER, SKY)
GREY: Colour = (200, 194, 190)

_LEFT, _RIGHT, _TOP, _BOTTOM = 54, 16, 34, 50
_MOST_COLUMNS = 800
_LOG_STEPS = ((1, 1.5, 2, 3, 4, 5, 6, 7, 8, 9), (1, 2, 3, 5, 7), (1, 2, 5), (1,))


@dataclass(frozen=True, slots=True)
class Range:
    """What an axis shows.

    Attributes:
        low, high: its ends, low < high.
        label: what it is, with its unit.
        log: equal steps are equal factors; low > 0.
        bare: it has no numbers.
    """

    low: float
    high: float
    label: str
    log: bool = False
    bare: bool = False

    def share(self, values: ArrayLike) -> Floats:
        """Where values lie, 0 at the low end, 1 at the high one."""
        found = np.asarray(values, np.float64)
        if self.log:
            found = np.log(np.maximum(found, 1e-12) / self.low)
            return np.asarray(found / np.log(self.high / self.low))
        return np.asarray((found - self.low) / (self.high - self.low))

    def ticks(self, most: int) -> list[float]:
        """Round values between the ends."""
        if self.bare:
            return []
        if not self.log:
            return ticks(self.low, self.high, most)
        powers = range(int(np.floor(np.log10(self.low))), int(np.ceil(np.log10(self.high))) + 1)
        inside: list[float] = []
        for steps in _LOG_STEPS:
            found = [step * 10.0**power for power in powers for step in steps]
            inside = [value for value in found if self.low * 0.999 <= value <= self.high * 1.001]
            if len(inside) <= most + 2:
                break
        return inside


def spanning(values: ArrayLike, label: str, from_zero: bool = True) -> Range:
    """An axis for values: finite ones, with some room above; from 0 where that is asked."""
    found = np.asarray(values, np.float64).ravel()
    found = found[np.isfinite(found)]
    low, high = (float(found.min()), float(found.max())) if len(found) else (0.0, 1.0)
    if from_zero:
        low, high = min(low, 0.0), max(high, 0.0)
    if high - low < 1e-9 * max(abs(high), abs(low), 1e-3):
        high = low + max(abs(low), 1.0)
    return Range(low, high + 0.06 * (high - low), label)


def ticks(low: float, high: float, most: int) -> list[float]:
    """Those of charts, to be written in full: without the last bits' noise, and no -0."""
    return [float(f"{value:.10g}") + 0.0 for value in chart.ticks(low, high, most)]


class Plot:
    """One pair of axes in a picture; later things cover earlier ones.

    Attributes:
        canvas: where it is drawn.
        x, y: the axes.
        left, right, top, bottom: the frame [px].
    """

    def __init__(
        self,
        canvas: Canvas,
        x: Range,
        y: Range,
        frame: tuple[float, float, float, float] | None = None,
    ) -> None:
        """Draws grid and numbers.

        Args:
            canvas: the picture.
            x: the axis below.
            y: the axis on the left; its label stands above it.
            frame: left, top, right, bottom [px] with room for the numbers outside; None: the
                whole picture.
        """
        height, width = canvas.image.shape[0] / SCALE, canvas.image.shape[1] / SCALE
        self.canvas, self.x, self.y = canvas, x, y
        whole = (float(_LEFT), float(_TOP), width - _RIGHT, height - _BOTTOM)
        edges: tuple[float, float, float, float] = frame or whole
        self.left, self.top, self.right, self.bottom = edges
        self._grid()

    def at(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Places of points, (n, 2) px; what is far outside stays near."""
        across, up = np.clip(self.x.share(x), -1, 2), np.clip(self.y.share(y), -1, 2)
        px = self.left + (self.right - self.left) * across
        py = self.bottom - (self.bottom - self.top) * up
        return np.stack(np.broadcast_arrays(px, py), axis=-1)

    def _grid(self) -> None:
        canvas = self.canvas
        for value in self.y.ticks(max(round((self.bottom - self.top) / 42), 2)):
            y = float(self.at(self.x.low, value)[1])
            canvas.lines(np.array([[self.left, y], [self.right, y]]), GRID)
            label = f"{value:g}"
            canvas.text(label, self.left - 8 - width_of(label, TEXT), y + 5, INK, TEXT)
        for value in self.x.ticks(max(round((self.right - self.left) / 80), 2)):
            x = float(self.at(value, self.y.low)[0])
            canvas.lines(np.array([[x, self.bottom], [x, self.bottom + 5]]), MUTED)
            label = f"{value:g}"
            canvas.text(label, x - width_of(label, TEXT) / 2, self.bottom + 20, INK, TEXT)
        floor = np.array([[self.left, self.bottom], [self.right, self.bottom]])
        canvas.lines(floor, MUTED)
        canvas.text(self.y.label, max(self.left - 44, 4), self.top - 14, INK, TEXT)
        middle = (self.left + self.right - width_of(self.x.label, TEXT)) / 2
        canvas.text(self.x.label, middle, self.bottom + 40, INK, TEXT)

    def line(
        self, x: ArrayLike, y: ArrayLike, colour: Colour, width: float = 1.5, steps: bool = False
    ) -> None:
        """Draws a line through points; a NaN parts it. With `steps` a value lasts to the next."""
        xs, ys = thinned(np.asarray(x, np.float64), np.asarray(y, np.float64))
        if steps and len(xs) > 1:
            xs, ys = np.repeat(xs, 2)[1:], np.repeat(ys, 2)[:-1]
        for piece in pieces(np.stack([xs, ys], axis=-1)):
            self.canvas.lines(self.at(piece[:, 0], piece[:, 1]), colour, width)

    def band(self, x: ArrayLike, low: ArrayLike, high: ArrayLike, colour: Colour) -> None:
        """Tints what lies between two curves, (n,) each without NaN."""
        below, above = self.at(x, low), self.at(x, high)[::-1]
        outline = np.concatenate([below, above])
        outline[:, 1] = np.clip(outline[:, 1], self.top, self.bottom)
        veil(self.canvas, [outline], colour, 0.22)

    def bars(self, edges: Floats, heights: Floats, colour: Colour) -> None:
        """Draws bars from the axis below, (n + 1,) edges and (n,) heights."""
        for low, high, height in zip(edges[:-1], edges[1:], heights):
            if height > 0.0:
                (x0, y0), (x1, y1) = self.at([low, high], [self.y.low, height])
                corners = np.array([[x0, y0], [x1 - 1, y0], [x1 - 1, y1], [x0, y1]])
                self.canvas.fill(corners, colour)

    def shade(self, from_x: float, to_x: float, colour: Colour) -> None:
        """Tints a time, 2 px at least."""
        (x0, _), (x1, _) = np.clip(self.at([from_x, to_x], self.y.low), self.left, self.right)
        x1 = max(x1, x0 + 2.0)
        box = np.array([[x0, self.top], [x1, self.top], [x1, self.bottom], [x0, self.bottom]])
        veil(self.canvas, [box], colour, 0.45)

    def marks(self, marks: Sequence[tuple[float, str]], colour: Colour) -> None:
        """Draws upright lines with words beside their upper ends, each a line lower."""
        for x, _ in marks:
            at = float(self.at(x, self.y.low)[0])
            self.canvas.lines(np.array([[at, self.top], [at, self.bottom]]), colour, 1.0)
        for row, (x, words) in enumerate(marks):
            at, width = float(self.at(x, self.y.low)[0]), width_of(words, SMALL)
            left = at + 6 if at + 6 + width <= self.right else at - 6 - width
            write(self.canvas, words, left, self.top + 12 + 19 * row, colour)

    def level(self, y: float, words: str) -> None:
        """Draws a broken level line with words at its right end."""
        for left in np.arange(self.left, self.right, 10.0):
            height = float(self.at(self.x.low, y)[1])
            self.canvas.lines(np.array([[left, height], [left + 5, height]]), MUTED)
        width = width_of(words, SMALL)
        write(self.canvas, words, self.right - width, height - 7, MUTED)

    def legend(self, names: Sequence[tuple[str, Colour]]) -> None:
        """Names the colours, above the frame at the right."""
        x = self.right
        for name, colour in reversed(names):
            x -= width_of(name, SMALL)
            self.canvas.text(name, x, self.top - 14, INK, SMALL)
            x -= 20
            key = np.array([[x, self.top - 19], [x + 14, self.top - 19]])
            self.canvas.lines(key, colour, 3.0)
            x -= 14


def write(canvas: Canvas, words: str, x: float, y: float, colour: Colour) -> None:
    """Writes small words on a piece of paper of their own, to be read on any ground."""
    width = width_of(words, SMALL)
    box = np.array(
        [[x - 2, y - 12], [x + width + 2, y - 12], [x + width + 2, y + 4], [x - 2, y + 4]]
    )
    veil(canvas, [box], (255, 255, 255), 0.75)
    canvas.text(words, x, y, colour, SMALL)


def veil(canvas: Canvas, outlines: Sequence[Floats], colour: Colour, share: float) -> None:
    """Tints shapes of any form, (n, 2) px each."""
    fixed = [np.rint(outline * SCALE).astype(np.int32) for outline in outlines]
    points = np.concatenate(fixed)
    height, width = canvas.image.shape[:2]
    left, top = np.clip(points.min(axis=0), 0, (width, height))
    right, bottom = np.clip(points.max(axis=0) + 1, 0, (width, height))
    under = canvas.image[top:bottom, left:right]
    if under.size == 0:
        return
    layer = under.copy()
    cv2.fillPoly(layer, fixed, colour, cv2.LINE_AA, 0, (-int(left), -int(top)))
    canvas.image[top:bottom, left:right] = cv2.addWeighted(layer, share, under, 1.0 - share, 0.0)


def pieces(points: Floats) -> list[Floats]:
    """Parts (n, 2) points at their NaNs; pieces of one point stay, empty ones do not."""
    known = np.isfinite(points).all(axis=1)
    ends = np.flatnonzero(np.diff(np.concatenate([[False], known, [False]])))
    return [points[begin:end] for begin, end in ends.reshape(-1, 2)]


def thinned(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """A curve with at most a few points for each px: the least and the greatest of each place."""
    step = -(-len(x) // _MOST_COLUMNS)
    if step <= 2 or not np.isfinite(y).all():
        return x, y
    kept: list[NDArray[np.intp]] = []
    for begin in range(0, len(x), step):
        part = y[begin : begin + step]
        kept.append(np.unique([0, part.argmin(), part.argmax(), len(part) - 1]) + begin)
    places = np.concatenate(kept)
    return x[places], y[places]
