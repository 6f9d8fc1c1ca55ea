"""One picture of the arena from above, made of the pictures of all cameras."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Image
from vsense.monitor.pictures._projections import NEAR_PLANE_M
from vsense.vision.cameras.camera import Camera, Image32, everywhere
from vsense.world.entities import Arena

_SEAM_M = 0.02
"""Width over which one camera's picture fades into the next."""

Shade = Callable[[Camera], Image32]
"""Gives the share of the light that reaches each pixel of a camera."""


class TopView:
    """The arena as one camera infinitely far above would see it; made once for many timesteps.

    Every place is taken from the camera that looks most steeply at it. What is not in the plane at
    `height_m` is shifted, at the seams by a few pixels: with 0 the floor is at its true place, with
    the markers' height the markers are.

    Args:
        cameras: whose pictures will come, in any order.
        arena: the part of the floor to show.
        px_per_m: resolution of the result.
        shade: the lenses' vignetting, which is taken out; None: it is not known.
    """

    def __init__(
        self,
        cameras: Sequence[Camera],
        arena: Arena,
        px_per_m: float,
        height_m: float = 0.0,
        shade: Shade | None = None,
    ) -> None:
        self._cameras = {camera.id: camera for camera in cameras}
        self._x, self._y = _places(arena, px_per_m)
        self._px_per_m, self._height_m = px_per_m, height_m
        shape = self._x.shape
        self._maps = {c.id: _pixels(c, arena, px_per_m, height_m, shape) for c in cameras}
        self._shades = {} if shade is None else {c.id: shade(c) for c in cameras}
        self._weights: dict[frozenset[str], dict[str, Image32]] = {}

    def draw(self, pictures: Mapping[str, Image]) -> Image:
        """Draws the grey pictures of a timestep by their cameras' ids; some may be missing.

        Returns:
            (rows, columns) uint8, +x to the right and +y up; black where no camera sees.
        """
        weights = self._weights_of(frozenset(pictures))
        total: Image32 = np.zeros(self._x.shape, dtype=np.float32)
        weighed: Image32 = np.full(self._x.shape, 1e-30, dtype=np.float32)
        for name, picture in pictures.items():
            even = picture / self._shades[name] if self._shades else picture
            fine = self._smooth(even, self._cameras[name])
            across, down = self._maps[name]
            seen = cv2.remap(fine, across, down, cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE)
            total += seen * weights[name]
            weighed += weights[name]
        return np.asarray(cv2.convertScaleAbs(total / weighed), dtype=np.uint8)

    def _weights_of(self, names: frozenset[str]) -> dict[str, Image32]:
        """How much of each place these cameras show."""
        if names not in self._weights:
            distances = {n: _distance_m(self._cameras[n], self._x, self._y) for n in names}
            nearest = np.min(list(distances.values()), axis=0) if names else self._x
            self._weights = {
                names: {
                    name: np.exp((nearest - distance) / _SEAM_M).astype(np.float32)
                    * self._cameras[name].contains(np.stack(self._maps[name], axis=-1))
                    * _before(self._cameras[name], self._x, self._y, self._height_m)
                    for name, distance in distances.items()
                }
            }
        return self._weights[names]

    def _smooth(self, picture: NDArray[np.generic], camera: Camera) -> Image32:
        """Removes what is finer than the result's pixels."""
        height_m = camera.position_m[2] - self._height_m
        reduction = camera.fx_px / height_m / self._px_per_m
        fine = picture.astype(np.float32)
        if reduction <= 1.0:
            return fine
        return np.asarray(cv2.GaussianBlur(fine, (0, 0), 0.4 * reduction), dtype=np.float32)


def _places(arena: Arena, px_per_m: float) -> tuple[Image32, Image32]:
    """Arena x and y of the result's pixels, (rows, columns) float32."""
    columns, rows = (round(size * px_per_m) for size in arena.size_m[:2])
    x = arena.centre_m[0] + (np.arange(columns) - (columns - 1) / 2) / px_per_m
    y = arena.centre_m[1] - (np.arange(rows) - (rows - 1) / 2) / px_per_m
    place_x, place_y = np.meshgrid(x.astype(np.float32), y.astype(np.float32))
    return place_x, place_y


def _pixels(
    camera: Camera, arena: Arena, px_per_m: float, height_m: float, shape: tuple[int, ...]
) -> tuple[Image32, Image32]:
    """Column and row in the camera's picture of each of the result's pixels."""
    middle = (np.array(shape[::-1]) - 1) / 2
    centre = np.array(arena.centre_m[:2])

    def project(pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        places = centre + (pixels - middle) * (1.0, -1.0) / px_per_m
        height = np.full((*pixels.shape[:-1], 1), height_m)
        return camera.project(np.concatenate((places, height), axis=-1))

    return everywhere(project, (shape[0], shape[1]))


def _before(camera: Camera, x: Image32, y: Image32, height_m: float) -> NDArray[np.bool_]:
    """Which places lie before a camera, and where its lens model is right.

    The projection of all others can lie in the picture, too, where something else is to be seen.
    """
    turn, place = np.reshape(camera.rotation, (3, 3)), camera.position_m
    across, down, deep = (
        row[0] * (x - place[0]) + row[1] * (y - place[1]) + row[2] * (height_m - place[2])
        for row in turn
    )
    reach = camera.window_radius() * deep
    return np.asarray((deep >= NEAR_PLANE_M) & (np.hypot(across, down) <= reach))


def _distance_m(camera: Camera, x: Image32, y: Image32) -> Image32:
    """Distance of each place from the point below the camera."""
    centre_x, centre_y = np.array(camera.position_m[:2], dtype=np.float32)
    return np.asarray(np.hypot(x - centre_x, y - centre_y), dtype=np.float32)
