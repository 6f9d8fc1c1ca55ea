"""A runtime and a server that play what a test says, on a clock that only moves when told to."""

from __future__ import annotations

import io
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from vsense.base.arena import POSE, ArenaState
from vsense.base.terminal import Console
from vsense.config.experiment import load
from vsense.config.specs import Experiment
from vsense.robots.link.status import RobotStatus
from vsense.robots.link.wire import Telemetry, Wanted
from vsense.run.alarms import Alarm
from vsense.run.runner import Runner
from vsense.run.runtime import Step
from vsense.run.watch import NoArenaState

MS = 1_000_000
S = 1_000_000_000
DT_NS = 100 * MS


def experiment(robots: int = 2, timesteps: int = 5) -> Experiment:
    """The pollution experiment with a few robots and timesteps."""
    whole = load("pollutant")
    return replace(whole, robots=whole.robots[:robots], length_s=timesteps * DT_NS / S)


def status(tag: int, name: str, **known: object) -> RobotStatus:
    """A robot that is connected and has taken all that was sent to it."""
    values: dict[str, object] = {
        "tag": tag, "name": name, "connected": True, "uid": bytes(16), "controller": "pollutant",
        "version": "0.1.0", "hash": "",
        "since_ns": 0, "heard_ns": 0, "udp": True, "telemetry": Telemetry(received=10),
        "sessions": 1, "sent": 10, "superseded": 0, "unsent": 0, "received": 0, "accepted": 0,
        "dropped": {},
    }  # fmt: skip
    return RobotStatus(**(values | known))  # type: ignore[arg-type]


def counted(sent: int, sessions: int = 1, **telemetry: int) -> RobotStatus:
    """A robot with these counters, in its telemetry too."""
    known = Telemetry(**telemetry)
    return status(7, "epuck_7_0", telemetry=known, sessions=sessions, sent=sent)


@dataclass
class Stage:
    """What a runner sees, and what it has done.

    Attributes:
        now_ns: the clock.
        connected, seen: tags.
        silent: no arena state comes.
        acts: by number of the call of `Runtime.step`, what happens before it.
        done: what the runner asked runtime and server for.
    """

    experiment: Experiment
    now_ns: int = 1000 * S
    connected: set[int] = field(default_factory=set)
    seen: set[int] = field(default_factory=set)
    silent: bool = False
    acts: dict[int, Callable[[], object]] = field(default_factory=dict)
    done: list[str] = field(default_factory=list)
    statuses: dict[int, dict[str, object]] = field(default_factory=dict)
    resting: frozenset[int] = frozenset()

    def __post_init__(self) -> None:
        self.interrupted = threading.Event()
        self.terminal = io.StringIO()
        self.timestep = 0
        self.calls = self.checks = self.snapshots = 0
        self.held: Mapping[int, str] = {}
        self.held_from: int | None = None
        self.places: dict[int, tuple[float, float]] = {}
        self.observed: list[tuple[bool, list[Alarm]]] = []
        self.first: int | None = None
        self.lived = -1
        self.runner = Runner(
            self.experiment,
            self,  # type: ignore[arg-type]
            self,  # type: ignore[arg-type]
            Console(self.terminal),
            self.interrupted,
            observe=lambda step, robots: self.observed.append((step is None, self.runner.alarms)),
            clock=lambda: self.now_ns,
        )

    @property
    def tags(self) -> set[int]:
        """All tags that are looked for."""
        things = self.experiment.objects
        return {r.tag for r in self.experiment.robots} | {thing.tag for thing in things}

    def logged(self) -> list[tuple[int, str]]:
        """Stands in for `Runtime.logged`: there are no virtual robots."""
        return []

    @property
    def finished(self) -> bool:
        """Stands in for `Runtime.finished`, likewise."""
        return False

    def said(self) -> list[str]:
        """Stands in for `Runtime.said`: there are no loop functions."""
        return []

    def check_cameras(self) -> None:
        """Stands in for `Runtime.check_cameras`."""
        self.checks += 1

    def step(self, timeout_s: float) -> Step:
        """Stands in for `Runtime.step`."""
        self.calls += 1
        self.acts.get(self.calls, lambda: None)()
        if self.silent:
            self.now_ns += round(timeout_s * S)
            raise NoArenaState("nothing came")
        self.now_ns += DT_NS
        # As `Pace` does: numbers follow the clock.
        self.timestep = (self.now_ns - 1000 * S) // DT_NS
        number = -1 if self.first is None else max(self.timestep - self.first, -1)
        capture_ns = self.now_ns - 20 * MS
        state = self.arena_state(capture_ns)
        times = (capture_ns, self.now_ns - 10 * MS, self.now_ns - 5 * MS, self.now_ns)
        return Step(self.timestep, number, *times, state, ())

    def arena_state(self, capture_ns: int) -> ArenaState:
        """Who is seen, in the middle or at its place of `places`."""
        poses = np.zeros(len(self.seen), POSE)
        poses["tag"], poses["seen"] = sorted(self.seen), True
        for row, tag in enumerate(sorted(self.seen)):
            poses["x_m"][row], poses["y_m"][row] = self.places.get(tag, (0.0, 0.0))
        poses["capture_ns"] = capture_ns
        return ArenaState(self.timestep, capture_ns, poses, len(self.seen))

    def start(self) -> int:
        """Stands in for `Runtime.start`."""
        self.done.append("start")
        self.first = self.timestep + 3
        return self.first

    def stop(self) -> None:
        """Stands in for `Runtime.stop`."""
        self.done.append("stop")

    def hold(self) -> None:
        """Stands in for `Runtime.hold`."""
        self.done.append("hold")
        self.lived, self.first = self.timestep - (self.first or 0), None

    def resume(self) -> int:
        """Stands in for `Runtime.resume`."""
        self.done.append("resume")
        self.first = self.timestep + 3 - (self.lived + 1)
        return self.timestep + 3

    def next_run(self, environment: object) -> int:
        """Stands in for `Runtime.next_run`."""
        self.first = None
        return 2

    def silence(self, silent: bool = True) -> None:
        """Stands in for `VirtualSensorServer.silence`."""
        if silent:
            self.done.append("silence")

    def command(self, wanted: Wanted, from_timestep: int = 0) -> None:
        """Stands in for `VirtualSensorServer.command`."""
        self.done.append(wanted.name)

    def hold_robots(self, reasons: Mapping[int, str]) -> None:
        """Stands in for `VirtualSensorServer.hold_robots`."""
        self.held = dict(reasons)
        if self.held_from is None and reasons:
            self.held_from = self.timestep

    def robots(self) -> dict[int, RobotStatus]:
        """Stands in for `VirtualSensorServer.robots`."""
        self.snapshots += 1
        return {
            r.tag: status(
                r.tag, r.id, connected=r.tag in self.connected, **self.statuses.get(r.tag, {})
            )
            for r in self.experiment.robots
        }
