"""The runs of a series in simulation: several at a time, their rows in the order of the plan.

Where it ends before, rows of runs that were done before earlier ones come last.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from vsense.base.errors import VsenseError
from vsense.base.terminal import Console, Interruption
from vsense.modes.sim.job import Job
from vsense.modes.sim.outcome import Interrupted, Task
from vsense.modes.sim.watch import WorkerProcess, simulate_all
from vsense.monitor.recording import SUFFIX
from vsense.run.programs import shared_objects
from vsense.run.runs_csv import RunRow, versions
from vsense.studies.series.folder import SeriesFolder
from vsense.studies.series.order import PlannedRun
from vsense.studies.series.parts import PlanLoader, PlannedExperiment
from vsense.studies.series.series import Made, RunOutcome


class SimulatedRuns:
    """Simulates; see `RunMaker`.

    Args:
        known: what each condition runs.
        jobs: runs at the same time.
        record: every run has a recording, in a folder of its own.
    """

    def __init__(
        self,
        loader: PlanLoader,
        known: Mapping[str, PlannedExperiment],
        console: Console,
        interrupted: Interruption,
        jobs: int = 1,
        record: bool = False,
    ) -> None:
        self._plan, self._loader, self._known = loader.plan, loader, known
        self._console, self._interrupted = console, interrupted
        self._jobs, self._record = jobs, record
        self._libraries: dict[str, dict[str, str]] = {}

    def make(self, runs: Sequence[PlannedRun], folder: SeriesFolder) -> Iterator[Made]:
        """Simulates all of these runs; raises as `simulate_all`, after what is done is given."""
        todo = [self._task(run, folder) for run in runs]
        place = {id(task): n for n, task in enumerate(todo)}
        finished: dict[int, dict[str, Any]] = {}
        written = 0

        def show(workers: Sequence[WorkerProcess[Task]]) -> None:
            self._console.progress(
                f"{self._plan.name}: {written + len(finished)} of {len(runs)} runs simulated"
            )

        try:
            for task, result in simulate_all(todo, self._jobs, self._interrupted, show):
                finished[place[id(task)]] = result
                while written in finished:
                    yield runs[written], self._outcome(todo[written], finished.pop(written))
                    written += 1
        except (Interrupted, VsenseError):
            for number, result in sorted(finished.items()):
                yield runs[number], self._outcome(todo[number], result)
            self._clear([todo[n] for n in range(written, len(todo)) if n not in finished])
            raise
        self._console.end_progress()

    def _task(self, run: PlannedRun, folder: SeriesFolder) -> Task:
        planned = self._known[run.cell.condition]
        condition = planned.condition
        experiment = planned.experiment
        libraries = self._libraries.get(condition.name)
        if libraries is None:
            built = shared_objects(experiment)
            libraries = {name: str(path) for name, path in built.items()}
            self._libraries[condition.name] = libraries
        setup = self._loader.setup(planned, self._plan.start(run.cell.start))
        kept = None
        if self._record:
            kept = str(folder.of_run(run) / f"{experiment.name}{SUFFIX}")
        label = f"{run.name} ({run.in_words()})"
        return Task(Job(setup, run.cell.seed, libraries, recording=kept), experiment, label)

    def _clear(self, tasks: Sequence[Task]) -> None:
        """Takes the folders away of runs that have not begun."""
        for recording in (task.job.recording for task in tasks if self._record):
            with suppress(OSError):  # it holds what was recorded until then
                Path(recording or "").parent.rmdir()

    def _outcome(self, task: Task, result: Mapping[str, Any]) -> RunOutcome:
        experiment = task.experiment
        swarm = result["swarm"] if experiment.sources else {}
        tags = [robot.tag for robot in experiment.robots]
        row = RunRow(
            run="",
            mode="sim",
            experiment=experiment.name,
            condition="",
            duration_s=float(result["timesteps"] * result["timestep_s"]),
            robots=len(tags),
            tags=tags,
            versions=(*versions(), *programs_of(task.job.libraries)),
            measures={**swarm, **result["measures"]},
        )
        return RunOutcome(row)


def programs_of(built: Mapping[str, str]) -> list[str]:
    """The controllers of a run as its versions name them: id, and digest of what was built."""
    return [f"{name}={Path(path).parent.name[:12]}" for name, path in sorted(built.items())]
