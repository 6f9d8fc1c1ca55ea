"""One picture of the arena from above, made of the pictures of all cameras."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.arena import Frame
from vsense.cameras.camera import Camera
from vsense.lab.optics import Image32, everywhere, vignetting
from vsense.world.entities import Arena

_SEAM_M = 0.02
"""Width over which one camera's picture fades into the next."""


def top_view(
    frames: Sequence[Frame],
    cameras: Sequence[Camera],
    arena: Arena,
    px_per_m: float,
    height_m: float = 0.0,
) -> NDArray[np.uint8]:
    """The arena as one camera infinitely far above would see it, in about 0.2 s.

    Every place is taken from the camera that looks most steeply at it. The lenses' vignetting is
    taken out. What is not in the plane at `height_m` is shifted, at the seams by a few pixels: with
    0 the floor is at its true place, with the markers' height the markers are.

    Args:
        frames: pictures of one timestep.
        cameras: those that took them, in any order.
        arena: the part of the floor to show.
        px_per_m: resolution of the result.

    Returns:
        (rows, columns) uint8, +x to the right and +y up; black where no camera sees.
    """
    known = {camera.id: camera for camera in cameras}
    x, y = _places(arena, px_per_m)
    distances = [_distance_m(known[frame.camera], x, y) for frame in frames]
    nearest = np.min(distances, axis=0)
    total: Image32 = np.zeros(x.shape, dtype=np.float32)
    weights: Image32 = np.full(x.shape, 1e-30, dtype=np.float32)
    for frame, distance in zip(frames, distances):
        camera = known[frame.camera]
        column, row = _pixels(camera, arena, px_per_m, height_m, x.shape)
        picture = _smooth(frame.image / vignetting(camera), camera, height_m, px_per_m)
        seen = cv2.remap(picture, column, row, cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE)
        inside = camera.contains(np.stack((column, row), axis=-1))
        weight = np.exp((nearest - distance) / _SEAM_M).astype(np.float32) * inside
        total += seen * weight
        weights += weight
    return np.asarray(cv2.convertScaleAbs(total / weights), dtype=np.uint8)


def _places(arena: Arena, px_per_m: float) -> tuple[Image32, Image32]:
    """Arena x and y of the result's pixels, (rows, columns) float32."""
    columns, rows = (round(size * px_per_m) for size in arena.size_m[:2])
    x = arena.centre_m[0] + (np.arange(columns) - (columns - 1) / 2) / px_per_m
    y = arena.centre_m[1] - (np.arange(rows) - (rows - 1) / 2) / px_per_m
    place_x, place_y = np.meshgrid(x.astype(np.float32), y.astype(np.float32))
    return place_x, place_y


def _pixels(
    camera: Camera, arena: Arena, px_per_m: float, height_m: float, shape: tuple[int, int]
) -> tuple[Image32, Image32]:
    """Column and row in the camera's picture of each of the result's pixels."""
    middle = (np.array(shape[::-1]) - 1) / 2
    centre = np.array(arena.centre_m[:2])

    def project(pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        places = centre + (pixels - middle) * (1.0, -1.0) / px_per_m
        height = np.full((*pixels.shape[:-1], 1), height_m)
        return camera.project(np.concatenate((places, height), axis=-1))

    return everywhere(project, shape)


def _distance_m(camera: Camera, x: Image32, y: Image32) -> Image32:
    """Distance of each place from the point below the camera."""
    centre_x, centre_y = np.array(camera.position_m[:2], dtype=np.float32)
    return np.asarray(np.hypot(x - centre_x, y - centre_y), dtype=np.float32)


def _smooth(
    picture: NDArray[np.floating], camera: Camera, height_m: float, px_per_m: float
) -> Image32:
    """Removes what is finer than the result's pixels."""
    reduction = camera.fx_px / (camera.position_m[2] - height_m) / px_per_m
    fine = picture.astype(np.float32)
    if reduction <= 1.0:
        return fine
    return np.asarray(cv2.GaussianBlur(fine, (0, 0), 0.4 * reduction), dtype=np.float32)
