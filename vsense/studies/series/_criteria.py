"""When a run does not count: criteria that are written down before the first run.

A witness watches each run for robots that are lost, and robots that somebody moves.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from vsense.base.arena import ArenaState
from vsense.robots.link.status import RobotStatus
from vsense.run.robots import shorten
from vsense.world.entities import BODY_RADIUS_M

FASTEST_M_S = 0.16
"""An e-puck's wheels turn at 1000 steps/s at most, 0.129 m/s; a quarter more is left to errors."""

PUSHED_M = 2.0 * BODY_RADIUS_M + 0.015
"""Who stands with another one so near may have been pushed by it."""

STOPPED_NS = 500_000_000
"""A robot that has told so long that its wheels stand does stand."""

GONE_NS = 1_000_000_000
"""Who was not seen for a moment when the run ended is not gone."""

PAUSE_NS = 1_000_000_000
"""Where a timestep came so much later than its number says, the run was paused before it."""

STANDING_NS = 1_000_000_000
"""How far a standing robot was moved is compared over this time: cameras drift more slowly."""

SeenPlace = tuple[float, float]


@dataclass(frozen=True, slots=True)
class VoidCriteria:
    """What makes a run void; None and False: that does not.

    Attributes:
        lost_s: a robot was not seen, or had no link, for longer than this.
        moved_mm: somebody moved a robot by more than this: it stood, or jumped.
        fenced_s: a robot stood for the fence for longer than this.
        late: more than this share of the timesteps was late or left out, 0..1.
        ended_early: the run ended before its length was over.
        away_from_start: a robot that plays did not reach its start.
    """

    lost_s: float | None = None
    moved_mm: float | None = None
    fenced_s: float | None = None
    late: float | None = None
    ended_early: bool = True
    away_from_start: bool = True

    def in_words(self) -> list[str]:
        """The criteria for people, one line each."""
        sentences = {
            f"a robot is lost for {self.lost_s or 0:g} s": self.lost_s is not None,
            f"a robot is moved by hand by {self.moved_mm or 0:g} mm": self.moved_mm is not None,
            f"a robot stands for the fence for more than {self.fenced_s or 0:g} s": self.fenced_s
            is not None,
            f"more than {100 * (self.late or 0):g} % of the timesteps are late": self.late
            is not None,
            "it ends before its time": self.ended_early,
            "a robot does not reach its start": self.away_from_start,
        }
        return [words for words, holds in sentences.items() if holds]


@dataclass(frozen=True, slots=True)
class Evidence:
    """What a run has shown, for its verdict.

    Attributes:
        ended: why it ended; "time": its length was over.
        late: share of timesteps that were late or left out; None: not known.
        lost_s: by robot's name, the longest time that it was lost.
        moved_mm: by robot's name, the farthest that somebody moved it.
        fenced_s: by robot's name, how long it stood for the fence.
        away: names of robots that were not at their starts, with why.
        measured: it had a timestep at least.
    """

    ended: str = "time"
    late: float | None = None
    lost_s: Mapping[str, float] = field(default_factory=dict)
    moved_mm: Mapping[str, float] = field(default_factory=dict)
    away: tuple[str, ...] = ()
    fenced_s: Mapping[str, float] = field(default_factory=dict)
    measured: bool = True


def why_void(criteria: VoidCriteria, evidence: Evidence) -> str:
    """Why a run does not count, in words; "": it does."""
    reasons = []
    if criteria.ended_early and evidence.ended != "time":
        reasons.append(f"{evidence.ended or 'failed'} before its end")
    elif not evidence.measured:
        reasons.append(f"nothing was measured: {evidence.ended or 'failed'}")
    if criteria.away_from_start and evidence.away:
        reasons.append(f"not at the start: {shorten(list(evidence.away))}")
    if (limit_s := criteria.lost_s) is not None:
        lost = [f"{n} lost for {s:.1f} s" for n, s in evidence.lost_s.items() if s > limit_s]
        reasons += [shorten(lost)] if lost else []
    if (limit_mm := criteria.moved_mm) is not None:
        moved = [
            f"{n} moved by {mm:.0f} mm" for n, mm in evidence.moved_mm.items() if mm > limit_mm
        ]
        reasons += [f"{shorten(moved)} by hand"] if moved else []
    if (limit_s := criteria.fenced_s) is not None:
        fenced = [f"{n} stood {s:.1f} s" for n, s in evidence.fenced_s.items() if s > limit_s]
        reasons += [f"{shorten(fenced)} for the fence"] if fenced else []
    if criteria.late is not None and (evidence.late or 0.0) > criteria.late:
        reasons.append(f"{100 * (evidence.late or 0.0):.1f} % of the timesteps late")
    return "; ".join(reasons)


@dataclass(slots=True)
class _Watched:
    """What is known of one robot.

    Attributes:
        well_ns: when it was seen and had its link last.
        lost_ns: the longest time between two such moments.
        place, seen_ns: where and when it was seen last.
        stands_ns: since when it tells that its wheels stand; None: they turn, or nobody knows.
        anchor, anchor_ns: where and when it was seen first while it stood alone.
        moved_m: the farthest that somebody moved it.
        millivolts, uid, program: as last told.
    """

    name: str
    well_ns: int | None = None
    lost_ns: int = 0
    place: SeenPlace | None = None
    seen_ns: int = 0
    stands_ns: int | None = None
    anchor: SeenPlace | None = None
    anchor_ns: int = 0
    moved_m: float = 0.0
    millivolts: int = 0
    uid: str = ""
    program: str = ""


class Witness:
    """Sees every timestep of one run.

    Args:
        robots: their names by tag.
    """

    def __init__(self, robots: Mapping[int, str]) -> None:
        self._robots = {tag: _Watched(name) for tag, name in robots.items()}
        self._newest_ns = self._paused_ns = 0
        self._before: tuple[int, int] | None = None

    def observe(self, state: ArenaState, robots: Mapping[int, RobotStatus], run_ns: int) -> None:
        """Takes the arena state of a timestep of the run, and the status of every robot by tag.

        `run_ns` is the time of the run, without its pauses: in those nobody is lost.
        """
        now_ns, rows = self._without_pauses_ns(state.capture_ns, run_ns), state.robots
        seen = rows[rows["seen"]]
        places = {
            int(tag): (float(x), float(y))
            for tag, x, y in zip(seen["tag"], seen["x_m"], seen["y_m"])
        }
        for tag, robot in self._robots.items():
            status, place = robots[tag], places.get(tag)
            self._note_link(robot, status, now_ns)
            self._note_loss(robot, place is not None and status.connected, now_ns)
            if place is not None:
                alone = all(
                    math.dist(place, other) > PUSHED_M for t, other in places.items() if t != tag
                )
                self._note_place(robot, place, now_ns, alone)
        self._newest_ns = now_ns

    @property
    def lost_s(self) -> dict[str, float]:
        """By robot's name, the longest time that it was lost."""
        return {robot.name: robot.lost_ns / 1e9 for robot in self._robots.values()}

    @property
    def moved_mm(self) -> dict[str, float]:
        """By robot's name, the farthest that somebody moved it."""
        return {robot.name: 1000.0 * robot.moved_m for robot in self._robots.values()}

    @property
    def gone(self) -> list[int]:
        """Tags of robots that were lost when the run ended."""
        return [
            tag
            for tag, robot in self._robots.items()
            if robot.well_ns is not None and self._newest_ns - robot.well_ns > GONE_NS
        ]

    @property
    def volts(self) -> list[float]:
        """Their batteries as last told, of those that told."""
        return [r.millivolts / 1e3 for r in self._robots.values() if r.millivolts]

    @property
    def uids(self) -> list[str]:
        """Who they are, of those that were there."""
        uids = [robot.uid or "-" for robot in self._robots.values()]
        return uids if any(uid != "-" for uid in uids) else []

    @property
    def programs(self) -> list[str]:
        """What they run: name, and hash of the source, as a run's versions have it."""
        return sorted({robot.program for robot in self._robots.values() if robot.program})

    def _without_pauses_ns(self, capture_ns: int, run_ns: int) -> int:
        if self._before is not None:
            captured_ns, ran_ns = self._before
            more_ns = (capture_ns - captured_ns) - (run_ns - ran_ns)
            self._paused_ns += more_ns if more_ns > PAUSE_NS else 0
        self._before = capture_ns, run_ns
        return capture_ns - self._paused_ns

    def _note_link(self, robot: _Watched, status: RobotStatus, now_ns: int) -> None:
        said = status.telemetry
        robot.uid = robot.uid if status.uid is None else status.uid.hex()
        if status.connected and status.controller:
            robot.program = f"{status.controller}={status.hash}"
        turns = said is None or (said.left_steps_s, said.right_steps_s) != (0, 0)
        if said is not None:
            robot.millivolts = said.battery_mv or robot.millivolts
        if turns or not status.connected:
            robot.stands_ns, robot.anchor = None, None
        elif robot.stands_ns is None:
            robot.stands_ns = now_ns

    def _note_loss(self, robot: _Watched, is_well: bool, now_ns: int) -> None:
        if robot.well_ns is None or is_well:
            since_ns = now_ns if robot.well_ns is None else robot.well_ns
            robot.lost_ns = max(robot.lost_ns, now_ns - since_ns)
            robot.well_ns = now_ns if is_well else since_ns
        else:
            robot.lost_ns = max(robot.lost_ns, now_ns - robot.well_ns)

    def _note_place(self, robot: _Watched, place: SeenPlace, now_ns: int, alone: bool) -> None:
        """Compares where a robot is with where it can be."""
        if robot.place is not None:
            could_m = FASTEST_M_S * (now_ns - robot.seen_ns) / 1e9
            robot.moved_m = max(robot.moved_m, math.dist(place, robot.place) - could_m)
        robot.place, robot.seen_ns = place, now_ns
        stands = robot.stands_ns is not None and now_ns - robot.stands_ns >= STOPPED_NS
        if not stands or not alone:
            robot.anchor = None
        elif robot.anchor is None or now_ns - robot.anchor_ns > STANDING_NS:
            robot.anchor, robot.anchor_ns = place, now_ns
        else:
            robot.moved_m = max(robot.moved_m, math.dist(place, robot.anchor))
