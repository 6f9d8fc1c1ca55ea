"""What a robot does to have its own sensors calibrated, once its wheels and marker are known.

For proximity it drives to a spot before a wall, where it turns on the spot at some distances from
it; for ground to places on white and on black. From each it goes back to where it came from, so
that the next one finds room. Near a wall it creeps, and stands in every timestep in which it is not
seen.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from vsense.base.arena import Floats, Point, wrap_angle
from vsense.run.homing.floor import DrivingFloor
from vsense.tools.robot_calibration._commanding import GROUND, OWN_SENSORS, PROXIMITY, OwnReadings
from vsense.tools.robot_calibration._places import (
    AROUND_M,
    STRAY_M,
    Area,
    FreeFloor,
    GroundPlaces,
    WallSpot,
    alone_m,
    gaps_m,
    room_m,
    stage_m,
)
from vsense.tools.robot_calibration._routine import (
    WAY_STEPS_S,
    Acting,
    Moment,
    MotionRoutine,
    RobotFailed,
    Speeds,
)
from vsense.tools.robot_calibration._sensor_fit import (
    BadReadings,
    SensorFit,
    WallLook,
    fit_ground,
    fit_proximity,
)
from vsense.world.robot_models import EPUCK, RobotModel

TOLD_GROUND = 3
"""Ground sensors that a base tells of: left, centre and right."""
LEAST_GAP_M = 0.004
"""Nearer than this nobody turns."""
TRAVEL_STEPS_S, CREEP_STEPS_S, LOOK_STEPS_S = 500, 60, 120
REACHED_M, OFF_RAD = 0.005, math.radians(25.0)
CROWDED_M = 0.008
"""A robot stands where another body is so near ahead of it."""
ON_PLACE_S, ACTION_TIMEOUT_S = 2.0, 10.0
_LOOKS, _TRY_S = 3, 1.0
_STILL: Speeds = (0, 0)
_Pose = tuple[float, float, float]

NO_ROOM_TO_MEASURE = (
    "has no room to have its sensors measured: it needs a free way to a wall and back, nobody"
    " within {:.0f} cm there, and free ways to the places on white and black; move it, or others"
)


@dataclass(frozen=True, slots=True)
class Sensing:
    """What is measured of all robots' sensors, and where.

    Attributes:
        floor: on which ways are found.
        spots: before walls, by the models that have sensors to be measured there; None: not
            proximity.
        ground: white and black; None: not ground.
        readings: where they are told.
    """

    floor: DrivingFloor
    spots: Mapping[RobotModel, Sequence[WallSpot]] | None = None
    ground: GroundPlaces | None = None
    readings: OwnReadings = field(default_factory=OwnReadings)


def unmeasured(model: RobotModel, name: str) -> str:
    """Why a kind of sensors of a model cannot be measured; "": it can."""
    if name == GROUND:
        count = len(model.ground_m)
        words = f"a {model.name} has {count} ground sensors, and its base tells of 3 at most"
        return words if count > TOLD_GROUND else ""
    if not model.ring.places_m:
        return f"the model {model.name} has no proximity sensors of its own"
    if model.ring.stands_for:
        return (
            f"a {model.name} does not tell what each of its sensors reads, only what they read in"
            " an e-puck's places: proximity is not measured"
        )
    return ""


@dataclass(frozen=True, slots=True)
class _Goal:
    """Where a way ends, and which spot that is, if it is one."""

    place: Point
    heading_rad: float
    spot: WallSpot | None = None


class SensorRoutine(MotionRoutine):
    """One robot's routine; see `MotionRoutine`.

    Attributes:
        sensors: what was found of them, by name.
        troubles: what was not, and why, by name.
    """

    def __init__(self, tag: int, floor: FreeFloor, sensing: Sensing) -> None:
        super().__init__(tag, floor)
        self.sensors: dict[str, SensorFit] = {}
        self.troubles: dict[str, str] = {}
        self._sensing = sensing
        self._corners: list[Point] = []
        self._area: Area | None = None
        self._try_s = -math.inf
        self._shares = (1.0, 1.0)

    def run(self) -> Acting:
        """The routine; errors as in `MotionRoutine.run`."""
        yield from super().run()
        needed_m = alone_m(self._model) + self._model.radius_m + AROUND_M
        self.needs = NO_ROOM_TO_MEASURE.format(100.0 * needed_m)
        left, right = self._straight()
        self._shares = left / WAY_STEPS_S, right / WAY_STEPS_S
        for name in self.wanted:
            yield from (self._proximity() if name == PROXIMITY else self._ground())
        self.doing = "done"

    @property
    def wanted(self) -> tuple[str, ...]:
        """Which sensors are to be measured, by name."""
        sensing = self._sensing
        wanted = {PROXIMITY: sensing.spots is not None, GROUND: sensing.ground is not None}
        return tuple(name for name in OWN_SENSORS if wanted[name])

    def _proximity(self) -> Acting:
        looks: list[WallLook] = []

        def at_wall(goal: _Goal) -> Acting:
            assert goal.spot is not None
            for number, gap_m in enumerate(gaps_m(self._model)):
                yield from self._creep(goal.spot, self._model.radius_m + gap_m)
                looks.extend((yield from self._look_around(goal.spot, 1 - 2 * (number % 2))))
            yield from self._creep(goal.spot, stage_m(self._model), -1)

        try:
            yield from self._hear(PROXIMITY)
            yield from self._trip(self._spots, at_wall)
            self.sensors[PROXIMITY] = fit_proximity(looks, self._model)
        except BadReadings as error:
            self.troubles[PROXIMITY] = str(error)

    def _ground(self) -> Acting:
        places = self._sensing.ground
        assert places is not None
        read: dict[Point, list[Floats]] = {places.white: [], places.black: []}
        try:
            yield from self._hear(GROUND)
            for place, rows in read.items():
                yield from self._trip(
                    lambda place=place: self._around(place),  # type: ignore[misc]
                    lambda goal, rows=rows: self._stand(goal, rows),  # type: ignore[misc]
                )
            self.sensors[GROUND] = fit_ground(read[places.black], read[places.white])
        except BadReadings as error:
            self.troubles[GROUND] = str(error)

    def _hear(self, name: str) -> Acting:
        """Waits until the robot tells a sensor's readings; BadReadings where it has none."""
        if words := unmeasured(self._model, name):
            raise BadReadings(words)
        until_s = self._moment.time_s + ON_PLACE_S
        while name not in self._moment.readings:
            if self._moment.time_s > until_s:
                raise BadReadings(
                    f"it reports no {name} readings: has it such sensors, does its base setting"
                    " name them, and is its controller 'calibrate' as new as this computer?"
                )
            yield from self._step(_STILL)

    # Where to, and back.

    def _trip(
        self, goals: Callable[[], Iterator[_Goal]], there: Callable[[_Goal], Acting]
    ) -> Acting:
        """Drives to a goal, does something there, and drives back."""
        chosen: list[_Goal] = []

        def choose() -> Area | None:
            # Ways are searched now and then: robots that wait do not need one in every timestep.
            if self._moment.time_s < self._try_s:
                return None
            self._try_s = self._moment.time_s + _TRY_S
            choice = self._choose(goals())
            chosen[:] = [] if choice is None else [choice[0]]
            return None if choice is None else choice[1]

        home = self._place
        area = yield from self._room(choose)
        (goal,) = chosen
        self._area = area
        if goal.spot is not None:
            near = np.concatenate([area.points, [goal.spot.before(self._model.radius_m)]])
            self._floor.give(self.tag, Area(near, alone_m(self._model)))
        self.doing = "driving to a wall" if goal.spot is not None else "driving over the floor"
        for point in self._corners:
            yield from self._drive(point)
        yield from self._turn_to(goal.heading_rad)
        yield from there(goal)
        self.doing = "driving back"
        for point in (*self._corners[-2::-1], home):
            yield from self._drive(point)
        self._floor.take(self.tag)

    def _choose(self, goals: Iterator[_Goal]) -> tuple[_Goal, Area] | None:
        """The first of some goals to which there is a free way."""
        discs, here = self._floor.discs(self.tag), self._place
        for goal, _ in zip(goals, range(_LOOKS)):
            way = self._sensing.floor.way(here, goal.place, room_m(self._model), discs)
            if way is None:
                continue
            area = Area(_along([here, *way]), self._model.radius_m + STRAY_M)
            if self._floor.is_free(self.tag, area):
                self._corners = way
                return goal, area
        return None

    def _spots(self) -> Iterator[_Goal]:
        """Spots before walls that nobody is near, the nearest first."""
        here, model = self._place, self._model
        stages = [
            (spot.before(stage_m(model)), spot) for spot in (self._sensing.spots or {})[model]
        ]
        for stage, spot in sorted(stages, key=lambda each: math.dist(here, each[0])):
            if self._floor.is_alone(self.tag, spot.before(model.radius_m), alone_m(model)):
                yield _Goal(stage, spot.heading_rad, spot)

    def _around(self, place: Point) -> Iterator[_Goal]:
        """Poses in which the ground sensors are over a place."""
        ahead_m = float(np.mean(self._model.ground_m, axis=0)[0])
        first = math.atan2(place[1] - self._place[1], place[0] - self._place[0])
        for turn in range(8):
            heading = first + turn * math.pi / 4.0
            at = (
                place[0] - ahead_m * math.cos(heading),
                place[1] - ahead_m * math.sin(heading),
            )
            if self._sensing.floor.clearance_m(np.array(at)) >= room_m(self._model):
                yield _Goal(at, heading)

    # How it moves.

    def _body(self, pose: _Pose) -> _Pose:
        """The axle's middle and the robot's heading, of a marker's pose."""
        assert self.result is not None
        marker = self.result.marker
        yaw = pose[2] - marker.yaw_rad
        cos, sin = math.cos(yaw), math.sin(yaw)
        x_m = pose[0] - cos * marker.x_m + sin * marker.y_m
        return x_m, pose[1] - sin * marker.x_m - cos * marker.y_m, yaw

    def _straight_speeds(self, ahead: float, turn: float = 0.0) -> Speeds:
        """Wheel speeds that drive straight, as its wheels are, and turn to the left."""
        left, right = self._shares
        return round((ahead - turn) * left), round((ahead + turn) * right)

    def _turn_to(self, heading_rad: float) -> Acting:
        assert self.result is not None
        while self._moment.pose is None:
            yield from self._step(_STILL)
        yield from self._aim(heading_rad + self.result.marker.yaw_rad)

    def _seen(
        self, ahead_rad: float | None
    ) -> Generator[Speeds, Moment, tuple[float, float, float]]:
        """Stands until it is seen, and nobody is near ahead of it; gives where its body is.

        `ahead_rad` is where it moves to; None: it turns on the spot, and nobody may be near.
        """
        until_s = self._moment.time_s + ACTION_TIMEOUT_S
        while self._moment.pose is None or self._floor.is_blocked(self.tag, CROWDED_M, ahead_rad):
            if self._moment.time_s > until_s:
                raise RobotFailed("was in the way of another one, or another one in its, for 10 s")
            yield from self._step(_STILL)
        return self._body(self._moment.pose)

    def _check_area(self) -> None:
        if self._area is not None and self._area.strays(*self._place) > 1.5 * STRAY_M:
            raise RobotFailed("left the way that was free for it: is it held or pushed?")

    def _drive(self, to: Point) -> Acting:
        yield from self._turn_to(math.atan2(to[1] - self._place[1], to[0] - self._place[0]))
        until_s = self._moment.time_s + ACTION_TIMEOUT_S
        step_m, axle_m = self._model.step_m, self._model.axle_m
        until_s += 3.0 * math.dist(self._place, to) / (WAY_STEPS_S * step_m)
        heading: float | None = None
        while True:
            x_m, y_m, yaw = yield from self._seen(heading)
            away_m, heading = math.hypot(to[0] - x_m, to[1] - y_m), yaw
            off = float(wrap_angle(math.atan2(to[1] - y_m, to[0] - x_m) - yaw))
            if away_m < REACHED_M or (away_m < 4.0 * REACHED_M and abs(off) > math.pi / 3.0):
                break
            if self._moment.time_s > until_s:
                raise RobotFailed("does not get on: is it held?")
            self._check_area()
            if abs(off) > OFF_RAD:
                yield from self._rest()
                yield from self._turn_to(yaw + off)
                continue
            speed = min(TRAVEL_STEPS_S, max(CREEP_STEPS_S, 1.5 * away_m / step_m))
            yield from self._step(self._straight_speeds(speed, off * axle_m / (2.0 * step_m)))
        yield from self._rest()

    def _creep(self, spot: WallSpot, wall_m: float, sign: int = 1) -> Acting:
        """Creeps towards a wall, or for -1 back from it, until it is so far away."""
        yield from self._turn_to(spot.heading_rad)
        self.doing = "before a wall"
        step_m, axle_m = self._model.step_m, self._model.axle_m
        until_s = self._moment.time_s + ACTION_TIMEOUT_S
        until_s += stage_m(self._model) / (CREEP_STEPS_S * step_m)
        back_rad = 0.0 if sign > 0 else math.pi
        while True:
            x_m, y_m, yaw = yield from self._seen(spot.heading_rad + back_rad)
            if sign * (spot.distance_m(x_m, y_m) - wall_m) <= 0.0:
                break
            if self._moment.time_s > until_s:
                raise RobotFailed("does not get on before a wall: is it held, does it touch it?")
            off = float(wrap_angle(spot.heading_rad - yaw))
            yield from self._step(
                self._straight_speeds(sign * CREEP_STEPS_S, off * axle_m / (2.0 * step_m))
            )
        yield from self._rest()

    def _look_around(self, spot: WallSpot, sign: int) -> Generator[Speeds, Moment, list[WallLook]]:
        """Turns once on the spot, to the left for 1; gives what its sensors read."""
        looks: list[WallLook] = []
        turned, before = 0.0, None
        until_s = self._moment.time_s + ACTION_TIMEOUT_S
        looking = round(LOOK_STEPS_S * self._model.axle_m / EPUCK.axle_m)
        until_s += 3.0 * math.pi * self._model.axle_m / (looking * self._model.step_m)
        while turned < 2.0 * math.pi + OFF_RAD:
            x_m, y_m, yaw = yield from self._seen(None)
            away_m = spot.distance_m(x_m, y_m)
            if away_m < self._model.radius_m + LEAST_GAP_M:
                raise RobotFailed("came too near to a wall to turn there")
            if self._moment.time_s > until_s:
                raise RobotFailed("does not turn before a wall: is it held, does it touch it?")
            if PROXIMITY in self._moment.readings:
                facing = float(wrap_angle(yaw - spot.heading_rad))
                looks.append(WallLook(away_m, facing, self._moment.readings[PROXIMITY]))
            turned += 0.0 if before is None else sign * float(wrap_angle(yaw - before))
            before = yaw
            yield from self._step(self._straight_speeds(0.0, sign * looking))
        yield from self._rest()
        return looks

    def _stand(self, goal: _Goal, rows: list[Floats]) -> Acting:
        yield from self._rest()
        until_s = self._moment.time_s + ON_PLACE_S
        while self._moment.time_s < until_s:
            yield from self._step(_STILL)
            if GROUND in self._moment.readings:
                rows.append(self._moment.readings[GROUND])


def _along(points: Sequence[Point]) -> Floats:
    """Points 1 cm apart along a way of straight parts."""
    parts = [
        np.linspace(a, b, max(2, int(math.dist(a, b) / 0.01) + 1)) for a, b in pairwise(points)
    ]
    return np.concatenate(parts)
