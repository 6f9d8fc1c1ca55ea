"""The state of one robot on its way home: pose, home, path and trouble."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import wrap_angle
from vsense.config.specs import Pose
from vsense.world.robot_models import EPUCK, RobotModel

TURN_M, DRIVE_M = 0.008, 0.015
"""A robot turns to its heading within the first distance from its home, and drives again beyond
the second."""
TOLERANCE_M, TOLERANCE_RAD = 0.02, math.radians(6.0)
"""Tolerance of a home."""
SETTLING_NS = 500_000_000
"""Settling time: a robot is home after so long within tolerance."""

STUCK_M, STUCK_RAD = 0.008, 0.12
"""A robot that moves less than this ..."""
STUCK_NS = 2_500_000_000
"""... in so long, while it is commanded to drive, is stuck."""
HELD_NS = 2_000_000_000
"""A base that reports for so long that it cannot drive counts as held."""
HAND_MOVE_M = 0.03
"""A robot that was given up and is moved farther than this by hand drives again."""


class Trouble(str, Enum):
    """Why a robot does not drive; the words that people read."""

    NONE = ""
    NO_LINK = "no link"
    HELD = "its base or battery does not let it drive"
    TOO_OLD = "cannot drive home: deploy"
    UNSEEN = "not seen"
    NEAR = "too near to what it keeps off"
    STUCK = "stuck"
    BLOCKED = "blocked"
    LATE = "not there in time"


@dataclass(frozen=True, slots=True)
class HomingLimits:
    """Time limits.

    Attributes:
        all_s: for all robots; those still on their way are left where they are.
        hindered_s: for robots that are not seen, or have no link, once all others are home.
    """

    all_s: float = 90.0
    hindered_s: float = 10.0


LIMITS = HomingLimits()

ROBOT_GAP_M = 0.018
"""Between the bodies of two robots; less where their homes are nearer to each other."""
MIN_GAP_M = 0.003
"""The least distance of two bodies."""
EXTRA_STANDING_M, EXTRA_UNSEEN_M = 0.01, 0.03
"""Added to the distance from robots that cannot move, and from those that are not seen."""
WALL_GAP_M = 0.012
"""Between a robot's body and walls; less where its home is nearer."""


@dataclass(frozen=True, slots=True)
class Arrival:
    """How it ended for one robot; `trouble` is "" where it is at `home`."""

    tag: int
    name: str
    home: Pose
    left_m: float
    left_rad: float
    trouble: str


@dataclass(slots=True)
class Traveller:
    """One robot on its way home.

    Attributes:
        home: where it is to stand.
        own: where it would stand without any exchange.
        model: what kind of robot it is.
        pose: where it was seen last; None: it never was.
        seen_ns: when.
        trouble: why it does not drive now; NONE: it drives, or is there.
        given_up: it is left where it is, at `left_at`.
        near: it turns on the spot, at its home.
        settled_ns: since when it stands as it shall.
        way: the corners that are still to come, home at the end.
        escapes: how often it has driven away from where it was stuck.
        escape_until_ns: until then it drives away from where it is stuck.
        since: when it began to be watched for motion, and where that was.
        best_m, best_ns: how near it has come to its home, and when.
        held_ns: since when its daemon says that it cannot drive.
        priority: how often it was given priority because it made no progress.
    """

    tag: int
    name: str
    home: Pose
    own: Pose
    model: RobotModel = EPUCK
    pose: Pose | None = None
    seen_ns: int = 0
    trouble: Trouble = Trouble.NONE
    given_up: bool = False
    left_at: Pose | None = None
    near: bool = False
    settled_ns: int | None = None
    way: list[tuple[float, float]] = field(default_factory=list)
    escapes: int = 0
    escape_until_ns: int = 0
    escape_rad: float = 0.0
    since: tuple[int, Pose] | None = None
    best_m: float = math.inf
    best_ns: int = 0
    priority: int = 0
    held_ns: int | None = None

    @property
    def label(self) -> str:
        """The robot for people."""
        return f"robot {self.tag}"

    @property
    def radius_m(self) -> float:
        """How large its body is."""
        return self.model.radius_m

    @property
    def room_m(self) -> float:
        """How far its middle keeps from walls."""
        return self.radius_m + WALL_GAP_M

    @property
    def left_m(self) -> float:
        """How far it is from its home; infinite where nobody knows."""
        if self.pose is None:
            return math.inf
        return math.hypot(self.home.x_m - self.pose.x_m, self.home.y_m - self.pose.y_m)

    @property
    def left_rad(self) -> float:
        """By how much it must turn to stand as its home says."""
        if self.pose is None:
            return math.inf
        return float(wrap_angle(self.home.yaw_rad - self.pose.yaw_rad))

    @property
    def moves(self) -> bool:
        """Whether it can be told to drive."""
        free = self.trouble in (Trouble.NONE, Trouble.BLOCKED)
        return self.pose is not None and not self.given_up and free

    def is_home(self, now_ns: int) -> bool:
        """Whether it stands at its home for good."""
        return self.settled_ns is not None and now_ns - self.settled_ns >= SETTLING_NS

    def lasting(self, reported: Trouble, now_ns: int) -> Trouble:
        """The reported trouble; a base that is held for less than `HELD_NS` has none."""
        if reported is not Trouble.HELD:
            self.held_ns = None
            return reported
        self.held_ns = self.held_ns or now_ns
        return reported if now_ns - self.held_ns > HELD_NS else Trouble.NONE

    def was_moved(self) -> bool:
        """Whether somebody has moved it since it was given up."""
        if self.pose is None or self.left_at is None or self.trouble is not Trouble.STUCK:
            return False
        away = self.pose.x_m - self.left_at.x_m, self.pose.y_m - self.left_at.y_m
        return math.hypot(*away) > HAND_MOVE_M

    def observe(self, pose: Pose, now_ns: int) -> None:
        """Takes a pose in which it was seen."""
        self.pose, self.seen_ns = pose, now_ns
        self.near = self.left_m < (DRIVE_M if self.near else TURN_M)
        if self.left_m > TOLERANCE_M or abs(self.left_rad) > TOLERANCE_RAD:
            self.settled_ns = None
        elif self.settled_ns is None:
            self.settled_ns = now_ns

    def assign_home(self, home: Pose, now_ns: int) -> None:
        """Gives it another home."""
        if home == self.home:
            self.best_ns = self.best_ns or now_ns
            return
        self.home, self.way = home, []
        self.near, self.settled_ns = False, None
        self.best_m, self.best_ns = math.inf, now_ns

    def stands_still(self, commanded: bool, now_ns: int) -> bool:
        """Whether it has not moved for `STUCK_NS` while it was `commanded` to drive."""
        if not commanded or self.pose is None:
            self.since = None
            return False
        if self.since is None:
            self.since = now_ns, self.pose
            return False
        began_ns, there = self.since
        moved_m = math.hypot(self.pose.x_m - there.x_m, self.pose.y_m - there.y_m)
        turned = abs(float(wrap_angle(self.pose.yaw_rad - there.yaw_rad)))
        if moved_m > STUCK_M or turned > STUCK_RAD:
            self.since = now_ns, self.pose
            return False
        return now_ns - began_ns > STUCK_NS

    def progresses(self, now_ns: int, most_ns: int) -> bool:
        """Whether it has come nearer to its home within this time."""
        if self.left_m < self.best_m - 0.03 or self.near:
            self.best_m, self.best_ns = self.left_m, now_ns
        return now_ns - self.best_ns < most_ns


def apart_m(robots: Sequence[Traveller], ends: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, n) distances of centres; `ends` (n, 2) is where each is going to stand."""
    away = ends[:, np.newaxis] - ends[np.newaxis]
    between = np.hypot(away[..., 0], away[..., 1]) - 0.004
    np.fill_diagonal(between, math.inf)
    more = [
        0.0 if r.moves else EXTRA_UNSEEN_M if r.trouble is Trouble.UNSEEN else EXTRA_STANDING_M
        for r in robots
    ]
    radii = np.array([robot.radius_m for robot in robots])
    touching = radii[:, np.newaxis] + radii
    wanted = (touching + ROBOT_GAP_M) + np.maximum(*np.meshgrid(more, more))
    return np.asarray(np.maximum(np.minimum(wanted, between), touching + MIN_GAP_M))
