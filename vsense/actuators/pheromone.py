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

import numpy as np

from vsense.actuators.base import Rows
from vsense.sensors.base import Scope
from vsense.sensors.quality import Floats, Scale
from vsense.world.world import World
from vsense.xml.element import Element

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

    def apply(self, world: World, rows: Rows, values: Floats, increments: Floats) -> None:
        """Releases where the robots stand; see `VirtualActuator.apply`."""
        amounts = values[:, 0] * world.timestep_s + increments[:, 1]
        robots = world.robots[rows]
        points_m = np.stack((robots["x_m"], robots["y_m"]), axis=-1)
        releasing = amounts > 0.0
        if releasing.any():
            world.fields[self.field].deposit(points_m[releasing], amounts[releasing])


def from_xml(element: Element, scope: Scope) -> PheromoneActuator:
    """Makes the actuator from its element."""
    return PheromoneActuator(
        field=scope.field(element),
        name=element.text("name", "pheromone_release"),
        max_rate_per_s=element.number("max_rate", 1e-6, MAX_RATE_PER_S, "1/s", MAX_RATE_PER_S),
    )
