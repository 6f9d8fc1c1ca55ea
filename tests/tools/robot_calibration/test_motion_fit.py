"""Wheels and markers found from poses that the physics in C has made."""

from __future__ import annotations

import math

import numpy as np
import pytest

from vsense.modes.lab.hardware import HardwareErrors, RobotHardware, draw, to_markers
from vsense.tools.robot_calibration._motion_fit import BadFit, Stretch, fit
from vsense.world.physics.motion import Physics
from vsense.world.robot_models import EPUCK

ERRORS = HardwareErrors(0.004, math.radians(5.0), 0.05)
TURNS = ((-200, 200), (200, -200))
WAYS = ((250, 250), (-250, -250))


def driven(
    built: RobotHardware, speeds: tuple[int, int], random: np.random.Generator, noise: float = 1.0
) -> Stretch:
    """What cameras see of a robot that drives for 6 s from anywhere, with 0.3 mm and 0.3 degrees
    of noise."""
    start = random.uniform((-1.0, -1.0, -3.0), (1.0, 1.0, 3.0))
    wheels = np.array([[built.left, built.right, built.axle_m]])
    physics = Physics([start], [], [], 0, built=wheels)
    physics.drive(0, *speeds, 0)
    offset = np.array([[built.marker.x_m, built.marker.y_m, built.marker.yaw_rad]])
    times_s = np.arange(60) / 10.0
    poses = []
    for time_s in times_s:
        physics.advance(round(time_s * 1e9))
        poses.append(to_markers(physics.poses, offset)[0])
    errors = noise * random.normal(0.0, (0.0003, 0.0003, math.radians(0.3)), (60, 3))
    return Stretch(times_s, np.array(poses) + errors, *map(float, speeds))


@pytest.mark.parametrize("tag", [23, 31, 1843])
def test_wheels_and_marker_are_found(tag: int) -> None:
    built, random = draw(tag, ERRORS), np.random.default_rng(tag)
    found = fit([driven(built, speeds, random) for speeds in (*TURNS, *WAYS, *WAYS)], EPUCK)
    # The bar is 1 mm, 0.5 degrees and 1 %; so much noise leaves a tenth of that.
    assert found.marker.x_m == pytest.approx(built.marker.x_m, abs=2e-4)
    assert found.marker.y_m == pytest.approx(built.marker.y_m, abs=2e-4)
    assert found.marker.yaw_rad == pytest.approx(built.marker.yaw_rad, abs=math.radians(0.15))
    assert found.wheel_diameter_mm == pytest.approx(built.wheel_diameter_mm, rel=2e-3)
    assert found.wheel_ratio == pytest.approx(built.wheel_ratio, rel=4e-3)
    assert 1000 * found.axle_m == pytest.approx(1000 * built.axle_m, rel=3e-3)


def test_standard_deviations_are_those_of_the_errors() -> None:
    random = np.random.default_rng(5)
    scaled = []
    for tag in range(12):
        built = draw(tag, ERRORS)
        found = fit([driven(built, speeds, random) for speeds in (*TURNS, *WAYS)], EPUCK)
        sigmas = found.sigmas
        scaled.append((found.wheel_diameter_mm - built.wheel_diameter_mm)
                      / sigmas["wheel_diameter_mm"])  # fmt: skip
        scaled.append((found.marker.x_m - built.marker.x_m) * 1000 / sigmas["x_mm"])
        yaw_rad = found.marker.yaw_rad - built.marker.yaw_rad
        scaled.append(math.degrees(yaw_rad) / sigmas["yaw_deg"])
    assert 0.6 < np.sqrt(np.mean(np.square(scaled))) < 1.4


def test_a_pose_that_is_far_off_spoils_nothing() -> None:
    built, random = draw(7, ERRORS), np.random.default_rng(1)
    stretches = [driven(built, speeds, random) for speeds in (*TURNS, *WAYS)]
    stretches[2].poses[30] += (0.02, -0.02, 0.5)
    found = fit(stretches, EPUCK)
    assert found.marker.y_m == pytest.approx(built.marker.y_m, abs=3e-4)
    assert found.wheel_ratio == pytest.approx(built.wheel_ratio, rel=4e-3)


def test_a_motor_makes_a_step_in_whole_ticks() -> None:
    # epuck.md 1.6: 900 -> 909, 700 -> 714, 600 -> 625.
    assert [round(EPUCK.motor_speed(told)) for told in (900, 700, 600, 0, -600)] == [
        909,
        714,
        625,
        0,
        -625,
    ]


def test_what_is_no_motion_of_two_wheels_is_refused() -> None:
    built, random = draw(3, ERRORS), np.random.default_rng(2)
    stretches = [driven(built, speeds, random) for speeds in (*TURNS, *WAYS)]
    with pytest.raises(BadFit, match="both ways"):
        fit(stretches[1:], EPUCK)
    stretches[2] = driven(built, WAYS[0], random, noise=40.0)
    with pytest.raises(BadFit, match="left over"):
        fit(stretches, EPUCK)
