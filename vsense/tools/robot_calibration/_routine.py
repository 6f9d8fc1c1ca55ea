"""What one robot does to be calibrated: a generator that takes moments and gives wheel speeds.

It turns on the spot both ways, drives a short way forth and back, which shows roughly where its
marker sits, and then two longer ways forth and back in different directions. It waits for room
before each, and stands again in the end about where it stood.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import wrap_angle
from vsense.base.errors import VsenseError
from vsense.tools.robot_calibration._motion_fit import MotionFit, Stretch, fit
from vsense.tools.robot_calibration._places import STRAY_M, Area, FreeFloor, spot, way
from vsense.world.robot_models import EPUCK

Speeds = tuple[int, int]
"""Of the left and the right wheel [steps/s]."""

TURN_STEPS_S, TURN_S = 200, 8.0
"""A little more than a turn."""
WAY_STEPS_S = 250
PROBE_M, LEAVE_M = 0.08, 0.06
WAYS_M = (0.22, 0.18, 0.14, 0.10)
AIM_RAD, FAR_RAD, AIM_S = math.radians(4.0), math.radians(40.0), 0.1
ARM_M = 0.05
"""A turn counts as much as a way this far from the middle."""
LEAST_POSES, ENOUGH, TRIES = 8, 14, 3
"""Poses of a part of a drive, and of all of it; and how often it is tried."""
UNSTEADY = "its motors did not turn as commanded: see its log, and whether this computer is slow"
SETTLE_S = 0.6
"""After a command its robot may still do what it was told before."""
UNSEEN_S = 1.0
REACH_S = 15.0

_STILL: Speeds = (0, 0)

NO_ROOM_TO_DRIVE = (
    "has no room: it needs a free circle of {:.0f} cm, and a way of 10 cm beside it; move it, or"
    " others"
)


class RobotFailed(VsenseError):
    """A robot cannot be calibrated; the message says why, without its name."""


@dataclass(frozen=True, slots=True)
class Moment:
    """A robot in one timestep.

    Attributes:
        time_s: of the pictures.
        pose: its marker's x, y [m] and yaw [rad]; None: not seen in this timestep.
        motors: what its motors were told last, as its telemetry says [steps/s].
        connected: whether it answers.
        readings: what its own sensors measure, raw, by their names.
    """

    time_s: float
    pose: tuple[float, float, float] | None
    motors: Speeds
    connected: bool
    readings: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)


Acting = Generator[Speeds, Moment, None]


class MotionRoutine:
    """One robot's routine.

    Attributes:
        doing: what it does, in a word.
        stretches: what was measured so far.
        waits: whether it waits for room.
        needs: what it lacks then, for people.
        result: what was found, once `run` has ended.
    """

    def __init__(self, tag: int, floor: FreeFloor) -> None:
        self.tag = tag
        self.doing = "waiting"
        self.stretches: list[Stretch] = []
        self._model = model = floor.models[tag]
        self.waits = False
        self.needs = NO_ROOM_TO_DRIVE.format(100.0 * (model.radius_m + STRAY_M))
        self.result: MotionFit | None = None
        self._floor = floor
        self._moment = Moment(0.0, None, _STILL, False)
        self._seen_s = self._heard_s = -math.inf
        self._trim = 1.0

    def run(self) -> Acting:
        """The routine; RobotFailed, or BadFit of `fit`, where it cannot go on."""
        yield from self._look()
        if self._floor.is_crowded(self.tag):
            yield from self._leave()
        for sign in (1, -1):
            yield from self._turn(sign)
        yield from self._there_and_back((PROBE_M,), None)
        heading = yield from self._there_and_back(WAYS_M, None)
        yield from self._there_and_back(WAYS_M, heading)
        self.doing = "done"
        self.result = fit(self.stretches, self._model)

    def stop(self) -> None:
        """The robot stands, for whatever reason."""
        self._floor.take(self.tag)
        self.waits = False

    def see(self, moment: Moment) -> None:
        """Notes where the robot is.

        Raises:
            RobotFailed: it was not seen, or has not answered, for too long.
        """
        if moment.pose is not None:
            self._seen_s = moment.time_s
            self._floor.places[self.tag] = moment.pose[:2]
        if moment.connected:
            self._heard_s = moment.time_s
        begun = self.stretches or self.doing != "waiting"
        for since, words in ((self._seen_s, "was not seen"), (self._heard_s, "did not answer")):
            if begun and moment.time_s - since > UNSEEN_S:
                raise RobotFailed(f"{words} for {UNSEEN_S:g} s while it was {self.doing}")
        self._moment = moment

    @property
    def _place(self) -> tuple[float, float]:
        return self._floor.places[self.tag]

    def _step(self, speeds: Speeds) -> Generator[Speeds, Moment, Moment]:
        self.see((yield speeds))
        return self._moment

    def _look(self) -> Acting:
        """Waits until the robot is seen and answers."""
        begun_s: float | None = None
        while True:
            moment = yield from self._step(_STILL)
            begun_s = moment.time_s if begun_s is None else begun_s
            if moment.pose is not None and moment.connected:
                return
            if moment.time_s - begun_s > REACH_S:
                raise RobotFailed("does not answer" if moment.pose else "is not seen")

    def _room(self, choose: Callable[[], Area | None]) -> Generator[Speeds, Moment, Area]:
        """Stands until there is room, and takes it."""
        self._floor.take(self.tag)
        self.doing = "waiting"
        while True:
            area = choose()
            self.waits = area is None or not self._floor.is_free(self.tag, area)
            if area is not None and not self.waits:
                self._floor.give(self.tag, area)
                return area
            yield from self._step(_STILL)

    def _turn(self, sign: int) -> Acting:
        area = yield from self._room(lambda: spot(*self._place, self._model.radius_m))
        self.doing = "turning"
        speeds = (-sign * self._turning, sign * self._turning)
        for _ in range(TRIES):
            if (yield from self._measure(speeds, TURN_S, area)) >= ENOUGH:
                return
        raise RobotFailed(UNSTEADY)

    def _leave(self) -> Acting:
        """Drives away from who stands near, to turn without touching anybody."""
        chosen = 0.0

        def choose() -> Area | None:
            nonlocal chosen
            free_way = self._floor.longest_way(self.tag, (LEAVE_M,), self._yaw)
            chosen = 0.0 if free_way is None else free_way[0]
            if free_way is None:
                return None
            return way(*self._place, *free_way, self._model.radius_m)

        yield from self._room(choose)
        self.doing = "making room"
        yield from self._aim(chosen)
        until_s = self._moment.time_s + LEAVE_M / (WAY_STEPS_S * self._model.step_m)
        while self._moment.time_s < until_s:
            yield from self._step((WAY_STEPS_S, WAY_STEPS_S))
        yield from self._rest()

    def _there_and_back(
        self, lengths_m: tuple[float, ...], unlike_rad: float | None
    ) -> Generator[Speeds, Moment, float]:
        """Drives the longest free way forth and back; gives the heading."""
        for _ in range(TRIES):
            heading, enough = yield from self._way(lengths_m, unlike_rad)
            if enough:
                return heading
        raise RobotFailed(UNSTEADY)

    def _way(
        self, lengths_m: tuple[float, ...], unlike_rad: float | None
    ) -> Generator[Speeds, Moment, tuple[float, bool]]:
        """Drives a way once; gives its heading, and whether enough of it was seen."""
        marker_yaw = self._fit_roughly().marker.yaw_rad if self._has_driven else 0.0
        chosen: tuple[float, float] = (0.0, 0.0)

        def choose() -> Area | None:
            nonlocal chosen
            # The robot's own heading, as far as it is known.
            yaw = self._yaw - marker_yaw
            free_way = self._floor.longest_way(self.tag, lengths_m, yaw, unlike_rad)
            if free_way is None:
                return None
            chosen = free_way
            return way(*self._place, *free_way, self._model.radius_m)

        area = yield from self._room(choose)
        heading, length_m = chosen
        self.doing = "driving"
        yield from self._aim(heading + marker_yaw)
        left, right = self._straight()
        from_m, along = np.array(self._place), np.array([math.cos(heading), math.sin(heading)])
        duration_s = 2.0 * length_m / (WAY_STEPS_S * self._model.step_m)

        def gone_m() -> float:
            return float((np.array(self._place) - from_m) @ along)

        forth = yield from self._measure(
            (left, right), duration_s, area, lambda: gone_m() >= length_m
        )
        back = yield from self._measure((-left, -right), duration_s, area, lambda: gone_m() <= 0.0)
        return heading, min(forth, back) >= ENOUGH

    def _fit_roughly(self) -> MotionFit:
        return fit(self.stretches, self._model, True)

    @property
    def _turning(self) -> int:
        """Speed of the wheels on the spot: wider ones turn as fast as an e-puck [steps/s]."""
        turning = round(TURN_STEPS_S * self._model.axle_m / EPUCK.axle_m)
        return min(turning, self._model.max_steps_s)

    @property
    def _has_driven(self) -> bool:
        return any(not stretch.is_turn for stretch in self.stretches)

    @property
    def _yaw(self) -> float:
        pose = self._moment.pose
        if pose is None:
            raise RobotFailed("was not seen when it was to set out")
        return pose[2]

    def _straight(self) -> Speeds:
        """Wheel speeds that make it drive straight, as far as is known."""
        if not self._has_driven:
            return WAY_STEPS_S, WAY_STEPS_S
        # The first way was driven with equal speeds, of which its settings may have made others.
        first = next(stretch for stretch in self.stretches if not stretch.is_turn)
        fitted = self._fit_roughly()
        ratio = first.left_steps_s / (first.right_steps_s * fitted.wheel_ratio)
        share = (1.0 - ratio) / (1.0 + ratio)
        return round(WAY_STEPS_S * (1.0 + share)), round(WAY_STEPS_S * (1.0 - share))

    def _aim(self, yaw_rad: float) -> Acting:
        """Turns the marker's heading to an angle: fast at first, then by steps after each of which
        it is looked at."""
        limit_s = self._moment.time_s + REACH_S
        while True:
            off = float(wrap_angle(yaw_rad - self._yaw)) if self._moment.pose else math.inf
            if abs(off) < AIM_RAD:
                return
            if self._moment.time_s > limit_s:
                raise RobotFailed("does not turn as commanded: is it held?")
            if abs(off) > FAR_RAD:
                turn = 0 if math.isinf(off) else round(math.copysign(self._turning, off))
                yield from self._step((-turn, turn))
                continue
            turn = round(off * self._model.axle_m / (2.0 * self._model.step_m * AIM_S))
            turn = min(max(turn, -self._turning), self._turning)
            yield from self._step((-turn, turn))
            yield from self._rest()

    def _rest(self) -> Acting:
        until_s = self._moment.time_s + SETTLE_S
        while self._moment.time_s < until_s or self._moment.pose is None:
            yield from self._step(_STILL)

    def _measure(
        self,
        speeds: Speeds,
        duration_s: float,
        area: Area,
        there: Callable[[], bool] = lambda: False,
    ) -> Generator[Speeds, Moment, int]:
        """Drives at constant speeds for a while, or until it is there; keeps what was seen.

        Gives how many poses that were.
        """
        begun_s = self._moment.time_s
        seen: list[Moment] = []
        while self._moment.time_s < begun_s + duration_s and not there():
            moment = yield from self._step(speeds)
            if moment.pose is None:
                continue
            if area.strays(*moment.pose[:2]) > 1.5 * STRAY_M:
                raise RobotFailed("left the way that was free for it: is it held or pushed?")
            if moment.time_s >= begun_s + SETTLE_S:
                seen.append(moment)
        stretches = steady(seen)
        self.stretches += stretches
        yield from self._rest()
        return sum(len(stretch.times_s) for stretch in stretches)


def steady(seen: list[Moment]) -> list[Stretch]:
    """The parts of a drive in which the motors kept their speeds.

    They did not where their telemetry says so, nor where the robot was slower between two pictures
    than it mostly was: old readings make it stand for a moment.
    """
    if len(seen) < LEAST_POSES:
        return []
    motors = [moment.motors for moment in seen]
    usual = max(set(motors), key=motors.count)
    poses = np.array([moment.pose for moment in seen])
    times_s = np.array([moment.time_s for moment in seen])
    if usual == _STILL:
        return []
    rates = np.hypot(*np.diff(poses[:, :2], axis=0).T) / ARM_M
    rates = (rates + np.abs(wrap_angle(np.diff(poses[:, 2])))) / np.diff(times_s)
    usual_rate = float(np.median(rates))
    spread = 1.4826 * float(np.median(np.abs(rates - usual_rate)))
    even = np.abs(rates - usual_rate) <= max(5.0 * spread, 0.08 * usual_rate)
    obeyed = np.array([motors == usual for motors in motors])
    # A change of speed that falls between two pictures spoils the time beside it, too.
    steady = even & obeyed[1:] & obeyed[:-1]
    parts, begin = [], 0
    for end in (*np.flatnonzero(~steady).tolist(), len(steady)):
        if end + 1 - begin >= LEAST_POSES:
            rows = slice(begin, end + 1)
            parts.append(Stretch(times_s[rows], poses[rows], *map(float, usual)))
        begin = end + 1
    return parts
