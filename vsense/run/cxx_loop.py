"""Loop functions in C++, for the hooks of a run: what they see of the world, and what they change.

The space that they see is theirs (`robot/argos/entities.hpp`). Before each call it is told where
the robots are, and after it the world takes over what has changed there.
"""

from __future__ import annotations

import math
import re
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from vsense.base.arena import Floats
from vsense.config.specs import Experiment, LoopSpec
from vsense.robots import build
from vsense.robots.link.table import Table
from vsense.robots.loop_library import Colors, CxxLoopError, LoopCaller
from vsense.robots.sources import ProgramSources
from vsense.run._loop_kernel import STEP_FUNCTIONS, FloorPainter, LoopFloor, LoopKernel
from vsense.run._loop_process import LoopProcess
from vsense.world.entities import (
    MAX_INTENSITY,
    Arena,
    Box,
    Cylinder,
    Entity,
    Led,
    Light,
    VirtualRobot,
    WorldError,
)
from vsense.world.fields import Floor
from vsense.world.loop_functions import STEPS
from vsense.world.world import NEVER_NS, World

PoseTuple = tuple[float, float, float]
Tables = Mapping[str, Table]
"""Sensor tables by a controller's id."""

_NO_NUMBERS = np.zeros(0)
_SCORE = re.compile(
    r"\s*(?:\[\w+\]\s*)?(?P<name>[A-Za-z_][\w /.-]*?)?\s*[:=]?\s*"
    r"(?P<value>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*"
)
"""A line that says nothing but a result: "12", "Score: 12", "Objective function result = 12"."""


@dataclass(frozen=True, slots=True)
class LoopHost:
    """Where loop functions in C++ run.

    Attributes:
        open: gives what calls a shared object of them.
        moves: whether robots and things go where the functions put them; a first try is told else.
        find: gives their shared object.
        begin: begins the controllers whose objects they use, before their Init, as ARGoS does.
    """

    open: Callable[[Path], LoopCaller] = LoopProcess
    moves: bool = False
    find: Callable[[ProgramSources], Path] = build.loop_functions
    begin: Callable[[Tables], None] = lambda tables: None


OBJECTIVE = "objective"
"""What a result is called that has no name."""


class CxxLoopFunctions:
    """The hooks of a run: those of `vsense.world.loop_functions.LoopFunctions`, called in C++.

    Attributes:
        steps, is_alive: both of them; they can be called.
        finished: they have said that the experiment is over.
        said: what they logged, and what is to be told, since the list was emptied.
        moved: by row of the robots, where they were put since the mapping was emptied.

    Raises:
        CxxLoopError: a function has failed; so with all hooks.
    """

    steps, robots_may_change = STEPS, False

    def __init__(
        self, experiment: Experiment, spec: LoopSpec, seed: int, host: LoopHost, tables: Tables
    ) -> None:
        """Makes them, and calls their Init; `spec` names a program."""
        assert spec.program is not None
        self._experiment, self._spec, self._seed = experiment, spec, seed
        self._caller, self._moves = host.open(host.find(spec.program)), host.moves
        self._begin_controllers = partial(host.begin, tables)
        self._lock = threading.RLock()
        self.is_alive, self.finished, self._answers = False, False, False
        self.said: list[str] = []
        self.moved: dict[int, PoseTuple] = {}
        self._reported: set[str] = set()
        self._pending: list[list[str]] | None = None
        self._measures: dict[str, float] = {}
        self._floor: LoopFloor | None = None
        address = self._caller.address
        self._kernel = LoopKernel(address, self._hear_floor) if address is not None else None
        self._painter = FloorPainter(self._colors, self._kernel)
        self._shown = np.zeros((0, 0, 3), dtype=np.uint8)
        self._begin()

    def renewed(self) -> CxxLoopFunctions:
        """Those for the next run: the same, which are reset."""
        return self

    def reset(self, world: World) -> None:
        """Takes over what Init did, or calls Reset; so does the world's floor."""
        if not self.is_alive:
            self._begin()
        elif self._pending is None:
            self.finished = False
            self._apply(world, self._call("Reset", [], self._rows(world)))
            if self._floor is not None:
                world.floor = self._floor
        self._apply(world, self._pending or [])
        self._pending = None

    def pre_step(self, world: World) -> None:
        """Calls PreStep."""
        self._step("PreStep", world)

    def post_step(self, world: World) -> None:
        """Calls PostStep, and asks whether the experiment is over."""
        self._step("PostStep", world)
        self._step("IsExperimentFinished", world)

    def end(self, world: World) -> dict[str, float]:
        """Calls PostExperiment and Destroy; returns what was reached.

        That is what the class gives in a function such as GetObjectiveFunction, and every line
        logged in PostExperiment that is a number, or a name and a number.
        """
        if not self.is_alive:
            return {}
        clock = [f"clock\t{max(world.run_timestep, -1) + 1}"]
        lines = self._call("PostExperiment", clock, self._rows(world))
        results = {name: float(value) for kind, name, value in _of(lines, "measure", 3)}
        for _, text in _of(lines, "log", 2):
            match = _SCORE.fullmatch(text)
            if match is not None and float(match["value"]) not in results.values():
                results[(match["name"] or OBJECTIVE).strip()] = float(match["value"])
        self._apply(world, lines)
        self._painter.end()
        self._apply(world, self._call("Destroy", [], _NO_NUMBERS))
        self.is_alive = self._answers = False
        self._caller.close()
        return {name: value for name, value in results.items() if math.isfinite(value)}

    def floor(self, arena: Arena, pixels_per_m: float) -> Floor:
        """Makes the floor that GetFloorColor gives."""
        size, centre = arena.size_m[:2], arena.centre_m[:2]
        painter, density = self._painter, pixels_per_m
        self._floor = LoopFloor(None, size, centre, painter=painter, pixels_per_m=density)
        return self._floor

    def _colors(self, points_m: Floats) -> Colors | None:
        """What GetFloorColor gives at points (n, 2): (n, 3)."""
        if not self._answers:
            return None
        with self._lock:
            said, colors = self._guarded("GetFloorColor", [], points_m)
        self._hear("GetFloorColor", said)
        return colors.reshape(-1, 3)

    def _hear_floor(self, said: str) -> None:
        self._hear("GetFloorColor", said)

    def kernel(self, world: World) -> Any:
        """The `struct vs_cxx *` that does both steps until an entity changes, where nothing is
        said and nobody was moved; None: they have to be called."""
        same = self._shown.shape == world.led_colors.shape and self._all_names(world) == self._sent
        if self._kernel is None or self.moved or not same or not self.is_alive:
            return None
        return self._kernel.follow(world, self._shown)

    def heard(self, world: World, function: int, is_called: bool) -> int:
        """Does what C has left of a step: a function, by its number, that was called and has said
        something, or that was not. Gives how many of a timestep's are done then."""
        name = STEP_FUNCTIONS[function]
        if is_called and self._kernel is not None:
            self._apply(world, self._hear(name, self._kernel.answer))
        else:
            self._step(name, world)
        if name == "PostStep":
            self._step("IsExperimentFinished", world)
        return 1 if name == "PreStep" else len(STEP_FUNCTIONS)

    def _begin(self) -> None:
        experiment = self._experiment
        self._names = [robot.id for robot in experiment.robots]
        places = [robot.pose or (0.0, 0.0, 0.0) for robot in experiment.robots]
        self._starts: Floats = np.array(places, dtype=np.float64).reshape(-1, 3)
        self._sent = names = [*self._names, *(robot.id for robot in experiment.virtual_robots)]
        poses = np.array([(r.x_m, r.y_m, r.yaw_rad) for r in experiment.virtual_robots])
        rows = np.concatenate([self._starts, poses.reshape(-1, 3)])
        self.is_alive = self._answers = True
        self._call("world", [*self._world(), "\t".join(("robots", *names))], _NO_NUMBERS)
        self._call("construct", [self._spec.label], _NO_NUMBERS)
        self._begin_controllers()
        settings = [f"|{line}" for line in self._spec.settings.splitlines()]
        self._pending = self._call("Init", settings, rows)
        for words in _of(self._pending, "robot", 6):
            self._move(words)

    def _world(self) -> list[str]:
        """What is there at the start."""
        experiment, arena = self._experiment, self._experiment.arena
        lines = [
            f"seed\t{self._seed % 2**32}",
            f"length\t{experiment.timesteps}",
            f"tick\t{experiment.timestep_s!r}",
            f"file\t{experiment.path}",
            f"moves\t{int(self._moves)}",
            _line("arena", "", *arena.size_m, *arena.centre_m).replace("\t\t", "\t"),
        ]
        lines += [f"model\t{robot.id}\t{robot.model.name}" for robot in experiment.robots]
        lines += [f"model\t{robot.id}\t{robot.model.name}" for robot in experiment.virtual_robots]
        return [*lines, *(line for e in experiment.entities if (line := _described(e)))]

    def _rows(self, world: World) -> Floats:
        """Where all robots are: where they were seen last, else where they start."""
        robots = world.robots
        rows = np.stack([robots["x_m"], robots["y_m"], robots["yaw_rad"]], axis=1)
        unseen = robots["capture_ns"][: len(self._starts)] == NEVER_NS
        rows[: len(self._starts)][unseen] = self._starts[unseen]
        for row, pose in self.moved.items():
            rows[row] = pose
        return rows.astype(np.float64)

    def _step(self, function: str, world: World) -> None:
        lines = [f"clock\t{world.run_timestep + 1}"]
        names = self._all_names(world)
        if names != self._sent:
            self._sent = names
            lines.append("\t".join(("robots", *names)))
            self._shown = np.zeros((0, 0, 3), dtype=np.uint8)
        lines += self._changed_leds(world)
        self._apply(world, self._call(function, lines, self._rows(world)))

    def _all_names(self, world: World) -> list[str]:
        """The ids of all robots, in the world's order."""
        return [*self._names, *(e.id for e in world.entities.values() if _is_robot(e))]

    def _changed_leds(self, world: World) -> list[str]:
        """Says what robots' LEDs show, where that is not what was said last."""
        colors = world.led_colors
        if self._shown.shape != colors.shape:
            self._shown = np.zeros_like(colors)
        changed = np.flatnonzero((colors != self._shown).any(axis=(1, 2)))
        self._shown[:] = colors  # C compares with it
        return [
            "\t".join(("shine", str(row), *map(str, colors[row].reshape(-1)))) for row in changed
        ]

    def _call(self, function: str, lines: Sequence[str], numbers: Floats) -> list[list[str]]:
        """Calls a function; gives the words of its answer's lines."""
        with self._lock:
            said, _ = self._guarded(function, lines, numbers)
        return self._hear(function, said)

    def _hear(self, function: str, said: str) -> list[list[str]]:
        """Gives the words of an answer's lines; keeps what was logged.

        Raises:
            CxxLoopError: something was thrown.
        """
        answer = [line.split("\t") for line in said.split("\n")]
        self.said += [text for _, text in _of(answer, "log", 2)]
        self.said += [f"error: {text}" for _, text in _of(answer, "logerr", 2)]
        for _, text in _of(answer, "error", 2):
            self.is_alive = False
            raise self._wrong(function, text.removeprefix("[FATAL] "))
        return answer

    def _guarded(self, function: str, lines: Sequence[str], numbers: Floats) -> tuple[str, Colors]:
        try:
            return self._caller.call(function, lines, numbers)
        except CxxLoopError as error:
            self.is_alive = self._answers = False
            raise CxxLoopError(f"{self._named()}: {error}") from None

    def _wrong(self, function: str, message: str) -> CxxLoopError:
        return CxxLoopError(f"{self._named()}: in {function}: {message}")

    def _named(self) -> str:
        return f"loop functions {self._spec.label!r} ({self._spec.path.name})"

    def _apply(self, world: World, lines: list[list[str]]) -> None:
        """Changes the world as an answer says."""
        for words in lines:
            if words[0] == "robot":
                self._move(words)
            elif words[0] == "finished":
                self.finished = True
            elif words[0] == "floor" and self._floor is not None:
                world.floor = self._floor
            elif words[0] in ("box", "cylinder", "light", "gone"):
                self._change(world, words)
        self._move_virtual(world)

    def _move(self, words: list[str]) -> None:
        """Puts a robot to a place in the simulation; a virtual one anywhere."""
        row = self._sent.index(words[1])
        pose = float(words[2]), float(words[3]), float(words[5])
        if self._moves or row >= len(self._names):
            self.moved[row] = pose
            if row < len(self._starts):
                self._starts[row] = pose
        else:
            self._tell_once("robots", "real robots stay where they are: MoveEntity of robots")

    def _move_virtual(self, world: World) -> None:
        for row in [row for row in self.moved if row >= len(self._names)]:
            x_m, y_m, yaw_rad = self.moved.pop(row)
            world.move(self._sent[row], x_m, y_m, yaw_rad)

    def _change(self, world: World, words: list[str]) -> None:
        """Puts, moves or removes what stands in the world, or a light."""
        name = words[1]
        entity = world.entities.get(name)
        if isinstance(entity, (Box, Cylinder)) and entity.physical and not self._moves:
            self._tell_once(name, f"{name!r} stands in the real arena: its change")
            return
        try:
            if words[0] != "gone":
                stands = entity.physical if isinstance(entity, (Box, Cylinder)) else self._moves
                world.rebuild(_entity(words, stands))
            elif entity is not None:
                world.tear_down(name)
        except WorldError as error:
            raise self._wrong("AddEntity or MoveEntity", str(error)) from None

    def _tell_once(self, about: str, words: str) -> None:
        if about not in self._reported:
            self._reported.add(about)
            self.said.append(f"{words} by the loop functions is passed over")


def _of(lines: list[list[str]], word: str, count: int) -> list[list[str]]:
    """The lines that begin with a word, as so many words."""
    return [words[:count] for words in lines if words[0] == word and len(words) >= count]


def _is_robot(entity: Entity) -> bool:
    return isinstance(entity, VirtualRobot)


def _line(kind: str, name: str, *numbers: float) -> str:
    return "\t".join((kind, name, *(repr(float(number)) for number in numbers)))


def _described(entity: Entity) -> str:
    """The line that tells loop functions of an entity; "": they do not see it."""
    if isinstance(entity, Box):
        place = *entity.position_m, entity.yaw_rad
        return _line("box", entity.id, *place, *entity.size_m, *_shining(entity))
    if isinstance(entity, Cylinder):
        size = entity.radius_m, entity.height_m
        return _line("cylinder", entity.id, *entity.position_m, 0.0, *size, *_shining(entity))
    if isinstance(entity, Light):
        return _line("light", entity.id, *entity.position_m, entity.intensity, *entity.color)
    return ""


def _shining(thing: Box | Cylinder) -> list[float]:
    """The LEDs of a thing, six numbers each."""
    return [number for led in thing.leds for number in (*led.offset_m, *led.color)]


def _leds(numbers: list[float]) -> tuple[Led, ...]:
    """The LEDs that these numbers describe."""
    rows = [numbers[first : first + 6] for first in range(0, len(numbers) - 5, 6)]
    return tuple(Led((x, y, z), (round(r), round(g), round(b))) for x, y, z, r, g, b in rows)


def _entity(words: list[str], physical: bool) -> Box | Cylinder | Light:
    """The entity that a line describes."""
    numbers = [float(word) for word in words[2:]]
    place = numbers[0], numbers[1], numbers[2]
    if words[0] == "box":
        size = numbers[4], numbers[5], numbers[6]
        return Box(words[1], place, size, numbers[3], physical, _leds(numbers[7:]))
    if words[0] == "cylinder":
        leds = _leds(numbers[6:])
        return Cylinder(words[1], place, numbers[4], numbers[5], physical, leds)
    color = round(numbers[4]), round(numbers[5]), round(numbers[6])
    return Light(words[1], place, min(max(numbers[3], 0.0), MAX_INTENSITY), color)
