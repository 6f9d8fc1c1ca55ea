"""Entities by id: put, moved, removed, and never what stands in the real arena."""

from __future__ import annotations

import pytest

from vsense.world._inventory import Inventory
from vsense.world.entities import Box, Cylinder, Light, VirtualRobot, WorldError

WALL = Box("wall", (0, 1, 0), (2, 0.1, 0.1), physical=True)
DOOR = Box("door", (1, 0, 0), (0.5, 0.1, 0.1))
LAMP = Light("lamp", (0, 0, 1))


def test_kinds_keep_their_order() -> None:
    inventory = Inventory([LAMP, DOOR, WALL])
    assert inventory.of(Box) == (DOOR, WALL) and inventory.of(Light) == (LAMP,)
    assert inventory.of(Cylinder) == ()
    inventory.put(Box("gate", (0, 0, 0), (1, 1, 1)))
    assert [box.id for box in inventory.of(Box)] == ["door", "wall", "gate"]


def test_every_change_is_counted_and_undone_by_reset() -> None:
    inventory = Inventory([LAMP, DOOR])
    versions = [inventory.version]
    for change in (
        lambda: inventory.move("lamp", 1.0, 2.0, None),
        lambda: inventory.put(Light("lamp", (0, 0, 2), 5.0)),
        lambda: inventory.remove("door"),
        inventory.reset,
    ):
        change()
        versions.append(inventory.version)
    assert versions == sorted(set(versions))
    assert dict(inventory.entities) == {"lamp": LAMP, "door": DOOR}


def test_moved_by_name() -> None:
    inventory = Inventory([LAMP, DOOR])
    inventory.move("lamp", 1.0, 2.0, None)
    inventory.move("door", 3.0, 4.0, 0.5)
    assert inventory.get("lamp") == Light("lamp", (1, 2, 1))
    assert inventory.get("door") == Box("door", (3, 4, 0), (0.5, 0.1, 0.1), 0.5)


def test_real_things_stay_where_they_are() -> None:
    inventory = Inventory([WALL])
    for change in (
        lambda: inventory.move("wall", 0.0, 0.0, None),
        lambda: inventory.remove("wall"),
        lambda: inventory.put(Box("wall", (0, 0, 0), (1, 1, 1))),
        lambda: inventory.put(Cylinder("new", (0, 0, 0), 1, 1, physical=True)),
    ):
        with pytest.raises(WorldError, match="real arena"):
            change()
    assert dict(inventory.entities) == {"wall": WALL}


def test_names_that_are_not_there_are_told_with_those_that_are() -> None:
    inventory = Inventory([LAMP, DOOR])
    for ask in (
        lambda: inventory.move("lmap", 0.0, 0.0, None),
        lambda: inventory.remove("lmap"),
        lambda: inventory.get("lmap"),
    ):
        with pytest.raises(WorldError, match=r"'lmap'.*'lamp'"):
            ask()
    with pytest.raises(WorldError, match=r"'lamp'.*none"):
        Inventory().remove("lamp")


def test_ids_and_tags_are_unique() -> None:
    with pytest.raises(WorldError, match="called 'lamp'"):
        Inventory([LAMP, Box("lamp", (0, 0, 0), (1, 1, 1))])
    robots = [VirtualRobot("a", 70_000, 0, 0), VirtualRobot("b", 70_000, 0, 0)]
    with pytest.raises(WorldError, match=r"'b'.*'a'.*70000"):
        Inventory(robots)
    inventory = Inventory(robots[:1])
    with pytest.raises(WorldError, match="same tag"):
        inventory.put(robots[1])
    inventory.put(VirtualRobot("a", 70_000, 1, 1))


@pytest.mark.parametrize("wrong", [None, "lamp", (0, 0, 1), Box])
def test_only_entities_are_put(wrong: object) -> None:
    with pytest.raises(WorldError, match="Box, Cylinder"):
        Inventory().put(wrong)


def test_the_view_cannot_be_written_to() -> None:
    entities = Inventory([LAMP]).entities
    with pytest.raises(TypeError):
        entities["door"] = DOOR  # type: ignore[index]
