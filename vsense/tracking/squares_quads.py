"""Where square markers may be: dark things in the picture whose hull has four corners.

A local threshold at several scales separates dark from light; every contour's hull is reduced
to the smallest quadrilateral around it. A hull forgives what blur does to a marker: white cells
that break through the black frame leave it as it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.tracking.markers import Floats

_WINDOW = 0.9
_NEXT_WINDOW = 2.4
_GREATEST_WINDOW_PX = 51
_ENOUGH_PX = 10.0
_NOISY = 5.0
_NOISE_ROWS = 32


@dataclass(frozen=True, slots=True)
class QuadSearch:
    """Finds quadrilaterals that are darker than what is around them.

    Large ones are looked for in the picture at half its resolution.

    Attributes:
        darkness: Dark is below this share of the local mean (0.96),
        least_step: less this many grey values (3).
        noise_step: That step in the picture's noise, where the noise is more (2.0).
        fullness: Least share of the quadrilateral that the hull fills (0.8).
        slimness: Least width of a thing, as a share of the least side (0.4).
    """

    darkness: float = 0.96
    least_step: float = 3.0
    noise_step: float = 2.0
    fullness: float = 0.8
    slimness: float = 0.4

    def find(self, image: NDArray[np.uint8], least_px: float, most_px: float) -> Floats:
        """Returns the picture's candidates.

        Args:
            image: (height, width) uint8.
            least_px: Shortest side of a marker, seen face to face.
            most_px: Longest side.

        Returns:
            (n, 4, 2) pixels: the corners, clockwise in the picture.
        """
        if least_px >= 2.0 * _ENOUGH_PX:
            half = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
            small = self.find(np.asarray(half, dtype=np.uint8), 0.5 * least_px, 0.5 * most_px)
            return 2.0 * small + 0.5
        noise = noise_level(image)
        if noise > _NOISY:
            image = np.asarray(cv2.GaussianBlur(image, (5, 5), 0.9), dtype=np.uint8)
            noise *= 0.4
        step = round(max(self.least_step, self.noise_step * noise))
        found = [
            quad
            for window in _windows(least_px, most_px)
            for quad in self._quads(self._dark(image, window, step), least_px, most_px)
        ]
        quads = np.array(found, dtype=np.float64).reshape(-1, 4, 2)
        turned = area(quads) < 0.0
        quads[turned] = quads[turned, ::-1]
        return quads

    def _dark(self, image: NDArray[np.uint8], window: int, step: int) -> NDArray[np.uint8]:
        mean = cv2.boxFilter(image, -1, (window, window))
        level = cv2.addWeighted(mean, self.darkness, mean, 0.0, -float(step))
        return np.asarray(cv2.compare(image, level, cv2.CMP_LT), dtype=np.uint8)

    def _quads(
        self, dark: NDArray[np.uint8], least_px: float, most_px: float
    ) -> list[NDArray[np.float32]]:
        contours, _ = cv2.findContours(dark, cv2.RETR_LIST, cv2.CHAIN_APPROX_SIMPLE)
        thin, least, most = self.slimness * least_px, least_px**2 / 4.0, 2.0 * most_px**2
        found = []
        for contour in contours:
            if len(contour) < 4:
                continue
            _, _, width, height = cv2.boundingRect(contour)
            if max(width, height) < least_px or min(width, height) < thin:
                continue
            hull = cv2.convexHull(contour)
            filled = cv2.contourArea(hull)
            if len(hull) < 4 or not least < filled < most:
                continue
            quad = np.asarray(cv2.approxPolyN(hull, 4, ensure_convex=True), dtype=np.float32)
            quad = quad.reshape(-1, 2)
            if len(quad) == 4 and filled > self.fullness * cv2.contourArea(quad):
                found.append(quad)
        return found


def area(quads: Floats) -> Floats:
    """Returns the area of (n, 4, 2) quadrilaterals, positive where clockwise in the picture."""
    x, y = quads[..., 0], quads[..., 1]
    cross = x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y
    return np.asarray(0.5 * cross.sum(axis=1))


def lengths(quads: Floats) -> Floats:
    """Returns the (n, 4) lengths of the sides of (n, 4, 2) quadrilaterals."""
    side = np.roll(quads, -1, axis=1) - quads
    return np.asarray(np.hypot(side[..., 0], side[..., 1]))


def noise_level(image: NDArray[np.uint8]) -> float:
    """Returns the standard deviation of the noise, from neighbours on a part of the rows."""
    rows = image[:: max(len(image) // _NOISE_ROWS, 1)].astype(np.int16)
    second = rows[:, 2:] - 2 * rows[:, 1:-1] + rows[:, :-2]
    return float(1.4826 * np.median(np.abs(second)) / np.sqrt(6.0)) if second.size else 0.0


def _windows(least_px: float, most_px: float) -> list[int]:
    """Returns the widths of the local means: each is right for markers about its own size."""
    windows: list[int] = []
    width = _WINDOW * least_px
    while not windows or (width < most_px and windows[-1] < _GREATEST_WINDOW_PX):
        windows.append(min(2 * round(width / 2.0) + 1, _GREATEST_WINDOW_PX))
        width *= _NEXT_WINDOW
    return windows
