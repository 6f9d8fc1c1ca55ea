"""The quality settings: what they do to numbers, and that noise is what it says."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.base.errors import ConfigError
from vsense.base.xml.parsing import parse
from vsense.world.sensors.quality import (
    Delay,
    Distortion,
    Quality,
    QualityError,
    Scale,
    generator,
)

UNIT = Scale(low=0.0, high=1.0)
PLAIN = Scale()
ROBOTS = 4000


def quality(attributes: str, scale: Scale = UNIT) -> Quality:
    xml = f'<r xmlns:vs="urn:vsense:1"><s {attributes}/></r>'.encode()
    element = parse(xml, "x.argos").child("s")
    read = Quality.from_xml(element, scale)
    element.check_all_read()
    return read


def distorted(
    settings: Quality, values: Any, scale: Scale = PLAIN, time_s: float = 0.0, seed: int = 1
) -> Any:
    """Distorts one robot's numbers, or those of many."""
    numbers = np.atleast_2d(np.asarray(values, dtype=float))
    made = Distortion(settings, scale, *numbers.shape)
    every = np.ones(len(numbers), dtype=bool)
    return made.apply(numbers, every, time_s, generator(seed, "test"))


def test_without_settings_a_device_is_perfect() -> None:
    assert quality("") == Quality()
    assert not Quality().distorts
    values = np.array([[0.1, -5.0, 1e30]])
    assert np.array_equal(distorted(Quality(), values), values)


def test_every_setting_is_read_from_its_attribute() -> None:
    read = quality(
        'noise_level="0.1" noise_std_dev="0.2" vs:bias="-0.3" vs:drift="0.4" vs:low="0.05"'
        ' vs:high="0.9" vs:bits="8" vs:latency="2" vs:drop_out="0.5" vs:update_every="3"'
    )
    assert read == Quality(0.1, 0.2, -0.3, 0.4, 0.05, 0.9, 8, 2, 0.5, 3)


@pytest.mark.parametrize(
    ("setting", "least", "most"),
    [
        ("noise_level", 0.0, 1e6),
        ("noise_std_dev", 0.0, 1e6),
        ("bias", -1e6, 1e6),
        ("drift_per_s", -1e6, 1e6),
        ("bits", 0, 24),
        ("latency", 0, 1000),
        ("drop_out", 0.0, 1.0),
        ("update_every", 1, 100_000),
    ],
)
def test_a_setting_is_changed_within_its_bounds(setting: str, least: float, most: float) -> None:
    for value in (least, most):
        assert getattr(Quality().changed(setting, value, UNIT), setting) == value
    beyond = 1 if isinstance(least, int) else 1e-6
    for value in (least - beyond, most + beyond):
        with pytest.raises(QualityError, match=f"{setting} is "):
            Quality().changed(setting, value, UNIT)


@pytest.mark.parametrize(
    ("attributes", "words"),
    [
        ('noise_level="-0.1"', "noise_level: -0.1 is out of range"),
        ('noise_level="nan"', "noise_level: 'nan' is not a number"),
        ('noise_std_dev="1e308"', "noise_std_dev: 1e308 is out of range"),
        ('vs:bits="0"', "vs:bits: 0 is out of range, expected 1 to 24"),
        ('vs:bits="8.5"', "vs:bits: '8.5' is not a whole number"),
        ('vs:latency="-1"', "vs:latency: -1 is out of range"),
        ('vs:drop_out="1.01"', "vs:drop_out: 1.01 is out of range"),
        ('vs:update_every="0"', "vs:update_every: 0 is out of range"),
        ('vs:low="1" vs:high="1"', "vs:high: 1 is not above 'vs:low' 1"),
        ('vs:low="1.5"', "vs:low: 1.5 is above all that the device can give"),
        ('vs:high="-0.5"', "vs:high: -0.5 is below all that the device can give"),
    ],
)
def test_a_wrong_setting_is_refused_with_its_place(attributes: str, words: str) -> None:
    with pytest.raises(ConfigError, match="x.argos:1: <s> " + words):
        quality(attributes)


def test_resolution_needs_bounds_to_divide() -> None:
    with pytest.raises(ConfigError, match=r"vs:bits:.*'vs:low'.*'vs:high'"):
        quality('vs:bits="8"', PLAIN)
    assert quality('vs:bits="8" vs:low="-1" vs:high="1"', PLAIN).bits == 8
    angle_and_count = Scale(unit=(1.0, 0.0), wraps=(True, False))
    assert quality('vs:bits="8"', angle_and_count).bits == 8


def test_uniform_noise() -> None:
    noise = distorted(Quality(noise_level=0.3), np.zeros((ROBOTS, 3)))
    assert np.abs(noise).max() <= 0.3
    assert np.abs(noise).max() > 0.299
    assert abs(noise.mean()) < 5 * 0.3 / math.sqrt(3 * noise.size)
    assert noise.std() == pytest.approx(0.3 / math.sqrt(3), rel=0.02)
    counts, _ = np.histogram(noise, 10, (-0.3, 0.3))
    expected = noise.size / 10
    # Chi squared with 9 degrees of freedom: 27.9 is its 99.9th percentile.
    assert ((counts - expected) ** 2 / expected).sum() < 27.9


def test_gaussian_noise() -> None:
    noise = distorted(Quality(noise_std_dev=0.2), np.zeros((ROBOTS, 3)))
    assert abs(noise.mean()) < 5 * 0.2 / math.sqrt(noise.size)
    assert noise.std() == pytest.approx(0.2, rel=0.02)
    within = [np.mean(np.abs(noise) < k * 0.2) for k in (1, 2, 3)]
    assert within == pytest.approx([0.6827, 0.9545, 0.9973], abs=0.012)


def test_noise_of_robots_numbers_devices_and_seeds_is_independent() -> None:
    settings, zeros = Quality(noise_std_dev=1.0), np.zeros((ROBOTS, 2))
    first = distorted(settings, zeros)
    others = [first[:, 1], np.roll(first[:, 0], 1), distorted(settings, zeros, seed=2)[:, 0]]
    random = generator(1, "another")
    every = np.ones(ROBOTS, dtype=bool)
    others.append(Distortion(settings, PLAIN, *zeros.shape).apply(zeros, every, 0.0, random)[:, 0])
    for other in others:
        assert abs(np.corrcoef(first[:, 0], other)[0, 1]) < 5 / math.sqrt(ROBOTS)


def test_the_noise_of_a_robot_does_not_depend_on_who_else_is_seen() -> None:
    made, again = (Distortion(Quality(noise_level=1.0), PLAIN, 3, 2) for _ in range(2))
    every = made.apply(np.zeros((3, 2)), np.array([True] * 3), 0.0, generator(5, "x"))
    last = again.apply(np.zeros((1, 2)), np.array([False, False, True]), 0.0, generator(5, "x"))
    assert np.array_equal(every[2:], last)


def test_the_same_seed_gives_the_same_noise() -> None:
    settings = Quality(noise_level=0.1, noise_std_dev=0.2)
    assert np.array_equal(*(distorted(settings, np.zeros((5, 2)), seed=7) for _ in range(2)))


def test_bias_and_drift_are_added_in_the_devices_unit() -> None:
    settings = Quality(bias=0.5, drift_per_s=-0.01)
    scale = Scale(unit=(1.0, 100.0, 0.0))
    assert distorted(settings, [1, 2, 3], scale).tolist() == [[1.5, 52.0, 3.0]]
    later = distorted(settings, [1, 2, 3], scale, time_s=20.0)
    assert later[0].tolist() == pytest.approx([1.3, 32.0, 3.0])
    # Nothing drifts before the run.
    assert distorted(settings, [1, 2, 3], scale, time_s=-20.0).tolist() == [[1.5, 52.0, 3.0]]


def test_saturation_is_the_narrower_of_the_devices_and_the_users() -> None:
    values = [-0.5, 0.2, 0.5, 0.8, 7.0]
    assert distorted(Quality(bias=0.0, noise_level=0.0), values, UNIT)[0, -1] == 1.0
    narrow = distorted(Quality(low=0.3, high=0.6), values, UNIT)
    assert narrow.tolist() == [[0.3, 0.3, 0.5, 0.6, 0.6]]
    wide = distorted(Quality(low=-9.0, high=9.0), values, UNIT)
    assert wide.tolist() == [[0.0, 0.2, 0.5, 0.8, 1.0]]
    raw = Scale(unit=4095.0, low=0.0, high=4095.0)
    assert distorted(Quality(high=0.5), [100.0, 4000.0], raw).tolist() == [[100.0, 2047.5]]


def test_noise_is_added_before_the_clip() -> None:
    noisy = distorted(Quality(noise_level=0.5), np.full((ROBOTS, 1), 1.0), UNIT)
    assert noisy.max() == 1.0
    assert np.mean(noisy == 1.0) == pytest.approx(0.5, abs=0.05)


@given(st.integers(1, 12), st.floats(0, 1))
def test_resolution_rounds_to_the_nearest_of_its_steps(bits: int, value: float) -> None:
    got = float(distorted(Quality(bits=bits), [value], UNIT)[0, 0])
    steps = np.linspace(0.0, 1.0, 2**bits)
    assert np.abs(steps - got).min() < 1e-12
    assert abs(got - value) <= 0.5 / (2**bits - 1) + 1e-12


def test_one_bit_tells_less_from_more() -> None:
    assert distorted(Quality(bits=1), [0.0, 0.49, 0.51, 1.0], UNIT).tolist() == [[0, 0, 1, 1]]


def test_resolution_divides_what_saturation_leaves() -> None:
    got = distorted(Quality(low=0.2, high=0.5, bits=2), [0.0, 0.31, 0.38, 0.9], UNIT)
    assert got == pytest.approx(np.array([[0.2, 0.3, 0.4, 0.5]]))


ANGLE = Scale(wraps=True)


@given(st.floats(-math.pi, math.pi), st.floats(-10, 10))
def test_defect_10_an_angle_with_a_bias_stays_within_half_a_turn(angle: float, bias: float) -> None:
    got = float(distorted(Quality(bias=bias), [angle], ANGLE)[0, 0])
    assert -math.pi < got <= math.pi
    assert math.cos(got - angle - bias) == pytest.approx(1.0, abs=1e-9)


def test_the_resolution_of_an_angle_divides_the_turn_and_has_no_seam() -> None:
    eighth = math.pi / 4
    angles = [math.pi - 0.1, -math.pi + 0.1, 0.3, -0.3, eighth * 1.4]
    got = distorted(Quality(bits=3), angles, ANGLE)
    assert got == pytest.approx(np.array([[math.pi, math.pi, 0.0, 0.0, eighth]]))


def test_saturation_leaves_angles_alone() -> None:
    scale = Scale(wraps=(True, False))
    assert distorted(Quality(high=1.0), [3.0, 3.0], scale).tolist() == [[3.0, 1.0]]


def test_what_is_no_measurement_stays_exact() -> None:
    settings = Quality(0.1, 0.2, 0.3, 0.4, 0.1, 0.9, 3)
    scale = Scale(unit=(0.0, 1.0), low=0.0, high=1.0)
    assert distorted(settings, [17.0, 0.5], scale)[0, 0] == 17.0


@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.floats(0, 1e6), st.floats(-1e30, 1e30))
def test_numbers_stay_finite_and_within_the_devices_bounds(
    bias: float, drift: float, noise: float, value: float
) -> None:
    settings = Quality(noise, noise, bias, drift)
    assert np.isfinite(distorted(settings, [value], PLAIN, 1e6)).all()
    assert 0.0 <= float(distorted(settings, [value], UNIT, 1e6)[0, 0]) <= 1.0


@given(st.integers(0, 5), st.lists(st.integers(), max_size=12))
def test_a_delay_gives_everything_once_and_in_order(timesteps: int, things: list[int]) -> None:
    delay: Delay[int | None] = Delay(timesteps, None)
    out = [delay.push(thing) for thing in things]
    assert out == ([None] * timesteps + things)[: len(things)]
