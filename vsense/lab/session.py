"""One run in the lab: starts every process, lives all timesteps, and ends everything again."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Container, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path

from vsense import build
from vsense.arena import Frame
from vsense.config.placement import place
from vsense.config.specs import Experiment
from vsense.console import Console
from vsense.errors import VsenseError
from vsense.lab.camera_spec import spec_for
from vsense.lab.canary import Canary
from vsense.lab.floor import Floor
from vsense.lab.grabber import LabGrabber
from vsense.lab.shared import LabError
from vsense.lab.swarm import Swarm
from vsense.lab.tally import Tally
from vsense.lab.truth import make_ring
from vsense.link.server import LinkEvent, VirtualSensorServer
from vsense.link.table import Direction, Entry, Table
from vsense.link.wire import GoodbyeCause
from vsense.runtime import Pictures, Runtime, Step
from vsense.sensors.bank import SensorBank
from vsense.tracking.arena_tracker import ArenaTracker
from vsense.tracking.camera import Camera
from vsense.tracking.families import load_family
from vsense.world.world import World

READY_TIMEOUT_S = 20.0
"""All robots must be connected and seen within this time."""

SETTLE_TIMEOUT_NS = 1_000_000_000
"""After the run the last telemetry may take this long to tell what was received."""


@dataclass(slots=True)
class Recording:
    """What the host noted during a run.

    Attributes:
        steps: the timesteps of the run, without their pictures.
        pictures: the cameras' pictures at chosen timesteps of the run.
        sent, received, dropped, reconnects: packets with the robots' readings.
        lateness_ms: the canary's ticks.
    """

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
        """
        self.experiment = experiment
        self.directory = directory
        self.truth_log = directory / "truth.bin"
        self.recording = Recording()
        self.interrupted = interrupted
        self._seed = seed
        self._port = port
        self._blind = blind
        self._console = console
        self._stack = ExitStack()
        self._over = False
        self._ready = False
        self._tally = Tally()
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
        tags = [robot.tag for robot in experiment.robots]
        source = experiment.controller
        daemon = build.daemon(source.library, experiment.path.parent)
        poses = place(experiment, self._seed)
        bank = SensorBank(experiment.sensors, tags, self._blind)
        self.server = self._serve(bank)
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
        self.floor = Floor(experiment, poses, truth.name, self._seed, self.directory)
        self._stack.callback(self.floor.close)
        self.swarm = Swarm(daemon, experiment.host, port, self._seed, self.directory / "robots")
        self._stack.callback(self.swarm.end)
        for robot, tty in zip(experiment.robots, self.floor.ttys):
            self.swarm.start(robot.tag, robot.id, tty)
        self.world = World(tags, experiment.sources)
        self.runtime = Runtime(Pictures(grabber, tracker), self.world, bank, self.server)
        grabber.start()
        self.runtime.open()
        self._stack.callback(self.runtime.close)

    def _serve(self, bank: SensorBank) -> VirtualSensorServer:
        experiment = self.experiment
        entries = [Entry(e.id, e.name, e.layout, Direction.SENSOR) for e in bank.table]
        return VirtualSensorServer(
            host=experiment.host,
            port=self._port,
            table=Table(entries),
            timestep_ns=self.dt_ns,
            seed=self._seed,
            params=experiment.controller.params_text,
            expected={robot.tag: robot.id for robot in experiment.robots},
            on_event=self._on_link_event,
        )

    def _track(self, cameras: list[Camera]) -> ArenaTracker:
        experiment = self.experiment
        heights = dict.fromkeys(self._names(), experiment.marker.height_m)
        return ArenaTracker.for_family(cameras, load_family(experiment.marker.family), heights)

    def wait_until_ready(self) -> None:
        """Lives timesteps until every robot is connected and every tag is seen.

        Raises:
            LabError: a daemon has ended, or somebody is still missing after `READY_TIMEOUT_S`;
                the message says who.
        """
        deadline_s = time.monotonic() + READY_TIMEOUT_S
        while not self.interrupted.is_set():
            step = self._step()
            self._check_daemons()
            seen = set(step.state.robots[step.state.robots["seen"]]["tag"].tolist())
            links = self.server.robots()
            absent = [robot for robot in self.experiment.robots if not links[robot.tag].connected]
            names = self._names()
            unseen = [name for tag, name in names.items() if tag not in seen]
            self._console.progress(
                f"waiting: {len(links) - len(absent)} of {len(links)} robots connected,"
                f" {len(names) - len(unseen)} of {len(names)} markers seen"
            )
            if not absent and not unseen:
                self._ready = True
                return
            if time.monotonic() > deadline_s:
                raise LabError(self._missing([r.id for r in absent], unseen))

    def _check_daemons(self) -> None:
        """Raises where a daemon has ended before it was ready: it will not come."""
        for robot, how in self.swarm.fallen():
            said = self.swarm.log(robot.tag).read_text(errors="replace").strip().splitlines()
            raise LabError(f"robot {robot.name}: its daemon {how}: {said[-1] if said else ''}")

    def _names(self) -> dict[int, str]:
        """All tagged bodies: tag -> name."""
        robots = {robot.tag: robot.id for robot in self.experiment.robots}
        return robots | {thing.tag: thing.id for thing in self.experiment.objects}

    def _missing(self, absent: list[str], unseen: list[str]) -> str:
        parts = []
        if absent:
            logs = self.directory / "robots"
            parts.append(f"not connected: {', '.join(absent)} (their logs are in {logs})")
        if unseen:
            parts.append(f"not seen: {', '.join(unseen)}")
        return f"the swarm is not ready after {READY_TIMEOUT_S:.0f} s; " + "; ".join(parts)

    def live(self, keep: Container[int], observe: Callable[[Step], None]) -> None:
        """Starts all robots together, lives the run's timesteps, and stops them.

        Args:
            keep: timesteps of the run whose pictures are kept; the last one's always are.
            observe: called after every timestep of the run.

        Raises:
            VsenseError: something has failed; what was recorded until then is there.
        """
        canary = Canary()
        self._stack.callback(canary.close)
        self._tally.update(self.server.robots())
        sessions = self._tally.sessions
        failure: VsenseError | None = None
        try:
            self._live_timesteps(keep, observe)
        except VsenseError as error:
            failure = error
        self._over = True
        self.runtime.stop()
        self.recording.lateness_ms = canary.end()
        self._settle()
        self.recording.reconnects = self._tally.sessions - sessions
        if failure is not None:
            raise failure

    def _live_timesteps(self, keep: Container[int], observe: Callable[[Step], None]) -> None:
        last = (self.experiment.timesteps or sys.maxsize) - 1
        self.runtime.start()
        pictures = self.recording.pictures
        step: Step | None = None
        try:
            while not self.interrupted.is_set() and (step is None or step.run_timestep < last):
                lived = self._step()
                if lived.run_timestep < 0:
                    continue
                step = lived
                self.recording.steps.append(step.without_frames())
                if step.run_timestep in keep:
                    pictures[step.run_timestep] = copy_frames(step.frames)
                observe(step)
        finally:
            if step is not None:
                pictures[step.run_timestep] = copy_frames(step.frames)
        # The robots have the last timestep's readings and a whole timestep to act on them.
        threading.Event().wait(self.dt_ns / 1e9)

    def _step(self) -> Step:
        try:
            step = self.runtime.step()
        except VsenseError:
            # Cameras starve without physics: say what failed first.
            self.floor.check()
            raise
        for status in self._tally.update(self.server.robots()):
            self._console.say(f"robot {status.name}: its guard was replaced")
        for robot, how in self.swarm.fallen() if self._ready else ():
            self._console.say(
                f"robot {robot.name}: its daemon {how} (log: {self.swarm.log(robot.tag)});"
                " the experiment goes on without it;"
                f" start it again with {self.swarm.script(robot.tag)}"
            )
        return step

    def _settle(self) -> None:
        """Stops sending and waits until every robot has told what it received."""
        self.server.hush()
        deadline_ns = time.monotonic_ns() + SETTLE_TIMEOUT_NS
        self._tally.update(self.server.robots())
        while self._tally.received < self._tally.sent and time.monotonic_ns() < deadline_ns:
            threading.Event().wait(0.02)
            self._tally.update(self.server.robots())
        self.recording.sent = self._tally.sent
        self.recording.received = self._tally.received
        self.recording.dropped = self._tally.dropped

    def _close_server(self) -> None:
        self._over = True
        self.server.close(GoodbyeCause.END, "the run has ended")

    def _on_link_event(self, event: LinkEvent) -> None:
        if event.kind != "connected" and not self._over:
            self._console.say(event.text)


def copy_frames(frames: Sequence[Frame]) -> list[Frame]:
    """Copies pictures whose memory the grabber will use again."""
    return [replace(frame, image=frame.image.copy()) for frame in frames]
