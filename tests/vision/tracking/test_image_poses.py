"""Arena poses put back into the pictures."""

from __future__ import annotations

import numpy as np
import pytest

from vsense.base.arena import DETECTION, POSE, UNNAMED
from vsense.vision.cameras._camera_array import CameraArray
from vsense.vision.cameras.camera import Camera
from vsense.vision.tracking._views import image_poses, place_markers
from vsense.vision.tracking.camera_tracking import ImagePoses

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


def test_what_a_camera_sees_is_kept_as_it_was_seen() -> None:
    found = np.zeros(4, dtype=DETECTION)
    found["tag"] = 9, UNNAMED, 5, 77
    place = np.array((-0.7, 0.2, 0.06))
    found["x_px"][2], found["y_px"][2] = LEFT.project(place)
    found["yaw_rad"] = 1.0
    both, heights_m = CameraArray([RIGHT, LEFT]), {5: 0.06, 9: 0.0}
    images = image_poses(both, place_markers(both, [0, 1], [found[:0], found], heights_m))
    assert images["tag"].tolist() == [5, 9] and images["camera"].tolist() == [1, 1]
    assert (images["x_m"][0], images["y_m"][0]) == pytest.approx((-0.7, 0.2), abs=1e-9)
    assert (images["x_px"][0], images["y_px"][0]) == (found["x_px"][2], found["y_px"][2])
    # In the middle of the picture the heading is that of the arena, aside the lens bends it.
    assert images["yaw_px_rad"][0] == pytest.approx(1.0, abs=0.02)
    best = ImagePoses([LEFT], {5: 0.06})(poses((5, -0.7, 0.2, 1.0)))
    assert np.degrees(images["yaw_px_rad"][0]) == pytest.approx(best[0, 2])
    assert len(image_poses(both, place_markers(both, [0], [found[:0]], {}))) == 0


def test_robots_that_join_have_their_height() -> None:
    find = ImagePoses([LEFT], {5: 0.06})
    find.learn({5: 0.06, 8: 0.5})
    seen = find(poses((8, -0.7, 0.2, 0.0)))[0, :2]
    assert seen == pytest.approx(LEFT.project(np.array((-0.7, 0.2, 0.5))))


def test_no_robots_have_no_poses() -> None:
    assert ImagePoses([LEFT], {})(poses()).shape == (0, 3)
