"""Letters, lines and colours that all pictures share."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats, Image

Colour = tuple[int, int, int]

SCALE = 2
"""Drawn this much larger and reduced at the end: smooth lines and letters."""

INK: Colour = (50, 42, 38)
MUTED: Colour = (140, 130, 124)
GRID: Colour = (232, 228, 226)
FONT = cv2.FONT_HERSHEY_DUPLEX

_SHIFT = 4
"""Bits of the fraction of a pixel in what OpenCV is given."""
_FAR_PX = 30_000


class Canvas:
    """A picture in the making; all places and sizes are px of the finished picture.

    Attributes:
        image: (h, w, 3) BGR, `scale` times as large as the finished picture.
    """

    def __init__(self, width: int, height: int, scale: int = SCALE) -> None:
        """Begins with white paper."""
        self.scale = scale
        self.image: Image = np.full((scale * height, scale * width, 3), 255, np.uint8)

    @classmethod
    def over(cls, image: Image, scale: int = 1) -> Canvas:
        """Begins with a picture, (h, w, 3) BGR, that is `scale` times as large as the finished."""
        canvas = cls(0, 0, scale)
        canvas.image = image
        return canvas

    def text(self, text: str, x: float, y: float, colour: Colour, size: float) -> None:
        """Writes a line; (x, y) is the left end of its base line."""
        at = (round(x * self.scale), round(y * self.scale))
        weight = self.scale if size >= 0.9 else 1
        cv2.putText(self.image, text, at, FONT, size * self.scale, colour, weight, cv2.LINE_AA)

    def lines(
        self, points: Floats, colour: Colour, width: float = 1.0, closed: bool = False
    ) -> None:
        """Draws a line through (n, 2) points."""
        self._polylines([self._fixed(points)], closed, colour, width)

    def dashes(self, points: Floats, colour: Colour, width: float = 1.0) -> None:
        """Draws every other piece of a line through (n, 2) points."""
        fixed = self._fixed(points)
        self._polylines(
            [fixed[k : k + 2] for k in range(0, len(fixed) - 1, 2)], False, colour, width
        )

    def _polylines(
        self, fixed: list[NDArray[np.int32]], closed: bool, colour: Colour, width: float
    ) -> None:
        thick = max(1, round(width * self.scale))
        cv2.polylines(self.image, fixed, closed, colour, thick, cv2.LINE_AA, _SHIFT)

    def _fixed(self, points: Floats) -> NDArray[np.int32]:
        """Points as OpenCV takes them, with a binary fraction; what is far outside comes nearer."""
        ends = np.clip(points * self.scale, -_FAR_PX, _FAR_PX)
        return np.asarray(np.rint(ends * (1 << _SHIFT)), np.int32)

    def fill(self, points: Floats, colour: Colour, share: float = 1.0) -> None:
        """Fills a shape of (n, 2) corners, `share` 1 covers, 0 is invisible."""
        if len(points) < 3:
            return
        fixed = self._fixed(points)
        if share >= 1.0:
            cv2.fillPoly(self.image, [fixed], colour, cv2.LINE_AA, _SHIFT)
            return
        # Only where it is: a mixture of whole pictures costs more than all else.
        low = np.maximum((fixed.min(axis=0) >> _SHIFT) - 2, 0)
        high = np.maximum((fixed.max(axis=0) >> _SHIFT) + 3, 0)
        under = self.image[low[1] : high[1], low[0] : high[0]]
        if under.size == 0:
            return
        layer = under.copy()
        cv2.fillPoly(layer, [fixed - (low << _SHIFT)], colour, cv2.LINE_AA, _SHIFT)
        cv2.addWeighted(layer, share, under, 1.0 - share, 0.0, dst=layer)
        under[:] = layer

    def dot(self, middle: Floats, radius: float, colour: Colour) -> None:
        """Draws a disc around a (2,) point."""
        self._circle(middle, radius, colour, cv2.FILLED)

    def ring(self, middle: Floats, radius: float, colour: Colour, width: float) -> None:
        """Draws a circle around a (2,) point."""
        self._circle(middle, radius, colour, max(1, round(width * self.scale)))

    def _circle(self, middle: Floats, radius: float, colour: Colour, line: int) -> None:
        x, y = self._fixed(np.asarray(middle)).tolist()
        size = round(radius * self.scale * (1 << _SHIFT))
        cv2.circle(self.image, (x, y), size, colour, line, cv2.LINE_AA, _SHIFT)

    def glow(self, middle: Floats, radius: float, colour: Colour, share: float) -> None:
        """Tints a disc around a (2,) point; `share` 1 covers, 0 is invisible."""
        reach = round(radius * self.scale) + 2
        x, y = np.rint(np.clip(middle * self.scale, -_FAR_PX, _FAR_PX)).astype(int).tolist()
        rows = slice(max(y - reach, 0), max(y + reach, 0))
        columns = slice(max(x - reach, 0), max(x + reach, 0))
        under = self.image[rows, columns]
        if under.size == 0:
            return
        tint = under.copy()
        at = (x - columns.start, y - rows.start)
        cv2.circle(tint, at, round(radius * self.scale), colour, -1, cv2.LINE_AA)
        self.image[rows, columns] = cv2.addWeighted(tint, share, under, 1.0 - share, 0.0)

    def paste(self, picture: Image, x: int, y: int, width: int, height: int) -> None:
        """Puts a picture into a rectangle."""
        size = (width * self.scale, height * self.scale)
        large = cv2.resize(picture, size, interpolation=cv2.INTER_CUBIC)
        self.image[
            y * self.scale : (y + height) * self.scale, x * self.scale : (x + width) * self.scale
        ] = large

    def place(self, large: Image, x: int, y: int) -> None:
        """Puts a picture that is `scale` times as large already at (x, y), with a frame."""
        height, width = large.shape[:2]
        self.image[
            y * self.scale : y * self.scale + height, x * self.scale : x * self.scale + width
        ] = large
        corners = np.array([[0, 0], [width, 0], [width, height], [0, height]]) / self.scale
        self.lines(corners + np.array([x, y]), MUTED, 1.0, closed=True)

    def finished(self) -> Image:
        """Returns the picture, (h, w, 3) BGR."""
        size = (self.image.shape[1] // self.scale, self.image.shape[0] // self.scale)
        return np.asarray(cv2.resize(self.image, size, interpolation=cv2.INTER_AREA), np.uint8)


def width_of(text: str, size: float, scale: int = SCALE) -> float:
    """Width of a text."""
    return float(cv2.getTextSize(text, FONT, size * scale, 1)[0][0] / scale)


def round_number(value: float) -> float:
    """The greatest of 1, 2, 5, 10, ... that is not above a value."""
    power = 10.0 ** np.floor(np.log10(max(value, 1e-9)))
    return float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= value * 1.0001))
