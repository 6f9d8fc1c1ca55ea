"""What a program is: whatever controls robots in this process, and which kinds there are.

A program runs the controller of one element of an experiment for all of its robots. `kind_of`
chooses its kind by the suffix of the controller's first source. Simulations, virtual robots and the
question of what a controller asks for go through this seam.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vsense.base.errors import UsageError
from vsense.base.readings import SensorReadings
from vsense.robots import build
from vsense.robots.inprocess import CompiledProgram, ProgramKernel, ProgramSetup
from vsense.robots.link.wire import ShownData, Wanted
from vsense.robots.sources import CXX_SUFFIXES, LUA, POLICY, PYTHON, ProgramSources
from vsense.world.robot_models import RobotModel


class Program(Protocol):
    """Controls the robots of one controller. It reads no clock: all times are given.

    Raises ControllerFailure from `begin`, `step`, `check` and `end` where a controller cannot go
    on.
    """

    @property
    def tags(self) -> Sequence[int]:
        """The robots, n of them."""

    @property
    def wheels_steps_s(self) -> NDArray[np.int16]:
        """(n, 2) left and right, as commanded in the newest step, after safety [step/s]."""

    @property
    def leds(self) -> NDArray[np.uint16]:
        """(n,) bits 0-7 ring, 8 body, 9 front."""

    def embody(self, model: RobotModel) -> None:
        """Its robots are of a model that is no e-puck."""

    def begin(self) -> None:
        """Every controller begins now; see `CompiledProgram.begin`."""

    def step(
        self,
        wanted: Wanted,
        from_timestep: int,
        timestep: int,
        times_ns: tuple[int, int],
        readings: SensorReadings,
        prox_raw: NDArray[np.int16],
    ) -> None:
        """One control step of every robot; see `CompiledProgram.step`."""

    def sense(self, readings: SensorReadings) -> None:
        """Sets the arrays that the robots sense from then on."""

    def kernel(self) -> ProgramKernel | None:
        """The robots as C steps them; None: each timestep comes back to Python for them."""

    def check(self) -> None:
        """Raises what a controller has failed with."""

    def reports(self) -> dict[int, bytes]:
        """By tag the actuators' block; {}: they have no virtual actuator."""

    def shown(self) -> list[tuple[int, ShownData]]:
        """By tag the values that a controller shows, where one has changed since the last call."""

    def logged(self) -> list[tuple[int, str]]:
        """What controllers have logged since the last call: tag and line."""

    def failures(self) -> dict[int, str]:
        """By tag why a controller has failed, whose robot stands since then."""

    def complaints(self) -> list[str]:
        """What the controllers asked for and did not get, each once."""

    def end(self) -> None:
        """The run is over."""


ProgramOpener = Callable[[ProgramSetup], Program]
"""Opens what was built for a run; raises as `CompiledProgram`."""


@dataclass(frozen=True, slots=True)
class ProgramKind:
    """A kind of program.

    Attributes:
        build: gives the file that is opened, made if it is missing; BuildError.
        open: makes the program of it.
    """

    build: Callable[[ProgramSources], Path]
    open: ProgramOpener


_COMPILED = ProgramKind(build.shared, CompiledProgram)


def _build_python(sources: ProgramSources) -> Path:
    from vsense.robots import _python_program  # with what runs users' Python, 20 ms

    return _python_program.build_program(sources)


def _open_python(setup: ProgramSetup) -> Program:
    from vsense.robots import _python_program

    return _python_program.PythonProgram(setup)


def _build_lua(sources: ProgramSources) -> Path:
    from vsense.robots import _lua_program  # likewise

    return _lua_program.build_program(sources)


def _open_lua(setup: ProgramSetup) -> Program:
    from vsense.robots import _lua_program

    return _lua_program.LuaProgram(setup)


_HOSTED = {
    PYTHON: ProgramKind(_build_python, _open_python),
    LUA: ProgramKind(_build_lua, _open_lua),
}
KINDS_BY_SUFFIX = dict.fromkeys((".c", *CXX_SUFFIXES, POLICY), _COMPILED) | _HOSTED
"""Kinds by the suffix of a controller's first source."""


def kind_of(sources: ProgramSources) -> ProgramKind:
    """Gives a controller's kind.

    Raises:
        UsageError: no kind has its suffix.
    """
    first = sources.sources[0]
    if first.suffix not in KINDS_BY_SUFFIX:
        expected = ", ".join(KINDS_BY_SUFFIX)
        raise UsageError(f"{first}: no controller can be written in this; expected {expected}")
    return KINDS_BY_SUFFIX[first.suffix]
