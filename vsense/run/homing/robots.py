"""What is known of one robot on its way home: where it is, and what hinders it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum

from vsense.base.arena import wrap_angle
from vsense.config.specs import Pose

NEAR_M, FAR_M = 0.008, 0.015
"""Who is nearer to its home than the first turns to its heading, until it is farther than the
second."""
HOME_M, HOME_RAD = 0.02, math.radians(6.0)
"""Who stands so near to its home, and so straight, is there ..."""
SETTLED_NS = 500_000_000
"""... once it has for so long."""

STILL_M, STILL_RAD = 0.008, 0.12
"""Who moves less than this ..."""
STILL_NS = 2_500_000_000
"""... in so long, although told to drive, is stuck."""
HELD_NS = 2_000_000_000
"""A base that lets nothing drive for so long is in trouble."""
FREED_M = 0.03
"""Who was given up and is found so far from there tries again: somebody has helped."""


class Trouble(str, Enum):
    """Why a robot does not drive; the words that people read."""

    NONE = ""
    NO_LINK = "no link"
    HELD = "its base or battery does not let it drive"
    TOO_OLD = "cannot drive home: deploy"
    UNSEEN = "not seen"
    STUCK = "stuck"
    BLOCKED = "blocked"
    LATE = "not there in time"


@dataclass(frozen=True, slots=True)
class HomingLimits:
    """How long robots are waited for.

    Attributes:
        all_s: of all of it; then whoever is on its way is left where it is.
        hindered_s: for who is not seen, or has no link, when all others are home.
    """

    all_s: float = 90.0
    hindered_s: float = 10.0


LIMITS = HomingLimits()


@dataclass(frozen=True, slots=True)
class Arrival:
    """How it ended for one robot: `trouble` is "" for who is at `home`."""

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
        pose: where it was seen last; None: it never was.
        seen_ns: when.
        trouble: why it does not drive now; NONE: it drives, or is there.
        given_up: it is left where it is, at `left_at`.
        near: it turns on the spot, at its home.
        settled_ns: since when it stands as it shall.
        way: the corners that are still to come, home at the end.
        tries: how often it was freed from where it was stuck.
        free_until_ns: until then it drives away from where it is stuck.
        since: when it began to be watched for motion, and where that was.
        best_m, best_ns: how near it has come to its home, and when.
        held_ns: since when its daemon says that it cannot drive.
        pushed: how often it was given right of way because it did not get on.
    """

    tag: int
    name: str
    home: Pose
    own: Pose
    pose: Pose | None = None
    seen_ns: int = 0
    trouble: Trouble = Trouble.NONE
    given_up: bool = False
    left_at: Pose | None = None
    near: bool = False
    settled_ns: int | None = None
    way: list[tuple[float, float]] = field(default_factory=list)
    tries: int = 0
    free_until_ns: int = 0
    free_rad: float = 0.0
    since: tuple[int, Pose] | None = None
    best_m: float = math.inf
    best_ns: int = 0
    pushed: int = 0
    held_ns: int | None = None

    @property
    def label(self) -> str:
        """The robot for people."""
        return f"robot {self.tag} ({self.name})"

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
        return self.settled_ns is not None and now_ns - self.settled_ns >= SETTLED_NS

    def lasting(self, told: Trouble, now_ns: int) -> Trouble:
        """What it is told to suffer from; a base that is silent for a moment counts as nothing."""
        if told is not Trouble.HELD:
            self.held_ns = None
            return told
        self.held_ns = self.held_ns or now_ns
        return told if now_ns - self.held_ns > HELD_NS else Trouble.NONE

    def was_freed(self) -> bool:
        """Whether somebody has moved it since it was given up."""
        if self.pose is None or self.left_at is None or self.trouble is not Trouble.STUCK:
            return False
        away = self.pose.x_m - self.left_at.x_m, self.pose.y_m - self.left_at.y_m
        return math.hypot(*away) > FREED_M

    def look(self, pose: Pose, now_ns: int) -> None:
        """It is seen."""
        self.pose, self.seen_ns = pose, now_ns
        self.near = self.left_m < (FAR_M if self.near else NEAR_M)
        if self.left_m > HOME_M or abs(self.left_rad) > HOME_RAD:
            self.settled_ns = None
        elif self.settled_ns is None:
            self.settled_ns = now_ns

    def send(self, home: Pose, now_ns: int) -> None:
        """Gives it another home."""
        if home == self.home:
            self.best_ns = self.best_ns or now_ns
            return
        self.home, self.way = home, []
        self.near, self.settled_ns = False, None
        self.best_m, self.best_ns = math.inf, now_ns

    def stands_still(self, told: bool, now_ns: int) -> bool:
        """Whether it has not moved for long although `told` to drive all the time."""
        if not told or self.pose is None:
            self.since = None
            return False
        if self.since is None:
            self.since = now_ns, self.pose
            return False
        began_ns, there = self.since
        moved_m = math.hypot(self.pose.x_m - there.x_m, self.pose.y_m - there.y_m)
        turned = abs(float(wrap_angle(self.pose.yaw_rad - there.yaw_rad)))
        if moved_m > STILL_M or turned > STILL_RAD:
            self.since = now_ns, self.pose
            return False
        return now_ns - began_ns > STILL_NS

    def gets_on(self, now_ns: int, patience_ns: int) -> bool:
        """Whether it has come nearer to its home within this time."""
        if self.left_m < self.best_m - 0.03 or self.near:
            self.best_m, self.best_ns = self.left_m, now_ns
        return now_ns - self.best_ns < patience_ns
