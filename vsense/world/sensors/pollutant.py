"""The pollutant sensor of the thesis: 1 inside the polluted cone, else 0.

    <virtual_pollutant_sensor implementation="default"
        pollutant_entity="polluter_22_1" direction_angle="0" wide_angle="90" max_distance="1.0"
        rotation_timestep="50%" rotation_angle="180" vs:memory="5" vs:amount="20" />

A source with `vs:amount` can be cleaned by <virtual_cleaning_actuator>: its area shrinks with what
is left of the amount. Sensor "pollutant", one number. The unit of the quality settings is 1.

Source: thesis 4.2.3 and chapter 5.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from vsense.base.xml.element import Element
from vsense.world.pollution import PollutantSource
from vsense.world.sensors._places import read_memory_ns
from vsense.world.sensors.base import Readings, Robots, Scope
from vsense.world.sensors.quality import Scale
from vsense.world.world import World

ELEMENTS = ("virtual_pollutant_sensor",)

_MAX_DISTANCE_M = 100.0
_MIN_WIDE_DEG = 0.01
"""An opening of 0 or of half a turn is no triangle."""
_MAX_TIMESTEP = 10**9


@dataclass(frozen=True, slots=True)
class PollutantSensor:
    """Senses whether robots stand in the cone of a source."""

    source: PollutantSource
    name: str = "pollutant"
    layout: str = "f4"
    scale: ClassVar[Scale] = Scale(low=0.0, high=1.0)

    def read(self, world: World, robots: Robots) -> Readings:
        """Reads the pollution where the robots are; see `VirtualSensor.read`."""
        cone = world.cone(self.source)
        if cone is None:
            return np.zeros((len(robots), 1))
        points = np.stack((robots["x_m"], robots["y_m"]), axis=-1)
        return cone.contains(points).astype(np.float64)[:, None]


def from_xml(element: Element, scope: Scope) -> PollutantSensor:
    """Makes the sensor from its element; absent attributes have the thesis's defaults."""
    wide_rad = element.angle("wide_angle", _MIN_WIDE_DEG, 180.0 - _MIN_WIDE_DEG, 90.0)
    max_distance_m = element.number("max_distance", 0.001, _MAX_DISTANCE_M, "m", 1.0)
    turn_timestep = _turn_timestep(element, scope)
    if turn_timestep is None and element.has("rotation_angle"):
        raise element.error("needs a 'rotation_timestep' that says when", "rotation_angle")
    source = PollutantSource(
        tag=scope.tag(element, "pollutant_entity", "epuck_22_1"),
        direction_rad=element.angle("direction_angle", -360.0, 360.0, 0.0),
        wide_rad=wide_rad,
        max_distance_m=max_distance_m,
        turn_timestep=turn_timestep,
        turn_rad=element.angle("rotation_angle", -360.0, 360.0, 90.0),
        memory_ns=read_memory_ns(element),
        amount=element.number("vs:amount", 1e-6, 1e9) if element.has("vs:amount") else math.inf,
    )
    if source not in scope.sources:  # that of another controller
        scope.sources.append(source)
    return PollutantSensor(source)


def _turn_timestep(element: Element, scope: Scope) -> int | None:
    """Reads when the wind turns: a timestep of the run, or a share of its length ("50%")."""
    key = "rotation_timestep"
    if not element.has(key):
        return None
    text = element.text(key)
    if not text.endswith("%"):
        return element.integer(key, 0, _MAX_TIMESTEP)
    share = element.share(key)
    if scope.timesteps == 0:
        raise element.error(f"'{text}' of a run without limit is no timestep", key)
    return round(share * scope.timesteps)
