"""The radiation sensor: 1/d^2, bounded."""

from __future__ import annotations

import pytest

from tests.world.sensors.scenes import read, sensor
from vsense.base.errors import ConfigError
from vsense.world.entities import Cylinder
from vsense.world.sensors.base import Scope

BARREL = Cylinder("barrel", (0.0, 0.0, 0.0), 0.1, 0.5)
SCOPE = Scope({"ore_9_0": 9}, 0, entities={"barrel": BARREL})


def radiation(more: str = "", entity: str = "barrel") -> object:
    return sensor(f'<virtual_radiation_sensor radiation_entity="{entity}" {more}/>', SCOPE)


def test_it_falls_with_the_square_of_the_distance() -> None:
    places = {1: (0.5, 0.0, 1.0), 2: (0.0, -2.0, 0.0), 3: (3.0, 4.0, 0.0)}
    assert read(radiation(), places, [BARREL]) == [
        [pytest.approx(4.0)], [pytest.approx(0.25)], [pytest.approx(0.04)]
    ]  # fmt: skip
    (strong,) = read(radiation('vs:strength="8"'), {1: (2.0, 0.0, 0.0)}, [BARREL])
    assert strong == [pytest.approx(2.0)]


def test_defect_9_it_has_a_bound_and_its_source_a_name() -> None:
    places = {1: (0.0, 0.0, 0.0), 2: (1e-300, 0.0, 0.0), 3: (0.01, 0.0, 0.0)}
    assert read(radiation(), places, [BARREL]) == [[pytest.approx(1e4)]] * 3
    with pytest.raises(ConfigError, match=r"radiation_entity:.*missing"):
        sensor("<virtual_radiation_sensor/>", SCOPE)
    with pytest.raises(ConfigError, match=r"'epuck_1'.*arena"):
        radiation(entity="epuck_1")


def test_it_never_rises_with_the_distance() -> None:
    places = {k: (0.003 * k, 0.0, 0.0) for k in range(400)}
    felt = [reading[0] for reading in read(radiation('vs:range="1"'), places, [BARREL])]
    assert felt == sorted(felt, reverse=True)
    assert [k for k, value in enumerate(felt) if value == 0.0] == list(range(334, 400))


def test_a_tagged_source_radiates_from_where_it_is_seen_and_not_at_all_before() -> None:
    device = radiation(entity="ore_9_0")
    assert read(device, {1: (0, 0, 0)}, objects=[9]) == [[0.0]]
    assert read(device, {1: (0, 0, 0), 9: (0, 2, 0)}, objects=[9]) == [[pytest.approx(0.25)]]
