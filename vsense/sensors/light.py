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

import numpy as np

from vsense.arena import wrap_angle
from vsense.sensors.base import Readings, Robots, Scope
from vsense.sensors.geometry import NEAREST_M, Ring, field_of_view, rows_of, within
from vsense.sensors.quality import Floats, Scale
from vsense.world.rays import NOBODY
from vsense.world.world import World
from vsense.xml.element import Element

ELEMENTS = ("virtual_light_sensor",)
ARGOS_ELEMENTS = ("epuck_light", "footbot_light", "light")
ARGOS_NOISE = ("noise_level",)

FORMULAS = ("thesis", "generic", "epuck")

FULL = 4096.0
"""What the robot's own ring reads in the brightest light; ARGoS calls it 1. Source: controller.h"""

_MAX_RANGE_M = 1000.0
_MAX_NOISE = 1e6
_EPUCK_REACH = 2.5
"""In distances over intensities."""


@dataclass(frozen=True, slots=True)
class LightSensor:
    """Senses the lights of the world; `formula` is one of FORMULAS. See the module.

    Lights farther away than `range_m`, or farther off a sensor's axis than half of
    `field_of_view_rad`, are not sensed. Readings are multiplied by `gain`; `limited` ones end
    at 1.
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

    def read(self, world: World, robots: Robots) -> Readings:
        """Reads the ring; see `VirtualSensor.read`."""
        count = len(self.ring)
        readings = np.zeros((len(robots), 2 * count if self.angles else count))
        if self.angles:
            readings[:, count:] = self.ring.angles_rad
        lights = [light for light in world.lights() if light.intensity > 0.0]
        if lights and len(robots):
            places = np.array([light.position_m for light in lights])
            intensities = np.array([light.intensity for light in lights])
            sense = self._from_centre if self.formula == "epuck" else self._from_sensors
            readings[:, :count] = sense(world, robots, places, intensities)
        if self.formula != "thesis" and self.limited:
            np.minimum(readings[:, :count], 1.0, out=readings[:, :count])
        readings[:, :count] *= self.gain
        return readings

    def _from_sensors(
        self, world: World, robots: Robots, lights_m: Floats, intensities: Floats
    ) -> Floats:
        """Sums (I/d)^2, each sensor with its own lines to the lights (l, 3): (n, k)."""
        points = self.ring.points(robots)
        seen = None
        if self.occlusions:
            seen = world.bodies().seen(points.reshape(-1, 3), lights_m, NOBODY)
        total = np.zeros(points.shape[:2])
        # Light by light: sums over the short axis of lights would take most of the time.
        for number, (light_m, intensity) in enumerate(zip(lights_m, intensities)):
            east, north, up = (light_m[axis] - points[..., axis] for axis in range(3))
            squared = east * east + north * north + up * up
            part = intensity**2 / np.maximum(squared, NEAREST_M**2)
            if seen is not None:
                part *= seen[:, number].reshape(part.shape)
            part[squared > self.range_m**2] = 0.0
            if self.field_of_view_rad < 2.0 * np.pi:
                off_axis = wrap_angle(np.arctan2(north, east) - self.ring.headings(robots))
                part[~within(off_axis, self.field_of_view_rad)] = 0.0
            total += part
        return total

    def _from_centre(
        self, world: World, robots: Robots, lights_m: Floats, intensities: Floats
    ) -> Floats:
        """What `epuck_light` makes of the lights (l, 3): (n, k)."""
        centres = np.zeros((len(robots), 3))
        centres[:, 0], centres[:, 1] = robots["x_m"], robots["y_m"]
        offsets = lights_m - centres[:, None, :]
        distances = np.sqrt(np.einsum("nli,nli->nl", offsets, offsets))
        near = distances <= _EPUCK_REACH * intensities
        nowhere = np.full_like(distances, np.inf)
        received = np.exp(-2.0 * np.divide(distances, intensities, out=nowhere, where=near))
        received[distances > self.range_m] = 0.0
        if self.occlusions:
            received *= world.bodies().seen(centres, lights_m, rows_of(world, robots))
        bearings = np.arctan2(offsets[..., 1], offsets[..., 0]) - robots["yaw_rad"][:, None]
        turn = np.abs(wrap_angle(bearings)[:, None, :] - self.ring.angles_rad[:, None])
        off_axis = np.minimum(turn, 2.0 * np.pi - turn)
        share: Floats = np.maximum(1.0 - 2.0 / np.pi * off_axis, 0.0)
        share[~within(off_axis, self.field_of_view_rad)] = 0.0
        summed: Floats = np.einsum("nl,nkl->nk", received, share)
        return summed


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
    )


def from_argos(element: Element, scope: Scope) -> LightSensor:
    """Makes the sensor that one of ARGoS's elements asks for."""
    ring = Ring.of_argos()
    return LightSensor(
        formula="generic" if element.name == "light" else "epuck",
        ring=ring,
        layout=f"{len(ring)}*f4",
        scale=Scale(unit=FULL, low=0.0, high=FULL),
        angles=False,
        gain=FULL,
        # Without noise nothing else limits it.
        limited=element.number("noise_level", 0.0, _MAX_NOISE, default=0.0) == 0.0,
    )
