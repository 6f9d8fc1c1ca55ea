"""Worlds and sensors for the tests of sensors: made from XML as users do, or moved as a whole."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import POSE, ArenaState
from vsense.base.xml.element import Element
from vsense.base.xml.parsing import parse
from vsense.config import devices
from vsense.world.entities import Box, Cylinder, Entity, Light
from vsense.world.sensors.base import MountedSensor, Scope
from vsense.world.world import World

STEP_NS = 100_000_000

Place = tuple[float, float, float]
Places = Mapping[int, Place]


def element(xml: str) -> Element:
    """Reads one element, in which `vs:` is our own namespace."""
    return parse(f'<r xmlns:vs="urn:vsense:1">{xml}</r>'.encode(), "x.argos").children()[0]


def mount(xml: str, scope: Scope | None = None) -> MountedSensor:
    """Mounts the sensor of an element; every attribute of it has to be understood."""
    wanted = element(xml)
    mounted = devices.mount_sensor(wanted, scope or Scope({}, 0))
    wanted.check_all_read()
    return mounted


def sensor(xml: str, scope: Scope | None = None) -> Any:
    """Makes the sensor of an element."""
    return mount(xml, scope).sensor


def arena_state(
    places: Places, capture_ns: int = STEP_NS, lost: Collection[int] = ()
) -> ArenaState:
    """Makes an arena state in which all are seen but those that are lost."""
    robots = np.zeros(len(places), dtype=POSE)
    for row, (tag, place) in zip(robots, sorted(places.items())):
        row["tag"], row["seen"], row["capture_ns"] = tag, tag not in lost, capture_ns
        row["x_m"], row["y_m"], row["yaw_rad"] = place
    return ArenaState(capture_ns // STEP_NS, capture_ns, robots, len(places) - len(lost))


def world_of(places: Places, entities: Iterable[Entity] = (), **arguments: Any) -> World:
    """Makes a world in which robots were just seen at these places."""
    objects = arguments.get("objects", ())
    robots = [tag for tag in places if tag not in objects]
    world = World(robots, entities=entities, **arguments)
    world.update(arena_state(places), 0)
    return world


def read(device: Any, places: Places, entities: Iterable[Entity] = (), **arguments: Any) -> Any:
    """Reads a sensor in a world made for it: a list per robot, in the order of `places`."""
    world = world_of(places, entities, **arguments)
    return np.asarray(device.read(world, world.robots[: world.real_robots])).tolist()


class Motion:
    """A motion of the whole arena in the plane: mirrored at the x axis, turned, shifted."""

    def __init__(self, angle_rad: float, shift_m: tuple[float, float], mirror: bool) -> None:
        self.angle_rad = angle_rad
        self.shift_m = shift_m
        self.sign = -1.0 if mirror else 1.0

    def place(self, place: Place) -> Place:
        """Moves a pose."""
        x, y = place[0], self.sign * place[1]
        c, s = math.cos(self.angle_rad), math.sin(self.angle_rad)
        yaw = math.remainder(self.sign * place[2] + self.angle_rad, 2 * math.pi)
        return c * x - s * y + self.shift_m[0], s * x + c * y + self.shift_m[1], yaw

    def entity(self, entity: Entity) -> Entity:
        """Moves anything virtual."""
        if isinstance(entity, (Cylinder, Light)):
            x, y, _ = self.place((*entity.position_m[:2], 0.0))
            return replace(entity, position_m=(x, y, entity.position_m[2]))
        if isinstance(entity, Box):
            x, y, yaw = self.place((*entity.position_m[:2], entity.yaw_rad))
            return replace(entity, position_m=(x, y, entity.position_m[2]), yaw_rad=yaw)
        x, y, yaw = self.place((entity.x_m, entity.y_m, entity.yaw_rad))
        return replace(entity, x_m=x, y_m=y, yaw_rad=yaw)


def rows(device: Any, world: World) -> NDArray[np.float64]:
    """Reads a sensor for all real robots of a world: (n, k)."""
    return np.asarray(device.read(world, world.robots[: world.real_robots]), dtype=np.float64)
