"""Proximity of what is not there: the infrared ring of the e-puck for virtual obstacles.

    <virtual_proximity_sensor implementation="default" vs:fuse="true" />

Eight whole numbers 0..4095 as the real ring gives them, higher is nearer, in the order of ps0..ps7.

With vs:fuse="true" the sensor is called "+proximity": the robot takes the larger one of each of
these numbers and of its real ring's whenever a controller reads "proximity". It senses virtual
boxes, cylinders and robots only; the real ring senses the real ones. So a virtual wall turns a real
robot. Without it the sensor is called "proximity" and takes the real ring's place: then it senses
physical ones, too. `vs:obstacles="virtual"` or "all" says otherwise.

Each sensor looks `vs:range` (0.05 m) far from its place on the ring, along seven lines spread over
`vs:field_of_view`, and the nearest thing counts: 60 degrees where fused as the real ring; otherwise
0 as in ARGoS, one line. `vs:ring` is as in geometry.py. The unit of the quality settings is the
whole range, 4095: so noise_level="0.05" is +-205.

A thing at distance d [m] gives 298.701 d^2 - 36.8961 d + 1.08212, clipped to [0, 1], times 4095.
Source: epuck_proximity of ARGoS, iridia.md section 3, which holds up to 0.05 m: a longer range
stretches the curve.

ARGoS's `<epuck_proximity>`, mounted where the robots have no ring of their own, gives the same,
times 4096, in the real robot's order, from ARGoS's places, and so does `<footbot_proximity>`. A
foot-bot has 24, whose curve is 0.0100527 / (d + 0.000163144), 1 below d = 0.009889556. A Khepera
IV's `<kheperaiv_proximity>` gives 4.14 exp(-33 d) - 0.085 up to d = 0.12, 1 below 0.04. Of the
generic `<proximity>`, which ARGoS's own e-puck has, a thing at distance d gives exp(-d), and its
sensors see 0.1 m far from the body's edge. A Pi-Puck's `<pipuck_rangefinders>`, sensor
"rangefinders", gives the distance [m] itself, and 0.1 where nothing is. The other e-puck's stand
1 mm before its body, and ARGoS's lines meet only what they enter: a robot that touches another does
not see it with the sensor nearest to the touch. So do these, since it counts in a swarm: 20 robots
that forage in a ring of 2.5 m brought home 5 % less without. Source: argos3-epuck 66cb8d9,
epuck_proximity_default_sensor.cpp lines 143-150; argos3 421bd76, proximity_default_sensor.cpp line
140, epuck_entity.cpp lines 23-35 and 112-135, Chipmunk's cpShape.c lines 138-159.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from vsense.base.native import kernel_ffi, kernels, pointer
from vsense.base.xml.element import Element
from vsense.world._model_file import CURVES
from vsense.world.entities import Box, Cylinder
from vsense.world.rays import Bodies, disc_rows, entity_rows
from vsense.world.robot_models import EPUCK, InfraredModel
from vsense.world.sensors.base import ReadFunction, Readings, Robots, Scope
from vsense.world.sensors.geometry import Ring, check_readings, read_in_c
from vsense.world.sensors.quality import Scale
from vsense.world.world import World

ELEMENTS = ("virtual_proximity_sensor",)
_RANGEFINDERS, _DISTANCE = "pipuck_rangefinders", CURVES[3]
ARGOS_ELEMENTS = (
    "epuck_proximity", "footbot_proximity", "kheperaiv_proximity", "proximity", _RANGEFINDERS,
)  # fmt: skip
ARGOS_NOISE = ("noise_level",)

MAX_RAW = 4095.0
"""The converter's largest value. Source: epuck.md section 6."""

RANGE_M = EPUCK.infrared.range_m
"""How far the formula holds."""

ARGOS_FULL = 4096.0
"""What ARGoS calls 1, in the unit of the robot's own ring. Source: controller.h"""

_RAYS = 7
_CONE_DEG = 60.0
"""Of a fused ring: so wide is the real one's, and no robot hides between two sensors, which are up
to 61 degrees apart."""
_MAX_RANGE_M = 2.0


@dataclass(frozen=True, slots=True)
class ProximitySensor:
    """Senses what is near; see the module.

    With `virtual_only` physical things are left to the real ring. With a `field_of_view_rad` of 0
    each sensor looks along one line. The largest reading is `full`; `curve` is one of CURVES, and
    `seat` says where the ring is. With `blind_within` a sensor does not see the body that it lies
    within.
    """

    ring: Ring
    name: str
    layout: str
    virtual_only: bool
    range_m: float = RANGE_M
    field_of_view_rad: float = 0.0
    full: float = MAX_RAW
    curve: str = CURVES[0]
    blind_within: bool = False
    seat: InfraredModel = EPUCK.infrared

    @property
    def count(self) -> int:
        """Of sensors."""
        return len(self.seat.lines_m) or len(self.ring)

    @property
    def scale(self) -> Scale:
        """The whole range is 1 to the quality settings."""
        return Scale(unit=self.full, low=0.0, high=self.full)

    def read(self, world: World, robots: Robots) -> Readings:
        """Reads the ring; see `VirtualSensor.read`."""
        return read_in_c(self.kernel(world, robots), world, robots, self.count)

    def kernel(self, world: World, robots: Robots) -> ReadFunction:
        """See `vsense/world/sensors/base.py`."""
        bodies = _virtual_bodies(world) if self.virtual_only else None
        fan = np.zeros(1)
        if self.field_of_view_rad > 0.0:
            fan = self.field_of_view_rad / 2.0 * np.linspace(-1.0, 1.0, _RAYS)
        lines = np.array(self.seat.lines_m).ravel()
        arrays = np.ascontiguousarray(self.ring.places_rad), fan, lines
        places_rad, fan_rad, lines_m = (pointer("double", a) for a in arrays)
        members = {
            "sensors": self.count,
            "rays": len(fan),
            "places_rad": places_rad,
            "fan_rad": fan_rad,
            "lines_m": lines_m if len(lines) else kernel_ffi.NULL,
            "radius_m": self.seat.radius_m,
            "height_m": self.seat.height_m,
            "range_m": self.range_m,
            "share": RANGE_M / self.range_m,
            "full": self.full,
            "curve": CURVES.index(self.curve),
            "blind_within": self.blind_within,
            "bodies": kernel_ffi.NULL if bodies is None else bodies.cdata,
        }
        ring = kernel_ffi.new("struct vs_proximity_ring *", members)
        owner = bodies, places_rad, fan_rad, lines_m
        return ReadFunction(kernels, "vs_proximity_read", ring, not self.virtual_only, owner)


def _virtual_bodies(world: World) -> Bodies:
    """Bodies that the real ring cannot sense."""
    robots = world.robots[world.real_robots :]
    discs = disc_rows(robots["x_m"], robots["y_m"])
    return Bodies(np.concatenate((discs, _virtual_rows(world.boxes(), world.cylinders()))))


@lru_cache(maxsize=8)
def _virtual_rows(boxes: Sequence[Box], cylinders: Sequence[Cylinder]) -> NDArray[np.void]:
    things: list[Box | Cylinder] = [*cylinders, *boxes]
    return entity_rows([thing for thing in things if not thing.physical])


def from_xml(element: Element, scope: Scope) -> ProximitySensor:
    """Makes the sensor from its element."""
    fuse = element.boolean("vs:fuse", False)
    obstacles = element.choice("vs:obstacles", ("virtual", "all"), "virtual" if fuse else "all")
    ring = Ring.from_xml(element)
    return ProximitySensor(
        ring=ring,
        name="+proximity" if fuse else "proximity",
        layout=f"{len(ring)}*u2",
        virtual_only=obstacles == "virtual",
        range_m=element.number("vs:range", 0.001, _MAX_RANGE_M, "m", RANGE_M),
        field_of_view_rad=element.angle("vs:field_of_view", 0.0, 180.0, _CONE_DEG if fuse else 0.0),
        seat=replace(scope.robots.model.infrared, lines_m=()),
    )


def from_argos(element: Element, scope: Scope) -> ProximitySensor:
    """Makes the sensor that one of ARGoS's elements asks for."""
    model, far = scope.robots.model, element.name == _RANGEFINDERS
    seat = model.generic if element.name == "proximity" else model.infrared
    if seat.curve == _DISTANCE and not far:
        words = f"a robot of the model {model.name} has rangefinders: expected <{_RANGEFINDERS}>"
        raise element.error(f"{words}, or <proximity>")
    check_readings(element, model, seat)
    ring = Ring.of(seat)
    return ProximitySensor(
        ring=ring,
        name="rangefinders" if far else "proximity",
        layout=f"{len(seat.lines_m) or len(ring)}*f4",
        virtual_only=False,
        range_m=seat.range_m,
        full=1.0 if far else ARGOS_FULL,
        curve=seat.curve,
        blind_within=True,
        seat=seat,
    )
