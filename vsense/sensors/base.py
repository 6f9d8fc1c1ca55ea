"""What a virtual sensor is: one file in this folder, one class, one XML element.

A new sensor's file holds a class with the members of `VirtualSensor`, a function
`from_xml(element, scope)` that makes one or raises ConfigError, and the line
`ELEMENTS = ("virtual_..._sensor",)`. Nothing else in the tree has to know of it. README.md beside
this file builds one.

A sensor may also have any of these members; without them it is a plain one:

    scale: Scale               unit and bounds of its numbers, for the quality settings
    changed(sent, fresh)       its own updating condition: (m, k) numbers that the robots were
                               sent last and could be sent now -> (m,) whether to send them
    tidy(values)               called on the (m, k) numbers after noise: what must hold again
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from vsense.errors import VsenseError
from vsense.sensors.quality import Quality, Scale
from vsense.sensors.updating import ALWAYS, Updating
from vsense.world.entities import Entity
from vsense.world.pollution import PollutantSource
from vsense.world.world import World
from vsense.xml.element import Element, listed, shown

PLAIN = Scale()
"""Of a sensor that says nothing about its numbers: one unit is 1, no bounds."""

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
        """Numbers of one reading on the wire: "f4" is one single, "8*f4" eight of them.

        Types are u1 i2 u2 i4 u4 f4; whole numbers are rounded to the nearest.
        """

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
        line: line of its XML element.
        quality: how good it is.
        updating: when robots are sent a new value; between, they keep being sent the last one,
            with its age.
    """

    sensor: VirtualSensor
    line: int
    quality: Quality = field(default_factory=Quality)
    updating: Updating = ALWAYS


@dataclass(slots=True)
class Scope:
    """What a sensor's or an actuator's element may refer to, and what it adds to the world.

    Attributes:
        tags: markers of all tagged things of the experiment, robots included, by their id.
        timesteps: length of the run, 0 for a run without limit.
        timestep_s: length of a timestep.
        entities: what else stands in the arena at the start, by id.
        fields: ids of the fields on the floor.
        folder: where the experiment file lies.
        sources: pollutant sources; sensors append theirs.
        named: tags that some sensor or actuator has asked for.
    """

    tags: Mapping[str, int]
    timesteps: int
    timestep_s: float = 0.1
    entities: Mapping[str, Entity] = field(default_factory=dict)
    fields: Collection[str] = ()
    folder: Path = Path()
    sources: list[PollutantSource] = field(default_factory=list)
    named: set[int] = field(default_factory=set)

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
        self.named.add(self.tags[entity])
        return self.tags[entity]

    def field(self, element: Element) -> str:
        """Reads the attribute `field`, the id of a field on the floor.

        Raises:
            ConfigError: there is no such field.
        """
        field = element.text("field", None, "the id of a <vs:field>")
        if field not in self.fields:
            known = listed(self.fields)
            raise element.error(
                f"there is no field {shown(field)} in the arena; there are: {known}", "field"
            )
        return field


def scale_of(sensor: VirtualSensor) -> Scale:
    """Gives what a sensor's numbers mean to the quality settings."""
    scale = getattr(sensor, "scale", PLAIN)
    # A user's sensor may well call a number of its own so.
    return scale if isinstance(scale, Scale) else PLAIN


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
