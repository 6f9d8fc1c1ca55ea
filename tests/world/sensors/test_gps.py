"""GPS: place and heading."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest

from tests.world.sensors.scenes import STEP_NS, mount, read, sensor, world_of
from vsense.world.sensors.bank import SensorBank

XML = "<gps_virtual_sensor/>"


def test_place_and_heading_are_those_that_the_cameras_see() -> None:
    places = {1: (1.5, -2.25, math.pi), 2: (0.0, 0.0, -3.0)}
    assert read(sensor(XML), places) == [list(places[1]), list(places[2])]
    sent = SensorBank([mount(XML)], [1, 2]).encode(world_of(places), 0)
    assert sent[1] == [(struct.pack("<3f", 1.5, -2.25, math.pi), STEP_NS)]


def test_defect_10_a_noisy_heading_stays_within_half_a_turn() -> None:
    tags = range(1000)
    world = world_of(dict.fromkeys(tags, (0.0, 0.0, math.pi - 0.01)))
    sent = SensorBank([mount('<gps_virtual_sensor noise_std_dev="0.1"/>')], tags).encode(world, 0)
    read_back = np.array([struct.unpack("<3f", sent[tag][0][0]) for tag in tags])
    heading = read_back[:, 2].astype(np.float64)
    assert np.abs(heading).max() <= np.float32(math.pi)
    assert (heading > 0).mean() == pytest.approx(0.54, abs=0.08)
    off = np.angle(np.exp(1j * (heading - math.pi + 0.01)))
    assert off.std() == pytest.approx(0.1, rel=0.1)
    assert read_back[:, :2].std() == pytest.approx(0.1, rel=0.1)
