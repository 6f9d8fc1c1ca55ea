"""One run in the lab: starts every process, handles all timesteps, and ends everything again."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from vsense.base.errors import VsenseError
from vsense.base.files import log_ends
from vsense.base.shared import LabError
from vsense.config.casting import Pair
from vsense.config.specs import Experiment
from vsense.modes.lab._camera_spec import robot_body, spec_for
from vsense.modes.lab._canary import Canary
from vsense.modes.lab._grabber import LabGrabber
from vsense.modes.lab._metrics import TrackingTally
from vsense.modes.lab._optics import vignetting
from vsense.modes.lab._physics_process import PhysicsHandle
from vsense.modes.lab._run_logs import RunLogs
from vsense.modes.lab._swarm import LabRobot, LabSwarm, daemons_of
from vsense.modes.lab.calibrated import CalibratedRig
from vsense.modes.lab.hardware import NOMINAL, EmulatedLab, LabRobots, to_markers
from vsense.modes.lab.truth import TruthReader, make_ring
from vsense.modes.live.session import ROBOT_WAIT_S, Busy, ExperimentSession, RunSetup
from vsense.monitor.pictures.run_figure import RunCameras
from vsense.monitor.pictures.run_samples import RunSamples
from vsense.robots import boards, build
from vsense.robots.link.status import RobotStatus
from vsense.run.cast import played, spares_for
from vsense.run.changing import Ground
from vsense.run.figures import Figures
from vsense.run.robots import Readiness
from vsense.run.runtime import Step
from vsense.run.verdict import LINK_S, RunRecord
from vsense.vision.markers.families import load_family
from vsense.vision.tracking.arena_tracker import ArenaTracker
from vsense.vision.tracking.camera_tracking import CameraTracking
from vsense.world.robot_models import EPUCK

READY_TIMEOUT_S = 20.0
"""All robots must be connected and seen within this time."""


def no_link() -> dict[str, int]:
    """The counters of a link that failed before it could be asked."""
    return dict.fromkeys(("sent", "received", "dropped", "reconnects", "defects"), 0)


@dataclass(slots=True)
class RunNotes:
    """The host's notes of a run.

    Attributes:
        directory: where the run's figures go.
        resting: robots that were not in it, as `ExperimentSession.resting`.
        experiment: with who plays in this run.
        robots: they, in its order.
        parts: who played which part, as in summaries.
        record: what there was of it, for its verdict.
        figures: the run's timesteps, counted.
        tracking: what was read of the markers, against the truth.
        samples: the virtual world and the experiment's measures over time.
        measures: the experiment's own, of the whole run.
        seen: the cameras' pictures at chosen timesteps of the run.
        link: `sent`, `received`, `dropped` packets with readings, `reconnects`, `defects`.
        lateness_ms: the canary's ticks.
        logs: of all other processes.
    """

    samples: RunSamples
    figures: Figures
    tracking: TrackingTally
    seen: RunCameras
    seed: int
    directory: Path
    experiment: Experiment
    robots: Sequence[LabRobot]
    logs: RunLogs
    parts: Sequence[Mapping[str, Any]] = ()
    resting: tuple[str, ...] = ()
    record: RunRecord = field(default_factory=lambda: RunRecord(ended=""))
    measures: dict[str, float] = field(default_factory=dict)
    link: dict[str, int] = field(default_factory=no_link)
    lateness_ms: list[float] = field(default_factory=list)

    def end(
        self,
        parts: Sequence[Mapping[str, Any]],
        link: dict[str, int],
        lateness_ms: list[float],
        record: RunRecord,
    ) -> None:
        """The run is over, with these."""
        self.parts, self.link = parts, link
        self.lateness_ms, self.record = lateness_ms, record


class Session(ExperimentSession):
    """Everything that runs in the lab; no process is left behind.

    Attributes:
        notes: of the present run, or the last one; None: none has begun.
    """

    quiet = frozenset({"connected"})

    def __init__(
        self,
        setup: RunSetup,
        directory: Path,
        lab: EmulatedLab,
        robots: LabRobots = NOMINAL,
        rig: CalibratedRig | None = None,
        legacy_port: int | None = None,
    ) -> None:
        """Prepares runs in a lab.

        Args:
            directory: exists.
            robots: what they differ in.
            rig: cameras in place of the lab's, tracked with as far as they are known.
            legacy_port: there the original's client gets the readings of a robot of the lab.

        Raises:
            VsenseError: something in the experiment cannot be made.
        """
        super().__init__(setup, legacy_port)
        self.directory = directory
        self.truth_log = directory / "truth.bin"
        self.notes: RunNotes | None = None
        self._lab = lab
        self.rig, self.robots = rig, robots
        self._ready = False
        self._fallen: list[str] = []
        self.dt_ns = setup.experiment.timestep_ns

    def _open(self) -> None:
        experiment, seed = self.experiment, self.setup.seed
        port = self._start_server()
        truth = make_ring(len(experiment.robots) + len(experiment.objects))
        self._stack.callback(truth.close)
        self._truth = TruthReader(truth.name)
        self._stack.callback(self._truth.close)
        # The cameras build their scene while everything else starts.
        hardware = self.robots.hardware
        true = None if self.rig is None else self.rig.true
        where = truth.name, seed, self.truth_log, self._lab.cameras
        spec = spec_for(experiment, *where, true, hardware, self.robots.worn)
        self._markers = np.array([body.marker for body in spec.bodies])
        grabber = LabGrabber(spec)
        self._stack.callback(grabber.close)
        self._grabber = grabber
        daemons = daemons_of(experiment)
        self.cameras = grabber.cameras if self.rig is None else list(self.rig.solved)
        self.tracking = self._track(grabber)
        self._stack.callback(self.tracking.close)
        of_base = self._lab.base, self._lab.firmware_watchdog
        floor = experiment, truth.name, seed, self.directory, *of_base
        self.floor = PhysicsHandle(*floor, hardware, self.robots.black)
        self._stack.callback(self.floor.close)
        keys = self.setup.trust.keys
        place = experiment.host, port, seed, self.directory / "robots"
        self.swarm = LabSwarm(*place, keys, self.robots.radios)
        self._stack.callback(self.swarm.end)
        for robot, base in zip(experiment.robots, self.floor.bases):
            settings = self.robots.settings.get(robot.tag, {})
            self.swarm.start(daemons[robot.controller], robot.tag, robot.id, base, settings)
        recorders = self.setup.room.recorders
        recorders.watch_family(experiment.marker, self.tracking, experiment.timestep_s)
        scene = self._scene("lab", self.cameras, {}, self.tracking.troubles)
        if self.rig is not None:
            scene = replace(scene, calibration=self.rig.checked)
        runtime = self._open_room(self.tracking, scene, ground=Ground(self.floor.put))
        grabber.start()
        runtime.open()
        self._stack.callback(runtime.close)

    def _track(self, grabber: LabGrabber) -> CameraTracking:
        experiment = self.experiment
        # Who may be put in between runs is known as soon as it is seen.
        tags = (*self._tags, *spares_for(experiment))
        models = experiment.models
        heights = {tag: experiment.marker_height_m(models.get(tag, EPUCK)) for tag in tags}
        family = load_family(experiment.marker.family)
        offsets = self.robots.markers
        tracker = ArenaTracker.for_family(self.cameras, family, heights, offsets=offsets)
        return CameraTracking(grabber, tracker, self.setup.console.say)

    @property
    def _tags(self) -> list[int]:
        """The markers of all bodies, in the order of the truth."""
        return list(self.experiment.tags.values())

    def wait_until_ready(self) -> None:
        """Handles timesteps until every robot is connected and every tag is seen.

        Later runs of a series start without those that are missing after `ROBOT_WAIT_S`.

        Raises:
            LabError: before the first run a daemon has ended, or a robot or tag is still missing
                after `READY_TIMEOUT_S`; the message names them.
            NoRobotError: before a later run no robot is there.
        """
        if self.runner.control.run > 1:
            self.wait_for_some(ROBOT_WAIT_S)
            return
        try:
            readiness = self.runner.wait(READY_TIMEOUT_S)
        except VsenseError:
            self.floor.check()
            raise
        self._ready = True
        started = self.setup.interrupted.is_set() or self.runner.control.asked
        if not readiness.complete and not started:
            logs = f" (the robots' logs are in {self.directory / 'robots'})"
            raise LabError(
                f"the swarm is not ready after {READY_TIMEOUT_S:.0f} s;"
                f" {readiness.missing_text()}{logs if readiness.absent else ''}"
            )

    def wait_patiently(self, limit_s: float | None, busy: Busy = lambda: "") -> Readiness:
        """See `ExperimentSession`; a daemon that ends is told from now on, and the rest goes on."""
        self._ready = True
        try:
            return super().wait_patiently(limit_s, busy)
        except VsenseError:
            self.floor.check()
            raise

    def _observe(self, step: Step | None, robots: Mapping[int, RobotStatus]) -> None:
        """Checks daemons; LabError where one has ended before all were ready."""
        super()._observe(step, robots)
        for robot, how in self.swarm.fallen():
            log = self.swarm.log(robot.tag)
            if not self._ready:
                said = boards.in_words(log_ends(log)).strip().splitlines()
                raise LabError(f"robot {robot.tag}: its daemon {how}: {said[-1] if said else ''}")
            self._fallen.append(f"robot {robot.tag}'s controller {how}")
            self.setup.console.say(
                f"robot {robot.tag}: its daemon {how} (log: {log});"
                " the experiment goes on without it;"
                f" start it again with {self.swarm.script(robot.tag)}"
            )

    def _notes(self, directory: Path) -> RunNotes:
        experiment = self.experiment
        samples, height_m = RunSamples(experiment), experiment.marker.height_m
        return RunNotes(
            samples,
            Figures(experiment),
            TrackingTally(self._tags),
            RunCameras(self.cameras, height_m, samples.moment, vignetting),
            self.environment.seed,
            directory,
            experiment,
            tuple(self.swarm.robots),
            RunLogs(self.truth_log, self.floor.log, self.swarm.robots),
            resting=self.resting,
        )

    def run(self, directory: Path, observe: Callable[[Step], None]) -> None:
        """Starts all robots together, handles the run's timesteps, and stops them.

        `directory` is that of the run's figures; `observe` is called after every timestep.

        Raises:
            VsenseError: something has failed; what was recorded until then is kept.
        """
        notes = self.notes = self._notes(directory)
        canary = Canary()
        self._stack.callback(canary.close)
        failure: VsenseError | None = None
        try:
            self._run_timesteps(notes, observe)
        except VsenseError as error:
            failure = error
        self.stop()
        parts, lateness_ms = played(self.experiment, self.runner.robots), canary.end()
        record = self.record_of(notes.figures, failure)
        record = replace(record, unlogged=self._unlogged(notes))
        notes.end(parts, self.runner.link_figures(), lateness_ms, record)
        self.judge(notes.record)
        if failure is not None:
            # Without physics the cameras fail, too: report what failed first.
            self.floor.check()
            raise failure
        try:
            notes.measures = self.environment.end()
        finally:
            for text in self.environment.said():
                self.setup.console.say(f"loop functions: {text}")

    def _unlogged(self, notes: RunNotes) -> list[str]:
        """What the logs of a run that is over lack, in words; see `RunRecord`."""
        standing, robots = self.runner.standing, self.runner.robots
        driving = [
            robot
            for robot in notes.robots
            if robots[robot.tag].connected
            and robot.name not in self.resting
            and not any(standing.stood_s(robot.tag))  # who stands makes no steps
        ]
        timesteps = notes.figures.steps.columns()[0]
        return notes.logs.end(timesteps, driving, round(LINK_S * 1e9 / self.dt_ns))

    def record_of(self, figures: Figures, failure: VsenseError | None) -> RunRecord:
        """See `ExperimentSession`; of controllers their logs tell here, and how daemons ended."""
        record = super().record_of(figures, failure)
        failed = (*record.failed, *self._fallen)
        return replace(record, complaints=self.swarm.complaints(), failed=failed)

    def _run_timesteps(self, notes: RunNotes, observe: Callable[[Step], None]) -> None:
        samples = notes.samples
        world, console = self.environment.world, self.setup.console
        step: Step | None = None
        try:
            counted = notes.figures.carry_out(self.runner, world, notes.directory, console)
            with closing(counted) as timesteps:
                for step, _ in timesteps:
                    self._judge(step, notes.tracking)
                    samples.add(step.run_timestep, world)
                    if step.run_timestep in samples.timesteps or not notes.seen.pictures:
                        # Of the first ones, too: later ones take their memory.
                        notes.seen.keep(step.run_timestep, step.frames)
                    observe(step)
        finally:
            samples.end(self.environment.world)
            if step is not None:
                notes.seen.keep(step.run_timestep, step.frames)

    def next_run(self) -> None:
        """See `ExperimentSession`."""
        self._fallen.clear()
        super().next_run()

    def _unable(self, tag: int) -> str:
        """See `ExperimentSession`."""
        family = load_family(self.experiment.marker.family)
        if not 0 <= tag < family.tags:
            return f"the markers {family.name} have tags from 0 to {family.tags - 1}"
        if self.robots.hardware and tag not in self.robots.hardware:
            return f"the lab has drawn no robot {tag}: --roster names those that it has"
        return ""

    def _make_room(self, pair: Pair, experiment: Experiment) -> None:
        """Another robot stands where the one stood, with a marker and a daemon of its own."""
        out, new = pair
        row = next(n for n, robot in enumerate(self.experiment.robots) if robot.tag == out)
        robot, built = experiment.robots[row], self.robots.hardware.get(new)
        body = robot_body(experiment, new, built, self.robots.worn)
        if built is not None:
            self.floor.rebuild(row, built)
        self._grabber.dress(row, body)
        self._markers[row] = body.marker
        daemon = build.daemon(experiment.controller_of(robot).program)
        self.swarm.replace(row, daemon, new, self.robots.settings.get(new, {}))

    def _judge(self, step: Step, tracking: TrackingTally) -> None:
        """Compares what was read of the markers with the truth, while the ring holds it."""
        try:
            poses, _ = self._truth.at(step.capture_ns)
        except LabError:
            return  # the host is seconds late, and says so
        tracking.add(step.state.sightings, to_markers(poses, self._markers))
