"""Arena poses put back into the pictures."""

from __future__ import annotations

import numpy as np
import pytest

from vsense.arena import POSE
from vsense.tracking.camera import Camera
from vsense.tracking.image_poses import ImagePoses

LENS = (-0.1, 0.02, 0.0, 0.0, 0.0)
LEFT = Camera.looking_down("left", -1.0, 0.0, 2.5, 800.0, (640, 480), LENS)
RIGHT = Camera.looking_down("right", 1.0, 0.0, 2.5, 800.0, (640, 480), LENS)


def poses(*robots: tuple[int, float, float, float]) -> np.ndarray:
    """Returns POSE rows of robots (tag, x, y, yaw)."""
    rows = np.zeros(len(robots), dtype=POSE)
    for row, robot in zip(rows, robots):
        row["tag"], row["x_m"], row["y_m"], row["yaw_rad"] = robot
    return rows


def test_a_robot_is_where_its_camera_sees_its_marker() -> None:
    found = ImagePoses([LEFT, RIGHT], {5: 0.06})(poses((5, -0.7, 0.2, 0.0)))
    assert found[0, :2] == pytest.approx(LEFT.project(np.array([[-0.7, 0.2, 0.06]]))[0])


@pytest.mark.parametrize(("yaw", "degrees"), [(0.0, 0.0), (np.pi / 2, 90.0), (-np.pi / 2, -90.0)])
def test_the_angle_is_the_one_in_the_picture(yaw: float, degrees: float) -> None:
    found = ImagePoses([LEFT], {5: 0.06})(poses((5, -1.0, 0.0, yaw)))
    assert found[0, 2] == pytest.approx(degrees, abs=0.01)


@pytest.mark.parametrize("yaw", [np.pi, -np.pi])
def test_half_a_turn_has_one_name(yaw: float) -> None:
    turn = ImagePoses([LEFT], {5: 0.06})(poses((5, -1.0, 0.0, yaw)))[0, 2]
    assert abs(turn) == pytest.approx(180.0, abs=0.01) and turn > -180.0


def test_of_two_pictures_the_one_that_shows_it_nearer_to_the_middle_counts() -> None:
    find = ImagePoses([LEFT, RIGHT], {5: 0.06, 6: 0.0})
    found = find(poses((5, -0.1, 0.0, 0.0), (6, 0.1, 0.0, 0.0), (7, 9.0, 0.0, 0.0)))
    assert found[0, 0] > 320.0 > found[1, 0]
    assert np.isfinite(found).all()


def test_no_robots_have_no_poses() -> None:
    assert ImagePoses([LEFT], {})(poses()).shape == (0, 3)
