"""What sensors point to: tagged things, virtual entities, rectangles."""

from __future__ import annotations

import pytest

from tests.world.sensors.scenes import STEP_NS, arena_state, element, world_of
from vsense.base.errors import ConfigError
from vsense.world.entities import Box, Cylinder, Light, VirtualRobot, Zone
from vsense.world.sensors import _places
from vsense.world.sensors.base import Scope

ENTITIES = {
    "box": Box("box", (1, 2, 0), (1, 1, 1), 0.5),
    "post": Cylinder("post", (3, 4, 0), 0.1, 1.0),
    "lamp": Light("lamp", (5, 6, 7), 1.0),
    "spot": Zone("spot", "circle", 7.0, 8.0, radius_m=1.0),
    "ghost": VirtualRobot("ghost", 0x10000, 9.0, 10.0, 1.5),
}
SCOPE = Scope({"barrel_9_0": 9, "epuck_7_1": 7}, 0, entities=ENTITIES)


def place(name: str, more: str = "") -> _places.AnyPlace:
    return _places.from_xml(element(f'<s at="{name}" {more}/>'), SCOPE, "at")


def test_entities_are_where_they_stand() -> None:
    world = world_of({}, ENTITIES.values())
    found = [place(name).pose(world) for name in ENTITIES]
    assert found == [(1, 2, 0.5), (3, 4, 0), (5, 6, 0), (7, 8, 0), (9, 10, 1.5)]


def test_an_entity_is_where_a_loop_function_moves_it_and_nowhere_once_it_is_gone() -> None:
    world, spot = world_of({}, ENTITIES.values()), place("spot")
    world.move("spot", -1.0, -2.0)
    assert spot.pose(world) == (-1, -2, 0)
    world.remove("spot")
    assert spot.pose(world) is None


def test_a_tagged_thing_is_where_it_was_seen_until_that_is_too_old() -> None:
    world, barrel = world_of({7: (0, 0, 0)}, objects=[9]), place("barrel_9_0", 'vs:memory="0.2"')
    assert barrel.pose(world) is None
    world.update(arena_state({9: (1, 2, 3)}, STEP_NS), 0)
    for k in (1, 2, 3):
        world.update(arena_state({}, k * STEP_NS), k)
        assert barrel.pose(world) == (1, 2, 3)
    world.update(arena_state({}, 4 * STEP_NS), 4)
    assert barrel.pose(world) is None


def test_a_robot_can_be_pointed_to_and_is_noted() -> None:
    scope = Scope({"epuck_7_1": 7}, 0)
    robot = _places.from_xml(element('<s at="epuck_7_1"/>'), scope, "at")
    assert robot.pose(world_of({7: (1, 2, 3)})) == (1, 2, 3)
    assert scope.named == {7}


def test_an_unknown_id_is_refused_with_what_there_is() -> None:
    with pytest.raises(ConfigError, match=r"<s> at:.*'gost'.*'ghost'"):
        place("gost")
    with pytest.raises(ConfigError, match=r"at:.*missing"):
        _places.from_xml(element("<s/>"), SCOPE, "at")


def rectangle(corners: str) -> _places.FixedPlace:
    return _places.rectangle_from_xml(element(f"<s {corners}/>"), "white")


def test_a_rectangle_stands_for_its_middle() -> None:
    corners = 'white_min_x="-1" white_max_x="3" white_min_y="2" white_max_y="2.5"'
    assert rectangle(corners).pose(world_of({})) == (1.0, 2.25, 0.0)


def test_wrong_rectangles_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"white_max_y:.*missing"):
        rectangle('white_min_x="-1" white_max_x="3" white_min_y="2"')
    with pytest.raises(ConfigError, match=r"white_max_x: -3.*white_min_x -1"):
        rectangle('white_min_x="-1" white_max_x="-3" white_min_y="2" white_max_y="2"')
