"""Simulated runs of a series or a campaign: several at a time, their rows in the order of the plan.

Where it ends before, rows of runs that were done before earlier ones come last. A campaign promises
the same bytes however often it is interrupted: it leaves them out.
"""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from vsense.base.errors import Interrupted, UsageError, VsenseError, failing_as
from vsense.base.interruption import Interruption
from vsense.base.terminal import Console
from vsense.modes.sim import engine
from vsense.modes.sim.fingerprint import of_file
from vsense.modes.sim.job import Job, Setup
from vsense.modes.sim.outcome import SimulatedRunError, Task, libraries_of, record_of
from vsense.modes.sim.watch import Show, WorkerProcess, simulate_all
from vsense.monitor import recording
from vsense.monitor.recording import megabytes
from vsense.robots.sources import HOSTED
from vsense.run.programs import LOOP_PROGRAM
from vsense.run.runs_csv import RunRow, versions
from vsense.run.verdict import VoidCriteria
from vsense.studies.series._folder import CampaignTable, SeriesFolder
from vsense.studies.series._order import CAMPAIGN, Cell, PlannedRun
from vsense.studies.series._parts import PlannedExperiment
from vsense.studies.series._plan import SeriesPlan
from vsense.studies.series._series import RunOutcome, RunResult

RUNS_BAR_WIDTH = 24

Simulate = Callable[..., Iterator[tuple[Task, dict[str, Any]]]]
"""Does tasks, given `interrupted` and `show`: see `Engine.simulate`."""


def check_simulator(address: str | None, jobs: int | None, record: bool) -> None:
    """Refuses what is not installed, or does not go together, before anything is made.

    For the arguments see `simulator`; `record`: every run has a recording.
    """
    if record:
        recording.require()
    if address is None:
        return
    if record:
        raise UsageError("--record: with --on the recordings would lie on the workers' machines")
    if jobs is not None:
        raise UsageError("-j: with --on the cluster has as many at a time as its workers take")
    engine.require_dask()


@contextmanager
def simulator(
    address: str | None, jobs: int | None, console: Console, interrupted: Interruption
) -> Iterator[Simulate]:
    """What does runs: `jobs` at a time on this machine, or a Dask cluster at an address.

    None: one per processor. Raises as `connected`.
    """
    if address is None:
        yield partial(simulate_all, processes=jobs or len(os.sched_getaffinity(0)))
        return
    with engine.connected(address, console, interrupted) as cluster:
        yield cluster.simulate


class SimulatedRuns:
    """Simulates; see `RunMaker`.

    Args:
        by_condition: what each condition runs.
        setup_of: what a run is made from.
        simulate: does the runs.
        record: every run has a recording.
        reported: warnings that were said before.
    """

    def __init__(
        self,
        plan: SeriesPlan,
        by_condition: Mapping[str, PlannedExperiment],
        setup_of: Callable[[PlannedExperiment, Cell], Setup],
        simulate: Simulate,
        console: Console,
        interrupted: Interruption,
        record: bool = False,
        reported: Sequence[str] = (),
    ) -> None:
        self._plan, self._by_condition, self._setup_of = plan, by_condition, setup_of
        self._simulate, self._record = simulate, record
        self._console, self._interrupted = console, interrupted
        self._libraries: dict[str, dict[str, str]] = {}
        self._warned = set(reported)

    def make(
        self, runs: Sequence[PlannedRun], folder: SeriesFolder | CampaignTable, goal: str = ""
    ) -> Iterator[RunResult]:
        """Simulates all of these runs; raises as `simulate_all`, after what is done is given.
        `goal`: what they and those that follow are for, as the bar says it."""
        todo = [self._task(run, folder) for run in runs]
        place = {id(task): n for n, task in enumerate(todo)}
        recordings = None
        if self._record:
            recordings = _Recordings(folder.path, len(todo), self._console)
        finished: dict[int, dict[str, Any]] = {}
        written = 0
        show = _bar(self._console, todo, lambda: written + len(finished), goal)

        def take(number: int) -> RunResult:
            result, run = finished.pop(number), runs[number]
            self._warn(run.cell.condition, result["complaints"])
            if recordings is not None:
                recordings.add(result["recording"])
            return run, outcome(todo[number], result, self._plan.void)

        try:
            for task, result in self._simulate(todo, interrupted=self._interrupted, show=show):
                finished[place[id(task)]] = result
                while written in finished:
                    yield take(written)
                    written += 1
        except (Interrupted, VsenseError) as error:
            self._clear([todo[n] for n in range(written, len(todo)) if n not in finished])
            for number in sorted(finished) if self._plan.seed != CAMPAIGN else ():
                yield take(number)
            if isinstance(error, SimulatedRunError) and self._plan.seed != CAMPAIGN:
                failed = outcome(error.task, error.result, self._plan.void)
                yield runs[place[id(error.task)]], failed
            raise
        show(())
        if not goal:
            self._console.end_progress()
        if recordings is not None:
            recordings.say()

    def _task(self, run: PlannedRun, folder: SeriesFolder | CampaignTable) -> Task:
        name = run.cell.condition
        planned = self._by_condition[name]
        if name not in self._libraries:
            self._libraries[name] = libraries_of(planned.experiment)
        file = str(folder.recording(run, planned.experiment.name)) if self._record else None
        setup = self._setup_of(planned, run.cell)
        job = Job(setup, run.cell.seed, self._libraries[name], recording=file)
        return Task(job, planned.experiment, run.label)

    def _clear(self, tasks: Sequence[Task]) -> None:
        """Takes the folders away of runs that have not begun."""
        for file in (task.job.recording for task in tasks if self._record):
            with suppress(OSError):  # it holds what was recorded until then
                Path(file or "").parent.rmdir()

    def _warn(self, condition: str, complaints: Sequence[str]) -> None:
        """Says what a run of a condition warns of, unless it was said before."""
        for warning in (*self._by_condition[condition].experiment.warnings, *complaints):
            words = f"{condition}: {warning}" if len(self._by_condition) > 1 else warning
            if not self._warned & {words, warning}:
                self._warned.add(words)
                self._console.end_progress()
                self._console.say(f"vsense: {words}")


def outcome(task: Task, result: dict[str, Any], criteria: VoidCriteria) -> RunOutcome:
    """What a run came to, by its result."""
    swarm = result["swarm"] if task.experiment.sources else {}
    tags = [robot.tag for robot in task.experiment.robots]
    measures = {**swarm, **result["measures"]}
    row = RunRow(
        run="",
        mode="sim",
        experiment=result["name"],
        condition="",
        duration_s=float(result["timesteps"] * result["timestep_s"]),
        robots=len(tags),
        tags=tags,
        versions=(*versions(), *programs_of(task.job.libraries)),
        # As it is read again: figures are the same whether or not it was interrupted.
        measures={k: None if v is None else float(f"{v:.12g}") for k, v in measures.items()},
    )
    verdict = record_of(result).judge(criteria)
    return RunOutcome(replace(row, why=verdict.why, note=verdict.note))


def programs_of(built: Mapping[str, str]) -> list[str]:
    """The controllers of a run as its versions name them: id, and digest of what was built."""
    controllers = sorted((name, path) for name, path in built.items() if name != LOOP_PROGRAM)
    return [f"{name}={_digest(Path(path))[:12]}" for name, path in controllers]


def _digest(program: Path) -> str:
    """What was built bears its digest; a file that is run as it is does not."""
    return of_file(program) if program.suffix in HOSTED else program.parent.name


def _bar(console: Console, todo: Sequence[Task], count: Callable[[], int], goal: str) -> Show:
    """Makes the function that draws the progress bar; `count`: so many runs are done."""
    aim = f"  {goal}" if goal else ""
    begun_s = time.monotonic()

    def show(workers: Sequence[WorkerProcess[Task]]) -> None:
        under_way = sum(
            worker.timesteps / worker.task.experiment.timesteps for worker in workers if worker.task
        )
        share = (count() + under_way) / len(todo)
        full = round(RUNS_BAR_WIDTH * share)
        left = ""
        if share > 0.0:
            left_s = round((time.monotonic() - begun_s) * (1.0 - share) / share)
            left = f"  {left_s // 60}:{left_s % 60:02d} left"
        bar = "#" * full + "." * (RUNS_BAR_WIDTH - full)
        console.progress(f"[{bar}] {count()} of {len(todo)} runs{left}{aim}")

    return show


class _Recordings:
    """Says where recordings are, and what they cost: after the first one, and at the end."""

    def __init__(self, folder: Path, todo: int, console: Console) -> None:
        self._folder, self._todo, self._console = folder, todo, console
        self._done = self._bytes = self._troubles = 0
        console.say(f"recording to {folder}, a file for each run")

    def add(self, recording: Mapping[str, Any]) -> None:
        """A run is done, with what became of its recording."""
        self._done, self._bytes = self._done + 1, self._bytes + recording["bytes"]
        if recording["trouble"]:
            self._troubles += 1
            if self._troubles == 1:
                self._say(f"vsense: a recording is not whole: {recording['trouble']}")
        if self._done == 1 and self._todo > 1:
            self._foretell(recording["bytes"])

    def _foretell(self, size: int) -> None:
        needed = size * self._todo
        with failing_as(VsenseError, f"{self._folder}: cannot be read"):
            free = shutil.disk_usage(self._folder).free
        words = f"{megabytes(size)} a run, about {megabytes(needed)} for all {self._todo}"
        self._say(f"recordings: {words}; {megabytes(free)} are free on the disk")
        if needed > free:
            self._say("vsense: the disk is too small for all recordings: the rows go on without")

    def say(self) -> None:
        """All runs are done."""
        words = f"{self._done} recordings, {megabytes(self._bytes)}"
        self._console.say(f"recordings: {self._folder}, {words}")
        if self._troubles:
            self._console.say(f"vsense: {self._troubles} of them are not whole", "trouble")

    def _say(self, text: str) -> None:
        self._console.end_progress()
        self._console.say(text)
