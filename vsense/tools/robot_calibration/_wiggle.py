"""Does the marker that turns sit on the robot that was told to? One robot after the other.

Each robot turns 20 degrees on the spot and back again, by its daemon alone: whatever controller it
runs, and whatever marker it wears. All others stand. Where a pause, or pictures that stay out, fall
into a turn, it is made again.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

from vsense.base.arena import ArenaState, wrap_angle
from vsense.robots.link.table import Goal
from vsense.run.homing.robots import Trouble

TURN_RAD = math.radians(20.0)
"""A robot is told to stand when some marker has turned so far but for its way to a stop."""
_STOPPING_RAD = math.radians(3.0)
_LEAD_RAD = 0.2
"""It is sent to a heading so far ahead: about 0.4 rad/s, and no farther where the host is lost."""
_LONGEST_NS = 2_000_000_000
"""Twice what a turn takes; then it has turned too little."""
_STAND_NS = 700_000_000
"""Before and after a turn everybody stands for so long, and was seen in the newer half of it."""
_LINK_NS = 3_000_000_000
_GAP_NS = 500_000_000
_TRIES = 3

TURNED_RAD = math.radians(6.0)
"""A marker that turned less has not."""
LEAST_RAD, MOST_RAD = math.radians(12.0), math.radians(32.0)
MOST_MOVED_M = 0.006
"""A robot whose one wheel stands moves by 9 mm; a marker 4 mm off the axle's middle by 1.4."""


class Verdict(str, Enum):
    """What came of a robot's turn."""

    OK = "ok"
    OTHER = "other marker"
    NONE = "no marker"
    SEVERAL = "several markers"
    WRONG_WAY = "wrong way"
    TOO_LITTLE = "too little"
    TOO_MUCH = "too much"
    MOVED = "moved away"
    OUT_OF_REACH = "out of reach"
    NOT_DONE = "not done"


@dataclass(frozen=True, slots=True)
class WiggledRobot:
    """What was found of one robot.

    Attributes:
        name: its own in the experiment.
        turned_rad: by marker, how far those turned that did, counter-clockwise.
        moved_m: how far its own marker moved; None: it was not seen before and after.
        why: it is out of reach, or its turn was not done; "": it was.
        twice: its tag was seen at two places.
        commanded: it was to turn; else only whether it is there was checked.
    """

    tag: int
    name: str
    turned_rad: Mapping[int, float] = field(default_factory=dict)
    moved_m: float | None = None
    why: str = ""
    twice: bool = False
    commanded: bool = True

    @property
    def verdict(self) -> Verdict:
        """What is to be said of it first."""
        if self.why or not self.commanded:
            return self._verdict_unmoved()
        if not self.turned_rad:
            return Verdict.NONE
        if len(self.turned_rad) > 1 or self.twice:
            return Verdict.SEVERAL
        ((marker, turned_rad),) = self.turned_rad.items()
        if marker != self.tag:
            return Verdict.OTHER
        if turned_rad < 0.0:
            return Verdict.WRONG_WAY
        if not LEAST_RAD <= turned_rad <= MOST_RAD:
            return Verdict.TOO_LITTLE if turned_rad < LEAST_RAD else Verdict.TOO_MUCH
        return Verdict.MOVED if (self.moved_m or 0.0) > MOST_MOVED_M else Verdict.OK

    def _verdict_unmoved(self) -> Verdict:
        if not self.why:
            return Verdict.OK
        away = self.why in _AWAY or not self.commanded
        return Verdict.OUT_OF_REACH if away else Verdict.NOT_DONE

    @property
    def words(self) -> str:
        """What was seen, for people, and what it may come from."""
        return f"{self._seen()}{_CAUSES.get(self.verdict, '')}"

    def _seen(self) -> str:
        turned = {marker: f"{math.degrees(rad):+.0f}°" for marker, rad in self.turned_rad.items()}
        verdict, own = self.verdict, turned.get(self.tag, "")
        if self.why or not self.commanded:
            return self.why or "is connected and seen"
        if verdict is Verdict.NONE:
            unseen = "" if self.moved_m is not None else f"; its own marker {self.tag} is not seen"
            return f"no marker turned{unseen}"
        if self.twice:
            return f"the marker {self.tag} is seen at two places"
        if verdict is Verdict.SEVERAL:
            return f"turned the markers {', '.join(map(str, turned))}"
        if verdict is Verdict.OTHER:
            return f"turned the marker {next(iter(turned))}"
        if verdict is Verdict.MOVED:
            return f"turned {own}, and moved by {1000.0 * (self.moved_m or 0.0):.0f} mm"
        return f"turned {own}"


_AWAY = [trouble.value for trouble in (Trouble.NO_LINK, Trouble.TOO_OLD, Trouble.HELD)]
_CAUSES = {
    Verdict.NONE: ": its motors, or it wears a marker that no camera reads",
    Verdict.SEVERAL: ": does somebody carry robots, or do two wear one marker?",
    Verdict.WRONG_WAY: ": the cables of its wheels are exchanged",
    Verdict.TOO_LITTLE: " in place of +20°: a motor stalls, or it is held",
    Verdict.TOO_MUCH: " in place of +20°: does somebody carry it?",
    Verdict.MOVED: ": one of its wheels does not turn",
}


class _Seen(NamedTuple):
    time_ns: int
    x_m: float
    y_m: float
    yaw_rad: float


_Marks = dict[int, _Seen]
_Driving = Iterator[Mapping[int, Goal]]
_Turning = Generator[Mapping[int, Goal], None, WiggledRobot | None]


class WiggleCheck:
    """Turns robots in their turn; a `Guide` of `vsense.run.homing.starts`.

    Attributes:
        doing: what people read that robots do.
        rows: what was found so far, in the robots' order.
        news: lines for people that were not told yet.
    """

    doing = "checking"

    def __init__(self, robots: Mapping[int, str]) -> None:
        """Prepares the turns of robots: names by tag."""
        self.rows: list[WiggledRobot] = []
        self.news: list[str] = []
        self._robots = dict(robots)
        self._marks: _Marks = {}
        self._now_ns: int | None = None
        self._troubles: Mapping[int, Trouble] = {}
        self._twice: frozenset[int] = frozenset()
        self._disturbed = False
        self._turns = self._run()

    @property
    def done(self) -> bool:
        """Whether all robots have had their turn."""
        return len(self.rows) == len(self._robots)

    def progress(self) -> str:
        """A line for people."""
        bad = sum(robot.verdict is not Verdict.OK for robot in self.rows)
        doing = list(self._robots)[len(self.rows) :][:1]
        now = f", robot {doing[0]} turns" if doing else ""
        return f"{len(self.rows)} of {len(self._robots)} robots{now}; {bad} not as they should be"

    def rest(self) -> None:
        """All robots stand, by an order: the turn that was being made is made again."""
        self._disturbed = True

    def step(self, state: ArenaState, troubles: Mapping[int, Trouble]) -> Mapping[int, Goal]:
        """Takes an arena state, and who cannot be told to drive; gives where robots are to turn."""
        now_ns, before_ns = state.capture_ns, self._now_ns
        self._disturbed |= before_ns is not None and now_ns - before_ns > _GAP_NS
        self._now_ns, self._troubles = now_ns, troubles
        self._twice = frozenset(state.duplicates)
        for row in state.robots[state.robots["seen"]]:
            self._marks[int(row["tag"])] = _Seen(
                *(int(row["capture_ns"]), float(row["x_m"]), float(row["y_m"])),
                float(row["yaw_rad"]),
            )
        return next(self._turns, {})

    def ended(self, why: str) -> list[WiggledRobot]:
        """All robots, of which the rest was not reached, and why."""
        rest = list(self._robots.items())[len(self.rows) :]
        return [*self.rows, *(WiggledRobot(tag, name, why=why) for tag, name in rest)]

    @property
    def _time_ns(self) -> int:
        assert self._now_ns is not None
        return self._now_ns

    def _run(self) -> _Driving:
        for tag, name in self._robots.items():
            result: WiggledRobot | None = None
            for _ in range(_TRIES):
                self._disturbed = False
                result = yield from self._turn(tag, name)
                if result is not None:
                    break
            result = result or WiggledRobot(tag, name, why="was interrupted three times")
            self.rows.append(result)
            if result.verdict is not Verdict.OK:
                self.news.append(f"robot {tag} ({name}) {result.words}")

    def _turn(self, tag: int, name: str) -> _Turning:
        yield from self._stand(_STAND_NS)
        until_ns = self._time_ns + _LINK_NS
        while (trouble := self._troubles.get(tag)) and self._time_ns < until_ns:
            yield {}
        if trouble:
            return WiggledRobot(tag, name, why=trouble.value)
        before, twice = self._seen_lately(), tag in self._twice
        yield from self._drive(tag, before, 1)
        lost = self._troubles.get(tag)
        yield from self._stand(_STAND_NS)
        if self._disturbed:
            return None
        after = self._seen_lately()
        turned, moved_m = _turned(before, after), _moved_m(before, after, tag)
        if not lost:
            yield from self._drive(tag, after, -1)
        if lost and not turned:
            return WiggledRobot(tag, name, why=lost.value)
        return WiggledRobot(tag, name, turned, moved_m, twice=twice or tag in self._twice)

    def _drive(self, tag: int, before: _Marks, sign: int) -> _Driving:
        """Has a robot turn until some marker has, or for the longest time."""
        goal = Goal(heading=round(sign * _LEAD_RAD * 1e4))
        until_ns = self._time_ns + _LONGEST_NS
        while self._time_ns < until_ns and not (self._disturbed or self._troubles.get(tag)):
            if any(abs(rad) >= TURN_RAD - _STOPPING_RAD for rad in _turns(before, self._marks)):
                return
            yield {tag: goal}

    def _stand(self, time_ns: int) -> _Driving:
        yield {}
        until_ns = self._time_ns + time_ns
        while self._time_ns < until_ns:
            yield {}

    def _seen_lately(self) -> _Marks:
        since_ns = self._time_ns - _STAND_NS // 2
        return {tag: seen for tag, seen in self._marks.items() if seen.time_ns >= since_ns}


def _turns(before: _Marks, after: _Marks) -> list[float]:
    return [
        float(wrap_angle(after[tag].yaw_rad - seen.yaw_rad))
        for tag, seen in before.items()
        if tag in after
    ]


def _turned(before: _Marks, after: _Marks) -> dict[int, float]:
    both = {tag: seen for tag, seen in before.items() if tag in after}
    turns = dict(zip(both, _turns(both, after)))
    return {tag: rad for tag, rad in turns.items() if abs(rad) >= TURNED_RAD}


def _moved_m(before: _Marks, after: _Marks, tag: int) -> float | None:
    if tag not in before or tag not in after:
        return None
    was, now = before[tag], after[tag]
    return math.hypot(now.x_m - was.x_m, now.y_m - was.y_m)


def exchanged(rows: Sequence[WiggledRobot]) -> list[tuple[int, int]]:
    """Pairs of robots that wear each other's markers."""
    wears = {
        robot.tag: next(iter(robot.turned_rad)) for robot in rows if robot.verdict is Verdict.OTHER
    }
    return [(tag, worn) for tag, worn in wears.items() if tag < worn and wears.get(worn) == tag]
