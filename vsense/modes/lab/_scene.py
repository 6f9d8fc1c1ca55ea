"""The lab's floor: tiles, dirt, litter that looks a little like markers, and the light on it.

Reflectances are uint8, 0 black to 255 perfectly white, on a grid in the arena frame.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats, Image
from vsense.modes.lab._optics import RayMap
from vsense.vision.cameras.camera import Image32

PX_PER_M = 800
"""Resolution of the floor: finer than any picture of it."""
TILE_M = 0.5
LIGHT_SWING = 0.35
"""The light on the floor is between 1 - this and 1 + this."""

_JOINT_M = 0.003
_MARGIN_M = 0.02
_FLOOR = 104
_JOINT = 66
_TILE_SIGMA = 2.5
_OCTAVES = ((0.4, 5.0), (0.12, 4.0), (0.035, 3.0), (0.009, 3.0))
"""Size [m] and strength of the spots of dirt."""
_GRAIN = 1024
_LIGHT_CELLS_M = 1.1
_LIGHT_PX_PER_M = 50


@dataclass(frozen=True, slots=True)
class Grid:
    """A picture of the floor from arena x `left_m` and y `top_m` on, rows running along -y."""

    left_m: float
    top_m: float
    width_m: float
    height_m: float
    px_per_m: float

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return (
            int(np.ceil(self.height_m * self.px_per_m)),
            int(np.ceil(self.width_m * self.px_per_m)),
        )

    def to_px(self, x_m: Image32, y_m: Image32) -> tuple[Image32, Image32]:
        """Column and row of places on the floor, (0, 0) is the first pixel's middle."""
        scale = np.float32(self.px_per_m)
        column = (x_m - np.float32(self.left_m)) * scale - np.float32(0.5)
        row = (np.float32(self.top_m) - y_m) * scale - np.float32(0.5)
        return column, row


class Scene:
    """Everything on the floor that never moves, and the light."""

    def __init__(self, rays: list[RayMap], seed: int, litter_per_picture: int) -> None:
        """Makes the floor that all cameras see; dirt, litter and light follow from `seed`."""
        rng = np.random.default_rng([seed, 2])
        low_x, high_x, low_y, high_y = np.array([r.bounds() for r in rays]).T
        seen_m2 = np.mean((high_x - low_x) * (high_y - low_y))
        left, top = low_x.min() - _MARGIN_M, high_y.max() + _MARGIN_M
        width, height = high_x.max() + _MARGIN_M - left, top - low_y.min() + _MARGIN_M
        self._grid = Grid(left, top, width, height, PX_PER_M)
        self._floor = _dirty_floor(self._grid, rng)
        pieces = round(litter_per_picture * width * height / seen_m2)
        scatter(self._floor, PX_PER_M, pieces, rng)
        self._light_grid = Grid(left, top, width, height, _LIGHT_PX_PER_M)
        self._light = _uneven_light(self._light_grid, rng)

    def floor(self, rays: RayMap) -> Image:
        """The (h, w) reflectance that a camera sees, empty arena without walls."""
        column, row = self._grid.to_px(rays.x_m, rays.y_m)
        return np.asarray(cv2.remap(self._floor, column, row, cv2.INTER_LINEAR), dtype=np.uint8)

    def light(self, rays: RayMap) -> Image32:
        """The (h, w) light on the floor that a camera sees, 1 on average."""
        column, row = self._light_grid.to_px(rays.x_m, rays.y_m)
        light = cv2.remap(self._light, column, row, cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE)
        return np.asarray(light, dtype=np.float32)


def _stretch(coarse: NDArray[np.float32], shape: tuple[int, int]) -> Image32:
    """Enlarges a coarse random field to `shape`, smoothly."""
    return np.asarray(
        cv2.resize(coarse, shape[::-1], interpolation=cv2.INTER_CUBIC), dtype=np.float32
    )


def _dirty_floor(grid: Grid, rng: np.random.Generator) -> Image:
    """Tiles of slightly different grey, with joints, spots of four sizes, and fine grain."""
    floor = np.full(grid.shape, _FLOOR, dtype=np.float32)
    for size_m, strength in _OCTAVES:
        cells = (int(grid.height_m / size_m) + 2, int(grid.width_m / size_m) + 2)
        field = rng.standard_normal(cells, dtype=np.float32) * np.float32(strength)
        floor += _stretch(field, grid.shape)
    _lay_tiles(floor, grid, rng)
    grain = rng.normal(0.0, 4.0, (_GRAIN, _GRAIN)).astype(np.float32)
    grain = np.asarray(cv2.GaussianBlur(grain, (0, 0), 0.8), dtype=np.float32)
    for row in range(0, grid.shape[0], _GRAIN):
        for column in range(0, grid.shape[1], _GRAIN):
            part = floor[row : row + _GRAIN, column : column + _GRAIN]
            part += grain[: part.shape[0], : part.shape[1]]
    return np.asarray(cv2.convertScaleAbs(floor), dtype=np.uint8)


def _lay_tiles(floor: Image32, grid: Grid, rng: np.random.Generator) -> None:
    """Shades each tile by itself, in place, and draws the joints between them."""
    step = TILE_M * grid.px_per_m
    joint = max(1, round(_JOINT_M * grid.px_per_m))
    first_column = (TILE_M / 2 - grid.left_m) % TILE_M * grid.px_per_m
    first_row = (grid.top_m - TILE_M / 2) % TILE_M * grid.px_per_m
    rows = np.arange(first_row - step, grid.shape[0], step).astype(int)
    columns = np.arange(first_column - step, grid.shape[1], step).astype(int)
    for row in rows:
        for column in columns:
            tile = np.s_[max(row, 0) : row + int(step), max(column, 0) : column + int(step)]
            floor[tile] += np.float32(rng.normal(0.0, _TILE_SIGMA))
    for row in rows[rows >= 0]:
        floor[row : row + joint] = 0.4 * floor[row : row + joint] + 0.6 * _JOINT
    for column in columns[columns >= 0]:
        part = floor[:, column : column + joint]
        floor[:, column : column + joint] = 0.4 * part + 0.6 * _JOINT


def _uneven_light(grid: Grid, rng: np.random.Generator) -> Image32:
    """A smooth field that swings between 1 - LIGHT_SWING and 1 + LIGHT_SWING."""
    cells = (int(grid.height_m / _LIGHT_CELLS_M) + 2, int(grid.width_m / _LIGHT_CELLS_M) + 2)
    field = _stretch(rng.standard_normal(cells, dtype=np.float32), grid.shape)
    field = np.asarray(cv2.GaussianBlur(field, (0, 0), 0.15 * grid.px_per_m), dtype=np.float32)
    span = field.max() - field.min()
    even = (field - field.min()) / span
    return np.asarray(1.0 + LIGHT_SWING * (2.0 * even - 1.0), dtype=np.float32)


Rng = np.random.Generator

PAPER_GRAY = 205
INK_GRAY = 22

_SHIFT = 4
_WORDS = ("ARENA", "EXIT", "B12", "LAB", "A4", "07", "STOP", "KEEP", "NORTH", "IN", "Q3", "TEST")


@dataclass(frozen=True, slots=True)
class _Pen:
    """Draws a turned piece into the floor; `at_px` (2,) are column and row of its middle."""

    floor: Image
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
        cv2.fillPoly(self.floor, [self.place(points_m)], grey, cv2.LINE_AA, _SHIFT)

    def trace(self, points_m: Floats, width_m: float, grey: int) -> None:
        """Draws a line through points."""
        width = max(1, round(width_m * self.px_per_m))
        points = [self.place(points_m)]
        cv2.polylines(self.floor, points, False, grey, width, cv2.LINE_AA, _SHIFT)


def scatter(floor: Image, px_per_m: float, pieces: int, rng: Rng) -> None:
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
        pen.fill(_rectangle(mask.shape[1] * metre, mask.shape[0] * metre), PAPER_GRAY)
    size = np.array(mask.shape[::-1]) * metre / 2.0
    source = np.array([(0, 0), (mask.shape[1], 0), (0, mask.shape[0])], dtype=np.float32)
    corners = np.array([(-1, -1), (1, -1), (-1, 1)]) * size
    target = (pen.place(corners) / (1 << _SHIFT)).astype(np.float32)
    transform = np.asarray(cv2.getAffineTransform(source, target), dtype=np.float64)
    _stamp(pen.floor, mask, transform, INK_GRAY if sheet else 150)


def _stamp(floor: Image, mask: Image, transform: Floats, grey: int) -> None:
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
    """A white card with a dark rectangle, which is easily taken for a marker."""
    length, width = rng.uniform(0.06, 0.10), rng.uniform(0.05, 0.075)
    pen.fill(_rectangle(length, width), int(rng.integers(185, 220)))
    pen.fill(_rectangle(length * rng.uniform(0.4, 0.7), width * rng.uniform(0.4, 0.7)), INK_GRAY)


_KINDS: tuple[Callable[[_Pen, Rng], None], ...] = (_ellipse, _triangle, _cable, _text, _card)
