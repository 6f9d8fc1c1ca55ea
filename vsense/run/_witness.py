"""Watches a run for robots that are lost, and robots that somebody moves, fail or never come."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from vsense.base.arena import ArenaState
from vsense.robots.link.status import RobotStatus
from vsense.robots.link.wire import StopCause
from vsense.run._standing import MOST_STEP_NS
from vsense.run.verdict import RobotRecord
from vsense.world.robot_models import EPUCK, RobotModel

FASTER = 0.16 / EPUCK.v_max_m_s
"""What a robot may seem to have gone over what its wheels can: a quarter is left to errors."""

PUSHED_M = 0.015
"""Who stands with another body so near to its own may have been pushed by it."""

STOPPED_NS = 500_000_000
"""A robot that has told so long that its wheels stand does stand."""

GONE_NS = 1_000_000_000
"""Who was not seen for a moment when the run ended is not gone."""

PAUSE_NS = 1_000_000_000
"""Where a timestep came so much later than its number says, the run was paused before it."""

OWN_CAUSES: Mapping[int, str] = {
    StopCause.NO_BEAT: "its controller did not return",
    StopCause.BASE: "its base did not answer",
    StopCause.GUARD: "nothing guarded it",
    StopCause.BATTERY: "its battery was too low",
}
"""Why a robot holds its wheels by itself."""

STANDING_NS = 1_000_000_000
"""How far a standing robot was moved is compared over this time: cameras drift more slowly."""

SeenPlace = tuple[float, float]


@dataclass(slots=True)
class _Gap:
    """The longest time in which something did not hold.

    Attributes:
        held_ns: when it held last, at first when it was looked at first; None: never yet.
        longest_ns: the longest time between two such moments, or since the newest.
    """

    held_ns: int | None = None
    longest_ns: int = 0

    def note(self, holds: bool, now_ns: int) -> None:
        """Takes whether it holds now."""
        since_ns = now_ns if self.held_ns is None else self.held_ns
        self.longest_ns = max(self.longest_ns, now_ns - since_ns)
        self.held_ns = now_ns if holds else since_ns


@dataclass(slots=True)
class _Watched:
    """What is known of one robot.

    Attributes:
        well: it had its link, and was seen.
        unlinked_ns, longest_ns: so long it has had no link now, and at the longest.
        came, seen: it had a link, and was seen, at some time.
        acted: it has reported that nothing holds its wheels; None: nothing yet.
        held_ns, held_by: so long something of its own held them, and what the last time.
        starts: how often its daemon was started, when it was seen first and last.
        place, seen_ns: where and when it was seen last.
        stands_ns: since when it tells that its wheels stand; None: they turn, or nobody knows.
        anchor, anchor_ns: where and when it was seen first while it stood alone.
        moved_m: the farthest that somebody moved it.
        refused, other_program, millivolts, uid, programs: as last reported.
    """

    name: str
    unlinked_ns: int = 0
    longest_ns: int = 0
    well: _Gap = field(default_factory=_Gap)
    came: bool = False
    seen: bool = False
    acted: bool | None = None
    held_ns: int = 0
    held_by: str = ""
    starts: tuple[int, int] = (0, 0)
    refused: str = ""
    other_program: str = ""
    place: SeenPlace | None = None
    seen_ns: int = 0
    stands_ns: int | None = None
    anchor: SeenPlace | None = None
    anchor_ns: int = 0
    moved_m: float = 0.0
    millivolts: int = 0
    uid: str = ""
    programs: tuple[str, ...] = ()


class Witness:
    """Sees every timestep of one run.

    Args:
        robots, objects: names by tag, of robots and of tagged objects.
        models: of all of them that are no e-pucks, by tag.
    """

    def __init__(
        self,
        robots: Mapping[int, str],
        objects: Mapping[int, str] = {},
        models: Mapping[int, RobotModel] = {},
    ) -> None:
        largest_m = max(model.radius_m for model in (EPUCK, *models.values()))
        self._fastest_m_s = FASTER * max(m.v_max_m_s for m in (EPUCK, *models.values()))
        self._pushed_m = 2.0 * largest_m + PUSHED_M
        self._robots = {tag: _Watched(name) for tag, name in robots.items()}
        self._unseen = dict(objects)
        self._newest_ns: int | None = None
        self._paused_ns = 0
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
        for tag in self._unseen.keys() & places.keys():
            del self._unseen[tag]
        for tag, robot in self._robots.items():
            status, place = robots[tag], places.get(tag)
            self._note_link(robot, status, now_ns)
            robot.seen |= place is not None
            robot.well.note(place is not None and status.connected, now_ns)
            if place is not None:
                others = (other for t, other in places.items() if t != tag)
                self._note_place(robot, place, now_ns, others)
        self._newest_ns = now_ns

    @property
    def records(self) -> dict[int, RobotRecord]:
        """What there was of each robot, by tag."""
        return {
            tag: RobotRecord(
                name=robot.name,
                came=robot.came,
                seen=robot.seen,
                refused=robot.refused,
                other_program=robot.other_program,
                acted=robot.acted is not False,
                starts=robot.starts[1] - robot.starts[0],
                held_s=robot.held_ns / 1e9,
                held_by=robot.held_by,
                unlinked_s=robot.longest_ns / 1e9,
                lost_s=robot.well.longest_ns / 1e9,
                moved_mm=1000.0 * robot.moved_m,
            )
            for tag, robot in self._robots.items()
        }

    @property
    def unseen(self) -> list[str]:
        """Names of tagged objects that were never seen."""
        return list(self._unseen.values())

    @property
    def gone(self) -> list[int]:
        """Tags of robots that were lost when the run ended."""
        return [
            tag
            for tag, robot in self._robots.items()
            if robot.well.held_ns is not None
            and self._newest_ns is not None
            and self._newest_ns - robot.well.held_ns > GONE_NS
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
        """What they run: controllers with hashes, daemons with versions; as a run's `versions`."""
        return sorted({word for robot in self._robots.values() for word in robot.programs})

    def _without_pauses_ns(self, capture_ns: int, run_ns: int) -> int:
        if self._before is not None:
            captured_ns, ran_ns = self._before
            more_ns = (capture_ns - captured_ns) - (run_ns - ran_ns)
            self._paused_ns += more_ns if more_ns > PAUSE_NS else 0
        self._before = capture_ns, run_ns
        return capture_ns - self._paused_ns

    def _note_link(self, robot: _Watched, status: RobotStatus, now_ns: int) -> None:
        said = status.telemetry
        robot.came |= status.connected
        # Of the time between two arena states nobody knows more: the tracker may have failed.
        before_ns = now_ns if self._newest_ns is None else self._newest_ns
        elapsed_ns = min(now_ns - before_ns, MOST_STEP_NS)
        robot.unlinked_ns = 0 if status.connected else robot.unlinked_ns + elapsed_ns
        robot.longest_ns = max(robot.longest_ns, robot.unlinked_ns)
        robot.refused = status.refused
        robot.other_program = status.other_program or robot.other_program
        if status.starts:
            robot.starts = robot.starts[0] or status.starts, status.starts
        if said is not None and status.connected:
            robot.acted = robot.acted or said.stop_cause == StopCause.NONE
            if words := OWN_CAUSES.get(said.stop_cause):
                robot.held_ns, robot.held_by = robot.held_ns + elapsed_ns, words
        robot.uid = robot.uid if status.uid is None else status.uid.hex()
        if status.connected and status.controller:
            robot.programs = f"{status.controller}={status.hash}", f"vsensed={status.version}"
        turns = said is None or (said.left_steps_s, said.right_steps_s) != (0, 0)
        if said is not None:
            robot.millivolts = said.battery_mv or robot.millivolts
        if turns or not status.connected:
            robot.stands_ns, robot.anchor = None, None
        elif robot.stands_ns is None:
            robot.stands_ns = now_ns

    def _note_place(
        self, robot: _Watched, place: SeenPlace, now_ns: int, others: Iterable[SeenPlace]
    ) -> None:
        """Compares where a robot is with where it can be; `others` may push it."""
        if robot.place is not None:
            could_m = self._fastest_m_s * (now_ns - robot.seen_ns) / 1e9
            robot.moved_m = max(robot.moved_m, math.dist(place, robot.place) - could_m)
        robot.place, robot.seen_ns = place, now_ns
        stands = robot.stands_ns is not None and now_ns - robot.stands_ns >= STOPPED_NS
        if not stands or any(math.dist(place, other) <= self._pushed_m for other in others):
            robot.anchor = None
        elif robot.anchor is None or now_ns - robot.anchor_ns > STANDING_NS:
            robot.anchor, robot.anchor_ns = place, now_ns
        else:
            robot.moved_m = max(robot.moved_m, math.dist(place, robot.anchor))
