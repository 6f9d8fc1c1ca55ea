"""GPS with heading: where the robot is in the arena.

    <gps_virtual_sensor implementation="default" noise_std_dev="0.01" />

Sensor "gps", three numbers: x, y [m] and heading [rad], counter-clockwise from +x, in (-pi, pi]. A
unit of the quality settings is 1 m in x and y and 1 rad in the heading. ARGoS's `<positioning>` is
the same sensor.

Source: iridia.md section 1b.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from vsense.base.xml.element import Element
from vsense.world.sensors.base import Readings, Robots, Scope
from vsense.world.sensors.quality import Scale
from vsense.world.world import World

ELEMENTS = ("gps_virtual_sensor",)
ARGOS_ELEMENTS = ("positioning",)
ARGOS_NOISE = ()


@dataclass(frozen=True, slots=True)
class GpsSensor:
    """The robots' own poses, as the cameras see them; see the module."""

    name: str = "gps"
    layout: str = "3*f4"
    scale: ClassVar[Scale] = Scale(wraps=(False, False, True))

    def read(self, world: World, robots: Robots) -> Readings:
        """Reads place and heading; see `VirtualSensor.read`."""
        return np.stack((robots["x_m"], robots["y_m"], robots["yaw_rad"]), axis=-1)


def from_xml(element: Element, scope: Scope) -> GpsSensor:
    """Makes the sensor; it has only quality settings."""
    return GpsSensor()


def from_argos(element: Element, scope: Scope) -> GpsSensor:
    """Makes the sensor that one of ARGoS's elements asks for."""
    return GpsSensor()
