"""Range and bearing: who is heard, where, and with which bytes."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest

from tests.world.sensors.scenes import arena_state, element, mount, rows, sensor, world_of
from vsense.base.errors import ConfigError
from vsense.world.entities import VIRTUAL_TAG_MIN, Box, Cylinder, VirtualRobot
from vsense.world.sensors import range_and_bearing
from vsense.world.sensors.bank import SensorBank
from vsense.world.sensors.base import Scope
from vsense.world.world import World

Message = tuple[float, ...]


def rab(more: str = "") -> object:
    return sensor(f"<virtual_range_and_bearing_sensor {more}/>")


def say(world: World, tag: int, *data: int) -> None:
    (row,) = np.flatnonzero(world.robots["tag"] == tag)
    world.messages["length"][row] = len(data)
    world.messages["data"][row, : len(data)] = data


def heard(device: object, world: World) -> list[list[Message]]:
    """Gives each robot's messages: (range, bearing, bytes...), by range."""
    width = 2 + device.data_size  # type: ignore[attr-defined]
    found = []
    for reading in rows(device, world):
        slots = reading[1:].reshape(-1, width)
        count = int(reading[0])
        assert not slots[count:].any()
        found.append(sorted(tuple(slot) for slot in slots[:count].tolist()))
    return found


def test_range_is_between_the_bodies_in_cm_and_bearing_is_the_receivers() -> None:
    world = world_of({1: (0, 0, math.pi / 2), 2: (0.3, 0, 0), 3: (0.0, 0.5, 0.0)})
    first, second, third = heard(rab(), world)
    assert first == [
        pytest.approx((23.0, -math.pi / 2, 0, 0, 0, 0)),
        pytest.approx((43.0, 0.0, 0, 0, 0, 0)),
    ]
    assert second[0] == pytest.approx((23.0, math.pi, 0, 0, 0, 0))
    assert third[0] == pytest.approx((43.0, -math.pi / 2, 0, 0, 0, 0))


def test_messages_arrive_byte_for_byte_cut_to_their_size() -> None:
    world = world_of({1: (0, 0, 0), 2: (0.3, 0, 0)})
    say(world, 2, 1, 0, 255)
    say(world, 1, 9, 8, 7, 6, 5)
    assert heard(rab(), world)[0] == [pytest.approx((23.0, 0.0, 1, 0, 255, 0))]
    assert heard(rab(), world)[1] == [pytest.approx((23.0, math.pi, 9, 8, 7, 6))]
    assert heard(rab('data_size="1"'), world)[1] == [pytest.approx((23.0, math.pi, 9))]
    # What lay there before the message became shorter does not count.
    world.messages["length"][world.robots["tag"] == 2] = 1
    assert heard(rab(), world)[0] == [pytest.approx((23.0, 0.0, 1, 0, 0, 0))]


def test_all_are_heard_or_only_those_who_say_something() -> None:
    ghost = VirtualRobot("ghost", VIRTUAL_TAG_MIN, 0.0, 0.3)
    world = world_of({1: (0, 0, 0), 2: (0.3, 0, 0)}, [ghost])
    say(world, 2, 7)
    assert len(heard(rab(), world)[0]) == 2
    assert heard(rab('vs:hear="speaking"'), world)[0] == [pytest.approx((23, 0, 7, 0, 0, 0))]


def test_range_field_of_view_and_who_was_never_seen() -> None:
    places = {1: (0.0, 0.0, 0.0), 2: (0.79, 0.0, 0.0), 3: (-0.4, 0.0, 0.0), 4: (0.0, 0.81, 0.0)}
    world = World([*places, 5])
    world.update(arena_state(places), 0)
    assert [round(m[0]) for m in heard(rab(), world)[0]] == [33, 72]
    assert [round(m[0]) for m in heard(rab('range="0.5"'), world)[0]] == [33]
    assert [round(m[0]) for m in heard(rab('vs:field_of_view="90"'), world)[0]] == [72]


def test_defect_11_bodies_stand_between_but_not_the_two_themselves() -> None:
    pair = {1: (0.0, 0.0, 0.0), 2: (0.6, 0.0, 0.0)}
    wall = Box("wall", (0.3, 0.0, 0.0), (0.01, 0.1, 0.1))
    post = Cylinder("post", (0.3, 0.0, 0.0), 0.01, 0.1)
    low = Box("low", (0.3, 0.0, 0.0), (0.01, 0.1, 0.052))
    free, blocked = [1, 1], [0, 0]
    for entities, expected in (
        ([], free), ([wall], blocked), ([post], blocked), ([low], free)
    ):  # fmt: skip
        assert [len(m) for m in heard(rab(), world_of(pair, entities))] == expected
    third = world_of(pair | {3: (0.3, 0.01, 0.0)})
    assert [len(m) for m in heard(rab(), third)] == [1, 1, 2]
    through = rab('check_occlusions="false"')
    assert [len(m) for m in heard(through, world_of(pair, [wall]))] == free


def ring_of_robots(count: int) -> dict[int, tuple[float, float, float]]:
    """One robot in the middle, the others around it at distances that tell them apart."""
    places = {0: (0.0, 0.0, 0.0)}
    for k in range(1, count + 1):
        angle, distance = 2 * math.pi * k / count, 0.4 + 0.002 * k
        places[k] = (distance * math.cos(angle), distance * math.sin(angle), 0.0)
    return places


def test_at_most_k_are_heard_and_chance_decides_which() -> None:
    world, device = world_of(ring_of_robots(12), seed=4), rab()
    chosen = [heard(device, world)[0] for _ in range(600)]
    assert {len(messages) for messages in chosen} == {5}
    numbers = [round((m[0] + 7 - 40) / 0.2) for messages in chosen for m in messages]
    counts = np.bincount(numbers, minlength=13)[1:]
    # Each of the 12 is chosen with probability 5/12: 250 times of 600, give or take 12.
    assert np.abs(counts - 250).max() < 55
    assert [len(set(map(tuple, messages))) for messages in chosen] == [5] * 600


def test_the_choice_repeats_with_the_seed() -> None:
    runs = []
    for seed in (4, 4, 5):
        world = world_of(ring_of_robots(12), seed=seed)
        runs.append([rows(rab(), world).tolist() for _ in range(5)])
    assert runs[0] == runs[1]
    assert runs[0] != runs[2]


def test_messages_are_lost_each_by_itself() -> None:
    world, device = world_of(ring_of_robots(4)), rab('loss_probability="0.25"')
    counts = np.array([rows(device, world)[0, 0] for _ in range(2000)])
    assert counts.mean() == pytest.approx(3.0, abs=0.08)
    assert counts.var() == pytest.approx(4 * 0.25 * 0.75, abs=0.12)
    assert not rows(rab('loss_probability="1"'), world).any()


def test_two_robots_in_one_place_hear_each_other_at_range_zero() -> None:
    (first, second) = heard(rab(), world_of({1: (0, 0, 1), 2: (0, 0, 2)}))
    assert first[0][0] == second[0][0] == 0.0
    assert all(math.isfinite(number) for number in first[0])


def test_noise_moves_range_and_bearing_but_no_byte_and_no_empty_place() -> None:
    tags = list(range(400))
    world = world_of({tag: (3.0 * (tag // 2), 0.3 * (tag % 2), 0.0) for tag in tags})
    for tag in tags:
        say(world, tag, 200)
    noisy = mount('<virtual_range_and_bearing_sensor noise_std_dev="0.05" data_size="2"/>')
    sent = SensorBank([noisy], tags).encode(world, 0)
    values = np.array([struct.unpack("<21f", sent[tag][0][0]) for tag in tags])
    assert (values[:, 0] == 1).all()
    assert values[:, 1].std() == pytest.approx(5.0, rel=0.2)
    off = np.remainder(values[:, 2] - np.pi / 2 + np.pi * np.array([0, 1] * 200) + np.pi, 2 * np.pi)
    assert off.std() == pytest.approx(0.05, rel=0.2)
    assert (values[:, 3:5] == (200, 0)).all()
    assert not values[:, 5:].any()


@pytest.mark.parametrize(("robots", "places"), [(1, 1), (2, 1), (3, 2), (9, 8)])
def test_as_in_argos_a_robot_hears_each_other_one(robots: int, places: int) -> None:
    xml = element("<epuck_range_and_bearing />")
    assert range_and_bearing.from_argos(xml, Scope({}, 0, most=robots)).max_messages == places


def test_layouts_and_wrong_attributes() -> None:
    assert (rab().name, rab().layout) == ("range_and_bearing", "31*f4")  # type: ignore[attr-defined]
    big = rab('vs:max_messages="10" data_size="16"')
    assert big.layout == "181*f4"  # type: ignore[attr-defined]
    for xml, words in (
        ('data_size="0"', "data_size: 0.*1.*16"),
        ('loss_probability="1.5"', "loss_probability: 1.5"),
        ('vs:max_messages="33"', "vs:max_messages: 33.*range"),
        ('check_occlusions="no"', "check_occlusions: 'no'"),
        ('range="nan"', "range: 'nan'"),
    ):
        with pytest.raises(ConfigError, match=words):
            rab(xml)
