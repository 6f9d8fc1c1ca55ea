"""ARGoS's controllers in Lua, run in this process: each robot has a state of Lua of its own.

What a script finds is made by `argos.lua`; here are its numbers, and what its mistakes cost.
"""

from __future__ import annotations

import os
import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from vsense.base.errors import failing_as, instead, require
from vsense.base.files import read_bytes
from vsense.robots import hosted
from vsense.robots._lua_devices import LuaActuators, LuaSensor, sensors_of
from vsense.robots.hosted import STEP_MAX_S, HostedProgram
from vsense.robots.inprocess import ProgramSetup, SimError
from vsense.robots.sources import ProgramSources

_TABLE = Path(__file__).with_name("argos.lua")
_LIMITS = ("vs:v_max",)
"""Of what a controller is told, what the robots below it have to know, too."""
_HOOKS = {"init": True, "step": True, "reset": False, "destroy": False}
"""Functions that ARGoS calls, and whether a robot stands without."""
_ESCAPED = {"n": "\n", "t": "\t"}


def build_program(program: ProgramSources) -> Path:
    """Gives the script, when what it needs is built; raises as `build.shared`.

    Raises:
        UsageError: the Python package that runs Lua is not installed.
    """
    require("controllers in Lua need", "lupa")
    hosted.build_host()
    return program.sources[0]


class ScriptError(Exception):
    """A script has failed; the words begin with its file and line."""


class LuaProgram(HostedProgram):
    """All robots of a run whose controller is a script for ARGoS; see `CompiledProgram`.

    A robot whose script fails stands, see `HostedProgram.each`.
    """

    def __init__(self, setup: ProgramSetup) -> None:
        """Reads the script; see `CompiledProgram`.

        Raises:
            SimError: it cannot be read, or is no Lua.
        """
        library, params = setup.library, setup.params
        told = [params if isinstance(params, str) else params[tag] for tag in setup.tags]
        own = ("".join(f"{k}={v}\n" for k, v in _lines(text) if k in _LIMITS) for text in told)
        super().__init__(replace(setup, params=dict(zip(setup.tags, own))))
        self._told, self._name_of_script = told, library.name.encode()
        self._folder = str(library.resolve().parent)
        with failing_as(SimError, f"{library}: cannot be read"):
            self._text = read_bytes(library)
        loaded = _new_state().eval(b"load")(self._text, b"@" + self._name_of_script)
        if isinstance(loaded, tuple):
            words = loaded[1].decode(errors="replace").removeprefix(library.name)
            raise SimError(f"{min(str(library), os.path.relpath(library), key=len)}{words}")
        self._states: list[Any] = []
        self._axle_cm = 0.0
        self._given: list[bytes] = []
        self._done: list[bytes] = []
        self._until_s = 0.0

    def begin(self) -> None:
        """See `Program.begin`."""
        super().begin()
        if self._states:
            return
        given, swarm = dict(_lines(self._told[0])), self.swarm
        declared = given.get("vs:sensors", "").split()
        two_radii_cm = float(given.get("vs:two_radii_cm", 7.0))
        heard_bytes = int(given.get("vs:heard_bytes", 4))
        self._sensors = sensors_of(swarm, declared, heard_bytes, two_radii_cm)
        declared, lamps = given.get("vs:actuators", "").split(), int(given.get("vs:lamps", 11))
        self._actuators = LuaActuators(swarm, declared, int(given.get("vs:said_bytes", 4)), lamps)
        self._axle_cm = float(given.get("vs:axle_cm", 5.3))
        table = _TABLE.read_bytes()
        self._states = [self._state(robot, told, table) for robot, told in enumerate(self._told)]
        self.each(self._begin_one)

    def _state(self, robot: int, told: str, table: bytes) -> Any:
        """Makes a robot's state of Lua; gives the functions of `table`, the text of `argos.lua`."""

        def log(words: bytes) -> None:
            for line in words.decode(errors="replace").split("\n"):
                self.swarm.log(robot, line)

        sensors = b"".join(sensor.line for sensor in self._sensors)
        seed = 1 + int(self.swarm.random_of(robot) * 2**53)
        given = dict(_lines(told)).get("vs:id", "").encode(), _params(told), sensors
        made = _new_state().execute(
            table, self._watch, log, *given, self._actuators.lines, seed, self._axle_cm
        )
        return made

    def _begin_one(self, robot: int) -> None:
        run, begin, *_ = self._states[robot]
        made = self._call(run, self._text, self._name_of_script, self._folder.encode())
        self._check_hooks(dict(line.rsplit(" ", 1) for line in made.decode().splitlines()))
        self._call(begin)

    def _check_hooks(self, lines: Mapping[str, str]) -> None:
        """Raises ScriptError where the script's functions, with their lines, lack some."""
        script = self._name_of_script.decode()
        for hook, is_needed in _HOOKS.items():
            alike = [name for name in lines if sorted(name.lower()) == sorted(hook)]
            if hook not in lines and (is_needed or alike):
                asked = instead(hook, alike or lines, "its functions are")
                line = next((lines[name] for name in lines if repr(name) in asked), 1)
                raise ScriptError(f"{script}:{line}: has no function {hook}(); {asked}")

    def act(self) -> None:
        """The scripts' part of a control step."""
        count = len(self.tags)
        self._given = _packed(self._sensors, count)
        self._done = [b""] * count
        self.each(self._step_one)
        goes_on = np.array([bool(done) for done in self._done])
        size = max(map(len, self._done))
        if size:
            numbers = b"".join(done or bytes(size) for done in self._done)
            values = np.frombuffer(numbers).reshape(count, -1)
            self._actuators.apply(values, goes_on)

    def _step_one(self, robot: int) -> None:
        self._done[robot] = self._call(self._states[robot][2], self._given[robot])

    def _call(self, function: Any, *arguments: bytes) -> Any:
        """What a function of `argos.lua` gives; raises ScriptError, or what the host has raised."""
        self._until_s = time.monotonic() + STEP_MAX_S
        given = function(*arguments)
        if not isinstance(given, tuple):
            return given
        _, why, raised = given
        if isinstance(raised, KeyboardInterrupt):
            raise raised
        words: str = why.decode(errors="replace") if isinstance(why, bytes) else str(why)
        raise ScriptError(words.replace(f"{self._folder}/", ""))

    def end(self) -> None:
        """See `Program.end`."""
        if self._begun:
            self.each(self._end_one)
        super().end()

    def _end_one(self, robot: int) -> None:
        self._call(self._states[robot][3])

    def _watch(self) -> None:
        """What a script that runs long calls: here a signal's handler may raise, too."""
        if time.monotonic() > self._until_s:
            raise TimeoutError(f"did not return within {STEP_MAX_S:g} s")


def _packed(sensors: Sequence[LuaSensor], count: int) -> list[bytes]:
    """What each of the robots is given: doubles, those that are lists last."""
    fixed = [sensor.values() for sensor in sensors if not sensor.is_list]
    data, size = np.hstack(fixed).tobytes() if fixed else b"", 8 * sum(f.shape[1] for f in fixed)
    given = [data[at : at + size] for at in range(0, size * count, size or 1)] or [b""] * count
    for sensor in sensors:
        if sensor.is_list:
            given = [before + more for before, more in zip(given, sensor.packed())]
    return given


def _new_state() -> Any:
    from lupa import lua53  # ARGoS's Lua on Debian and Ubuntu

    return lua53.LuaRuntime(encoding=None, register_eval=False, register_builtins=False)


def _lines(told: str) -> list[tuple[str, str]]:
    """The lines that a controller for ARGoS is sent: what is before the first "=", and behind."""
    return [(key, value) for key, _, value in (line.partition("=") for line in told.split("\n"))]


def _params(told: str) -> bytes:
    """The attributes of <params>, each name and value with a zero behind it."""
    depth, found = 0, []
    for key, value in _lines(told):
        depth += {"<": 1, ">": -1}.get(key, 0)
        if key.startswith("@") and depth == 1:
            plain = re.sub(r"\\(.)", lambda match: _ESCAPED.get(match[1], match[1]), value)
            found.append(f"{key[1:]}\0{plain}\0")
    return "".join(found).encode()
