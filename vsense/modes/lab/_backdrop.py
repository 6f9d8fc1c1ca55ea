"""The empty arena in one camera: floor, walls and light.

Walls and boxes are painted slice by slice from the floor upwards: as every ray comes from above,
the highest slice is also the nearest.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats, Image
from vsense.base.shared import LabError
from vsense.modes.lab._optics import RayMap, blur, vignetting
from vsense.modes.lab._scene import Scene
from vsense.vision.cameras.camera import Camera, Image32
from vsense.world.entities import Box, Cylinder

FULL_DN = 213.0
"""Reading of a perfectly white surface in light of strength 1; paper stays below 255."""

_SLICE_M = 0.003
_EDGE_M = 0.02
_ROUND_POINTS = 72
_TOP = 150
_SIDE = 105
_FOOT = 60
_SHIFT = 4


@dataclass(frozen=True, slots=True)
class Block:
    """A wall, a box or a cylinder that stands on the floor and never moves, arena frame.

    Attributes:
        x_m, y_m: its middle.
        length_m, width_m: extents along its own x and y.
        is_round: it is the upright cylinder that fits in.
    """

    x_m: float
    y_m: float
    yaw_rad: float
    length_m: float
    width_m: float
    height_m: float
    is_round: bool = False

    def __post_init__(self) -> None:
        if not min(self.length_m, self.width_m, self.height_m) > 0.0:
            raise LabError(f"box at {self.x_m}, {self.y_m}: its sizes must be positive")

    @classmethod
    def of(cls, thing: Box | Cylinder) -> Block:
        """What stands in the real arena, as pictures show it."""
        x_m, y_m = thing.position_m[:2]
        if isinstance(thing, Box):
            return cls(x_m, y_m, thing.yaw_rad, *thing.size_m)
        return cls(x_m, y_m, 0.0, 2 * thing.radius_m, 2 * thing.radius_m, thing.height_m, True)

    def outline(self) -> Floats:
        """Points (n, 2) around the box, close enough for a lens to bend the edges."""
        if self.is_round:
            radii = np.array((self.length_m, self.width_m)) / 2
            angles = np.linspace(0.0, 2.0 * np.pi, _ROUND_POINTS, endpoint=False)
            turned = np.column_stack((np.cos(angles), np.sin(angles))) * radii
            return np.asarray(turned + np.array((self.x_m, self.y_m)))
        corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * (self.length_m, self.width_m) / 2
        points = []
        for start, end in zip(corners, np.roll(corners, -1, axis=0)):
            steps = int(np.ceil(np.hypot(*(end - start)) / _EDGE_M)) + 1
            points.append(np.linspace(start, end, steps, endpoint=False))
        cos, sin = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        turned = np.concatenate(points) @ np.array([[cos, sin], [-sin, cos]])
        return np.asarray(turned + np.array((self.x_m, self.y_m)))


class Backdrop:
    """The empty arena in one camera; painted in about 0.1 s.

    Attributes:
        grey: (h, w) float32, the picture without noise [DN].
        light: (h, w) float32, reading of a perfectly white surface there [DN].
        top_m: (h, w) float32, height above the floor of what is seen.
    """

    def __init__(self, rays: RayMap, scene: Scene, boxes: tuple[Block, ...]) -> None:
        self.light: Image32 = scene.light(rays) * vignetting(rays.camera) * np.float32(FULL_DN)
        surface = scene.floor(rays)
        self.top_m: Image32 = np.zeros(surface.shape, dtype=np.float32)
        _shade_foot(surface, rays.camera, boxes)
        _stand(surface, self.top_m, rays.camera, boxes)
        self.grey = blur(surface * self.light * np.float32(1.0 / 255.0))


def _polygon(camera: Camera, outline: Floats, height_m: float) -> NDArray[np.int32]:
    """The picture of an outline at a height, in 1/16 px."""
    points = np.column_stack((outline, np.full(len(outline), height_m)))
    return np.rint(camera.project(points) * (1 << _SHIFT)).astype(np.int32)


def _stand(surface: Image, top_m: Image32, camera: Camera, boxes: tuple[Block, ...]) -> None:
    """Paints all boxes into the surface and their heights into `top_m`, in place."""
    highest = max((box.height_m for box in boxes), default=0.0)
    outlines = [box.outline() for box in boxes]
    for height_m in np.arange(0.0, highest + _SLICE_M, _SLICE_M):
        for box, outline in zip(boxes, outlines):
            if height_m - box.height_m >= _SLICE_M:
                continue
            at_top = height_m >= box.height_m
            level = min(float(height_m), box.height_m)
            polygon = [_polygon(camera, outline, level)]
            grey = _TOP if at_top else int(_FOOT + (_SIDE - _FOOT) * level / box.height_m)
            cv2.fillPoly(surface, polygon, grey, cv2.LINE_AA, _SHIFT)
            cv2.fillPoly(top_m, polygon, level, cv2.LINE_8, _SHIFT)


def _shade_foot(surface: Image, camera: Camera, boxes: tuple[Block, ...]) -> None:
    """Darkens the floor near the boxes, where less light arrives, in place."""
    shrink = 8
    height, width = surface.shape
    near = np.zeros((height // shrink + 1, width // shrink + 1), dtype=np.uint8)
    for box in boxes:
        polygon = _polygon(camera, box.outline(), 0.0) // shrink
        cv2.fillPoly(near, [polygon], 255, cv2.LINE_AA, _SHIFT)
    near = np.asarray(cv2.GaussianBlur(near, (0, 0), 3.0), dtype=np.uint8)
    near = np.asarray(cv2.resize(near, (width, height)), dtype=np.uint8)
    cv2.multiply(surface, 255 - near // 2, dst=surface, scale=1.0 / 255.0)
