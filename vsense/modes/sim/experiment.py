"""One simulation: with a page or without, its files, and what is said of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vsense.base.errors import Interrupted, VsenseError
from vsense.base.interruption import Interruption, interruption
from vsense.base.terminal import Console, measure_rows
from vsense.config.placement import settle
from vsense.config.specs import Experiment
from vsense.modes import origin
from vsense.modes.lab._metrics import swarm_rows
from vsense.modes.options import choose_seed, say_warnings
from vsense.modes.sim.job import Job, Setup, SimOptions, setup_of
from vsense.modes.sim.outcome import SimulatedRunError, Task, libraries_of, record_of
from vsense.modes.sim.watch import Show, WorkerProcess, simulate_all
from vsense.monitor.recording import MCAP, size_line
from vsense.run import directory as run_directory
from vsense.run.directory import LOGGED, TRAJECTORY
from vsense.run.environment import MOST_SEED
from vsense.run.verdict import VoidCriteria, exit_code, table_rows

if TYPE_CHECKING:
    from vsense.modes._several import Series
    from vsense.modes.sim._room import SimRoom, WatchedRuns


def run(options: SimOptions) -> int:
    """Simulates an experiment; with a page others may follow.

    Returns:
        0, or 130 after Ctrl-C, 143 after SIGTERM; with a page that of the newest run's failure.

    Raises:
        UsageError: something is missing or does not go together.
        VsenseError: it cannot be simulated, or has failed.
    """
    console = Console()
    runs = _SingleRun.of(options, console)
    with interruption() as interrupted:
        try:
            if options.web is None:
                return exit_code([runs.run(interrupted)[0]])
            return runs.run_watched(interrupted)
        except Interrupted:
            console.end_progress()
            return interrupted.code


def simulate(
    options: SimOptions, console: Console, interrupted: Interruption
) -> tuple[dict[str, Any], Path]:
    """Simulates an experiment once: its figures, as summary.json has them, and its folder.

    Raises:
        Interrupted: `interrupted` was set; the figures until then are in the folder.
        UsageError, VsenseError: as `run`.
    """
    return _SingleRun.of(options, console).run(interrupted)


@dataclass(frozen=True, slots=True)
class _SingleRun:
    """A run that is no campaign; with a page there may be others after it."""

    options: SimOptions
    setup: Setup
    experiment: Experiment
    console: Console

    @classmethod
    def of(cls, options: SimOptions, console: Console) -> _SingleRun:
        """Loads the experiment; raises as `run`."""
        options.check()
        setup = setup_of(options.experiment)
        experiment = setup.fit(options.experiment.load())
        say_warnings(experiment, console)
        return cls(options, setup, experiment, console)

    def run(self, interrupted: Interruption) -> tuple[dict[str, Any], Path]:
        """Does the run: figures, trajectories, and a table for people; raises as `simulate_all`."""
        job = self._job()
        self._announce(job)
        tasks = [Task(job, self.experiment)]
        try:
            for _, result in simulate_all(tasks, 1, interrupted, self._show()):
                summary = self._report(job, result, self.options.json)
        except VsenseError as error:
            self._report_failure(job, error, self.options.json)
            raise
        return summary, Path(job.directory or ".")

    def run_watched(self, interrupted: Interruption) -> int:
        """Does runs that a page watches, until a signal ends the process.

        Returns:
            As `exit_code`; 130 after Ctrl-C, 143 after SIGTERM in the middle of a run, whose
            figures and files are there all the same; as of the newest run's failure.
        """
        # These need the extra `web`.
        from vsense.modes._several import Series
        from vsense.modes.sim._room import SimRoom, WatchedRuns
        from vsense.monitor.ui.room import ControlRoom

        options, output, seed = self.options, self.options.experiment.output, self._seed()
        libraries, speed = libraries_of(self.experiment), options.speed or 1.0
        with (
            ControlRoom(options.room, self.console) as control_room,
            SimRoom(control_room, self.experiment, seed, speed) as room,
        ):
            directory = run_directory.make(output, self.experiment.name, seed)
            say = self.console.say
            series = Series(self.experiment.name, directory, 1, False, interrupted, say)
            with WatchedRuns(room, interrupted) as runs:
                self._watched(room, runs, series, libraries)
        series.end(None, self.options.json)
        if runs.failure is not None:
            return runs.failure.exit_code
        return interrupted.code if runs.cut else exit_code(series.summaries)

    def _watched(
        self,
        room: SimRoom,
        runs: WatchedRuns,
        series: Series,
        libraries: dict[str, str],
    ) -> None:
        """Does runs as they are wanted."""
        console, control = self.console, room.control
        while True:
            job = self._job(series.directory(control.run), room.seed, libraries)
            self._announce(job)
            room.begin_run(Path(job.directory or "."))
            try:
                result = runs.run(Task(job, self.experiment), self._show())
                console.end_progress()
                series.add(self._report(job, result, False, control.why))
            except VsenseError as error:
                for summary in self._report_failure(job, error):
                    series.add(summary)
                # The page stays: who watches shall see what has failed, and may go on.
                console.say(f"vsense: {error}", "trouble")
            room.end_run()
            console.say("the run is over; its page stays until Ctrl-C, reset begins the next one")
            idle = lambda: console.progress("the run is over: Ctrl-C ends vsense")  # noqa: E731
            while wanted := runs.rest(idle):
                if series.prepares_next(control):
                    break
            if not wanted:
                return
            console.end_progress()
            room.next_run(room.seed % MOST_SEED + 1)

    def _job(
        self,
        directory: Path | None = None,
        seed: int | None = None,
        libraries: dict[str, str] | None = None,
    ) -> Job:
        """The run; without arguments the only one, in a new directory."""
        name = self.experiment.name
        if directory is None:
            seed, libraries = self._seed(), libraries_of(self.experiment)
            directory = run_directory.make(self.options.experiment.output, name, seed)
        assert seed is not None and libraries is not None
        recording = str(directory / f"{name}{MCAP}") if self.options.record else None
        setups = {origin.key_of(): self.setup}
        origin.keep(directory, "sim", [self.experiment], self.console.say, setups)
        return Job(self.setup, seed, libraries, str(directory), recording)

    def _seed(self) -> int:
        """The first run's seed; ConfigError where there is no place for all with it."""
        seed = choose_seed(self.options.experiment.seed, self.experiment)
        settle(self.experiment, seed)
        return seed

    def _announce(self, job: Job) -> None:
        experiment = self.experiment
        self.console.say(
            f"{experiment.name}: {len(experiment.robots)} robots, seed {job.seed},"
            f" {experiment.length_s:g} s; results in {job.directory}"
        )
        if job.recording is not None:
            self.console.say(f"recording to {job.recording}")

    def _show(self) -> Show:
        """Makes the function that updates the live line."""
        experiment = self.experiment

        def show(workers: Sequence[WorkerProcess[Task]]) -> None:
            done = max(worker.timesteps for worker in workers)
            time_s = done * experiment.timestep_s
            self.console.progress(f"{time_s:6.1f}/{experiment.length_s:g} s  timestep {done}")

        return show

    def _report_failure(
        self, job: Job, error: VsenseError, on_stdout: bool = False
    ) -> list[dict[str, Any]]:
        """Says that a run has failed, and writes its figures, if it was one; gives these."""
        self.console.end_progress()
        summaries = []
        if isinstance(error, SimulatedRunError):
            summaries = [self._summary(job, error.result)]
            try:
                run_directory.write_summary(Path(job.directory or "."), summaries[0], on_stdout)
            except run_directory.DirectoryError as lacking:
                # The run's own failure is what is raised.
                self.console.say(f"the run's figures are not kept: {lacking}", "trouble")
        self.console.say(f"the run has failed; what there is of it: {job.directory}")
        return summaries

    def _summary(self, job: Job, result: dict[str, Any], ended: str = "") -> dict[str, Any]:
        """A run's figures with their verdict."""
        record = record_of(result, ended)
        swarm = {"swarm": result["swarm"]} if self.experiment.sources else {}
        verdict = record.judge(VoidCriteria()).facts()
        return {**_summarise(job, result), "ended": record.ended, **swarm, **verdict}

    def _report(
        self, job: Job, result: dict[str, Any], on_stdout: bool, ended: str = ""
    ) -> dict[str, Any]:
        """Writes and prints a run's figures; `ended`: why, where it did before its end."""
        console, directory = self.console, Path(job.directory or ".")
        console.end_progress()
        summary = self._summary(job, result, ended)
        self._say_events(result, directory)
        run_directory.write_summary(directory, summary, on_stdout)
        console.say(_table(summary))
        console.say(f"trajectories: {directory / TRAJECTORY}")
        console.say(f"picture: {directory / self.experiment.name}.png")
        if result["recording"] is not None:
            _say_recording(console, result["recording"])
        return summary

    def _say_events(self, result: dict[str, Any], directory: Path) -> None:
        """Says what controllers complained of, and the first of what they logged."""
        for complaint in result["complaints"]:
            self.console.say(f"vsense: {complaint}")
        for time_s, text in result["events"]:
            self.console.print_only(f"{time_s:8.1f} s  {text}")  # a page has heard it in the run
        more = result["events_in_all"] - len(result["events"])
        if more:
            self.console.say(f"{more} more events: {directory / LOGGED}")


def _say_recording(console: Console, state: dict[str, Any]) -> None:
    """Says where a run's recording is, how large, and what is wrong with it."""
    console.say(size_line(state["file"], state["bytes"], state["seconds"]))
    if state["trouble"]:
        console.say(f"vsense: the recording is not whole: {state['trouble']}", "trouble")


def _summarise(job: Job, result: dict[str, Any]) -> dict[str, Any]:
    """Gives a run's figures under the names that scripts rely on."""
    duration_s, wall_s = result["timesteps"] * result["timestep_s"], result["wall_s"]
    return {
        "experiment": result["name"],
        "seed": job.seed,
        "blind": job.setup.blind,
        "settings": dict(job.setup.settings),
        "robots": result["robots"],
        "timesteps": result["timesteps"],
        "duration_s": round(duration_s, 3),
        "speedup": None if wall_s is None else round(duration_s / wall_s, 1),
        "measures": result["measures"],
    }


def _table(summary: dict[str, Any]) -> str:
    """The summary as a person reads it."""
    text = (
        f"{summary['duration_s']:g} s of {summary['robots']} robots,"
        f" {summary['speedup']:g} times as fast as real time"
    )
    rows = [("run", text), *table_rows(summary)]
    rows += swarm_rows(summary.get("swarm"), summary["robots"])
    rows += measure_rows(summary["measures"])
    return "\n".join(f"{name:<10}{text}" for name, text in rows)
