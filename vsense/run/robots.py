"""The robots of a run: their server, who is there, their alarms, and their links' counters."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from vsense.base.terminal import Level, shorten
from vsense.config.battery_history import BatteryRow, append, history_of
from vsense.config.specs import Experiment
from vsense.robots.link.keys import LinkTrust
from vsense.robots.link.legacy.protocol import LegacySwarm, by_octet, translations
from vsense.robots.link.legacy.server import MixedServer
from vsense.robots.link.server import VirtualSensorServer
from vsense.robots.link.status import LinkEvent, RobotStatus
from vsense.robots.link.table import BRING, ExpectedRobot, Table
from vsense.robots.link.wire import StopCause, Telemetry
from vsense.run.programs import told_programs


def make_server(
    experiment: Experiment,
    tables: Mapping[str, Table],
    address: tuple[str, int],
    seed: int,
    trust: LinkTrust,
    on_event: Callable[[LinkEvent], None],
    legacy_port: int | None = None,
    other_programs: bool = False,
) -> VirtualSensorServer:
    """Prepares the server that an experiment's robots connect to; nothing is opened yet.

    Args:
        experiment: whose robots are expected.
        tables: the sensor table of each controller, by its id.
        address: interface to listen on, and its port; 0 takes a free one.
        seed: of the run.
        trust: which robots are believed.
        on_event: called from the server's thread; must not wait.
        legacy_port: port for robots with the original's client, None: none are served.
        other_programs: robots that run another program than the file's are taken.

    Raises:
        WireError: params or timestep do not fit the protocol.
        LinkError: the original's client cannot be served in this experiment.
    """
    options: dict[str, Any] = {
        **dict(zip(("host", "port"), address)),
        "timestep_ns": experiment.timestep_ns,
        "seed": seed,
        "expected": expected_robots(experiment, tables, other_programs=other_programs),
        "trust": trust,
        "on_event": on_event,
    }
    if legacy_port is None:
        return VirtualSensorServer(**options)
    numbers = by_octet({robot.tag: (robot.id, robot.number) for robot in experiment.robots})
    entries = {tag: robot.table.entries for tag, robot in options["expected"].items()}
    swarm = LegacySwarm(translations(entries), numbers)
    return MixedServer((address[0], legacy_port), swarm, **options)


def expected_robots(
    experiment: Experiment,
    tables: Mapping[str, Table],
    exact: Collection[int] = (),
    other_programs: bool = False,
) -> dict[int, ExpectedRobot]:
    """The robots by tag, each with what its controller is told; for `exact` see `ExpectedRobot`.

    `other_programs`: they may run another program than the file's.
    """
    controllers = {robot: experiment.controller_of(robot) for robot in experiment.robots}
    programs = told_programs(experiment)
    return {
        robot.tag: ExpectedRobot(
            robot.id,
            tables[c.id],
            "" if c.program.is_hosted else c.params_for(robot.id),
            programs[c.id],
            other_programs,
            robot.tag in exact,
        )
        for robot, c in controllers.items()
    }


@dataclass(frozen=True, slots=True)
class Readiness:
    """Who is there and who is missing, by name, in the experiment's order.

    Attributes:
        robots, markers: how many there should be; tagged objects have markers, too.
        absent: robots that are not connected.
        unseen: robots and objects whose marker is not seen.
        refused: of robots that are not connected, why they were turned away.
        away: they by name, and in brief what is to be done: "robot 23: deploy".
        tags: of robots, by name: texts call a robot by its tag.
    """

    robots: int
    markers: int
    absent: tuple[str, ...]
    unseen: tuple[str, ...]
    refused: tuple[str, ...] = ()
    away: Mapping[str, str] = field(default_factory=dict)
    tags: Mapping[str, int] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        robots: Mapping[int, str],
        objects: Mapping[int, str],
        connected: Collection[int],
        seen: Collection[int],
        refused: Mapping[int, str] | None = None,
    ) -> Readiness:
        """Compares names by tag of robots and tagged objects with the tags that are there.

        `refused` says by tag why a robot was turned away, "": it was not.
        """
        whys = (refused or {}).items()
        away = {t: why for t, why in whys if why and t in robots and t not in connected}
        by_why = defaultdict[str, list[str]](list)
        for tag, why in away.items():
            by_why[why].append(f"robot {tag}")
        return cls(
            robots=len(robots),
            markers=len(robots) + len(objects),
            absent=tuple(name for tag, name in robots.items() if tag not in connected),
            unseen=tuple(n for tag, n in (*robots.items(), *objects.items()) if tag not in seen),
            refused=tuple(f"{shorten(names)} {why}" for why, names in by_why.items()),
            away={robots[tag]: _brief(tag, why) for tag, why in away.items()},
            tags={name: tag for tag, name in robots.items()},
        )

    @property
    def complete(self) -> bool:
        """Whether none is missing."""
        return not self.absent and not self.unseen

    @property
    def missing(self) -> tuple[str, ...]:
        """All that are not connected or not seen, each once."""
        return tuple(dict.fromkeys((*self.absent, *self.unseen)))

    def progress(self, watched: bool = True) -> str:
        """One line on who is there; `watched` is False before the first arena state."""
        missing = _without(self._unheard, self.away.values())
        connected = f"{self.robots - len(self.absent)} of {self.robots} robots connected{missing}"
        if not watched:
            return f"{connected}, no arena state yet"
        unseen = _without(self._called(self.unseen))
        seen = self.markers - len(self.unseen)
        return f"{connected}, {seen} of {self.markers} markers seen{unseen}"

    def missing_text(self) -> str:
        """Who is missing in which way; "": nobody."""
        ways = {"not connected": self._unheard, "not seen": self._called(self.unseen)}
        ways["turned away"] = self.refused
        return "; ".join(f"{way}: {', '.join(names)}" for way, names in ways.items() if names)

    def _called(self, names: Iterable[str]) -> tuple[str, ...]:
        return tuple(str(self.tags.get(name, name)) for name in names)

    @property
    def _unheard(self) -> tuple[str, ...]:
        """Robots of which nothing is heard: those that were turned away are there."""
        return self._called(name for name in self.absent if name not in self.away)


def _brief(tag: int, why: str) -> str:
    """What is to be done about a robot that was turned away."""
    return f"robot {tag}: {'deploy' if BRING in why else 'turned away'}"


def _without(names: tuple[str, ...], away: Iterable[str] = ()) -> str:
    parts = [f"not {shorten(names)}" if names else "", shorten(away)]
    return f" ({'; '.join(filter(None, parts))})" if any(parts) else ""


TROUBLE_DELAY_NS = 1_000_000_000
"""A daemon that has just started looks for its base for a moment: that is no trouble yet."""

BATTERY_LOW = SAVES_POWER = 1

SLEEPS = f"its Wi-Fi's power saving is on: readings come late; {BRING} turns it off"


class RobotAlarms:
    """Troubles in the robots' telemetry: reported once when one begins, once when it is over."""

    def __init__(self) -> None:
        self._since_ns: dict[tuple[int, str], int] = {}
        self._reported: set[tuple[int, str]] = set()

    def update(self, robots: Mapping[int, RobotStatus], now_ns: int) -> list[tuple[str, Level]]:
        """Takes the newest status of every robot by tag.

        Returns a line for each trouble that has lasted long enough, or that is over: good news.
        """
        lines = list[tuple[str, Level]]()
        for tag, status in robots.items():
            if status.telemetry is None or not status.connected:
                continue
            for begun, over, present in _troubles(status.telemetry):
                key = (tag, begun)
                if not present:
                    self._since_ns.pop(key, None)
                    if key in self._reported:
                        self._reported.remove(key)
                        lines.append((f"robot {tag}: {over}", "info"))
                    continue
                lasted_ns = now_ns - self._since_ns.setdefault(key, now_ns)
                if lasted_ns >= TROUBLE_DELAY_NS and key not in self._reported:
                    self._reported.add(key)
                    lines.append((f"robot {tag}: {begun}", "warning"))
        return lines


def low_batteries(robots: Mapping[int, RobotStatus], limit_v: float) -> dict[int, str]:
    """Whose batteries are low, by tag, and how low: words that follow the robot's name.

    `limit_v` is what they should have at least; 0: no battery is too low.
    """
    low = dict[int, str]()
    for tag, status in robots.items():
        telemetry = status.telemetry
        if telemetry is None or limit_v <= 0.0:
            continue
        volts = telemetry.battery_mv / 1e3
        if volts < limit_v if volts else telemetry.battery_low == BATTERY_LOW:
            # 0: only the base says so, and not how low.
            low[tag] = f"has {volts:.2f} V left" if volts else "has a low battery"
    return low


def _troubles(telemetry: Telemetry) -> list[tuple[str, str, bool]]:
    """Words for each trouble, words for its end, and whether it is present."""
    base_lost = telemetry.stop_cause == StopCause.BASE
    battery_low = telemetry.battery_low == BATTERY_LOW
    power_saving = telemetry.power_saving == SAVES_POWER
    return [
        ("its base does not answer: its wheels are held", "its base answers again", base_lost),
        ("its battery is low", "its battery is no longer low", battery_low),
        (SLEEPS, "its Wi-Fi's power saving is off", power_saving),
    ]


@dataclass(slots=True)
class _LinkCounts:
    """One robot's daemons: counts of the earlier ones, and the newest telemetry."""

    received: int = 0
    dropped: int = 0
    guard_restarts: int = 0
    newest: Telemetry | None = None


@dataclass(slots=True)
class LinkCounters:
    """Counters of STATE packets, from the server's start or from `anew`.

    A daemon counts from its own start, which may be before the server's. Of one that was killed the
    last telemetry is known; what it received after that is counted as lost.

    Attributes:
        sent: packets made by the host.
        received: packets that the robots took, each once.
        dropped: packets that the robots did not take: old, repeated, foreign, damaged.
        sessions: sessions that were opened.
        defects: sessions that a bug in vsense has ended.
    """

    sent: int = 0
    received: int = 0
    dropped: int = 0
    sessions: int = 0
    defects: int = 0
    _robots: dict[int, _LinkCounts] = field(default_factory=dict)
    _earlier: tuple[int, int, int, int] = (0, 0, 0, 0)

    def update(self, robots: Mapping[int, RobotStatus]) -> list[RobotStatus]:
        """Takes the newest status of every robot; gives those whose guard was replaced."""
        replaced = []
        for tag, status in robots.items():
            counts = self._robots.setdefault(tag, _LinkCounts())
            if status.telemetry is not None and _add(counts, status.telemetry, status.sent):
                replaced.append(status)
        sent, received, dropped, defects = self._earlier
        self.sent = sum(status.sent for status in robots.values()) - sent
        self.sessions = sum(status.sessions for status in robots.values())
        self.defects = sum(status.defects for status in robots.values()) - defects
        heard = [r.newest for r in self._robots.values() if r.newest is not None]
        taken = self._before("received") + sum(_taken(t) for t in heard) - received
        # Of who was on before, what was on its way to it when it was first heard is not known.
        self.received = min(taken, self.sent)
        self.dropped = self._before("dropped") + sum(_dropped(t) for t in heard) - dropped
        return replaced

    def from_here(self) -> LinkCounters:
        """Gives counters that count from here."""
        now = (self.sent, self.received, self.dropped, self.defects)
        sent, received, dropped, defects = (a + b for a, b in zip(self._earlier, now))
        earlier = (sent, received, dropped, defects)
        return LinkCounters(sessions=self.sessions, _robots=self._robots, _earlier=earlier)

    def _before(self, counter: str) -> int:
        return sum(getattr(robot, counter) for robot in self._robots.values())


def _add(counts: _LinkCounts, now: Telemetry, sent: int) -> bool:
    """Adds a telemetry of a robot that was sent so much; True where it reports a new guard."""
    before = counts.newest
    if before is None and (more := _taken(now) - sent) > 0:
        # It was on before this server was, and has counted what others sent.
        counts.received, counts.dropped = -more, -_dropped(now)
    if before is not None and now.received < before.received:
        counts.received += _taken(before)
        counts.dropped += _dropped(before)
        counts.guard_restarts = 0
    counts.newest = now
    replaced = now.guard_restarts > counts.guard_restarts
    counts.guard_restarts = now.guard_restarts
    return replaced


def _taken(telemetry: Telemetry) -> int:
    return telemetry.received - _dropped(telemetry)


def _dropped(telemetry: Telemetry) -> int:
    return telemetry.old + telemetry.foreign + telemetry.corrupt


class RunBatteries:
    """What the robots of a run tell of their batteries.

    Args:
        roster: whose history is written; "": there is no roster, and nothing is written.
        timestep_s: length of a timestep.
    """

    def __init__(self, roster: str, timestep_s: float) -> None:
        self._roster, self._timestep_s = roster, timestep_s
        self._begun: dict[int, float | None] = {}
        self._newest: dict[int, tuple[str, float | None]] = {}
        self._timesteps = 0

    def update(self, run_timestep: int, robots: Mapping[int, RobotStatus]) -> None:
        """Takes the status of every robot by tag in a timestep of the run."""
        if not self._roster:
            return
        self._timesteps = run_timestep + 1
        for tag, status in robots.items():
            if not status.connected or status.telemetry is None:
                continue
            millivolts = status.telemetry.battery_mv
            volts = millivolts / 1e3 if millivolts else None
            if self._begun.get(tag) is None:
                self._begun[tag] = volts
            self._newest[tag] = ("" if status.uid is None else status.uid.hex(), volts)

    def end(self) -> Path | None:
        """Writes the rows of robots that were there, and forgets them; None: there were none.

        Raises:
            VsenseError: the history cannot be written.
        """
        now = datetime.now().astimezone().isoformat(timespec="seconds")
        duration_s = round(self._timesteps * self._timestep_s, 3)
        rows = [
            BatteryRow(now, tag, uid, self._begun[tag], volts, duration_s)
            for tag, (uid, volts) in self._newest.items()
        ]
        self._begun, self._newest, self._timesteps = {}, {}, 0
        if not rows:
            return None
        path = history_of(Path(self._roster))
        append(path, rows)
        return path
