"""A field on the floor, such as a pheromone: how much there is, and where there is more.

    <virtual_field_sensor field="trail" name="pheromone" />

Sensor of the name given ("pheromone" by default), three numbers: the concentration [1/m^2] under
the robot's centre, and its gradient [1/m^3] along the robot's own axes: ahead, left. `field` is the
id of a `<vs:field>`. Several of these elements, each with a name of its own, sense several fields.
The unit of the quality settings is 1 (1/m^2 and 1/m^3).

Source: our own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from vsense.base.native import kernels
from vsense.base.xml.element import Element
from vsense.world.sensors.base import ReadFunction, Readings, Robots, Scope
from vsense.world.sensors.geometry import read_in_c
from vsense.world.sensors.quality import Scale
from vsense.world.world import World

ELEMENTS = ("virtual_field_sensor",)


@dataclass(frozen=True, slots=True)
class FieldSensor:
    """Reads the field of the id `field`; see the module."""

    field: str
    name: str = "pheromone"
    layout: str = "3*f4"
    scale: ClassVar[Scale] = Scale(low=(0.0, -np.inf, -np.inf))

    def read(self, world: World, robots: Robots) -> Readings:
        """Reads value and gradient; see `VirtualSensor.read`."""
        return read_in_c(self.kernel(world, robots), world, robots, 3)

    def kernel(self, world: World, robots: Robots) -> ReadFunction:
        """See `vsense/world/sensors/base.py`."""
        return ReadFunction(kernels, "vs_field_sense", world.fields[self.field].as_c())


def from_xml(element: Element, scope: Scope) -> FieldSensor:
    """Makes the sensor from its element."""
    return FieldSensor(scope.field(element), element.text("name", "pheromone"))
