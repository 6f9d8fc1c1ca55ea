"""Virtual LEDs of others: the coloured lights that robots show by their virtual LED actuator.

    <virtual_led_sensor vs:range="1.0" vs:field_of_view="360" check_occlusions="true"
        vs:max_blobs="6" />

Sensor "leds", as an omnidirectional camera of ARGoS: the number of lit robots in sight, then for
each of vs:max_blobs (6) places, the nearest first: distance [cm] between the centres, bearing [rad]
counter-clockwise from straight ahead, red, green, blue 0..255; places without a robot are all 0.

A robot is seen nearer than `vs:range` (1 m), within `vs:field_of_view` [deg] around straight ahead,
unless a body is in the way, if its LEDs are not off. A unit of the quality settings is 1 m, 1 rad,
and the whole range of a colour.

Source: coloured_blob_omnidirectional_camera of ARGoS (its distances are in cm, too).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vsense.sensors.base import Readings, Robots, Scope
from vsense.sensors.neighbours import Reach, without_empty
from vsense.sensors.quality import Floats, Scale
from vsense.world.world import World
from vsense.xml.element import Element

ELEMENTS = ("virtual_led_sensor",)

_RANGE_M = 1.0
_HEIGHT_M = 0.04
"""Of the LEDs' ring. Source: argos3-epuck, LED_RING_ELEVATION."""
_MAX_BLOBS = 32


@dataclass(frozen=True, slots=True)
class LedSensor:
    """Sees coloured robots, the nearest `max_blobs`; see the module."""

    reach: Reach
    layout: str
    scale: Scale
    max_blobs: int
    name: str = "leds"

    def read(self, world: World, robots: Robots) -> Readings:
        """Reads the blobs; see `VirtualSensor.read`."""
        pairs = self.reach.pairs(world, robots, np.any(world.leds, axis=1))
        pairs = pairs.first(self.max_blobs, pairs.distance_m)
        colors = world.leds[pairs.sender].astype(np.float64)
        columns = np.column_stack((100.0 * pairs.distance_m, pairs.bearing_rad, colors))
        return pairs.reading(len(robots), self.max_blobs, columns)

    def tidy(self, values: Floats) -> Floats:
        """Leaves no noise in the places without a robot."""
        return without_empty(values, self.max_blobs)


def from_xml(element: Element, scope: Scope) -> LedSensor:
    """Makes the sensor from its element."""
    blobs = element.integer("vs:max_blobs", 1, _MAX_BLOBS, 6)
    return LedSensor(
        reach=Reach.from_xml(element, "vs:range", _RANGE_M, _HEIGHT_M),
        layout=f"{1 + 5 * blobs}*f4",
        scale=Scale(
            unit=(0.0, *(100.0, 1.0, 255.0, 255.0, 255.0) * blobs),
            low=(0.0, *(0.0, -np.pi, 0.0, 0.0, 0.0) * blobs),
            high=(np.inf, *(np.inf, np.pi, 255.0, 255.0, 255.0) * blobs),
            wraps=(False, *(False, True, False, False, False) * blobs),
        ),
        max_blobs=blobs,
    )
