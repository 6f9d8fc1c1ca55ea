"""One run with real robots, from its first timestep to its report, and the picture of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Frame
from vsense.base.errors import VsenseError
from vsense.base.terminal import shorten
from vsense.config.specs import Experiment
from vsense.modes.live.session import RunSession
from vsense.monitor.pictures import run_figure
from vsense.monitor.pictures.run_figure import RunCameras, RunFigure, RunPictureError
from vsense.monitor.pictures.run_samples import SPARE_TIMESTEPS, RunSamples
from vsense.robots.link.status import RobotStatus
from vsense.run import directory as run_directory
from vsense.run import figures
from vsense.run.cast import played
from vsense.run.directory import RunLog
from vsense.run.figures import Figures, TimestepSample
from vsense.run.link_check import RunLinkCheck
from vsense.run.robots import Readiness
from vsense.run.runtime import Step
from vsense.run.verdict import RunRecord, judged
from vsense.vision.cameras.camera import Camera
from vsense.world.world import NEVER_NS, World

MOST_TIMESTEPS = 6_000
"""Ten minutes at 10 Hz: of longer runs every second timestep is kept, every fourth, and so on."""


class Portrait:
    """The picture of a run: the state that the host knew, at chosen moments.

    It is filled timestep by timestep while the run goes on; `cameras` are our own, in any order.
    """

    def __init__(self, experiment: Experiment, cameras: Sequence[Camera] = ()) -> None:
        self._experiment = experiment
        self._samples = RunSamples(experiment)
        moment = self._samples.moment
        self._cameras = RunCameras(cameras, experiment.marker.height_m, moment)
        self._source = experiment.source
        self._every = 1
        self._timesteps: list[int] = []
        self._poses: list[NDArray[np.float64]] = []
        self._sighted: list[NDArray[np.bool_]] = []
        self._lit: list[list[bool]] = []
        self._inside: list[NDArray[np.bool_]] = []

    def add(
        self,
        run_timestep: int,
        world: World,
        robots: Mapping[int, RobotStatus],
        frames: Sequence[Frame] = (),
    ) -> None:
        """Adds a timestep, the links' statuses by tag, and the pictures; `world` is up to date."""
        self._look(run_timestep, frames)
        if run_timestep % self._every and run_timestep not in self._samples.timesteps:
            return
        rows = world.robots[: len(self._experiment.robots)]
        self._timesteps.append(run_timestep)
        self._poses.append(np.stack([rows[key] for key in ("x_m", "y_m", "yaw_rad")], axis=-1))
        self._sighted.append(rows["capture_ns"] != NEVER_NS)
        self._lit.append([robots[robot.tag].lit for robot in self._experiment.robots])
        if self._source is not None:
            cone = world.cone(self._source)
            places = self._poses[-1][:, :2]
            outside = np.zeros(len(places), bool)
            self._inside.append(outside if cone is None else cone.contains(places))
        self._samples.add(run_timestep, world)
        if len(self._timesteps) >= MOST_TIMESTEPS:
            self._thin()

    def _look(self, run_timestep: int, frames: Sequence[Frame]) -> None:
        """Copies pictures once in a second, and where a view or the run's end may need them.

        Nobody knows which timestep is the last one of a run that is stopped.
        """
        second = max(round(self._experiment.ticks_per_second), 1)
        last = self._experiment.timesteps - 1
        if (
            run_timestep in self._samples.timesteps
            or run_timestep % second == 0
            or last - SPARE_TIMESTEPS < run_timestep <= last
        ):
            self._cameras.keep(run_timestep, frames)

    def _thin(self) -> None:
        """Forgets every other timestep, but for those of a view and the last."""
        self._every *= 2
        last, kept = self._timesteps[-1], self._samples.timesteps
        stay = [t % self._every == 0 or t in kept or t == last for t in self._timesteps]
        self._timesteps = list(compress(self._timesteps, stay))
        self._poses = list(compress(self._poses, stay))
        self._sighted = list(compress(self._sighted, stay))
        self._lit = list(compress(self._lit, stay))
        self._inside = list(compress(self._inside, stay))
        self._samples.thin(stay)

    def draw(self, path: Path, world: World, blind: bool, subtitle: str) -> bool:
        """Draws the picture after the run, into an existing folder; `subtitle` says how it was run.

        False if no robot was ever seen; PictureError if the file cannot be written.
        """
        sighted = np.array(self._sighted)
        if not sighted.any():
            return False
        self._samples.end(world)
        run_figure.save(self._figure(sighted), path, blind, subtitle)
        return True

    def _figure(self, sighted: NDArray[np.bool_]) -> RunFigure:
        """The figure of the robots that were seen at all."""
        seen = sighted.any(axis=0)
        poses = np.array(self._poses)
        # Before a robot was seen for the first time it stands where that was.
        first = sighted.argmax(axis=0)
        for robot in np.flatnonzero(seen):
            poses[: first[robot], robot] = poses[first[robot], robot]
        return RunFigure(
            self._experiment,
            np.array(self._timesteps, np.int64),
            poses[:, seen],
            np.array(self._lit)[:, seen],
            np.array(self._inside)[:, seen] if self._source is not None else None,
            self._experiment.turn_timestep,
            self._samples,
            cameras=self._cameras,
        )


class OneRun:
    """Carries out a run and reports about it.

    Attributes:
        failure: what has ended it before its time.
        figures: of its timesteps.
    """

    def __init__(
        self,
        session: RunSession,
        directory: Path,
        readiness: Readiness,
        log: RunLog,
        check: RunLinkCheck,
    ) -> None:
        """The robots of `session` have been waited for; `directory` exists.

        `check` was made of their links before the run.
        """
        self.failure: VsenseError | None = None
        self._session = session
        self._experiment = session.experiment
        self._directory = directory
        self._readiness = readiness
        self._log, self._check = log, check
        self.figures = Figures(session.experiment)
        own = session.source.own
        cameras = () if own is None else own.tracking.tracker.cameras
        self._portrait = Portrait(session.experiment, cameras)
        self._results: dict[str, float] = {}
        self._record = RunRecord(timesteps=False)

    def run(self) -> None:
        """Carries out the run to its end; a failure is kept for after the report."""
        self._log.say("all robots start")
        for act in (self._timesteps, self._session.stop, self._end_world):
            try:
                act()
            except VsenseError as error:
                self._session.setup.room.fail(error)
                self.failure = self.failure or error
        record = self._session.record_of(self.figures, self.failure)
        self._record = replace(record, link_check=self._check.words)
        self._log.end_progress()
        self._session.judge(self._record)

    def _timesteps(self) -> None:
        runner, world = self._session.runner, self._session.environment.world
        counted = self.figures.carry_out(runner, world, self._directory, self._log)
        with closing(counted) as timesteps:
            for step, sample in timesteps:
                robots = runner.robots
                self._portrait.add(step.run_timestep, world, robots, step.frames)
                lost = [str(tag) for tag, status in robots.items() if not status.connected]
                self._log.progress(self._line(step, sample, lost))
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
            f"  old readings {sample.stale}"
            f"  capture to sent {(step.sent_ns - step.capture_ns) / 1e6:.0f} ms"
        )

    def report(self) -> dict[str, Any] | None:
        """Measures, writes, and prints the figures; None where nothing was measured."""
        session, environment = self._session, self._session.environment
        if not len(self.figures.steps):
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
            **self.figures.summary(session.runner, self._readiness, self._results),
        }
        if self._check.verdicts:
            summary["link_check"] = [verdict.as_json() for verdict in self._check.verdicts]
        summary = judged(summary, self._record, session.setup.criteria)
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
