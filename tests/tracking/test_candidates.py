"""The search for candidates, on plain drawings."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vsense.tracking.candidates import CandidateSearch
from vsense.tracking.families import load_family

ARROW = load_family("arrow4x4")
SEARCH = CandidateSearch(ARROW)
PX_PER_MM = 0.68


def drawing(tag: int, x_px: float, y_px: float, turn_deg: float, floor: int = 110) -> np.ndarray:
    """Returns a 200 x 200 picture of a marker whose disc's centre is at (x_px, y_px)."""
    marker = ARROW.texture(tag, 2.0)
    turn = cv2.getRotationMatrix2D((marker.centre_px,) * 2, turn_deg, PX_PER_MM / 2.0)
    turn[:, 2] += (x_px - marker.centre_px, y_px - marker.centre_px)
    ink, cover = (
        cv2.warpAffine(
            cv2.GaussianBlur(layer, (0, 0), 1.5), turn, (200, 200), flags=cv2.INTER_LINEAR
        ).astype(float)
        for layer in (marker.ink, marker.coverage)
    )
    share = cover / 255.0
    return np.rint((30.0 + 0.65 * ink) * share + floor * (1.0 - share)).astype(np.uint8)


@given(
    st.sampled_from([31, 18425, 34415]),
    st.floats(60.0, 140.0),
    st.floats(60.0, 140.0),
    st.floats(0.0, 360.0),
    st.integers(20, 200),
)
@settings(max_examples=60)
def test_an_arrow_is_found_with_its_direction(
    tag: int, x_px: float, y_px: float, turn_deg: float, floor: int
) -> None:
    found = SEARCH.find(drawing(tag, x_px, y_px, turn_deg, floor), PX_PER_MM)
    assert len(found) == 1
    ahead = np.array([np.cos(np.radians(turn_deg)), -np.sin(np.radians(turn_deg))])
    offset = (ARROW.outline_centroid_mm - ARROW.disc_centre_mm)[0] * PX_PER_MM * ahead
    assert np.hypot(*(found["x_px"] - x_px - offset[0], found["y_px"] - y_px - offset[1])) < 1.5
    assert found["ahead_x"][0] * ahead[0] + found["ahead_y"][0] * ahead[1] > np.cos(np.radians(15))


@pytest.mark.parametrize("turn_deg", [0.0, 17.0, 45.0, 90.0])
def test_rectangles_and_ellipses_are_no_arrows(turn_deg: float) -> None:
    picture = np.full((300, 300), 200, np.uint8)
    box = cv2.boxPoints(((80.0, 80.0), (33.0, 24.0), turn_deg)).astype(np.int32)
    cv2.fillPoly(picture, [box], 30)
    cv2.ellipse(picture, (220, 220), (18, 13), turn_deg, 0, 360, 30, -1)
    assert len(SEARCH.find(picture, PX_PER_MM)) == 0


@pytest.mark.parametrize("scale", [0.5, 1.7])
def test_an_arrow_of_a_wrong_size_is_none(scale: float) -> None:
    picture = drawing(31, 100.0, 100.0, 30.0)
    assert len(SEARCH.find(picture, PX_PER_MM)) == 1
    assert len(SEARCH.find(picture, PX_PER_MM * scale)) == 0
