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
from typing import Any

import numpy as np

from vsense.base.arena import Floats
from vsense.base.native import kernel_ffi, kernels, pointer, random_in_c
from vsense.base.xml.element import Element
from vsense.world.robot_models import EPUCK
from vsense.world.sensors.base import ReadFunction, Readings, Robots, Scope
from vsense.world.sensors.geometry import Reach, read_in_c, without_empty
from vsense.world.sensors.quality import Scale
from vsense.world.world import MESSAGE_MAX, World

ELEMENTS = ("virtual_range_and_bearing_sensor",)
ARGOS_ELEMENTS = ("epuck_range_and_bearing", "range_and_bearing")
ARGOS_NOISE = ()

_MAX_MESSAGES = 32
_ARGOS_BYTES = 480
"""Of all places of a reading: so much of a datagram is left beside a robot's other sensors."""
_MAX_NOISE_M = 1e3
_MOST_NOTED = 2000
"""Robots, of which it is noted whether the line between two is free."""
_MAX_PACKETS = 2**32 - 1


@dataclass(frozen=True, slots=True)
class ArgosNoise:
    """What ARGoS's sensor makes of a sender's place.

    Attributes:
        std_dev_m: of the length of the vector that is added to it; its inclination is uniform in
            [0, pi], its azimuth in [0, 2 pi].
        real_range: the range is what the real board would measure.
    """

    std_dev_m: float
    real_range: bool


@dataclass(frozen=True, slots=True)
class RangeAndBearingSensor:
    """Receives the messages of the robots around; see the module. Twice `body_m` is no part of a
    range."""

    reach: Reach
    layout: str
    scale: Scale
    data_size: int
    max_messages: int
    loss_probability: float
    speaking_only: bool
    name: str = "range_and_bearing"
    noise: ArgosNoise | None = None
    body_m: float = EPUCK.radius_m

    def read(self, world: World, robots: Robots) -> Readings:
        """Reads the messages; see `VirtualSensor.read`."""
        count = 1 + self.max_messages * (2 + self.data_size)
        return read_in_c(self.kernel(world, robots), world, robots, count)

    def kernel(self, world: World, robots: Robots) -> ReadFunction:
        """See `vsense/world/sensors/base.py`."""
        noise = self.noise or ArgosNoise(0.0, False)
        normal = noise.std_dev_m > 0.0 or noise.real_range
        occlusions = self.reach.height_m is not None
        room = len(robots) * self.max_messages + 1
        arrays: dict[str, Any] = {
            "messages": pointer("struct vs_message", world.messages),
            "random": random_in_c(world.random, normal),
            "places_m": kernel_ffi.new("double[]", 3 * len(world.robots)),
            "heard": kernel_ffi.new("struct vs_noticed[]", room),
            "counts": kernel_ffi.new("uint32_t[]", len(robots) + 1),
            "lines": kernel_ffi.NULL,
        }
        if occlusions and len(world.robots) <= _MOST_NOTED:
            arrays["lines"] = kernel_ffi.new("uint8_t[]", len(world.robots) ** 2 + 1)
        members = {
            "world": world.sightings.cdata,
            "range_m": self.reach.range_m,
            "view_rad": self.reach.field_of_view_rad,
            "height_m": self.reach.height_m or 0.0,
            "occlusions": occlusions,
            "speaking": self.speaking_only,
            "most": self.max_messages,
            "size": self.data_size,
            "loss": self.loss_probability,
            "body_m": self.body_m,
            "shuffled": self.noise is not None,
            "noise_m": noise.std_dev_m,
            "real_range": noise.real_range,
        }
        hearing = kernel_ffi.new("struct vs_hearing *", {**members, **arrays})
        owner = arrays, world.random, world.messages
        return ReadFunction(kernels, "vs_hearing_read", hearing, occlusions, owner)

    def tidy(self, values: Floats) -> Floats:
        """Leaves no noise in the places without a message."""
        return without_empty(values, self.max_messages)


def from_xml(element: Element, scope: Scope) -> RangeAndBearingSensor:
    """Makes the sensor from its element."""
    size = element.integer("data_size", 1, MESSAGE_MAX, 4)
    places = element.integer("vs:max_messages", 1, _MAX_MESSAGES, 5)
    model = scope.robots.model
    return RangeAndBearingSensor(
        reach=Reach.from_xml(element, "range", model.radio.range_m, model.radio.height_m),
        layout=_layout(places, size),
        scale=_scale(places, size),
        data_size=size,
        max_messages=places,
        loss_probability=element.number("loss_probability", 0.0, 1.0, default=0.0),
        speaking_only=element.choice("vs:hear", ("all", "speaking"), "all") == "speaking",
        body_m=model.radius_m,
    )


def from_argos(element: Element, scope: Scope) -> RangeAndBearingSensor:
    """Makes the sensor that one of ARGoS's elements asks for."""
    any_robot, model = element.name == "range_and_bearing", scope.robots.model
    if any_robot:
        size, wanted = scope.robots.message_bytes, scope.most
        loss = element.number("packet_drop_prob", 0.0, 1.0, default=0.0)
    else:
        size = element.integer("data_size", 1, MESSAGE_MAX, 4)
        wanted = element.integer("max_packets", 1, _MAX_PACKETS, _MAX_PACKETS)
        loss = element.number("loss_probability", 0.0, 1.0, default=0.0)
    wanted = max(min(wanted, scope.most - 1), 1)
    places = min(wanted, (scope.heard_bytes or _ARGOS_BYTES) // (4 * (2 + size)))
    if places < wanted:
        element.warn(f"hears at most {places} messages in a timestep: a datagram has no room")
    noise_m = element.number("noise_std_dev", 0.0, _MAX_NOISE_M, "m", 0.0)
    real_range = not any_robot and element.boolean("real_range_noise", False)
    return RangeAndBearingSensor(
        reach=Reach.from_xml(element, "vs:range", model.radio.range_m, model.radio.height_m),
        layout=_layout(places, size),
        scale=_scale(places, size),
        data_size=size,
        max_messages=places,
        loss_probability=loss,
        speaking_only=not any_robot,
        noise=ArgosNoise(noise_m, real_range),
        body_m=model.radius_m,
    )


def _layout(places: int, size: int) -> str:
    return f"{1 + places * (2 + size)}*f4"


def _scale(places: int, size: int) -> Scale:
    return Scale(
        unit=(0.0, *((100.0, 1.0) + (0.0,) * size) * places),
        low=(0.0, *((0.0, -np.pi) + (0.0,) * size) * places),
        wraps=(False, *((False, True) + (False,) * size) * places),
    )
