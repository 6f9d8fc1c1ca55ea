"""The battery of a simulated robot: full, as ARGoS's e-pucks have it.

    <epuck_battery implementation="default" /> or <battery implementation="default" />

Sensor "battery", as the robot's own its voltage [mV]: 4200, which ARGoS calls 1. Nothing discharges
it. Lab and real robots measure their own. A unit of the quality settings is 1 V.

Source: argos3-epuck 66cb8d9, epuck_battery_equipped_entity.cpp; the voltage: epuck.md section 6.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from vsense.base.xml.element import Element
from vsense.world.sensors.base import Readings, Robots, Scope
from vsense.world.sensors.quality import Scale
from vsense.world.world import World

ELEMENTS = ()
ARGOS_ELEMENTS = ("battery", "epuck_battery")
ARGOS_NOISE = ()

FULL_MV = 4200.0


@dataclass(frozen=True, slots=True)
class BatterySensor:
    """A battery that stays full; see the module."""

    name: str = "battery"
    layout: str = "f4"
    scale: ClassVar[Scale] = Scale(unit=1000.0, low=0.0, high=FULL_MV)

    def read(self, world: World, robots: Robots) -> Readings:
        """Reads it; see `VirtualSensor.read`."""
        return np.full((len(robots), 1), FULL_MV)


def from_argos(element: Element, scope: Scope) -> BatterySensor:
    """Makes the sensor that one of ARGoS's elements asks for."""
    return BatterySensor()
