"""The RGB ground sensor of the thesis: the floor's colour under the robot's centre, with alpha.

    <virtual_rgb_ground_sensor implementation="default" vs:bits="4" />

Sensor "rgb_ground", four numbers 0..255: red, green, blue, alpha; alpha is 255 where the floor's
picture has none. The unit of the quality settings is 255, the whole range: noise_level="0.1" is
+-25.5. Alpha is a mark in the picture, no measurement: it has no noise.

Source: thesis 4.2.1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from vsense.base.xml.element import Element
from vsense.world.sensors.base import ReadFunction, Readings, Robots, Scope
from vsense.world.sensors.geometry import ground_reader, read_in_c
from vsense.world.sensors.quality import Scale
from vsense.world.world import World

ELEMENTS = ("virtual_rgb_ground_sensor",)


@dataclass(frozen=True, slots=True)
class RgbGroundSensor:
    """Looks at the floor; see the module."""

    name: str = "rgb_ground"
    layout: str = "4*u1"
    scale: ClassVar[Scale] = Scale(unit=(255.0, 255.0, 255.0, 0.0), low=0.0, high=255.0)

    def read(self, world: World, robots: Robots) -> Readings:
        """Reads the floor's colour; see `VirtualSensor.read`."""
        return read_in_c(self.kernel(world, robots), world, robots, 4)

    def kernel(self, world: World, robots: Robots) -> ReadFunction:
        """See `vsense/world/sensors/base.py`."""
        return ground_reader(world.floor, len(robots), [(0.0, 0.0)])


def from_xml(element: Element, scope: Scope) -> RgbGroundSensor:
    """Makes the sensor; it has only quality settings."""
    return RgbGroundSensor()
