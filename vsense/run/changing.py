"""Changes of a running experiment: which there are, how they are carried out, and limits.

A `Change` is requested by people; `carry_out` makes it, in the thread of the timesteps and between
two of them. The same changes before the same timesteps make the same world again.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

from vsense.base.errors import instead
from vsense.run.environment import Environment
from vsense.run.orders import OrderError
from vsense.world.entities import (
    Box,
    Cylinder,
    Entity,
    Light,
    VirtualRobot,
    Zone,
    moved,
)
from vsense.world.fields import Field
from vsense.world.sensors.quality import QUALITY_SETTINGS

MAX_TEXT = 200
MAX_VALUE = 1e9
MOST_ROBOTS = 200
"""Virtual robots that people may put into one world."""


class ChangeKind(str, Enum):
    """What is done: to a thing, or to a sensor, a field or the experiment's parameters (SET)."""

    MOVE = "move"
    SET = "set"
    ADD = "add"
    REMOVE = "remove"


_TEXTS, _NUMBERS = ("name", "controller", "setting"), ("x_m", "y_m", "yaw_rad")
_FIELDS: Mapping[ChangeKind, tuple[tuple[str, ...], tuple[str, ...]]] = {
    ChangeKind.MOVE: (("name", "x_m", "y_m"), ("yaw_rad", "final")),
    ChangeKind.SET: (("setting", "value"), ("name", "controller")),
    ChangeKind.ADD: (("x_m", "y_m"), ("name", "yaw_rad")),
    ChangeKind.REMOVE: (("name",), ()),
}
"""The required and the optional fields of each kind."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """A change of the world that is requested.

    Attributes:
        name: id of a thing, a field or a sensor; SET of "": a parameter of the loop functions.
        controller: whose sensor; "": it is no sensor.
        setting, value: of SET.
        x_m, y_m, yaw_rad: of MOVE and ADD, arena frame; without yaw_rad a thing keeps its turn.
        final: not in the middle of a drag.
    """

    kind: ChangeKind
    name: str = ""
    controller: str = ""
    setting: str = ""
    value: float | str = 0.0
    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float | None = None
    final: bool = True

    @classmethod
    def read(cls, data: object) -> Change:
        """Reads what `data` gives, from anybody; the text of a ValueError is for people."""
        if not isinstance(data, Mapping):
            raise ValueError(f"a change is an object, not {data!r:.40}")
        kinds = [kind.value for kind in ChangeKind]
        if data.get("kind") not in kinds:
            raise ValueError(f"a change's kind is {data.get('kind')!r:.40}; {instead('', kinds)}")
        kind = ChangeKind(data["kind"])
        needed, more = _FIELDS[kind]
        for name in data:
            if name not in ("kind", *needed, *more):
                raise ValueError(f"{kind.value}: has no {name!r:.40}")
        for name in needed:
            if name not in data:
                raise ValueError(f"{kind.value}: has to say {name!r}")
        return cls(kind=kind, **{n: _checked(n, data[n]) for n in data if n != "kind"})

    def data(self) -> dict[str, Any]:
        """The change as JSON holds it."""
        needed, more = _FIELDS[self.kind]
        return {"kind": self.kind.value, **{name: getattr(self, name) for name in (*needed, *more)}}


def _checked(name: str, value: object) -> Any:
    """One value of a change; ValueError where it is of another kind, or too large."""
    if name == "final" and isinstance(value, bool):
        return value
    if name == "yaw_rad" and value is None:
        return None
    if isinstance(value, str) and name in (*_TEXTS, "value"):
        if len(value) > MAX_TEXT or not (value.isprintable() or not value):
            raise ValueError(f"{name}: {value!r:.40} is no text of at most {MAX_TEXT} characters")
        return value
    plain = isinstance(value, (int, float)) and not isinstance(value, bool)
    if plain and name in (*_NUMBERS, "value") and abs(value) <= MAX_VALUE:  # type: ignore[arg-type]
        return float(value)  # type: ignore[arg-type]
    raise ValueError(f"{name} is {value!r:.40}, expected {_expected(name)}")


def _expected(name: str) -> str:
    if name == "final":
        return "true or false"
    return "a text" if name in _TEXTS else f"a number of at most {MAX_VALUE:g}"


@dataclass(frozen=True, slots=True)
class Ground:
    """What of the real arena follows.

    Attributes:
        put: puts the tagged object of a row of the experiment's at x, y [m] and yaw [rad]; None:
            only hands can.
        rebuilds: what robots drive against can be moved, too.
    """

    put: Callable[[int, float, float, float], None] | None = None
    rebuilds: bool = False


HANDS = Ground()
"""What is real is moved by people's hands."""


def carry_out(change: Change, environment: Environment, ground: Ground = HANDS) -> str:
    """Changes the world; gives what was done in words. Not in the middle of a timestep.

    Raises:
        VsenseError: it cannot be; nothing has changed.
    """
    if change.kind is ChangeKind.MOVE:
        return _move(change, environment, ground)
    if change.kind is ChangeKind.ADD:
        return _add(change, environment)
    if change.kind is ChangeKind.REMOVE:
        return _remove(change, environment)
    if change.controller:
        return _set_quality(change, environment)
    return _set(change, environment) if change.name else _set_parameter(change, environment)


def _move(change: Change, environment: Environment, ground: Ground) -> str:
    world, x_m, y_m = environment.world, change.x_m, change.y_m
    _check_place(environment, change.name, x_m, y_m)
    objects = [thing.id for thing in environment.experiment.objects]
    if change.name in objects:
        if ground.put is None:
            raise OrderError(f"{change.name!r} is real: carry it by hand, the cameras see it")
        yaw_rad = _yaw(environment, objects.index(change.name), change.yaw_rad)
        ground.put(objects.index(change.name), x_m, y_m, yaw_rad)
    elif change.name in [robot.id for robot in environment.experiment.robots]:
        raise OrderError(f"{change.name!r} is a robot that drives by itself: carry it by hand")
    elif _is_physical(world.entities.get(change.name)) and ground.rebuilds:
        world.rebuild(moved(world.entities[change.name], x_m, y_m, change.yaw_rad))
    elif change.name not in world.entities:
        hint = instead(change.name, [*world.entities, *objects])
        raise OrderError(f"there is no {change.name!r} in the world; {hint}")
    else:
        world.move(change.name, x_m, y_m, change.yaw_rad)
    return f"{change.name} is at {x_m:.2f}, {y_m:.2f} m"


def _check_place(environment: Environment, name: str, x_m: float, y_m: float) -> None:
    arena = environment.experiment.arena
    if not arena.contains(x_m, y_m):
        width_m, height_m = arena.size_m[:2]
        raise OrderError(
            f"{name}: {x_m:g}, {y_m:g} m is outside of the arena of {width_m:g} x {height_m:g} m"
        )


def _yaw(environment: Environment, row: int, yaw_rad: float | None) -> float:
    """The wanted turn of a tagged object, or its present one."""
    pose = environment.world.pose(environment.experiment.objects[row].tag)
    return yaw_rad if yaw_rad is not None else 0.0 if pose is None else float(pose["yaw_rad"])


def _is_physical(thing: Entity | None) -> bool:
    return isinstance(thing, (Box, Cylinder)) and thing.physical


def _add(change: Change, environment: Environment) -> str:
    """Puts a virtual robot that stands where it was put, or that loop functions move."""
    world = environment.world
    _check_robots(environment)
    robots = [thing for thing in world.entities.values() if isinstance(thing, VirtualRobot)]
    if len(robots) >= MOST_ROBOTS:
        raise OrderError(f"there are {len(robots)} virtual robots already")
    number = len(robots) + 1
    while (name := change.name or f"visitor {number}") in world.entities and not change.name:
        number += 1
    spec = environment.experiment
    bodies = [*(robot.id for robot in spec.robots), *(thing.id for thing in spec.objects)]
    if name in world.entities or name in bodies:
        raise OrderError(f"there is a {name!r} already")
    _check_place(environment, name, change.x_m, change.y_m)
    world.put(VirtualRobot(name, world.free_tag, change.x_m, change.y_m, change.yaw_rad or 0.0))
    return f"{name} stands at {change.x_m:.2f}, {change.y_m:.2f} m: a virtual robot"


def _check_robots(environment: Environment) -> None:
    if not environment.robots_may_change:
        raise OrderError(
            "the experiment's loop functions may count the robots: none can come or go while it"
            " runs, unless they say robots_may_change = True"
        )


def _remove(change: Change, environment: Environment) -> str:
    thing = environment.world.entities.get(change.name)
    if thing is not None and not isinstance(thing, VirtualRobot):
        raise OrderError(f"{change.name!r} is no virtual robot: only these can be removed")
    if thing is not None:
        _check_robots(environment)
    environment.world.remove(change.name)
    return f"{change.name} is taken away"


def _number(change: Change) -> float:
    if isinstance(change.value, str):
        raise OrderError(f"{change.setting} is {change.value!r:.40}, expected a number")
    return change.value


def _set_quality(change: Change, environment: Environment) -> str:
    if environment.blind:
        raise OrderError(f"{change.name}: this run is without virtual sensors: they are held at 0")
    banks = {part.controller: part.sensors for part in environment.equipment}
    if change.controller not in banks:
        hint = instead(change.controller, banks)
        raise OrderError(f"there is no controller {change.controller!r}; {hint}")
    value = _number(change)
    banks[change.controller].set_quality(change.name, change.setting, value)
    return f"{change.setting} of {change.name} ({change.controller}) is {value:g}"


_SETTABLE: Mapping[type, tuple[str, ...]] = {
    Light: ("intensity",),
    Zone: ("radius_m", "value"),
    Cylinder: ("radius_m",),
    Field: ("evaporation_per_s", "diffusion_m2_s"),
}


def _set(change: Change, environment: Environment) -> str:
    """Changes a number of a thing or of a field."""
    world, name = environment.world, change.name
    things: dict[str, Any] = {**world.fields, **world.entities}
    if name not in things:
        raise OrderError(f"there is no {name!r} in the world; {instead(name, things)}")
    thing, value = things[name], _number(change)
    settable = _SETTABLE.get(type(thing), ())
    if isinstance(thing, Zone) and thing.shape != "circle":
        settable = tuple(number for number in settable if number != "radius_m")
    if change.setting not in settable:
        hint = instead(change.setting, settable) if settable else "nothing of it can be set"
        raise OrderError(f"{name!r} has no {change.setting!r} to be set; {hint}")
    if isinstance(thing, Field):
        thing.set_rate(change.setting, value, world.timestep_s)
    else:
        world.put(replace(thing, **{change.setting: value}))
    return f"{change.setting} of {name} is {value:g}"


def _set_parameter(change: Change, environment: Environment) -> str:
    """Changes what loop functions in Python find in `world.params`, a text."""
    params, name = environment.world.params, change.setting
    if not params:
        raise OrderError(
            "the experiment has no parameters that can be changed while it runs: controllers and"
            " loop functions in C++ read theirs at the start, with --set"
        )
    if name not in params:
        raise OrderError(f"there is no parameter {name!r}; {instead(name, params)}")
    value = change.value if isinstance(change.value, str) else f"{change.value:.17g}"
    _check_parameter(name, params[name], value, environment)
    params[name] = value
    return f"parameter {name} is {value}"


def _check_parameter(name: str, before: str, value: str, environment: Environment) -> None:
    """Refuses what cannot mean the same as before: loop functions that fail end the run."""
    for kind, named in _kinds(environment).items():
        if before in named and value not in named:
            raise OrderError(
                f"parameter {name} names {before!r}, a {kind}; there is no {kind} {value!r:.60};"
                f" {instead(value, named)}"
            )
    drives = Counter(environment.world.controllers.values())
    if drives[before] != drives[value] and before in drives and not environment.robots_may_change:
        raise OrderError(
            f"parameter {name}: {before!r} drives {drives[before]} robots and {value!r}"
            f" {drives[value]}; the experiment's loop functions may count them"
        )
    for read, what in ((int, "whole number"), (float, "number")):
        if _reads(read, before) and not _reads(read, value):
            more = f"; write {before}.0 in its file for fractions" if read is int else ""
            raise OrderError(f"parameter {name} is the {what} {before}, not {value!r:.60}{more}")


def _kinds(environment: Environment) -> dict[str, set[str]]:
    """What parameters may name, by what it is."""
    spec, world = environment.experiment, environment.world
    kinds = {
        "field": set(world.fields),
        "robot": {robot.id for robot in spec.robots},
        "object": {thing.id for thing in spec.objects},
        "controller": {controller.id for controller in spec.controllers},
    }
    for name, thing in world.entities.items():
        kind = "virtual robot" if isinstance(thing, VirtualRobot) else type(thing).__name__.lower()
        kinds.setdefault(kind, set()).add(name)
    return kinds


def _reads(read: Callable[[str], float], text: str) -> bool:
    """Whether a text is a finite number, as `read` reads it."""
    try:
        return math.isfinite(read(text))
    except (ValueError, OverflowError):
        return False


def settings_of(environment: Environment, ground: Ground, locked: bool) -> dict[str, Any]:
    """What can be changed, and how it is now: the data of `/settings`."""
    world = environment.world
    sensors = [
        {"controller": part.controller, "name": name}
        | {setting: getattr(quality, setting) for setting in QUALITY_SETTINGS}
        for part in environment.equipment
        for name, quality in part.sensors.qualities.items()
    ]
    rates = _SETTABLE[Field]
    return {
        "locked": locked,
        "objects": ground.put is not None,
        "solids": ground.rebuilds,
        "sensors": [] if environment.blind else sensors,
        "fields": [
            {"id": field.id} | {rate: getattr(field, rate) for rate in rates}
            for field in world.fields.values()
        ],
        "params": dict(world.params),
        "things": {kind.__name__.lower(): list(names) for kind, names in _SETTABLE.items()},
    }
