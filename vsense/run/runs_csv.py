"""runs.csv: a row for each run, in the same columns for simulations, labs and real robots."""

from __future__ import annotations

import csv
import io
import os
import platform
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from vsense import __version__
from vsense.base.errors import UsageError, VsenseError
from vsense.base.files import read_bytes, replace_text, stamp_of
from vsense.config.specs import Experiment
from vsense.robots import build
from vsense.run.verdict import VALID, VOID, late_share

RUNS = "runs.csv"
"""Its name in the folder of a run or of several."""

COLUMNS = (
    "run", "series", "mode", "experiment", "condition", "block", "repetition", "start", "seed",
    "began", "duration_s", "robots", "tags", "uids", "batteries_v", "light_level", "late",
    "versions", "verdict", "why", "note",
)  # fmt: skip
"""The columns that every table begins with."""

OPTIONAL = ("longest_silence_s", "signal_dbm", "power_saving")
"""Columns that a table has where some run has a value in them; all others are measures."""

FORMER = ("campaign", "experiment")
"""The columns that tables of campaigns began with before there was a runs.csv."""

MODES = ("sim", "lab", "run")
_MOST_BYTES = 4 << 30
_Kinds = Mapping[str, Callable[[str], Any]]
_NUMBERS: _Kinds = {
    "seed": int, "duration_s": float, "robots": int, "light_level": float, "late": float,
    "longest_silence_s": float, "signal_dbm": int,
}  # fmt: skip
_LISTS: _Kinds = {"tags": int, "uids": str, "batteries_v": float, "power_saving": int}
_WRITTEN: Mapping[str, Any] = {"encoding": "utf-8", "errors": "backslashreplace"}
"""How the file is written: an argument that is no UTF-8 costs no row."""
_KINDS = {int: "a whole number", float: "a number"}


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRow:
    """One run; "", None and () are unknown.

    Attributes:
        run: its name, which no other run of the series has.
        series: the name of the series.
        mode: of `MODES`.
        condition: what is compared, in words.
        block, repetition, start: runs of two conditions that agree in all three are a pair.
        began: UTC, as ISO 8601.
        tags, uids, batteries_v: of its robots; uids are "-" where not known; volts of those told.
        light_level: of the room: the mean of the first pictures, 0 black to 1 white.
        late: share of the timesteps that were late or left out, 0..1.
        versions: of software: words such as vsense=1.2.
        verdict: `VALID` or `VOID`.
        why: it is void.
        longest_silence_s: in which nothing was heard of some robot that was connected.
        signal_dbm: the weakest that some robot's radio had.
        power_saving: tags of robots whose radio's power saving was on.
        measures: the experiment's, at the end; None: not taken.
    """

    run: str
    mode: str
    experiment: str
    condition: str
    series: str = ""
    block: str = ""
    repetition: str = ""
    start: str = ""
    seed: int | None = None
    began: str = ""
    duration_s: float | None = None
    robots: int | None = None
    tags: Sequence[int] = ()
    uids: Sequence[str] = ()
    batteries_v: Sequence[float] = ()
    light_level: float | None = None
    late: float | None = None
    versions: Sequence[str] = ()
    verdict: str = VALID
    why: str = ""
    note: str = ""
    longest_silence_s: float | None = None
    signal_dbm: int | None = None
    power_saving: Sequence[int] = ()
    measures: Mapping[str, float | None] = field(default_factory=dict)

    @property
    def valid(self) -> bool:
        """Whether it counts."""
        return self.verdict == VALID


def utc(seconds: float) -> str:
    """A time of the clock, since the epoch, as `began` has it."""
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(seconds))


def versions() -> tuple[str, ...]:
    """The software that a run's results depend on, as `RunRow.versions` has it."""
    own = f"vsense={__version__}", f"sources={build.own_sources()}"
    return *own, f"python={platform.python_version()}", f"numpy={np.__version__}"


def condition_of(blind: bool, settings: Mapping[str, str]) -> str:
    """The condition of a run that nobody named: whether it is blind, and what was set."""
    words = [f"{name}={value}" for name, value in settings.items()]
    return ", ".join([*(["blind"] if blind else []), *words]) or "sighted"


class RunsFile:
    """A runs.csv to which rows are added; each is on the disk when `append` returns.

    Attributes:
        rows: all rows, the read ones first.
        measures: names of the columns beyond `COLUMNS`, in their order.
        repaired: whether the file ended in half a row, which was cut off.
    """

    def __init__(self, path: Path) -> None:
        """Reads the file if there is one.

        Raises:
            UsageError: it is no runs.csv, or is damaged.
            VsenseError: it cannot be read.
        """
        self.path = path
        self.rows: list[RunRow] = []
        self.measures: list[str] = []
        self.repaired = False
        self._in_order, self._seen = False, stamp_of(self.path)
        self._read()

    def append(self, row: RunRow) -> None:
        """Adds a row; measures that are new become columns, empty in the rows before.

        A measure that is called like a fixed column gets one of its own, `measure_` before its
        name. What somebody has changed in the file since stays.

        VsenseError if it cannot be written; the file is then as it was, or ends in half a row.
        """
        if stamp_of(self.path) != self._seen:
            self._read()
        row = replace(row, measures=_columns_of(row.measures))
        more = [name for name in OPTIONAL if getattr(row, name) not in (None, (), [])]
        new = [name for name in (*more, *row.measures) if name not in self.measures]
        rows, measures = [*self.rows, row], [*self.measures, *new]
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            if self.rows and not new and self._in_order:
                self._add(_line(_cells(row, measures)))
            else:
                replace_text(self.path, _text_of(rows, measures), **_WRITTEN)
                self._in_order = True
        except OSError as error:
            raise VsenseError(f"{self.path}: cannot be written: {error.strerror}") from None
        self.rows, self.measures, self._seen = rows, measures, stamp_of(self.path)

    def _read(self) -> None:
        text, self._in_order = self._text(), False
        if text:
            self.rows, names = _parse(self.path, text)
            self.measures = [name for name in names if name not in COLUMNS]
            # A spreadsheet may have moved columns: rows in our order do not fit below them.
            self._in_order = names == [*COLUMNS, *self.measures]

    def _add(self, text: str) -> None:
        with open(self.path, "a", **_WRITTEN) as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())

    def _text(self) -> str:
        """The whole rows of the file; cuts off half a row at its end."""
        try:
            data = read_bytes(self.path, _MOST_BYTES)
            complete = data[: data.rfind(b"\n") + 1]
            text = complete.decode("utf-8-sig")
            if len(complete) < len(data):
                # Of what is no runs.csv nothing is cut off; half a heading may be one's own.
                half, heading = data.decode(errors="replace"), ",".join(COLUMNS)
                if complete or not (half.startswith(heading) or heading.startswith(half)):
                    _parse(self.path, text)
                os.truncate(self.path, len(complete))
                self.repaired = True
            return text
        except FileNotFoundError:
            return ""
        except OSError as error:
            raise VsenseError(f"{self.path}: cannot be read: {error.strerror}") from None
        except UnicodeDecodeError:
            raise UsageError(f"{self.path}: is no {RUNS}: it is no text in UTF-8") from None


class RunRows:
    """Writes the runs of one `lab` or `run` into the runs.csv of its folder."""

    def __init__(self, folder: Path, mode: str, settings: Mapping[str, str]) -> None:
        """Of the runs of an experiment, in a folder of their own, in a mode of `MODES`."""
        self._file, self._series, self._mode = RunsFile(folder / RUNS), folder.name, mode
        self._settings = settings
        self._began: dict[int, float] = {}

    def begin(self, number: int) -> None:
        """A run begins now."""
        self._began[number] = time.time()

    def add(self, summary: Mapping[str, Any], experiment: Experiment) -> str:
        """Adds a run, by what summary.json has.

        `experiment` is that of the run: others may play in the next one.

        Returns:
            Why it cannot be written, in words; "": it is.
        """
        condition = condition_of(summary["blind"], self._settings)
        try:
            row = row_of(summary, self._mode, experiment, condition)
            name, began = f"run-{summary['run']}", utc(self._began[summary["run"]])
            self._file.append(replace(row, run=name, series=self._series, began=began))
        except VsenseError as error:
            return f"vsense: the table of runs lacks run {summary['run']}: {error}"
        return ""


def row_of(summary: Mapping[str, Any], mode: str, experiment: Experiment, condition: str) -> RunRow:
    """The row of a run in the lab or with robots, without what it is called and when it began.

    `summary` is what its summary.json has.
    """
    swarm = {name: n for name, n in summary.get("swarm", {}).items() if n is not None}
    per_robot = summary.get("per_robot", ())
    volts = [robot["battery_mv"] for robot in per_robot]
    silences = [s for robot in per_robot if (s := robot.get("longest_silence_s")) is not None]
    signals = [dbm for robot in per_robot if (dbm := robot.get("signal_dbm")) is not None]
    resting = summary.get("resting", ())
    return RunRow(
        run="",
        mode=mode,
        experiment=summary["experiment"],
        condition=condition,
        seed=summary["seed"],
        duration_s=summary["duration_s"],
        robots=summary["robots"] - len(resting),
        tags=[robot.tag for robot in experiment.robots if robot.id not in resting],
        uids=_uids_of([p for p in summary.get("parts", ()) if p.get("name") not in resting]),
        batteries_v=[mv / 1000.0 for mv in volts if mv],
        light_level=summary.get("light_level"),
        late=late_share(summary),
        versions=versions(),
        verdict=summary["verdict"],
        why=summary["why"],
        note=summary["note"],
        longest_silence_s=max(silences, default=None),
        signal_dbm=min(signals, default=None),
        power_saving=[robot["tag"] for robot in per_robot if robot.get("power_saving")],
        measures={**swarm, **summary.get("measures", summary.get("results", {}))},
    )


def _uids_of(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """The uids of a summary's parts in the order of its tags, "-": not known; none where all are
    unknown."""
    uids = [row["uid"] or "-" for row in rows]
    return uids if any(uid != "-" for uid in uids) else []


def read_runs(path: Path) -> list[RunRow]:
    """Reads a runs.csv, which may be written by hand; it is not changed.

    Half a row at its end, where a run was ended while it wrote, is left out.

    Raises:
        UsageError: it is none, or a value is wrong; the message names line and column.
        OSError: it cannot be read.
    """
    try:
        return _parse(path, read_bytes(path, _MOST_BYTES).decode("utf-8-sig"))[0]
    except UnicodeDecodeError:
        raise UsageError(f"{path}: is no {RUNS}: it is no text in UTF-8") from None


def are_columns(names: Iterable[str]) -> bool:
    """Whether these are the columns of a runs.csv, in whatever order."""
    return set(COLUMNS) <= set(names)


def _parse(path: Path, text: str) -> tuple[list[RunRow], list[str]]:
    """The rows, and the names of all columns in their order."""
    lines = csv.reader(io.StringIO(text, newline=""))
    try:
        names = next(lines, [])
        _check(path, names)
        rows = []
        for cells in lines:
            if not cells:
                continue
            if len(cells) < len(names) and not text.endswith("\n") and not any(lines):
                break
            if len(cells) != len(names):
                raise csv.Error(f"{len(cells)} values, expected {len(names)}")
            rows.append(_row(dict(zip(names, cells))))
    except (csv.Error, ValueError) as error:
        raise UsageError(f"{path}:{max(lines.line_num, 1)}: {error}") from None
    return rows, names


def _check(path: Path, names: Sequence[str]) -> None:
    """Raises csv.Error unless these can be the columns of a runs.csv."""
    missing = [name for name in COLUMNS if name not in names]
    if tuple(names[:2]) == FORMER:
        raise csv.Error("is a campaign's table in the form before runs.csv: only report reads it")
    if len(missing) == len(COLUMNS) or not names:
        hint = " (its cells have to be separated by commas)" if ";" in "".join(names) else ""
        raise csv.Error(f"is no {RUNS}: expected the columns {','.join(COLUMNS)}{hint}")
    if missing:
        raise csv.Error(f"lacks the columns {', '.join(missing)}")
    if len(set(names)) < len(names) or "" in names:
        raise csv.Error("has columns without a name, or two of the same name")


def _columns_of(measures: Mapping[str, float | None]) -> dict[str, float | None]:
    """Measures by the names of their columns, which are no fixed column's and not empty."""
    columns: dict[str, float | None] = {}
    for measure, value in measures.items():
        name = measure
        while name in ("", *COLUMNS, *OPTIONAL) or (name != measure and name in measures):
            name = f"measure_{name}"
        columns[name] = value
    return columns


def _row(cells: Mapping[str, str]) -> RunRow:
    """Makes a row; ValueError says what is wrong."""
    values: dict[str, Any] = {n: cells.get(n, "").strip() for n in (*COLUMNS, *OPTIONAL)}
    for name, kind in _NUMBERS.items():
        values[name] = _number(name, values[name], kind) if values[name] else None
    for name, kind in _LISTS.items():
        values[name] = tuple(_number(name, word, kind) for word in values[name].split())
    values["versions"] = tuple(values["versions"].split())
    if values["verdict"] not in (VALID, VOID):
        raise ValueError(f"verdict is {values['verdict']!r}, expected {VALID} or {VOID}")
    if values["mode"] not in MODES:
        raise ValueError(f"mode is {values['mode']!r}, expected {', '.join(MODES)}")
    measures = {
        name: _number(name, text.strip(), float) if text.strip() else None
        for name, text in cells.items()
        if name not in (*COLUMNS, *OPTIONAL)
    }
    return RunRow(**values, measures=measures)


def _number(name: str, text: str, kind: Callable[[str], Any]) -> Any:
    try:
        return kind(text)
    except ValueError:
        expected = _KINDS[kind]  # type: ignore[index]
        raise ValueError(f"{name} is {text!r}, expected {expected}") from None


def _text_of(rows: Sequence[RunRow], measures: Sequence[str]) -> str:
    head = [*COLUMNS, *measures]
    return "".join(_line(cells) for cells in (head, *(_cells(row, measures) for row in rows)))


def _cells(row: RunRow, measures: Sequence[str]) -> list[str]:
    return [
        *(_written(getattr(row, name)) for name in COLUMNS),
        *(_written(getattr(row, n) if n in OPTIONAL else row.measures.get(n)) for n in measures),
    ]


def _written(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.12g}"
    if isinstance(value, (list, tuple)):
        return " ".join(map(_written, value))
    return str(value)


def _line(cells: Sequence[str]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(cells)
    return text.getvalue()
