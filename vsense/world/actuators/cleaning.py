"""Pollution cleaning: a robot in a source's cone takes away some of what pollutes.

    <virtual_cleaning_actuator implementation="default" pollutant_entity="polluter_22_1"
        rate="0.5" />

One level: how hard the robot cleans, from 0 (not at all) to 1 (`rate` per second). It takes effect
while the robot stands inside the cone of the source, and cleans what is left of the `vs:amount` of
that source's <virtual_pollutant_sensor>: the polluted area shrinks in proportion, the cone's reach
therefore with the root of what is left, until nothing is. The controller's name for it is
"cleaning". The run's result `pollution_left` is the share that is left, from 1 to 0.

Source: the extension that the thesis asks for in its chapter 5.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vsense.base.arena import Floats
from vsense.base.xml.element import Element
from vsense.world.actuators.base import RowNumbers
from vsense.world.pollution import PollutantSource
from vsense.world.sensors.base import Scope
from vsense.world.sensors.quality import Scale
from vsense.world.world import World

ELEMENTS = ("virtual_cleaning_actuator",)

_MAX_RATE_PER_S = 1e6
_SHARE = Scale(low=0.0, high=1.0)


@dataclass(frozen=True, slots=True)
class CleaningActuator:
    """Cleans a source of finite amount; `rate_per_s` is what one robot cleans at level 1."""

    source: PollutantSource
    rate_per_s: float
    name: str = "cleaning"
    layout: str = "f4"
    scale: Scale = _SHARE

    def apply(self, world: World, rows: RowNumbers, values: Floats, increments: Floats) -> None:
        """Cleans where the robots stand; see `VirtualActuator.apply`."""
        cone = world.cone(self.source)
        if cone is not None:
            robots = world.robots[rows]
            inside = cone.contains(np.stack((robots["x_m"], robots["y_m"]), axis=-1))
            effort = float(values[inside, 0].sum())
            world.stock.clean(self.source, effort * self.rate_per_s * world.timestep_s)
        world.results["pollution_left"] = world.stock.share(self.source)


def from_xml(element: Element, scope: Scope) -> CleaningActuator:
    """Makes the actuator from its element; ConfigError where there is nothing to clean."""
    key = "pollutant_entity"
    tag = scope.tag(element, key, "epuck_22_1")
    sources = [source for source in scope.sources if source.tag == tag]
    finite = [source for source in sources if np.isfinite(source.amount)]
    if not finite:
        needed = "needs a <virtual_pollutant_sensor> with this entity and a 'vs:amount'"
        raise element.error(f"{needed}: what there is to clean", key)
    return CleaningActuator(finite[0], element.number("rate", 0.0, _MAX_RATE_PER_S, "1/s", 1.0))
