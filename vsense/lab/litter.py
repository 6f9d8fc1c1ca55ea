"""What lies about on a lab's floor: much of it looks a little like a marker.

Pieces are drawn into a uint8 picture of the floor's reflectance, 0 black to 255 white.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Image8 = NDArray[np.uint8]
Floats = NDArray[np.float64]
Rng = np.random.Generator

PAPER = 205
INK = 22

_SHIFT = 4
_WORDS = ("ARENA", "EXIT", "B12", "LAB", "A4", "07", "STOP", "KEEP", "NORTH", "IN", "Q3", "TEST")


@dataclass(frozen=True, slots=True)
class _Pen:
    """Draws into one place of the floor, turned.

    Attributes:
        floor: The picture that is drawn into.
        px_per_m: Its resolution.
        at_px: (2,) column and row of the piece's middle.
        yaw_rad: How the piece is turned.
    """

    floor: Image8
    px_per_m: float
    at_px: Floats
    yaw_rad: float

    def place(self, points_m: Floats) -> NDArray[np.int32]:
        """Pixels of points (n, 2) of the piece's own frame, in 1/16 px."""
        cos, sin = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        turned = np.asarray(points_m) @ np.array([[cos, -sin], [sin, cos]])
        pixels = self.at_px + turned * self.px_per_m
        return np.asarray(np.rint(pixels * (1 << _SHIFT)), dtype=np.int32)

    def fill(self, points_m: Floats, grey: int) -> None:
        """Fills a polygon."""
        cv2.fillPoly(self.floor, [self.place(points_m)], grey, cv2.LINE_AA, _SHIFT)

    def trace(self, points_m: Floats, width_m: float, grey: int) -> None:
        """Draws a line through points."""
        width = max(1, round(width_m * self.px_per_m))
        points = [self.place(points_m)]
        cv2.polylines(self.floor, points, False, grey, width, cv2.LINE_AA, _SHIFT)


def scatter(floor: Image8, px_per_m: float, pieces: int, rng: Rng) -> None:
    """Draws `pieces` pieces of litter at random places, in place; all kinds in turn."""
    for number in range(pieces):
        at = rng.uniform((0.0, 0.0), floor.shape[::-1])
        pen = _Pen(floor, px_per_m, at, float(rng.uniform(-np.pi, np.pi)))
        _KINDS[number % len(_KINDS)](pen, rng)


def _grey(rng: Rng) -> int:
    """Clearly darker or clearly lighter than the floor."""
    return int(rng.integers(20, 60) if rng.random() < 0.6 else rng.integers(140, 215))


def _rectangle(length_m: float, width_m: float) -> Floats:
    return np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * (length_m / 2, width_m / 2)


def _ellipse(pen: _Pen, rng: Rng) -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    radii = rng.uniform(0.006, 0.035, 2)
    pen.fill(np.stack((np.cos(angle), np.sin(angle)), axis=1) * radii, _grey(rng))


def _triangle(pen: _Pen, rng: Rng) -> None:
    angle = np.array([0.0, 2.1, 4.2]) + rng.uniform(-0.4, 0.4, 3)
    corners = np.stack((np.cos(angle), np.sin(angle)), axis=1)
    pen.fill(corners * rng.uniform(0.015, 0.045), _grey(rng))


def _cable(pen: _Pen, rng: Rng) -> None:
    along = np.linspace(0.0, rng.uniform(0.2, 0.7), 60)
    bends = sum(
        rng.normal(0.0, 0.03 / k) * np.sin(along * k * 7.0 + rng.uniform(0, 6)) for k in (1, 2, 3)
    )
    grey = int(rng.choice((25, 40, 190)))
    path = np.stack((along, bends), axis=1)
    width = float(rng.uniform(0.004, 0.007))
    pen.trace(path, width, grey)
    pen.trace(path + np.array((0.0, 0.25 * width)), width / 5.0, min(255, grey + 35))


def _text(pen: _Pen, rng: Rng) -> None:
    """Big letters: painted on the floor, or printed on a sheet of paper."""
    height_m = float(rng.uniform(0.03, 0.08))
    font, weight = cv2.FONT_HERSHEY_SIMPLEX, 3
    word = str(rng.choice(_WORDS))
    (width, height), under = cv2.getTextSize(word, font, 2.0, weight)
    sheet = bool(rng.random() < 0.5)
    mask = np.zeros((height + under + 30, width + 30), dtype=np.uint8)
    cv2.putText(mask, word, (15, height + 15), font, 2.0, 255, 5 * weight, cv2.LINE_AA)
    metre = height_m / height
    if sheet:
        pen.fill(_rectangle(mask.shape[1] * metre, mask.shape[0] * metre), PAPER)
    size = np.array(mask.shape[::-1]) * metre / 2.0
    source = np.array([(0, 0), (mask.shape[1], 0), (0, mask.shape[0])], dtype=np.float32)
    corners = np.array([(-1, -1), (1, -1), (-1, 1)]) * size
    target = (pen.place(corners) / (1 << _SHIFT)).astype(np.float32)
    transform = np.asarray(cv2.getAffineTransform(source, target), dtype=np.float64)
    _stamp(pen.floor, mask, transform, INK if sheet else 150)


def _stamp(floor: Image8, mask: Image8, transform: Floats, grey: int) -> None:
    """Paints `grey` where the transformed mask is; only the part of the floor it touches."""
    height, width = mask.shape
    corners = np.array([(0, 0, 1), (width, 0, 1), (0, height, 1), (width, height, 1)])
    reached = corners @ transform.T
    low = np.maximum(np.floor(reached.min(axis=0)).astype(int), 0)
    high = np.minimum(np.ceil(reached.max(axis=0)).astype(int) + 1, floor.shape[::-1])
    if np.any(high <= low):
        return
    moved = transform.copy()
    moved[:, 2] -= low
    size = (int(high[0] - low[0]), int(high[1] - low[1]))
    cover = cv2.warpAffine(mask, moved, size, flags=cv2.INTER_AREA).astype(np.float32) / 255.0
    part = floor[low[1] : high[1], low[0] : high[0]]
    part[:] = np.rint(part + cover * (grey - part.astype(np.float32))).astype(np.uint8)


def _card(pen: _Pen, rng: Rng) -> None:
    """A white card with a dark rectangle: what a careless detector takes for a marker."""
    length, width = rng.uniform(0.06, 0.10), rng.uniform(0.05, 0.075)
    pen.fill(_rectangle(length, width), int(rng.integers(185, 220)))
    pen.fill(_rectangle(length * rng.uniform(0.4, 0.7), width * rng.uniform(0.4, 0.7)), INK)


_KINDS: tuple[Callable[[_Pen, Rng], None], ...] = (_ellipse, _triangle, _cable, _text, _card)
