"""Spans found from readings that a formula of the test's own has made of Webots' table."""

from __future__ import annotations

import math

import numpy as np
import pytest

from vsense.tools.robot_calibration._sensor_fit import (
    BadReadings,
    WallLook,
    fit_ground,
    fit_proximity,
)
from vsense.world.robot_models import EPUCK

# The field sensorTable of Webots' E-puck.proto: distance [m], reading.
WEBOTS = [
    (0.0, 4095), (0.005, 2133), (0.01, 1466), (0.015, 601), (0.02, 384),
    (0.03, 235), (0.04, 158), (0.05, 120), (0.06, 104), (0.07, 67),
]  # fmt: skip
PLACES_DEG = [-17.2, -45.9, -90.0, -151.5, 151.5, 90.0, 45.8, 17.2]
PLACES_MM = [(30, -10), (22, -25), (0, -31), (-30, -15), (-30, 15), (0, 31), (22, 25), (30, 10)]
LOW = np.array([40.0, 67.0, 90.0, 120.0, 30.0, 67.0, 80.0, 10.0])
HIGH = np.array([1200.0, 1466.0, 1700.0, 1300.0, 1500.0, 1466.0, 1100.0, 1600.0])


def read(distance_m: float, sensor: int) -> float:
    """What a sensor with its span reads of a wall straight ahead."""
    share = (np.interp(distance_m, *zip(*WEBOTS)) - 67.0) / (1466.0 - 67.0)
    return float(LOW[sensor] + share * (HIGH[sensor] - LOW[sensor]))


def looks(wall_off_m: float = 0.0, bend: float = 1.0) -> list[WallLook]:
    """Turns at four distances, with 0.3 mm and 8 raw of noise; `bend` is another response."""
    random = np.random.default_rng(5)
    made = []
    for wall_m in (0.066, 0.056, 0.050, 0.046):
        for turn_rad in np.linspace(-math.pi, math.pi, 100, endpoint=False):
            raw = np.empty(8)
            for sensor, ((x_mm, y_mm), deg) in enumerate(zip(PLACES_MM, PLACES_DEG)):
                off = math.remainder(turn_rad + math.radians(deg), 2.0 * math.pi)
                forward = (x_mm * math.cos(turn_rad) - y_mm * math.sin(turn_rad)) / 1000.0
                away_m = (wall_m + wall_off_m - forward) / math.cos(off)
                sees = abs(off) < math.radians(30.0)
                raw[sensor] = read(away_m * bend, sensor) if sees else LOW[sensor]
            noisy = raw + random.normal(0.0, 8.0, 8)
            made.append(WallLook(wall_m + random.normal(0.0, 0.0003), turn_rad, noisy))
    return made


@pytest.mark.parametrize("wall_off_m", [0.0, 0.004, -0.003])
def test_spans_are_found_wherever_the_wall_stands(wall_off_m: float) -> None:
    found = fit_proximity(looks(wall_off_m), EPUCK)
    assert found.spans[:, 0] == pytest.approx(LOW, abs=4.0)
    assert found.spans[:, 1] == pytest.approx(HIGH, rel=0.03)
    assert found.error_m == pytest.approx(wall_off_m, abs=0.0003)
    off = np.abs(found.spans - np.array([LOW, HIGH]).T)
    assert (off < 4.0 * found.sigmas).all()


def broken(made: list[WallLook]) -> list[WallLook]:
    for look in made:
        look.raw[3] = 80.0
    return made


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (looks(0.012), r"\+1\d mm"),
        (broken(looks()), "ps3.*80.*80"),
        (looks()[:3], "ps0.*enough"),
        ([], "did not come"),
        (looks(bend=1.9), "does not read what a wall reflects|mm from where"),
    ],
)
def test_what_is_no_wall_is_said(made: list[WallLook], words: str) -> None:
    with pytest.raises(BadReadings, match=words):
        fit_proximity(made, EPUCK)


def test_ground_is_what_most_readings_say() -> None:
    black = [np.array([210.0, 200.0, 230.0])] * 9 + [np.array([880.0, 900.0, 910.0])]
    white = [np.array([880.0, 900.0, 910.0])] * 9
    assert fit_ground(black, white).spans.tolist() == [[210, 880], [200, 900], [230, 910]]
    with pytest.raises(BadReadings, match=r"left ground.*880.*880"):
        fit_ground(white, white)
    with pytest.raises(BadReadings, match="did not come"):
        fit_ground(black[:2], white)
