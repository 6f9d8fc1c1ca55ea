"""The radiation sensor: 1/d^2 from a radioactive thing.

    <virtual_radiation_sensor implementation="default"
        radiation_entity="barrel_9_0" vs:strength="1" vs:range="2" vs:memory="5" />

Sensor "radiation", one number: strength/d^2 with the distance d [m] along the floor to the thing,
which is tagged or virtual and may move. Closer than 1 cm it grows no more; beyond `vs:range` [m]
and while the thing is not there it is 0. Nothing stands in its way. A tagged thing that no camera
sees radiates on from where it was for `vs:memory` seconds. The unit of the quality settings is 1.

Source: iridia.md section 3; the original named its source in its code, and had no bound.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from vsense.base.xml.element import Element
from vsense.world.sensors import _places
from vsense.world.sensors.base import Readings, Robots, Scope
from vsense.world.sensors.geometry import NEAREST_M, seen_from
from vsense.world.sensors.quality import Scale
from vsense.world.world import World

ELEMENTS = ("virtual_radiation_sensor",)

_MAX_STRENGTH = 1e6
_MAX_RANGE_M = 1000.0


@dataclass(frozen=True, slots=True)
class RadiationSensor:
    """Measures how strongly a thing radiates: `strength` is the reading at 1 m; see the module."""

    source: _places.AnyPlace
    strength: float = 1.0
    range_m: float = _MAX_RANGE_M
    name: str = "radiation"
    layout: str = "f4"
    scale: ClassVar[Scale] = Scale(low=0.0)

    def read(self, world: World, robots: Robots) -> Readings:
        """Reads the radiation where the robots are; see `VirtualSensor.read`."""
        pose = self.source.pose(world)
        if pose is None:
            return np.zeros((len(robots), 1))
        distance, _ = seen_from(robots, [pose[0]], [pose[1]])
        strengths = self.strength / np.maximum(distance, NEAREST_M) ** 2
        return np.where(distance <= self.range_m, strengths, 0.0)


def from_xml(element: Element, scope: Scope) -> RadiationSensor:
    """Makes the sensor from its element."""
    return RadiationSensor(
        _places.from_xml(element, scope, "radiation_entity"),
        element.number("vs:strength", 0.0, _MAX_STRENGTH, default=1.0),
        element.number("vs:range", 0.001, _MAX_RANGE_M, "m", _MAX_RANGE_M),
    )
