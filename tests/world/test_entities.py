"""What stands in the world: records that check themselves."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.world.entities import (
    Box,
    Cylinder,
    Entity,
    Light,
    VirtualRobot,
    WorldError,
    Zone,
    moved,
)

GOOD: dict[type, dict[str, Any]] = {
    Box: {"id": "b", "position_m": (1, 2, 0), "size_m": (0.1, 0.2, 0.3), "yaw_rad": 1.0},
    Cylinder: {"id": "c", "position_m": (1, 2, 0), "radius_m": 0.1, "height_m": 0.2},
    Light: {"id": "l", "position_m": (1, 2, 3), "intensity": 2.0, "color": (1, 2, 3)},
    Zone: {"id": "z", "shape": "circle", "x_m": 1.0, "y_m": 2.0, "radius_m": 0.5},
    VirtualRobot: {"id": "v", "tag": 70_000, "x_m": 1.0, "y_m": 2.0, "yaw_rad": 0.5},
}


@pytest.mark.parametrize("kind", GOOD, ids=lambda kind: kind.__name__)
@pytest.mark.parametrize("wrong", [math.nan, math.inf, 1e308, "1", None, True, (1, 2)])
def test_whatever_is_no_number_of_an_arena_is_refused(kind: type, wrong: Any) -> None:
    for name, value in GOOD[kind].items():
        if name in ("id", "shape"):
            continue
        values = [wrong] if not isinstance(value, tuple) else [wrong, (wrong, *value[1:])]
        for bad in values:
            with pytest.raises(WorldError, match=f"{kind.__name__} '.': {name} is .*expected"):
                kind(**(GOOD[kind] | {name: bad}))


@pytest.mark.parametrize("kind", GOOD, ids=lambda kind: kind.__name__)
@pytest.mark.parametrize("name", ["", " ", "two\nlines", 3, None])
def test_an_id_is_a_name(kind: type, name: Any) -> None:
    with pytest.raises(WorldError, match="expected a name"):
        kind(**(GOOD[kind] | {"id": name}))


@pytest.mark.parametrize(
    ("kind", "name", "wrong"),
    [
        (Box, "size_m", (0.1, 0.0, 0.1)),
        (Box, "size_m", (0.1, 0.1)),
        (Cylinder, "radius_m", 0.0),
        (Cylinder, "height_m", -1.0),
        (Light, "intensity", -0.1),
        (Light, "color", (0, 0, 256)),
        (Light, "color", (0.5, 0, 0)),
        (Zone, "shape", "hexagon"),
        (Zone, "color", (1, 2)),
        (Zone, "radius_m", 0.0),
        (VirtualRobot, "tag", 65_535),
        (VirtualRobot, "tag", 2**32),
        (VirtualRobot, "tag", 7e4),
        (VirtualRobot, "model", "thymio2"),
        (VirtualRobot, "model", None),
    ],
)
def test_out_of_range(kind: type, name: str, wrong: Any) -> None:
    with pytest.raises(WorldError, match=f"{name} is"):
        kind(**(GOOD[kind] | {name: wrong}))


def test_lists_and_numpy_numbers_will_do() -> None:
    box = Box("b", [np.float32(1), 2, 0], np.array([1.0, 2.0, 3.0]))  # type: ignore[arg-type]
    assert box.position_m == (1.0, 2.0, 0.0) and box.size_m == (1.0, 2.0, 3.0)
    assert Light("l", (0, 0, 1), color=[np.uint8(9), 0, 0]).color == (9, 0, 0)  # type: ignore[arg-type]


@given(st.floats(-1000, 1000))
def test_turns_are_wrapped(yaw_rad: float) -> None:
    robot = VirtualRobot("v", 70_000, 0.0, 0.0, yaw_rad)
    assert -math.pi < robot.yaw_rad <= math.pi
    assert math.cos(robot.yaw_rad) == pytest.approx(math.cos(yaw_rad), abs=1e-9)
    assert math.sin(robot.yaw_rad) == pytest.approx(math.sin(yaw_rad), abs=1e-9)


@pytest.mark.parametrize("kind", GOOD, ids=lambda kind: kind.__name__)
def test_what_is_moved_changes_its_place_only(kind: type) -> None:
    entity: Entity = kind(**GOOD[kind])
    other = moved(entity, -3.0, -4.0)
    assert moved(other, 1.0, 2.0) == entity
    assert other != entity and other.id == entity.id
    if kind in (Cylinder, Light):
        with pytest.raises(WorldError, match="no heading"):
            moved(entity, 0.0, 0.0, 1.0)
    else:
        turned = moved(entity, 0.0, 0.0, -1.0)
        assert not isinstance(turned, (Cylinder, Light)) and turned.yaw_rad == -1.0


@given(st.floats(-2, 2), st.floats(-2, 2), st.floats(-3, 3), st.floats(-3, 3), st.booleans())
def test_a_zone_moved_with_its_points_holds_the_same(
    x: float, y: float, yaw_rad: float, turn_rad: float, is_round: bool
) -> None:
    shape = "circle" if is_round else "rectangle"
    points = np.random.default_rng(1).uniform(-3, 3, (200, 2))
    zone = Zone("z", shape, x, y, radius_m=0.8, size_m=(1.5, 0.7), yaw_rad=yaw_rad)
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    place = np.array([(c, s), (-s, c)])
    far_x, far_y = np.array([x, y]) @ place + [7.0, 8.0]
    turned = moved(zone, float(far_x), float(far_y), yaw_rad + turn_rad)
    assert isinstance(turned, Zone)
    inside = zone.contains(points)
    assert np.array_equal(turned.contains(points @ place + [7.0, 8.0]), inside)
    assert zone.contains([(x, y)]).all()


def test_a_zones_edge_belongs_to_it() -> None:
    zone = Zone("z", "rectangle", 1.0, 0.0, size_m=(2.0, 1.0))
    points = [(0, 0.5), (2, -0.5), (-0.01, 0), (1, 0.51)]
    assert zone.contains(points).tolist() == [True, True, False, False]
    assert Zone("c", "circle", 0, 0, radius_m=2).contains([(0, 2), (1.5, 1.5)]).tolist() == [
        True,
        False,
    ]
