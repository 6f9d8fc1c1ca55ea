"""The RGB ground sensor: the colour under the robot."""

from __future__ import annotations

import numpy as np

from tests.world.sensors.scenes import STEP_NS, mount, read, sensor, world_of
from vsense.world.entities import Zone
from vsense.world.fields import Floor
from vsense.world.sensors.bank import SensorBank

XML = "<virtual_rgb_ground_sensor/>"


def test_defect_8_red_and_blue_arrive_in_their_places() -> None:
    spot = Zone("spot", "circle", 1.0, 1.0, radius_m=0.1, color=(200, 100, 50))
    places = {1: (1.0, 1.05, 0.0), 2: (1.0, 1.15, 0.0)}
    assert read(sensor(XML), places, [spot]) == [[200, 100, 50, 255], [255, 255, 255, 255]]
    world = world_of(places, [spot])
    sent = SensorBank([mount(XML)], [1, 2]).encode(world, 0)
    assert sent[1] == [(bytes([200, 100, 50, 255]), STEP_NS)]


def test_alpha_is_that_of_the_picture() -> None:
    picture = np.array([[[1, 2, 3, 4]]], np.uint8)
    floor = Floor(picture, (2.0, 2.0))
    assert read(sensor(XML), {1: (0.3, 0.3, 0)}, floor=floor) == [[1, 2, 3, 4]]


def test_noise_is_a_share_of_the_whole_range_and_leaves_alpha_alone() -> None:
    noisy = mount('<virtual_rgb_ground_sensor noise_level="0.1"/>')
    floor = Floor(np.array([[[128, 128, 128, 9]]], np.uint8))
    tags = range(2000)
    world = world_of(dict.fromkeys(tags, (0.0, 0.0, 0.0)), floor=floor)
    sent = SensorBank([noisy], tags).encode(world, 0)
    colors = np.array([list(sent[tag][0][0]) for tag in tags])
    assert (colors[:, 3] == 9).all()
    assert (colors[:, :3].min(), colors[:, :3].max()) == (103, 153)
