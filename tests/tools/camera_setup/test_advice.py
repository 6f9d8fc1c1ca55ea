"""One line of advice: the first thing to do, and never what would make it worse."""

from __future__ import annotations

import re

import numpy as np
import pytest

from vsense.tools.camera_setup._advice import (
    GOOD_BLUR_CELLS,
    Brightness,
    ExposureReading,
    PictureScale,
    advise,
    rounded,
)
from vsense.vision.markers.families import load_family
from vsense.vision.tracking.marker_detector import cell_width

CELL_M = 0.0053


def reading(
    exposure_us: float | None = 10_000.0,
    light: float = 205.0,
    mean: float = 110.0,
    saturated: float = 0.0,
    noise: float | None = 2.5,
    px_per_m: float | None = 667.0,
    speed_m_s: float = 0.13,
    gain: float | None = 4.0,
) -> ExposureReading:
    counts = np.zeros(256, np.int64)
    shown = Brightness(counts, mean, 30.0, light, saturated, 0.0)
    scale = None if px_per_m is None else PictureScale(px_per_m, "test")
    width = None if px_per_m is None else cell_width(load_family("arrow4x4"), px_per_m)
    return ExposureReading(exposure_us, gain, shown, noise, speed_m_s, scale, CELL_M, width)


def test_a_good_picture_needs_nothing() -> None:
    assert advise(reading()) == "good: nothing to change"


def test_blur_is_what_robots_lose_their_numbers_by() -> None:
    text = advise(reading(exposure_us=40_000.0))
    assert text == (
        "blur 3.5 px: above 2.8 px cells of 3.5 px are lost; exposure 20000 us would give 1.7 px,"
        " then raise gain or light"
    )


def test_blur_that_was_measured_as_harmless_is_not_told() -> None:
    """Exposures of 20 ms were read without a fault. Source: reference/tracking.md, section 2."""
    assert not reading(exposure_us=20_000.0).is_blurred
    assert reading(exposure_us=30_000.0, px_per_m=377.0, speed_m_s=0.2).is_blurred


def test_too_much_light_is_told_before_blur() -> None:
    text = advise(reading(exposure_us=40_000.0, saturated=0.2))
    assert text == "20.0 % is saturated: less gain, or exposure 20000 us"
    assert advise(reading(saturated=0.2, gain=0.0)).endswith("saturated: exposure 5000 us")
    assert advise(reading(None, saturated=0.2)).endswith("less gain or exposure")


def test_dim_light_takes_exposure_as_far_as_blur_allows_and_then_gain() -> None:
    text = advise(reading(exposure_us=5_000.0, light=100.0, mean=40.0))
    assert text.startswith("dim: the lightest 1 % is at 100 of 255")
    assert text.endswith("; exposure 10000 us (blur 0.9 px)")
    text = advise(reading(exposure_us=5_000.0, light=20.0, mean=14.0))
    assert text.endswith("; exposure 20000 us (blur 1.7 px), then gain")
    assert advise(reading(exposure_us=20_300.0, light=100.0)).endswith(
        "more gain, or better more lamps"
    )


def test_a_covered_lens_is_asked_about() -> None:
    assert "is the lens open?" in advise(reading(mean=3.0, light=5.0))


def test_noise_comes_from_gain() -> None:
    assert "noise 8.0: above 6 numbers are misread; less gain" in advise(reading(noise=8.0))


@pytest.mark.parametrize("exposure_us", [None, 8_000.0])
@pytest.mark.parametrize("px_per_m", [None, 500.0])
@pytest.mark.parametrize("light", [3.0, 100.0, 210.0])
@pytest.mark.parametrize("saturated", [0.0, 0.5])
@pytest.mark.parametrize("noise", [None, 9.0])
def test_there_is_always_one_line(
    exposure_us: float | None,
    px_per_m: float | None,
    light: float,
    saturated: float,
    noise: float | None,
) -> None:
    given = reading(exposure_us, light, light / 2, saturated, noise, px_per_m)
    text = advise(given)
    assert text and "\n" not in text
    for told in re.findall(r"exposure (\d+) us", text):
        assert float(told) * 1e-6 * 0.13 <= GOOD_BLUR_CELLS * CELL_M, "it would blur"


def test_robots_that_stand_still_are_never_blurred() -> None:
    assert advise(reading(exposure_us=900_000.0, speed_m_s=0.0)) == "good: nothing to change"


@pytest.mark.parametrize(
    ("given", "expected"), [(20384.6, 20000.0), (9999.0, 9900.0), (87.0, 87.0), (5.4, 5.0)]
)
def test_exposures_are_round_and_never_longer(given: float, expected: float) -> None:
    assert rounded(given) == expected


def test_cells_that_cannot_be_read_come_first_and_small_ones_last() -> None:
    assert advise(reading(px_per_m=150.0, saturated=0.5)).startswith(
        "the cells of arrow4x4, 5.3 mm, are 0.8 px wide: expected at least 1 px, and 2 px"
    )
    assert "saturated" in advise(reading(px_per_m=300.0, saturated=0.5))
    assert "are 1.6 px wide" in advise(reading(px_per_m=300.0))
