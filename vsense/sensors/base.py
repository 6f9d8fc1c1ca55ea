"""What a virtual sensor is: one file in this folder, one class, one XML element.

A new sensor's file holds a class with the members of `VirtualSensor`, a function
`from_xml(element, scope)` that makes one, and the line `ELEMENTS = ("virtual_..._sensor",)`.
Nothing else in the tree has to know of it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from vsense.config.element import Element
from vsense.errors import VsenseError
from vsense.world.pollution import PollutantSource
from vsense.world.world import World

_LAYOUT = re.compile(r"(?:([1-9][0-9]{0,3})\*)?([uif][124])")
_TYPES = ("u1", "i2", "u2", "i4", "u4", "f4")


class SensorError(VsenseError):
    """A virtual sensor gave something that must not reach a robot."""


class VirtualSensor(Protocol):
    """Computes one kind of reading for all robots at once."""

    @property
    def name(self) -> str:
        """What controllers call it; unique in an experiment."""

    @property
    def layout(self) -> str:
        """Numbers of one reading on the wire: "f4" is one single, "8*f4" eight of them."""

    def read(self, world: World, robots: NDArray[np.void]) -> NDArray[Any]:
        """Computes the readings of robots.

        Args:
            world: everything that can be sensed.
            robots: POSE array (n,) of robots that a camera saw in this timestep.

        Returns:
            (n, k) finite numbers, k as the layout says.
        """


@dataclass(frozen=True, slots=True)
class MountedSensor:
    """A virtual sensor as the robots of an experiment carry it.

    Attributes:
        sensor: what computes the readings.
        update_every: readings are recomputed in every n-th timestep; between them the robots
            keep being sent the last one, with its age.
        line: line of its XML element.
    """

    sensor: VirtualSensor
    update_every: int
    line: int


@dataclass(slots=True)
class Scope:
    """What a sensor's element may refer to, and what it adds to the world.

    Attributes:
        tags: markers of all tagged things of the experiment by their id.
        timesteps: length of the run, 0 for a run without limit.
        sources: pollutant sources; sensors append theirs.
    """

    tags: Mapping[str, int]
    timesteps: int
    sources: list[PollutantSource] = field(default_factory=list)

    def tag(self, element: Element, attribute: str, default: str) -> int:
        """Reads an attribute that names a tagged thing.

        Raises:
            ConfigError: there is no such thing.
        """
        entity = element.text(attribute, default)
        if entity not in self.tags:
            known = ", ".join(sorted(self.tags)) or "none"
            raise element.error(
                f"there is no {entity!r} in the arena; tagged are: {known}", attribute
            )
        return self.tags[entity]


def layout_dtype(layout: str) -> tuple[int, np.dtype[Any]]:
    """Takes a layout apart.

    Returns:
        How many numbers a reading has, and their type on the wire (little-endian).

    Raises:
        SensorError: it is not "[count*]type".
    """
    match = _LAYOUT.fullmatch(layout)
    if match is None or match[2] not in _TYPES:
        known = ", ".join(_TYPES)
        raise SensorError(f"layout {layout!r}: expected 'type' or 'count*type', types are {known}")
    return int(match[1] or 1), np.dtype(f"<{match[2]}")
