"""Controllers in Python, run in this process: a file's class decides for robots that C runs."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

from vsense.base.errors import VsenseError, likely
from vsense.base.users_code import UsersCode
from vsense.robots import hosted
from vsense.robots.hosted import HostedProgram
from vsense.robots.inprocess import ProgramSetup, SimError
from vsense.robots.python_robot import Robot
from vsense.robots.sources import ProgramSources

ONE, ALL = "Controller", "SwarmController"
"""The classes of which a file has one."""
_METHODS = {"__init__": 2, "step": 2, "end": 1}
"""What they have, and how many arguments each takes, with itself."""
_HOOKS = ("populate", "reset", "pre_step", "post_step", "end")
"""By which a file of loop functions is known."""


def build_program(program: ProgramSources) -> Path:
    """Gives the file to be opened, when what it needs is built; raises as `build.shared`."""
    hosted.build_host()
    return program.sources[0]


class PythonProgram(HostedProgram):
    """All robots of a run whose controller is a file in Python; see `CompiledProgram`.

    A robot whose controller raises an exception stands, see `HostedProgram.each`.
    """

    def __init__(self, setup: ProgramSetup) -> None:
        """Runs the file; see `CompiledProgram`.

        Raises:
            SimError: it cannot be read, fails, or has no class that controls robots.
        """
        super().__init__(setup)
        library = setup.library
        self._code = UsersCode(library, _located)
        self._class, self._is_for_all = _class_of(self._code, self._code.load(_module(library)))
        self._controllers: list[Any] | None = None
        self._views: list[Any] = [self.swarm]
        if not self._is_for_all:
            self._views = [Robot(self.swarm, row) for row in range(len(self.tags))]

    def begin(self) -> None:
        """See `Program.begin`."""
        super().begin()
        if self._controllers is None:
            self._controllers = [None] * len(self._views)
            self._each(self._make)

    def _make(self, number: int) -> None:
        assert self._controllers is not None
        self._controllers[number] = self._class(self._views[number])

    def act(self) -> None:
        """The file's part of a control step."""
        self._each(self._step_one)

    def _step_one(self, number: int) -> None:
        assert self._controllers is not None
        self._controllers[number].step(self._views[number])

    def _each(self, act: Callable[[int], None]) -> None:
        with self._code.beside():
            self.each(act, self._is_for_all)

    def explained(self, error: BaseException) -> str:
        """See `HostedProgram.explained`."""
        words = str(self._code.caused(error))
        return words.removeprefix(os.path.dirname(words.partition(":")[0]) + "/")

    def end(self) -> None:
        """See `Program.end`."""
        if self._controllers is not None and hasattr(self._class, "end"):
            self._each(self._end_one)
        super().end()

    def _end_one(self, number: int) -> None:
        assert self._controllers is not None
        self._controllers[number].end()


def _located(file: str, line: int, message: str) -> VsenseError:
    """Names a file as seen from the current folder, where that is shorter."""
    return SimError(f"{min(file, os.path.relpath(file), key=len)}:{line}: {message}")


def _module(file: Path) -> str:
    return f"vsense_controller_{file.stem}"


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
