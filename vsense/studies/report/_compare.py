"""Several runs side by side: curves with mean and spread, and the statistics of single values."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vsense.base.arena import Floats
from vsense.base.terminal import spoken
from vsense.monitor import recording
from vsense.run.runs_csv import RunRow
from vsense.studies.report._facts import RECORDED, RUN_KINDS
from vsense.studies.report._findings import Findings
from vsense.studies.report.study._collect import TableOfRuns

_ENDS = (("in_cone", recording.IN_CONE), ("lit", recording.LIT_IN_CONE))
"""The swarm's figures of a campaign, and the measure of a recording whose last value they are."""


@dataclass(frozen=True, slots=True)
class CampaignRuns:
    """The valid runs of one condition in one table.

    Attributes:
        condition: as the table has it.
        kind: of the runs, of `vsense.studies.report._facts.KINDS`.
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
    names = []
    for table, own in zip(tables, parts):
        rest = alike[table.experiment, table.kind, table.condition] - {own}
        lengths = (n for n in range(1, len(own)) if all(o[-n:] != own[-n:] for o in rest))
        file = Path(*own[-next(lengths, len(own)) :])
        names.append(f"{file}, {table.condition}" if rest else table.condition)
    return names


def campaign_runs(table: TableOfRuns) -> list[CampaignRuns]:
    """The conditions of a table; void runs are left out."""
    groups: dict[tuple[str, str, str], list[RunRow]] = {}
    for row in table.rows:
        if row.valid:
            groups.setdefault((row.experiment, row.mode, row.condition), []).append(row)
    return [
        CampaignRuns(
            path=table.path,
            experiment=experiment,
            condition=condition,
            kind=RUN_KINDS[mode],
            seeds=["" if row.seed is None else str(row.seed) for row in rows],
            ends=_ends(rows),
        )
        for (experiment, mode, condition), rows in groups.items()
    ]


def _ends(rows: Sequence[RunRow]) -> dict[str, list[float]]:
    """The values of each measure; those of the swarm under the names that recordings have."""
    ends: dict[str, list[float]] = {}
    for row in rows:
        values = {name: value for name, value in row.measures.items() if value is not None}
        for before, name in _ENDS:
            early = values.pop(f"{before}_before_turn", None)
            late = values.pop(f"{before}_after_turn", early)
            if late is not None:
                values[name] = late
        for name, value in values.items():
            ends.setdefault(name, []).append(value)
    return ends


@dataclass(frozen=True, slots=True)
class Group:
    """Runs of one experiment, one at least, of one kind and under one condition.

    Attributes:
        condition: in words; "sighted", "blind" or "condition unknown", and where runs of several
            kinds are compared, of which kind they are.
        runs: those that are recorded.
        tables: those of which a table has the last values.
        kind: of `vsense.studies.report._facts.KINDS`, "" unknown.
        blind: the virtual sensors were held at 0; None: unknown.
    """

    experiment: str
    condition: str
    runs: Sequence[Findings]
    tables: Sequence[CampaignRuns] = ()
    kind: str = ""
    blind: bool | None = None

    @property
    def count(self) -> int:
        """How many runs there are: the unit of everything that is compared."""
        return len(self.runs) + sum(len(table.seeds) for table in self.tables)

    def ends(self, name: str) -> list[float]:
        """The last value of a measure in each run that has it."""
        values = [run.measures[name]["end"] for run in self.runs if name in run.measures]
        return [*values, *(value for table in self.tables for value in table.ends.get(name, ()))]


@dataclass(frozen=True, slots=True)
class Curve:
    """A measure of a group over time, (n,), as long as all of its runs last.

    `mean` and `spread` are over the runs: sample standard deviation; 0 for a single run.
    """

    time_s: Floats
    mean: Floats
    spread: Floats


@dataclass(frozen=True, slots=True)
class Statistics:
    """One value of each run of a group that has it, and their mean and median.

    `spread` is the sample standard deviation; None for a single value.
    """

    values: Sequence[float]
    mean: float
    spread: float | None
    median: float


_BLIND = {False: "sighted", True: "blind", None: "condition unknown"}
_ORDER = (*RUN_KINDS.values(), RECORDED)


def groups(runs: Sequence[Findings], tables: Sequence[CampaignRuns] = ()) -> list[Group]:
    """Sorts runs by experiment, kind and condition: simulation first, sighted before blind."""
    sorted_: dict[tuple[str, str, bool | None], list[Findings]] = {}
    kinds: dict[str, set[str]] = {}
    for table in tables:
        kinds.setdefault(table.experiment, set()).add(table.kind)
    for run in runs:
        facts = run.gathered.facts
        name = facts.name or "unnamed experiment"
        kinds.setdefault(name, set()).add(facts.kind)
        sorted_.setdefault((name, facts.kind, facts.blind), []).append(run)
    sorted_groups = [
        Group(name, _words(kind, blind, len(kinds[name]) > 1), members, (), kind, blind)
        for (name, kind, blind), members in sorted_.items()
    ]
    for table, label in zip(tables, labels(tables)):
        words = f"{table.kind} ({label})"
        sorted_groups.append(Group(table.experiment, words, (), (table,), table.kind, None))
    return sorted(sorted_groups, key=_place)


def _words(kind: str, blind: bool | None, several: bool) -> str:
    if not several:
        return _BLIND[blind]
    kind = kind or "unknown kind"
    return kind if blind is False else f"{kind}, {_BLIND[blind]}"


def _place(group: Group) -> tuple[str, int, int]:
    kind = _ORDER.index(group.kind) if group.kind in _ORDER else len(_ORDER)
    return group.experiment, kind, tuple(_BLIND).index(group.blind)


def by_experiment(groups_: Sequence[Group]) -> dict[str, list[Group]]:
    """Puts the groups of each experiment together."""
    experiments: dict[str, list[Group]] = {}
    for group in groups_:
        experiments.setdefault(group.experiment, []).append(group)
    return experiments


def measure_names(groups_: Sequence[Group]) -> list[str]:
    """All measures of some groups, in their order of appearance."""
    names = [name for group in groups_ for run in group.runs for name in run.gathered.measures]
    names += [name for group in groups_ for table in group.tables for name in table.ends]
    return list(dict.fromkeys(names))


def curve(group: Group, name: str) -> Curve | None:
    """A measure of a group over time; None: no run has it."""
    series = [run.gathered.measures[name] for run in group.runs if name in run.gathered.measures]
    if not series:
        return None
    step_s = min(run.gathered.facts.timestep_s for run in group.runs)
    begin_s = max(times[0] for times, _ in series)
    end_s = min(times[-1] for times, _ in series)
    if end_s < begin_s:
        return None
    count = min(max(int((end_s - begin_s) / step_s + 1e-6) + 1, 2), 2_000)
    grid = np.linspace(begin_s, end_s, count)
    rows = np.array([held(np.array(times), np.array(values), grid) for times, values in series])
    spread = rows.std(axis=0, ddof=1) if len(rows) > 1 else np.zeros(count)
    return Curve(grid, rows.mean(axis=0), spread)


def held(times: Floats, values: Floats, grid: Floats) -> Floats:
    """Values at other times, (n,): each lasts until the next."""
    places = np.searchsorted(times, grid + 1e-9, side="right") - 1
    return np.asarray(values[np.clip(places, 0, len(values) - 1)])


def quantities(run: Findings) -> dict[str, float]:
    """What is compared of a run as single numbers, by a name with its unit."""
    result: dict[str, float] = {}
    for name, values in run.measures.items():
        result[f"{spoken(name)}, at the end"] = values["end"]
        result[f"{spoken(name)}, mean over the run"] = values["mean"]
    moved = [row for row in run.robots if row.speed_m_s is not None]
    if moved:
        result["distance per robot [m]"] = float(np.mean([row.distance_m for row in moved]))
        speeds = [row.speed_m_s for row in moved if row.speed_m_s is not None]
        result["speed per robot [m/s]"] = float(np.mean(speeds))
    latency = run.latency
    if latency:
        result["latency, median [ms]"] = latency["p50_ms"]
    return result


def statistics(values: Sequence[float]) -> Statistics:
    """Summarises one value of each run, one at least."""
    spread = float(np.std(values, ddof=1)) if len(values) > 1 else None
    return Statistics(values, float(np.mean(values)), spread, float(np.median(values)))


def table(groups_: Sequence[Group]) -> dict[str, dict[str, Statistics]]:
    """The statistics of one experiment's groups, by quantity and condition."""
    rows: dict[str, dict[str, list[float]]] = {}
    for group in groups_:
        for run in group.runs:
            for name, value in quantities(run).items():
                rows.setdefault(name, {}).setdefault(group.condition, []).append(value)
        for measure, values in ((m, v) for runs in group.tables for m, v in runs.ends.items()):
            name = f"{spoken(measure)}, at the end"
            rows.setdefault(name, {}).setdefault(group.condition, []).extend(values)
    return {
        name: {condition: statistics(values) for condition, values in columns.items()}
        for name, columns in rows.items()
    }


def as_json(groups_: Sequence[Group]) -> list[Mapping[str, Any]]:
    """The comparison for `--json`: statistics by experiment, condition and quantity."""
    rows: list[Mapping[str, Any]] = []
    for experiment, members in by_experiment(groups_).items():
        statistics_ = table(members)
        for group in members:
            values = {
                name: {
                    "n": len(columns[group.condition].values),
                    "mean": columns[group.condition].mean,
                    "standard_deviation": columns[group.condition].spread,
                    "median": columns[group.condition].median,
                }
                for name, columns in statistics_.items()
                if group.condition in columns
            }
            paths = [*(run.path for run in group.runs), *(runs.path for runs in group.tables)]
            files = [str(path) for path in paths]
            rows.append(
                {
                    "experiment": experiment,
                    "condition": group.condition,
                    "kind": group.kind,
                    "runs": group.count,
                    "files": files,
                    "quantities": values,
                }
            )
    return rows
