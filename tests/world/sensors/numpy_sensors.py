"""Sensors in NumPy, as vsense had them before they became C: what the kernels are held against."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.world.entities import Box, Cylinder
from vsense.world.rays import NOBODY, Bodies, disc_rows, entity_rows
from vsense.world.sensors.geometry import points_at, rows_of
from vsense.world.sensors.ground import AHEAD_M, LEFT_M
from vsense.world.sensors.proximity import RANGE_M, ProximitySensor
from vsense.world.world import World

Floats = NDArray[np.float64]
Robots = NDArray[np.void]

RAYS = 7
GREY = np.array([0.299, 0.587, 0.114]) / 255.0


def proximity(sensor: ProximitySensor, world: World, robots: Robots) -> Floats:
    """What `ProximitySensor.read` gives."""
    fan = np.zeros(1)
    if sensor.field_of_view_rad > 0.0:
        fan = sensor.field_of_view_rad / 2.0 * np.linspace(-1.0, 1.0, RAYS)
    headings = sensor.ring.headings(robots)[:, :, None] + fan
    starts = np.repeat(sensor.ring.points(robots)[:, :, None, :], len(fan), axis=2)
    ends = starts.copy()
    ends[..., 0] += sensor.range_m * np.cos(headings)
    ends[..., 1] += sensor.range_m * np.sin(headings)
    bodies: Bodies = virtual_bodies(world) if sensor.virtual_only else world.bodies()
    skip: Any = NOBODY
    if not sensor.virtual_only:
        skip = np.repeat(rows_of(world, robots), len(sensor.ring) * len(fan))
    shares = bodies.nearest(starts.reshape(-1, 3), ends.reshape(-1, 3), skip)
    if sensor.blind_within:
        shares[shares <= 0.0] = np.inf
    distances_m = sensor.range_m * shares.reshape(headings.shape).min(axis=2)
    if sensor.generic:
        return np.asarray(sensor.full * np.exp(-distances_m))
    return np.asarray(sensor.full * response(distances_m * (RANGE_M / sensor.range_m)))


def response(distance_m: Floats) -> Floats:
    """Reading of ARGoS's sensor at a distance, in [0, 1]; 0 beyond RANGE_M."""
    near = np.minimum(distance_m, RANGE_M)
    curve = 298.701 * near**2 - 36.8961 * near + 1.08212
    return np.where(distance_m <= RANGE_M, np.clip(curve, 0.0, 1.0), 0.0)


def virtual_bodies(world: World) -> Bodies:
    """Bodies that the real ring cannot sense."""
    robots = world.robots[world.real_robots :]
    things: list[Box | Cylinder] = [*world.cylinders(), *world.boxes()]
    standing = entity_rows([thing for thing in things if not thing.physical])
    return Bodies(np.concatenate((disc_rows(robots["x_m"], robots["y_m"]), standing)))


def ground(world: World, robots: Robots) -> Floats:
    """What `GroundSensor.read` gives; the sum's order is that of the kernel, no BLAS's."""
    points = points_at(robots, AHEAD_M, LEFT_M)
    red, green, blue, _ = world.floor.sample(points.reshape(-1, 2)).T
    grey = red * GREY[0] + green * GREY[1] + blue * GREY[2]
    return np.clip(grey, 0.0, 1.0).reshape(len(robots), len(LEFT_M))
