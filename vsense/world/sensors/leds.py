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
from typing import Any

from vsense.base.arena import Floats
from vsense.base.native import kernel_ffi, kernels, pointer
from vsense.base.xml.element import Element
from vsense.world.sensors.base import ReadFunction, Readings, Robots, Scope
from vsense.world.sensors.geometry import Reach, blob_scale, read_in_c, without_empty
from vsense.world.sensors.quality import Scale
from vsense.world.world import World

ELEMENTS = ("virtual_led_sensor",)

_RANGE_M = 1.0
_HEIGHT_M = 0.04
"""Of the LEDs' ring. Source: argos3-epuck, LED_RING_ELEVATION."""
_MAX_BLOBS: int = kernels.VS_LEDS_MOST


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
        return read_in_c(self.kernel(world, robots), world, robots, 1 + 5 * self.max_blobs)

    def kernel(self, world: World, robots: Robots) -> ReadFunction:
        """See `vsense/world/sensors/base.py`."""
        occlusions = self.reach.height_m is not None
        return ReadFunction(kernels, "vs_leds_read", self._as_c(world), occlusions)

    def _as_c(self, world: World) -> Any:
        """Makes the `struct vs_leds *`; it holds until an entity changes."""
        struct: Any = kernel_ffi.new("struct vs_leds *")
        struct.colors = pointer("uint8_t", world.leds)
        struct.world = world.sightings.cdata
        struct.range_m, struct.view_rad = self.reach.range_m, self.reach.field_of_view_rad
        struct.occlusions = self.reach.height_m is not None
        struct.height_m, struct.most = self.reach.height_m or 0.0, self.max_blobs
        return struct

    def tidy(self, values: Floats) -> Floats:
        """Leaves no noise in the places without a robot."""
        return without_empty(values, self.max_blobs)


def from_xml(element: Element, scope: Scope) -> LedSensor:
    """Makes the sensor from its element."""
    blobs = element.integer("vs:max_blobs", 1, _MAX_BLOBS, 6)
    return LedSensor(
        reach=Reach.from_xml(element, "vs:range", _RANGE_M, _HEIGHT_M),
        layout=f"{1 + 5 * blobs}*f4",
        scale=blob_scale(blobs),
        max_blobs=blobs,
    )
