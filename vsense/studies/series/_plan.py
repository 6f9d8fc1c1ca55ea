"""A plan: what is compared, where runs begin, how often, and when a run does not count.

It is written in TOML before the first run; `example.toml` explains every line. What a plan says is
checked as a whole before anything moves.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from vsense.base.toml import (
    Schema,
    TomlFile,
    boolean,
    integer,
    matching,
    read_toml_text,
    real,
    single_line,
)
from vsense.config.placement import StartPlaces
from vsense.run.runs_csv import MODES
from vsense.run.verdict import VoidCriteria

MOST_RUNS = 100_000


@dataclass(frozen=True, slots=True)
class Condition:
    """What runs are compared by.

    Attributes:
        name: as tables and figures have it.
        experiment: a shipped experiment's name, or the path of its file.
        controller: a library that drives the robots in place of the file's; "": the file's.
        settings: values by `ELEMENT.attribute` instead of the file's.
        blind: virtual sensors are held at 0.
        line: where it begins in the plan.
    """

    name: str
    experiment: str
    controller: str = ""
    settings: Mapping[str, str] = field(default_factory=dict)
    blind: bool = False
    line: int = 0


@dataclass(frozen=True, slots=True)
class PlannedStart:
    """Where runs begin; the same for every condition. `line` is where it begins in the plan."""

    name: str
    places: StartPlaces
    line: int = 0


@dataclass(frozen=True, slots=True)
class RobotRules:
    """What becomes of robots that cannot go on.

    Attributes:
        battery_v: whose battery has less before a run drives home and does not play; 0: whoever
            has any.
        least: a run begins with so many robots; None: with all.
        ready_s: they are waited for so long before a run.
        home: they drive to their starts between runs.
        virtual_walls: and around virtual walls.
    """

    battery_v: float = 0.0
    least: int | None = None
    ready_s: float = 60.0
    home: bool = True
    virtual_walls: bool = False


@dataclass(frozen=True, slots=True)
class SeriesPlan:
    """A series.

    Attributes:
        path: of the file.
        mode: of `MODES`.
        duration_s: length of a run, None: the experiment's.
        count: so many robots of each experiment play, see `Casting.limit`; None: all.
        repetitions: of every condition at every start.
        seed: of the order of runs, and of the runs' own seeds.
        again: a void run is repeated so often.
        void: when a run does not count.
    """

    path: Path
    name: str
    mode: str
    conditions: tuple[Condition, ...]
    starts: tuple[PlannedStart, ...]
    repetitions: int = 1
    seed: int = 1
    duration_s: float | None = None
    count: int | None = None
    again: int = 2
    void: VoidCriteria = field(default_factory=VoidCriteria)
    robots: RobotRules = field(default_factory=RobotRules)

    @property
    def runs(self) -> int:
        """How many valid runs there are in the end."""
        return len(self.conditions) * len(self.starts) * self.repetitions

    def facts(self) -> dict[str, Any]:
        """All that it says, by name and without its layout, for JSON.

        It is the same in whatever folder the command is called, and where the plan's is moved.
        """
        facts = asdict(self)
        del facts["path"]
        for table in (*facts["conditions"], *facts["starts"]):
            del table["line"]
        for table in facts["conditions"]:
            for name in ("experiment", "controller"):
                table[name] = self.beside(table[name])
        plain: dict[str, Any] = json.loads(json.dumps(facts))
        return plain

    def beside(self, file: str) -> str:
        """A file in the plan's folder as seen from there, another one by its absolute path.

        What is no file is a name, and stays.
        """
        if not os.path.isfile(file):
            return file
        inside = os.path.relpath(file, self.path.parent)
        return os.path.abspath(file) if inside.startswith(os.pardir) else inside

    def condition(self, name: str) -> Condition:
        """The condition of a name."""
        return next(condition for condition in self.conditions if condition.name == name)

    def start(self, name: str) -> PlannedStart:
        """The start of a name."""
        return next(start for start in self.starts if start.name == name)


def _mode(value: Any) -> str:
    if value not in MODES:
        raise ValueError(f"one of {', '.join(MODES)}")
    return str(value)


def _poses(value: Any) -> tuple[tuple[float, float, float], ...]:
    expected = "a list of [x in m, y in m, heading in degrees], one for each robot"
    if not isinstance(value, list) or not value:
        raise ValueError(expected)
    poses = []
    for pose in value:
        is_pose = isinstance(pose, list) and len(pose) == 3
        if not is_pose or not all(type(n) in (int, float) and abs(n) < 1e4 for n in pose):
            raise ValueError(expected)
        poses.append((float(pose[0]), float(pose[1]), math.radians(pose[2])))
    return tuple(poses)


def _unread(value: Any) -> Any:
    """For values that `_settings` reads, which knows their lines."""
    return value


_NAME = matching(r"\w[\w.+-]{0,59}", "letters, digits and . _ + -, at most 60 of them")
_TEXT = single_line()
_SEED = integer(1, 2**32 - 1)

_CONDITION: Schema = {
    "name": _TEXT,
    "experiment": _TEXT,
    "controller": _TEXT,
    "blind": boolean,
    "settings": _unread,
}
_VOID: Schema = {
    "lost_s": real(0.1, 1e6, " s"),
    "moved_mm": real(5.0, 1e4, " mm"),
    "fenced_s": real(0.0, 1e6, " s"),
    "late": real(0.0, 1.0, ", a share"),
    "ended_early": boolean,
    "away_from_start": boolean,
}
_ROBOTS: Schema = {
    "count": integer(1, 10_000),
    "battery_v": real(0.0, 10.0, " V"),
    "least": integer(1, 10_000),
    "ready_s": real(1.0, 1e5, " s"),
    "home": boolean,
    "virtual_walls": boolean,
}
_PLAN: Schema = {
    "name": _NAME,
    "mode": _mode,
    "experiment": _TEXT,
    "duration_s": real(0.1, 1e7, " s"),
    "repetitions": integer(1, 10_000),
    "seed": _SEED,
    "again": integer(0, 1000),
    "settings": _unread,
    "condition": [_CONDITION],
    "start": [{"name": _NAME, "seed": _SEED, "poses": _poses}],
    "void": _VOID,
    "robots": _ROBOTS,
}


def read(path: Path, mode: str | None = None) -> SeriesPlan:
    """Reads a plan; `mode` takes the place of its own.

    Raises:
        UsageError: it cannot be read.
        ConfigError: something in it is wrong; the message has its line.
    """
    file = TomlFile(path, read_toml_text(path))
    values = file.read(_PLAN)
    if mode is not None:
        values["mode"] = mode
    if values.get("mode") not in MODES:
        raise file.error(f"no mode: expected one of {', '.join(MODES)}", "mode")
    for kind in ("condition", "start"):
        if not values.get(kind):
            raise file.error(f"expected a table [[{kind}]] for each {kind}", kind)
    rules = values.get("robots", {})
    count = rules.pop("count", None)
    optional = ("repetitions", "seed", "duration_s", "again")
    plan = SeriesPlan(
        path,
        values.get("name", path.stem),
        values["mode"],
        _conditions(file, values, path.parent),
        _starts(file, values),
        **{name: values[name] for name in optional if name in values},
        count=count,
        void=VoidCriteria(**values.get("void", {})),
        robots=RobotRules(**rules),
    )
    if plan.runs > MOST_RUNS:
        raise file.error(f"{plan.runs} runs: at most {MOST_RUNS}", "repetitions")
    return plan


def _conditions(file: TomlFile, values: Mapping[str, Any], folder: Path) -> tuple[Condition, ...]:
    common = _settings(file, values, "settings")
    conditions = []
    for number, table in enumerate(values["condition"]):
        experiment = table.get("experiment", values.get("experiment"))
        if experiment is None:
            words = 'no experiment: add experiment = "FILE.argos"'
            raise file.error(words, "condition", number)
        own = _settings(file, table, "condition", number, "settings")
        blind = table.get("blind", False)
        conditions.append(
            Condition(
                table.get("name") or _named_by(own, blind, number),
                _placed(experiment, folder),
                _placed(table.get("controller", ""), folder),
                {**common, **own},
                blind,
                file.line("condition", number),
            )
        )
    _distinct(file, "condition", [condition.name for condition in conditions])
    return tuple(conditions)


def _starts(file: TomlFile, values: Mapping[str, Any]) -> tuple[PlannedStart, ...]:
    starts = []
    for number, table in enumerate(values["start"]):
        if "seed" not in table and "poses" not in table:
            raise file.error("expected a seed, or poses", "start", number)
        places = StartPlaces(table.get("seed", 1), table.get("poses", ()))
        name = table.get("name", f"start{number + 1}")
        starts.append(PlannedStart(name, places, file.line("start", number)))
    _distinct(file, "start", [start.name for start in starts])
    return tuple(starts)


def _distinct(file: TomlFile, kind: str, names: Sequence[str]) -> None:
    for number, name in enumerate(names):
        if name in names[:number]:
            raise file.error(f"a second {kind} called {name!r}", kind, number, "name")


def _settings(file: TomlFile, table: Mapping[str, Any], *position: str | int) -> dict[str, str]:
    """Settings as the command line has them."""
    given, expected = table.get("settings", {}), 'expected "ELEMENT.attribute" = value'
    if not isinstance(given, dict):
        raise file.error(f"settings: {expected}", *position)
    settings = {}
    for key, value in given.items():
        if isinstance(value, bool):
            value = "true" if value else "false"
        if not isinstance(value, str | int | float) or "." not in key:
            words = f"settings: {expected}, got {key} = {value!r}"
            raise file.error(words[:200], *position, key)
        settings[key] = str(value)
    return settings


def _named_by(settings: Mapping[str, str], blind: bool, number: int) -> str:
    """The name of a condition that nobody named; one line, as tables give it back."""
    words = [f"{key}={value}" for key, value in settings.items()]
    name = ", ".join([*(["blind"] if blind else []), *words]) or f"condition{number + 1}"
    return " ".join(name.split())


def _placed(name: str, folder: Path) -> str:
    """A file beside the plan, or a name as it is."""
    beside = folder / name
    return str(beside) if name and os.path.isfile(beside) else name
