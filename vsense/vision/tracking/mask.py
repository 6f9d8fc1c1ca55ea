"""The arena's outline as a mask over the cameras' pictures: outside of it nothing is detected.

People stand around an arena, and their hands, shoes and shirts have dark things on light ground.
A mask is given in the arena frame and carried into each picture through the camera's calibration,
at the markers' height; nobody paints anything, and where a camera is calibrated anew, it follows.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats, Image, from_sides_m
from vsense.base.errors import VsenseError
from vsense.base.native import kernels
from vsense.vision.cameras.camera import Camera

MASK_MARGIN_M = 0.05
"""Usual margin: markers of robots that touch the arena's border are inside."""
_KEPT = 256
"""Cameras and heights whose blocks are not computed anew."""
_LEAST_AREA_M2 = 1e-4
_DRAWN_PX = 4
_HEIGHTS = 4
"""Heights between the floor and the tops of what is kept that are projected."""


class MaskError(VsenseError):
    """Corners that make no outline."""


@dataclass(frozen=True, slots=True)
class Mask:
    """Where markers are looked for: in a polygon, and so far around it.

    Attributes:
        outline_m: The polygon's corners in their order, x and y in the arena frame.
        margin_m: 0 or more.
    """

    outline_m: tuple[tuple[float, float], ...]
    margin_m: float = MASK_MARGIN_M

    def __post_init__(self) -> None:
        corners = np.array(self.outline_m, dtype=np.float64)
        if corners.ndim != 2 or corners.shape[0] < 3 or corners.shape[1] != 2:
            raise MaskError(f"{len(self.outline_m)} corners, expected 3 or more, each x and y")
        if not np.isfinite(corners).all() or not 0.0 <= self.margin_m < np.inf:
            raise MaskError("a corner or the margin is not a number that can be used")
        x, y = corners.T
        area = 0.5 * abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))))
        if area < _LEAST_AREA_M2:
            raise MaskError("the corners enclose nothing")

    def keeps(self, places_m: Floats) -> NDArray[np.bool_]:
        """Whether something at (n, 2) places is detected."""
        return np.asarray(self.distance_m(places_m) <= self.margin_m)

    def distance_m(self, places_m: Floats) -> Floats:
        """Returns how far (n, 2) places are from the polygon: 0 inside; infinite for no place."""
        away, inside = from_sides_m(self.outline_m, places_m)
        return np.where(np.isnan(away), np.inf, np.where(inside, 0.0, away))


class Blocks(NamedTuple):
    """What a mask makes of the blocks of a picture, each (lines, columns) uint8: 1 or 0.

    Attributes:
        outside: No piece of a marker that is kept is in them: C need not scan them.
        inside: A marker whose place is in them is kept.
    """

    outside: NDArray[np.uint8]
    inside: NDArray[np.uint8]


@lru_cache(maxsize=_KEPT)
def blocks_of(mask: Mask, camera: Camera, height_m: float, reach_m: float) -> Blocks:
    """Returns the blocks of a camera's pictures.

    Args:
        height_m: Of the markers above the floor.
        reach_m: How far a marker reaches from its place.
    """
    side = kernels.VS_MARKERS_BLOCK
    columns, lines = (-(-size // side) for size in (camera.width_px, camera.height_px))
    middle = (np.stack(np.meshgrid(np.arange(columns), np.arange(lines)), axis=-1) + 0.5) * side
    points = middle.reshape(-1, 2) - 0.5
    with np.errstate(all="ignore"):
        places = camera.to_plane(points, height_m)
        half_m = 1.5 * np.linalg.norm(
            camera.to_plane(points + 0.5 * side, height_m) - places, axis=1
        )
        away, inside = from_sides_m(mask.outline_m, places)
        beyond = np.where(inside, -away, away) - mask.margin_m
    # What the lens shows of no plane, a marker cannot be in.
    outside = ~(beyond <= reach_m + half_m)
    shape = lines, columns
    return Blocks(
        np.ascontiguousarray(outside.reshape(shape), dtype=np.uint8),
        np.ascontiguousarray((beyond <= -half_m).reshape(shape), dtype=np.uint8),
    )


def outlines_px(mask: Mask, camera: Camera, height_m: float) -> list[list[tuple[float, float]]]:
    """Returns the polygons in a camera's picture in which markers are looked for, for drawing.

    They are as coarse as `_DRAWN_PX`. Where nothing of the arena is in the picture there are none.
    """
    kept = _kept(mask, camera, height_m)
    contours, _ = cv2.findContours(kept, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    polygons = [cv2.approxPolyDP(c, 0.7, True).reshape(-1, 2) * _DRAWN_PX for c in contours]
    return [[(float(x), float(y)) for x, y in polygon] for polygon in polygons if len(polygon) > 2]


def painted(image: Image, mask: Mask, camera: Camera, top_m: float) -> Image:
    """Returns a grey picture with an even grey where it shows nothing of what the mask keeps.

    What is up to `top_m` above the kept floor stays to be seen, and what stands in front of it.
    """
    kept = _everything_kept(mask, camera, top_m)
    size = image.shape[1], image.shape[0]
    is_kept = np.asarray(cv2.resize(kept, size, interpolation=cv2.INTER_NEAREST)) != 0
    grey = np.uint8(image[is_kept].mean() if is_kept.any() else 0)
    return np.where(is_kept, image, grey)


@lru_cache(maxsize=_KEPT)
def _everything_kept(mask: Mask, camera: Camera, top_m: float) -> Image:
    kept = np.maximum.reduce(
        [_kept(mask, camera, height) for height in np.linspace(0.0, top_m, _HEIGHTS)]
    )
    # Not a pixel of the arena is lost for the coarse grid.
    kept = cv2.dilate(kept, np.ones((3, 3), np.uint8))
    size = kept.shape[1] * _DRAWN_PX, kept.shape[0] * _DRAWN_PX
    fine = cv2.resize(kept, size, interpolation=cv2.INTER_NEAREST)
    return np.ascontiguousarray(fine[: camera.height_px, : camera.width_px], np.uint8)


def _kept(mask: Mask, camera: Camera, height_m: float) -> Image:
    """What of a picture shows a kept place at a height, a number for each `_DRAWN_PX`: 1 or 0."""
    columns, lines = (-(-size // _DRAWN_PX) + 1 for size in (camera.width_px, camera.height_px))
    points = np.stack(np.meshgrid(np.arange(columns), np.arange(lines)), axis=-1) * _DRAWN_PX
    with np.errstate(all="ignore"):
        places = camera.to_plane(points.reshape(-1, 2).astype(np.float64), height_m)
    return mask.keeps(places).reshape(lines, columns).astype(np.uint8)
