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
times 4096, in the real robot's order, from ARGoS's places; the foot-bot's is the same here. Of the
generic `<proximity>` a thing at distance d gives exp(-d). The e-puck's sensors stand 1 mm before
its body, and ARGoS's lines meet only what they enter: a robot that touches another does not see it
with the sensor nearest to the touch. So do these, since it counts in a swarm: 20 robots that forage
in a ring of 2.5 m brought home 5 % less without. Source: argos3-epuck 66cb8d9,
epuck_proximity_default_sensor.cpp lines 143-150; argos3 421bd76, proximity_default_sensor.cpp line
140, epuck_entity.cpp lines 112-135, Chipmunk's cpShape.c lines 138-159.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.base.xml.element import Element
from vsense.world.entities import Box, Cylinder
from vsense.world.rays import NOBODY, Bodies, disc_rows, entity_rows
from vsense.world.sensors.base import Readings, Robots, Scope
from vsense.world.sensors.geometry import Ring, rows_of
from vsense.world.sensors.quality import Floats, Scale
from vsense.world.world import World

ELEMENTS = ("virtual_proximity_sensor",)
ARGOS_ELEMENTS = ("epuck_proximity", "footbot_proximity", "proximity")
ARGOS_NOISE = ("noise_level",)

MAX_RAW = 4095.0
"""The converter's largest value. Source: epuck.md section 6."""

RANGE_M = 0.05
"""How far the formula holds. Source: iridia.md section 3."""

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
    each sensor looks along one line. The largest reading is `full`; the `generic` curve is that of
    ARGoS for any robot. With `blind_within` a sensor does not see the body that it lies within.
    """

    ring: Ring
    name: str
    layout: str
    virtual_only: bool
    range_m: float = RANGE_M
    field_of_view_rad: float = 0.0
    full: float = MAX_RAW
    generic: bool = False
    blind_within: bool = False

    @property
    def scale(self) -> Scale:
        """The whole range is 1 to the quality settings."""
        return Scale(unit=self.full, low=0.0, high=self.full)

    def read(self, world: World, robots: Robots) -> Readings:
        """Reads the ring; see `VirtualSensor.read`."""
        distances_m = self._distances(world, robots)
        if self.generic:
            return self.full * np.exp(-distances_m)
        return self.full * response(distances_m * (RANGE_M / self.range_m))

    def _distances(self, world: World, robots: Robots) -> Floats:
        """Distances of the nearest thing from each sensor, (n, k) [m]; inf where there is none."""
        fan = np.zeros(1)
        if self.field_of_view_rad > 0.0:
            fan = self.field_of_view_rad / 2.0 * np.linspace(-1.0, 1.0, _RAYS)
        headings = self.ring.headings(robots)[:, :, None] + fan
        starts = np.repeat(self.ring.points(robots)[:, :, None, :], len(fan), axis=2)
        ends = starts.copy()
        ends[..., 0] += self.range_m * np.cos(headings)
        ends[..., 1] += self.range_m * np.sin(headings)
        bodies: Bodies = _virtual_bodies(world) if self.virtual_only else world.bodies()
        skip: Any = NOBODY
        if not self.virtual_only:
            skip = np.repeat(rows_of(world, robots), len(self.ring) * len(fan))
        shares = bodies.nearest(starts.reshape(-1, 3), ends.reshape(-1, 3), skip)
        if self.blind_within:
            shares[shares <= 0.0] = np.inf
        nearest: Floats = self.range_m * shares.reshape(headings.shape).min(axis=2)
        return nearest


def response(distance_m: Floats) -> Floats:
    """Reading of ARGoS's sensor at a distance, in [0, 1]; 0 beyond RANGE_M."""
    near = np.minimum(distance_m, RANGE_M)
    curve = 298.701 * near**2 - 36.8961 * near + 1.08212
    return np.where(distance_m <= RANGE_M, np.clip(curve, 0.0, 1.0), 0.0)


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
    )


def from_argos(element: Element, scope: Scope) -> ProximitySensor:
    """Makes the sensor that one of ARGoS's elements asks for."""
    ring, generic = Ring.of_argos(), element.name == "proximity"
    return ProximitySensor(
        # ARGoS's own e-puck, which has the generic one, has its sensors where it says.
        ring=Ring(ring.angles_rad, ring.angles_rad) if generic else ring,
        name="proximity",
        layout=f"{len(ring)}*f4",
        virtual_only=False,
        full=ARGOS_FULL,
        generic=generic,
        blind_within=True,
    )
