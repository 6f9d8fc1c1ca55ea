"""Range and bearing: where other robots are, and what they say.

    <virtual_range_and_bearing_sensor implementation="default" range="0.8" data_size="4"
        loss_probability="0.1" check_occlusions="true" vs:max_messages="5" />

Sensor "range_and_bearing": the number of messages, then for each of vs:max_messages (5) places:
range [cm] between the two bodies, bearing [rad] counter-clockwise from straight ahead, and
`data_size` (4) bytes as numbers 0..255; places without a message are all 0.

A robot is heard nearer than `range` (0.8 m between the centres), unless a body is in the way, and
within `vs:field_of_view` [deg]. As in ARGoS all robots are heard all the time, also those that say
nothing (their bytes are 0) and virtual ones; with vs:hear="speaking" only those that say something.
When more are heard than there are places, chance decides which; each of these is lost with
`loss_probability`. A unit of the quality settings is 1 m in the range and 1 rad in the bearing.

Source: epuck_range_and_bearing of ARGoS, iridia.md section 3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vsense.sensors.base import Readings, Robots, Scope
from vsense.sensors.neighbours import Pairs, Reach, without_empty
from vsense.sensors.quality import Floats, Scale
from vsense.world.entities import BODY_RADIUS_M
from vsense.world.world import MESSAGE_MAX, World
from vsense.xml.element import Element

ELEMENTS = ("virtual_range_and_bearing_sensor",)

_RANGE_M = 0.8
_HEIGHT_M = float(np.float32(0.052))
"""Of the line of sight. Source: argos3-epuck, RAB_ELEVATION, which is a single there: it just
clears a box of 0.052 m."""
_MAX_MESSAGES = 32


@dataclass(frozen=True, slots=True)
class RangeAndBearingSensor:
    """Receives the messages of the robots around; see the module."""

    reach: Reach
    layout: str
    scale: Scale
    data_size: int
    max_messages: int
    loss_probability: float
    speaking_only: bool
    name: str = "range_and_bearing"

    def read(self, world: World, robots: Robots) -> Readings:
        """Reads the messages; see `VirtualSensor.read`."""
        speaking = world.messages["length"] > 0
        heard = speaking if self.speaking_only else np.ones_like(speaking)
        pairs = self.reach.pairs(world, robots, heard)
        pairs = self._arrived(pairs, len(robots), world.random)
        data = world.messages["data"][pairs.sender, : self.data_size].astype(np.float64)
        silent = np.arange(self.data_size) >= world.messages["length"][pairs.sender][:, None]
        data[silent] = 0.0
        range_cm = 100.0 * np.maximum(pairs.distance_m - 2.0 * BODY_RADIUS_M, 0.0)
        columns = np.column_stack((range_cm, pairs.bearing_rad, data))
        return pairs.reading(len(robots), self.max_messages, columns)

    def tidy(self, values: Floats) -> Floats:
        """Leaves no noise in the places without a message."""
        return without_empty(values, self.max_messages)

    def _arrived(self, pairs: Pairs, receivers: int, random: np.random.Generator) -> Pairs:
        """Drops the messages that have no place, then those that are lost."""
        if pairs.counts(receivers).max(initial=0) > self.max_messages:
            pairs = pairs.first(self.max_messages, random.random(len(pairs)))
        if self.loss_probability > 0.0:
            pairs = pairs.kept(random.random(len(pairs)) >= self.loss_probability)
        return pairs


def from_xml(element: Element, scope: Scope) -> RangeAndBearingSensor:
    """Makes the sensor from its element."""
    size = element.integer("data_size", 1, MESSAGE_MAX, 4)
    places = element.integer("vs:max_messages", 1, _MAX_MESSAGES, 5)
    return RangeAndBearingSensor(
        reach=Reach.from_xml(element, "range", _RANGE_M, _HEIGHT_M),
        layout=f"{1 + places * (2 + size)}*f4",
        scale=Scale(
            unit=(0.0, *((100.0, 1.0) + (0.0,) * size) * places),
            low=(0.0, *((0.0, -np.pi) + (0.0,) * size) * places),
            wraps=(False, *((False, True) + (False,) * size) * places),
        ),
        data_size=size,
        max_messages=places,
        loss_probability=element.number("loss_probability", 0.0, 1.0, default=0.0),
        speaking_only=element.choice("vs:hear", ("all", "speaking"), "all") == "speaking",
    )
