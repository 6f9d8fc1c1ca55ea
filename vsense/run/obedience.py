"""Whether robots do what they are told: one that goes on after STOP is said loudly, for any cause,
and so is one that moves without a link.

A robot tells what it does in its telemetry, and the cameras see it. What it is told to do is in its
status, and since when.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import ArenaState
from vsense.robots.link.status import RobotStatus
from vsense.robots.link.wire import Wanted
from vsense.run.overload import Alarm

PATIENCE_NS = 150_000_000
"""A robot may take so long to do what it is told: the network, a control step, a telemetry."""

DEAD_LINK_NS = 500_000_000
"""A robot stops its wheels by itself 400 ms after the last that it has heard."""

LOOK_NS = 80_000_000
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
    if heard_ns - robot.ordered_ns < PATIENCE_NS:
        return ""  # what it has said may be what it did before it heard
    what = "it runs" if said.state == Wanted.RUN else "its wheels turn"
    return _words(robot, f"it reports that {what}", now_ns)


def _words(robot: RobotStatus, what: str, now_ns: int) -> str:
    since_s = (now_ns - robot.ordered_ns) / 1e9
    return f"{_DISOBEYS}: told to {robot.wanted.name.lower()} {since_s:.2f} s ago, {what}"


def _alarm(robot: RobotStatus, wrong: str) -> Alarm:
    what, _, cause = wrong.partition(": ")
    kind = "disobeys" if what == _DISOBEYS else "no_link"
    return Alarm(kind, f"{robot.name} {what}: lift it", f"{cause}; or switch it off")


def _must_stand_ns(robot: RobotStatus) -> int | None:
    """Since when a robot must stand still; None: it may move."""
    if robot.wanted in _STANDING:
        return robot.ordered_ns
    if robot.connected or robot.heard_ns is None:
        return None
    return robot.heard_ns + DEAD_LINK_NS


class Obedience:
    """Watches robots that must stand still after they ran: told to, or without a link.

    What people carry must not look like disobedience: a robot that the cameras have once seen
    standing still is left to its telemetry.

    Attributes:
        alarms: what is wrong now.
    """

    def __init__(self) -> None:
        self.alarms: tuple[Alarm, ...] = ()
        self._told: dict[int, str] = {}
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
            if wrong:
                alarms.append(_alarm(robot, wrong))
            if wrong and tag not in self._told:
                what, _, cause = wrong.partition(": ")
                lines.append(f"ROBOT {robot.name} {what}: LIFT IT ({cause})")
                self._told[tag] = wrong
            elif not wrong and (before := self._told.pop(tag, "")):
                again = "obeys again" if before.startswith(_DISOBEYS) else "moves no more"
                lines.append(f"robot {robot.name} {again}")
        self.alarms = tuple(alarms)
        return lines

    def _note_orders(self, robots: Mapping[int, RobotStatus]) -> None:
        for tag, robot in robots.items():
            if _must_stand_ns(robot) is None:
                self._ran.add(tag)
                self._moving.discard(tag)
                self._poses.pop(tag, None)

    def _seen(self, tag: int, robot: RobotStatus, now_ns: int) -> str:
        if tag not in self._moving or _must_stand_ns(robot) is None:
            return ""
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
            if time_ns - since_ns >= PATIENCE_NS:
                self._compare(tag, time_ns, np.array(pose))

    def _compare(self, tag: int, time_ns: int, pose: NDArray[Any]) -> None:
        """Compares a robot's pose with that since which it has not moved."""
        before_ns, before = self._poses.setdefault(tag, (time_ns, pose))
        turned = abs((pose[2] - before[2] + np.pi) % (2.0 * np.pi) - np.pi)
        moved = float(np.hypot(*(pose - before)[:2])) > MOVED_M or turned > MOVED_RAD
        if moved and time_ns - before_ns >= LOOK_NS:
            self._poses[tag] = time_ns, pose
            self._moving.add(tag)
        elif not moved and time_ns - before_ns >= STILL_NS:
            self._moving.discard(tag)
            self._ran.discard(tag)
