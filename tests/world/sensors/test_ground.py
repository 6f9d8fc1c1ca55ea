"""The ground sensor: three grey values, left to right."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.world.sensors.scenes import STEP_NS, mount, read, sensor, world_of
from vsense.world.entities import Zone
from vsense.world.fields import Floor
from vsense.world.sensors.bank import SensorBank


def spot(x: float, y: float, color: tuple[int, int, int], radius: float = 0.005) -> Zone:
    return Zone(f"{x}{y}", "circle", x, y, radius_m=radius, color=color)


@pytest.mark.parametrize(
    ("color", "grey"),
    [
        ((255, 255, 255), 1.0),
        ((0, 0, 0), 0.0),
        ((255, 0, 0), 0.299),
        ((0, 255, 0), 0.587),
        ((0, 0, 255), 0.114),
        ((100, 150, 200), (0.299 * 100 + 0.587 * 150 + 0.114 * 200) / 255),
    ],
)
def test_grey_is_the_weighted_sum_of_the_colours(color: tuple[int, int, int], grey: float) -> None:
    (reading,) = read(sensor("<virtual_ground_sensor/>"), {1: (0, 0, 0)}, floor=Floor(color=color))
    assert reading == pytest.approx([grey] * 3, abs=1e-12)
    assert max(reading) <= 1.0


@pytest.mark.parametrize("yaw_deg", [0.0, 90.0, 180.0, -135.0])
def test_left_centre_and_right_look_where_they_sit_on_the_robot(yaw_deg: float) -> None:
    yaw = math.radians(yaw_deg)
    spots = []
    for left, level in ((0.009, 51), (0.0, 102), (-0.009, 153)):
        x = 1.0 + 0.03 * math.cos(yaw) - left * math.sin(yaw)
        y = -0.5 + 0.03 * math.sin(yaw) + left * math.cos(yaw)
        spots.append(spot(x, y, (level, level, level), 0.004))
    (reading,) = read(sensor("<virtual_ground_sensor/>"), {1: (1.0, -0.5, yaw)}, spots)
    assert reading == pytest.approx([0.2, 0.4, 0.6])


def test_the_floors_picture_has_its_last_row_at_the_lowest_y() -> None:
    picture = np.zeros((2, 2, 3), np.uint8)
    picture[1, 1] = 255
    floor = Floor(picture, (2.0, 2.0))
    places = {1: (0.5, -0.5, 0.0), 2: (0.5, 0.5, 0.0), 3: (-0.5, -0.5, 0.0), 4: (9.0, -9.0, 0.0)}
    readings = read(sensor("<virtual_ground_sensor/>"), places, floor=floor)
    assert [round(reading[1], 9) for reading in readings] == [1, 0, 0, 1]


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
