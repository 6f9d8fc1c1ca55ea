"""What a virtual actuator is: one file in this folder, one class, one XML element.

A new actuator's file holds a class with the members of `VirtualActuator`, a function
`from_xml(element, scope)` that makes one or raises ConfigError, and the line
`ELEMENTS = ("virtual_..._actuator",)`. Nothing else has to be changed. `scope` is that of the
virtual sensors, which are read before the actuators.

A robot's report is never an event, since it may come twice or not at all. Each number is a
**level** ("release 0.3 per second"), which holds until the next one and is 0 where nothing is done,
or a **cumulative counter** ("dropped 7 since the run began"), whose growth is acted on.

An actuator may also have this member:

    kernel(world, robots)   gives C that does the same as `apply` for all robots, without Python, in
                            a simulation, until an entity or the floor changes; None: there is none
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats
from vsense.base.errors import VsenseError
from vsense.base.native import kernel_ffi, pointer
from vsense.world.sensors.quality import Quality, Scale
from vsense.world.world import World

RowNumbers = NDArray[np.intp]


class ActuatorError(VsenseError):
    """A virtual actuator does not exist, or a report does not fit it."""


class VirtualActuator(Protocol):
    """Changes one kind of thing in the virtual world for all robots at once."""

    @property
    def name(self) -> str:
        """What controllers call it; no sensor of the experiment has the same name."""

    @property
    def layout(self) -> str:
        """Numbers of one report on the wire: "f4" is one single, "3*u1" three bytes."""

    @property
    def scale(self) -> Scale:
        """Unit and bounds of its numbers; nothing outside of the bounds reaches `apply`."""

    def apply(self, world: World, rows: RowNumbers, values: Floats, increments: Floats) -> None:
        """Acts for one timestep, in which `world` was updated.

        Args:
            rows: (m,) which of `world.robots`, ascending. A row may be a robot that no camera
                sees now: it acts where it was seen last.
            values: (m, k) newest levels, k as the layout says; 0 for a silent robot.
            increments: (m, k) by how much each number has grown since the last call, 0 or more.
        """


class ApplyFunction(NamedTuple):
    """A function of a library that acts, and what it takes first; `owner` is kept alive.

    It is declared as `apply` of `struct vs_sim_actuator`.
    """

    library: Any
    name: str
    cdata: Any
    owner: object = None


def rows_in_c(rows: RowNumbers) -> Any:
    """Robots' rows (n,) in the world as `int32_t[]`, which hold until an entity changes."""
    return pointer("int32_t", np.ascontiguousarray(rows, dtype=np.int32))


def apply_in_c(kernel: ApplyFunction, levels: Floats) -> None:
    """Sets levels (n, k) by a function that asks for nothing else and cannot fail."""
    given = pointer("double", np.ascontiguousarray(levels))
    function = getattr(kernel.library, kernel.name)
    function(kernel.cdata, kernel_ffi.NULL, given, kernel_ffi.NULL)


@dataclass(frozen=True, slots=True)
class MountedActuator:
    """A virtual actuator as the robots of an experiment carry it; `line` is its element's."""

    actuator: VirtualActuator
    line: int
    quality: Quality = field(default_factory=Quality)
