"""What a virtual sensor is: one file in this folder, one class, one XML element.

A new sensor's file holds a class with the members of `VirtualSensor`, a function
`from_xml(element, scope)` that makes one or raises ConfigError, and the line
`ELEMENTS = ("virtual_..._sensor",)`. Nothing else has to be changed. README.md beside this file
builds one.

A sensor may also have any of these members:

    scale: Scale               unit and bounds of its numbers, for the quality settings
    changed(sent, fresh)       its own updating condition: (m, k) numbers that the robots were
                               sent last and could be sent now -> (m,) whether to send them
    tidy(values)               called on the (m, k) numbers after noise: what must hold again
    kernel(world, robots)      gives C that does the same as `read`, without Python, in a
                               simulation, until an entity or the floor changes; None: there is none
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from vsense.base.errors import VsenseError, instead
from vsense.base.native import kernels
from vsense.base.xml.element import Element, shown
from vsense.world.entities import Entity
from vsense.world.pollution import PollutantSource
from vsense.world.robot_models import EPUCK, RobotModel
from vsense.world.sensors.quality import ALWAYS, Quality, Scale, Updating
from vsense.world.world import World

Robots = NDArray[np.void]
"""POSE array (n,) of robots."""
Readings = NDArray[Any]
"""(n, k) numbers of n robots."""
_LAYOUT = re.compile(r"(?:([1-9][0-9]{0,3})\*)?([uif][124])")
_TYPES = ("u1", "i2", "u2", "i4", "u4", "f4")
NUMBERS: dict[np.dtype[Any], int] = {
    np.dtype(f"<{name}"): getattr(kernels, f"VS_NUMBER_{name.upper()}") for name in _TYPES
}
"""What the C library calls the types."""


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

    def read(self, world: World, robots: Robots) -> Readings:
        """Computes the readings of robots that a camera saw in this timestep.

        They are finite numbers (n, k), k as the layout says.
        """


class ReadFunction(NamedTuple):
    """A function of a library that reads a sensor, and what it takes first.

    It is declared as `read` of `struct vs_sim_sensor`. `bodies` is whether it asks what stands in
    the way; `owner` is kept alive by it.
    """

    library: Any
    name: str
    cdata: Any
    bodies: bool = False
    owner: object = None


@dataclass(frozen=True, slots=True)
class MountedSensor:
    """A virtual sensor as the robots of an experiment carry it; `line` is that of its element."""

    sensor: VirtualSensor
    line: int
    quality: Quality = field(default_factory=Quality)
    updating: Updating = ALWAYS


@dataclass(frozen=True, slots=True)
class RobotSettings:
    """What a robot is, and what its element says of its devices where they are virtual.

    Attributes:
        rab_range_m: how far `<range_and_bearing>` reaches.
        message_bytes: how long its messages are.
        aperture_rad: of the omnidirectional camera, from its axis.
    """

    model: RobotModel
    rab_range_m: float
    message_bytes: int
    aperture_rad: float

    @classmethod
    def of(cls, model: RobotModel) -> RobotSettings:
        """Those of a robot whose element says nothing."""
        radio, aperture_rad = model.radio, math.radians(model.camera.aperture_deg)
        return cls(model, radio.range_m, radio.bytes, aperture_rad)


_USUAL = RobotSettings.of(EPUCK)


@dataclass(slots=True)
class Scope:
    """What a sensor's or an actuator's element may refer to, and what it adds to the world.

    Attributes:
        tags: markers of all tagged things of the experiment, robots included, by their id.
        timesteps: length of the run, 0 for a run without limit.
        entities: what else stands in the arena at the start, by id.
        fields: ids of the fields on the floor.
        folder: of the experiment file.
        sources: pollutant sources; sensors append theirs.
        named: tags that some sensor or actuator has asked for.
        robots: settings of the robots that carry the device.
        most: how many robots there are.
        leds: how many LEDs of others a robot may see.
        watched: loop functions look at the LEDs of robots.
        heard_bytes, seen_bytes: how much of a datagram the lists of messages and of LEDs may take;
            0: as an e-puck's.
    """

    tags: Mapping[str, int]
    timesteps: int
    timestep_s: float = 0.1
    entities: Mapping[str, Entity] = field(default_factory=dict)
    fields: Collection[str] = ()
    folder: Path = Path()
    sources: list[PollutantSource] = field(default_factory=list)
    named: set[int] = field(default_factory=set)
    robots: RobotSettings = _USUAL
    most: int = 1
    leds: int = 0
    watched: bool = False
    heard_bytes: int = 0
    seen_bytes: int = 0

    def tag(self, element: Element, attribute: str, default: str) -> int:
        """Reads an attribute that names a tagged thing; ConfigError where there is none."""
        entity = element.text(attribute, default)
        if entity not in self.tags:
            hint = instead(entity, self.tags, "tagged are")
            raise element.error(f"there is no {entity!r} in the arena; {hint}", attribute)
        self.named.add(self.tags[entity])
        return self.tags[entity]

    def field(self, element: Element) -> str:
        """Reads the attribute `field`, an id; ConfigError where the floor has no such field."""
        field = element.text("field", None, "the id of a <vs:field>")
        if field not in self.fields:
            hint = instead(field, self.fields)
            raise element.error(f"there is no field {shown(field)} in the arena; {hint}", "field")
        return field


def scale_of(sensor: VirtualSensor) -> Scale:
    """The scale of a sensor's numbers; without one a unit is 1, and there are no bounds."""
    scale = getattr(sensor, "scale", None)
    # A user's sensor may call something else so.
    return scale if isinstance(scale, Scale) else Scale()


@cache
def layout_dtype(layout: str) -> tuple[int, np.dtype[Any]]:
    """Count of a reading's numbers, and their type on the wire (little-endian).

    Raises:
        SensorError: the layout is not "[count*]type".
    """
    match = _LAYOUT.fullmatch(layout)
    if match is None or match[2] not in _TYPES:
        types = ", ".join(_TYPES)
        raise SensorError(f"layout {layout!r}: expected 'type' or 'count*type', types are {types}")
    return int(match[1] or 1), np.dtype(f"<{match[2]}")
