"""The picture kernel through its Python seam: against ground truth, the camera's own model, and
pictures of any bytes in any shape. The same in C runs under the sanitizers: `tests/c/test_scan.c`.
"""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from tests.vision.markers.texture import draw_texture
from tests.vision.tracking.synthetic import HEIGHT_M, Look, Robot, render
from vsense.base.native import kernel_ffi
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import load_family
from vsense.vision.tracking._kernel import MARKER, Kernel

ARROW = load_family("arrow4x4")
LENS = (-0.12, 0.02, 0.001, -0.002, 0.003)
SIZE = (480, 360)
SMALL = Camera.looking_down("small", 0.0, 0.0, 2.43, 1620.0, SIZE, LENS)
CORNER = Camera.looking_down("corner", -0.95, -0.65, 2.43, 1620.0, (1620, 1220), LENS)
KERNEL = Kernel(ARROW)
TRUTH = Robot(18425, 0.0, 0.0, 0.7)
PICTURE = render(CORNER, ARROW, [TRUTH], Look(litter=0), seed=2)


def tilted(lean_rad: float) -> Camera:
    """Returns a camera 2.4 m away from the origin that looks at it under an angle."""
    c, s = np.cos(lean_rad), np.sin(lean_rad)
    rotation = (1.0, 0.0, 0.0, 0.0, -c, -s, 0.0, s, -c)
    return Camera(
        "tilted", *SIZE, 1620.0, 1620.0, 239.5, 179.5, LENS, rotation, (0.0, -2.4 * s, 2.4 * c)
    )


def drawing(tag: int, x_px: float, y_px: float, turn_deg: float, floor: int) -> np.ndarray:
    """Returns a 200 x 200 picture of a marker whose disc's centre is at (x_px, y_px)."""
    px_per_mm = 0.68
    marker = draw_texture(ARROW, tag, 2.0)
    turn = cv2.getRotationMatrix2D((marker.centre_px,) * 2, turn_deg, px_per_mm / 2.0)
    turn[:, 2] += (x_px - marker.centre_px, y_px - marker.centre_px)
    ink, cover = (
        cv2.warpAffine(
            cv2.GaussianBlur(layer, (0, 0), 1.5), turn, (200, 200), flags=cv2.INTER_LINEAR
        ).astype(float)
        for layer in (marker.ink, marker.coverage)
    )
    share = cover / 255.0
    return np.rint((30.0 + 0.65 * ink) * share + floor * (1.0 - share)).astype(np.uint8)


FLAT = Camera.looking_down("flat", 0.0, 0.0, 2.0 + HEIGHT_M, 1360.0, (200, 200))


@given(
    st.sampled_from([31, 18425, 34415]),
    st.floats(60.0, 140.0),
    st.floats(60.0, 140.0),
    st.floats(-179.0, 179.0),
    st.integers(20, 200),
)
@settings(max_examples=60)
def test_an_arrow_is_found_with_its_pose(
    tag: int, x_px: float, y_px: float, turn_deg: float, floor: int
) -> None:
    (found,) = KERNEL.search(drawing(tag, x_px, y_px, turn_deg, floor), FLAT, HEIGHT_M)
    assert (found["x_px"], found["y_px"]) == pytest.approx((x_px, y_px), abs=0.25)
    yaw = np.arctan2(found["ahead_y"], found["ahead_x"])
    assert np.cos(yaw - np.radians(turn_deg)) > np.cos(np.radians(1.0))
    bits = (found["cell"][:16] > 0.5) == ARROW.bits(tag).ravel()
    assert bits.all()


@pytest.mark.parametrize("turn_deg", [0.0, 17.0, 45.0, 90.0])
def test_rectangles_and_ellipses_are_no_arrows(turn_deg: float) -> None:
    picture = np.full((200, 200), 200, np.uint8)
    box = cv2.boxPoints(((60.0, 60.0), (33.0, 24.0), turn_deg)).astype(np.int32)
    cv2.fillPoly(picture, [box], 30)
    cv2.ellipse(picture, (140, 140), (18, 13), turn_deg, 0, 360, 30, -1)
    assert len(KERNEL.search(picture, FLAT, HEIGHT_M)) == 0


@pytest.mark.parametrize("focal_px", [800.0, 2700.0])
def test_an_arrow_of_a_wrong_size_is_none(focal_px: float) -> None:
    picture = drawing(31, 100.0, 100.0, 30.0, 110)
    camera = Camera.looking_down("other", 0.0, 0.0, 2.0 + HEIGHT_M, focal_px, (200, 200))
    assert len(KERNEL.search(picture, FLAT, HEIGHT_M)) == 1
    assert len(KERNEL.search(picture, camera, HEIGHT_M)) == 0


@pytest.mark.parametrize("lean_deg", [-35.0, 0.0, 20.0, 35.0])
def test_a_camera_may_look_aslant(lean_deg: float) -> None:
    camera = tilted(np.radians(lean_deg))
    spots = ((-0.15, 0.0, 0.3), (0.0, 0.08, 2.0), (0.14, -0.07, -1.2))
    robots = [Robot(31, x, y, yaw) for x, y, yaw in spots]
    found = KERNEL.search(render(camera, ARROW, robots, Look(litter=0)), camera, HEIGHT_M)
    found = np.sort(found, order="x_m")
    assert np.stack((found["x_m"], found["y_m"]), 1) == pytest.approx(
        np.array(spots)[:, :2], abs=3e-4
    )


@given(
    st.floats(-0.002, 0.002),
    st.floats(-0.002, 0.002),
    st.floats(-0.15, 0.15),
)
@settings(max_examples=50)
def test_a_known_marker_is_followed_in_the_picture_s_corner(
    x_m: float, y_m: float, turn_rad: float
) -> None:
    poses = np.array([(0.3, 0.2, 0.0), (x_m, y_m, TRUTH.yaw_rad + turn_rad)])
    found, origin = KERNEL.follow(PICTURE, CORNER, HEIGHT_M, poses)
    assert origin.tolist() == [1]
    assert (found["x_m"][0], found["y_m"][0]) == pytest.approx((0.0, 0.0), abs=2e-4)
    yaw = np.arctan2(found["ahead_y"][0], found["ahead_x"][0])
    assert yaw == pytest.approx(TRUTH.yaw_rad, abs=0.01)
    assert found["scale"][0] == pytest.approx(1.0, abs=0.01)
    assert found["coverage"][0] > 0.95 and found["residual_m"][0] < 2e-4


def test_windows_find_what_is_in_them_once() -> None:
    robots = [Robot(31, -0.1, 0.0, 0.0), Robot(1843, 0.1, 0.05, 3.0)]
    picture = render(SMALL, ARROW, robots, Look(litter=0))
    everywhere = KERNEL.search(picture, SMALL, HEIGHT_M)
    left = np.array([(-50, -50, SIZE[0] // 2, SIZE[1] + 50)], dtype=np.int32)
    (found,) = KERNEL.search(picture, SMALL, HEIGHT_M, left)
    assert found["x_m"] == pytest.approx(-0.1, abs=1e-3)
    both = np.array([(0, 0, *SIZE), (10, 10, *SIZE), (600, 0, 700, 90)], dtype=np.int32)
    again = KERNEL.search(picture, SMALL, HEIGHT_M, both)
    assert np.sort(again["x_m"]) == pytest.approx(np.sort(everywhere["x_m"]), abs=1e-5)


def test_rows_may_lie_apart_in_memory() -> None:
    picture = render(SMALL, ARROW, [Robot(31, 0.0, 0.0, 1.0)], Look(litter=0))
    wide = np.zeros((SIZE[1], SIZE[0] + 77), dtype=np.uint8)
    wide[:, 13 : 13 + SIZE[0]] = picture
    plain = KERNEL.search(picture, SMALL, HEIGHT_M)
    for view in (wide[:, 13 : 13 + SIZE[0]], np.asfortranarray(picture), picture[::-1][::-1]):
        assert KERNEL.search(view, SMALL, HEIGHT_M).tobytes() == plain.tobytes()


@given(
    arrays.arrays(np.uint8, st.tuples(st.integers(1, 90), st.integers(1, 90))),
    st.integers(-3, 3),
)
@settings(max_examples=80)
def test_any_picture_gives_markers_or_none(picture: np.ndarray, turn: int) -> None:
    found = KERNEL.search(picture, SMALL, HEIGHT_M)
    assert np.isfinite(found["x_m"]).all()
    poses = np.array([(0.0, 0.0, float(turn)), (1e9, -1e9, 0.0)])
    KERNEL.follow(picture, SMALL, HEIGHT_M, poses)


def test_a_picture_with_too_much_in_it_is_counted() -> None:
    kernel = Kernel(ARROW)
    noise = np.random.default_rng(1).integers(0, 256, (1220, 1620), dtype=np.uint8)
    kernel.search(noise, CORNER, HEIGHT_M)
    assert kernel.overflows == 1
    kernel.search(PICTURE, CORNER, HEIGHT_M)
    assert kernel.overflows == 1


@pytest.mark.parametrize("camera", [CORNER, tilted(0.4)], ids=lambda camera: camera.id)
def test_the_lens_is_the_camera_s(camera: Camera) -> None:
    middle = camera.to_plane(np.array([camera.width_px / 2, camera.height_px / 2]), HEIGHT_M)
    far = 0.3 * camera.width_px / 1620.0
    robots = [
        Robot(31, middle[0] + x * far, middle[1] + y * far, x + 3.0 * y)
        for x in (-1.0, 0.0, 1.0)
        for y in (-1.0, 0.0, 1.0)
    ]
    found = KERNEL.search(render(camera, ARROW, robots, Look(litter=0)), camera, HEIGHT_M)
    assert len(found) == len(robots)
    places = np.stack((found["x_m"], found["y_m"], np.full(len(found), HEIGHT_M)), axis=1)
    expected = camera.project(places)
    np.testing.assert_allclose(np.stack((found["x_px"], found["y_px"]), 1), expected, atol=1e-6)


def test_the_marker_s_layout_is_that_of_c() -> None:
    assert MARKER.itemsize == kernel_ffi.sizeof("struct vs_marker")
    for name, field in kernel_ffi.typeof("struct vs_marker").fields:
        assert MARKER.fields is not None and MARKER.fields[name][1] == field.offset


def test_textured_ground_of_12_megapixels_is_scanned_to_the_last_row() -> None:
    """With the tables of a picture of two megapixels the rows further down were not scanned."""
    wide, high = 4000, 3000
    texture = np.random.default_rng(4).standard_normal((high, wide)).astype(np.float32)
    texture = cv2.GaussianBlur(texture, (0, 0), 2.4)
    image = np.clip(130.0 + 25.0 / texture.std() * texture, 0, 255).astype(np.uint8)
    camera = Camera.looking_down("wide", 0.0, 0.0, 2.43, 4000.0, (wide, high))
    last = Camera.looking_down("last", 0.0, -0.75, 2.43, 4000.0, SIZE)
    part = render(last, ARROW, [Robot(TRUTH.tag, 0.0, -0.75, 0.7)], Look(litter=0), seed=2)
    # The small camera's picture, where the large one shows the same ground.
    x, y = np.rint(camera.project(np.array([0.0, -0.75, HEIGHT_M]))).astype(int)
    ground = image[y - 180 : y + 180, x - 240 : x + 240]
    ground[60:300, 120:360] = part[60:300, 120:360]
    kernel = Kernel(ARROW)
    assert len(kernel.search(PICTURE, CORNER, HEIGHT_M)) == 1
    rows = kernel.search(image, camera, HEIGHT_M)
    assert kernel.overflows == 0
    apart = np.hypot(rows["x_m"], rows["y_m"] + 0.75)
    assert apart.min() < 0.001
    assert len(kernel.search(PICTURE, CORNER, HEIGHT_M)) == 1
