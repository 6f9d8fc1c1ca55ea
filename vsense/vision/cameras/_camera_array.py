"""Many cameras at once: what `Camera` computes, for points that belong to different cameras.

NumPy's calls cost more than their work on the few points of one picture; here all pictures of a
timestep share them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats
from vsense.vision.cameras.camera import Camera, distort, undistort

Index = NDArray[np.intp]
Chosen = NDArray[np.bool_]

_AXES = ("x_px", "y_px")
_BORDER_POINTS = 33
_KEPT = 1024
"""Cameras and heights whose ground is not computed anew."""
_GROUND_MORE = 0.05
"""Of the sides, for what lies between the border's points."""


class CameraArray:
    """Cameras, each known by its place among them.

    Attributes:
        cameras: The cameras.
        position_m: (c, 3) their centres in the arena frame.
        size_px: (c, 2) width and height of their pictures.
        row_time_ns: (c,) see `Camera.row_time_s`.
    """

    def __init__(self, cameras: Sequence[Camera]) -> None:
        self.cameras = tuple(cameras)
        self._number = {camera.id: number for number, camera in enumerate(cameras)}
        self.position_m = np.array([c.position_m for c in cameras], dtype=np.float64)
        self.size_px = np.array([(c.width_px, c.height_px) for c in cameras], dtype=np.float64)
        self.row_time_ns = 1e9 * np.array([c.row_time_s for c in cameras], dtype=np.float64)
        self._focal_px = np.array([(c.fx_px, c.fy_px) for c in cameras])
        self._centre_px = np.array([(c.cx_px, c.cy_px) for c in cameras])
        self._rotation = np.array([c.rotation for c in cameras]).reshape(-1, 3, 3)
        self._distortion = np.array([c.distortion for c in cameras])
        self._grounds: dict[float, Floats] = {}

    def project(self, points_m: Floats, camera: Index) -> Floats:
        """Returns the (n, 2) pixels of (n, 3) arena points, each in a camera's picture.

        `camera` is (n,) the cameras' places; the points are in front of them.
        """
        away = points_m - self.position_m[camera]
        seen = np.einsum("nij,nj->in", self._rotation[camera], away)
        x, y = distort(seen[0] / seen[2], seen[1] / seen[2], self._distortion[camera].T)
        flat = np.stack((x, y), axis=-1)
        return np.asarray(self._focal_px[camera] * flat + self._centre_px[camera])

    def to_plane(self, points_px: Floats, height_m: Floats, camera: Index) -> Floats:
        """Returns arena x and y [m] of what (n, 2) pixels show of horizontal planes, (n, 2).

        `height_m` is (n,) the planes' heights above the floor, `camera` (n,) the cameras' places.
        """
        flat = (points_px - self._centre_px[camera]) / self._focal_px[camera]
        x, y = undistort(flat[:, 0], flat[:, 1], self._distortion[camera].T)
        rays = np.einsum(
            "nj,nji->ni", np.stack((x, y, np.ones_like(x)), axis=-1), self._rotation[camera]
        )
        centre = self.position_m[camera]
        reach = (height_m - centre[:, 2]) / rays[:, 2]
        return np.asarray(centre[:, :2] + reach[:, np.newaxis] * rays[:, :2])

    def places(self, pictures: Mapping[str, NDArray[np.void]], height_m: Sequence[float]) -> Floats:
        """Returns arena x and y [m] of what pictures show, (n, 2).

        `pictures` has the DETECTION array of each picture by its camera, n rows in all; `height_m`
        is how far above the floor each of these is.
        """
        if not height_m:
            return np.zeros((0, 2))
        of = np.repeat(
            [self._number[camera] for camera in pictures], [*map(len, pictures.values())]
        )
        x_px, y_px = (np.concatenate([p[axis] for p in pictures.values()]) for axis in _AXES)
        return self.to_plane(np.stack((x_px, y_px), axis=-1), np.array(height_m), of)

    def contain(self, points_px: Floats, camera: Index, margin_px: Floats | float = 0.0) -> Chosen:
        """Whether (n, 2) pixels lie in their camera's picture, so far inside its border."""
        low = np.asarray(margin_px - 0.5)[..., np.newaxis]
        inside = (points_px >= low) & (points_px <= self.size_px[camera] - 1.0 - low)
        return np.asarray(inside.all(axis=1))

    def ground(self, height_m: float) -> Floats:
        """Returns rectangles that hold all that the pictures show of a horizontal plane.

        They are (c, 4) least and greatest x, least and greatest y [m], and larger than need be;
        without end, where a picture shows a horizon.
        """
        if height_m not in self._grounds:
            self._grounds[height_m] = np.array(
                [_ground(camera, height_m) for camera in self.cameras]
            ).reshape(-1, 4)
        return self._grounds[height_m]


@lru_cache(maxsize=_KEPT)
def _ground(camera: Camera, height_m: float) -> tuple[float, ...]:
    """Returns a row of `CameraArray.ground`; those that come and go need not be computed anew."""
    steps = np.linspace(0.0, 1.0, _BORDER_POINTS)
    zero, ones = np.zeros_like(steps), np.ones_like(steps)
    sides = [(steps, zero), (steps, ones), (zero, steps), (ones, steps)]
    border = np.concatenate([np.stack(side, axis=1) for side in sides])
    only, of = CameraArray([camera]), np.zeros(len(border), dtype=np.intp)
    places = only.to_plane(border * only.size_px - 0.5, np.full(len(of), height_m), of)
    points = np.column_stack((places, np.full(len(of), height_m)))
    away = (points - only.position_m) @ np.array(camera.rotation).reshape(3, 3)[2]
    if not (np.isfinite(places).all() and (away > 0.0).all()):
        return -math.inf, math.inf, -math.inf, math.inf
    low, high = places.min(axis=0), places.max(axis=0)
    more = _GROUND_MORE * (high - low)
    (left, near), (right, far) = (low - more).tolist(), (high + more).tolist()
    return left, right, near, far
