"""One run in the lab: starts every process, lives all timesteps, and ends everything again."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path

from vsense import build
from vsense.arena import Frame
from vsense.config.placement import place
from vsense.config.specs import Experiment
from vsense.lab.camera_spec import spec_for
from vsense.lab.canary import Canary
from vsense.lab.console import Console
from vsense.lab.floor import Floor
from vsense.lab.grabber import LabGrabber
from vsense.lab.shared import LabError
from vsense.lab.swarm import Swarm
from vsense.lab.truth import make_ring
from vsense.link.server import LinkEvent, VirtualSensorServer
from vsense.link.table import Direction, Entry, Table
from vsense.link.wire import GoodbyeCause
from vsense.runtime import Runtime, Step
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
        world = World(tags, experiment.sources)
        self.runtime = Runtime(grabber, tracker, world, bank, self.server)
        self.runtime.open()
        self._stack.callback(self.runtime.close)

    def _serve(self, bank: SensorBank) -> VirtualSensorServer:
        experiment = self.experiment
        entries = [Entry(e.id, e.name, e.layout, Direction.SENSOR) for e in bank.table]
        params = experiment.controller.params.items()
        return VirtualSensorServer(
            host=experiment.host,
            port=self._port,
            table=Table(entries),
            timestep_ns=self.dt_ns,
            seed=self._seed,
            params="".join(f"{key}={value}\n" for key, value in params),
            expected={robot.tag: robot.id for robot in experiment.robots},
            on_event=self._on_link_event,
        )

    def _track(self, cameras: list[Camera]) -> ArenaTracker:
        experiment = self.experiment
        heights = dict.fromkeys(self._names(), experiment.marker.height_m)
        return ArenaTracker.for_arrows(cameras, load_family(experiment.marker.family), heights)

    def wait_until_ready(self) -> None:
        """Lives timesteps until every robot is connected and every tag is seen.

        Raises:
            LabError: somebody is still missing after `READY_TIMEOUT_S`; the message says who.
        """
        deadline_s = time.monotonic() + READY_TIMEOUT_S
        while not self.interrupted.is_set():
            step = self._step()
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
                return
            if time.monotonic() > deadline_s:
                raise LabError(self._missing([r.id for r in absent], unseen))

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

    def live(self, keep: set[int], observe: Callable[[Step], None]) -> None:
        """Starts all robots together, lives the run's timesteps, and stops them.

        Args:
            keep: timesteps of the run whose pictures are kept; the last one's always are.
            observe: called after every timestep of the run.
        """
        wanted = self.experiment.timesteps
        canary = Canary()
        before = {tag: robot.sessions for tag, robot in self.server.robots().items()}
        self.runtime.start()
        latest: Step | None = None
        while not self.interrupted.is_set() and len(self.recording.steps) < (wanted or sys.maxsize):
            step = self._step()
            if step.run_timestep < 0:
                continue
            latest = step
            self.recording.steps.append(step.without_frames())
            if step.run_timestep in keep:
                self.recording.pictures[step.run_timestep] = copy_frames(step.frames)
            observe(step)
        if latest is not None:
            self.recording.pictures[latest.run_timestep] = copy_frames(latest.frames)
            # The robots have the last timestep's readings and a whole timestep to act on them.
            self.interrupted.wait(self.dt_ns / 1e9)
        self._over = True
        self.runtime.stop()
        self.recording.lateness_ms = canary.end()
        self._settle(before)

    def _step(self) -> Step:
        step = self.runtime.step()
        self.floor.check()
        for robot, how in self.swarm.fallen():
            self._console.say(
                f"robot {robot.name}: its daemon {how} (log: {self.swarm.log(robot.tag)});"
                " the experiment goes on without it;"
                f" start it again with {self.swarm.script(robot.tag)}"
            )
        return step

    def _settle(self, sessions_before: dict[int, int]) -> None:
        """Stops sending and waits until every robot has told what it received."""
        self.server.hush()
        deadline_ns = time.monotonic_ns() + SETTLE_TIMEOUT_NS
        while True:
            robots = self.server.robots()
            self.recording.sent = sum(robot.sent for robot in robots.values())
            heard = [r.telemetry for r in robots.values() if r.telemetry is not None]
            self.recording.received = sum(t.received - t.foreign - t.corrupt for t in heard)
            complete = self.recording.received >= self.recording.sent
            if complete or time.monotonic_ns() > deadline_ns:
                break
            threading.Event().wait(0.02)
        self.recording.dropped = sum(t.old + t.foreign + t.corrupt for t in heard)
        self.recording.reconnects = sum(
            robot.sessions - sessions_before[tag] for tag, robot in robots.items()
        )

    def _close_server(self) -> None:
        self.server.close(GoodbyeCause.END, "the run has ended")

    def _on_link_event(self, event: LinkEvent) -> None:
        if event.kind != "connected" and not self._over:
            self._console.say(event.text)


def copy_frames(frames: Sequence[Frame]) -> list[Frame]:
    """Copies pictures whose memory the grabber will use again."""
    return [replace(frame, image=frame.image.copy()) for frame in frames]
