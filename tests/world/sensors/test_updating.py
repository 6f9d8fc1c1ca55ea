"""Updating conditions: how they are spelt, and when they hold."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from tests.world.sensors.scenes import element, mount
from vsense.base.errors import ConfigError
from vsense.world.sensors import quality
from vsense.world.sensors.quality import ALWAYS, Scale, Updating

PLAIN = SimpleNamespace(name="x")
OWN = SimpleNamespace(name="x", changed=lambda sent, fresh: fresh[:, 0] > sent[:, 0])


def condition(attributes: str, sensor: SimpleNamespace = PLAIN) -> tuple[Updating, int]:
    return quality.updating_from_xml(element(f"<s {attributes}/>"), sensor, 1)


def test_spellings() -> None:
    assert condition("") == (ALWAYS, 1)
    assert condition('vs:update="always"') == (ALWAYS, 1)
    assert condition('vs:update="every:7"') == (ALWAYS, 7)
    assert condition('vs:update="change"') == (Updating("change"), 1)
    assert condition('vs:update="threshold:0.25"') == (Updating("threshold", 0.25), 1)
    assert condition("", OWN) == (Updating("own"), 1)
    assert condition('vs:update="own"', OWN) == (Updating("own"), 1)
    assert condition('vs:update="always"', OWN) == (ALWAYS, 1)


def test_mounted_sensors_have_their_condition_and_period() -> None:
    mounted = mount('<gps_virtual_sensor vs:update="threshold:0.1" vs:update_every="4"/>')
    assert mounted.updating == Updating("threshold", 0.1)
    assert mounted.quality.update_every == 4
    assert mount('<gps_virtual_sensor vs:update="every:4"/>').quality.update_every == 4


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("sometimes", "'sometimes' is not 'always', 'change'"),
        ("threshold", "'threshold' is not 'always'"),
        ("threshold:", "threshold '': expected a number above 0"),
        ("threshold:0", "threshold '0': expected a number above 0"),
        ("threshold:-1", "threshold '-1': expected a number above 0"),
        ("threshold:nan", "threshold 'nan': expected a number above 0"),
        ("threshold:1e308", "threshold '1e308': expected a number above 0"),
        ("every:0", "every '0': expected a whole number from 1"),
        ("every:1.5", "every '1.5': expected a whole number from 1"),
        ("own", "the sensor 'x' has no condition of its own"),
    ],
)
def test_wrong_ones_are_refused(text: str, words: str) -> None:
    with pytest.raises(ConfigError, match="x.argos:1: <s> vs:update: " + words):
        condition(f'vs:update="{text}"')


def test_two_periods_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"same .*'vs:update_every'"):
        condition('vs:update="every:2" vs:update_every="2"')


def due(condition: Updating, sent: list[float], fresh: list[float], scale: Scale) -> list[bool]:
    column = np.array([sent]).T, np.array([fresh]).T
    return condition.due(OWN, scale, *column).tolist()


def test_when_they_hold() -> None:
    sent, fresh, scale = [1.0, 1.0, 1.0, 1.0], [1.0, 1.05, 1.5, 0.5], Scale()
    assert due(ALWAYS, sent, fresh, scale) == [True] * 4
    assert due(Updating("change"), sent, fresh, scale) == [False, True, True, True]
    assert due(Updating("threshold", 0.5), sent, fresh, scale) == [False, False, True, True]
    assert due(Updating("own"), sent, fresh, scale) == [False, True, True, False]


def test_a_threshold_is_in_the_sensors_unit_and_any_change_of_a_count_matters() -> None:
    threshold = Updating("threshold", 0.1)
    assert due(threshold, [0.0, 0.0], [9.0, 10.0], Scale(unit=100.0)) == [False, True]
    assert due(threshold, [1.0, 1.0], [1.0, 2.0], Scale(unit=0.0)) == [False, True]


def test_defect_10_angles_are_compared_across_half_a_turn() -> None:
    sent, fresh = [math.pi - 0.01] * 2, [-math.pi + 0.01, -math.pi + 0.2]
    assert due(Updating("threshold", 0.1), sent, fresh, Scale(wraps=True)) == [False, True]


def test_one_number_is_enough() -> None:
    sent, fresh = np.zeros((2, 3)), np.array([[0, 0, 0], [0, 0, 1.0]])
    assert Updating("change").due(PLAIN, Scale(), sent, fresh).tolist() == [False, True]


def test_bytes_are_compared_as_numbers() -> None:
    sent, fresh = np.array([[250]], np.uint8), np.array([[3]], np.uint8)
    assert Updating("threshold", 200.0).due(PLAIN, Scale(), sent, fresh).tolist() == [True]
    assert Updating("threshold", 250.0).due(PLAIN, Scale(), sent, fresh).tolist() == [False]
