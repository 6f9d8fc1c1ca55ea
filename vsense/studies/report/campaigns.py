"""Tables of runs beside recordings: the last value of each measure, one for each valid run."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from vsense.run.runs_csv import RunRow
from vsense.studies.report.facts import KINDS
from vsense.studies.report.gather import IN_CONE, LIT_IN_CONE
from vsense.studies.report.study.collect import TableOfRuns

_ENDS = (("in_cone", IN_CONE), ("lit", LIT_IN_CONE))
"""The swarm's figures of a campaign, and the measure of a recording whose last value they are."""


@dataclass(frozen=True, slots=True)
class CampaignRuns:
    """The valid runs of one condition in one table.

    Attributes:
        condition: as the table has it.
        kind: of the runs, of `vsense.studies.report.facts.KINDS`.
        seeds: of the runs, "" unknown.
        ends: by measure the last value of each run that has it.
    """

    path: Path
    experiment: str
    condition: str
    kind: str
    seeds: Sequence[str]
    ends: Mapping[str, Sequence[float]]


def labels(tables: Sequence[CampaignRuns]) -> list[str]:
    """The conditions of tables; with the ends of their paths where some are alike.

    Every campaign's table has the same name unless somebody gives it another.
    """
    alike: dict[tuple[str, str, str], set[tuple[str, ...]]] = {}
    parts = [Path(os.path.abspath(table.path)).parts for table in tables]
    for table, own in zip(tables, parts):
        alike.setdefault((table.experiment, table.kind, table.condition), set()).add(own)
    found = []
    for table, own in zip(tables, parts):
        others = alike[table.experiment, table.kind, table.condition] - {own}
        lengths = (n for n in range(1, len(own)) if all(o[-n:] != own[-n:] for o in others))
        file = Path(*own[-next(lengths, len(own)) :])
        found.append(f"{file}, {table.condition}" if others else table.condition)
    return found


def campaign_runs(table: TableOfRuns) -> list[CampaignRuns]:
    """The conditions of a table; void runs are left out."""
    groups: dict[tuple[str, str, str], list[RunRow]] = {}
    for row in table.rows:
        if row.valid:
            groups.setdefault((row.experiment, row.mode, row.condition), []).append(row)
    return [
        CampaignRuns(
            *(table.path, experiment, condition, KINDS[mode]),
            ["" if row.seed is None else str(row.seed) for row in rows],
            _ends(rows),
        )
        for (experiment, mode, condition), rows in groups.items()
    ]


def _ends(rows: Sequence[RunRow]) -> dict[str, list[float]]:
    """The values of each measure; those of the swarm under the names that recordings have."""
    found: dict[str, list[float]] = {}
    for row in rows:
        values = {name: value for name, value in row.measures.items() if value is not None}
        for before, name in _ENDS:
            early = values.pop(f"{before}_before_turn", None)
            late = values.pop(f"{before}_after_turn", early)
            if late is not None:
                values[name] = late
        for name, value in values.items():
            found.setdefault(name, []).append(value)
    return found
