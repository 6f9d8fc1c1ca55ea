"""One run in the lab: starts every process, lives all timesteps, and ends everything again."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path

from vsense.arena import Frame
from vsense.cameras.camera import Camera
from vsense.config.placement import place
from vsense.config.specs import Experiment
from vsense.errors import VsenseError
from vsense.lab.camera_spec import spec_for
from vsense.lab.eyes import Eyes
from vsense.lab.floor import FloorProcess
from vsense.lab.grabber import LabGrabber
from vsense.lab.processes import Canary
from vsense.lab.shared import LabError
from vsense.lab.swarm import Swarm
from vsense.lab.truth import make_ring
from vsense.link.robots.server import LinkEvent
from vsense.link.robots.table import Table
from vsense.link.robots.wire import GoodbyeCause
from vsense.markers.families import load_family
from vsense.pictures.album import RunSamples
from vsense.robot import build
from vsense.run.control import Control
from vsense.run.environment import Environment
from vsense.run.robots import make_server
from vsense.run.runner import Runner
from vsense.run.runtime import Runtime, Step
from vsense.terminal import Console
from vsense.tracking.arena_tracker import ArenaTracker
from vsense.ui.messages import ExperimentFacts
from vsense.ui.room import ControlRoom

READY_TIMEOUT_S = 20.0
"""All robots must be connected and seen within this time."""


@dataclass(slots=True)
class RunNotes:
    """What the host noted during a run.

    Attributes:
        seed: of everything that was drawn.
        directory: where the run's figures go.
        ended: what ended it, as `Runner.ended`.
        steps: the timesteps of the run, without their pictures.
        album: the virtual world and the experiment's measures over time.
        measures: what the experiment measured in all, by name.
        pictures: the cameras' pictures at chosen timesteps of the run.
        sent, received, dropped, reconnects: packets with the robots' readings.
        lateness_ms: the canary's ticks.
    """

    album: RunSamples
    seed: int
    directory: Path
    ended: str = ""
    measures: dict[str, float] = field(default_factory=dict)
    steps: list[Step] = field(default_factory=list)
    pictures: dict[int, list[Frame]] = field(default_factory=dict)
    sent: int = 0
    received: int = 0
    dropped: int = 0
    reconnects: int = 0
    lateness_ms: list[float] = field(default_factory=list)


class Session:
    """Everything that runs in the lab; a context that leaves no process behind."""

    def __init__(
        self,
        experiment: Experiment,
        seed: int,
        directory: Path,
        port: int,
        blind: bool,
        console: Console,
        interrupted: threading.Event,
        base: str,
        room: ControlRoom,
    ) -> None:
        """Prepares runs; `__enter__` starts everything.

        Args:
            experiment: what to run.
            seed: seed of everything that is drawn.
            directory: run directory, exists.
            port: TCP and UDP port of the server, 0 for a free one.
            blind: hold the virtual sensors at 0.
            console: where to say what happens.
            interrupted: set by whoever wants the run to end early.
            base: what the robots are based on, of `vsense.lab.links.BASES`.
            room: where the runs are seen and steered.
        """
        self.experiment = experiment
        self.directory = directory
        self.truth_log = directory / "truth.bin"
        self.recordings: list[RunNotes] = []
        self.interrupted = interrupted
        self.blind = blind
        self._seed = seed
        self._port = port
        self._base = base
        self._room = room
        self._console = console
        self._stack = ExitStack()
        self._over = False
        self._ready = False
        self.dt_ns = experiment.timestep_ns

    def __enter__(self) -> Session:
        try:
            self._start()
        except BaseException:
            self._stack.close()
            raise
        return self

    def __exit__(self, *exception: object) -> None:
        self._stack.close()

    def _start(self) -> None:
        experiment = self.experiment
        source = experiment.controller
        daemon = build.daemon(source.library, experiment.path.parent)
        poses = place(experiment, self._seed)
        environment = Environment(experiment, self._seed, self.blind)
        table = Table(environment.table_entries)
        address = (experiment.host, self._port)
        self.server = make_server(experiment, table, address, self._seed, self._on_link_event)
        port = self.server.start()
        self._stack.callback(self._close_server)
        truth = make_ring(len(poses))
        self._stack.callback(truth.close)
        # The cameras build their scene while everything else starts.
        grabber = LabGrabber(spec_for(experiment, truth.name, self._seed, self.truth_log))
        self._stack.callback(grabber.close)
        self.cameras = grabber.cameras
        tracker = self._track(self.cameras)
        self._stack.callback(tracker.close)
        self.floor = FloorProcess(
            experiment, poses, truth.name, self._seed, self.directory, self._base
        )
        self._stack.callback(self.floor.close)
        self.swarm = Swarm(daemon, experiment.host, port, self._seed, self.directory / "robots")
        self._stack.callback(self.swarm.end)
        for robot, base in zip(experiment.robots, self.floor.bases):
            self.swarm.start(robot.tag, robot.id, base)
        self.environment = environment
        self.eyes = Eyes(grabber, tracker, self._console.say)
        self._room.recorders.watch_family(self.cameras, experiment.marker, self.eyes, tracker)
        runtime = Runtime(self.eyes, environment, self.server)
        control = Control(self.server.command, self._console.say, self._room.holds)
        self.runner = Runner(
            experiment, runtime, self.server, self._console, self.interrupted, self._look, control
        )
        text = experiment.path.read_text(encoding="utf-8", errors="replace")
        scene = ExperimentFacts("lab", text, self.blind, self.cameras, {}, self.eyes.troubles)
        self._room.open(scene, environment, self.server, runtime, control)
        grabber.start()
        runtime.open()
        self._stack.callback(runtime.close)

    def _track(self, cameras: list[Camera]) -> ArenaTracker:
        experiment = self.experiment
        tagged = [*(r.tag for r in experiment.robots), *(t.tag for t in experiment.objects)]
        heights = dict.fromkeys(tagged, experiment.marker.height_m)
        return ArenaTracker.for_family(cameras, load_family(experiment.marker.family), heights)

    def wait_until_ready(self) -> None:
        """Lives timesteps until every robot is connected and every tag is seen.

        Raises:
            LabError: a daemon has ended, or somebody is still missing after `READY_TIMEOUT_S`;
                the message says who.
        """
        try:
            attendance = self.runner.wait(READY_TIMEOUT_S)
        except VsenseError:
            self.floor.check()
            raise
        self._ready = True
        started = self.interrupted.is_set() or self.runner.control.asked
        if not attendance.complete and not started:
            logs = f" (the robots' logs are in {self.directory / 'robots'})"
            raise LabError(
                f"the swarm is not ready after {READY_TIMEOUT_S:.0f} s;"
                f" {attendance.complaint()}{logs if attendance.absent else ''}"
            )

    def _look(self, step: Step | None) -> None:
        """Looks after the cameras and the daemons.

        Raises:
            LabError: one has ended before all were ready: it will not come.
        """
        self.eyes.look_after()
        self._room.look(step)
        for robot, how in self.swarm.fallen():
            log = self.swarm.log(robot.tag)
            if not self._ready:
                said = log.read_text(errors="replace").strip().splitlines()
                raise LabError(f"robot {robot.name}: its daemon {how}: {said[-1] if said else ''}")
            self._console.say(
                f"robot {robot.name}: its daemon {how} (log: {log});"
                " the experiment goes on without it;"
                f" start it again with {self.swarm.script(robot.tag)}"
            )

    def live(self, directory: Path, observe: Callable[[Step], None]) -> None:
        """Starts all robots together, lives the run's timesteps, and stops them.

        Args:
            directory: where the run's figures will go.
            observe: called after every timestep of the run.

        Raises:
            VsenseError: something has failed; what was recorded until then is there.
        """
        recording = RunNotes(RunSamples(self.experiment), self.environment.seed, directory)
        self.recordings.append(recording)
        canary = Canary()
        self._stack.callback(canary.close)
        failure: VsenseError | None = None
        try:
            self._live_timesteps(recording, observe)
        except VsenseError as error:
            failure = error
        self._over = True
        self.runner.stop()
        recording.ended, tally = self.runner.ended, self.runner.tally
        recording.lateness_ms = canary.end()
        recording.sent, recording.received = tally.sent, tally.received
        recording.dropped, recording.reconnects = tally.dropped, self.runner.reconnects
        if failure is not None:
            # Cameras starve without physics: say what failed first.
            self.floor.check()
            raise failure
        recording.measures = self.environment.end()

    def next_run(self) -> None:
        """Goes back to before the start of the next run, whose seed is one more.

        Raises:
            VsenseError: its virtual world cannot be made, or the link has failed.
        """
        self.environment = self.environment.following()
        self.runner.next_run(self.environment)
        self._over = False

    def _live_timesteps(self, recording: RunNotes, observe: Callable[[Step], None]) -> None:
        pictures, album = recording.pictures, recording.album
        step: Step | None = None
        try:
            for step in self.runner.timesteps():
                recording.steps.append(step.without_frames())
                album.look(step.run_timestep, self.environment.world)
                if step.run_timestep in album.kept:
                    pictures[step.run_timestep] = copy_frames(step.frames)
                observe(step)
        finally:
            album.end(self.environment.world)
            if step is not None:
                pictures[step.run_timestep] = copy_frames(step.frames)

    def _close_server(self) -> None:
        self._over = True
        self.server.close(GoodbyeCause.END, "the run has ended")

    def _on_link_event(self, event: LinkEvent) -> None:
        if event.kind != "connected" and not self._over:
            self._console.say(event.text)


def copy_frames(frames: Sequence[Frame]) -> list[Frame]:
    """Copies pictures whose memory the grabber will use again."""
    return [replace(frame, image=frame.image.copy()) for frame in frames]
