"""Carries a series out: one run after the other, until every cell of the plan has a valid one."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from vsense.base.errors import CutShort, Interrupted, UsageError
from vsense.base.interruption import Interruption
from vsense.base.terminal import Console, aligned, spoken
from vsense.config.experiment import ARGOS_SUFFIX
from vsense.run.runs_csv import RunRow
from vsense.run.verdict import VALID, VOID
from vsense.studies.report.study._effects import spread_of
from vsense.studies.series._folder import CampaignTable, SeriesFolder, changed_words
from vsense.studies.series._order import CUT, PlannedRun, count_valid, duplicates, pending
from vsense.studies.series._plan import Condition, SeriesPlan

INTERRUPTED = "interrupted"
"""Why a run or a series has ended where the user has ended it."""
_SHOWN_ROWS = 60
"""Of the table that is printed."""


@dataclass(frozen=True, slots=True)
class RunOutcome:
    """What a run came to.

    Attributes:
        row: what the run knows, and its verdict; name and cell are the series' to fill in.
        ended: why it ended; "time": its length was over.
        halt_reason: why no other run may follow by itself; "": one may.
    """

    row: RunRow
    ended: str = "time"
    halt_reason: str = ""


RunResult = tuple[PlannedRun, RunOutcome]


class RunMaker(Protocol):
    """Who makes runs: a simulation, the lab, or real robots."""

    def make(self, runs: Sequence[PlannedRun], folder: SeriesFolder) -> Iterator[RunResult]:
        """Makes the first of these runs, or more of them in their order.

        VsenseError: one has failed, and so would others. `sim.outcome.Interrupted`: the user has
        ended it.
        """
        ...


class SeriesLoop:
    """The runs of a series.

    Attributes:
        end_reason: why it has ended before all runs were made; "": it has not.
        grows: nobody knows yet how many runs there will be.
    """

    def __init__(
        self,
        plan: SeriesPlan,
        folder: SeriesFolder | CampaignTable,
        make: Callable[[Sequence[PlannedRun]], Iterator[RunResult]],
        console: Console,
        interrupted: Interruption,
        grows: bool = False,
    ) -> None:
        """`make` makes runs, as `RunMaker.make`."""
        self._plan, self._folder, self._make = plan, folder, make
        self._console, self._interrupted = console, interrupted
        self.end_reason, self.grows, self._has_begun = "", grows, False

    def run(self) -> None:
        """Makes all runs that are missing, as far as nobody ends it.

        Raises:
            VoidLimit: a run was void too often.
            VsenseError: a run has failed, or the table cannot be written.
        """
        if not self._has_begun:
            self._begin()
        self._has_begun = True
        try:
            self._make_all()
        except (Interrupted, CutShort):
            self.end_reason = INTERRUPTED

    def complete(self) -> None:
        """As `run`; Interrupted: somebody has ended it, which is said."""
        self.run()
        if self.end_reason:
            self._console.end_progress()
            self._console.say(f"{self.in_words()}; the same command goes on from there")
            raise Interrupted

    def grow(self, plan: SeriesPlan) -> None:
        """Goes on by a plan that has more runs than the one before."""
        self._plan = plan

    def _make_all(self) -> None:
        while (todo := pending(self._plan, self._folder.rows)) and not self.end_reason:
            if self._interrupted.is_set():
                raise Interrupted
            if self._note_cut_off(todo[0]):
                continue
            for planned, outcome in self._make(todo):
                self._add(planned, outcome)
                self.end_reason = self.end_reason or outcome.halt_reason

    @property
    def valid(self) -> int:
        """So many runs of the plan have one that counts."""
        return count_valid(self._plan, self._folder.rows)

    def facts(self) -> dict[str, Any]:
        """How the series stands, for programs."""
        rows = self._folder.rows
        void = [{"run": row.run, "why": row.why} for row in rows if not row.valid]
        return {
            "series": self._plan.name,
            "mode": self._plan.mode,
            "runs_csv": str(self._folder.table.path),
            "planned": self._plan.runs,
            "valid": self.valid,
            "void": void,
            "complete": self.valid == self._plan.runs,
            "conditions": [
                {"condition": condition.name, "measures": spreads(values)}
                for condition, values in measures_of(self._plan, self._folder)
            ],
        }

    def table(self) -> list[str]:
        """The measures of every condition so far, for people."""
        groups = measures_of(self._plan, self._folder)
        return measure_table("condition", [condition.name for condition, _ in groups], groups)

    def in_words(self) -> str:
        """How the series stands, for people."""
        void = sum(not row.valid for row in self._folder.rows)
        thrown = f", {void} invalid" if void else ""
        there = f"{self.valid} of {self._plan.runs} runs"
        if self.grows:
            there = f"{len(self._folder.rows) - void} runs"
        return f"{self._folder.table.path}: {there}{thrown}"

    def _begin(self) -> None:
        folder, say = self._folder, self._console.say
        if folder.table.repaired:
            say(f"{folder.table.path}: its last row was cut short: that run is made again")
        if folder.rows:
            say(f"{self.in_words()}; it goes on from there")
        for names in duplicates(folder.rows):
            say(
                f"{names} are the same run and all valid: one has to become 'void' in the table",
                "warning",
            )
        for text in folder.plan_changes:
            say(f"the plan has changed since this series began: {text}", "warning")
        self._warn_of([folder.upgrade, *folder.changed])

    def _warn_of(self, changes: Sequence[str]) -> None:
        if words := ", ".join(filter(None, changes)):
            self._console.say(f"changed since this series began: {words}", "warning")

    def _note_cut_off(self, run: PlannedRun) -> bool:
        """Writes down a run that was cut off when vsense or the machine ended; says whether."""
        if self._plan.mode == "sim" or not self._folder.is_cut_off(run):
            return False
        experiment = Path(self._plan.condition(run.cell.condition).experiment).name
        name = experiment.removesuffix(ARGOS_SUFFIX)
        row = RunRow(run="", mode=self._plan.mode, experiment=name, condition="")
        self._write(run, row, f"{CUT}: vsense was ended in it")
        return True

    def _add(self, run: PlannedRun, outcome: RunOutcome) -> None:
        is_cut = outcome.ended == INTERRUPTED
        self._write(run, outcome.row, f"{CUT}: {INTERRUPTED}" if is_cut else outcome.row.why)

    def _write(self, run: PlannedRun, row: RunRow, why: str) -> None:
        cell = run.cell
        new, folder = self._folder.check_files(), self._folder
        is_over = bool(new) and not folder.allows_upgrade
        self._warn_of(() if is_over else new)
        names = [Path(file).name for file in folder.changed]
        changed = ", ".join(filter(None, (folder.upgrade, *names)))
        words = changed and f"changed since the series began: {changed}"
        why = why or (f"{', '.join(names)} changed while the series went on" if is_over else "")
        row = replace(
            row,
            run=run.name,
            series=self._plan.name,
            mode=self._plan.mode,
            condition=cell.condition,
            block=str(cell.block or ""),
            start=cell.start,
            repetition=str(cell.repetition or ""),
            seed=cell.seed,
            verdict=VOID if why else VALID,
            why=why,
            note="; ".join(filter(None, (words, row.note))),
        )
        self._folder.append(row)
        if why:
            self._console.say(f"{run.label} is invalid: {why}", "warning")
        elif self._plan.mode != "sim":
            self._console.say(f"{run.name} is valid; {self.in_words()}")
        if is_over:
            raise UsageError(changed_words(str(folder.path), new))


ConditionMeasures = tuple[Condition, dict[str, list[float]]]
"""A condition, and the values of its valid runs by measure."""


def measures_of(plan: SeriesPlan, table: SeriesFolder | CampaignTable) -> list[ConditionMeasures]:
    """The measures of every condition's valid runs, at all starts."""
    groups = []
    for condition in plan.conditions:
        rows = [row for row in table.rows if row.condition == condition.name and row.valid]
        measures = {
            name: [n for row in rows if (n := row.measures.get(name)) is not None]
            for name in table.table.measures
        }
        groups.append((condition, measures))
    return groups


def measure_table(
    head: str, names: Sequence[str], groups: Sequence[ConditionMeasures]
) -> list[str]:
    """For people: runs, median and quartiles of every measure; `names` are those of the groups."""
    from vsense.studies.report.study._words import number  # 0.1 s

    rows = [(head, "measure", "runs", "median", "quartiles")]
    for words, (_, measures) in zip(names, groups):
        for name, values in measures.items():
            cells = "-", "-"
            if values:
                spread = spread_of(np.array(values))
                cells = number(spread.median), " to ".join(map(number, spread.quartiles))
            rows.append((words, spoken(name), str(len(values)), *cells))
            words = ""
    lines = aligned(rows[: _SHOWN_ROWS + 1], left=2) if len(rows) > 1 else []
    left_out = len(rows) - 1 - _SHOWN_ROWS
    return [*lines, f"and {left_out} more rows: --json has all"] if left_out > 0 else lines


def spreads(measures: Mapping[str, Sequence[float]]) -> dict[str, dict[str, Any]]:
    """Mean, standard deviation, median and quartiles of every measure."""
    figures: dict[str, dict[str, Any]] = {}
    for name, values in measures.items():
        figures[name] = {"runs": len(values), **dict.fromkeys(("mean", "std", "median"))}
        figures[name]["quartiles"] = None
        if values:
            spread = spread_of(np.array(values))
            figures[name] |= {
                "mean": round(spread.mean, 6),
                "std": None if spread.sd is None else round(spread.sd, 6),
                "median": spread.median,
                "quartiles": list(spread.quartiles),
            }
    return figures
