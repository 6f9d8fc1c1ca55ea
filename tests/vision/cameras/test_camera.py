"""The camera model against OpenCV's and against itself."""

from __future__ import annotations

import dataclasses
import json

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.vision.cameras.camera import Camera, CameraError

LENS = (-0.12, 0.02, 0.0, 0.0, 0.0)
OVERHEAD = Camera.looking_down("c", 0.4, -0.2, 2.43, 1620.0, (1620, 1220), LENS)


@st.composite
def cameras(draw: st.DrawFn) -> Camera:
    """Cameras above the arena that look about downwards through a common lens."""
    tilt = np.array([draw(st.floats(-0.3, 0.3)) for _ in range(3)])
    turn = cv2.Rodrigues(tilt)[0] @ np.diag([1.0, -1.0, -1.0])
    small = st.floats(-0.002, 0.002)
    return Camera(
        id="drawn",
        width_px=1620,
        height_px=1220,
        fx_px=draw(st.floats(1400.0, 1800.0)),
        fy_px=draw(st.floats(1400.0, 1800.0)),
        cx_px=draw(st.floats(780.0, 840.0)),
        cy_px=draw(st.floats(580.0, 640.0)),
        distortion=(draw(st.floats(-0.15, 0.05)), 0.02, draw(small), draw(small), 0.0),
        rotation=tuple(turn.ravel().tolist()),
        position_m=(draw(st.floats(-2.0, 2.0)), draw(st.floats(-2.0, 2.0)), 2.43),
    )


pixels = st.tuples(st.floats(0.0, 1619.0), st.floats(0.0, 1219.0))


@given(cameras(), pixels, st.floats(0.0, 0.2))
def test_a_pixel_goes_to_the_plane_and_back(
    camera: Camera, pixel: tuple[float, float], height_m: float
) -> None:
    ground = camera.to_plane(np.array([pixel]), height_m)
    point = np.column_stack((ground, [height_m]))
    assert camera.project(point)[0] == pytest.approx(pixel, abs=1e-5)


@given(cameras(), st.lists(pixels, min_size=1, max_size=5))
def test_it_projects_as_opencv_does(camera: Camera, spots: list[tuple[float, float]]) -> None:
    ground = camera.to_plane(np.array(spots), 0.06)
    points = np.column_stack((ground, np.full(len(spots), 0.06)))
    matrix = np.array(
        [[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1.0]]
    )
    # The points are turned here: a rotation vector is too coarse close to half a turn.
    seen = (points - camera.position_m) @ np.reshape(camera.rotation, (3, 3)).T
    still = np.zeros(3)
    theirs = cv2.projectPoints(seen, still, still, matrix, np.array(camera.distortion))[0]
    assert camera.project(points) == pytest.approx(theirs.reshape(-1, 2), abs=1e-6)


def test_looking_down_keeps_right_right_and_up_up() -> None:
    middle, right, up = OVERHEAD.project(
        np.array([[0.4, -0.2, 0.0], [0.5, -0.2, 0.0], [0.4, -0.1, 0.0]])
    )
    assert middle == pytest.approx((809.5, 609.5))
    assert right[0] > middle[0] and right[1] == pytest.approx(middle[1])
    assert up[1] < middle[1] and up[0] == pytest.approx(middle[0])


def test_points_may_come_in_any_shape_and_with_a_height_each() -> None:
    grid = np.stack(np.meshgrid([100.0, 800.0], [50.0, 600.0, 1100.0]), axis=-1)
    assert OVERHEAD.to_plane(grid, 0.0).shape == (3, 2, 2)
    assert OVERHEAD.to_plane(np.zeros((0, 2)), 0.0).shape == (0, 2)
    assert OVERHEAD.project(np.zeros((0, 3))).shape == (0, 2)
    each = OVERHEAD.to_plane(np.array([[10.0, 10.0], [10.0, 10.0]]), np.array([0.0, 0.06]))
    assert each[0] == pytest.approx(OVERHEAD.to_plane(np.array([10.0, 10.0]), 0.0))
    assert each[1] == pytest.approx(OVERHEAD.to_plane(np.array([10.0, 10.0]), 0.06))


def test_contains_counts_whole_pixels() -> None:
    spots = np.array([[-0.4, 0.0], [-0.6, 0.0], [1619.4, 1219.4], [1619.4, 1219.6]])
    assert OVERHEAD.contains(spots).tolist() == [True, False, True, False]
    assert OVERHEAD.contains(np.array([[3.0, 50.0]]), 4.0).tolist() == [False]


@given(cameras())
def test_a_camera_file_gives_the_camera_back(camera: Camera) -> None:
    assert Camera.from_json(camera.to_json()) == camera


@pytest.mark.parametrize(
    ("name", "value", "complaint"),
    [
        ("fx_px", "wide", "'wide'"),
        ("fx_px", 0.0, "focal length"),
        ("width_px", -1, "size"),
        ("distortion", [0.0] * 4, "distortion"),
        ("distortion", None, "NoneType"),
        ("rotation", [1.0] * 9, "rotation"),
        ("position_m", [0.0, float("nan"), 1.0], "position_m"),
    ],
)
def test_a_bad_value_is_named(name: str, value: object, complaint: str) -> None:
    values = dataclasses.asdict(OVERHEAD) | {name: value}
    with pytest.raises(CameraError, match=complaint):
        Camera.from_json(json.dumps(values))


def test_a_file_has_the_time_of_a_row_where_the_shutter_rolls() -> None:
    rolling = dataclasses.replace(OVERHEAD, row_time_s=-2e-5)
    assert Camera.from_json(rolling.to_json()) == rolling != OVERHEAD
    assert "row_time_s" not in OVERHEAD.to_json()
    values = json.loads(rolling.to_json()) | {"row_time_s": 0.02}
    with pytest.raises(CameraError, match=r"camera c: row_time_s: 0\.02: expected up to 0\.2 s"):
        Camera.from_json(json.dumps(values))


def test_a_missing_value_and_broken_text_are_named() -> None:
    values = dataclasses.asdict(OVERHEAD)
    del values["cy_px"]
    with pytest.raises(CameraError, match=r"cy_px.*missing"):
        Camera.from_json(json.dumps(values))
    with pytest.raises(CameraError, match="line 2"):
        Camera.from_json("{\n oops")
    with pytest.raises(CameraError):
        Camera.from_json("[]")
