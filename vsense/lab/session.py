"""One run in the lab: starts every process, lives all timesteps, and ends everything again."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path

from vsense import build
from vsense.arena import Frame
from vsense.config.placement import place
from vsense.config.specs import Experiment
from vsense.console import Console
from vsense.environment import Environment
from vsense.errors import VsenseError
from vsense.lab.camera_spec import spec_for
from vsense.lab.canary import Canary
from vsense.lab.eyes import Eyes
from vsense.lab.floor import Floor
from vsense.lab.grabber import LabGrabber
from vsense.lab.shared import LabError
from vsense.lab.swarm import Swarm
from vsense.lab.truth import make_ring
from vsense.link.server import LinkEvent
from vsense.link.table import Table
from vsense.link.wire import GoodbyeCause
from vsense.pictures.album import Album
from vsense.run.runner import Runner
from vsense.run.serving import make_server
from vsense.runtime import Runtime, Step
from vsense.tracking.arena_tracker import ArenaTracker
from vsense.tracking.camera import Camera
from vsense.tracking.families import load_family

READY_TIMEOUT_S = 20.0
"""All robots must be connected and seen within this time."""


@dataclass(slots=True)
class Recording:
    """What the host noted during a run.

    Attributes:
        steps: the timesteps of the run, without their pictures.
        album: the virtual world and the experiment's measures over time.
        measures: what the experiment measured in all, by name.
        pictures: the cameras' pictures at chosen timesteps of the run.
        sent, received, dropped, reconnects: packets with the robots' readings.
        lateness_ms: the canary's ticks.
    """

    album: Album
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
    ) -> None:
        """Prepares a run; `__enter__` starts it.

        Args:
            experiment: what to run.
            seed: seed of everything that is drawn.
            directory: run directory, exists.
            port: TCP and UDP port of the server, 0 for a free one.
            blind: hold the virtual sensors at 0.
            console: where to say what happens.
            interrupted: set by whoever wants the run to end early.
            base: what the robots are based on, of `vsense.lab.bases.BASES`.
        """
        self.experiment = experiment
        self.directory = directory
        self.truth_log = directory / "truth.bin"
        self.recording = Recording(Album(experiment))
        self.interrupted = interrupted
        self._seed = seed
        self._port = port
        self._blind = blind
        self._base = base
        self._console = console
        self._stack = ExitStack()
        self._over = False
        self._ready = False
        self.dt_ns = round(1e9 / experiment.ticks_per_second)

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
        environment = Environment(experiment, self._seed, self._blind)
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
        self.floor = Floor(experiment, poses, truth.name, self._seed, self.directory, self._base)
        self._stack.callback(self.floor.close)
        self.swarm = Swarm(daemon, experiment.host, port, self._seed, self.directory / "robots")
        self._stack.callback(self.swarm.end)
        for robot, base in zip(experiment.robots, self.floor.bases):
            self.swarm.start(robot.tag, robot.id, base)
        self.world, self._environment = environment.world, environment
        self.eyes = Eyes(grabber, tracker, self._console.say)
        runtime = Runtime(self.eyes, environment, self.server)
        self.runner = Runner(
            experiment, runtime, self.server, self._console, self.interrupted, self._look
        )
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
        if not attendance.complete and not self.interrupted.is_set():
            logs = f" (the robots' logs are in {self.directory / 'robots'})"
            raise LabError(
                f"the swarm is not ready after {READY_TIMEOUT_S:.0f} s;"
                f" {attendance.complaint()}{logs if attendance.absent else ''}"
            )

    def _look(self) -> None:
        """Looks after the cameras and the daemons.

        Raises:
            LabError: one has ended before all were ready: it will not come.
        """
        self.eyes.look_after()
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

    def live(self, observe: Callable[[Step], None]) -> None:
        """Starts all robots together, lives the run's timesteps, and stops them.

        Args:
            observe: called after every timestep of the run.

        Raises:
            VsenseError: something has failed; what was recorded until then is there.
        """
        canary = Canary()
        self._stack.callback(canary.close)
        failure: VsenseError | None = None
        try:
            self._live_timesteps(observe)
        except VsenseError as error:
            failure = error
        self._over = True
        self.runner.stop()
        recording, tally = self.recording, self.runner.tally
        recording.lateness_ms = canary.end()
        recording.sent, recording.received = tally.sent, tally.received
        recording.dropped, recording.reconnects = tally.dropped, self.runner.reconnects
        if failure is not None:
            # Cameras starve without physics: say what failed first.
            self.floor.check()
            raise failure
        recording.measures = self._environment.end()

    def _live_timesteps(self, observe: Callable[[Step], None]) -> None:
        pictures, album = self.recording.pictures, self.recording.album
        step: Step | None = None
        try:
            for step in self.runner.timesteps():
                self.recording.steps.append(step.without_frames())
                album.look(step.run_timestep, self.world)
                if step.run_timestep in album.kept:
                    pictures[step.run_timestep] = copy_frames(step.frames)
                observe(step)
        finally:
            album.end(self.world)
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
