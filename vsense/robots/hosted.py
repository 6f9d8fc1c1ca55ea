"""Robots whose runtime is C's, and for which this process decides: `robot/hosted.h`.

A control step is that of `CompiledProgram`: C has the sensors' ages, what of them is fused, the
limits of what a robot may do and when it must stand. Before it, `act` reads and sets.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from vsense.base.native import ffi, lib
from vsense.robots import build
from vsense.robots.inprocess import (
    CompiledProgram,
    ControllerFailure,
    ProgramKernel,
    ProgramSetup,
    declarations,
    functions,
)
from vsense.robots.link.table import Direction, Table
from vsense.robots.link.wire import Wanted
from vsense.robots.python_swarm import Swarm

_HOST = "stand_still"
"""The controller in C that leaves alone what its host sets."""

OWN_ENTRIES = 200
"""From this id on a table's entries are the robots' own devices, for who drives real ones."""
MESSAGE = "message"
"""Of these, what a robot's board says to others: the length and the bytes."""

STEP_MAX_S = 3.0
"""What controllers may take for a control step; real robots stand meanwhile, without commands."""


MAX_TEXT_BYTES = 4096
"""Of all parameters together. Source: robot/controller.h."""


class HostedRobots:
    """The robots of a controller as C has them (`robot/hosted.h`)."""

    def __init__(self, lib: Any, robots: Any, count: int, memory: Any) -> None:
        """`memory` is what `robots` points into: it stays as long as this does."""
        self._lib, self._robots, self._memory = lib, robots, memory
        self.count = count

    def call(self, function: str, *arguments: Any) -> Any:
        """Calls `vs_hosted_FUNCTION`; arrays are given as they lie in memory, texts as UTF-8."""
        given = map(self._given, arguments)
        return getattr(self._lib, f"vs_hosted_{function}")(self._robots, *given)

    def walks(self) -> Any:
        """Memory for the walks of all robots."""
        return ffi.new("double[]", -(-self.call("walk_bytes") // 8))

    def text(self, robot: int, name: str) -> str | None:
        """A parameter; None: the experiment does not have it."""
        room = ffi.new("char[]", MAX_TEXT_BYTES + 1)
        size = len(room)
        if self.call("param_text", robot, name, room, size) < 0:
            return None
        text: bytes = ffi.string(room)
        return text.decode(errors="replace")

    def _given(self, value: Any) -> Any:
        if isinstance(value, np.ndarray):
            return ffi.from_buffer(f"{_C_TYPES[value.dtype.char]} *", value)
        if isinstance(value, str):
            return value.encode()
        return value


_C_TYPES = {"d": "double", "B": "uint8_t", "?": "uint8_t", "i": "int32_t", "I": "uint32_t"}
_C_TYPES |= {np.dtype(np.uint64).char: "uint64_t"}


def build_host() -> Path:
    """Gives the shared object of the robots; raises as `build.shared`."""
    return build.shared(_HOST)


class HostedProgram(CompiledProgram):
    """All robots of a controller that this process decides for; see `CompiledProgram`.

    Attributes:
        swarm: what they sense and do.
        notes: timestep, and 1 + the robot that is in its control step.
    """

    def __init__(self, setup: ProgramSetup) -> None:
        """Greets every robot; `library` is the file that decides, and gives the name."""
        built, table, self._name = build_host(), setup.table, setup.library.stem
        super().__init__(replace(setup, library=built))
        self.notes = memoryview(setup.progress).cast("B").cast("I")
        counts = _counts(table, Direction.SENSOR), _counts(table, Direction.ACTUATOR)
        robots = HostedRobots(functions(built, "hosted"), self._all, len(self.tags), self._memory)
        self.swarm = Swarm(robots, self.tags, setup.timestep_ns * 1e-9, *counts)
        self._begun, self._raised, self._failures = False, None, dict[int, str]()
        self._step_of_c = ffi.callback(declarations()["vs_inprocess_step"], self._step_for_c)

    _raised: BaseException | None

    @property
    def controller(self) -> str:
        """The file's name."""
        return self._name

    @abstractmethod
    def act(self) -> None:
        """Reads what the swarm senses, and sets what it does in this control step."""

    def each(self, act: Callable[[int], None], are_one: bool = False) -> None:
        """Has every robot whose controller has not failed do something, and notes which does.

        One that raises an exception stands from then on, which is logged and is one of `failures`;
        `are_one`: there is one controller for all of them.

        Raises:
            ControllerFailure: no robot can go on.
        """
        for number in range(1 if are_one else len(self.tags)):
            if number in self._failures:
                continue
            self.notes[1] = number + 1
            try:
                act(number)
            except KeyboardInterrupt:
                raise
            except BaseException as error:
                self._fail(number, error, are_one)
        self.notes[1] = 0

    def _fail(self, number: int, error: BaseException, are_one: bool) -> None:
        words = self._failures[number] = self.explained(error)
        if are_one or len(self._failures) == len(self.tags):
            raise ControllerFailure(self.tags[number], self.controller, words) from error
        self.swarm.rest(number)
        self.swarm.log(number, f"its controller has failed: {words}")

    def explained(self, error: BaseException) -> str:
        """What an exception in a controller means, with file and line."""
        return str(error)

    def failures(self) -> dict[int, str]:
        """See `Program.failures`."""
        return {self.tags[row]: words for row, words in self._failures.items()}

    def begin(self) -> None:
        """See `Program.begin`."""
        super().begin()
        self._begun = True

    def decide(self, wanted: Wanted) -> None:
        """See `CompiledProgram.decide`."""
        if wanted is not Wanted.RUN:
            return
        if not self._begun:
            self.begin()
        self.swarm.runtime.call("sense", self._now)
        self.swarm.steps += 1
        self.notes[0] = self._now.timestep
        self.act()
        self.swarm.send()

    def kernel(self) -> ProgramKernel:
        """See `CompiledProgram.kernel`: C asks this process what to do in every timestep."""
        return super().kernel()._replace(step=int(ffi.cast("uintptr_t", self._step_of_c)))

    def _step_for_c(self, robots: Any, now: Any) -> int:
        """A control step that C asks for; what it raises waits for `check`."""
        try:
            self.decide(Wanted.RUN)
            return int(self._lib.vs_inprocess_step(robots, now))
        except BaseException as error:
            self._raised = error
            return int(lib.VS_ERR_STATE)

    def check(self) -> None:
        """See `Program.check`."""
        if self._raised is not None:
            raise self._raised
        super().check()

    def complaints(self) -> list[str]:
        """See `Program.complaints`."""
        ours, theirs = f"controller '{_HOST}'", f"controller '{self._name}'"
        return [line.replace(ours, theirs, 1) for line in super().complaints()]


def _counts(table: Table, direction: Direction) -> dict[str, int]:
    """How many numbers the entries have, by name."""
    rows = [e for e in table.entries if e.direction == direction]
    layouts = {
        e.name: e.layout for e in rows if e.id < OWN_ENTRIES or direction == Direction.ACTUATOR
    }
    return {n: int(layout.rpartition("*")[0] or 1) for n, layout in layouts.items()}
