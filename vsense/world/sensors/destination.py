"""The destination: where the robot is to go, as set by the experiment or its loop functions.

    <destination_virtual_sensor implementation="default" vs:target="nest" />
    <destination_virtual_sensor implementation="default" vs:target="goal_{tag}" />

Sensor "destination", five numbers: x, y [m] and heading [rad] of the destination in the arena, and
as the robot sees it: distance [m] and bearing [rad], counter-clockwise from straight ahead. The
first three are those of the original; with the other two a robot needs no GPS to go there.

`vs:target` is the id of something tagged or virtual, which may move; `{tag}` in it stands for the
robot's own tag: so a loop function gives each robot a destination of its own by putting an entity
of that id into the world. The default is "destination_{tag}". A robot without a destination is sent
its own place: it has arrived. A unit of the quality settings is 1 m or 1 rad.

Source: iridia.md section 1b (x, y, heading).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from vsense.base.native import kernel_ffi, kernels, pointer
from vsense.base.xml.element import Element
from vsense.world.sensors import _places
from vsense.world.sensors.base import ReadFunction, Readings, Robots, Scope
from vsense.world.sensors.geometry import read_in_c
from vsense.world.sensors.quality import Scale
from vsense.world.world import World

ELEMENTS = ("destination_virtual_sensor",)

_OWN_TAG = "{tag}"


@dataclass(frozen=True, slots=True)
class DestinationSensor:
    """Robots' destinations: `target` is that of all, or the pattern of the entities' ids."""

    target: _places.AnyPlace | str
    name: str = "destination"
    layout: str = "5*f4"
    scale: ClassVar[Scale] = Scale(
        low=(-np.inf, -np.inf, -np.inf, 0.0, -np.inf), wraps=(False, False, True, False, True)
    )

    def read(self, world: World, robots: Robots) -> Readings:
        """Reads the destinations; see `VirtualSensor.read`."""
        return read_in_c(self._kernel(world, robots), world, robots, 5)

    def kernel(self, world: World, robots: Robots) -> ReadFunction | None:
        """See `vsense/world/sensors/base.py`."""
        moves = isinstance(self.target, _places.TaggedPlace)  # by itself
        return None if moves else self._kernel(world, robots)

    def _kernel(self, world: World, robots: Robots) -> ReadFunction:
        nowhere = math.nan, math.nan, math.nan  # the robot is there
        poses = [pose or nowhere for pose in self._poses(world, robots)]
        rows = pointer("double", np.array(poses, dtype=np.float64).reshape(-1, 3))
        destinations = kernel_ffi.new("struct vs_destinations *", (rows,))
        return ReadFunction(kernels, "vs_destinations_read", destinations, owner=rows)

    def _poses(self, world: World, robots: Robots) -> Sequence[_places.PlacePose | None]:
        """Where robots (n,) are to go now."""
        if isinstance(self.target, str):
            names = [self.target.replace(_OWN_TAG, str(tag)) for tag in robots["tag"].tolist()]
            return [_places.EntityPlace(name).pose(world) for name in names]
        return [self.target.pose(world)] * len(robots)


def from_xml(element: Element, scope: Scope) -> DestinationSensor:
    """Makes the sensor from its element."""
    target = element.text("vs:target", f"destination_{_OWN_TAG}")
    if _OWN_TAG in target:
        return DestinationSensor(target)
    return DestinationSensor(_places.from_xml(element, scope, "vs:target"))
