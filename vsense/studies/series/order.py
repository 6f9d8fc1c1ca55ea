"""The order of a series: every condition at every start once in each block, shuffled by the seed.

A void run is repeated at the end of its block. What comes next follows from the plan and from the
rows that are there: nothing else is remembered.
"""

from __future__ import annotations

import hashlib
import random
from collections.abc import Sequence
from dataclasses import dataclass, replace

from vsense.base.errors import UsageError, VsenseError
from vsense.run.runs_csv import RUNS, RunRow
from vsense.studies.series.plan import SeriesPlan

CUT = "cut off"
"""How `why` of a run begins that nobody judged: vsense or the machine ended in it."""


Key = tuple[str, str, str]
"""Condition, start and repetition, as runs.csv has them."""


class VoidLimit(VsenseError):
    """A run was void as often as the plan allows."""


@dataclass(frozen=True, slots=True)
class Cell:
    """A place in the plan; `number` counts from 1 in the order of runs.

    Runs of all conditions with the same start and repetition have the same seed: they are pairs.
    """

    number: int
    block: int
    condition: str
    start: str
    repetition: int
    seed: int

    @property
    def key(self) -> Key:
        """What tells it from the others in runs.csv."""
        return self.condition, self.start, str(self.repetition)


@dataclass(frozen=True, slots=True)
class PlannedRun:
    """A run to be made; `attempt` counts from 1."""

    cell: Cell
    attempt: int = 1

    @property
    def name(self) -> str:
        """As runs.csv and its folder have it."""
        again = f"-{self.attempt}" if self.attempt > 1 else ""
        return f"run-{self.cell.number:03d}{again}"

    def in_words(self) -> str:
        """What it is, for people."""
        cell = self.cell
        again = f", attempt {self.attempt}" if self.attempt > 1 else ""
        return f"{cell.condition}, start {cell.start}, repetition {cell.repetition}{again}"


def cells(plan: SeriesPlan) -> list[Cell]:
    """All cells of a plan in their order."""
    found: list[Cell] = []
    for block in range(1, plan.repetitions + 1):
        pairs = [(c.name, s.name) for c in plan.conditions for s in plan.starts]
        random.Random(f"{plan.seed}/{block}").shuffle(pairs)
        for condition, start in pairs:
            seed = run_seed(plan.seed, start, block)
            found.append(Cell(len(found) + 1, block, condition, start, block, seed))
    return found


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
    tried, names = made(rows), {row.run for row in rows}
    todo = []
    for cell in cells(plan):
        found = tried.pop(cell.key, [])
        if any(row.valid for row in found):
            continue
        judged = [row for row in found if not row.why.startswith(CUT)]
        if len(judged) > plan.again:
            raise VoidLimit(_limit(plan, cell, judged))
        run = PlannedRun(cell, len(found) + 1)
        while run.name in names:  # somebody has taken a row away
            run = replace(run, attempt=run.attempt + 1)
        todo.append(run)
    if tried:
        raise UsageError(_stray(next(iter(tried.values()))[0]))
    return sorted(todo, key=lambda run: (run.cell.block, run.attempt, run.cell.number))


def made(rows: Sequence[RunRow]) -> dict[Key, list[RunRow]]:
    """The rows of each cell."""
    found: dict[Key, list[RunRow]] = {}
    for row in rows:
        found.setdefault((row.condition, row.start, row.repetition), []).append(row)
    return found


def valid(rows: Sequence[RunRow]) -> int:
    """How many cells have a run that counts."""
    return sum(any(row.valid for row in found) for found in made(rows).values())


def twice(rows: Sequence[RunRow]) -> list[str]:
    """Names of runs that count for one cell, where there are several."""
    counting = ([row.run for row in found if row.valid] for found in made(rows).values())
    return [" and ".join(names) for names in counting if len(names) > 1]


def _stray(row: RunRow) -> str:
    return (
        f"{RUNS}: {row.run} is of condition {row.condition!r}, start {row.start!r}, repetition"
        f" {row.repetition!r}, which the plan does not have: has somebody changed these cells?"
    )


def _limit(plan: SeriesPlan, cell: Cell, void: Sequence[RunRow]) -> str:
    whys = "; ".join(f"{row.run}: {row.why}" for row in void)
    times = f"{len(void)} times" if len(void) > 1 else "once"
    return (
        f"{PlannedRun(cell).in_words()}: void {times}, no more is wanted (again = {plan.again}"
        f" in the plan): {whys}"
    )
