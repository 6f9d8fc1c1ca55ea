"""Controllers in Python, run in this process: C runs the robots, and the file decides.

A control step is that of `CompiledProgram`: C has the sensors' ages, what of them is fused, the
limits of what a robot may do and when it must stand. Before it, the file's class reads and sets.
"""

from __future__ import annotations

import inspect
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from vsense.base.errors import VsenseError, likely
from vsense.base.users_code import UsersCode
from vsense.robots import build
from vsense.robots.inprocess import (
    PROGRESS_BYTES,
    CompiledProgram,
    ControllerFailure,
    ProgramKernel,
    SimError,
    functions,
)
from vsense.robots.link.table import Direction, Table
from vsense.robots.link.wire import Wanted
from vsense.robots.python_robot import Robot
from vsense.robots.python_swarm import HostedRobots, Swarm
from vsense.robots.sources import ProgramSources

ONE, ALL = "Controller", "SwarmController"
"""The classes of which a file has one."""
_METHODS = {"__init__": 2, "step": 2, "end": 1}
"""What they have, and how many arguments each takes, with itself."""
_HOOKS = ("populate", "reset", "pre_step", "post_step", "end")
"""By which a file of loop functions is known."""
_HOST, _PART = "stand_still", "hosted"
"""The controller in C that leaves alone what its host sets, and the header of how it does."""


def build_program(program: ProgramSources) -> Path:
    """Gives the file to be opened, when what it needs is built; raises as `build.shared`."""
    build.shared(_HOST)
    return program.sources[0]


class PythonProgram(CompiledProgram):
    """All robots of a run whose controller is a file in Python; see `CompiledProgram`.

    A robot whose controller raises an exception stands from then on, which is logged and is one of
    `failures`; the others go on. Where all have, or the class for all of them has, nobody can.
    """

    def __init__(
        self,
        library: Path,
        tags: Sequence[int],
        table: Table,
        timestep_ns: int,
        seed: int,
        params: str | Mapping[int, str],
        progress: Any = None,
    ) -> None:
        """Runs the file; see `CompiledProgram`.

        Raises:
            SimError: it cannot be read, fails, or has no class that controls robots.
        """
        progress = bytearray(PROGRESS_BYTES) if progress is None else progress
        built = build.shared(_HOST)
        self._name, self._failures = library.stem, dict[int, str]()
        super().__init__(built, tags, table, timestep_ns, seed, params, progress)
        self._code = UsersCode(library, _located)
        self._class, self._is_for_all = _class_of(self._code, self._code.load(_module(library)))
        self._notes = np.frombuffer(progress, dtype=np.uint32)
        counts = _counts(table, Direction.SENSOR), _counts(table, Direction.ACTUATOR)
        runtime = HostedRobots(functions(built, _PART), self._all, len(self.tags))
        self._swarm = Swarm(runtime, self.tags, timestep_ns * 1e-9, *counts)
        self._controllers: list[Any] | None = None
        self._views = [self._swarm] if self._is_for_all else self._robots()

    def _robots(self) -> list[Any]:
        return [Robot(self._swarm, row) for row in range(len(self.tags))]

    @property
    def controller(self) -> str:
        """The file's name."""
        return self._name

    def begin(self) -> None:
        """See `Program.begin`."""
        super().begin()
        if self._controllers is None:
            self._controllers = [None] * len(self._views)
            self._each(self._make)

    def _make(self, number: int) -> None:
        assert self._controllers is not None
        self._controllers[number] = self._class(self._views[number])

    def decide(self, wanted: Wanted) -> None:
        """The file's part of a control step."""
        if wanted is not Wanted.RUN:
            return
        if self._controllers is None:
            self.begin()
        self._hosted_sense()
        self._swarm.steps += 1
        self._notes[0] = self._now.timestep
        self._each(self._step_one)
        self._swarm.send()

    def _hosted_sense(self) -> None:
        self._swarm.runtime.call("sense", self._now)

    def _step_one(self, number: int) -> None:
        assert self._controllers is not None
        self._controllers[number].step(self._views[number])

    def _each(self, act: Any) -> None:
        """Has the controllers that have not failed do something, and notes which does."""
        with self._code.beside():
            for number in range(len(self._views)):
                if number in self._failures:
                    continue
                self._notes[1] = number + 1
                try:
                    act(number)
                except KeyboardInterrupt:
                    raise
                except BaseException as error:
                    self._fail(number, error)
        self._notes[1] = 0

    def _fail(self, number: int, error: BaseException) -> None:
        words = str(self._code.caused(error))
        words = words.removeprefix(os.path.dirname(words.partition(":")[0]) + "/")
        self._failures[number] = words
        if self._is_for_all or len(self._failures) == len(self.tags):
            raise ControllerFailure(self.tags[number], self._name, words) from error
        self._swarm.rest(number)
        self._swarm.log(number, f"its controller has failed: {words}")

    def failures(self) -> dict[int, str]:
        """By tag why a controller has failed, whose robot stands since then."""
        return {self.tags[row]: words for row, words in self._failures.items()}

    def kernel(self) -> ProgramKernel | None:
        """Python decides in every timestep."""
        return None

    def end(self) -> None:
        """See `Program.end`."""
        if self._controllers is not None and hasattr(self._class, "end"):
            self._each(self._end_one)
        super().end()

    def _end_one(self, number: int) -> None:
        assert self._controllers is not None
        self._controllers[number].end()

    def complaints(self) -> list[str]:
        """See `Program.complaints`."""
        ours, theirs = f"controller '{_HOST}'", f"controller '{self._name}'"
        return [line.replace(ours, theirs, 1) for line in super().complaints()]


def _located(file: str, line: int, message: str) -> VsenseError:
    """Names a file as seen from the current folder, where that is shorter."""
    return SimError(f"{min(file, os.path.relpath(file), key=len)}:{line}: {message}")


def _module(file: Path) -> str:
    return f"vsense_controller_{file.stem}"


def _counts(table: Table, direction: Direction) -> dict[str, int]:
    """How many numbers the entries have, by name."""
    layouts = {e.name: e.layout for e in table.entries if e.direction == direction}
    return {n: int(layout.rpartition("*")[0] or 1) for n, layout in layouts.items()}


def _class_of(code: UsersCode, module: ModuleType) -> tuple[type[Any], bool]:
    """The class that controls robots, and whether it is one for all of them.

    Raises:
        SimError: there is none, or both; or a method of it is missing, or called something else.
    """
    own = {n: c for n, c in vars(module).items() if inspect.isclass(c)}
    there = [name for name in (ONE, ALL) if name in own]
    if len(there) != 1:
        words = f"has {'both' if there else 'neither'} of the classes {ONE} (one robot) and {ALL}"
        hint = "" if there else likely(ONE, own) or _loop_functions(module)
        raise code.error(1, f"{words} (all robots of the controller), expected one{hint}")
    found = own[there[0]]
    line = inspect.getsourcelines(found)[1] if hasattr(found, "__module__") else 1
    names = [name for name in vars(found) if not name.startswith("_")]
    for name, count in _METHODS.items():
        method = vars(found).get(name, getattr(found, name, None))
        if name == "step" and not callable(method):
            raise code.error(line, f"class {there[0]} has no method step{likely('step', names)}")
        if name in vars(found) and not _takes(method, count):
            given = "self" if count == 1 else "self and the robot, or the swarm"
            raise code.error(method.__code__.co_firstlineno, f"{name} takes {given}")
    return found, there[0] == ALL


def _takes(method: Any, count: int) -> bool:
    parameters = inspect.signature(method).parameters.values()
    placed = [p for p in parameters if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    needed = [p for p in placed if p.default is p.empty]
    any_more = any(p.kind is p.VAR_POSITIONAL for p in parameters)
    return len(needed) <= count and (any_more or count <= len(placed))


def _loop_functions(module: ModuleType) -> str:
    places = [module, *(c for c in vars(module).values() if inspect.isclass(c))]
    hooks = [hook for hook in _HOOKS if any(hasattr(place, hook) for place in places)]
    return f"; it has loop functions ({', '.join(hooks)})" if hooks else ""
