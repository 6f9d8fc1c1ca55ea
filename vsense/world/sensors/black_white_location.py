"""Black and white location: in which directions two places lie, such as nest and source.

    <virtual_black_white_location_sensor implementation="default"
        white_min_x="-1.2" white_min_y="-0.5" white_max_x="-0.8" white_max_y="0.5"
        black_min_x="0.8" black_min_y="-0.5" black_max_x="1.2" black_max_y="0.5" />
    <virtual_black_white_location_sensor implementation="default" vs:white="nest" vs:black="food" />

Sensor "black_white_location", four numbers: x and y of the unit vector towards the middle of the
black place, then of the one towards the white place, in the robot's frame (x ahead, y left); 0, 0
on the spot. Each place is a rectangle [m], or by `vs:black` and `vs:white` the id of something
tagged or virtual that may move; 0, 0 while it is not there. The unit of the quality settings is 1.

Source: argos3-tycho's sensor of that name (two unit vectors from the rectangles' middles).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from vsense.base.xml.element import Element
from vsense.world.sensors import _places
from vsense.world.sensors.base import Readings, Robots, Scope
from vsense.world.sensors.geometry import seen_from
from vsense.world.sensors.quality import Scale
from vsense.world.world import World

ELEMENTS = ("virtual_black_white_location_sensor",)


@dataclass(frozen=True, slots=True)
class BlackWhiteLocationSensor:
    """Points to two places; see the module."""

    black: _places.AnyPlace
    white: _places.AnyPlace
    name: str = "black_white_location"
    layout: str = "4*f4"
    scale: ClassVar[Scale] = Scale(low=-1.0, high=1.0)

    def read(self, world: World, robots: Robots) -> Readings:
        """Reads the two directions; see `VirtualSensor.read`."""
        readings = np.zeros((len(robots), 4))
        for column, place in ((0, self.black), (2, self.white)):
            pose = place.pose(world)
            if pose is None:
                continue
            distance, bearing = seen_from(robots, [pose[0]], [pose[1]])
            direction = np.concatenate((np.cos(bearing), np.sin(bearing)), axis=1)
            readings[:, column : column + 2] = np.where(distance > 0.0, direction, 0.0)
        return readings


def from_xml(element: Element, scope: Scope) -> BlackWhiteLocationSensor:
    """Makes the sensor from its element."""
    black, white = (
        _places.from_xml(element, scope, f"vs:{color}")
        if element.has(f"vs:{color}")
        else _places.rectangle_from_xml(element, color)
        for color in ("black", "white")
    )
    return BlackWhiteLocationSensor(black, white)
