"""The floor's colours: ARGoS's pixels, zones over them, and the arena's symmetries."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.world.entities import WorldError, Zone
from vsense.world.fields import Floor

IMAGE = np.random.default_rng(4).integers(0, 256, (6, 8, 3), dtype=np.uint8)
"""6 rows, 8 columns."""


@given(st.floats(-2, 2, exclude_max=True), st.floats(-1.5, 1.5, exclude_max=True))
def test_a_point_has_the_pixel_that_argos_gives_it(x: float, y: float) -> None:
    """Column floor((x + size_x/2) width/size_x); rows likewise, from the bottom row."""
    floor = Floor(IMAGE, (4.0, 3.0))
    column, up = math.floor((x + 2.0) * (8 / 4.0)), math.floor((y + 1.5) * (6 / 3.0))
    expected = IMAGE[5 - min(up, 5), min(column, 7)]
    assert floor.sample([(x, y)])[0].tolist() == [*expected, 255.0]


def test_corners_and_what_lies_outside() -> None:
    floor = Floor(IMAGE, (4.0, 3.0))
    top_left, bottom_right = IMAGE[0, 0], IMAGE[5, 7]
    sampled = floor.sample([(-1.99, 1.49), (-9, 9), (1.99, -1.49), (1e6, -1e6)])[:, :3]
    assert sampled.tolist() == [list(p) for p in (top_left, top_left, bottom_right, bottom_right)]


def test_alpha_is_the_pictures_or_full() -> None:
    image = np.dstack((IMAGE, np.full((6, 8), 7, dtype=np.uint8)))
    assert Floor(image, (4, 3)).sample([(0.1, 0.1)])[0, 3] == 7.0
    assert Floor(IMAGE, (4, 3)).sample([(0.1, 0.1)])[0, 3] == 255.0
    assert Floor(color=(1, 2, 3)).sample([(5, 5)]).tolist() == [[1.0, 2.0, 3.0, 255.0]]
    assert Floor().sample(np.zeros((0, 2))).shape == (0, 4)


@given(st.integers(0, 3), st.booleans())
def test_a_floor_moved_with_its_points_looks_the_same(quarters: int, mirrored: bool) -> None:
    points = np.random.default_rng(2).uniform(-1.4, 1.4, (300, 2))
    image = np.random.default_rng(3).integers(0, 256, (12, 12, 3), dtype=np.uint8)
    zones = [
        Zone("a", "circle", 0.5, 0.2, radius_m=0.4, color=(9, 0, 0)),
        Zone("b", "rectangle", -0.5, 0.3, size_m=(0.8, 0.4), yaw_rad=0.3, color=(0, 9, 0)),
    ]
    before = Floor(image, (3.0, 3.0), zones=zones).sample(points)
    turn = quarters * math.pi / 2
    c, s = round(math.cos(turn)), round(math.sin(turn))
    flip = np.diag([1, -1 if mirrored else 1])
    place = flip @ np.array([(c, s), (-s, c)])
    shift = np.array([10.0, 20.0])
    moved = []
    for zone in zones:
        x, y = np.array([zone.x_m, zone.y_m]) @ place + shift
        yaw = (-zone.yaw_rad if mirrored else zone.yaw_rad) + turn
        moved.append(Zone(zone.id, zone.shape, x, y, zone.radius_m, zone.size_m, yaw, zone.color))
    turned = np.rot90(image[::-1] if mirrored else image, quarters)
    after = Floor(turned, (3.0, 3.0), (10.0, 20.0), zones=moved).sample(points @ place + shift)
    assert np.array_equal(before, after)


def test_later_zones_lie_over_earlier_ones_and_colourless_ones_are_not_seen() -> None:
    red = Zone("red", "circle", 0, 0, radius_m=2, color=(255, 0, 0))
    blue = Zone("blue", "circle", 1, 0, radius_m=1, color=(0, 0, 255))
    plain = Zone("plain", "circle", 0, 0, radius_m=5, value=3)
    points = [(-1, 0), (1, 0), (3, 0)]
    floor = Floor(color=(5, 5, 5)).with_zones([red, blue, plain])
    assert floor.sample(points)[:, 0].tolist() == [255.0, 0.0, 5.0]
    assert floor.with_zones([blue, red]).sample(points)[:, 0].tolist() == [255.0, 255.0, 5.0]


@pytest.mark.parametrize(
    "image", [IMAGE[:, :, 0], IMAGE[:, :, :2], IMAGE.astype(float), IMAGE[:0]], ids=str
)
def test_what_is_no_picture_is_refused(image: np.ndarray) -> None:  # type: ignore[type-arg]
    with pytest.raises(WorldError, match=r"picture.*shape"):
        Floor(image)


def test_a_picture_covers_something() -> None:
    with pytest.raises(WorldError, match="expected lengths"):
        Floor(IMAGE, (0.0, 1.0))
