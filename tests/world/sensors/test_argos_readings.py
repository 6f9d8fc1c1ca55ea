"""The formulas against what ARGoS's own e-pucks read: tests/data/argos-readings."""

from __future__ import annotations

import json
import math
from typing import Any

import cv2
import numpy as np
import pytest

from tests.rigs.places import DATA
from tests.world.sensors.numpy_sensors import points_at
from tests.world.sensors.scenes import rows, sensor, world_of
from vsense.world.entities import Box, Cylinder, Entity, Light
from vsense.world.fields import Floor
from vsense.world.world import World

READINGS = DATA / "argos-readings"
ORACLE = json.loads((READINGS / "readings.json").read_text())
CLOSE = 1e-4


def image() -> Any:
    return cv2.cvtColor(cv2.imread(str(READINGS / "floor.png")), cv2.COLOR_BGR2RGB)


def world(scene: Any, floor: Any) -> World:
    entities: list[Entity] = [Light(a["id"], a["pos"], a["intensity"]) for a in scene["lights"]]
    for box in scene["boxes"]:
        entities.append(Box(box["id"], box["pos"], box["size"], math.radians(box["yaw"])))
    for c in scene["cylinders"]:
        entities.append(Cylinder(c["id"], c["pos"], c["radius"], c["height"]))
    places = {
        tag: (r["x"], r["y"], math.radians(r["yaw"])) for tag, r in enumerate(scene["robots"])
    }
    return world_of(places, entities, floor=Floor(floor, (scene["arena"], scene["arena"])))


@pytest.fixture(scope="module")
def worlds() -> list[tuple[World, list[Any]]]:
    """Each world with what its robots read."""
    floor = image()
    return [(world(scene, floor), scene["robots"]) for scene in ORACLE["worlds"]]


def column(worlds: list[tuple[World, list[Any]]], key: str) -> Any:
    return np.array([robot[key] for _, robots in worlds for robot in robots])


def test_there_is_something_to_compare(worlds: list[tuple[World, list[Any]]]) -> None:
    assert len(worlds) == 30
    light, proximity = column(worlds, "light"), column(worlds, "proximity")
    assert ((light > 0).sum(), (proximity > 0).sum()) > (500, 50)
    assert sum(len(r["rab"]) for _, robots in worlds for r in robots) == 840


def test_the_angles_are_those_that_argos_reports() -> None:
    light = sensor('<virtual_light_sensor formula="epuck" vs:ring="argos"/>')
    told = light.read(world_of({1: (0.0, 0.0, 1.0)}), world_of({1: (0, 0, 1)}).robots)[0, 8:]
    difference = np.array(
        [math.remainder(a - b, 2 * math.pi) for a, b in zip(told, ORACLE["angles"])]
    )
    assert np.abs(difference).max() < 1e-5


def test_light(worlds: list[tuple[World, list[Any]]]) -> None:
    light = sensor('<virtual_light_sensor formula="epuck" vs:ring="argos" vs:angles="false"/>')
    ours = np.concatenate([rows(light, world) for world, _ in worlds])
    np.testing.assert_allclose(ours, column(worlds, "light"), atol=CLOSE)


def test_proximity(worlds: list[tuple[World, list[Any]]]) -> None:
    proximity = sensor('<virtual_proximity_sensor vs:ring="argos"/>')
    ours = np.concatenate([rows(proximity, world) for world, _ in worlds]) / 4095
    np.testing.assert_allclose(ours, column(worlds, "proximity"), atol=CLOSE)


def test_ground_but_on_the_edges_of_pixels(worlds: list[tuple[World, list[Any]]]) -> None:
    ground = sensor("<virtual_ground_sensor/>")
    ours = np.concatenate([rows(ground, world) for world, _ in worlds])
    wrong = np.abs(ours - column(worlds, "ground")) > CLOSE
    edges = []
    height, width, _ = image().shape
    for scene, (world_now, _) in zip(ORACLE["worlds"], worlds):
        points = points_at(world_now.robots, 0.03, [0.009, 0.0, -0.009])
        pixels = (points / scene["arena"] + 0.5) * (width, height)
        edges.append(np.abs(pixels - np.rint(pixels)).min(axis=2) < 1e-3)
    assert not (wrong & ~np.concatenate(edges)).any()
    assert wrong.sum() <= 1


def test_range_and_bearing(worlds: list[tuple[World, list[Any]]]) -> None:
    rab = sensor('<virtual_range_and_bearing_sensor vs:max_messages="32" data_size="1"/>')
    for world_now, robots in worlds:
        for reading, robot in zip(rows(rab, world_now), robots):
            count = int(reading[0])
            ours = sorted(reading[1:].reshape(-1, 3)[:count, :2].tolist())
            theirs = sorted(message[1:] for message in robot["rab"])
            assert len(ours) == len(theirs), robot
            np.testing.assert_allclose(
                np.reshape(ours, (-1, 2)), np.reshape(theirs, (-1, 2)), atol=CLOSE
            )
