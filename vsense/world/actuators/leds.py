"""Virtual LEDs: the colour that a robot shows to the virtual sensors of the others.

    <virtual_leds_actuator implementation="default" />

Three levels, red, green and blue, 0 to 255 each; 0, 0, 0 is dark. The controller's name for it is
"led_color". A setting of quality counts full brightness as 1: `noise_level="0.05"` is +-12.75.

ARGoS's elements are single LEDs, each of which a camera sees as a blob:

    <epuck_rgb_leds medium="leds" />   "rgb_leds": red, green, blue of the LED front left, then
                                       front right, then back
    <epuck_base_leds medium="leds" />  "base_leds": 8 levels, 0 off, else red, clockwise from the
                                       front right
    <leds medium="leds" />             "leds": red, green, blue of all that the robot has; an
                                       e-puck the 8 of the ring, counter-clockwise from the front
                                       left, then those 3; a foot-bot 12 likewise, then its beacon

Source: argos3-epuck 66cb8d9, epuck_rgb_leds_default_actuator.cpp lines 54-58,
epuck_base_leds_default_actuator.cpp lines 58-70; argos3 421bd76, leds_default_actuator.cpp.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vsense.base.arena import Floats
from vsense.base.native import kernel_ffi, kernels, pointer
from vsense.base.xml.element import Element
from vsense.world.actuators.base import (
    ApplyFunction,
    RowNumbers,
    VirtualActuator,
    apply_in_c,
    rows_in_c,
)
from vsense.world.robot_models import RobotModel
from vsense.world.sensors.base import Robots, Scope
from vsense.world.sensors.geometry import rows_of
from vsense.world.sensors.quality import Scale
from vsense.world.world import World

ELEMENTS = ("virtual_leds_actuator",)
ARGOS_ELEMENTS = ("epuck_rgb_leds", "epuck_base_leds", "leds")

_FULL = 255.0
_BRIGHTNESS = Scale(unit=_FULL, low=0.0, high=_FULL)
_SWITCHES = Scale(unit=0.0, low=0.0, high=_FULL)


@dataclass(frozen=True, slots=True)
class LedsActuator:
    """Sets the robots' colours; see `VirtualActuator`."""

    name: str = "led_color"
    layout: str = "3*u1"
    scale: Scale = _BRIGHTNESS

    def apply(self, world: World, rows: RowNumbers, values: Floats, increments: Floats) -> None:
        """Shows the colours; see `VirtualActuator.apply`."""
        apply_in_c(self._function(world, rows), np.rint(values))

    def kernel(self, world: World, robots: Robots) -> ApplyFunction:
        """See `vsense/world/actuators/base.py`."""
        return self._function(world, rows_of(world, robots))

    def _function(self, world: World, rows: RowNumbers) -> ApplyFunction:
        arrays = rows_in_c(rows), pointer("uint8_t", world.leds)
        shine = kernel_ffi.new("struct vs_shine *", (len(rows), *arrays))
        return ApplyFunction(kernels, "vs_shine_show", shine, owner=arrays)


@dataclass(frozen=True, slots=True)
class SingleLedsActuator:
    """Sets `count` LEDs from `first` on of `World.led_colors`, three numbers each.

    Of `switches` each has one number, from the last LED to the first, and is red or off.
    """

    name: str
    first: int
    count: int
    switches: bool = False

    @property
    def scale(self) -> Scale:
        """What is a switch has no noise."""
        return _SWITCHES if self.switches else _BRIGHTNESS

    @property
    def layout(self) -> str:
        """The numbers of one LED after the other."""
        return f"{self.count if self.switches else 3 * self.count}*u1"

    def apply(self, world: World, rows: RowNumbers, values: Floats, increments: Floats) -> None:
        """Lights them; see `VirtualActuator.apply`."""
        apply_in_c(self._function(world, rows), np.rint(values))

    def kernel(self, world: World, robots: Robots) -> ApplyFunction:
        """See `vsense/world/actuators/base.py`."""
        return self._function(world, rows_of(world, robots))

    def _function(self, world: World, rows: RowNumbers) -> ApplyFunction:
        shown = (pointer("uint8_t", a) for a in (world.led_colors, world.leds))
        arrays = rows_in_c(rows), *shown
        parts = world.led_colors.shape[1], self.first, self.count, self.switches
        lamps = kernel_ffi.new("struct vs_lamps *", (len(rows), *arrays, *parts))
        return ApplyFunction(kernels, "vs_lamps_light", lamps, owner=arrays)


def from_xml(element: Element, scope: Scope) -> LedsActuator:
    """Makes the actuator from its element."""
    return LedsActuator()


def from_argos(element: Element, scope: Scope) -> VirtualActuator:
    """Makes the actuator that one of ARGoS's elements asks for."""
    name, first, count = lamps_of(element.name, scope.robots.model)
    return SingleLedsActuator(name, first, count, switches=name == "base_leds")


def lamps_of(element: str, model: RobotModel) -> tuple[str, int, int]:
    """What controllers call the LEDs that an element of ARGoS sets, the first one, and how many."""
    ring, count = len(model.leds.ring_m), len(model.lamps_m)
    if element == "epuck_base_leds":
        return "base_leds", 0, ring
    return ("leds", 0, count) if element == "leds" else ("rgb_leds", ring, count - ring)
