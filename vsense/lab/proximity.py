"""The real infrared proximity ring of the lab's e-pucks: what bodies and walls reflect."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsense.lab.contacts import BODY_RADIUS_M, Floats, Neighbourhood, to_box_frame

POSITIONS_M = np.array(
    [
        (0.030, -0.010),
        (0.022, -0.025),
        (0.0, -0.031),
        (-0.030, -0.015),
        (-0.030, 0.015),
        (0.0, 0.031),
        (0.022, 0.025),
        (0.030, 0.010),
    ]
)
"""(8, 2) places of ps0..ps7, clockwise from the front right, in the robot's frame (x forward,
y left). Source: epuck.md section 6."""

HEADINGS_RAD = np.radians([-17.2, -45.9, -90.0, -151.5, 151.5, 90.0, 45.8, 17.2])
"""(8,) directions of ps0..ps7, counter-clockwise from straight ahead. Source: as above."""

TABLE_M = np.array([0.0, 0.005, 0.01, 0.015, 0.02, 0.03, 0.04, 0.05, 0.06, 0.07])
"""(10,) distances at which `TABLE_RAW` holds. Source: epuck.md section 6, from Webots."""
TABLE_RAW = np.array([4095.0, 2133.0, 1466.0, 601.0, 384.0, 235.0, 158.0, 120.0, 104.0, 67.0])
"""(10,) raw readings of a surface straight ahead; the last is also the reading of nothing."""

MAX_RAW = 4095
"""Largest value of the converter."""
NOISE_RAW = 8.0
"""Standard deviation of the additive noise: between Webots's 4 near and 25 far along the table."""

_RAYS = 7
_HALF_CONE_RAD = np.radians(30.0)
"""Rays of one sensor fan out this far to both sides, so that the cones of neighbouring sensors
meet (up to 61 degrees apart) and nobody hides between two of them."""
_FAN_RAD = np.linspace(-_HALF_CONE_RAD, _HALF_CONE_RAD, _RAYS)
_RESPONSE = np.cos(_FAN_RAD) ** 2
"""(_RAYS,) emitter and receiver each fall off with the cosine of the angle."""
_PARALLEL = 1e-30
"""Stands for a ray's slope of exactly 0, which would divide 0 by 0 on a box's edge."""


class ProximityRing:
    """The rings of all robots, read at once.

    Rays are laid out in the robot's frame once; bodies and boxes are turned into that frame.
    """

    def __init__(self, near: Neighbourhood, seed: int) -> None:
        """Rings that feel whoever is `near`; `seed` decides the noise."""
        self._near = near
        self._random = np.random.Generator(np.random.PCG64(seed))
        angles = (HEADINGS_RAD[:, None] + _FAN_RAD).reshape(-1)
        self._origins_m = np.repeat(POSITIONS_M, _RAYS, axis=0).T
        self._rays = np.stack([np.cos(angles), np.sin(angles)])

    def read(self, poses: Floats) -> NDArray[np.int16]:
        """What every ring measures now.

        Args:
            poses: (n, 3) x_m, y_m, yaw_rad of all bodies, robots first, arena frame.

        Returns:
            (m, 8) raw readings 0..4095 of ps0..ps7, higher is nearer; with noise.
        """
        raw = readings(self.distances(poses))
        noisy = raw + self._random.normal(0.0, NOISE_RAW, raw.shape)
        return np.clip(np.rint(noisy), 0, MAX_RAW).astype(np.int16)

    def distances(self, poses: Floats) -> Floats:
        """How far each ray gets: (m, 8, rays per sensor) in m, inf where it meets nothing."""
        near = self._near
        nearest = np.full((near.robots, self._rays.shape[1]), np.inf)
        if len(near.robot):
            np.minimum.at(nearest, near.robot, self._to_bodies(poses))
        if len(near.box_robot):
            np.minimum.at(nearest, near.box_robot, self._to_boxes(poses))
        return nearest.reshape(near.robots, len(POSITIONS_M), _RAYS)

    def _to_bodies(self, poses: Floats) -> Floats:
        """Distances (p, rays) in m for every near pair of robot and body."""
        robot, body = poses[self._near.robot], poses[self._near.body]
        cos, sin = np.cos(robot[:, 2]), np.sin(robot[:, 2])
        east, north = (body[:, :2] - robot[:, :2]).T
        ahead = (east * cos + north * sin)[:, None] - self._origins_m[0]
        aside = (north * cos - east * sin)[:, None] - self._origins_m[1]
        along = ahead * self._rays[0] + aside * self._rays[1]
        across = aside * self._rays[0] - ahead * self._rays[1]
        half_chord_squared = BODY_RADIUS_M**2 - across * across
        half_chord = np.sqrt(np.maximum(half_chord_squared, 0.0))
        met = (half_chord_squared > 0.0) & (along + half_chord > 0.0)
        return np.where(met, np.maximum(along - half_chord, 0.0), np.inf)

    def _to_boxes(self, poses: Floats) -> Floats:
        """Distances (q, rays) in m for every near pair of robot and box."""
        boxes, box = self._near.boxes, self._near.box
        robot = poses[self._near.box_robot]
        centre_m = to_box_frame(robot[:, :2] - boxes.centre_m[box], boxes.axis[box])
        facing = np.stack([np.cos(robot[:, 2]), np.sin(robot[:, 2])], axis=1)
        cos, sin = to_box_frame(facing, boxes.axis[box]).T[:, :, None]
        (from_x, from_y), (ray_x, ray_y) = self._origins_m, self._rays
        start_x = centre_m[:, :1] + from_x * cos - from_y * sin
        start_y = centre_m[:, 1:] + from_x * sin + from_y * cos
        enter_x, leave_x = _slab(start_x, ray_x * cos - ray_y * sin, boxes.half_m[box, :1])
        enter_y, leave_y = _slab(start_y, ray_x * sin + ray_y * cos, boxes.half_m[box, 1:])
        enter, leave = np.maximum(enter_x, enter_y), np.minimum(leave_x, leave_y)
        return np.where((enter <= leave) & (leave > 0.0), np.maximum(enter, 0.0), np.inf)


def _slab(start_m: Floats, slope: Floats, half_m: Floats) -> tuple[Floats, Floats]:
    """Where rays (q, r) enter and leave the strip |coordinate| <= half_m (q, 1), in m."""
    pace = 1.0 / np.where(slope == 0.0, _PARALLEL, slope)
    middle, reach = -start_m * pace, half_m * np.abs(pace)
    return middle - reach, middle + reach


def readings(distances_m: Floats) -> Floats:
    """What sensors make of the distances along their rays, without noise.

    Args:
        distances_m: (..., rays per sensor), inf where a ray meets nothing.

    Returns:
        (...,) raw values: of the ray that reflects most.
    """
    nothing: float = TABLE_RAW[-1]
    excess = np.interp(distances_m, TABLE_M, TABLE_RAW) - nothing
    strongest: Floats = (excess * _RESPONSE).max(axis=-1)
    return nothing + strongest
