"""Brightness and noise of pictures that were made so."""

from __future__ import annotations

import numpy as np
import pytest

from vsense.tools.camera_setup._advice import brightness, noise


def flat(level: float, sigma: float, seed: int, shape: tuple[int, int] = (240, 320)) -> np.ndarray:
    drawn = np.random.default_rng(seed).normal(level, sigma, shape)
    return np.clip(np.rint(drawn), 0, 255).astype(np.uint8)


def test_brightness_of_known_levels() -> None:
    image = np.full((100, 100), 100, np.uint8)
    image[:3] = 255
    image[3:5] = 0
    light = brightness(image)
    assert light.saturated == 0.03 and light.black == 0.02
    assert light.mean == pytest.approx(0.95 * 100 + 0.03 * 255)
    assert (light.dark, light.light) == (0.0, 255.0)
    assert light.counts.sum() == image.size


def test_percentiles_are_those_of_the_picture() -> None:
    image = np.tile(np.arange(200, dtype=np.uint8), (200, 1))
    light = brightness(image)
    assert light.dark == pytest.approx(np.percentile(image, 1), abs=1)
    assert light.light == pytest.approx(np.percentile(image, 99), abs=1)


@pytest.mark.parametrize("sigma", [1.0, 2.5, 6.0])
def test_noise_is_the_sensors(sigma: float) -> None:
    assert noise(flat(100, sigma, 1), flat(100, sigma, 2)) == pytest.approx(sigma, rel=0.1)


def test_a_robot_that_drives_is_no_noise() -> None:
    first, second = flat(100, 2.0, 1), flat(100, 2.0, 2)
    first[50:110, 60:120], second[50:110, 70:130] = 20, 20
    assert noise(first, second) == pytest.approx(2.0, rel=0.1)


def test_a_lamp_that_flickers_is_no_noise() -> None:
    assert noise(flat(100, 2.0, 1), flat(112, 2.0, 2)) == pytest.approx(2.0, rel=0.1)


def test_clipped_parts_tell_nothing_of_noise() -> None:
    first, second = flat(100, 3.0, 1), flat(100, 3.0, 2)
    first[:200], second[:200] = 255, 255
    assert noise(first, second) == pytest.approx(3.0, rel=0.15)
    white = np.full((64, 64), 255, np.uint8)
    assert noise(white, white) is None


def test_pictures_that_cannot_be_compared() -> None:
    assert noise(flat(9, 1, 1, (8, 8)), flat(9, 1, 1, (8, 8))) is None
    assert noise(flat(9, 1, 1, (64, 64)), flat(9, 1, 1, (64, 80))) is None
