"""Pheromone release: a robot leaves something behind in a field, where it stands.

    <virtual_pheromone_actuator implementation="default" field="trail" name="pheromone_release"
        max_rate="10" />

Two numbers, of which a controller uses what fits it:

    0  a level: how much it releases per second, at most `max_rate`
    1  a counter: how much it has dropped since the run began, all drops added up

The amounts are the field's: 1 in one square metre is a concentration of 1. Several kinds of
pheromone are several fields with an actuator each, under different names. Settings of quality
concern the level, in units per second.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from vsense.base.arena import Floats
from vsense.base.native import check, kernel_ffi, kernels, pointer
from vsense.base.xml.element import Element
from vsense.world.actuators.base import ApplyFunction, RowNumbers
from vsense.world.fields import MAX_CONCENTRATION
from vsense.world.sensors.base import Robots, Scope
from vsense.world.sensors.geometry import SensedScene
from vsense.world.sensors.quality import Scale
from vsense.world.world import World

ELEMENTS = ("virtual_pheromone_actuator",)

MAX_RATE_PER_S = 1e6
MAX_DROPPED = 1e7
"""Counters end here: a single holds every whole number up to it."""


@dataclass(frozen=True, slots=True)
class PheromoneActuator:
    """Adds to the field of the id `field`."""

    field: str
    name: str = "pheromone_release"
    max_rate_per_s: float = MAX_RATE_PER_S
    layout: str = "2*f4"

    @property
    def scale(self) -> Scale:
        """The counter is no measurement: no noise changes it."""
        return Scale(unit=(1.0, 0.0), low=0.0, high=(self.max_rate_per_s, MAX_DROPPED))

    def apply(self, world: World, rows: RowNumbers, values: Floats, increments: Floats) -> None:
        """Releases where the robots stand; see `VirtualActuator.apply`."""
        scene = SensedScene(world, world.robots[rows])
        given = (pointer("double", np.ascontiguousarray(array)) for array in (values, increments))
        code = kernels.vs_field_release(self._release(world), scene.cdata, *given)
        check(code, f"what is left in field {self.field!r}")

    def kernel(self, world: World, robots: Robots) -> ApplyFunction:
        """See `vsense/world/actuators/base.py`."""
        return ApplyFunction(kernels, "vs_field_release", self._release(world))

    def _release(self, world: World) -> Any:
        field = world.fields[self.field].as_c()
        return kernel_ffi.new("struct vs_release *", (field, world.timestep_s, MAX_CONCENTRATION))


def from_xml(element: Element, scope: Scope) -> PheromoneActuator:
    """Makes the actuator from its element."""
    return PheromoneActuator(
        field=scope.field(element),
        name=element.text("name", "pheromone_release"),
        max_rate_per_s=element.number("max_rate", 1e-6, MAX_RATE_PER_S, "1/s", MAX_RATE_PER_S),
    )
