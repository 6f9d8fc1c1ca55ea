"""The ground sensor: how bright the floor is under three points in front of the robot.

    <virtual_ground_sensor implementation="default" noise_level="0.05" />

Sensor "ground", three numbers in [0, 1], left, centre, right: 0 is black, 1 is white. The floor is
the experiment's `<floor>` with its coloured zones; no real one has to be painted. The unit of the
quality settings is 1: the whole range from black to white.

ARGoS's `<epuck_ground>` and `<ground>`, and the foot-bot's two, are the same sensor.

Source: epuck_ground of ARGoS, iridia.md section 3; thesis 4.2.1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from vsense.base.xml.element import Element
from vsense.world.robot_models import EPUCK
from vsense.world.sensors.base import ReadFunction, Readings, Robots, Scope
from vsense.world.sensors.geometry import GroundPoints, read_in_c
from vsense.world.sensors.quality import Scale
from vsense.world.world import World

ELEMENTS = ("virtual_ground_sensor",)
ARGOS_ELEMENTS = ("epuck_ground", "ground", "footbot_base_ground", "footbot_motor_ground")
ARGOS_NOISE = ("noise_level",)

GREY = tuple(share / 255.0 for share in (0.299, 0.587, 0.114))
"""Brightness of red, green, blue. Source: as above."""


@dataclass(frozen=True, slots=True)
class GroundSensor:
    """Looks at the floor; see the module."""

    name: str = "ground"
    layout: str = "3*f4"
    scale: ClassVar[Scale] = Scale(low=0.0, high=1.0)

    def read(self, world: World, robots: Robots) -> Readings:
        """Reads the floor's brightness; see `VirtualSensor.read`."""
        return read_in_c(self.kernel(world, robots), world, robots, len(EPUCK.ground_m))

    def kernel(self, world: World, robots: Robots) -> ReadFunction:
        """See `vsense/world/sensors/base.py`."""
        points_m = EPUCK.ground_m
        return GroundPoints(world.floor, len(robots), points_m, GREY).kernel()


def from_xml(element: Element, scope: Scope) -> GroundSensor:
    """Makes the sensor; it has only quality settings."""
    return GroundSensor()


def from_argos(element: Element, scope: Scope) -> GroundSensor:
    """Makes the sensor that one of ARGoS's elements asks for."""
    return GroundSensor()
