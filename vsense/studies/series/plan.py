"""A plan: what is compared, where runs begin, how often, and when a run does not count.

It is written in TOML before the first run; `example.toml` explains every line. What a plan says is
checked as a whole before anything moves.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from vsense.base.errors import UsageError
from vsense.base.files import read_text
from vsense.config.roster_text import parse
from vsense.config.starting import StartPlaces
from vsense.run.runs_csv import MODES
from vsense.studies.series import fields
from vsense.studies.series.criteria import VoidCriteria
from vsense.studies.series.fields import PlanText

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
        count: only the first so many robots of each experiment play, None: all.
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
        told = asdict(self)
        del told["path"]
        for table in (*told["conditions"], *told["starts"]):
            del table["line"]
        for table in told["conditions"]:
            for name in ("experiment", "controller"):
                table[name] = self.beside(table[name])
        plain: dict[str, Any] = json.loads(json.dumps(told))
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


def read(path: Path, mode: str | None = None) -> SeriesPlan:
    """Reads a plan; `mode` takes the place of its own.

    Raises:
        UsageError: it cannot be read.
        ConfigError: something in it is wrong; the message has its line.
    """
    try:
        text = read_text(path, "utf-8-sig")  # as editors of some systems write it
    except OSError as error:
        raise UsageError(f"cannot read {path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise UsageError(f"cannot read {path}: it is no text") from None
    source = PlanText(path, text)
    told = source.table("", None, parse(path, text), fields.PLAN)
    if mode is not None:
        told["mode"] = mode
    if told.get("mode") not in MODES:
        raise source.error("", None, "mode", f"no mode: expected one of {', '.join(MODES)}")
    conditions = _conditions(source, told, path.parent)
    starts = _starts(source, told)
    named = {name: told[name] for name in ("repetitions", "seed", "duration_s") if name in told}
    rules = source.table("robots", None, told.get("robots", {}), fields.ROBOTS)
    count = rules.pop("count", None)
    plan = SeriesPlan(
        path,
        told.get("name", path.stem),
        told["mode"],
        conditions,
        starts,
        **named,
        count=count,
        again=told.get("again", 2),
        void=VoidCriteria(**source.table("void", None, told.get("void", {}), fields.VOID)),
        robots=RobotRules(**rules),
    )
    if plan.runs > MOST_RUNS:
        raise source.error("", None, "repetitions", f"{plan.runs} runs: at most {MOST_RUNS}")
    return plan


def _conditions(source: PlanText, told: Mapping[str, Any], folder: Path) -> tuple[Condition, ...]:
    common = _texts(source, "settings", None, told.get("settings", {}))
    tables = _tables(source, told, "condition")
    found = []
    for number, table in enumerate(tables):
        values = source.table("condition", number, table, fields.CONDITION)
        experiment = values.get("experiment", told.get("experiment"))
        if experiment is None:
            raise source.error(
                "condition", number, "", 'no experiment: add experiment = "FILE.argos"'
            )
        own = _texts(source, "condition", number, values.get("settings", {}))
        name = values.get("name") or _named_by(own, values.get("blind", False), number)
        found.append(
            Condition(
                name,
                _placed(experiment, folder),
                _placed(values.get("controller", ""), folder),
                {**common, **own},
                values.get("blind", False),
                source.line("condition", number),
            )
        )
    _distinct(source, "condition", [condition.name for condition in found])
    return tuple(found)


def _starts(source: PlanText, told: Mapping[str, Any]) -> tuple[PlannedStart, ...]:
    found = []
    for number, table in enumerate(_tables(source, told, "start")):
        values = source.table("start", number, table, fields.START)
        if "seed" not in values and "poses" not in values:
            raise source.error("start", number, "", "expected a seed, or poses")
        places = StartPlaces(values.get("seed", 1), values.get("poses", ()))
        name = values.get("name", f"start{number + 1}")
        found.append(PlannedStart(name, places, source.line("start", number)))
    _distinct(source, "start", [start.name for start in found])
    return tuple(found)


def _tables(source: PlanText, told: Mapping[str, Any], name: str) -> Sequence[Mapping[str, Any]]:
    tables = told.get(name)
    if not isinstance(tables, list) or not tables:
        raise source.error(name, None, "", f"expected a table [[{name}]] for each {name}")
    return tables


def _distinct(source: PlanText, kind: str, names: Sequence[str]) -> None:
    for number, name in enumerate(names):
        if name in names[:number]:
            raise source.error(kind, number, "name", f"a second {kind} called {name!r}")


def _texts(source: PlanText, table: str, number: int | None, given: Any) -> dict[str, str]:
    """Settings as the command line has them."""
    if not isinstance(given, dict):
        raise source.error(table, number, "settings", 'expected "ELEMENT.attribute" = value')
    found = {}
    for key, value in given.items():
        if isinstance(value, bool):
            value = "true" if value else "false"
        if not isinstance(value, str | int | float) or "." not in key:
            words = f'settings: expected "ELEMENT.attribute" = value, got {key} = {value!r}'
            named = source.line(table, number, key) != source.line(table, number)
            place = key if named else "settings"  # in one line with the table that it is of
            raise source.error(table, number, place, words[:200])
        found[key] = str(value)
    return found


def _named_by(settings: Mapping[str, str], blind: bool, number: int) -> str:
    """The name of a condition that nobody named; one line, as tables give it back."""
    words = [f"{key}={value}" for key, value in settings.items()]
    name = ", ".join([*(["blind"] if blind else []), *words]) or f"condition{number + 1}"
    return " ".join(name.split())


def _placed(name: str, folder: Path) -> str:
    """A file beside the plan, or a name as it is."""
    beside = folder / name
    return str(beside) if name and beside.is_file() else name
