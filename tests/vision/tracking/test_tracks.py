"""One robot from timestep to timestep."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.vision.tracking._tracks import Limits, RobotTracks
from vsense.vision.tracking._views import VIEW

STEP_NS = 100_000_000
LIMITS = Limits()
SPREAD = (1e-8, 0.0, 0.0, 1e-8, 0.0, 1e-5)
TAG = 31

Place = tuple[float, float, float]
"""x, y [m] and yaw [rad]."""


def at(x_m: float, yaw_rad: float = 0.0, y_m: float = 0.0) -> Place:
    return x_m, y_m, yaw_rad


class One:
    """The tracks of one robot, and of another far away whom all this does not concern."""

    def __init__(self, first: Place, step: int = 0) -> None:
        self.tracks = RobotTracks(LIMITS)
        assert self.follow(step, first) == 0

    def follow(self, step: int, *places: Place) -> int:
        """Takes sightings of it at these places; returns how many were out of reach."""
        seen = np.zeros(len(places) + 1, dtype=VIEW)
        seen["tag"], seen["cameras"], seen["covariance"] = TAG, 1, SPREAD
        seen["capture_ns"] = step * STEP_NS
        for row, (x_m, y_m, yaw_rad) in zip(seen, places):
            row["x_m"], row["y_m"], row["yaw_rad"] = x_m, y_m, yaw_rad
        seen["tag"][-1], seen["x_m"][-1] = TAG + 1, 9.0
        return self.tracks.update(seen)

    @property
    def row(self) -> np.void:
        """Its TRACK."""
        first, other = self.tracks.rows
        assert other["seen"] and other["last"]["x_m"] == 9.0 and other["strays"] == 0
        return first

    def pose(self, now_ns: int) -> np.void:
        """Its POSE."""
        return self.tracks.poses(now_ns)[0]


@given(st.floats(-0.2, 0.2), st.integers(2, 30))
def test_a_steady_robot_has_its_speed_and_is_believed(speed_m_s: float, steps: int) -> None:
    one = One(at(0.0))
    for step in range(1, steps):
        assert one.follow(step, at(0.1 * speed_m_s * step)) == 0
        pose = one.pose(step * STEP_NS)
        assert pose["seen"] and pose["confidence"] == 1.0
    assert pose["speed_m_s"] <= abs(speed_m_s) + 1e-9
    assert pose["speed_m_s"] >= abs(speed_m_s) * (1.0 - 0.4 ** (steps - 1)) - 1e-9


def test_a_jump_is_not_believed() -> None:
    one = One(at(0.0))
    assert one.follow(1, at(0.5)) == 1
    assert not one.row["seen"] and one.row["last"]["x_m"] == 0.0
    assert one.follow(2, at(0.01)) == 0
    assert one.row["seen"]


def test_a_robot_that_was_set_down_elsewhere_is_believed_when_it_insists() -> None:
    one = One(at(0.0))
    assert [one.follow(1, at(0.5)), one.follow(2, at(0.51))] == [1, 1]
    assert not one.row["seen"]
    one.follow(3, at(0.52))
    pose = one.pose(3 * STEP_NS)
    assert pose["seen"] and pose["x_m"] == 0.52 and pose["speed_m_s"] == 0.0


def test_jumps_to_and_fro_never_insist() -> None:
    one = One(at(0.0))
    for step in range(1, 8):
        one.follow(step, at(0.6 if step % 2 else -0.6))
        assert one.row["last"]["x_m"] == 0.0


def test_the_longer_unseen_the_farther_it_may_have_come() -> None:
    reach = LIMITS.slack_m + 2.0 * LIMITS.max_speed_m_s
    assert One(at(0.0)).follow(20, at(reach - 0.001)) == 0
    assert One(at(0.0)).follow(20, at(reach + 0.001)) == 1


def test_of_two_the_one_within_reach_is_followed_with_less_confidence() -> None:
    one = One(at(0.0))
    assert one.follow(1, at(0.01), at(0.9)) == 1
    pose = one.pose(STEP_NS)
    assert pose["seen"] and pose["x_m"] == 0.01 and pose["confidence"] == 0.5


def test_of_two_within_reach_none_is_believed() -> None:
    one = One(at(0.0))
    assert one.follow(1, at(0.01), at(-0.03)) == 0
    assert not one.row["seen"]


def test_who_begins_at_two_places_begins_nowhere() -> None:
    tracks, seen = RobotTracks(LIMITS), np.zeros(3, dtype=VIEW)
    seen["tag"], seen["x_m"] = (7, 7, 9), (0.0, 1.0, 2.0)
    assert tracks.update(seen) == 0
    assert tracks.rows["last"]["tag"].tolist() == [9]
    seen["tag"] = 5, 7, 9
    tracks.update(seen)
    assert tracks.rows["last"]["tag"].tolist() == [5, 7, 9]


def test_who_was_not_seen_for_too_long_is_forgotten() -> None:
    one = One(at(0.0))
    for step, left in ((50, [TAG, TAG + 1]), (51, [TAG + 1])):
        one.follow(step)
        one.tracks.forget(step * STEP_NS)
        assert one.tracks.rows["last"]["tag"].tolist() == left


def test_a_robot_out_of_sight_is_carried_on_for_a_moment_and_then_held() -> None:
    one = One(at(0.0))
    for step in range(1, 30):
        one.follow(step, at(0.01 * step))
    x_m = [one.pose((29 + k) * STEP_NS)["x_m"] for k in range(8)]
    assert x_m[:4] == pytest.approx([0.29, 0.30, 0.31, 0.32], abs=1e-6)
    assert x_m[4:] == pytest.approx([0.32] * 4, abs=1e-6)


def test_a_robot_out_of_sight_turns_on_for_a_moment_and_then_is_held() -> None:
    one = One(at(0.0))
    for step in range(1, 30):
        one.follow(step, at(0.0, math.remainder(0.2 * step, math.tau)))
    last = one.row["last"]["yaw_rad"]
    turned = [one.pose((29 + k) * STEP_NS)["yaw_rad"] - last for k in range(6)]
    assert np.remainder(turned, math.tau) == pytest.approx([0, 0.2, 0.4, 0.6, 0.6, 0.6], abs=1e-6)


def test_the_covariance_is_the_picture_s_and_grows_out_of_sight() -> None:
    one = One(at(0.0))
    for step in range(1, 5):
        one.follow(step, at(0.01 * step))
    now = one.pose(4 * STEP_NS)["covariance"]
    assert now[np.triu_indices(3)].tolist() == list(SPREAD)
    later = [one.pose((4 + k) * STEP_NS)["covariance"] for k in range(40)]
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
        one = One(at(x, yaw, y))
        spin = 0
        for step in range(1, 36):
            spin = spin - 1 if spin else int(rng.integers(2, 6)) * (rng.random() < 0.06)
            yaw += 0.35 * bool(spin)
            way = 0.0 if spin else 0.012
            x, y = x + way * math.cos(yaw), y + way * math.sin(yaw)
            if step <= 20:
                one.follow(step, at(x, math.remainder(yaw, math.tau), y))
                continue
            pose = one.pose(step * STEP_NS)
            error = np.array([pose["x_m"] - x, pose["y_m"] - y, pose["yaw_rad"] - yaw])
            error[2] = math.remainder(error[2], math.tau)
            squares.append(float(error @ np.linalg.solve(pose["covariance"], error)))
    assert 0.1 < np.mean(squares) / 3.0 < 1.5
    assert np.mean(np.array(squares) > 11.34) < 0.08


@given(st.lists(st.integers(STEP_NS, 10**10), min_size=2))
def test_confidence_falls_while_out_of_sight(ages: list[int]) -> None:
    one = One(at(0.0))
    one.follow(1)
    falling = [float(one.pose(age)["confidence"]) for age in sorted(ages)]
    assert falling == sorted(falling, reverse=True)
    assert all(0.0 <= value <= 1.0 for value in falling)
    faded = one.pose(round(1e9 * LIMITS.fade_s))["confidence"]
    assert faded == pytest.approx(math.exp(-1), rel=1e-6)


def test_a_capture_time_that_stands_still_divides_nothing_by_zero() -> None:
    one = One(at(0.0), 5)
    assert one.follow(5, at(0.01)) == 0
    pose = one.pose(5 * STEP_NS)
    assert pose["seen"] and pose["speed_m_s"] == 0.0


@pytest.mark.parametrize("elapsed_ns", [1, 1_000_000, 5_000_000, 50_000_000])
def test_two_sightings_soon_after_each_other_fling_nobody_away(elapsed_ns: int) -> None:
    """Two pictures of one moment, or a node's that says so: 2 cm apart, within reach."""
    one = One(at(0.0))
    seen = np.zeros(1, dtype=VIEW)
    seen["tag"], seen["cameras"], seen["covariance"] = TAG, 1, SPREAD
    seen["capture_ns"], seen["x_m"], seen["yaw_rad"] = elapsed_ns, 0.02, 0.1
    one.tracks.update(seen)
    pose = one.pose(elapsed_ns + STEP_NS)
    assert pose["speed_m_s"] <= LIMITS.max_speed_m_s * 1.000001
    assert abs(pose["x_m"] - 0.02) <= LIMITS.max_speed_m_s * 0.1 * 1.000001
    assert abs(pose["yaw_rad"]) < math.pi / 2 or elapsed_ns >= 5_000_000
