"""All robots drive home: one step for every arena state, from poses to a goal for each robot.

Nothing here reads a clock or sends anything: `Homing.step` is a function of what it is given, and
of what it was given before.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping
from functools import partial

import numpy as np

from vsense.base.arena import ArenaState, Floats, wrap_angle
from vsense.config.specs import Pose
from vsense.robots.link.table import STAY, Goal
from vsense.run.homing._assignment import Way, assign, straight_m
from vsense.run.homing._traffic import (
    MAX_M_S,
    Decision,
    Traffic,
    braked_m_s,
    carrot_m,
    decide,
    in_frame,
)
from vsense.run.homing.floor import DrivingFloor
from vsense.run.homing.robots import (
    EXTRA_STANDING_M,
    LIMITS,
    MIN_GAP_M,
    ROBOT_GAP_M,
    WALL_GAP_M,
    Arrival,
    HomingLimits,
    Traveller,
    Trouble,
    apart_m,
)
from vsense.world.robot_models import EPUCK, RobotModel

YIELD_M_S = 0.06
"""The speed with which a robot at its home makes way for others."""

LOST_NS = 300_000_000
"""A robot that was not seen for longer stands until it is seen again."""
REASSIGN_NS = 2_000_000_000
"""Homes are assigned anew when a robot has been hindered for longer, or can drive again."""
NO_PROGRESS_NS = 4_000_000_000
"""A robot that has not come nearer to its home for so long gets priority and a new path."""
ESCAPE_NS = 1_500_000_000
"""A stuck robot drives in another direction for so long."""
MAX_ESCAPES = 3
"""A robot that is stuck once more is given up."""
_MAX_STEP_NS = 500_000_000
"""The longest time between two arena states that counts as time spent."""


class Homing:
    """Brings robots home; see the module.

    Args:
        homes: by tag, each robot's own home, before homes are exchanged.
        names: of the robots, by tag.
        kinds: which robots may exchange homes, see `assign`.
        floor: what else is in the arena.

    Attributes:
        doing: what robots do, for people.
        done: nobody drives any more.
        news: lines for people, oldest first; who prints them takes them out.
    """

    doing = "driving home"

    def __init__(
        self,
        homes: Mapping[int, Pose],
        names: Mapping[int, str],
        kinds: Mapping[int, Hashable],
        floor: DrivingFloor,
        limits: HomingLimits = LIMITS,
        models: Mapping[int, RobotModel] = {},
    ) -> None:
        self._models = models
        self.robots = {
            tag: Traveller(tag, names.get(tag, ""), home, home, models.get(tag, EPUCK))
            for tag, home in homes.items()
        }
        self.done = False
        self.news: list[str] = []
        self._kinds, self._floor, self._limits = dict(kinds), floor, limits
        self._begun_ns: int | None = None
        self._newest_ns = self._spent_ns = 0
        self._assigned_for: frozenset[int] | None = None
        self._hindered_ns = dict[int, int]()
        self._round = 0
        self._bystanders = dict[int, Traveller]()
        self._headings, self._driven = np.zeros(len(homes)), np.zeros(len(homes))
        self._rank = dict.fromkeys(homes, 0)

    def step(self, state: ArenaState, troubles: Mapping[int, Trouble]) -> dict[int, Goal]:
        """Gives each robot's goal, relative to its pose in this arena state.

        Args:
            state: the newest arena state; time is its capture time.
            troubles: by tag, why robots cannot drive: see `hindered`.

        Returns:
            A goal for every robot.
        """
        now_ns = state.capture_ns
        if self._begun_ns is None:
            self._begun_ns = self._newest_ns = now_ns
        # A pause, or a tracker that is silent, takes nobody's time.
        self._spent_ns += min(now_ns - self._newest_ns, _MAX_STEP_NS)
        self._newest_ns = now_ns
        self._update_poses(state, now_ns)
        for robot in self.robots.values():
            self._update_trouble(robot, troubles.get(robot.tag, Trouble.NONE), now_ns)
        self._assign_homes(now_ns)
        self._check_limits(now_ns)
        if self.done:
            return dict.fromkeys(self.robots, STAY)
        traffic = self._traffic(now_ns)
        decision = decide(traffic, self._floor)
        self._headings, self._driven = decision.headings, decision.speeds
        self._find_stuck(decision, now_ns)
        return {
            robot.tag: self._goal(robot, row, traffic, decision)
            for row, robot in enumerate(self.robots.values())
        }

    @property
    def _all(self) -> list[Traveller]:
        """The robots, then whatever else bears a marker and stands in their way: tagged objects,
        robots that do not play."""
        return [*self.robots.values(), *self._bystanders.values()]

    @property
    def spent_s(self) -> float:
        """How long it has taken up to now, pauses left out."""
        return self._spent_ns / 1e9

    def rest(self) -> None:
        """The robots were stopped for a while: nobody is stuck."""
        self._driven[:] = 0.0
        for robot in self.robots.values():
            robot.since, robot.best_m = None, math.inf

    def arrivals(self) -> list[Arrival]:
        """How it stands with everybody."""
        return [
            Arrival(r.tag, r.name, r.home, r.left_m, abs(r.left_rad), self._why(r))
            for r in self.robots.values()
        ]

    def progress(self) -> str:
        """One line for people."""
        robots = self.robots.values()
        there = sum(robot.settled_ns is not None for robot in robots)
        hindered = [str(r.tag) for r in robots if r.trouble is not Trouble.NONE]
        without = f" (not {', '.join(hindered)})" if hindered else ""
        return f"{there}/{len(self.robots)} at their starts{without}"

    def _why(self, robot: Traveller) -> str:
        if robot.settled_ns is not None and robot.trouble in (Trouble.NONE, Trouble.BLOCKED):
            return ""
        return robot.trouble.value or Trouble.LATE.value

    def _update_poses(self, state: ArenaState, now_ns: int) -> None:
        rows = state.robots[state.robots["seen"]]
        columns = (rows[name].tolist() for name in ("tag", "x_m", "y_m", "yaw_rad"))
        for tag, x_m, y_m, yaw_rad in zip(*columns):
            pose = Pose(x_m, y_m, yaw_rad)
            robot = self.robots.get(tag) or self._bystanders.get(tag)
            if robot is None:
                robot = self._bystanders[tag] = Traveller(
                    tag, "", pose, pose, self._models.get(tag, EPUCK), given_up=True
                )
                self._headings, self._driven = (
                    np.append(done, 0.0) for done in (self._headings, self._driven)
                )
                self._assigned_for = None
            robot.observe(pose, now_ns)

    def _update_trouble(self, robot: Traveller, reported: Trouble, now_ns: int) -> None:
        """Takes the trouble that is reported of a robot, and reports a change of it."""
        if robot.given_up and robot.was_moved():
            self.news.append(f"{robot.label} was moved: it tries again")
            robot.given_up, robot.escapes, robot.trouble = False, 0, Trouble.NONE
        if robot.given_up:
            return
        trouble = robot.lasting(reported, now_ns)
        if trouble is Trouble.NONE and (robot.pose is None or now_ns - robot.seen_ns > LOST_NS):
            trouble = Trouble.UNSEEN
        stays_blocked = trouble is Trouble.NONE and robot.trouble is Trouble.BLOCKED
        if stays_blocked or trouble is robot.trouble:
            return
        before, robot.trouble = robot.trouble, trouble
        robot.since = None
        self._hindered_ns[robot.tag] = now_ns
        if trouble is Trouble.NONE:
            self.news.append(f"{robot.label} drives on: no longer '{before.value}'")
            robot.best_m = math.inf
        else:
            self.news.append(f"{robot.label} stands on the way home: {trouble.value}")
            robot.given_up = trouble is Trouble.TOO_OLD

    def _standing(self, now_ns: int, lasting: bool) -> frozenset[int]:
        """The robots that cannot drive; if `lasting` without those for which that is new."""
        first = now_ns == self._begun_ns
        return frozenset(
            robot.tag
            for robot in self.robots.values()
            if not robot.moves
            and (
                not lasting
                or first
                or robot.given_up
                or now_ns - self._hindered_ns.get(robot.tag, now_ns) > REASSIGN_NS
            )
        )

    def _assign_homes(self, now_ns: int) -> None:
        """Assigns homes, at first and whenever the set of robots that cannot drive has changed."""
        standing = self._standing(now_ns, lasting=True)
        if standing == self._assigned_for:
            return
        self._assigned_for = standing
        stand = {*standing, *self._bystanders}
        fixed = [r for r in self._all if r.tag in stand and r.pose is not None]
        places = {r.tag: r.pose for r in self.robots.values() if r.pose and r.tag not in standing}
        homes = {robot.tag: robot.own for robot in self.robots.values()}
        assigned = assign(places, homes, self._kinds, self._way_m(fixed))
        for tag, home in assigned.items():
            self.robots[tag].assign_home(home, now_ns)
        by_length = sorted(self.robots.values(), key=lambda r: -r.left_m)
        self._rank = {robot.tag: rank for rank, robot in enumerate(by_length)}

    def _way_m(self, fixed: list[Traveller]) -> Way:
        """The length of paths around walls; infinite to a home on which a robot stands."""
        taken = [(r.pose, r.radius_m + MIN_GAP_M) for r in fixed if r.pose is not None]
        # Only robots of one kind exchange places: who goes there is as large as whose home it is.
        radius_at = {robot.own: robot.radius_m for robot in self.robots.values()}
        lengths_m = dict[tuple[Pose, Pose], float]()

        def measure(place: Pose, home: Pose) -> float:
            radius_m = radius_at[home]
            if any(straight_m(home, other) < radius_m + room_m for other, room_m in taken):
                return math.inf
            if self._floor.is_open:
                return straight_m(place, home)
            if (place, home) not in lengths_m:
                way = self._floor.way(place[:2], home[:2], radius_m + WALL_GAP_M)
                points = [place[:2], *(way or [])]
                length_m = sum(map(math.dist, points, points[1:]))
                lengths_m[place, home] = length_m if way else math.inf
            return lengths_m[place, home]

        return measure

    def _check_limits(self, now_ns: int) -> None:
        """Gives up robots for which all others have waited longer than the limits."""
        over = self._spent_ns > self._limits.all_s * 1e9
        waiting = [r for r in self.robots.values() if not r.given_up and not r.is_home(now_ns)]
        driving = [r for r in waiting if r.trouble is Trouble.NONE]
        for robot in waiting:
            since_ns = self._hindered_ns.get(robot.tag, now_ns)
            lost = not driving and now_ns - since_ns > self._limits.hindered_s * 1e9
            if over or (robot.trouble is not Trouble.NONE and lost):
                self._give_up(robot, robot.trouble if robot.trouble.value else Trouble.LATE)
        self.done = all(r.given_up or r.is_home(now_ns) for r in self.robots.values())

    def _give_up(self, robot: Traveller, why: Trouble) -> None:
        robot.trouble, robot.given_up, robot.left_at = why, True, robot.pose
        far = "" if robot.pose is None else f", {robot.left_m:.2f} m from its start"
        self.news.append(f"{robot.label} is left where it is{far}: {why.value}")

    def _traffic(self, now_ns: int) -> Traffic:
        robots = self._all
        self._round += 1
        poses = np.array([r.pose or (1e3 + r.tag, 1e3, 0.0) for r in robots])
        discs = self._discs(now_ns)
        targets, speeds = poses[:, :2].copy(), np.zeros(len(robots))
        for row, robot in enumerate(robots):
            if robot.moves:
                targets[row], speeds[row] = self._target(robot, row, discs, now_ns)
        homes = np.array([r.home[:2] for r in robots])
        moves = np.array([r.moves for r in robots])
        ends = np.array([len(r.way) == 1 and not r.near for r in robots])
        order = sorted(range(len(robots)), key=lambda row: self._precedence(robots[row]))
        return Traffic(
            poses=poses,
            moves=moves,
            targets=targets,
            speeds=speeds,
            reach_m=np.where(ends, [min(r.left_m, 1e3) for r in robots], math.inf),
            order=order,
            apart_m=apart_m(robots, np.where(moves[:, np.newaxis], homes, poses[:, :2])),
            room_m=np.minimum(
                [robot.room_m for robot in robots], self._floor.clearance_m(homes) - 0.003
            ),
            headings=self._headings,
            driven=self._driven,
        )

    def _precedence(self, robot: Traveller) -> tuple[bool, int, int]:
        """The key of the order of decisions: waiting time, then length of path; home comes last."""
        return robot.near, -robot.priority, self._rank.get(robot.tag, 0)

    def _discs(self, now_ns: int, but: Traveller | None = None) -> Floats:
        """(k, 3) obstacles for paths: robots that cannot move; for robot `but` all that stand."""
        more_m = ROBOT_GAP_M + EXTRA_STANDING_M - WALL_GAP_M + 0.01
        rows = [
            (*r.pose[:2], r.radius_m + more_m)
            for r in self._all
            if r.pose is not None and r is not but and (not r.moves or (but and r.near))
        ]
        return np.array(rows, dtype=np.float64).reshape(-1, 3)

    def _target(
        self, robot: Traveller, row: int, discs: Floats, now_ns: int
    ) -> tuple[tuple[float, float], float]:
        """The next point that a robot drives to, and its speed."""
        assert robot.pose is not None
        here, home = robot.pose[:2], robot.home[:2]
        if now_ns < robot.escape_until_ns:
            away = robot.escape_rad
            return (here[0] + 0.2 * math.cos(away), here[1] + 0.2 * math.sin(away)), 0.06
        if robot.near:
            return home, YIELD_M_S
        slow = not robot.progresses(now_ns, NO_PROGRESS_NS)
        if slow:
            robot.priority += 1
            robot.best_ns = now_ns
        if slow or not robot.way or (self._round + row) % 10 == 0:
            self._plan(robot, self._discs(now_ns, robot) if slow else discs, slow, now_ns)
        if not robot.way:
            return here, YIELD_M_S
        while len(robot.way) > 1 and math.dist(here, robot.way[0]) < 0.08:
            robot.way.pop(0)
        last = len(robot.way) == 1
        return robot.way[0], braked_m_s(robot.left_m) if last else MAX_M_S

    def _plan(self, robot: Traveller, discs: Floats, replan: bool, now_ns: int) -> None:
        """Plans a path, unless the present one is clear."""
        assert robot.pose is not None
        here, home = robot.pose[:2], robot.home[:2]
        is_clear = partial(self._floor.is_clear, here, room_m=robot.room_m, discs=discs)
        if robot.way and not replan and is_clear(robot.way[0]):
            if len(robot.way) > 1 and is_clear(robot.way[1]):
                robot.way.pop(0)
            return
        way = self._floor.way(here, home, robot.room_m, discs)
        if way is None and replan:
            way = self._floor.way(here, home, robot.room_m, self._discs(now_ns))
        if way is None and robot.trouble is Trouble.NONE:
            robot.trouble = Trouble.BLOCKED
            self._hindered_ns[robot.tag] = now_ns
            self.news.append(f"{robot.label}: its way is blocked; it waits")
        elif way is not None and robot.trouble is Trouble.BLOCKED:
            robot.trouble = Trouble.NONE
            self.news.append(f"{robot.label}: its way is free again")
        robot.way = way or []

    def _find_stuck(self, decision: Decision, now_ns: int) -> None:
        """Finds robots that are commanded to drive and do not move."""
        for row, robot in enumerate(self.robots.values()):
            commanded = robot.moves and decision.speeds[row] > 0.03
            if not robot.stands_still(commanded, now_ns):
                continue
            robot.since, robot.escapes = None, robot.escapes + 1
            if robot.escapes > MAX_ESCAPES:
                self._give_up(robot, Trouble.STUCK)
                continue
            # A golden angle from one direction to the next.
            robot.escape_rad = float(decision.headings[row]) + 2.4 * robot.escapes
            robot.escape_until_ns = now_ns + ESCAPE_NS
            tries = f"try {robot.escapes} of {MAX_ESCAPES}"
            self.news.append(f"{robot.label} is stuck: {tries} to free it")

    def _goal(self, robot: Traveller, row: int, traffic: Traffic, decision: Decision) -> Goal:
        if not robot.moves or robot.pose is None:
            return STAY
        pose, speed = robot.pose, float(decision.speeds[row])
        if speed == 0.0:
            aim = robot.left_rad
            if not robot.near:
                away = traffic.targets[row] - pose[:2]
                aim = float(wrap_angle(math.atan2(away[1], away[0]) - pose.yaw_rad))
            return Goal(0, 0, round(aim * 1e4))
        x_m, y_m = traffic.targets[row]
        last = decision.wanted[row] and (x_m, y_m) == robot.home[:2] and not robot.near
        if not last or robot.left_m > carrot_m(MAX_M_S):
            heading, far_m = float(decision.headings[row]), max(carrot_m(speed), 0.007)
            x_m, y_m = pose.x_m + far_m * math.cos(heading), pose.y_m + far_m * math.sin(heading)
        ahead, left = in_frame(pose, x_m, y_m)
        return Goal(round(ahead * 1e3), round(left * 1e3))
