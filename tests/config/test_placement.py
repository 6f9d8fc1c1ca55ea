"""Start poses: drawn from the seed alone, uniform, and without overlap."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.config.experiment import load
from vsense.config.placement import MIN_GAP_M, box_distance, place
from vsense.config.specs import BODY_RADIUS_M, Box, Experiment, Pose
from vsense.errors import ConfigError

Read = Callable[..., Experiment]


@pytest.fixture(scope="module")
def pollutant() -> Experiment:
    return load("pollutant")


@given(st.integers(0, 2**32 - 1))
def test_the_same_seed_gives_the_same_poses_and_no_two_bodies_overlap(
    pollutant: Experiment, seed: int
) -> None:
    poses = place(pollutant, seed)
    assert poses == place(pollutant, seed)
    assert sorted(poses) == sorted(b.tag for b in (*pollutant.robots, *pollutant.objects))
    for a, b in itertools.combinations(poses.values(), 2):
        assert math.hypot(a.x_m - b.x_m, a.y_m - b.y_m) >= 2 * BODY_RADIUS_M + MIN_GAP_M
    for pose in poses.values():
        assert abs(pose.x_m) <= 1.48 - BODY_RADIUS_M - MIN_GAP_M + 1e-12
        assert abs(pose.y_m) <= 1.18 - BODY_RADIUS_M - MIN_GAP_M + 1e-12
        assert -math.pi < pose.yaw_rad <= math.pi


def test_poses_are_uniform_over_arena_and_circle(pollutant: Experiment) -> None:
    poses = np.array([place(pollutant, s)[r.tag] for s in range(200) for r in pollutant.robots])
    for column, half in ((0, 1.44), (1, 1.14), (2, math.pi)):
        shares, _ = np.histogram(poses[:, column], bins=6, range=(-half, half))
        # Six standard deviations of a binomial count; the polluter's own place costs 0.1 %.
        assert np.all(np.abs(shares - 500) < 6 * math.sqrt(3000 / 6 * 5 / 6))


def test_placed_poses_are_kept_and_distributed_ones_keep_away(
    read_text: Read, example: str
) -> None:
    experiment = read_text(example)
    poses = place(experiment, 3)
    assert poses[23] == experiment.robots[0].pose
    assert poses[22] == experiment.objects[1].pose
    for robot in experiment.robots[1:]:
        for box in experiment.boxes:
            assert box_distance(box, poses[robot.tag]) >= BODY_RADIUS_M + MIN_GAP_M


def test_bodies_that_the_file_places_into_each_other_are_refused(
    read_text: Read, example: str
) -> None:
    experiment = read_text(example.replace('"0.5,-0.5,0"', '"0.05,0,0"'))
    with pytest.raises(ConfigError, match=r"x\.argos:29: 'epuck_23_30' overlaps with the body"):
        place(experiment, 1)
    experiment = read_text(example.replace('"0.5,-0.5,0"', '"1.05,0.5,0"'))
    with pytest.raises(ConfigError, match="overlaps with box 'crate'"):
        place(experiment, 1)


def test_bodies_that_touch_are_accepted(read_text: Read, example: str) -> None:
    place(read_text(example.replace('"0.5,-0.5,0"', '"0.07,0,0"')), 1)


def test_a_robot_without_room_is_refused_at_its_entity(read_text: Read, example: str) -> None:
    text = example.replace('max="1.4,1.1,0"', 'max="-1.3,-1.0,0"')
    with pytest.raises(ConfigError, match=r"x\.argos:36: <entity> max_trials: no room for 'swarm_"):
        for seed in range(5):
            place(read_text(text), seed)


def test_every_method_of_drawing(read_text: Read, example: str) -> None:
    text = example.replace(
        '"uniform" min="-1.4,-1.1,0" max="1.4,1.1,0"', '"gaussian" mean="0,0,0" std_dev="0.5,0.4,0"'
    ).replace('"gaussian" mean="0,0,0" std_dev="360,0,0"', '"constant" values="90,0,0"')
    poses = place(read_text(text), 1)
    assert all(poses[tag].yaw_rad == pytest.approx(math.pi / 2) for tag in (5, 6, 7))


@given(
    st.floats(-math.pi, math.pi),
    st.floats(-2, 2),
    st.floats(-2, 2),
    st.floats(-1, 1),
    st.floats(-1, 1),
)
def test_box_distance_agrees_with_the_nearest_of_many_points(
    yaw: float, x: float, y: float, box_x: float, box_y: float
) -> None:
    box = Box("b", (box_x, box_y, 0.0), (0.6, 0.4, 0.1), yaw, 1)
    u, v = np.meshgrid(np.linspace(-0.3, 0.3, 61), np.linspace(-0.2, 0.2, 41))
    px = box_x + u * math.cos(yaw) - v * math.sin(yaw)
    py = box_y + u * math.sin(yaw) + v * math.cos(yaw)
    nearest = np.hypot(px - x, py - y).min()
    distance = box_distance(box, Pose(x, y, 0.0))
    assert nearest - 0.0075 <= distance <= nearest + 1e-12
