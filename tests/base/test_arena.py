"""The arena's types and angles."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.base.arena import IMAGE_POSE, POSE, ArenaState, wrap_angle


@given(st.floats(-50.0, 50.0))
def test_iridia_defect_10_angles_are_wrapped_into_one_turn(angle_rad: float) -> None:
    wrapped = float(wrap_angle(angle_rad))
    assert -math.pi < wrapped <= math.pi
    assert math.cos(wrapped - angle_rad) == pytest.approx(1.0)


def test_half_a_turn_is_plus_pi() -> None:
    assert wrap_angle(np.array([-math.pi, math.pi, 3 * math.pi])).tolist() == [math.pi] * 3
    hair = np.nextafter(math.pi, 4.0)
    assert wrap_angle(np.array([hair, -hair])).tolist() == [math.pi] * 2


def test_a_camera_s_state_is_what_that_camera_sees() -> None:
    """Thesis, 2.2: GetCameraState."""
    images = np.zeros(3, dtype=IMAGE_POSE)
    images["tag"], images["camera"] = (5, 5, 9), (0, 1, 1)
    state = ArenaState(3, 300, np.zeros(0, dtype=POSE), 2, cameras=("a", "b", "c"), images=images)
    assert state.camera_state("a")["tag"].tolist() == [5]
    assert state.camera_state("b")["tag"].tolist() == [5, 9]
    assert len(state.camera_state("c")) == 0
    with pytest.raises(KeyError, match="d"):
        state.camera_state("d")


def test_a_state_has_no_duplicates_unless_told() -> None:
    state = ArenaState(3, 300, np.zeros(0, dtype=POSE), 0)
    assert state.duplicates == () and state.unnamed == 0
