"""Camera views: pixels to places, and several cameras to one sighting."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from vsense.base.arena import DETECTION, UNNAMED, wrap_angle
from vsense.vision.cameras._camera_array import CameraArray
from vsense.vision.cameras.camera import Camera
from vsense.vision.tracking._views import (
    MERGE_M,
    VIEW,
    covariances,
    make_views,
    merge_views,
    place_markers,
)

LENS = (-0.12, 0.02, 0.0, 0.0, 0.0)
CAMERA = Camera.looking_down("a", 0.5, 0.2, 2.43, 1620.0, (1620, 1220), LENS)
SPREAD = (1e-7, 0.0, 0.0, 1e-7, 0.0, 1e-6)

angles = st.floats(-math.pi, math.pi)


@dataclass(frozen=True)
class Seen:
    """One view of a marker, in one picture."""

    tag: int = 1
    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float = 0.0
    capture_ns: int = 0
    weight: float = 1e6
    picture: int = 0
    covariance: tuple[float, ...] = SPREAD
    height_sensitivity: tuple[float, float] = (0.0, 0.0)


seen_views = st.builds(
    Seen,
    tag=st.integers(1, 3),
    x_m=st.floats(-0.04, 0.04),
    y_m=st.floats(-0.04, 0.04),
    yaw_rad=angles,
    capture_ns=st.integers(0, 10**6),
    weight=st.floats(1e5, 1e7),
    picture=st.integers(0, 3),
    height_sensitivity=st.tuples(st.floats(-1e-3, 1e-3), st.floats(-1e-3, 1e-3)),
)


def rows_of(seen: Sequence[Seen]) -> NDArray[np.void]:
    rows = np.zeros(len(seen), dtype=VIEW)
    for row, one in zip(rows, seen, strict=True):
        for name in VIEW.names or ():
            row[name] = 1 if name == "cameras" else getattr(one, name)
    return rows


def merge(*seen: Seen) -> NDArray[np.void]:
    return merge_views(rows_of(seen), np.array([one.picture for one in seen], dtype=np.intp))


def detections(*rows: tuple[int, float, float]) -> NDArray[np.void]:
    found = np.zeros(len(rows), dtype=DETECTION)
    for row, (tag, x_px, y_px) in zip(found, rows, strict=True):
        row["tag"], row["x_px"], row["y_px"] = tag, x_px, y_px
        row["covariance"] = np.diag((1e-7, 1e-7, 1e-6))
    return found


def place_views(
    found: NDArray[np.void], heights_m: dict[int, float], camera: Camera = CAMERA
) -> NDArray[np.void]:
    """Returns what one camera sees as views."""
    array = CameraArray([camera])
    return make_views(array, [700], place_markers(array, [0], [found], heights_m), 0.002)


def test_each_tag_is_placed_at_the_height_of_its_marker() -> None:
    heights = {1: 0.06, 2: 0.15}
    point = (0.9, -0.3)
    pixels = {tag: CAMERA.project(np.array([*point, height])) for tag, height in heights.items()}
    found = detections(*((tag, *pixel) for tag, pixel in pixels.items()))
    placed = place_views(found, heights)
    assert placed["tag"].tolist() == [1, 2]
    for view in placed:
        assert (view["x_m"], view["y_m"]) == pytest.approx((0.9, -0.3), abs=1e-9)
        assert view["capture_ns"] == 700 and view["cameras"] == 1


def test_unnamed_and_foreign_tags_are_left_out() -> None:
    found = detections((UNNAMED, 10.0, 10.0), (9, 20.0, 20.0))
    assert len(place_views(found, {1: 0.06})) == 0


def test_a_view_from_aside_weighs_less() -> None:
    found = detections((1, 809.5, 609.5), (2, 1600.0, 609.5))
    below, aside = place_views(found, {1: 0.06, 2: 0.06})["weight"]
    assert below > 3.0 * aside
    # Far from the border: the inverse of the picture's variance and the height's together.
    (view,) = place_views(detections((1, 1100.0, 609.5)), {1: 0.06})
    lean_m = np.hypot(*view["height_sensitivity"])
    assert 1.0 / view["weight"] == pytest.approx(1e-7 + lean_m**2) and lean_m > 2e-4


@given(st.lists(seen_views, max_size=8), st.randoms(use_true_random=False))
def test_merging_does_not_depend_on_the_order(seen: list[Seen], random: object) -> None:
    shuffled = list(seen)
    random.shuffle(shuffled)  # type: ignore[attr-defined]
    # As numbers: -0.0 is 0.0, and equal views may be sorted either way.
    one, other = merge(*seen), merge(*shuffled)
    assert all(np.array_equal(one[name], other[name]) for name in VIEW.names or ())


@given(st.lists(seen_views, max_size=8))
def test_merging_loses_no_view_and_merges_none_that_disagree(seen: list[Seen]) -> None:
    merged = merge(*seen)
    assert merged["tag"].tolist() == sorted(merged["tag"].tolist())
    assert set(merged["tag"].tolist()) == {view.tag for view in seen}
    for tag in set(merged["tag"].tolist()):
        places = merged[merged["tag"] == tag]
        same = [view for view in seen if view.tag == tag]
        assert places["cameras"].sum() == len(same)
        assert places["cameras"].max() <= len({view.picture for view in same})
        for x_m, y_m in zip(places["x_m"], places["y_m"], strict=True):
            assert any(math.hypot(x_m - v.x_m, y_m - v.y_m) <= MERGE_M for v in same)


def test_two_cameras_make_one_sighting_nearer_to_the_better_view() -> None:
    good = Seen(1, 0.0, 0.0, 0.1, 1000, 3e6, 0, SPREAD, (0.001, 0.0))
    poor = Seen(1, 0.004, 0.0, 0.3, 2000, 1e6, 1, SPREAD, (-0.001, 0.0))
    (merged,) = merge(poor, good)
    assert merged["x_m"] == pytest.approx(0.001)
    assert merged["yaw_rad"] == pytest.approx(0.15, abs=1e-3)
    assert merged["capture_ns"] == 1250
    assert merged["weight"] == 4e6 and merged["cameras"] == 2


def test_several_cameras_err_less_and_their_lean_cancels_between_them() -> None:
    left = Seen(height_sensitivity=(0.002, 0.0))
    right = Seen(picture=1, height_sensitivity=(-0.002, 0.001))
    (merged,) = merge(left, right)
    assert merged["covariance"] == pytest.approx([value / 2.0 for value in SPREAD])
    assert merged["height_sensitivity"] == pytest.approx((0.0, 0.0005))
    alone, both = covariances(np.array([rows_of([left])[0], merged]))
    assert alone[0, 0] == pytest.approx(1e-7 + 4e-6)
    assert both[0, 0] == pytest.approx(0.5e-7)
    assert both[1, 1] == pytest.approx(0.5e-7 + 0.25e-6)
    assert covariances(rows_of([])).shape == (0, 3, 3)


def test_a_wrong_height_shifts_a_view_as_its_lean_says() -> None:
    pixel = CAMERA.project(np.array((1.1, -0.4, 0.062)))
    (view,) = place_views(detections((1, *pixel)), {1: 0.060})
    off = view["x_m"] - 1.1, view["y_m"] + 0.4
    assert off == pytest.approx(-view["height_sensitivity"], rel=0.01)


def test_a_view_that_begins_at_the_border_pulls_nothing() -> None:
    """A robot drives into a second camera's picture: the merged place does not jump."""
    other = Camera.looking_down("b", 1.9, 0.2, 2.43, 1620.0, (1620, 1220), LENS)
    places = []
    for x_m in np.arange(0.6, 1.85, 0.005):
        both = []
        for camera, wrong_m in ((CAMERA, 0.0), (other, 0.004)):
            pixel = camera.project(np.array((x_m + wrong_m, 0.2, 0.06)))
            if camera.contains(pixel, 24.0):
                both.append(place_views(detections((1, *pixel)), {1: 0.06}, camera))
        (merged,) = merge_views(np.concatenate(both), np.arange(len(both)))
        places.append(merged["x_m"] - x_m)
    steps = np.abs(np.diff(places))
    assert places[0] == pytest.approx(0.0, abs=1e-6) and places[-1] == pytest.approx(
        0.004, abs=1e-6
    )
    assert steps.max() < 0.4e-3


def test_the_same_tag_twice_in_one_picture_is_never_merged() -> None:
    assert len(merge(Seen(), Seen(x_m=0.001))) == 2


def test_the_same_tag_at_two_places_is_never_merged() -> None:
    assert len(merge(Seen(), Seen(x_m=0.2, picture=1))) == 2


def test_a_tag_that_is_there_twice_spoils_no_other() -> None:
    """Two pairs of views of tag 1, each of one marker; tag 2 is seen by both cameras."""
    seen = [Seen(x_m=x_m, picture=picture) for picture in (0, 1) for x_m in (0.0, 0.3)]
    merged = merge(*seen, Seen(2, picture=0), Seen(2, x_m=0.01, picture=1))
    assert merged["tag"].tolist() == [1, 1, 2] and merged["cameras"].tolist() == [2, 2, 2]
    assert merged["x_m"] == pytest.approx([0.0, 0.3, 0.005])


@given(angles, st.floats(-0.2, 0.2))
def test_iridia_defect_10_headings_are_averaged_across_180_degrees(
    yaw_rad: float, apart_rad: float
) -> None:
    one = Seen(yaw_rad=float(wrap_angle(yaw_rad)))
    other = Seen(yaw_rad=float(wrap_angle(yaw_rad + apart_rad)), picture=1)
    (merged,) = merge(one, other)
    middle = yaw_rad + apart_rad / 2.0
    assert float(wrap_angle(merged["yaw_rad"] - middle)) == pytest.approx(0.0, abs=1e-9)
