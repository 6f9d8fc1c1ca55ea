"""Virtual range-and-bearing messages: what a robot says to its neighbours' virtual sensors.

    <virtual_range_and_bearing_actuator implementation="default" data_size="4" />

A report is the length of the message and `data_size` bytes of it; length 0 says nothing. It is a
level: the robot sends the same in every timestep until the next report. The controller's name for
it is "message". The receiving sensor decides who hears it, and how far away.

ARGoS's `<epuck_range_and_bearing medium="rab" range="0.8" />` is heard up to its own `range`; for
`<range_and_bearing />` the robots' `rab_range` and `rab_data_size` say how far and how long.
Source: argos3-epuck 66cb8d9, epuck_range_and_bearing_default_actuator.cpp line 33; argos3 421bd76,
epuck_entity.cpp lines 286-289.
"""

from __future__ import annotations

from dataclasses import dataclass

from vsense.base.arena import Floats
from vsense.base.native import kernel_ffi, kernels, pointer
from vsense.base.xml.element import Element
from vsense.world.actuators.base import ApplyFunction, RowNumbers, apply_in_c, rows_in_c
from vsense.world.sensors.base import Robots, Scope
from vsense.world.sensors.geometry import rows_of
from vsense.world.sensors.quality import Scale
from vsense.world.world import MESSAGE_MAX, World

ELEMENTS = ("virtual_range_and_bearing_actuator",)
ARGOS_ELEMENTS = ("epuck_range_and_bearing", "range_and_bearing")

DEFAULT_SIZE = 4
"""Bytes of a message of the e-puck's range-and-bearing board. Source: argos3-epuck."""

_MAX_RANGE_M = 1000.0


@dataclass(frozen=True, slots=True)
class MessagesActuator:
    """Sets the robots' messages of at most `size` bytes; `range_m` as in `MESSAGE`."""

    size: int = DEFAULT_SIZE
    name: str = "message"
    range_m: float = 0.0

    @property
    def layout(self) -> str:
        """The length, then the bytes."""
        return f"{1 + self.size}*u1"

    @property
    def scale(self) -> Scale:
        """Bytes are no measurements: no noise changes them."""
        return Scale(unit=0.0, low=0.0, high=(float(self.size), *[255.0] * self.size))

    def apply(self, world: World, rows: RowNumbers, values: Floats, increments: Floats) -> None:
        """Sets the messages; see `VirtualActuator.apply`."""
        apply_in_c(self._function(world, rows), values)

    def kernel(self, world: World, robots: Robots) -> ApplyFunction:
        """See `vsense/world/actuators/base.py`."""
        return self._function(world, rows_of(world, robots))

    def _function(self, world: World, rows: RowNumbers) -> ApplyFunction:
        own = rows_in_c(rows)
        messages = pointer("struct vs_message", world.messages)
        members = len(rows), own, messages, self.size, self.range_m
        speech = kernel_ffi.new("struct vs_speech *", members)
        return ApplyFunction(kernels, "vs_speech_set", speech, owner=(own, world.messages))


def from_xml(element: Element, scope: Scope) -> MessagesActuator:
    """Makes the actuator from its element."""
    return MessagesActuator(element.integer("data_size", 1, MESSAGE_MAX, DEFAULT_SIZE))


def from_argos(element: Element, scope: Scope) -> MessagesActuator:
    """Makes the actuator that one of ARGoS's elements asks for."""
    if element.name == "range_and_bearing":
        return MessagesActuator(scope.robots.message_bytes, range_m=scope.robots.rab_range_m)
    size = element.integer("data_size", 1, MESSAGE_MAX, DEFAULT_SIZE)
    range_m = element.number("range", 0.001, _MAX_RANGE_M, "m", scope.robots.model.radio.range_m)
    return MessagesActuator(size, range_m=range_m)
