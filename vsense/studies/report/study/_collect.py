"""Reads tables of runs (runs.csv) together: a run that is named twice counts once."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from vsense.base.errors import UsageError, failing_as
from vsense.base.files import open_bytes, read_bytes
from vsense.monitor import recording
from vsense.monitor.recording.form import RecordingError
from vsense.run.runs_csv import COLUMNS, FORMER, RUNS, RunRow, are_columns, condition_of, read_runs

TABLE_SUFFIX = ".csv"
"""Of tables of runs."""

_FORMER_LAST = ("seed", "robots", "duration_s")
"""Columns of a campaign's table as vsense once wrote it: `FORMER`, settings, these, measures."""


@dataclass(frozen=True, slots=True)
class TableOfRuns:
    """The runs of a file.

    Attributes:
        rows: all of them, void ones, too.
        repeated: how many runs are left out because a file before it, or itself, has them.
    """

    path: Path
    rows: Sequence[RunRow]
    repeated: int = 0


def tables_in(folder: Path) -> list[Path]:
    """The tables of runs in a folder."""
    with failing_as(RecordingError, f"{folder}: cannot be read"):
        files = (path for path in sorted(folder.glob(f"*{TABLE_SUFFIX}")) if os.path.isfile(path))
        return [path for path in files if _is_table(path)]


def files_of(path: Path) -> list[Path]:
    """The recordings, or the tables of runs, that a path means.

    A folder of runs has a runs.csv beside its recordings, which show more.

    Raises:
        UsageError: a folder holds neither.
        RecordingError: it cannot be read.
    """
    if not os.path.isdir(path) or not (tables := tables_in(path)):
        return recording.files_of(path)
    if all(table.name == RUNS for table in tables):
        with suppress(UsageError):
            return recording.files_of(path)
    return tables


def read_tables(paths: Iterable[Path]) -> list[TableOfRuns]:
    """Reads files one after the other; a path that is named twice is read once.

    Raises:
        UsageError: one is no table of runs, is damaged, or says another thing of a run than one
            before it.
        RecordingError: one cannot be read.
    """
    tables: list[TableOfRuns] = []
    first_rows: dict[tuple[object, ...], tuple[Path, RunRow]] = {}
    for path in {path.resolve(): path for path in paths}.values():
        with failing_as(RecordingError, f"{path}: cannot be read"):
            read = read_former(path) if _is_former(path) else read_runs(path)
        if not read:
            raise UsageError(f"{path}: holds no run")
        rows = []
        for row in read:
            identity = (row.series, row.mode, row.experiment, row.run, row.began)
            before = first_rows.setdefault(identity, (path, row))
            if before[1] is row:
                rows.append(row)
            elif differing := _differing(before[1], row):
                raise UsageError(
                    f"{path}: run {row.run!r} of series {row.series!r} is in {before[0]}, too, with"
                    f" another {differing}: expected the same, or a name of its own"
                )
        tables.append(TableOfRuns(path, rows, len(read) - len(rows)))
    return tables


def _differing(row: RunRow, other: RunRow) -> str:
    """The first column in which two rows of one run differ; "": none. A measure may be missing."""
    for name in COLUMNS:
        if getattr(row, name) != getattr(other, name):
            return name
    both = row.measures.keys() & other.measures.keys()
    return next((n for n in sorted(both) if repr(row.measures[n]) != repr(other.measures[n])), "")


def read_former(path: Path) -> list[RunRow]:
    """Reads a campaign's table in the form before runs.csv.

    Raises:
        UsageError: it is none, or is damaged.
        OSError: it cannot be read.
    """
    lines = csv.reader(io.StringIO(read_bytes(path).decode(errors="replace"), newline=""))
    try:
        names = next(lines, [])
        if not _are_former(names):
            raise csv.Error(
                f"is no table of a campaign: expected columns {','.join(FORMER)}, settings,"
                f" {','.join(_FORMER_LAST)}, measures"
            )
        rows = []
        for cells in lines:
            if len(cells) != len(names):
                raise csv.Error(f"{len(cells)} values, expected {len(names)}")
            rows.append(_former_row(names, dict(zip(names, cells))))
    except (csv.Error, ValueError) as error:
        raise UsageError(f"{path}:{lines.line_num or 1}: {error}") from None
    return rows


def _former_row(names: Sequence[str], cells: Mapping[str, str]) -> RunRow:
    place = names.index(_FORMER_LAST[0])
    settings = {name: cells[name] for name in names[len(FORMER) : place]}
    # Whether it was blind was not told.
    condition = condition_of(False, settings) if settings else "as in the file"
    measures = names[place + len(_FORMER_LAST) :]
    return RunRow(
        run=f"{condition}, seed {cells['seed']}",
        series=cells[FORMER[0]],
        mode="sim",
        experiment=cells[FORMER[1]],
        condition=condition,
        start=f"seed{cells['seed']}",
        seed=int(cells["seed"]),
        robots=int(cells["robots"]),
        duration_s=float(cells["duration_s"]),
        measures={name: float(cells[name]) if cells[name] else None for name in measures},
    )


def _are_former(names: Sequence[str]) -> bool:
    place = names.index(_FORMER_LAST[0]) if _FORMER_LAST[0] in names else -1
    begins = tuple(names[: len(FORMER)]) == FORMER
    return begins and tuple(names[max(place, 0) : place + len(_FORMER_LAST)]) == _FORMER_LAST


def _is_former(path: Path) -> bool:
    return tuple(_head(path)[: len(FORMER)]) == FORMER


def _is_table(path: Path) -> bool:
    names = _head(path)
    return are_columns(names) or _are_former(names)


def _head(path: Path) -> list[str]:
    with open_bytes(path) as file:
        line = file.readline(1 << 16).decode("utf-8-sig", "replace")
    return line.rstrip("\r\n").split(",")
