"""The arena's types and angles."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.arena import POSE, ArenaState, wrap_angle


@given(st.floats(-50.0, 50.0))
def test_iridia_defect_10_angles_are_wrapped_into_one_turn(angle_rad: float) -> None:
    wrapped = float(wrap_angle(angle_rad))
    assert -math.pi < wrapped <= math.pi
    assert math.cos(wrapped - angle_rad) == pytest.approx(1.0)


def test_half_a_turn_is_plus_pi() -> None:
    assert wrap_angle(np.array([-math.pi, math.pi, 3 * math.pi])).tolist() == [math.pi] * 3


def test_a_state_has_no_duplicates_unless_told() -> None:
    state = ArenaState(3, 300, np.zeros(0, dtype=POSE), 0)
    assert state.duplicates == () and state.unnamed == 0
