"""The runs of a series in the lab: each in processes of its own, robots where they stood."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from vsense.base.arena import ArenaState
from vsense.base.errors import CutShort, VsenseError
from vsense.base.interruption import Interruption
from vsense.base.terminal import Console
from vsense.config.specs import Pose
from vsense.modes.lab.calibrated import CalibratedRig
from vsense.modes.lab.experiment import calibrate_cameras, report_run
from vsense.modes.lab.hardware import EmulatedLab, report_all
from vsense.modes.lab.session import Session
from vsense.modes.live.opening import LinkOptions
from vsense.modes.live.session import RunSetup
from vsense.monitor.ui.room import ControlRoom, RoomOptions
from vsense.robots.link.key_process import KeyProcess
from vsense.robots.link.keys import LinkTrust
from vsense.run.runtime import Step
from vsense.studies.series._folder import SeriesFolder
from vsense.studies.series._order import PlannedRun
from vsense.studies.series._parts import PlanLoader, SeriesCast
from vsense.studies.series._series import RunResult
from vsense.studies.series._staged import NotEnoughRobots, StagedRun
from vsense.world.entities import Arena


class LabRuns:
    """Runs in the lab; see `RunMaker`."""

    def __init__(
        self,
        loader: PlanLoader,
        cast: SeriesCast,
        console: Console,
        interrupted: Interruption,
        lab: EmulatedLab,
        room: RoomOptions,
        link: LinkOptions | None = None,
    ) -> None:
        """`room`: how runs are seen and kept; `link`: to robots."""
        self._loader, self._cast = loader, cast
        self._lab, self._room, self._link = lab, room, link or LinkOptions()
        self._console, self._interrupted = console, interrupted
        self._poses: dict[int, Pose] = {}
        self._rigs: dict[tuple[Arena, float], CalibratedRig] = {}

    def make(self, runs: Sequence[PlannedRun], folder: SeriesFolder) -> Iterator[RunResult]:
        """Makes the first of these runs; none where the user ends it before.

        Raises:
            VsenseError: the lab cannot be made, or has failed.
        """
        run = runs[0]
        directory = folder.of_run(run)
        staged = StagedRun.of(self._loader.plan, run, self._cast.by_condition[run.cell.condition])
        with staged.control_room(self._room, self._console) as room:
            session = self._session(staged, room, directory, self._rig(staged, folder))
            try:
                self._drive(staged, session, room, directory)
            except VsenseError as error:
                room.fail(error)
                raise
        self._console.end_progress()
        if (notes := session.notes) is None:
            return
        staged.figures = notes.figures
        ended, summaries = notes.record.ended, list[dict[str, Any]]()
        if len(notes.figures.steps):
            try:
                with suppress(CutShort), self._interrupted.in_time():
                    report_run(session, summaries.append)
            except VsenseError as error:
                # A picture that the disk does not take costs no run that has figures.
                self._console.say(f"{run.name} is not reported as a whole: {error}", "trouble")
                ended = ended if summaries else str(error)
        elif self._interrupted.is_set():
            return
        yield run, staged.outcome(next(iter(summaries), None), ended, session.runner.control)
        staged.replace_lost(self._cast)

    def _rig(self, staged: StagedRun, folder: SeriesFolder) -> CalibratedRig | None:
        """The cameras of all runs in an arena, calibrated once; None: they are known exactly."""
        experiment, lab = staged.experiment, self._lab
        if not lab.calibrate:
            return None
        key = experiment.arena, experiment.marker.height_m
        if key not in self._rigs:
            place = folder.path / f"arena-{len(self._rigs) + 1}" if self._rigs else folder.path
            with self._interrupted.at_once():
                seed = staged.plan.seed
                rig = calibrate_cameras(lab, experiment, seed, place, self._console)
            assert rig is not None
            self._rigs[key] = rig
        return self._rigs[key]

    def _session(
        self, staged: StagedRun, room: ControlRoom, directory: Path, rig: CalibratedRig | None
    ) -> Session:
        robots = self._lab.robots(staged.experiment)
        origin = staged.origin(asdict(self._loader.code.absolute(Path.cwd())))
        setup = self._setup(staged, room, origin | report_all(robots.hardware))
        return Session(setup, directory, self._lab, robots, rig)

    def _setup(self, staged: StagedRun, room: ControlRoom, origin: Mapping[str, Any]) -> RunSetup:
        experiment, cell = staged.from_where(self._poses), staged.run.cell
        starts = staged.starts if self._poses else None
        address = self._link.in_lab(experiment).address(experiment)
        who = address, LinkTrust(KeyProcess()), self._console, self._interrupted
        blind = staged.planned.condition.blind
        setup = RunSetup(experiment, cell.seed, blind, *who, room, origin, starts)
        return replace(setup, criteria=staged.plan.void)

    def _drive(
        self, staged: StagedRun, session: Session, room: ControlRoom, directory: Path
    ) -> None:
        """Carries the run out, and notes where everybody is then."""
        plan, run = staged.plan, staged.run
        newest: list[ArenaState] = []

        def observe(step: Step) -> None:
            newest[:] = [step.state]  # not its pictures, which are lent
            time_s = step.run_timestep * session.experiment.timestep_s
            self._console.progress(
                f"run {run.cell.number} of {plan.runs} ({run.in_words()})"
                f" {time_s:5.1f}/{session.experiment.length_s:g} s"
            )

        with session:
            room.begin_run(session.environment, directory)
            readiness = staged.wait(session, self._cast)
            if not readiness.complete and not self._interrupted.is_set():
                logs = f"the robots' logs are in {directory / 'robots'}"
                raise NotEnoughRobots(
                    f"{run.name} cannot begin: {readiness.missing_text()} ({logs})"
                )
            session.home()
            if self._interrupted.is_set():
                return
            staged.begin()
            session.run(directory, observe)
            room.recorders.end_run()
        for state in newest:
            rows = state.robots
            for tag, x_m, y_m, yaw_rad in zip(
                *(rows[name].tolist() for name in ("tag", "x_m", "y_m", "yaw_rad"))
            ):
                self._poses[tag] = Pose(x_m, y_m, yaw_rad)
