"""The order of a series: every condition at every start once in each block, shuffled by the seed.

A void run is repeated at the end of its block. What comes next follows from the plan and from the
rows that are there: nothing else is remembered.
"""

from __future__ import annotations

import hashlib
import random
from collections.abc import Sequence
from dataclasses import dataclass

from vsense.errors import VsenseError
from vsense.run.runs_csv import RunRow
from vsense.series.plan import SeriesPlan

CUT = "cut off"
"""How `why` of a run begins that nobody judged: vsense or the machine ended in it."""


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
    """
    tried: dict[tuple[str, str, str], list[RunRow]] = {}
    for row in rows:
        tried.setdefault((row.condition, row.start, row.repetition), []).append(row)
    todo = []
    for cell in cells(plan):
        made = tried.get((cell.condition, cell.start, str(cell.repetition)), [])
        if any(row.valid for row in made):
            continue
        judged = [row for row in made if not row.why.startswith(CUT)]
        if len(judged) > plan.again:
            raise VoidLimit(_limit(cell, judged))
        todo.append(PlannedRun(cell, len(made) + 1))
    return sorted(todo, key=lambda run: (run.cell.block, run.attempt, run.cell.number))


def _limit(cell: Cell, void: Sequence[RunRow]) -> str:
    whys = "; ".join(f"{row.run}: {row.why}" for row in void)
    times = f"{len(void)} times" if len(void) > 1 else "once"
    return (
        f"{PlannedRun(cell).in_words()}: void {times}, no more is wanted (again = {len(void) - 1}"
        f" in the plan): {whys}"
    )
