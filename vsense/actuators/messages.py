"""Virtual range-and-bearing messages: what a robot says to its neighbours' virtual sensors.

    <virtual_range_and_bearing_actuator implementation="default" data_size="4" />

A report is the length of the message and `data_size` bytes of it; length 0 says nothing. It is a
level: the robot sends the same in every timestep until the next report. The controller's name for
it is "message". The receiving sensor decides who hears it, and how far away.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vsense.actuators.base import Rows
from vsense.sensors.base import Scope
from vsense.sensors.quality import Floats, Scale
from vsense.world.world import MESSAGE_MAX, World
from vsense.xml.element import Element

ELEMENTS = ("virtual_range_and_bearing_actuator",)

DEFAULT_SIZE = 4
"""Bytes of a message of the e-puck's range-and-bearing board. Source: argos3-epuck."""


@dataclass(frozen=True, slots=True)
class MessagesActuator:
    """Sets the robots' messages of at most `size` bytes."""

    size: int = DEFAULT_SIZE
    name: str = "message"

    @property
    def layout(self) -> str:
        """The length, then the bytes."""
        return f"{1 + self.size}*u1"

    @property
    def scale(self) -> Scale:
        """Bytes are no measurements: no noise changes them."""
        return Scale(unit=0.0, low=0.0, high=(float(self.size), *[255.0] * self.size))

    def apply(self, world: World, rows: Rows, values: Floats, increments: Floats) -> None:
        """Sets the messages; see `VirtualActuator.apply`."""
        lengths = values[:, 0].astype(np.uint8)
        said = np.arange(self.size) < lengths[:, None]
        data = np.zeros((len(rows), MESSAGE_MAX), dtype=np.uint8)
        data[:, : self.size] = np.where(said, values[:, 1:], 0.0)
        world.messages["length"][rows] = lengths
        world.messages["data"][rows] = data


def from_xml(element: Element, scope: Scope) -> MessagesActuator:
    """Makes the actuator from its element."""
    return MessagesActuator(element.integer("data_size", 1, MESSAGE_MAX, DEFAULT_SIZE))
