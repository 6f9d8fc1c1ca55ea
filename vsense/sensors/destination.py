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

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from vsense.sensors import places
from vsense.sensors.base import Readings, Robots, Scope
from vsense.sensors.geometry import seen_from
from vsense.sensors.quality import Scale
from vsense.world.world import World
from vsense.xml.element import Element

ELEMENTS = ("destination_virtual_sensor",)

_OWN_TAG = "{tag}"


@dataclass(frozen=True, slots=True)
class DestinationSensor:
    """Robots' destinations: `target` is that of all, or the pattern of the entities' ids."""

    target: places.Place | str
    name: str = "destination"
    layout: str = "5*f4"
    scale: ClassVar[Scale] = Scale(
        low=(-np.inf, -np.inf, -np.inf, 0.0, -np.inf), wraps=(False, False, True, False, True)
    )

    def read(self, world: World, robots: Robots) -> Readings:
        """Reads the destinations; see `VirtualSensor.read`."""
        readings = np.zeros((len(robots), 5))
        for axis, name in enumerate(("x_m", "y_m", "yaw_rad")):
            readings[:, axis] = robots[name]
        if isinstance(self.target, str):
            for reading, tag in zip(readings, robots["tag"].tolist()):
                place = places.EntityPlace(self.target.replace(_OWN_TAG, str(tag)))
                reading[:3] = place.pose(world) or reading[:3]
        else:
            readings[:, :3] = self.target.pose(world) or readings[:, :3]
        distance, bearing = seen_from(robots, readings[:, :1], readings[:, 1:2])
        readings[:, 3] = distance[:, 0]
        readings[:, 4] = np.where(distance > 0.0, bearing, 0.0)[:, 0]
        return readings


def from_xml(element: Element, scope: Scope) -> DestinationSensor:
    """Makes the sensor from its element."""
    target = element.text("vs:target", f"destination_{_OWN_TAG}")
    if _OWN_TAG in target:
        return DestinationSensor(target)
    return DestinationSensor(places.from_xml(element, scope, "vs:target"))
