"""What a camera made of its settings is told in the same words everywhere."""

from __future__ import annotations

import math

import pytest

from vsense.vision.cameras.source import absent, refused, said


@pytest.mark.parametrize(
    ("wanted", "got", "bounds", "text"),
    [
        (7.0, 7.0, None, None),
        (7, 7.0, (0.0, 10.0), None),
        (0.0, 0.0, (0.0, 10.0), None),
        (99.0, 99.0, (0.0, 10.0), None),
        (8000.0, 8000.007, None, None),
        (8000.0, 8000.009, None, "takes 8000.009 for x 8000"),
        (8000.4, 8000.0, None, "takes 8000 for x 8000.4"),
        (8000.4, 8000.0, (10.0, 1e7), "takes 8000 for x 8000.4"),
        (1e7, 2e6, (10.0, 2e6), "does not take x 10000000 (10 to 2000000): keeps 2000000"),
        (99.0, 7.0, (0.0, 10.0), "does not take x 99 (0 to 10): keeps 7"),
        (-1.0, 0.0, (0.0, 10.0), "does not take x -1 (0 to 10): keeps 0"),
        (0.0, 0.5, (0.0, 1.0), "takes 0.5 for x 0"),
        (30.0, 30000 / 1001, None, "takes 29.97003 for x 30"),
        (0.1, math.nan, None, "takes nan for x 0.1"),
        ("Mono8", "Mono8", None, None),
        ("Mono8", "BayerRG8", None, "does not take x Mono8: keeps BayerRG8"),
    ],
)
def test_a_value_read_back_is_told_where_it_is_another(
    wanted: float | str, got: float | str, bounds: tuple[float, float] | None, text: str | None
) -> None:
    assert said("x", wanted, got, bounds) == text


@pytest.mark.parametrize(
    ("kept", "bounds", "text"),
    [
        (None, None, "does not take gain_raw 99"),
        (7.0, None, "does not take gain_raw 99: keeps 7"),
        (None, (0.0, 10.5), "does not take gain_raw 99 (0 to 10.5)"),
    ],
)
def test_a_refusal_says_no_more_than_is_known(
    kept: float | None, bounds: tuple[float, float] | None, text: str
) -> None:
    assert refused("gain_raw", 99.0, kept, bounds) == text


def test_a_setting_that_is_not_there_is_told() -> None:
    assert absent("gain_raw") == "has no gain_raw"
