"""The precise pose of a marker: its outline fitted to the picture through the lens model.

All candidates of a picture are fitted together. The outline is sampled along its edges; each
sample looks along its normal for the step from black to white, and four parameters (position,
heading, scale) follow by weighted least squares on the plane of the markers.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.tracking.camera import Camera
from vsense.tracking.families import MarkerFamily

Floats = NDArray[np.float64]

_SPACING_U = 0.4
_CORNER_U = 0.6
_SLOPE = 0.35
_RISE = 0.4


class Fits(NamedTuple):
    """Fitted outlines, n of them.

    Attributes:
        centre_m: (n, 2) the disc's centre on the plane.
        yaw_rad: (n,) heading in the arena frame, not wrapped.
        scale: (n,) size found, relative to the family's.
        residual_mm: (n,) root mean square distance of the edges found to the outline.
        coverage: (n,) share of the outline's samples that found their edge.
        black: (n,) median grey value just inside of the outline.
        white: (n,) median grey value just outside.
    """

    centre_m: Floats
    yaw_rad: Floats
    scale: Floats
    residual_mm: Floats
    coverage: Floats
    black: Floats
    white: Floats

    def keep(self, where: NDArray[np.bool_]) -> Fits:
        """Returns the chosen ones."""
        return Fits(*(values[where] for values in self))


class OutlineFit:
    """Fits one family's outline."""

    def __init__(self, family: MarkerFamily) -> None:
        self._unit_m = 1e-3 * family.unit_mm
        points, normals = _sample(family.polygon_mm, family.unit_mm)
        self._points_m = 1e-3 * (points - family.disc_centre_mm)
        self._normals = normals
        nx, ny = normals.T
        qx, qy = self._points_m.T
        self._design = np.stack((nx, ny, ny * qx - nx * qy, nx * qx + ny * qy), axis=1)
        self._products = self._design[:, :, np.newaxis] * self._design[:, np.newaxis, :]

    def fit(
        self,
        image: NDArray[np.uint8],
        camera: Camera,
        height_m: float,
        start: Fits,
        reach_u: float,
        steps: int,
    ) -> Fits:
        """Moves each outline once to where its edges are.

        Args:
            image: (height, width) uint8.
            camera: The camera that took it.
            height_m: Height of the markers' plane.
            start: Where to begin; only poses and scales matter.
            reach_u: How far to look inwards and outwards, in units u.
            steps: Samples along each normal.
        """
        reach_m = reach_u * self._unit_m
        values = self._profiles(image, camera, height_m, start, reach_m, steps)
        inner, outer = np.sort(values[:, :, :2].min(2)), np.sort(values[:, :, -2:].max(2))
        middle = values.shape[1] // 2
        black, white = inner[:, middle], outer[:, middle]
        contrast = np.maximum(white - black, 1.0)[:, np.newaxis]
        flat = _SLOPE * 2.0 * reach_u / (steps - 1) * contrast[:, :, np.newaxis]
        rise = np.diff(values, axis=2)
        rise[rise < flat] = 0.0
        height = rise.sum(axis=2)
        where = np.linspace(-reach_m, reach_m, 2 * steps - 1)[1::2]
        offset = (rise @ where) / np.maximum(height, 1e-6)
        found = height > _RISE * contrast
        return self._solve(start, offset, found, black, white, reach_m)

    def _solve(
        self,
        start: Fits,
        offset: Floats,
        found: NDArray[np.bool_],
        black: Floats,
        white: Floats,
        reach_m: float,
    ) -> Fits:
        spread = np.median(np.abs(offset), axis=1, keepdims=True) + 0.02 * reach_m
        weight = found / (1.0 + (offset / (2.0 * spread)) ** 2)
        normal = np.tensordot(weight, self._products, axes=1) + 1e-9 * np.eye(4)
        right = (weight * offset) @ self._design
        move = np.linalg.solve(normal, right[:, :, np.newaxis])[:, :, 0]
        limit = np.array([reach_m, reach_m, 0.3, 0.2])
        move = np.clip(move, -limit, limit)
        left = offset - move @ self._design.T
        number = np.maximum(found.sum(axis=1), 1)
        c, s = np.cos(start.yaw_rad), np.sin(start.yaw_rad)
        shift = np.stack((c * move[:, 0] - s * move[:, 1], s * move[:, 0] + c * move[:, 1]), 1)
        return Fits(
            centre_m=start.centre_m + shift,
            yaw_rad=start.yaw_rad + move[:, 2] / start.scale,
            scale=start.scale + move[:, 3],
            residual_mm=1e3 * np.sqrt((found * left**2).sum(axis=1) / number),
            coverage=found.mean(axis=1),
            black=black,
            white=white,
        )

    def _profiles(
        self,
        image: NDArray[np.uint8],
        camera: Camera,
        height_m: float,
        start: Fits,
        reach_m: float,
        steps: int,
    ) -> NDArray[np.float32]:
        """Returns (n, samples, steps) grey values along the normals, from inside to outside."""
        across = reach_m * self._normals
        scaled = start.scale[:, np.newaxis, np.newaxis] * self._points_m
        ends = np.concatenate((scaled - across, scaled + across), axis=1)
        pixels = camera.project(place(ends, start, height_m)).astype(np.float32)
        inner, outer = np.split(pixels, 2, axis=1)
        share = np.linspace(0.0, 1.0, steps, dtype=np.float32)
        x_px, y_px = (
            inner[:, :, axis, np.newaxis] + (outer - inner)[:, :, axis, np.newaxis] * share
            for axis in (0, 1)
        )
        return look(image, x_px, y_px)


def place(points_m: Floats, fits: Fits, height_m: float) -> Floats:
    """Returns (n, m, 3) arena points of (n, m, 2) points relative to the disc's centre."""
    c, s = np.cos(fits.yaw_rad)[:, np.newaxis], np.sin(fits.yaw_rad)[:, np.newaxis]
    x, y = points_m[..., 0], points_m[..., 1]
    placed = np.empty((*np.broadcast_shapes(x.shape, c.shape), 3))
    placed[..., 0] = c * x - s * y + fits.centre_m[:, :1]
    placed[..., 1] = s * x + c * y + fits.centre_m[:, 1:]
    placed[..., 2] = height_m
    return placed


def look(
    image: NDArray[np.uint8], x_px: NDArray[np.float32], y_px: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Returns the interpolated grey values at (n, ...) pixels, n > 0, as float32."""
    rows = (len(x_px), -1)
    grey = cv2.remap(image, x_px.reshape(rows), y_px.reshape(rows), cv2.INTER_LINEAR)
    return np.asarray(grey.reshape(x_px.shape), dtype=np.float32)


def _sample(corners: Floats, unit: float) -> tuple[Floats, Floats]:
    """Returns points along a counter-clockwise polygon, away from its corners, and normals."""
    points, normals = [], []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        length = float(np.hypot(*(end - start)))
        ahead = (end - start) / length
        count = max(2, round((length - 2.0 * _CORNER_U * unit) / (_SPACING_U * unit)) + 1)
        along = np.linspace(_CORNER_U * unit, length - _CORNER_U * unit, count)
        points.append(start + along[:, np.newaxis] * ahead)
        normals.append(np.tile((ahead[1], -ahead[0]), (count, 1)))
    return np.concatenate(points), np.concatenate(normals)
