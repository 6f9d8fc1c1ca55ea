"""Virtual LEDs: the colour that a robot shows to the virtual sensors of the others.

    <virtual_leds_actuator implementation="default" />

Three levels, red, green and blue, 0 to 255 each; 0, 0, 0 is dark. The controller's name for it is
"led_color". A setting of quality counts full brightness as 1: `noise_level="0.05"` is +-12.75.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vsense.actuators.base import Rows
from vsense.sensors.base import Scope
from vsense.sensors.quality import Floats, Scale
from vsense.world.world import World
from vsense.xml.element import Element

ELEMENTS = ("virtual_leds_actuator",)

_FULL = 255.0
_BRIGHTNESS = Scale(unit=_FULL, low=0.0, high=_FULL)


@dataclass(frozen=True, slots=True)
class LedsActuator:
    """Sets the robots' colours; see `VirtualActuator`."""

    name: str = "led_color"
    layout: str = "3*u1"
    scale: Scale = _BRIGHTNESS

    def apply(self, world: World, rows: Rows, values: Floats, increments: Floats) -> None:
        """Shows the colours; see `VirtualActuator.apply`."""
        world.leds[rows] = np.rint(values).astype(np.uint8)


def from_xml(element: Element, scope: Scope) -> LedsActuator:
    """Makes the actuator from its element."""
    return LedsActuator()
