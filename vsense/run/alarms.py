"""Says while a run goes on that its timesteps are late, and which robots do not obey."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.base import clock
from vsense.base.arena import ArenaState
from vsense.robots.link.status import RobotStatus
from vsense.robots.link.wire import StopCause, Wanted
from vsense.run._standing import NOT_SEEN
from vsense.run.runtime import Step
from vsense.run.verdict import MOST_LATE

SILENCE_NS = 500_000_000
"""Robots have stopped 400 ms after the last arena state: such a pause is told by itself."""
LATENESS_WINDOW_S = 10.0
ON_TIME_SHARE = 0.7
"""Of what a computer made at its limit, so much it makes on time."""
REPEAT = 6
"""As long as it lasts, it is said again in every so manieth window."""


@dataclass(frozen=True, slots=True)
class Alarm:
    """What is wrong with a run now, in words that a banner shows.

    Attributes:
        kind: "overload", "disobeys" or "no_link".
        text, cause: what is so, and why or what to do.
    """

    kind: str
    text: str
    cause: str


@dataclass(slots=True)
class Tally:
    """The timesteps of a run: the last one, how many were made, and how many late."""

    last: int = -1
    done: int = 0
    late: int = 0

    def add(self, run_timestep: int, late: bool) -> None:
        """Counts a timestep."""
        self.last = run_timestep
        self.done += 1
        self.late += late


class Overload:
    """Judges the timesteps of a run, window by window; for one thread.

    `alarm` is what is wrong in the newest window, None: nothing.
    """

    def __init__(
        self, timestep_ns: int, who: str = "this computer", can_slow: bool = False
    ) -> None:
        """`who` makes the timesteps, as messages say it; a run that `can_slow` takes `--pace`."""
        self._dt_ns, self._who, self._can_slow = timestep_ns, who, can_slow
        self._tally = Tally()
        self._window = max(10, round(LATENESS_WINDOW_S * 1e9 / timestep_ns))
        self._bad = 0
        self.alarm: Alarm | None = None
        self._next, self._silent = 0, -self._window
        self._begin(0)

    def _begin(self, run_timestep: int) -> None:
        """Begins a window with a timestep of the run."""
        self._first = run_timestep
        self._lived = self._late = self._held = self._robots = 0
        self._stages_ns = [0, 0, 0]

    def add(self, step: Step, robots: Mapping[int, RobotStatus]) -> str | None:
        """Counts a timestep of the run, and gives a line where there is something to say."""
        missing_ns = (step.run_timestep - self._next) * self._dt_ns
        # One silence is told by itself. Many are a computer that is many times too slow.
        alone = missing_ns >= SILENCE_NS and step.run_timestep - self._silent > self._window
        if step.run_timestep < self._next or alone:  # another run; or it was said already
            self._bad, self.alarm = 0, None
            self._begin(step.run_timestep)
        if missing_ns >= SILENCE_NS:
            self._silent = step.run_timestep
        elif step.run_timestep < self._next:
            self._silent = -self._window
        self._next = step.run_timestep + 1
        times_ns = step.capture_ns, step.ready_ns, step.arena_ns, step.sent_ns
        for stage in range(3):
            self._stages_ns[stage] += times_ns[stage + 1] - times_ns[stage]
        late = step.sent_ns - step.capture_ns > self._dt_ns
        self._lived += 1
        self._late += late
        self._tally.add(step.run_timestep, late)
        for status in robots.values():
            if status.connected and status.telemetry is not None:
                self._robots += 1
                self._held += status.telemetry.stop_cause == StopCause.STALE
        if self._next - self._first < self._window:
            return None
        line = self._judge()
        self._begin(self._next)
        return line

    def _judge(self) -> str | None:
        """What there is to say at the end of a window."""
        wanted = self._next - self._first
        left_out = wanted - self._lived
        if self._late + left_out <= MOST_LATE * wanted:
            was_bad, self._bad, self.alarm = self._bad, 0, None
            return "timesteps are on time again" if was_bad else None
        self._bad += 1
        slow = self._slow("make" if " and " in self._who else "makes", self._lived, wanted)
        late = f"{self._cause()} of {self._dt_ns / 1e6:.0f} ms{self._advice(self._lived / wanted)}"
        headline, _, more = slow.partition("; ")
        self.alarm = Alarm("overload", headline, f"{more}; {late}" if more else late)
        if self._bad % REPEAT != 1:
            return None
        seconds = wanted * self._dt_ns / 1e9
        held = 100.0 * self._held / self._robots if self._robots else 0.0
        return (
            f"{slow}: of {wanted} in the last {seconds:.0f} s"
            f" {self._late} were late and {left_out} left out; robots stood still for old readings"
            f" {held:.0f} % of the time; {late}"
        )

    def _advice(self, share: float) -> str:
        """A pace at which timesteps would be on time, from the share of them that were made."""
        if not self._can_slow:
            return ""
        pace = math.floor(clock.pace() * share * ON_TIME_SHARE * 100.0) / 100.0
        return f"; it would keep up with --pace {max(pace, 0.01):g}"

    def _slow(self, makes: str, done: int, wanted: int) -> str:
        """How many timesteps there are of those that there should be."""
        if wanted - done <= MOST_LATE * wanted:
            return "timesteps are late"
        hz = 1e9 / self._dt_ns
        return (
            f"{self._who} {makes} {hz * done / wanted:.1f} of {hz:g} timesteps per second;"
            f" a run with more than {100 * MOST_LATE:g} % left out is invalid, unless its plan says"
            " otherwise"
        )

    def verdict(self, timesteps: int = 0) -> str | None:
        """What there is to say of the whole run, which had so many or, 0, ended with its last one;
        None: it was on time."""
        tally, self._tally, self.alarm = self._tally, Tally(), None
        wanted = timesteps or tally.last + 1
        if tally.late + wanted - tally.done <= MOST_LATE * wanted:
            return None
        words = self._slow("made", tally.done, wanted).replace("are late", "were late")
        return (
            f"{words}: of {wanted} {tally.late} were late and {wanted - tally.done} left out"
            f"{self._advice(tally.done / wanted)}"
        )

    def _cause(self) -> str:
        """The slowest part of a timestep, and how long it takes."""
        names = "pictures take", "tracking takes", "world and sensors take"
        slowest = max(range(3), key=lambda stage: self._stages_ns[stage])
        return f"{names[slowest]} {self._stages_ns[slowest] / self._lived / 1e6:.0f} ms"


OBEY_TIMEOUT_NS = 150_000_000
"""A robot may take so long to do what it is told: the network, a control step, a telemetry."""

DEAD_LINK_NS = 500_000_000
"""A robot stops its wheels by itself 400 ms after the last that it has heard."""

UNSURE_NS = 2_000_000_000
"""By then the cameras have seen whether a robot stands that was heard last so long ago."""

MIN_MOTION_NS = 80_000_000
"""Two looks of the cameras that show a motion are at least so far apart."""

STILL_NS = 300_000_000
"""A robot that has not moved for so long stands."""

MOVED_M, MOVED_RAD = 0.005, 0.1
"""What moves less stands still: cameras tremble, and shake."""

_DISOBEYS = "does NOT stop"
_STANDING = (Wanted.IDLE, Wanted.PAUSE, Wanted.STOP)


def moves(robot: RobotStatus) -> bool:
    """Whether a robot that is connected reports that it runs, or that its wheels turn."""
    said = robot.telemetry
    if said is None or not robot.connected:
        return False
    return said.state == Wanted.RUN or (said.left_steps_s, said.right_steps_s) != (0, 0)


def stands(robot: RobotStatus) -> bool:
    """Whether a robot has reported that it stands since it was told to."""
    heard_ns = robot.heard_ns
    return heard_ns is not None and heard_ns > robot.ordered_ns and not moves(robot)


def disobeys(robot: RobotStatus, now_ns: int) -> str:
    """Says what a robot reports that was told to stand still; "": nothing is wrong.

    `now_ns` is the host's clock.
    """
    said, heard_ns = robot.telemetry, robot.heard_ns
    if said is None or heard_ns is None or robot.wanted not in _STANDING or not moves(robot):
        return ""
    if heard_ns - robot.ordered_ns < OBEY_TIMEOUT_NS:
        return ""  # what it has said may be what it did before it heard
    what = "it runs" if said.state == Wanted.RUN else "its wheels turn"
    return _words(robot, f"it reports that {what}", now_ns)


def _words(robot: RobotStatus, what: str, now_ns: int) -> str:
    since_s = (now_ns - robot.ordered_ns) / 1e9
    return f"{_DISOBEYS}: told to {robot.wanted.name.lower()} {since_s:.2f} s ago, {what}"


def _alarm(robot: RobotStatus, what: str, cause: str) -> Alarm:
    kind = "disobeys" if what == _DISOBEYS else "no_link"
    return Alarm(kind, f"robot {robot.tag} {what}: lift it", f"{cause}; or switch it off")


def _must_stand_ns(robot: RobotStatus) -> int | None:
    """Since when a robot must stand still; None: it may move, or be moved by people."""
    if robot.held == NOT_SEEN:
        return None  # who was not seen may come back in somebody's hands
    if robot.wanted in _STANDING:
        return robot.ordered_ns
    if robot.connected or robot.heard_ns is None:
        return None
    return robot.heard_ns + DEAD_LINK_NS


class Obedience:
    """Watches robots that must stand still after they ran: told to, or without a link.

    What people carry must not look like disobedience: a robot that the cameras have once seen
    standing still, or that was not seen for a while, is left to its telemetry. One that was seen
    moving stays an alarm out of their sight.

    Attributes:
        alarms: what is wrong now.
    """

    def __init__(self) -> None:
        self.alarms: tuple[Alarm, ...] = ()
        self._reported: dict[int, str] = {}
        self._ran: set[int] = set()
        self._poses: dict[int, tuple[int, NDArray[Any]]] = {}
        self._moving: set[int] = set()

    def update(
        self, robots: Mapping[int, RobotStatus], state: ArenaState | None, now_ns: int
    ) -> list[str]:
        """Takes the newest status of every robot by tag, and a new arena state, if there is one.

        Returns a line for each robot that does not obey, and for each that obeys again.
        """
        self._note_orders(robots)
        if state is not None:
            self._look(robots, state)
        lines, alarms = [], []
        for tag, robot in robots.items():
            wrong = disobeys(robot, now_ns) or self._seen(tag, robot, now_ns)
            what, _, cause = wrong.partition(": ")
            if what:
                alarms.append(_alarm(robot, what, cause))
            if what and self._reported.get(tag) != what:
                lines.append(f"ROBOT {tag} {what}: LIFT IT ({cause})")
                self._reported[tag] = what
            elif not what and (before := self._reported.pop(tag, "")):
                again = "obeys again" if before == _DISOBEYS else "moves no more"
                lines.append(f"robot {tag} {again}")
        self.alarms = tuple(alarms)
        return lines

    def is_unsure(self, robots: Mapping[int, RobotStatus], now_ns: int) -> bool:
        """Whether a robot has just lost its link, and nobody has seen yet whether it stands."""
        return any(
            not robot.connected
            and tag in self._ran - self._moving
            and robot.heard_ns is not None
            and now_ns - robot.heard_ns < UNSURE_NS
            for tag, robot in robots.items()
        )

    def _note_orders(self, robots: Mapping[int, RobotStatus]) -> None:
        for tag, robot in robots.items():
            if robot.held == NOT_SEEN:
                self._poses.pop(tag, None)
                if tag not in self._moving:
                    self._ran.discard(tag)
            elif _must_stand_ns(robot) is None:
                self._ran.add(tag)
                self._moving.discard(tag)
                self._poses.pop(tag, None)

    def _seen(self, tag: int, robot: RobotStatus, now_ns: int) -> str:
        if tag not in self._moving:
            return ""
        if robot.held == NOT_SEEN:
            return _words(robot, "the cameras saw it move, and do not see it now", now_ns)
        if robot.wanted in _STANDING:
            return _words(robot, "the cameras see it move", now_ns)
        silent_s = (now_ns - (robot.heard_ns or 0)) / 1e9
        return f"moves without a link: nothing heard for {silent_s:.1f} s, the cameras see it move"

    def _look(self, robots: Mapping[int, RobotStatus], state: ArenaState) -> None:
        rows = state.robots[state.robots["seen"]]
        for tag, time_ns, *pose in zip(
            *(rows[name].tolist() for name in ("tag", "capture_ns", "x_m", "y_m", "yaw_rad"))
        ):
            robot = robots.get(tag)
            since_ns = None if robot is None else _must_stand_ns(robot)
            if since_ns is None or tag not in self._ran:
                continue
            if time_ns - since_ns >= OBEY_TIMEOUT_NS:
                self._compare(tag, time_ns, np.array(pose))

    def _compare(self, tag: int, time_ns: int, pose: NDArray[Any]) -> None:
        """Compares a robot's pose with that since which it has not moved."""
        before_ns, before = self._poses.setdefault(tag, (time_ns, pose))
        turned = abs((pose[2] - before[2] + np.pi) % (2.0 * np.pi) - np.pi)
        moved = float(np.hypot(*(pose - before)[:2])) > MOVED_M or turned > MOVED_RAD
        if moved and time_ns - before_ns >= MIN_MOTION_NS:
            self._poses[tag] = time_ns, pose
            self._moving.add(tag)
        elif not moved and time_ns - before_ns >= STILL_NS:
            self._moving.discard(tag)
            self._ran.discard(tag)
