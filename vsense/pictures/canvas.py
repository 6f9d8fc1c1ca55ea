"""Letters, lines and colours that all pictures share."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
Floats = NDArray[np.float64]
Colour = tuple[int, int, int]

SCALE = 2
"""Drawn this much larger and reduced at the end: smooth lines and letters."""

INK: Colour = (50, 42, 38)
MUTED: Colour = (140, 130, 124)
GRID: Colour = (232, 228, 226)
FONT = cv2.FONT_HERSHEY_DUPLEX


class Canvas:
    """A picture in the making; all places and sizes are px of the finished picture."""

    def __init__(self, width: int, height: int) -> None:
        """Begins with white paper."""
        self.image: Image = np.full((SCALE * height, SCALE * width, 3), 255, np.uint8)

    def text(self, text: str, x: float, y: float, colour: Colour, size: float) -> None:
        """Writes a line; (x, y) is the left end of its base line."""
        at = (round(x * SCALE), round(y * SCALE))
        weight = SCALE if size >= 0.9 else 1
        cv2.putText(self.image, text, at, FONT, size * SCALE, colour, weight, cv2.LINE_AA)

    def lines(
        self, points: Floats, colour: Colour, width: float = 1.0, closed: bool = False
    ) -> None:
        """Draws a line through (n, 2) points."""
        fixed = [np.rint(points * SCALE * 16).astype(np.int32)]
        cv2.polylines(
            self.image, fixed, closed, colour, max(1, round(width * SCALE)), cv2.LINE_AA, 4
        )

    def fill(self, points: Floats, colour: Colour, share: float = 1.0) -> None:
        """Fills a convex shape of (n, 2) corners, `share` 1 covers, 0 is invisible."""
        fixed = np.rint(points * SCALE * 16).astype(np.int32)
        layer = self.image if share >= 1.0 else self.image.copy()
        cv2.fillConvexPoly(layer, fixed, colour, cv2.LINE_AA, 4)
        if share < 1.0:
            cv2.addWeighted(layer, share, self.image, 1.0 - share, 0.0, dst=self.image)

    def dot(self, middle: Floats, radius: float, colour: Colour) -> None:
        """Draws a disc around a (2,) point."""
        self._circle(middle, radius, colour, cv2.FILLED)

    def ring(self, middle: Floats, radius: float, colour: Colour, width: float) -> None:
        """Draws a circle around a (2,) point."""
        self._circle(middle, radius, colour, max(1, round(width * SCALE)))

    def _circle(self, middle: Floats, radius: float, colour: Colour, line: int) -> None:
        x, y = (round(float(value) * SCALE * 16) for value in middle)
        cv2.circle(self.image, (x, y), round(radius * SCALE * 16), colour, line, cv2.LINE_AA, 4)

    def glow(self, middle: Floats, radius: float, colour: Colour, share: float) -> None:
        """Tints a disc around a (2,) point; `share` 1 covers, 0 is invisible."""
        reach = round(radius * SCALE) + 2
        x, y = (round(float(value) * SCALE) for value in middle)
        rows = slice(max(y - reach, 0), max(y + reach, 0))
        columns = slice(max(x - reach, 0), max(x + reach, 0))
        under = self.image[rows, columns]
        if under.size == 0:
            return
        tint = under.copy()
        at = (x - columns.start, y - rows.start)
        cv2.circle(tint, at, round(radius * SCALE), colour, -1, cv2.LINE_AA)
        self.image[rows, columns] = cv2.addWeighted(tint, share, under, 1.0 - share, 0.0)

    def paste(self, picture: Image, x: int, y: int, width: int, height: int) -> None:
        """Puts a picture into a rectangle."""
        size = (width * SCALE, height * SCALE)
        large = cv2.resize(picture, size, interpolation=cv2.INTER_CUBIC)
        self.image[y * SCALE : (y + height) * SCALE, x * SCALE : (x + width) * SCALE] = large

    def place(self, large: Image, x: int, y: int) -> None:
        """Puts a picture that is `SCALE` times as large already at (x, y), with a frame."""
        height, width = large.shape[:2]
        self.image[y * SCALE : y * SCALE + height, x * SCALE : x * SCALE + width] = large
        corners = np.array([[0, 0], [width, 0], [width, height], [0, height]]) / SCALE
        self.lines(corners + np.array([x, y]), MUTED, 1.0, closed=True)

    def finished(self) -> Image:
        """Returns the picture, (h, w, 3) BGR."""
        size = (self.image.shape[1] // SCALE, self.image.shape[0] // SCALE)
        return np.asarray(cv2.resize(self.image, size, interpolation=cv2.INTER_AREA), np.uint8)


def width_of(text: str, size: float) -> float:
    """Width of a text."""
    return float(cv2.getTextSize(text, FONT, size * SCALE, 1)[0][0] / SCALE)


def round_number(value: float) -> float:
    """The greatest of 1, 2, 5, 10, ... that is not above a value."""
    power = 10.0 ** np.floor(np.log10(max(value, 1e-9)))
    return float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= value * 1.0001))
