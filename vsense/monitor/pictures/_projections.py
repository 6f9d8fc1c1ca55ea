"""Where places of the arena are in a picture: from above, or through a camera's lens.

Both take places relative to the arena's middle and give px of the finished picture. Straight things
are cut before the lens bends them.
"""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats, Image
from vsense.vision.cameras.camera import Camera, Image32, everywhere

NEAR_PLANE_M = 0.02
"""What is nearer to a camera's plane than this, or behind it, is not shown."""

_BEND_PX = 6.0
"""A line is bent by the lens at points that are at most so far apart."""
_MOST_STEPS = 400
_NOWHERE_PX = 1e6
_OWN_M = 0.01
_BESIDE_M = _OWN_M * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


class Projection(Protocol):
    """Where places are; points are (n, 3) x, y, z in m."""

    flat: bool
    """Whether heights do not count."""
    size_px: tuple[int, int]
    """Width and height of the finished picture."""

    def area(self, corners_m: Floats) -> Floats:
        """The (k, 2) corners of what is to be seen of an area; k is 0 where it is nothing."""
        ...

    def line(self, points_m: Floats, closed: bool = False) -> list[Floats]:
        """The pieces (k, 2) of what is to be seen of a line."""
        ...

    def spot(self, point_m: Floats) -> tuple[Floats, float] | None:
        """The place (2,) of a (3,) point and the px of a metre there; None: it is not seen."""
        ...

    def spread(self, raster: Image, size_m: Floats, smooth: bool, scale: int) -> Image:
        """Lays a raster (h, w, channels) on the floor around the arena's middle.

        `size_m` is its extent, its first row lies at the highest y. Gives a picture of the whole
        view with the same channels, 0 where the raster is not, `scale` times as large.
        """
        ...


class FromAbove:
    """The arena as one sees it from very far above, +y up."""

    flat = True

    def __init__(self, size_m: Floats, width_px: int) -> None:
        self.zoom = float(width_px / size_m[0])
        self.size_px = (width_px, max(round(float(size_m[1]) * self.zoom), 1))
        self._size_m = size_m
        self._middle = np.asarray(size_m) * self.zoom / 2.0

    def area(self, corners_m: Floats) -> Floats:
        """See `Projection`."""
        return np.asarray(corners_m[:, :2] * (self.zoom, -self.zoom) + self._middle)

    def line(self, points_m: Floats, closed: bool = False) -> list[Floats]:
        """See `Projection`."""
        points = self.area(points_m)
        return [np.vstack((points, points[:1])) if closed else points]

    def spot(self, point_m: Floats) -> tuple[Floats, float]:
        """See `Projection`."""
        return self.area(point_m[None])[0], self.zoom

    def spread(self, raster: Image, size_m: Floats, smooth: bool, scale: int) -> Image:
        """See `Projection`; the raster covers the whole arena."""
        size = (self.size_px[0] * scale, self.size_px[1] * scale)
        how = cv2.INTER_LINEAR if smooth else cv2.INTER_NEAREST
        return np.asarray(cv2.resize(raster, size, interpolation=how), np.uint8)


class ThroughLens:
    """The arena as a camera's picture shows it: pose, perspective and distortion.

    Args:
        camera: whose picture it is.
        width_px: the picture's width, its height follows.
        middle_m: (2,) the arena's middle, arena frame.
    """

    flat = False

    def __init__(self, camera: Camera, width_px: int, middle_m: Floats) -> None:
        self.zoom = width_px / camera.width_px
        self.size_px = (width_px, max(round(camera.height_px * self.zoom), 1))
        self._camera = camera
        self._turn = np.reshape(camera.rotation, (3, 3))
        self._origin = np.array(camera.position_m) - (*middle_m, 0.0)
        self._radius = camera.window_radius()
        self._step = _BEND_PX / (max(camera.fx_px, camera.fy_px) * self.zoom)

    def area(self, corners_m: Floats) -> Floats:
        """See `Projection`."""
        seen = self._seen(corners_m)
        front = _cut(seen, seen[:, 2] - NEAR_PLANE_M)
        if len(front) < 3:
            return np.empty((0, 2))
        plane = _cut_to_disc(front[:, :2] / front[:, 2:], self._radius)
        if len(plane) < 3:
            return np.empty((0, 2))
        return self._bent(self._path(np.vstack((plane, plane[:1])))[:-1])

    def line(self, points_m: Floats, closed: bool = False) -> list[Floats]:
        """See `Projection`."""
        seen = self._seen(points_m)
        if closed:
            seen = np.vstack((seen, seen[:1]))
        if seen[:, 2].min() >= NEAR_PLANE_M:
            plane = seen[:, :2] / seen[:, 2:]
            if np.hypot(*plane.T).max() <= self._radius:
                return [self._bent(self._path(plane))]
        pieces: list[list[Floats]] = [[]]
        for start, end in pairwise(seen):
            visible = self._visible(start, end)
            if visible is None:
                pieces.append([])
                continue
            first, last = visible
            if pieces[-1] and not np.array_equal(pieces[-1][-1][-1], first):
                pieces.append([])
            pieces[-1].append(self._path(np.stack((first, last))))
        return [self._bent(np.vstack(piece)) for piece in pieces if piece]

    def spot(self, point_m: Floats) -> tuple[Floats, float] | None:
        """See `Projection`."""
        beside = point_m + _BESIDE_M
        seen = self._seen(beside)
        if seen[:, 2].min() < NEAR_PLANE_M:
            return None
        plane = seen[:, :2] / seen[:, 2:]
        if np.hypot(*plane.T).max() > self._radius:
            return None
        here, right, up = self._bent(plane)
        px_per_m = abs(float(np.linalg.det(np.stack((right - here, up - here))))) ** 0.5 / _OWN_M
        return here, px_per_m

    def spread(self, raster: Image, size_m: Floats, smooth: bool, scale: int) -> Image:
        """See `Projection`."""
        x, y = self._floor if scale == 1 else self._floor_at(scale)
        rows, columns = raster.shape[:2]
        across = (x / np.float32(size_m[0]) + np.float32(0.5)) * columns - np.float32(0.5)
        down = (np.float32(0.5) - y / np.float32(size_m[1])) * rows - np.float32(0.5)
        how = cv2.INTER_LINEAR if smooth else cv2.INTER_NEAREST
        laid = cv2.remap(raster, across, down, how, None, cv2.BORDER_CONSTANT, 0)
        return np.asarray(laid, np.uint8)

    def _seen(self, points_m: Floats) -> Floats:
        """Points in the camera's frame."""
        return np.asarray((points_m - self._origin) @ self._turn.T)

    def _visible(self, start: Floats, end: Floats) -> tuple[Floats, Floats] | None:
        """The ends (2,), on the image plane, of what is to be seen of a line; None: nothing."""
        if start[2] < NEAR_PLANE_M and end[2] < NEAR_PLANE_M:
            return None
        if start[2] < NEAR_PLANE_M or end[2] < NEAR_PLANE_M:
            way = end - start
            meeting = start + (NEAR_PLANE_M - start[2]) / way[2] * way
            start, end = (meeting, end) if start[2] < NEAR_PLANE_M else (start, meeting)
        first, last = start[:2] / start[2], end[:2] / end[2]
        shares = _within_disc(first, last, self._radius)
        if shares is None:
            return None
        low, high = shares
        way = last - first
        return (
            first if low == 0.0 else first + low * way,
            last if high == 1.0 else first + high * way,
        )

    def _path(self, plane: Floats) -> Floats:
        """Points of a line on the image plane, as near to each other as the lens needs."""
        ways = np.diff(plane, axis=0)
        counts = np.minimum(np.hypot(*ways.T) / self._step, _MOST_STEPS).astype(int) + 1
        if counts.max() == 1:
            return plane
        ends = np.cumsum(counts)
        shares = (np.arange(ends[-1]) - np.repeat(ends - counts, counts)) / np.repeat(
            counts, counts
        )
        between = np.repeat(plane[:-1], counts, axis=0)
        between += shares[:, None] * np.repeat(ways, counts, axis=0)
        return np.vstack((between, plane[-1:]))

    def _bent(self, plane: Floats) -> Floats:
        """Points of the image plane in the picture, (n, 2) px."""
        pixels = self._camera.shown(plane[:, 0], plane[:, 1])
        return np.asarray((pixels + 0.5) * self.zoom - 0.5)

    @cached_property
    def _floor(self) -> tuple[Image32, Image32]:
        return self._floor_at(1)

    def _floor_at(self, scale: int) -> tuple[Image32, Image32]:
        """The x and y [m] of the floor in each pixel; far away where none is seen."""
        camera, zoom = self._camera, self.zoom * scale

        def floor(pixels: Floats) -> Floats:
            own = (pixels + 0.5) / zoom - 0.5
            with np.errstate(all="ignore"):
                x, y = camera.straightened(own)
                rays = np.stack((x, y, np.ones_like(x)), axis=-1) @ self._turn
                reach = -self._origin[2] / rays[..., 2]
                places = self._origin[:2] + reach[..., None] * rays[..., :2]
                right = (np.hypot(x, y) <= self._radius) & (reach >= NEAR_PLANE_M)
            return np.where(right[..., None], places, _NOWHERE_PX)

        size = (self.size_px[1] * scale, self.size_px[0] * scale)
        return everywhere(floor, size)


def upright(outline_m: NDArray[np.floating], height_m: float) -> Floats:
    """(n, 2) places at a height, (n, 3)."""
    places = np.asarray(outline_m, np.float64)
    return np.column_stack((places, np.full(len(places), height_m)))


def _cut(points: Floats, distances: Floats) -> Floats:
    """Returns the part of an area (n, k) on one side: where the corners' distances are not < 0."""
    inside = distances >= 0.0
    if inside.all():
        return points
    if not inside.any():
        return points[:0]
    corners = []
    for here in range(len(points)):
        there = (here + 1) % len(points)
        if inside[here]:
            corners.append(points[here])
        if inside[here] != inside[there]:
            share = distances[here] / (distances[here] - distances[there])
            corners.append(points[here] + share * (points[there] - points[here]))
    return np.array(corners)


_SIDES = 48
_TURNS = (np.arange(_SIDES) + 0.5) * 2.0 * np.pi / _SIDES
_NORMALS = np.stack((np.cos(_TURNS), np.sin(_TURNS)), axis=-1)


def _cut_to_disc(points: Floats, radius: float) -> Floats:
    """Returns the part of an area of (n, 2) corners in a polygon inside of the disc."""
    reach = radius * float(np.cos(np.pi / _SIDES))
    if len(points) == 0 or float(np.hypot(*points.T).max()) <= reach:
        return points
    for normal in _NORMALS:
        points = _cut(points, reach - points @ normal)
        if len(points) == 0:
            break
    return points


def _within_disc(start: Floats, end: Floats, radius: float) -> tuple[float, float] | None:
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
