"""The light sensor: a ring around the robot that senses the experiment's virtual lights.

    <virtual_light_sensor implementation="default" formula="epuck" vs:ring="epuck"
        vs:range="3" vs:field_of_view="360" vs:angles="true" vs:occlusions="true" />

Sensor "light", with k sensors 2 k numbers: the k readings, then the angle [rad] of each; or the
readings alone with vs:angles="false". So a controller that reads the robot's own "light" finds the
readings at the same places. `vs:ring` says which sensors there are (see geometry.py): "epuck"
(default, 8 in the real robot's order), "argos" (8), or a number of even ones.

    formula="thesis"   (default) sum of I^2/d^2 over the lights, d from each sensor to the light;
                       closer than 1 cm it grows no more. Source: thesis 4.2.2
    formula="generic"  the same, at most 1. Source: ARGoS's light sensor, iridia.md section 3
    formula="epuck"    with D = d/I from the robot's centre on the floor: exp(-2 D), 0 beyond 2.5,
                       times 1 - 2|a|/pi for a light |a| < pi/2 off the sensor's angle; summed, at
                       most 1. Source: epuck_light, iridia.md section 3

Robots, boxes and cylinders stand in the way: with "thesis" and "generic" of each sensor's own line
to the light, also the robot's own body; with "epuck" of the line from its centre, other bodies.
`vs:range` [m] and `vs:field_of_view` [deg] are limits of distance and of the angle off each
sensor's axis; there are none by default. The unit of the quality settings is 1.

ARGoS's `<epuck_light>` ("epuck", as is the foot-bot's) and `<light>` ("generic") give their 8
readings in the real robot's order and unit, times 4096. As in ARGoS the sum of several lights is
limited only after the noise. Source: argos3-epuck 66cb8d9, epuck_light_default_sensor.cpp lines
160-190; argos3 421bd76, light_default_sensor.cpp.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from vsense.base.arena import Floats
from vsense.base.native import kernel_ffi, kernels, pointer
from vsense.base.xml.element import Element
from vsense.world.robot_models import EPUCK, InfraredModel
from vsense.world.sensors.base import ReadFunction, Readings, Robots, Scope
from vsense.world.sensors.geometry import (
    NEAREST_M,
    Ring,
    check_readings,
    field_of_view,
    read_in_c,
)
from vsense.world.sensors.quality import Scale
from vsense.world.world import World

ELEMENTS = ("virtual_light_sensor",)
ARGOS_ELEMENTS = ("epuck_light", "footbot_light", "light")
ARGOS_NOISE = ("noise_level",)

FORMULAS = ("thesis", "generic", "epuck")

FULL = 4096.0
"""What the robot's own ring reads in the brightest light; ARGoS calls it 1. Source: controller.h"""

_MAX_RANGE_M = 1000.0
_MAX_NOISE = 1e6


_KERNELS = {
    "thesis": kernels.VS_LIGHT_AT_SENSORS,
    "generic": kernels.VS_LIGHT_AT_SENSORS,
    "epuck": kernels.VS_LIGHT_AT_CENTRE,
}


@dataclass(frozen=True)
class LightSensor:
    """Senses the lights of the world; `formula` is one of FORMULAS. See the module.

    Lights farther away than `range_m`, or farther off a sensor's axis than half of
    `field_of_view_rad`, are not sensed. Readings are multiplied by `gain`; `limited` ones end
    at 1; `seat` says where the ring is. The formulas are C (`c_src/host/vs_light.c`).
    """

    formula: str
    ring: Ring
    layout: str
    scale: Scale
    range_m: float = _MAX_RANGE_M
    field_of_view_rad: float = 2.0 * np.pi
    angles: bool = True
    occlusions: bool = True
    name: str = "light"
    gain: float = 1.0
    limited: bool = True
    seat: InfraredModel = EPUCK.infrared

    def read(self, world: World, robots: Robots) -> Readings:
        """Reads the ring; see `VirtualSensor.read`."""
        count = len(self.ring)
        readings = read_in_c(self._kernel, world, robots, 2 * count if self.angles else count)
        readings[:, count:] = self.ring.angles_rad if self.angles else 0.0
        return readings

    def kernel(self, world: World, robots: Robots) -> ReadFunction | None:
        """See `vsense/world/sensors/base.py`."""
        return None if self.angles else self._kernel

    @property
    def _kernel(self) -> ReadFunction:
        return ReadFunction(kernels, "vs_light_read", self.cdata, self.occlusions)

    @cached_property
    def cdata(self) -> Any:
        """The `struct vs_light_ring *`."""
        members = {
            "formula": _KERNELS[self.formula],
            "sensors": len(self.ring),
            "angles_rad": pointer("double", self._looking_rad),
            "radius_m": self.seat.radius_m,
            "height_m": self.seat.height_m,
            "nearest_m": NEAREST_M,
            "range_m": self.range_m,
            "view_rad": self.field_of_view_rad,
            "most": 1.0 if self.formula != "thesis" and self.limited else np.inf,
            "gain": self.gain,
            "occlusions": self.occlusions,
            "step": 2 * len(self.ring) if self.angles else len(self.ring),
        }
        return kernel_ffi.new("struct vs_light_ring *", members)

    @cached_property
    def _looking_rad(self) -> Floats:
        angles = self.ring.angles_rad if self.formula == "epuck" else self.ring.places_rad
        return np.ascontiguousarray(angles)


def from_xml(element: Element, scope: Scope) -> LightSensor:
    """Makes the sensor from its element."""
    formula = element.choice("formula", FORMULAS, "thesis")
    ring = Ring.from_xml(element)
    angles = element.boolean("vs:angles", True)
    readings, angles_sent = len(ring), len(ring) if angles else 0
    high = np.inf if formula == "thesis" else 1.0
    return LightSensor(
        formula=formula,
        ring=ring,
        layout=f"{readings + angles_sent}*f4",
        # The angles are facts about the robot, no measurements.
        scale=Scale(
            unit=(1.0,) * readings + (0.0,) * angles_sent,
            low=(0.0,) * readings + (-np.pi,) * angles_sent,
            high=(high,) * readings + (np.pi,) * angles_sent,
        ),
        range_m=element.number("vs:range", 0.001, _MAX_RANGE_M, "m", _MAX_RANGE_M),
        field_of_view_rad=field_of_view(element),
        angles=angles,
        occlusions=element.boolean("vs:occlusions", True),
        seat=scope.robots.model.infrared,
    )


def from_argos(element: Element, scope: Scope) -> LightSensor:
    """Makes the sensor that one of ARGoS's elements asks for."""
    seat = scope.robots.model.infrared
    check_readings(element, scope.robots.model, seat)
    ring = Ring.of(seat)
    return LightSensor(
        formula="generic" if element.name == "light" else "epuck",
        ring=ring,
        layout=f"{len(ring)}*f4",
        scale=Scale(unit=FULL, low=0.0, high=FULL),
        angles=False,
        gain=FULL,
        # Without noise nothing else limits it.
        limited=element.number("noise_level", 0.0, _MAX_NOISE, default=0.0) == 0.0,
        seat=seat,
    )
