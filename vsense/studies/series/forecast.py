"""Which runs of a series follow, in which order, and how long that takes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

from vsense.base.terminal import aligned
from vsense.run.runs_csv import RunRow
from vsense.studies.series.order import PlannedRun, pending, valid
from vsense.studies.series.parts import PlannedExperiment
from vsense.studies.series.plan import SeriesPlan

OPENING_S = 6.0
"""A run begins and is reported so much longer than it lasts: lab and robots alike."""
HOMING_S = 16.0
"""The median of ways to the starts, as `scripts/bench homing` measures it."""
BRINGING_S = 20.0
"""To bring another controller to all robots, at once."""


@dataclass(frozen=True, slots=True)
class Forecast:
    """What is left of a series.

    Attributes:
        known: what each condition runs.
        rows: the runs that were made.
        pace: of the lab's clocks.
    """

    plan: SeriesPlan
    known: Mapping[str, PlannedExperiment]
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
            "valid": valid(self.rows),
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
                f"a run is void if {', or '.join(void)}: it is repeated up to {plan.again} times",
            ]
        )

    def _lasts(self) -> str:
        simulated_s = sum(map(self._length_s, self.todo))
        wall_s = self.wall_s()
        if wall_s is None:
            return f"{clock(simulated_s)} of simulated time"
        return f"{clock(wall_s)} if none is void, {clock(simulated_s)} of it in runs"

    def _length_s(self, run: PlannedRun) -> float:
        return self.known[run.cell.condition].experiment.length_s

    def _programs(self, run: PlannedRun) -> list[tuple[int, tuple[str, ...]]]:
        """Which sources each robot runs."""
        experiment = self.known[run.cell.condition].experiment
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
