"""The picture of a campaign: every setting and measure has its place, whatever the numbers."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from vsense.sim.comparison import BOX, DOT, draw, round_marks

finite = st.floats(-1e9, 1e9)


@given(finite, finite)
def test_marks_are_round_and_enclose_all(one: float, other: float) -> None:
    low, high = sorted((one, other))
    marks = round_marks(low, high)
    step = marks[1] - marks[0]
    assert marks[0] <= low + 1e-6 * step and marks[-1] >= high - 1e-6 * step
    assert 2 <= len(marks) <= 9
    np.testing.assert_allclose(np.diff(marks), step, rtol=1e-6)
    assert f"{step:.0e}"[0] in "125"


@settings(max_examples=15)
@given(
    st.integers(1, 5),
    st.lists(
        st.lists(st.lists(finite, max_size=6), min_size=5, max_size=5), min_size=1, max_size=5
    ),
)
def test_any_numbers_are_drawn(rows: int, table) -> None:
    settings_ = [{"sensor.noise": str(row), "light.position": "0,0,1"} for row in range(rows)]
    measures = {f"measure_{i}": some[:rows] for i, some in enumerate(table)}
    image = draw("it", settings_, measures)
    assert image.dtype == np.uint8 and image.ndim == 3
    assert image.min() < 80, "something is written"


def reds(image: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    return np.argwhere((np.abs(image.astype(int) - colour) < 40).all(axis=2))


def test_a_dot_lies_where_its_value_is() -> None:
    """The same setting twice, once with small and once with large values."""
    image = draw("it", [{"a.b": "1"}, {"a.b": "2"}], {"m": [[0.0], [10.0]]})
    dots = reds(image, DOT)
    upper, lower = (
        dots[dots[:, 0] < np.median(dots[:, 0])],
        dots[dots[:, 0] > np.median(dots[:, 0])],
    )
    assert 200 < lower[:, 1].mean() - upper[:, 1].mean() < 320
    assert len(reds(image, BOX)) > 0
