"""Which runs of a series follow, in which order, and how long that takes.

Every condition comes at every start once in each block, shuffled by the seed. A void run is
repeated at the end of its block. What comes next follows from the plan and from the rows that are
there: nothing else is remembered.
"""

from __future__ import annotations

import hashlib
import random
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise, product
from typing import Any

from vsense.base.errors import UsageError, VsenseError
from vsense.base.terminal import aligned
from vsense.run.runs_csv import RUNS, RunRow
from vsense.run.verdict import FAILED
from vsense.studies.series._parts import PlannedExperiment
from vsense.studies.series._plan import SeriesPlan

CUT = "cut off"
"""How `why` of a run begins that nobody judged: vsense or the machine ended in it."""

CAMPAIGN = 0
"""The seed of a campaign's plan, which no file may say.

Its runs come in the order of conditions and starts, each with the seed of its start. They have
neither block nor repetition.
"""

OPENING_S = 6.0
"""A run begins and is reported so much longer than it lasts: lab and robots alike."""
HOMING_S = 16.0
"""The median of ways to the starts, as `scripts/bench homing` measures it."""
BRINGING_S = 20.0
"""To bring another controller to all robots, at once."""

CellKey = tuple[str, str, str]
"""Condition, start and repetition, as runs.csv has them."""


class VoidLimit(VsenseError):
    """A run was void as often as the plan allows."""


@dataclass(frozen=True, slots=True)
class Cell:
    """A place in the plan; `number` counts from 1 in the order of runs.

    Runs of all conditions with the same start and repetition have the same seed: they are pairs.
    `block` and `repetition` are 0 where there are none.
    """

    number: int
    block: int
    condition: str
    start: str
    repetition: int
    seed: int

    @property
    def key(self) -> CellKey:
        """What tells it from the others in runs.csv."""
        return self.condition, self.start, str(self.repetition or "")


@dataclass(frozen=True, slots=True)
class PlannedRun:
    """A run to be made; `attempt` counts from 1."""

    cell: Cell
    attempt: int = 1

    @property
    def name(self) -> str:
        """As runs.csv and its folder have it."""
        if not self.cell.block:
            return f"{self.cell.condition}, seed {self.cell.seed}{self._again}"
        suffix = f"-{self.attempt}" if self.attempt > 1 else ""
        return f"run-{self.cell.number:03d}{suffix}"

    def in_words(self) -> str:
        """What it is, for people."""
        cell = self.cell
        if not cell.block:
            return f"{condition_words(cell.condition)}, seed {cell.seed}{self._again}"
        return f"{cell.condition}, start {cell.start}, repetition {cell.repetition}{self._again}"

    @property
    def _again(self) -> str:
        return f", attempt {self.attempt}" if self.attempt > 1 else ""

    @property
    def label(self) -> str:
        """Its name with what it is."""
        return f"{self.name} ({self.in_words()})" if self.cell.block else self.in_words()


def condition_words(condition: str) -> str:
    """What `condition_of` gives, for people."""
    head, comma, rest = condition.partition(", ")
    words = {"sighted": "as in the file", "blind": "without virtual sensors"}.get(head, head)
    return f"{words}{comma}{rest}"


def cells(plan: SeriesPlan) -> list[Cell]:
    """All cells of a plan in their order."""
    if plan.seed == CAMPAIGN:
        pairs_of_all = enumerate(product(plan.conditions, plan.starts), 1)
        return [Cell(n, 0, c.name, s.name, 0, s.places.seed) for n, (c, s) in pairs_of_all]
    order: list[Cell] = []
    for block in range(1, plan.repetitions + 1):
        pairs = [(c.name, s.name) for c in plan.conditions for s in plan.starts]
        random.Random(f"{plan.seed}/{block}").shuffle(pairs)
        for condition, start in pairs:
            seed = run_seed(plan.seed, start, block)
            order.append(Cell(len(order) + 1, block, condition, start, block, seed))
    return order


def run_seed(seed: int, start: str, repetition: int) -> int:
    """A run's own seed, 1 to 2^32 - 1."""
    digest = hashlib.blake2b(f"{seed}/{start}/{repetition}".encode(), digest_size=8).digest()
    return int.from_bytes(digest, "big") % (2**32 - 1) + 1


def pending(plan: SeriesPlan, rows: Sequence[RunRow]) -> list[PlannedRun]:
    """The runs that are missing, in their order, as far as it is known now.

    Raises:
        VoidLimit: a run of the plan was void too often.
        UsageError: a row is of no run of the plan.
    """
    tries, names = rows_by_cell(rows), {row.run for row in rows}
    todo = []
    for cell in cells(plan):
        attempts = tries.pop(cell.key, [])
        if any(row.valid for row in attempts):
            continue
        judged = [row for row in attempts if not row.why.startswith(CUT)]
        if len(judged) > plan.again:
            raise VoidLimit(_limit(plan, cell, judged))
        # A simulation does the same again, also where users may have void rows repeated for ever.
        if plan.mode == "sim" and (same := [row for row in judged if FAILED in row.why]):
            raise VoidLimit(f"{same[-1].run}: {same[-1].why}; it would fail again")
        run = PlannedRun(cell, len(attempts) + 1)
        while run.name in names:  # somebody has taken a row away
            run = replace(run, attempt=run.attempt + 1)
        todo.append(run)
    if tries and plan.seed != CAMPAIGN:  # which may have had more settings and seeds
        raise UsageError(_stray(next(iter(tries.values()))[0]))
    return sorted(todo, key=lambda run: (run.cell.block, run.attempt, run.cell.number))


def rows_by_cell(rows: Sequence[RunRow]) -> dict[CellKey, list[RunRow]]:
    """The rows of each cell."""
    tries: dict[CellKey, list[RunRow]] = {}
    for row in rows:
        tries.setdefault((row.condition, row.start, row.repetition), []).append(row)
    return tries


def valid_by_cell(rows: Sequence[RunRow]) -> dict[CellKey, list[RunRow]]:
    """The rows of each cell that count."""
    return rows_by_cell([row for row in rows if row.valid])


def count_valid(plan: SeriesPlan, rows: Sequence[RunRow]) -> int:
    """How many cells of a plan have a run that counts."""
    counting = valid_by_cell(rows)
    return sum(cell.key in counting for cell in cells(plan))


def duplicates(rows: Sequence[RunRow]) -> list[str]:
    """Names of runs that count for one cell, where there are several."""
    counting = valid_by_cell(rows).values()
    return [" and ".join(row.run for row in same) for same in counting if len(same) > 1]


def _stray(row: RunRow) -> str:
    return (
        f"{RUNS}: {row.run} is of condition {row.condition!r}, start {row.start!r}, repetition"
        f" {row.repetition!r}, which the plan does not have: has somebody changed these cells?"
    )


def _limit(plan: SeriesPlan, cell: Cell, void: Sequence[RunRow]) -> str:
    whys = "; ".join(f"{row.run}: {row.why}" for row in void)
    times = f"{len(void)} times" if len(void) > 1 else "once"
    return (
        f"{PlannedRun(cell).in_words()}: invalid {times}, no more is wanted (again = {plan.again}"
        f" in the plan): {whys}"
    )


@dataclass(frozen=True, slots=True)
class Forecast:
    """What is left of a series.

    Attributes:
        by_condition: what each condition runs.
        rows: the runs that were made.
        pace: of the lab's clocks.
    """

    plan: SeriesPlan
    by_condition: Mapping[str, PlannedExperiment]
    rows: Sequence[RunRow]
    pace: float = 1.0

    @property
    def todo(self) -> list[PlannedRun]:
        """The runs that follow; raises as `pending`."""
        return pending(self.plan, self.rows)

    def wall_s(self) -> float | None:
        """How long all of them take if none is void; None: a simulation takes what it takes."""
        plan = self.plan
        if plan.mode == "sim":
            return None
        todo = self.todo
        each_s = OPENING_S + (HOMING_S if plan.robots.home else 0.0)
        whole_s = sum(self._length_s(run) + each_s for run in todo)
        if plan.mode == "run":
            drives = [self._programs(run) for run in todo]
            whole_s += BRINGING_S * sum(a != b for a, b in pairwise(drives))
        return whole_s / self.pace if plan.mode == "lab" else whole_s

    def facts(self) -> dict[str, Any]:
        """The same for programs."""
        return {
            "series": self.plan.name,
            "mode": self.plan.mode,
            "planned": self.plan.runs,
            "valid": count_valid(self.plan, self.rows),
            "wall_s": self.wall_s(),
            "void": self.plan.void.in_words(),
            "runs": [{"run": run.name, "attempt": run.attempt, **asdict(run.cell)}
                     for run in self.todo],
        }  # fmt: skip

    def table(self) -> str:
        """The same for people."""
        plan, todo = self.plan, self.todo
        head = ("run", "block", "condition", "start", "seed", "")
        lines = [
            (
                run.name,
                str(run.cell.block),
                run.cell.condition,
                run.cell.start,
                str(run.cell.seed),
                f"attempt {run.attempt}" if run.attempt > 1 else "",
            )
            for run in todo
        ]
        void = plan.void.in_words() or ["never"]
        return "\n".join(
            [
                *aligned([head, *lines]),
                "",
                f"{plan.name}: {len(todo)} of {plan.runs} runs follow ({plan.mode}),"
                f" {self._lasts()}",
                f"a run is invalid if {', or '.join(void)}: it is repeated"
                f" up to {plan.again} times",
            ]
        )

    def _lasts(self) -> str:
        simulated_s = sum(map(self._length_s, self.todo))
        wall_s = self.wall_s()
        if wall_s is None:
            return f"{clock(simulated_s)} of simulated time"
        return f"{clock(wall_s)} if none is invalid, {clock(simulated_s)} of it in runs"

    def _length_s(self, run: PlannedRun) -> float:
        return self.by_condition[run.cell.condition].experiment.length_s

    def _programs(self, run: PlannedRun) -> list[tuple[int, tuple[str, ...]]]:
        """Which sources each robot runs."""
        experiment = self.by_condition[run.cell.condition].experiment
        return [
            (robot.tag, tuple(map(str, experiment.controller_of(robot).sources)))
            for robot in experiment.robots
        ]


def clock(seconds: float) -> str:
    """A duration as people say it: 90 s, 25 min, 3 h 20 min."""
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    if minutes < 120:
        return f"{minutes} min"
    return f"{minutes // 60} h {minutes % 60:02d} min"
