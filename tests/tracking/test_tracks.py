"""One robot from timestep to timestep."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.tracking.tracks import Limits, Track, covariances
from vsense.tracking.views import Sighting

STEP_NS = 100_000_000
LIMITS = Limits()
SPREAD = (1e-8, 0.0, 0.0, 1e-8, 0.0, 1e-5)


def sighting(x_m: float, step: int, yaw_rad: float = 0.0, y_m: float = 0.0) -> Sighting:
    return Sighting(31, x_m, y_m, yaw_rad, step * STEP_NS, 1e6, ("a",), SPREAD, (0.0, 0.0))


def follow(track: Track, *places: list[Sighting]) -> list[int]:
    return [track.update(place, LIMITS) for place in places]


@given(st.floats(-0.2, 0.2), st.integers(2, 30))
def test_a_steady_robot_has_its_speed_and_is_believed(speed_m_s: float, steps: int) -> None:
    track = Track(sighting(0.0, 0))
    for step in range(1, steps):
        assert track.update([sighting(0.1 * speed_m_s * step, step)], LIMITS) == 0
        assert track.seen and track.confidence(step * STEP_NS, LIMITS) == 1.0
    assert track.speed_m_s <= abs(speed_m_s) + 1e-9
    assert track.speed_m_s >= abs(speed_m_s) * (1.0 - 0.4 ** (steps - 1)) - 1e-9


def test_a_jump_is_not_believed() -> None:
    track = Track(sighting(0.0, 0))
    assert follow(track, [sighting(0.5, 1)]) == [1]
    assert not track.seen and track.last.x_m == 0.0
    assert follow(track, [sighting(0.01, 2)]) == [0]
    assert track.seen


def test_a_robot_that_was_set_down_elsewhere_is_believed_when_it_insists() -> None:
    track = Track(sighting(0.0, 0))
    assert follow(track, [sighting(0.5, 1)], [sighting(0.51, 2)]) == [1, 1]
    assert not track.seen
    follow(track, [sighting(0.52, 3)])
    assert track.seen and track.last.x_m == 0.52 and track.speed_m_s == 0.0


def test_jumps_to_and_fro_never_insist() -> None:
    track = Track(sighting(0.0, 0))
    for step in range(1, 8):
        follow(track, [sighting(0.6 if step % 2 else -0.6, step)])
        assert track.last.x_m == 0.0


def test_the_longer_unseen_the_farther_it_may_have_come() -> None:
    reach = LIMITS.slack_m + 2.0 * LIMITS.max_speed_m_s
    near, far = Track(sighting(0.0, 0)), Track(sighting(0.0, 0))
    assert follow(near, [sighting(reach - 0.001, 20)]) == [0]
    assert follow(far, [sighting(reach + 0.001, 20)]) == [1]


def test_of_two_the_one_within_reach_is_followed_with_less_confidence() -> None:
    track = Track(sighting(0.0, 0))
    assert follow(track, [sighting(0.01, 1), sighting(0.9, 1)]) == [1]
    assert track.seen and track.last.x_m == 0.01
    assert track.confidence(STEP_NS, LIMITS) == 0.5


def test_of_two_within_reach_none_is_believed() -> None:
    track = Track(sighting(0.0, 0))
    assert follow(track, [sighting(0.01, 1), sighting(-0.03, 1)]) == [0]
    assert not track.seen


def test_a_robot_out_of_sight_is_carried_on_for_a_moment_and_then_held() -> None:
    track = Track(sighting(0.0, 0))
    for step in range(1, 30):
        follow(track, [sighting(0.01 * step, step)])
    track.seen = False
    x_m = [track.pose((29 + k) * STEP_NS, LIMITS)[0] for k in range(8)]
    assert x_m[:4] == pytest.approx([0.29, 0.30, 0.31, 0.32], abs=1e-6)
    assert x_m[4:] == pytest.approx([0.32] * 4, abs=1e-6)


def test_a_robot_out_of_sight_turns_on_for_a_moment_and_then_is_held() -> None:
    track = Track(sighting(0.0, 0))
    for step in range(1, 30):
        follow(track, [sighting(0.0, step, math.remainder(0.2 * step, math.tau))])
    last = track.last.yaw_rad
    turned = [track.pose((29 + k) * STEP_NS, LIMITS)[2] - last for k in range(6)]
    assert np.remainder(turned, math.tau) == pytest.approx([0, 0.2, 0.4, 0.6, 0.6, 0.6], abs=1e-6)


def test_the_covariance_is_the_picture_s_and_grows_out_of_sight() -> None:
    track = Track(sighting(0.0, 0))
    for step in range(1, 5):
        follow(track, [sighting(0.01 * step, step)])
    now = covariances([track], 4 * STEP_NS, LIMITS)[0]
    assert now[np.triu_indices(3)].tolist() == list(SPREAD)
    later = [covariances([track], (4 + k) * STEP_NS, LIMITS)[0] for k in range(40)]
    sd_m = np.sqrt([spread[0, 0] for spread in later])
    assert (np.diff(sd_m) > 0.0).all() and sd_m[3] < 0.03 and sd_m[30] > 0.15
    assert later[-1][2, 2] == pytest.approx(math.pi**2 / 3.0), "any heading is as good"
    assert all((np.linalg.eigvalsh(spread) > 0.0).all() for spread in later)


def test_robots_that_drive_turn_and_spin_are_found_where_they_were_expected() -> None:
    """What is said of the error of a prediction is not less than the error, nor far more."""
    rng = np.random.default_rng(5)
    squares = []
    for _ in range(60):
        x = y = yaw = 0.0
        track = Track(sighting(x, 0, yaw, y))
        spin = 0
        for step in range(1, 36):
            spin = spin - 1 if spin else int(rng.integers(2, 6)) * (rng.random() < 0.06)
            yaw += 0.35 * bool(spin)
            way = 0.0 if spin else 0.012
            x, y = x + way * math.cos(yaw), y + way * math.sin(yaw)
            if step <= 20:
                follow(track, [sighting(x, step, math.remainder(yaw, math.tau), y)])
                continue
            pose = np.array(track.pose(step * STEP_NS, LIMITS))
            error = pose - (x, y, yaw)
            error[2] = math.remainder(error[2], math.tau)
            spread = covariances([track], step * STEP_NS, LIMITS)[0]
            squares.append(float(error @ np.linalg.solve(spread, error)))
    assert 0.1 < np.mean(squares) / 3.0 < 1.5
    assert np.mean(np.array(squares) > 11.34) < 0.08


@given(st.lists(st.integers(0, 10**10), min_size=2))
def test_confidence_falls_while_out_of_sight(ages: list[int]) -> None:
    track = Track(sighting(0.0, 0))
    track.seen = False
    falling = [track.confidence(age, LIMITS) for age in sorted(ages)]
    assert falling == sorted(falling, reverse=True)
    assert all(0.0 <= value <= 1.0 for value in falling)
    assert track.confidence(round(1e9 * LIMITS.fade_s), LIMITS) == pytest.approx(math.exp(-1))


def test_a_capture_time_that_stands_still_divides_nothing_by_zero() -> None:
    track = Track(sighting(0.0, 5))
    assert follow(track, [sighting(0.01, 5)]) == [0]
    assert track.seen and track.speed_m_s == 0.0
