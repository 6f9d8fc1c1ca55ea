"""The ground sensor: how bright the floor is under points of the robot, of an e-puck in its front.

    <virtual_ground_sensor implementation="default" noise_level="0.05" />

Sensor "ground", numbers in [0, 1], of an e-puck left, centre, right: 0 is black, 1 is white. The
floor is the experiment's `<floor>` with its coloured zones; no real one has to be painted. The unit
of the quality settings is 1: the whole range from black to white.

ARGoS's `<epuck_ground>`, `<ground>`, `<pipuck_ground>` and the foot-bot's two are the same sensor,
where the robot has its own. A foot-bot's base has eight more, "base_ground", of which ARGoS's
controllers are told whether they are bright.

Source: epuck_ground of ARGoS, iridia.md section 3; thesis 4.2.1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from vsense.base.arena import Point
from vsense.base.xml.element import Element
from vsense.world.sensors.base import ReadFunction, Readings, Robots, Scope
from vsense.world.sensors.geometry import ground_reader, read_in_c
from vsense.world.sensors.quality import Scale
from vsense.world.world import World

ELEMENTS = ("virtual_ground_sensor",)
ARGOS_ELEMENTS = (
    "epuck_ground", "ground", "footbot_base_ground", "footbot_motor_ground", "pipuck_ground",
)  # fmt: skip
ARGOS_NOISE = ("noise_level",)

GREY = tuple(share / 255.0 for share in (0.299, 0.587, 0.114))
"""Brightness of red, green, blue. Source: as above."""


@dataclass(frozen=True, slots=True)
class GroundSensor:
    """Looks at the floor at `points_m`, ahead and to the left; see the module."""

    points_m: tuple[Point, ...]
    name: str = "ground"
    scale: ClassVar[Scale] = Scale(low=0.0, high=1.0)

    @property
    def layout(self) -> str:
        """A number for each point."""
        return f"{len(self.points_m)}*f4"

    def read(self, world: World, robots: Robots) -> Readings:
        """Reads the floor's brightness; see `VirtualSensor.read`."""
        return read_in_c(self.kernel(world, robots), world, robots, len(self.points_m))

    def kernel(self, world: World, robots: Robots) -> ReadFunction:
        """See `vsense/world/sensors/base.py`."""
        return ground_reader(world.floor, len(robots), self.points_m, GREY)


def from_xml(element: Element, scope: Scope) -> GroundSensor:
    """Makes the sensor; it has only quality settings."""
    return GroundSensor(scope.robots.model.ground_m)


def from_argos(element: Element, scope: Scope) -> GroundSensor:
    """Makes the sensor that one of ARGoS's elements asks for."""
    model = scope.robots.model
    if element.name == "footbot_base_ground" and model.base_ground_m:
        return GroundSensor(model.base_ground_m, "base_ground")
    if element.name == "ground":
        return GroundSensor((*model.ground_m, *model.base_ground_m))
    return GroundSensor(model.ground_m)
