"""What is kept of a simulated run while it goes on, and after it: tables, recording, picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from vsense.base.errors import VsenseError
from vsense.base.message_bus import MessageBus
from vsense.modes.sim._simulation import Simulation
from vsense.modes.sim.job import Job
from vsense.monitor.pictures.run_samples import RunSamples
from vsense.monitor.recording import MCAP
from vsense.run.directory import LOGGED, TRAJECTORY, RunTables

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

    from vsense.modes.sim._paced import PacedRun
    from vsense.modes.sim._publishing import SimPublisher
    from vsense.modes.sim._recording import SimRecorder


def prepare(job: Job, watched: bool) -> None:
    """Imports what a job's run needs beside the simulation, before the fork that does it."""
    if watched or job.recording is not None:
        from vsense.modes.sim import _paced, _recording  # noqa: F401


class KeptRun:
    """Keeps one simulation, as its job wants it; nothing in it changes the run.

    A run of a campaign keeps nothing but its recording, where one is wanted.
    """

    def __init__(self, run: Simulation, job: Job, page: Connection | None = None) -> None:
        """Prepares everything; `page` watches and paces the run. VsenseError if a file fails."""
        self._run, self._job = run, job
        self._tables: RunTables | None = None
        self._recorder: SimRecorder | None = None
        self._publisher: SimPublisher | None = None
        self._paced: PacedRun | None = None
        if job.directory is not None:
            experiment = run.environment.experiment
            run.samples = RunSamples(experiment, 1)  # a simulation misses none
            run.record.keep_events(Path(job.directory) / LOGGED)
            note = lambda text: run.record.note_event(len(run.record.timesteps), text)  # noqa: E731
            self._tables = RunTables(Path(job.directory), experiment.timestep_s, note)
        if page is not None:
            from vsense.modes.sim._paced import PacedRun

            self._paced = PacedRun(page, run, job.setup.blind, self._switch, self._recording)
            run.gate = self._paced.gate
        if job.recording is not None:
            self._record(True, Path(job.recording))
        if self._tables or self._recorder or self._paced:
            run.observe = self._observe

    def _observe(self, run_timestep: int) -> None:
        if self._tables is not None:
            self._note(run_timestep)
        if self._paced is not None:
            self._paced.note(run_timestep)
        if self._publisher is not None:
            self._publisher.observe(run_timestep)

    def _switch(self, on: bool) -> str:
        """Records from now on, or no more; gives why not, "" where it worked."""
        path = Path(self._job.directory or ".") / f"{self._run.environment.experiment.name}{MCAP}"
        try:
            self._record(on, path)
        except VsenseError as error:
            return f"run not recorded: {error}"
        return ""

    def _record(self, on: bool, path: Path) -> None:
        if self._recorder is not None:
            self._recorder.switch(on)
        elif on:
            from vsense.modes.sim._publishing import SimPublisher, SimState
            from vsense.modes.sim._recording import SimRecorder, clear

            clear(path)
            bus, blind = MessageBus(), self._job.setup.blind
            self._recorder = SimRecorder(bus, path, self._run.now_ns)
            changes = None if self._paced is None else self._paced.changes
            arguments = bus, self._run, blind, SimState(), self._recording, changes
            self._publisher = SimPublisher(*arguments)

    def _recording(self) -> dict[str, Any] | None:
        return None if self._recorder is None else self._recorder.state()

    def _note(self, run_timestep: int) -> None:
        """Writes a row of the tables: there are neither pictures nor links."""
        run = self._run
        timestep, capture_ns = run.moment(run_timestep)
        numbers, times_ns = (run_timestep, timestep), (capture_ns, None, None, None)
        counts = None, len(run.record.tags), None
        assert self._tables is not None
        self._tables.add(numbers, times_ns, counts, run.environment.world.results)

    @property
    def changes(self) -> int:
        """So often somebody has changed its world."""
        return 0 if self._paced is None else self._paced.changes.carried

    def end(self) -> dict[str, Any] | None:
        """Ends tables and recording; gives what became of that: see `SimRecorder.close`."""
        if self._tables is not None:
            self._tables.close()
        if self._publisher is not None:
            self._publisher.end()
        if self._paced is not None:
            self._paced.end()
        return None if self._recorder is None else self._recorder.close()

    def save(self) -> None:
        """Writes `TRAJECTORY` and the picture of a run that is kept and has a timestep at least."""
        run, job = self._run, self._job
        if job.directory is None or run.samples is None or not len(run.record.timesteps):
            return
        from vsense.monitor.pictures import run_figure  # no run of a campaign has a picture

        directory = Path(job.directory)
        experiment = run.environment.experiment
        run.record.save(directory / TRAJECTORY)
        run.record.save_notes(directory)
        figure = run.record.figure(run.samples, run.environment.world)
        subtitle = f"{len(run.record.tags)} simulated robots, seed {job.seed}"
        run_figure.save(figure, directory / f"{experiment.name}.png", job.setup.blind, subtitle)
