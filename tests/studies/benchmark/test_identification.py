"""Wheels and noise identified from motion that was made with known ones."""

from __future__ import annotations

import math

import numpy as np
import pytest

from vsense.base.arena import Floats, wrap_angle
from vsense.studies.benchmark._motion import (
    RunMotion,
    WheelOrders,
    robots_of,
    shift_of,
    standing_noise,
)
from vsense.world.robot_models import EPUCK

TAG, STEPS, DT_S = 23, 900, 0.1


def driven(
    left: float, right: float, axle: float, lag_s: float, noise: tuple[float, float]
) -> RunMotion:
    """A robot that gets other speeds every half second, and stands for two of every four seconds.

    It is moved in steps of 1 ms, straight ahead and about its middle: no arc is computed here.
    """
    rng = np.random.default_rng(5)
    speeds = rng.integers(-400, 900, (STEPS // 5, 2)).astype(float)
    speeds[np.arange(len(speeds)) % 8 < 4] = 0.0
    fine_s = np.arange(0, STEPS * 100) / 1000.0
    now = speeds[np.clip((fine_s - lag_s) / 0.5, 0, len(speeds) - 1).astype(int)]
    way = now * EPUCK.step_m * (left, right) * 1e-3
    yaw = np.concatenate(([0.0], np.cumsum((way[:, 1] - way[:, 0]) / (EPUCK.axle_m * axle))))
    ahead = way.mean(axis=1)
    x, y = (np.cumsum(ahead * turn(yaw[:-1])) for turn in (np.cos, np.sin))
    at = slice(0, None, 100)
    poses = np.stack((x[at], y[at], wrap_angle(yaw[:-1][at])), axis=-1)
    poses[:, :2] += rng.normal(0.0, noise[0], (STEPS, 2))
    poses[:, 2] += rng.normal(0.0, noise[1], STEPS)
    orders = WheelOrders(np.arange(len(speeds)) * 0.5, speeds, EPUCK.step_m)
    light = 3.0 + rng.normal(0.0, 0.02, (STEPS, 1, 8))
    light[rng.random((STEPS, 1)) < 0.03] = 0.0  # somebody's shadow
    return motion(poses[:, None], orders, light)


def motion(poses: Floats, orders: WheelOrders | None, light: Floats) -> RunMotion:
    times_s, free = np.arange(STEPS) * DT_S, np.ones((STEPS, 1), bool)
    axles_m, readings = (EPUCK.axle_m,), {"light": light}
    return RunMotion(DT_S, (TAG,), times_s, poses, free, (orders,), axles_m, readings)


@pytest.mark.parametrize("lag_s", [0.0, 0.13])
def test_wheels_lag_and_noise_are_found(lag_s: float) -> None:
    run = driven(1.04, 0.97, 1.03, lag_s, (0.0003, math.radians(0.1)))
    found_s = shift_of([run])
    assert found_s == pytest.approx(lag_s, abs=0.011)
    (robot,) = robots_of([run], lag_s)
    assert (robot.tag, robot.way_over_told) == (TAG, pytest.approx(1.005, abs=0.002))
    assert robot.right_over_left == pytest.approx(0.97 / 1.04, abs=0.003)
    assert robot.axle_over_nominal == pytest.approx(1.03, abs=0.003)
    # Both ends of a timestep have the camera's noise.
    assert robot.forward_noise_mm == pytest.approx(0.3 * math.sqrt(2.0), rel=0.15)
    assert robot.turn_noise_deg == pytest.approx(0.1 * math.sqrt(2.0), rel=0.15)
    standing = {one.what: one for one in standing_noise([run])}
    assert standing["x"].sigma == pytest.approx(0.3, rel=0.2)
    assert standing["heading"].sigma == pytest.approx(0.1, rel=0.2)
    assert standing["light"].sigma == pytest.approx(0.02, rel=0.2)
    assert standing["light"].samples == 8 * standing["x"].samples


def test_what_nobody_told_is_not_known() -> None:
    still = np.zeros((STEPS, 1, 3))
    silent = motion(still, None, np.zeros((STEPS, 1, 8)))
    assert shift_of([silent]) is None
    assert robots_of([silent], 0.0) == [] and standing_noise([silent]) == []
    stood = motion(still, WheelOrders(np.array([0.0, 80.0]), np.zeros((2, 2)), EPUCK.step_m), still)
    assert shift_of([stood]) is None and robots_of([stood], 0.0) == []
    assert {one.sigma for one in standing_noise([stood])} == {0.0}
