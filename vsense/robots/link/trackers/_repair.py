"""What links to other trackers share: the wait for a state, and its repair with the list of tags.

Thesis, 3.3.1. A tag that is not in the experiment is a misreading: where it lies within reach of
exactly one lost robot, and of that robot alone, it is that robot; otherwise it is left out and
counted. A robot that is not reported stays where it was last seen, with an age that grows and a
confidence that falls, and is left out in the end.
"""

from __future__ import annotations

import math
import select
import socket
import threading
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from vsense.base.arena import POSE, SIGHTING, ArenaState, Frame
from vsense.robots.link._shared import Waker
from vsense.robots.link.status import LinkError
from vsense.robots.link.trackers.protocol import TrackerReport

MAX_SPEED_M_S = 0.25
"""An e-puck drives 0.13 m/s, with a margin."""
SLACK_M = 0.02
"""Added to how far a robot can have come: noise, and being pushed."""
FADE_S = 1.0
"""Time constant of the confidence of a robot that is not seen."""
FORGET_NS = 5_000_000_000
"""Age at which a robot is left out."""
REPAIRED = 0.5
"""Confidence in a robot whose tag was misread, and in a tag that was there twice."""

_NEW_SPEED = 0.6


@dataclass(slots=True)
class RepairCounters:
    """What was wrong with the states so far.

    Attributes:
        unknown: reports of tags that are not in the experiment and could not be repaired.
        repaired: reports of such tags that were a lost robot.
        duplicates: tags that were reported twice in one state.
    """

    unknown: int = 0
    repaired: int = 0
    duplicates: int = 0


@dataclass(slots=True)
class _Robot:
    last: TrackerReport
    capture_ns: int
    confidence: float
    speed_m_s: float = 0.0


class Repair:
    """Makes arena states of another tracker's reports; `tags` are those of the experiment.

    `capture_ns` is when the newest state was seen, on the host's clock.
    """

    def __init__(self, tags: Collection[int]) -> None:
        self.counters = RepairCounters()
        self.capture_ns = 0
        self._timestep = -1
        self._tags = frozenset(tags)
        self._robots: dict[int, _Robot] = {}

    def expect(self, tags: Collection[int]) -> None:
        """Other tags are the experiment's from the next state on; from any thread."""
        self._tags = frozenset(tags)

    def follow(self, reports: Sequence[TrackerReport], steps: int, capture_ns: int) -> ArenaState:
        """Takes the state `steps` timesteps after the last in; its capture time never goes back."""
        self._timestep += steps
        self.capture_ns = max(self.capture_ns, capture_ns)
        return self.update(reports, self._timestep, self.capture_ns)

    def update(
        self, reports: Sequence[TrackerReport], timestep: int, capture_ns: int
    ) -> ArenaState:
        """Takes one state in; `capture_ns` must not go back. `unnamed` counts unknown tags."""
        groups: dict[int, list[TrackerReport]] = {}
        for report in reports:
            groups.setdefault(report.tag, []).append(report)
        duplicates = tuple(sorted(t for t in groups if t in self._tags and len(groups[t]) > 1))
        unlisted = [report for report in reports if report.tag not in self._tags]
        seen = set()
        for tag in self._tags & groups.keys():
            believed = self._choose(tag, groups[tag], capture_ns)
            if believed is not None:
                self._see(tag, believed, capture_ns, REPAIRED if tag in duplicates else 1.0)
                seen.add(tag)
        named = self._name(unlisted, (self._robots.keys() & self._tags) - groups.keys(), capture_ns)
        for tag, report in named.items():
            self._see(tag, report, capture_ns, REPAIRED)
        self.counters.duplicates += len(duplicates)
        self.counters.repaired += len(named)
        self.counters.unknown += len(unlisted) - len(named)
        self._forget(capture_ns)
        return ArenaState(
            timestep=timestep,
            capture_ns=capture_ns,
            robots=self._poses(seen | named.keys(), capture_ns),
            detected=len(self._tags & groups.keys()),
            unnamed=len(unlisted) - len(named),
            duplicates=duplicates,
            sightings=np.array(
                [(r.tag, *_pose(r)) for r in reports if r.tag in self._tags], dtype=SIGHTING
            ),
        )

    def _choose(self, tag: int, reports: list[TrackerReport], now_ns: int) -> TrackerReport | None:
        """The report to believe; of several only one that alone can be reached."""
        if len(reports) == 1:
            return reports[0]
        robot = self._robots.get(tag)
        near = [r for r in reports if robot is not None and _reaches(robot, r, now_ns)]
        return near[0] if len(near) == 1 else None

    def _name(
        self, unlisted: list[TrackerReport], lost: set[int], now_ns: int
    ) -> dict[int, TrackerReport]:
        """Gives misread reports to lost robots, where there is no doubt."""
        near = {
            tag: [r for r in unlisted if _reaches(self._robots[tag], r, now_ns)] for tag in lost
        }
        claims = [id(report) for reports in near.values() for report in reports]
        return {
            tag: reports[0]
            for tag, reports in sorted(near.items())
            if len(reports) == 1 and claims.count(id(reports[0])) == 1
        }

    def _see(self, tag: int, report: TrackerReport, capture_ns: int, confidence: float) -> None:
        robot = self._robots.get(tag)
        if robot is None:
            self._robots[tag] = _Robot(report, capture_ns, confidence)
            return
        elapsed_s = (capture_ns - robot.capture_ns) / 1e9
        if elapsed_s > 0.0:
            speed = _distance_m(robot.last, report) / elapsed_s
            robot.speed_m_s += _NEW_SPEED * (speed - robot.speed_m_s)
        robot.last, robot.capture_ns, robot.confidence = report, capture_ns, confidence

    def _forget(self, now_ns: int) -> None:
        oldest_ns = now_ns - FORGET_NS
        self._robots = {t: r for t, r in self._robots.items() if r.capture_ns >= oldest_ns}

    def _poses(self, seen: set[int], now_ns: int) -> np.ndarray:
        poses = np.zeros(len(self._robots), dtype=POSE)
        for row, tag in zip(poses, sorted(self._robots), strict=True):
            robot = self._robots[tag]
            age_ns = now_ns - robot.capture_ns
            row["tag"] = tag
            row["x_m"], row["y_m"], row["yaw_rad"] = _pose(robot.last)
            row["speed_m_s"] = robot.speed_m_s
            row["capture_ns"], row["age_ns"] = robot.capture_ns, age_ns
            row["confidence"] = robot.confidence * math.exp(-age_ns / 1e9 / FADE_S)
            row["seen"] = row["cameras"] = tag in seen
            row["covariance"] = np.nan
        return poses


def _pose(report: TrackerReport) -> tuple[float, float, float]:
    return report.x_m, report.y_m, report.yaw_rad


def _distance_m(a: TrackerReport, b: TrackerReport) -> float:
    return math.hypot(a.x_m - b.x_m, a.y_m - b.y_m)


def _reaches(robot: _Robot, report: TrackerReport, now_ns: int) -> bool:
    elapsed_s = (now_ns - robot.capture_ns) / 1e9
    return _distance_m(robot.last, report) <= SLACK_M + MAX_SPEED_M_S * elapsed_s


@dataclass(slots=True)
class StateCounters:
    """How many arena states were taken, and how many of them a newer one replaced unseen."""

    states: int = 0
    skipped: int = 0


class TrackerLink:
    """A link to another tracker; `next` belongs to one thread, the rest to any.

    Args:
        name: the tracker, in messages after "tracker".
        say: takes a line for a person; must not wait.
        clock: the host's monotonic clock [ns].
    """

    def __init__(self, name: str, say: Callable[[str], None], clock: Callable[[], int]) -> None:
        self.name = name
        self._say = say
        self._clock = clock
        self._busy = threading.Lock()
        self._closed = False
        self._waker = Waker()

    def next(self, timeout_s: float) -> tuple[ArenaState, Sequence[Frame]]:
        """Waits for the newest arena state; its timestep is greater than all before, pictures none.

        Raises:
            TrackerEnded: the tracker has ended its run.
            LinkError: no state came in time, or `close` was called.
        """
        with self._busy:
            deadline_ns = self._clock() + round(timeout_s * 1e9)
            while not self._closed:
                self._check()
                if self._clock() >= deadline_ns:
                    who = self._miss(timeout_s)
                    raise LinkError(f"tracker {who}: no arena state in {timeout_s:g} s")
                state = self._step(deadline_ns)
                if state is not None:
                    return state, ()
        raise LinkError(f"tracker {self.name}: the link is closed")

    def check_cameras(self) -> None:
        """The cameras are the tracker's own."""

    def close(self) -> None:
        """Ends a `next` that waits, and the connection; can be called again."""
        self._closed = True
        self._waker.wake()
        with self._busy:
            self._hang_up()
            self._waker.close()

    def _poll(self, wanted: Mapping[socket.socket, int], until_ns: int) -> set[int]:
        """Waits for events of sockets, `_waker` or the time; gives the ready descriptors."""
        poll = select.poll()
        poll.register(self._waker, select.POLLIN)
        for sock, events in wanted.items():
            poll.register(sock, events)
        left_ns = max(until_ns - self._clock(), 0)
        ready = {descriptor for descriptor, _ in poll.poll(-(-left_ns // 1_000_000))}
        if self._waker.fileno() in ready:
            self._waker.drain()
        return ready

    def _check(self) -> None:
        """Raises what ends `next` before it waits."""

    def _miss(self, timeout_s: float) -> str:
        """Takes note that no state came in time; gives the tracker's name."""
        raise NotImplementedError

    def _step(self, until_ns: int) -> ArenaState | None:
        """Does what is due and waits once; gives the newest state that came."""
        raise NotImplementedError

    def _hang_up(self) -> None:
        raise NotImplementedError
