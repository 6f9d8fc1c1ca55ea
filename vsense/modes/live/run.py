"""One run with real robots, from its first timestep to its report."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

from vsense.base.errors import VsenseError
from vsense.modes.live.portrait import Portrait
from vsense.modes.live.session import RunSession
from vsense.monitor.pictures.run_figure import RunPictureError
from vsense.run import directory as run_directory
from vsense.run import figures
from vsense.run.directory import RunLog
from vsense.run.figures import Figures, TimestepSample
from vsense.run.recasting import played
from vsense.run.robots import Readiness, shorten
from vsense.run.runtime import Step


class OneRun:
    """Carries out a run and reports about it; `failure` is what has ended it before its time."""

    def __init__(
        self,
        session: RunSession,
        directory: Path,
        readiness: Readiness,
        log: RunLog,
        observe: Callable[[Step], None] = lambda step: None,
    ) -> None:
        """The robots of `session` have been waited for; `directory` exists.

        `observe` is called after every timestep of the run.
        """
        self.failure: VsenseError | None = None
        self._session = session
        self._experiment = session.experiment
        self._directory = directory
        self._readiness = readiness
        self._log, self._observe = log, observe
        self._figures = Figures(session.experiment)
        own = session.source.own
        cameras = () if own is None else own.tracking.tracker.cameras
        self._portrait = Portrait(session.experiment, cameras)
        self._results: dict[str, float] = {}

    def run(self) -> None:
        """Carries out the run to its end; a failure is kept for after the report."""
        self._log.say("all robots start")
        for act in (self._timesteps, self._session.stop, self._end_world):
            try:
                act()
            except VsenseError as error:
                self._session.setup.room.fail(error)
                self.failure = self.failure or error
        self._log.end_progress()

    def _timesteps(self) -> None:
        runner, world = self._session.runner, self._session.environment.world
        counted = self._figures.carry_out(runner, world, self._directory, self._log)
        with closing(counted) as timesteps:
            for step, sample in timesteps:
                robots = runner.robots
                self._portrait.add(step.run_timestep, world, robots, step.frames)
                lost = [status.name for status in robots.values() if not status.connected]
                self._log.progress(self._line(step, sample, lost))
                self._observe(step)
                # Lent pictures go back during a pause.
                del step

    def _end_world(self) -> None:
        environment = self._session.environment
        try:
            self._results = environment.end()
        finally:
            for text in environment.said():
                self._log.say(f"loop functions: {text}")

    def _line(self, step: Step, sample: TimestepSample, lost: list[str]) -> str:
        experiment = self._experiment
        length = f"/{experiment.length_s:g}" if experiment.length_s else ""
        robots = len(experiment.robots)
        without = f" (not {shorten(lost)})" if lost else ""
        return (
            f"{step.run_timestep * experiment.timestep_s:5.1f}{length} s"
            f"  timestep {step.run_timestep}"
            f"  robots {sample.connected}/{robots}{without}  seen {sample.seen}/{robots}"
            f"  stale {sample.stale}"
            f"  capture to sent {(step.sent_ns - step.capture_ns) / 1e6:.0f} ms"
        )

    def report(self) -> dict[str, Any] | None:
        """Measures, writes, and prints the figures; None where nothing was measured."""
        session, environment = self._session, self._session.environment
        if not len(self._figures.steps):
            self._log.say("vsense: the run ended before its first timestep: nothing was measured")
            return None
        summary: dict[str, Any] = {
            "experiment": self._experiment.name,
            "run": session.runner.control.run,
            "seed": environment.seed,
            "blind": environment.blind,
            "robots": len(self._experiment.robots),
            "resting": list(session.resting),
            "parts": played(self._experiment, session.runner.robots),
            "source": session.source.figures(),
            **self._figures.summary(session.runner, self._readiness, self._results),
        }
        self._log.say(figures.table(summary))
        try:
            run_directory.write_summary(self._directory, summary, False)
            self._draw()
        except (run_directory.DirectoryError, RunPictureError) as error:
            # A full disk costs this run's files, not the runs that follow.
            self._log.say(f"the run's figures are not kept: {error}", "trouble")
        return summary

    def _draw(self) -> None:
        environment, name = self._session.environment, self._experiment.name
        path = self._directory / f"{name}.png"
        count = len(self._experiment.robots)
        source = self._session.source.name
        subtitle = f"{count} robots, seed {environment.seed}; arena states from {source}"
        if self._portrait.draw(path, environment.world, environment.blind, subtitle):
            self._log.say(f"picture: {path}")
