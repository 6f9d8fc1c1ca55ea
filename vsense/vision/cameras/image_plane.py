"""The normalised image plane: which part of it a lens shows, and what lies in that part.

Straight things are straight here, so they are cut here, and bent by the lens afterwards.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.vision.cameras.camera import Camera, distort

Floats = NDArray[np.float64]
Image32 = NDArray[np.float32]

NEAR_M = 0.02
"""What is nearer to a camera's plane than this, or behind it, is not shown."""

_STEP = 4
"""Smooth functions are evaluated at every fourth pixel: of a lens a straight line between them is
off by 1e-3 px."""
_DIRECTIONS = 48
_REACH = np.arange(0.0, 6.0, 0.01)
"""Tangents of the angles at which a lens is looked at: up to 80 degrees."""
_MARGIN = 0.05
"""Share of the picture's size beyond its border that still belongs to the window."""


def everywhere(
    evaluate: Callable[[Floats], Floats], shape: tuple[int, int]
) -> tuple[Image32, Image32]:
    """Evaluates a smooth function at every pixel of a picture of `shape` (rows, columns).

    `evaluate` takes pixels (..., 2), column and row, and returns (..., 2). It is called for every
    fourth pixel; both results (rows, columns) are interpolated.
    """
    height, width = shape
    columns = np.arange(-1, width // _STEP + 2) * _STEP + (_STEP - 1) / 2
    rows = np.arange(-1, height // _STEP + 2) * _STEP + (_STEP - 1) / 2
    coarse = evaluate(np.stack(np.meshgrid(columns, rows), axis=-1)).astype(np.float32)
    size = (coarse.shape[1] * _STEP, coarse.shape[0] * _STEP)
    fine = [
        cv2.resize(coarse[..., k], size, interpolation=cv2.INTER_LINEAR)[
            _STEP : _STEP + height, _STEP : _STEP + width
        ]
        for k in range(2)
    ]
    return np.ascontiguousarray(fine[0]), np.ascontiguousarray(fine[1])


def window_radius(camera: Camera) -> float:
    """Radius of the disc of the normalised image plane in which a camera's lens model is right.

    It ends a little outside of the picture, or where the model folds back: from there on its
    polynomial shows what lies farther out nearer to the middle, which no lens does.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, _DIRECTIONS, endpoint=False)[:, None]
    x, y = _REACH * np.cos(angle), _REACH * np.sin(angle)
    u, v = distort(x, y, camera.distortion)
    across, down = camera.fx_px * u + camera.cx_px, camera.fy_px * v + camera.cy_px
    margin_x, margin_y = _MARGIN * camera.width_px, _MARGIN * camera.height_px
    outside = (across < -margin_x) | (across > camera.width_px + margin_x)
    outside |= (down < -margin_y) | (down > camera.height_px + margin_y)
    folds = _jacobian(x, y, camera.distortion) <= 0.0
    leaves = _first(outside & ~folds)
    folded = _first(folds)
    # A ray that has folded back before it left the picture never leaves it.
    return float(min(leaves.max(), folded.min()))


def _first(where: NDArray[np.bool_]) -> Floats:
    """The reach of the first true place of each row; the last one where there is none."""
    return np.asarray(_REACH[np.where(where.any(axis=1), where.argmax(axis=1), -1)])


def _jacobian(x: Floats, y: Floats, coefficients: tuple[float, ...]) -> Floats:
    """By how much a lens stretches areas around points of the plane."""
    step = 1e-6
    (u_right, v_right), (u_left, v_left) = (distort(x + d, y, coefficients) for d in (step, -step))
    (u_up, v_up), (u_low, v_low) = (distort(x, y + d, coefficients) for d in (step, -step))
    area = (u_right - u_left) * (v_up - v_low) - (u_up - u_low) * (v_right - v_left)
    return np.asarray(area / (4.0 * step * step))


def cut(points: Floats, distances: Floats) -> Floats:
    """Returns the part of an area (n, k) on one side: where the corners' distances are not < 0."""
    inside = distances >= 0.0
    if inside.all():
        return points
    if not inside.any():
        return points[:0]
    kept = []
    for here in range(len(points)):
        there = (here + 1) % len(points)
        if inside[here]:
            kept.append(points[here])
        if inside[here] != inside[there]:
            share = distances[here] / (distances[here] - distances[there])
            kept.append(points[here] + share * (points[there] - points[here]))
    return np.array(kept)


_SIDES = 48
_TURNS = (np.arange(_SIDES) + 0.5) * 2.0 * np.pi / _SIDES
_NORMALS = np.stack((np.cos(_TURNS), np.sin(_TURNS)), axis=-1)


def cut_to_disc(points: Floats, radius: float) -> Floats:
    """Returns the part of an area of (n, 2) corners in a polygon inside of the disc."""
    reach = radius * float(np.cos(np.pi / _SIDES))
    if len(points) == 0 or float(np.hypot(*points.T).max()) <= reach:
        return points
    for normal in _NORMALS:
        points = cut(points, reach - points @ normal)
        if len(points) == 0:
            break
    return points


def within_disc(start: Floats, end: Floats, radius: float) -> tuple[float, float] | None:
    """Which part of a line from (2,) to (2,) lies in the disc: two shares of it; None: nothing."""
    way = end - start
    square = float(way @ way)
    if square == 0.0:
        return (0.0, 1.0) if float(start @ start) <= radius * radius else None
    middle = -float(start @ way) / square
    half = middle * middle - (float(start @ start) - radius * radius) / square
    if half <= 0.0:
        return None
    first, last = max(middle - half**0.5, 0.0), min(middle + half**0.5, 1.0)
    return (first, last) if first < last else None
