"""What a robot's own sensors read, by least squares on readings at places that the cameras saw.

Proximity. The robot turned on the spot at some distances from a wall. When sensor i looked straight
at it from d metres away it read

    raw = n_i + g_i (T(d + e) - T(inf))

n_i: what it reads with nothing near; g_i: how much of what comes back it sees; T: the response of
the nominal sensor, the table of the robot's model; e: by how much the wall is farther away than the
experiment says, common to all sensors. Between 5 and 15 mm an e-puck's reading changes by 12 % per
mm, which is why places have to be measured, and one distance is not enough. Sensors that look away
from the wall see nothing.

Ground. What the sensors read on white and on black.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vsense.base.arena import Floats, wrap_angle
from vsense.base.errors import VsenseError
from vsense.world.robot_models import RobotModel

STRAIGHT_RAD = math.radians(12.0)
"""A sensor that looks at the wall less straight than this is not compared with the table."""
AWAY_RAD = math.radians(110.0)
"""A sensor that looks so far away from it sees nothing of the wall."""
SATURATED_RAW = 4000.0
RESPONSE_RANGE = 4.5
"""Beyond so many times `wall_m` the response is next to nothing."""

LEAST_READINGS = 6
"""Readings of a sensor that looked at the wall, and of one that looked away."""
SPAN_MIN, MOST_RAW = 16, 4096
"""As vsensed has it: a sensor that tells no more than this apart, or reads more, is broken."""
MOST_ERROR_M = 0.006
"""Of the wall's place; it is looked for much farther away, as far out gains look like distances."""
MOST_REST = 0.15
"""What may be left over, of the span."""

_NOISE_RAW = 10.0
_NOISE_SHARE = 0.06
"""Half a millimetre of what is seen: a reading's 12 % per mm."""
_REACH_M, _PARTS = 0.020, 201


class BadReadings(VsenseError):
    """What a sensor read cannot be; the message says which one and what."""


@dataclass(frozen=True, slots=True)
class WallLook:
    """One moment: where the robot was, and what its sensors read.

    Attributes:
        wall_m: distance of the axle's middle from the wall.
        turn_rad: the robot's heading from the direction of the wall, counter-clockwise.
        raw: (k) readings of its sensors.
    """

    wall_m: float
    turn_rad: float
    raw: Floats


@dataclass(frozen=True, slots=True)
class SensorFit:
    """What was found of one kind of sensors.

    Attributes:
        spans: (n, 2) raw readings: nothing and wall, or black and white.
        sigmas: (n, 2) their standard deviations.
        rest: what is left over, of the span (rms of the worst sensor).
        error_m: by how much the wall is farther away than was taken; 0 for ground.
        readings: how many it was found from.
    """

    spans: Floats
    sigmas: Floats
    rest: float
    error_m: float
    readings: int


def wall_m(model: RobotModel) -> float:
    """Where the upper end of a model's span is read, see `RingModel.span`."""
    return model.ring.span[0]


def response(distances_m: Floats, model: RobotModel) -> Floats:
    """What a nominal proximity sensor of a model reads more than with nothing near."""
    ring = model.ring
    return np.asarray(np.interp(distances_m, ring.table_m, ring.table_raw) - ring.table_raw[-1])


def sensor_distances(looks: Sequence[WallLook], model: RobotModel) -> tuple[Floats, Floats]:
    """How far each sensor is from the wall along its own direction [m], and how far it looks away
    from the wall's [rad]; (n, k) each."""
    places_m = np.array(model.ring.places_m)
    turns = np.array([look.turn_rad for look in looks])[:, None]
    cos, sin = np.cos(turns), np.sin(turns)
    toward = cos * places_m[:, 0] - sin * places_m[:, 1]
    away = np.abs(wrap_angle(turns + model.ring.headings_rad))
    walls = np.array([look.wall_m for look in looks])[:, None]
    return np.asarray((walls - toward) / np.maximum(np.cos(away), 0.1)), away


def fit_proximity(looks: Sequence[WallLook], model: RobotModel) -> SensorFit:
    """Finds the spans of a model's sensors.

    Raises:
        BadReadings: too little was seen, or it is not what a wall reflects.
    """
    count = len(model.ring.places_m)
    raw = np.array([look.raw[:count] for look in looks]).reshape(-1, count)
    if not len(raw):
        raise BadReadings("its proximity readings did not come")
    distances, away = sensor_distances(looks, model)
    sensors = [_Sensor.of(i, model, distances[:, i], away[:, i], raw[:, i]) for i in range(count)]
    errors = np.linspace(-_REACH_M, _REACH_M, _PARTS)
    costs = [sum(sensor.solve(error)[2] for sensor in sensors) for error in errors]
    best = int(np.argmin(costs))
    error = _vertex(errors, costs, min(max(best, 1), len(errors) - 2))
    if abs(error) > MOST_ERROR_M:
        raise BadReadings(
            f"the wall seems to stand {1000 * error:+.0f} mm from where the experiment has it,"
            f" at most {1000 * MOST_ERROR_M:g} are corrected: measure it, or"
            " 'vsense camera arena align'"
        )
    return _result([sensor.named(error) for sensor in sensors], error, raw.size)


def _vertex(errors: Floats, costs: Sequence[float], best: int) -> float:
    """Where the parabola through the least cost and its neighbours is lowest."""
    before, least, after = costs[best - 1 : best + 2]
    bend = before - 2.0 * least + after
    shift = 0.0 if bend <= 0.0 else 0.5 * (before - after) / bend
    return float(errors[best] + shift * (errors[1] - errors[0]))


def _result(fits: Sequence[tuple[Floats, Floats, float]], error: float, count: int) -> SensorFit:
    spans, sigmas = (np.array([fit[part] for fit in fits]) for part in (0, 1))
    return SensorFit(spans, sigmas, max(fit[2] for fit in fits), error, count)


@dataclass(frozen=True, slots=True)
class _Sensor:
    """One sensor's readings: of nothing, and of the wall at distances."""

    number: int
    model: RobotModel
    nothing: Floats
    distances_m: Floats
    raw: Floats

    @classmethod
    def of(
        cls, number: int, model: RobotModel, distances_m: Floats, away_rad: Floats, raw: Floats
    ) -> _Sensor:
        wall = (away_rad < STRAIGHT_RAD) & (raw < SATURATED_RAW)
        wall &= distances_m < RESPONSE_RANGE * wall_m(model)
        nothing = raw[away_rad > AWAY_RAD]
        if min(int(wall.sum()), len(nothing)) < LEAST_READINGS:
            raise BadReadings(f"ps{number} was not seen long enough, looking at the wall and away")
        return cls(number, model, nothing, distances_m[wall], raw[wall])

    def solve(self, error_m: float) -> tuple[Floats, Floats, float]:
        """Nothing and gain, their covariance (2, 2), and the cost, for a wall so far off."""
        at = self.distances_m + error_m
        # Not those of the response at `at`: costs of different errors could not be compared.
        excess = self.raw - np.median(self.nothing)
        weights = 1.0 / np.hypot(_NOISE_RAW, _NOISE_SHARE * excess)
        rows = np.stack([np.ones_like(at), response(at, self.model)], axis=1) * weights[:, None]
        rest = np.stack([np.ones_like(self.nothing), np.zeros_like(self.nothing)], axis=1)
        design = np.concatenate([rows, rest / _NOISE_RAW])
        wanted = np.concatenate([self.raw * weights, self.nothing / _NOISE_RAW])
        normal = design.T @ design + 1e-12 * np.eye(2)
        solution = np.linalg.solve(normal, design.T @ wanted)
        cost = float(((design @ solution - wanted) ** 2).sum())
        return solution, np.linalg.inv(normal) * max(1.0, cost / len(wanted)), cost

    def named(self, error_m: float) -> tuple[Floats, Floats, float]:
        """Its span, standard deviations, and what is left over; BadReadings where it cannot be."""
        (nothing, gain), covariance, _ = self.solve(error_m)
        full = float(response(np.array([wall_m(self.model)]), self.model)[0])
        width = gain * full
        if width < SPAN_MIN or nothing + width > MOST_RAW:
            raise BadReadings(
                f"ps{self.number} reads {nothing:.0f} of nothing and {nothing + width:.0f} of a"
                f" wall {100 * wall_m(self.model):g} cm ahead: it is broken or covered, or there"
                " is no wall"
            )
        off = self.raw - nothing - gain * response(self.distances_m + error_m, self.model)
        rest = math.sqrt(float((off**2).mean())) / width
        if rest > MOST_REST:
            raise BadReadings(
                f"ps{self.number} does not read what a wall reflects: {100 * rest:.0f} % of it are"
                f" left over, at most {100 * MOST_REST:g} fit; is the wall white, and smooth?"
            )
        along = np.array([[1.0, 0.0], [1.0, full]])
        sigmas = np.sqrt(np.diag(along @ covariance @ along.T))
        return np.array([nothing, nothing + width]), sigmas, rest


def fit_ground(black: Sequence[Floats], white: Sequence[Floats]) -> SensorFit:
    """Finds the three spans of readings (3) on black and on white.

    Raises:
        BadReadings: too few, or a sensor does not tell them apart.
    """
    if min(len(black), len(white)) < LEAST_READINGS:
        raise BadReadings("its ground readings did not come: has it a ground board, and a setting?")
    levels = np.array([np.median(np.array(rows), axis=0) for rows in (black, white)]).T
    spread = np.array(
        [np.array(rows).std(axis=0) / math.sqrt(len(rows)) for rows in (black, white)]
    )
    for name, (low, high) in zip(("left", "centre", "right"), levels):
        if high - low < SPAN_MIN:
            raise BadReadings(
                f"its {name} ground sensor reads {low:.0f} on black and {high:.0f} on white: are"
                " the places right, and on the real floor?"
            )
    return SensorFit(levels, np.array(spread).T, 0.0, 0.0, len(black) + len(white))
