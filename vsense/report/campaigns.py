"""Tables of campaigns (`vsense sim --runs`) as runs that a report compares: the last value of each
measure, one for each run."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from vsense.errors import UsageError, failing_as
from vsense.files import read_bytes
from vsense.recording.form import RecordingError
from vsense.report.gather import IN_CONE, LIT_IN_CONE

SUFFIX = ".csv"

_FIRST, _LAST = ("campaign", "experiment"), ("seed", "robots", "duration_s")
"""Columns before and after those of the settings; measures follow; see `vsense/run/OUTPUT.md`."""

_ENDS = (("in_cone", IN_CONE), ("lit", LIT_IN_CONE))
"""The swarm's figures of a campaign, and the measure of a recording whose last value they are."""


@dataclass(frozen=True, slots=True)
class CampaignRuns:
    """The runs of one combination of settings.

    Attributes:
        settings: values by name, as the command line gave them.
        seeds: of the runs.
        ends: by measure the last value of each run that has it.
    """

    path: Path
    experiment: str
    settings: Mapping[str, str]
    seeds: Sequence[str]
    ends: Mapping[str, Sequence[float]]

    @property
    def label(self) -> str:
        """Its settings, or its file where there are none."""
        return self.spoken or self.path.name

    @property
    def spoken(self) -> str:
        """Its settings in words; "" where there are none."""
        return ", ".join(f"{name} {value}" for name, value in self.settings.items())


def labels(tables: Sequence[CampaignRuns]) -> list[str]:
    """The labels of tables; where some of an experiment are alike, with the ends of their paths.

    Every campaign's table has the same name unless somebody gives it another.
    """
    alike: dict[tuple[str, str], set[tuple[str, ...]]] = {}
    parts = [Path(os.path.abspath(table.path)).parts for table in tables]
    for table, own in zip(tables, parts):
        alike.setdefault((table.experiment, table.label), set()).add(own)
    found = []
    for table, own in zip(tables, parts):
        others = alike[table.experiment, table.label] - {own}
        lengths = (n for n in range(1, len(own)) if all(o[-n:] != own[-n:] for o in others))
        file = Path(*own[-next(lengths, len(own)) :])
        both = f"{file}, {table.spoken}" if table.spoken else str(file)
        found.append(both if others else table.label)
    return found


def tables_in(folder: Path) -> list[Path]:
    """The tables of campaigns in a folder."""
    with failing_as(RecordingError, f"{folder}: cannot be read"):
        return [path for path in sorted(folder.glob(f"*{SUFFIX}")) if _is_table(path)]


def read_campaign(path: Path) -> list[CampaignRuns]:
    """Reads a campaign's table.

    Raises:
        UsageError: it is none, or is damaged.
        RecordingError: it cannot be read.
    """
    with failing_as(RecordingError, f"{path}: cannot be read"):
        text = read_bytes(path).decode(errors="replace")
    rows = _rows(path, text)
    columns = next(rows)
    place = columns.index(_LAST[0])
    groups: dict[tuple[str, ...], list[dict[str, str]]] = {}
    for cells in rows:
        row = dict(zip(columns, cells))
        key = row["experiment"], *(row[name] for name in columns[len(_FIRST) : place])
        groups.setdefault(key, []).append(row)
    if not groups:
        raise UsageError(f"{path}: holds no run")
    settings, measures = columns[len(_FIRST) : place], columns[place + len(_LAST) :]
    return [
        CampaignRuns(
            *(path, name, dict(zip(settings, values)), [row["seed"] for row in rows]),
            _ends(path, rows, measures),
        )
        for (name, *values), rows in groups.items()
    ]


def _rows(path: Path, text: str) -> Iterator[list[str]]:
    """The lines of a table, its columns first; UsageError where one is damaged."""
    lines = csv.reader(io.StringIO(text, newline=""))
    try:
        columns = next(lines, [])
        if not _are_columns(columns):
            raise csv.Error
        yield columns
    except csv.Error:
        raise UsageError(
            f"{path}:{lines.line_num or 1}: is no table of a campaign, which vsense sim --runs"
            f" makes: expected columns {','.join(_FIRST)}, settings, {','.join(_LAST)}, measures"
        ) from None
    try:
        for cells in lines:
            if len(cells) != len(columns):
                raise csv.Error(f"{len(cells)} values, not {len(columns)}")
            yield cells
    except csv.Error as error:
        raise UsageError(f"{path}:{lines.line_num}: {error}") from None


def _ends(
    path: Path, rows: Sequence[Mapping[str, str]], measures: Sequence[str]
) -> dict[str, list[float]]:
    """The values of each measure; those of the swarm under the names that recordings have."""
    found: dict[str, list[float]] = {}
    for row in rows:
        for name, text in _named(row, measures).items():
            try:
                found.setdefault(name, []).append(float(text))
            except ValueError:
                raise UsageError(
                    f"{path}: seed {row['seed']}: {name} is {text!r}, expected a number"
                ) from None
    return found


def _named(row: Mapping[str, str], measures: Sequence[str]) -> dict[str, str]:
    values = {name: row[name] for name in measures if row[name]}
    for before, name in _ENDS:
        early, late = (values.pop(f"{before}_{when}_turn", "") for when in ("before", "after"))
        if late or early:
            values[name] = late or early
    return values


def _are_columns(columns: Sequence[str]) -> bool:
    place = columns.index(_LAST[0]) if _LAST[0] in columns else -1
    begins = tuple(columns[: len(_FIRST)]) == _FIRST
    return begins and tuple(columns[max(place, 0) : place + len(_LAST)]) == _LAST


def _is_table(path: Path) -> bool:
    with path.open(encoding="utf-8", errors="replace") as file:
        return _are_columns(file.readline(4096).rstrip("\r\n").split(","))
