"""Wheels and marker of one robot, by least squares on where its marker was seen.

The robot drives stretches of constant wheel speeds: on the spot both ways, straight both ways. With
L, R the steps a second that its motors make, s the nominal way of a step, a the nominal axle:

    v = s (l L + r R) / 2             speed of the axle's middle
    w = s (r R - l L) / (b a)         turning rate
    yaw(t) = yaw0 + w t               and the axle's middle goes along a circle

    marker's place = middle + Rot(yaw) (x, y)
    marker's yaw   = yaw + turn

l, r (the wheels' ways over nominal), b (the axle over nominal) and x, y, turn (the marker's offset)
are common to all stretches; each has its own pose to begin with. Source of the model: Borenstein,
Feng: Measurement and correction of systematic odometry errors in mobile robots, 1996; of finding a
sensor's place together with the wheels: Censi, Franchi, Marchionni, Oriolo: Simultaneous
calibration of odometry and sensor parameters for mobile robots, 2013. Here poses are seen, and not
increments measured. Times are those of the pictures: delays of the link do not matter.

Turning on the spot shows the axle and the marker's distance from the centre of turning, driving
straight the wheels and the marker's heading.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vsense.base.arena import Floats, wrap_angle
from vsense.base.errors import VsenseError
from vsense.config.roster_fields import MarkerOffset
from vsense.world.robot_models import RobotModel

PARAMETERS = ("left", "right", "axle", "marker_x", "marker_y", "marker_yaw")
"""In this order in covariances: shares, shares, shares of nominal, m, m, rad."""

MOST_RMS_M, MOST_RMS_RAD = 0.003, math.radians(2.0)
"""Of what is left over; more is no motion of two wheels."""
MOST_SIGMA = np.array([0.005, 0.005, 0.005, 0.0005, 0.0005, math.radians(0.3)])
"""Standard deviations with which a result is still one."""

_ITERATIONS = 30
_ENOUGH = 1e-7
_HUBER = 2.0
_COMMON = len(PARAMETERS)


class BadFit(VsenseError):
    """What a robot did is not what its wheels were told; the message says what does not fit."""


@dataclass(frozen=True, slots=True)
class Stretch:
    """A time in which the motors kept their speeds.

    Attributes:
        times_s: (n,) of the pictures.
        poses: (n, 3) the marker's x, y [m] and yaw [rad], arena frame.
        left_steps_s, right_steps_s: what the motors were told.
    """

    times_s: Floats
    poses: Floats
    left_steps_s: float
    right_steps_s: float

    @property
    def is_turn(self) -> bool:
        """Whether the robot turned on the spot."""
        return self.left_steps_s * self.right_steps_s < 0.0


@dataclass(frozen=True, slots=True)
class MotionFit:
    """What was found of a robot.

    Attributes:
        model: the nominal robot.
        left, right: way of a wheel over that of the nominal one.
        axle_m: distance of the wheels.
        marker: its offset from the axle's middle.
        covariance: (6, 6) of `PARAMETERS`.
        poses: how many it was found from.
        rms_m, rms_rad: what is left over of places and headings.
    """

    model: RobotModel
    left: float
    right: float
    axle_m: float
    marker: MarkerOffset
    covariance: Floats
    poses: int
    rms_m: float
    rms_rad: float

    @property
    def wheel_diameter_mm(self) -> float:
        """The mean of both wheels."""
        return (1000.0 * self.model.diameter_m) * (self.left + self.right) / 2.0

    @property
    def wheel_ratio(self) -> float:
        """The right wheel over the left one."""
        return self.right / self.left

    @property
    def sigmas(self) -> dict[str, float]:
        """Standard deviations of what the roster holds, by its names."""
        own = np.sqrt(np.diag(self.covariance))
        mean = np.array([0.5, 0.5, 0.0, 0.0, 0.0, 0.0]) * (1000.0 * self.model.diameter_m)
        ratio = np.zeros(_COMMON)
        ratio[:2] = -self.wheel_ratio / self.left, 1.0 / self.left
        return {
            "wheel_diameter_mm": _along(mean, self.covariance),
            "wheel_ratio": _along(ratio, self.covariance),
            "axle_length_mm": 1000.0 * self.model.axle_m * float(own[2]),
            "x_mm": 1000.0 * float(own[3]),
            "y_mm": 1000.0 * float(own[4]),
            "yaw_deg": math.degrees(own[5]),
        }


def _along(derivative: Floats, covariance: Floats) -> float:
    return math.sqrt(float(derivative @ covariance @ derivative))


def fit(stretches: Sequence[Stretch], model: RobotModel, roughly: bool = False) -> MotionFit:
    """Finds wheels and marker of the robot that drove these; `roughly`: however sure that is.

    Raises:
        BadFit: too little was seen, or it is no motion of two wheels.
    """
    turns = {np.sign(s.left_steps_s) for s in stretches if s.is_turn}
    ways = {np.sign(s.left_steps_s) for s in stretches if not s.is_turn}
    if len(turns) < 2 or len(ways) < 2:
        raise BadFit("it was not seen turning and driving both ways for long enough")
    problem = _Problem(stretches, model)
    problem.solve()
    return problem.result(roughly)


class _Problem:
    """Gauss-Newton's method with Huber's weights; the stretches' own poses are eliminated."""

    def __init__(self, stretches: Sequence[Stretch], model: RobotModel) -> None:
        self._stretches, self._model = stretches, model
        self._middles = [float(s.times_s.mean()) for s in stretches]
        self._common = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
        self._own = [_begin(s, middle) for s, middle in zip(stretches, self._middles)]
        self._sigma = np.array([0.0007, 0.0007, 0.01])

    def solve(self) -> None:
        """Iterates until nothing changes."""
        for _ in range(_ITERATIONS):
            normal, right, backs = self._normal()
            step = np.linalg.solve(normal, right)
            self._common = self._common + step
            for number, (inverse, own_right, coupling) in enumerate(backs):
                self._own[number] = self._own[number] + inverse @ (own_right - coupling @ step)
            self._learn_noise()
            if np.abs(step).max() < _ENOUGH:
                break
        if not np.isfinite(self._common).all():
            raise BadFit("no wheels and no marker explain how it moved")

    def result(self, roughly: bool) -> MotionFit:
        """The result; BadFit where what is left over is too much."""
        errors = np.concatenate([self._errors(i) for i in range(len(self._stretches))])
        rms_m = math.sqrt(float((errors[:, :2] ** 2).sum(axis=1).mean()))
        rms_rad = math.sqrt(float((errors[:, 2] ** 2).mean()))
        inverse = np.linalg.inv(self._normal()[0])
        covariance = np.asarray(inverse * self._memory(), dtype=np.float64)
        if rms_m > MOST_RMS_M or rms_rad > MOST_RMS_RAD:
            raise BadFit(
                f"{1000 * rms_m:.1f} mm and {math.degrees(rms_rad):.1f} degrees are left over, at"
                f" most {1000 * MOST_RMS_M:g} and {math.degrees(MOST_RMS_RAD):g} fit: does it slip,"
                " is its marker loose, was it touched?"
            )
        if not roughly and (np.sqrt(np.diag(covariance)) > MOST_SIGMA).any():
            raise BadFit("too little was seen of it to be sure")
        left, right, axle, x_m, y_m, yaw_rad = self._common.tolist()
        marker = MarkerOffset(x_m, y_m, float(wrap_angle(yaw_rad)))
        axle_m = axle * self._model.axle_m
        return MotionFit(
            self._model, left, right, axle_m, marker, covariance, len(errors), rms_m, rms_rad
        )

    def _normal(self) -> tuple[Floats, Floats, list[tuple[Floats, Floats, Floats]]]:
        """The normal equations of the common parameters, and how the own ones follow."""
        normal, right = np.zeros((_COMMON, _COMMON)), np.zeros(_COMMON)
        backs = []
        for number in range(len(self._stretches)):
            errors, weights = self._errors(number), self._weights(number)
            common, own = self._derivatives(number)
            flat = (weights * errors).reshape(-1)
            weighted = weights.reshape(-1, 1)
            inverse = np.linalg.inv(own.T @ (weighted * own))
            coupling = own.T @ (weighted * common)
            own_right = own.T @ flat
            normal += common.T @ (weighted * common) - coupling.T @ inverse @ coupling
            right += common.T @ flat - coupling.T @ inverse @ own_right
            backs.append((inverse, own_right, coupling))
        return normal, right, backs

    def _errors(self, number: int) -> Floats:
        """Seen less expected, (n, 3)."""
        stretch = self._stretches[number]
        expected = self._markers(self._common, self._own[number], number)
        errors = stretch.poses - expected
        errors[:, 2] = wrap_angle(errors[:, 2])
        return errors

    def _weights(self, number: int) -> Floats:
        """Inverse variances (n, 3); less for what is far off."""
        scaled = np.abs(self._errors(number)) / self._sigma
        return np.asarray(np.minimum(1.0, _HUBER / np.maximum(scaled, 1e-9)) / self._sigma**2)

    def _derivatives(self, number: int) -> tuple[Floats, Floats]:
        """Of the expected poses, by common and own parameters: (3 n, 6) and (3 n, 3)."""
        parameters = np.concatenate((self._common, self._own[number]))
        changes = 1e-6 * np.eye(len(parameters))
        both = np.concatenate((parameters + changes, parameters - changes))
        ahead, back = np.split(self._markers(both[:, :_COMMON], both[:, _COMMON:], number), 2)
        table = ((ahead - back) / 2e-6).reshape(len(parameters), -1).T
        return table[:, :_COMMON], table[:, _COMMON:]

    def _markers(self, common: Floats, own: Floats, number: int) -> Floats:
        """Where the marker should have been seen, (..., n, 3); see the module.

        `common` are parameters (..., 6), and `own` of the stretch (..., 3).
        """
        stretch, model = self._stretches[number], self._model
        left, right, axle, marker_x, marker_y, marker_yaw = np.moveaxis(common[..., None, :], -1, 0)
        own_x, own_y, own_yaw = np.moveaxis(own[..., None, :], -1, 0)
        way_left = model.step_m * left * model.motor_speed(stretch.left_steps_s)
        way_right = model.step_m * right * model.motor_speed(stretch.right_steps_s)
        since_s = stretch.times_s - self._middles[number]
        half = 0.5 * (way_right - way_left) / (axle * model.axle_m) * since_s
        chord = 0.5 * (way_left + way_right) * since_s * np.sinc(half / np.pi)
        yaw = own_yaw + 2.0 * half
        cos, sin = np.cos(yaw), np.sin(yaw)
        return np.stack(
            (
                own_x + chord * np.cos(own_yaw + half) + cos * marker_x - sin * marker_y,
                own_y + chord * np.sin(own_yaw + half) + sin * marker_x + cos * marker_y,
                yaw + marker_yaw,
            ),
            axis=-1,
        )

    def _learn_noise(self) -> None:
        """Takes the noise from what is left over: the median's deviation, which outliers spare."""
        errors = np.concatenate([self._errors(i) for i in range(len(self._stretches))])
        spread = 1.4826 * np.median(np.abs(errors), axis=0)
        place = max(float(spread[:2].mean()), 1e-5)
        self._sigma = np.array([place, place, max(float(spread[2]), 1e-4)])

    def _memory(self) -> float:
        """By how much variances grow because errors resemble those before them.

        (1 + c) / (1 - c) with their correlation c. Source: Bayley, Hammersley: The effective number
        of independent observations in an autocorrelated time series, 1946.
        """
        before = np.concatenate([self._errors(i)[:-1] for i in range(len(self._stretches))])
        after = np.concatenate([self._errors(i)[1:] for i in range(len(self._stretches))])
        before, after = before / self._sigma, after / self._sigma
        likeness = float((before * after).sum() / max(float((before**2).sum()), 1e-12))
        likeness = min(max(likeness, 0.0), 0.98)
        return (1.0 + likeness) / (1.0 - likeness)


def _begin(stretch: Stretch, middle_s: float) -> Floats:
    yaw = np.unwrap(stretch.poses[:, 2])
    turned = np.column_stack((stretch.poses[:, :2], yaw))
    nearest = int(np.argmin(np.abs(stretch.times_s - middle_s)))
    return np.asarray(turned[nearest])
