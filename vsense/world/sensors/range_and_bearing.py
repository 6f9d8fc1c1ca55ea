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

ARGoS's `<epuck_range_and_bearing noise_std_dev="0.01" loss_probability="0.85" max_packets="5"
real_range_noise="true" />` and `<range_and_bearing packet_drop_prob="0.1" />` are the same
sensor, but: the sender's actuator says how far a message reaches; who says nothing is not heard by
the first (by the second he is); messages come in an order that chance decides; there are as many
places as robots, as far as a datagram has room; the sender seems to be moved by a vector of
Gaussian length [m] and, in ARGoS's measure, any direction in space. Source: argos3-epuck 66cb8d9,
epuck_range_and_bearing_default_sensor.cpp lines 144-240; argos3 421bd76,
range_and_bearing_medium_sensor.cpp and rab_medium.cpp lines 170-236.

Source: epuck_range_and_bearing of ARGoS, iridia.md section 3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vsense.base.xml.element import Element
from vsense.world.entities import BODY_RADIUS_M
from vsense.world.sensors._neighbours import Pairs, Reach, without_empty
from vsense.world.sensors.base import Readings, Robots, Scope
from vsense.world.sensors.quality import Floats, Scale
from vsense.world.world import MESSAGE_MAX, World

ELEMENTS = ("virtual_range_and_bearing_sensor",)
ARGOS_ELEMENTS = ("epuck_range_and_bearing", "range_and_bearing")
ARGOS_NOISE = ()

_RANGE_M = 0.8
_HEIGHT_M = float(np.float32(0.052))
"""Of the line of sight. Source: argos3-epuck, RAB_ELEVATION, which is a single there: it just
clears a box of 0.052 m."""
_MAX_MESSAGES = 32
_ARGOS_BYTES = 480
"""Of all places of a reading: so much of a datagram is left beside a robot's other sensors."""
_MAX_NOISE_M = 1e3
_MAX_PACKETS = 2**32 - 1

_REAL_CM = np.array([0.0, 2.0, 5.0, 10.0, 15.0, 30.0, 45.0, 60.0, 80.0])
_REAL_MU = np.array(
    [7.64689, 7.596525, 7.24955, 7.084636, 6.984497, 6.917447, 6.823188, 6.828551, 6.828551]
)
_REAL_SIGMA = np.array(
    [
        0.3570609, 0.319231, 0.1926492, 0.1529397, 0.109233, 0.1216533, 0.1531546, 0.1418425,
        0.1418425,
    ]
)  # fmt: skip
"""What the real board measures at a distance: power, log-normal. Source: argos3-epuck,
epuck_range_and_bearing_default_sensor.cpp lines 78-96."""
_POWER = 9.06422181283387, -0.00565074879677167
"""exp(a + b * power) is the distance [cm] that it tells. Source: as above, lines 33-34."""


@dataclass(frozen=True, slots=True)
class ArgosNoise:
    """What ARGoS's sensor makes of a sender's place.

    Attributes:
        std_dev_m: of the length of the vector that is added to it; its inclination is uniform in
            [0, pi], its azimuth in [0, 2 pi].
        real_range: the range is what the real board would measure, see `_REAL_CM`.
    """

    std_dev_m: float
    real_range: bool

    def apply(self, pairs: Pairs, random: np.random.Generator) -> tuple[Floats, Floats]:
        """Ranges between the bodies [cm] and bearings [rad] of pairs, (p,) each."""
        distance_m, bearing_rad = pairs.distance_m, pairs.bearing_rad
        if self.std_dev_m > 0.0:
            away_m = random.normal(0.0, self.std_dev_m, len(pairs))
            inclination = random.uniform(0.0, np.pi, len(pairs))
            azimuth = random.uniform(0.0, 2.0 * np.pi, len(pairs))
            flat_m = away_m * np.sin(inclination)
            ahead_m = distance_m * np.cos(bearing_rad) + flat_m * np.cos(azimuth)
            left_m = distance_m * np.sin(bearing_rad) + flat_m * np.sin(azimuth)
            up_m = away_m * np.cos(inclination)
            distance_m = np.sqrt(ahead_m**2 + left_m**2 + up_m**2)
            bearing_rad = np.arctan2(left_m, ahead_m)
        range_cm = 100.0 * (distance_m - 2.0 * BODY_RADIUS_M)
        if self.real_range:
            mu, sigma = (np.interp(range_cm, _REAL_CM, table) for table in (_REAL_MU, _REAL_SIGMA))
            power = np.exp(mu + sigma * random.normal(0.0, 1.0, len(pairs)))
            range_cm = np.exp(_POWER[0] + _POWER[1] * power)
        return range_cm, bearing_rad


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
    noise: ArgosNoise | None = None

    def read(self, world: World, robots: Robots) -> Readings:
        """Reads the messages; see `VirtualSensor.read`."""
        speaking = world.messages["length"] > 0
        heard = speaking if self.speaking_only else np.ones_like(speaking)
        reaches_m = world.messages["range_m"]
        pairs = self.reach.pairs(world, robots, heard, reaches_m)
        if self.noise is not None:
            return self._as_argos(world, robots, pairs, self.noise)
        pairs = self._arrived(pairs, len(robots), world.random)
        range_cm = 100.0 * np.maximum(pairs.distance_m - 2.0 * BODY_RADIUS_M, 0.0)
        return self._reading(world, len(robots), pairs, range_cm, pairs.bearing_rad)

    def _as_argos(self, world: World, robots: Robots, pairs: Pairs, noise: ArgosNoise) -> Readings:
        """The reading in ARGoS's order and with its noise."""
        random = world.random
        pairs = pairs.first(self.max_messages, random.random(len(pairs)))
        if self.loss_probability > 0.0:
            pairs = pairs.select(random.random(len(pairs)) >= self.loss_probability)
        range_cm, bearing_rad = noise.apply(pairs, random)
        return self._reading(world, len(robots), pairs, range_cm, bearing_rad)

    def _reading(
        self, world: World, receivers: int, pairs: Pairs, range_cm: Floats, bearing_rad: Floats
    ) -> Readings:
        data = world.messages["data"][pairs.sender, : self.data_size].astype(np.float64)
        silent = np.arange(self.data_size) >= world.messages["length"][pairs.sender][:, None]
        data[silent] = 0.0
        columns = np.column_stack((range_cm, bearing_rad, data))
        return pairs.reading(receivers, self.max_messages, columns)

    def tidy(self, values: Floats) -> Floats:
        """Leaves no noise in the places without a message."""
        return without_empty(values, self.max_messages)

    def _arrived(self, pairs: Pairs, receivers: int, random: np.random.Generator) -> Pairs:
        """Drops the messages that have no place, then those that are lost."""
        if pairs.counts(receivers).max(initial=0) > self.max_messages:
            pairs = pairs.first(self.max_messages, random.random(len(pairs)))
        if self.loss_probability > 0.0:
            pairs = pairs.select(random.random(len(pairs)) >= self.loss_probability)
        return pairs


def from_xml(element: Element, scope: Scope) -> RangeAndBearingSensor:
    """Makes the sensor from its element."""
    size = element.integer("data_size", 1, MESSAGE_MAX, 4)
    places = element.integer("vs:max_messages", 1, _MAX_MESSAGES, 5)
    return RangeAndBearingSensor(
        reach=Reach.from_xml(element, "range", _RANGE_M, _HEIGHT_M),
        layout=_layout(places, size),
        scale=_scale(places, size),
        data_size=size,
        max_messages=places,
        loss_probability=element.number("loss_probability", 0.0, 1.0, default=0.0),
        speaking_only=element.choice("vs:hear", ("all", "speaking"), "all") == "speaking",
    )


def from_argos(element: Element, scope: Scope) -> RangeAndBearingSensor:
    """Makes the sensor that one of ARGoS's elements asks for."""
    any_robot = element.name == "range_and_bearing"
    if any_robot:
        size, wanted = scope.robots.message_bytes, scope.most
        loss = element.number("packet_drop_prob", 0.0, 1.0, default=0.0)
    else:
        size = element.integer("data_size", 1, MESSAGE_MAX, 4)
        wanted = element.integer("max_packets", 1, _MAX_PACKETS, _MAX_PACKETS)
        loss = element.number("loss_probability", 0.0, 1.0, default=0.0)
    wanted = max(min(wanted, scope.most - 1), 1)
    places = min(wanted, _ARGOS_BYTES // (4 * (2 + size)))
    if places < wanted:
        element.warn(f"hears at most {places} messages in a timestep: a datagram has no room")
    noise_m = element.number("noise_std_dev", 0.0, _MAX_NOISE_M, "m", 0.0)
    real_range = not any_robot and element.boolean("real_range_noise", False)
    return RangeAndBearingSensor(
        reach=Reach.from_xml(element, "vs:range", _RANGE_M, _HEIGHT_M),
        layout=_layout(places, size),
        scale=_scale(places, size),
        data_size=size,
        max_messages=places,
        loss_probability=loss,
        speaking_only=not any_robot,
        noise=ArgosNoise(noise_m, real_range),
    )


def _layout(places: int, size: int) -> str:
    return f"{1 + places * (2 + size)}*f4"


def _scale(places: int, size: int) -> Scale:
    return Scale(
        unit=(0.0, *((100.0, 1.0) + (0.0,) * size) * places),
        low=(0.0, *((0.0, -np.pi) + (0.0,) * size) * places),
        wraps=(False, *((False, True) + (False,) * size) * places),
    )
