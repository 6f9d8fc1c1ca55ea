"""Camera views: pixels to places, and several cameras to one sighting."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.arena import DETECTION, UNNAMED, Frame, wrap_angle
from vsense.cameras.camera import Camera
from vsense.tracking.views import (
    MERGE_M,
    Sighting,
    covariances,
    make_views,
    merge_views,
    place_markers,
)

LENS = (-0.12, 0.02, 0.0, 0.0, 0.0)
CAMERA = Camera.looking_down("a", 0.5, 0.2, 2.43, 1620.0, (1620, 1220), LENS)
FRAME = Frame("a", np.zeros((1220, 1620), np.uint8), 7, 700, 800)

SPREAD = (1e-7, 0.0, 0.0, 1e-7, 0.0, 1e-6)

angles = st.floats(-math.pi, math.pi)
views = st.builds(
    Sighting,
    tag=st.integers(1, 3),
    x_m=st.floats(-0.04, 0.04),
    y_m=st.floats(-0.04, 0.04),
    yaw_rad=angles,
    capture_ns=st.integers(0, 10**6),
    weight=st.floats(1e5, 1e7),
    cameras=st.sampled_from([("a",), ("b",), ("c",), ("d",)]),
    covariance=st.just(SPREAD),
    height_sensitivity=st.tuples(st.floats(-1e-3, 1e-3), st.floats(-1e-3, 1e-3)),
)


def detections(*rows: tuple[int, float, float]) -> np.ndarray:
    found = np.zeros(len(rows), dtype=DETECTION)
    for row, (tag, x_px, y_px) in zip(found, rows, strict=True):
        row["tag"], row["x_px"], row["y_px"] = tag, x_px, y_px
        row["covariance"] = np.diag((1e-7, 1e-7, 1e-6))
    return found


def place_views(
    frame: Frame,
    camera: Camera,
    found: np.ndarray,
    heights_m: dict[int, float],
    doubt_m: float = 0.002,
) -> list[Sighting]:
    """Returns what one camera sees as sightings."""
    return make_views(frame, camera, place_markers(camera, found, heights_m), doubt_m)


def test_each_tag_is_placed_at_the_height_of_its_marker() -> None:
    heights = {1: 0.06, 2: 0.15}
    point = (0.9, -0.3)
    pixels = {tag: CAMERA.project(np.array([*point, height])) for tag, height in heights.items()}
    found = detections(*((tag, *pixel) for tag, pixel in pixels.items()))
    placed = place_views(FRAME, CAMERA, found, heights)
    assert [view.tag for view in placed] == [1, 2]
    for view in placed:
        assert (view.x_m, view.y_m) == pytest.approx((0.9, -0.3), abs=1e-9)
        assert view.capture_ns == 700 and view.cameras == ("a",)


def test_unnamed_and_foreign_tags_are_left_out() -> None:
    found = detections((UNNAMED, 10.0, 10.0), (9, 20.0, 20.0))
    assert place_views(FRAME, CAMERA, found, {1: 0.06}) == []


def test_a_view_from_aside_weighs_less() -> None:
    below, aside = place_views(
        FRAME, CAMERA, detections((1, 809.5, 609.5), (2, 1600.0, 609.5)), {1: 0.06, 2: 0.06}
    )
    assert below.weight > 3.0 * aside.weight


@given(st.lists(views, max_size=8), st.randoms(use_true_random=False))
def test_merging_does_not_depend_on_the_order(seen: list[Sighting], random: object) -> None:
    shuffled = list(seen)
    random.shuffle(shuffled)  # type: ignore[attr-defined]
    assert merge_views(seen) == merge_views(shuffled)


@given(st.lists(views, max_size=8))
def test_merging_loses_no_view_and_merges_none_that_disagree(seen: list[Sighting]) -> None:
    merged = merge_views(seen)
    assert set(merged) == {view.tag for view in seen}
    for tag, places in merged.items():
        same = [view for view in seen if view.tag == tag]
        assert sum(len(place.cameras) for place in places) == len(same)
        for place in places:
            assert len(set(place.cameras)) == len(place.cameras)
            assert any(
                math.hypot(place.x_m - view.x_m, place.y_m - view.y_m) <= MERGE_M for view in same
            )


def test_two_cameras_make_one_sighting_nearer_to_the_better_view() -> None:
    good = Sighting(1, 0.0, 0.0, 0.1, 1000, 3e6, ("a",), SPREAD, (0.001, 0.0))
    poor = Sighting(1, 0.004, 0.0, 0.3, 2000, 1e6, ("b",), SPREAD, (-0.001, 0.0))
    (merged,) = merge_views([poor, good])[1]
    assert merged.x_m == pytest.approx(0.001)
    assert merged.yaw_rad == pytest.approx(0.15, abs=1e-3)
    assert merged.capture_ns == 1250
    assert merged.weight == 4e6 and merged.cameras == ("a", "b")


def test_several_cameras_err_less_and_their_lean_cancels_between_them() -> None:
    left = Sighting(1, 0.0, 0.0, 0.0, 0, 1e6, ("a",), SPREAD, (0.002, 0.0))
    right = replace(left, cameras=("b",), height_sensitivity=(-0.002, 0.001))
    (merged,) = merge_views([left, right])[1]
    assert merged.covariance == pytest.approx([value / 2.0 for value in SPREAD])
    assert merged.height_sensitivity == pytest.approx((0.0, 0.0005))
    alone, both = covariances([left, merged])
    assert alone[0, 0] == pytest.approx(1e-7 + 4e-6)
    assert both[0, 0] == pytest.approx(0.5e-7)
    assert both[1, 1] == pytest.approx(0.5e-7 + 0.25e-6)
    assert covariances([]).shape == (0, 3, 3)


def test_a_wrong_height_shifts_a_view_as_its_lean_says() -> None:
    pixel = CAMERA.project(np.array((1.1, -0.4, 0.062)))
    (view,) = place_views(FRAME, CAMERA, detections((1, *pixel)), {1: 0.060}, 0.002)
    assert (view.x_m - 1.1, view.y_m + 0.4) == pytest.approx(
        (-view.height_sensitivity[0], -view.height_sensitivity[1]), rel=0.01
    )


def test_a_view_that_begins_at_the_border_pulls_nothing() -> None:
    """A robot drives into a second camera's picture: the merged place does not jump."""
    other = Camera.looking_down("b", 1.9, 0.2, 2.43, 1620.0, (1620, 1220), LENS)
    places = []
    for x_m in np.arange(0.6, 1.85, 0.005):
        both = []
        for camera, wrong_m in ((CAMERA, 0.0), (other, 0.004)):
            pixel = camera.project(np.array((x_m + wrong_m, 0.2, 0.06)))
            if camera.contains(pixel, 24.0):
                frame = replace(FRAME, camera=camera.id)
                both += place_views(frame, camera, detections((1, *pixel)), {1: 0.06})
        (merged,) = merge_views(both)[1]
        places.append(merged.x_m - x_m)
    steps = np.abs(np.diff(places))
    assert places[0] == pytest.approx(0.0, abs=1e-6) and places[-1] == pytest.approx(
        0.004, abs=1e-6
    )
    assert steps.max() < 0.4e-3


def test_the_same_tag_twice_in_one_picture_is_never_merged() -> None:
    one = Sighting(1, 0.0, 0.0, 0.0, 0, 1e6, ("a",), SPREAD, (0.0, 0.0))
    assert len(merge_views([one, replace(one, x_m=0.001)])[1]) == 2


def test_the_same_tag_at_two_places_is_never_merged() -> None:
    one = Sighting(1, 0.0, 0.0, 0.0, 0, 1e6, ("a",), SPREAD, (0.0, 0.0))
    assert len(merge_views([one, replace(one, x_m=0.2, cameras=("b",))])[1]) == 2


@given(angles, st.floats(-0.2, 0.2))
def test_iridia_defect_10_headings_are_averaged_across_180_degrees(
    yaw_rad: float, apart_rad: float
) -> None:
    one = Sighting(1, 0.0, 0.0, float(wrap_angle(yaw_rad)), 0, 1e6, ("a",), SPREAD, (0.0, 0.0))
    other = replace(one, yaw_rad=float(wrap_angle(yaw_rad + apart_rad)), cameras=("b",))
    (merged,) = merge_views([one, other])[1]
    middle = yaw_rad + apart_rad / 2.0
    assert float(wrap_angle(merged.yaw_rad - middle)) == pytest.approx(0.0, abs=1e-9)
