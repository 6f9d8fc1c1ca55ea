"""Simulated runs of which some decide which others follow: a campaign whose plan grows.

`vsense compare` and `vsense optimize` look at rows, and ask for others: see `GrowingRuns`.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vsense.base.errors import UsageError, VsenseError, instead
from vsense.base.interruption import Interruption
from vsense.base.terminal import Console
from vsense.config.placement import StartPlaces, settle
from vsense.modes.sim import fingerprint
from vsense.modes.sim.job import Job, Setup
from vsense.modes.sim.outcome import Task, libraries_of
from vsense.run.environment import MOST_SEED
from vsense.run.runs_csv import RunRow, RunsFile
from vsense.studies.notebook import checked
from vsense.studies.report import _plot
from vsense.studies.series._folder import CampaignTable
from vsense.studies.series._order import CAMPAIGN, Cell
from vsense.studies.series._parts import PlanLoader, PlannedExperiment
from vsense.studies.series._plan import Condition, PlannedStart, SeriesPlan
from vsense.studies.series._series import SeriesLoop
from vsense.studies.series._simulated import SimulatedRuns, check_simulator, simulator
from vsense.studies.series.campaign import EVER, outputs, write_picture

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True)
class Objective:
    """What runs are judged by: a measure of the experiment, and whether more of it is better."""

    measure: str
    more: bool = True

    def of(self, row: RunRow) -> float:
        """Its value in a run; UsageError or VsenseError: there is none."""
        value = row.measures.get(self.measure)
        if value is not None:
            return value
        if self.measure in row.measures:
            raise VsenseError(f"{row.run}: it measured no {self.measure}")
        known = instead(self.measure, row.measures, "it measures")
        raise UsageError(f"{row.experiment} has no measure {self.measure!r}; {known}")


@dataclass(frozen=True, slots=True)
class TrialOptions:
    """How such runs are made.

    Attributes:
        settings: values by `ELEMENT.attribute`, of all runs.
        robots, duration_s: as `Setup` has them.
        seed: of the first run; the next ones follow.
        output: the table, or the picture; a folder, None: runs, where names say what is simulated.
        format, style, jobs, on: as `CampaignOptions` has them.
        lenient: as `Campaign` has it.
    """

    settings: Mapping[str, str] = field(default_factory=dict)
    robots: int | None = None
    duration_s: float | None = None
    seed: int = 1
    output: str | Path | None = None
    format: str | None = None
    style: str | None = None
    jobs: int | None = None
    on: str | None = None
    lenient: bool = False

    @classmethod
    def of(cls, how: Mapping[str, Any]) -> TrialOptions:
        """Reads options by their names; UsageError: one is wrong, or needs what is not there."""
        names = [one.name for one in fields(cls)]
        if unknown := [name for name in how if name not in names]:
            raise UsageError(f"{unknown[0]}: no such option; {instead(unknown[0], names)}")
        settings = {key: str(value) for key, value in (how.get("settings") or {}).items()}
        options = cls(**{**how, "settings": settings})
        options = replace(
            options,
            robots=checked("robots", options.robots, int, 1),
            duration_s=checked("duration_s", options.duration_s, float, 0.0),
            seed=checked("seed", options.seed, int, 1, MOST_SEED),
            jobs=checked("jobs", options.jobs, int, 1),
        )
        check_simulator(options.on, options.jobs, False)
        _plot.require_sheet(options.style)
        return options

    def seeds(self, count: int) -> range:
        """So many seeds; UsageError: there are not so many from the first one on."""
        if not 1 <= self.seed <= MOST_SEED - count:
            raise UsageError(f"seed {self.seed}: expected 1 to {MOST_SEED - count}")
        return range(self.seed, self.seed + count)

    def planned(self, condition: Condition) -> PlannedExperiment:
        """What a condition runs, loaded and checked; raises as `PlanLoader.load`."""
        path, count = Path(condition.experiment), self.robots
        plan = SeriesPlan(path, "", "sim", (), (), duration_s=self.duration_s, count=count)
        return PlanLoader(plan, lenient=self.lenient).load(condition)

    def setup_of(self, planned: PlannedExperiment, cell: Cell | None = None) -> Setup:
        """What the runs of a condition are made from."""
        path, settings = planned.condition.experiment, planned.settings
        return Setup(path, self.duration_s, self.robots, settings=settings)

    def digest(self, planned: PlannedExperiment) -> str:
        """What all runs of a condition have in common; see `fingerprint.of_campaign`."""
        job = Job(self.setup_of(planned), 0, libraries_of(planned.experiment))
        return fingerprint.of_campaign(Task(job, planned.experiment))

    def outputs(self, name: str) -> tuple[Path, Path]:
        """The table and the picture; raises as `campaign.outputs`."""
        path = Path("runs" if self.output is None else self.output)
        is_folder = self.output is None or os.path.isdir(path)
        return outputs(path / f"{name}.csv" if is_folder else path, self.format)


class GrowingRuns:
    """Completes one table, plan after plan; who asks looks at the rows in between.

    The simulator works within its `with` block.

    Attributes:
        how: runs are made.
        path: of the table.
    """

    def __init__(
        self,
        how: TrialOptions,
        name: str,
        digests: Sequence[str],
        console: Console,
        interrupted: Interruption,
    ) -> None:
        """Begins with what is in the table.

        Args:
            how: runs are made.
            name: of the files, where nobody gave one.
            digests: of all that is compared; rows of other runs are refused.
        """
        self.how, self._console, self._interrupted = how, console, interrupted
        digest = hashlib.sha256("".join(digests).encode()).hexdigest()[: fingerprint.NAME_DIGITS]
        self.path, self._drawing = how.outputs(f"{name}-{digest}")
        self._plan = SeriesPlan(self.path, digest, "sim", (), (), seed=CAMPAIGN, again=EVER)
        self.table = CampaignTable(RunsFile(self.path), self._plan, mixed=True)
        self._settled = set[tuple[str, int]]()
        self._by_condition: dict[str, PlannedExperiment] = {}
        self._goal, self._stack = "", ExitStack()

    def __enter__(self) -> GrowingRuns:
        how, console, interrupted = self.how, self._console, self._interrupted
        self._stack.callback(console.end_progress)
        simulate = self._stack.enter_context(simulator(how.on, how.jobs, console, interrupted))
        makes = how.setup_of, simulate, console, interrupted
        maker = SimulatedRuns(self._plan, self._by_condition, *makes)
        self._loop = SeriesLoop(
            self._plan,
            self.table,
            lambda runs: maker.make(runs, self.table, self._goal),
            console,
            interrupted,
            grows=True,
        )
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def complete(
        self, planned: Mapping[str, PlannedExperiment], seeds: Sequence[int], goal: str
    ) -> None:
        """Makes the runs of these conditions with these seeds that are not there yet.

        Args:
            planned: what each condition runs.
            goal: what they are for, as the progress bar says it.

        Raises:
            Interrupted: the user has ended it, which is said; the rows until then are in the table.
            VsenseError: robots find no room with a seed, or a run has failed.
        """
        for name, seed in ((name, seed) for name in planned for seed in seeds):
            if (name, seed) not in self._settled:
                settle(planned[name].experiment, seed)
                self._settled.add((name, seed))
        self._by_condition.update(planned)
        conditions = tuple(one.condition for one in planned.values())
        starts = tuple(PlannedStart(f"seed{n}", StartPlaces(n)) for n in seeds)
        self._goal = goal
        self._loop.grow(replace(self._plan, conditions=conditions, starts=starts))
        self._loop.complete()

    def rows(self, condition: str, seeds: Sequence[int]) -> list[RunRow]:
        """The valid rows of a condition with these seeds, in their order, as far as they are."""
        there = {
            row.seed: row for row in self.table.rows if row.valid and row.condition == condition
        }
        return [there[seed] for seed in seeds if seed in there]

    def draw(self, draw: Callable[[], Figure]) -> Path | None:
        """The picture of it all; see `write_picture`."""
        return write_picture(draw, self._drawing, self.how.style)
