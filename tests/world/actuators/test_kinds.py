"""What each virtual actuator does to the world."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.world.actuators.conftest import ARENA, STEP_NS, element_of, world_of
from vsense.base.arena import ArenaState
from vsense.base.errors import ConfigError
from vsense.config import devices
from vsense.world.actuators import leds, messages
from vsense.world.actuators.bank import ActuatorBank
from vsense.world.actuators.base import MountedActuator
from vsense.world.sensors.base import Scope
from vsense.world.world import World

States = Callable[..., ArenaState]


def mounted(text: str, scope: Scope) -> MountedActuator:
    element = element_of(text)
    actuator = devices.mount_actuator(element, scope)
    element.check_all_read()
    return actuator


def act(world: World, state: States, actuator: MountedActuator, *steps: dict[int, bytes]) -> None:
    """Robots 7 and 3 stand at (0.5, 0.25) and (-0.5, 0), a source at the origin."""
    places = {7: (0.5, 0.25, 0.0), 3: (-0.5, 0.0, 0.0), 22: (0.0, 0.0, 0.0)}
    bank = ActuatorBank([actuator], (7, 3))
    for timestep, reports in enumerate(steps):
        world.update(state(places, (timestep + 1) * STEP_NS), timestep)
        bank.apply(world, reports)


def test_the_shipped_actuators_are_found() -> None:
    assert set(devices.factories(devices.ACTUATORS)) == {
        "virtual_pheromone_actuator",
        "virtual_cleaning_actuator",
        "virtual_leds_actuator",
        "virtual_range_and_bearing_actuator",
        "vs:actuator",
    }


def test_leds_show_their_colour_until_told_otherwise(state: States, scope: Scope) -> None:
    world = world_of()
    leds = mounted("<virtual_leds_actuator/>", scope)
    act(world, state, leds, {7: b"\xff\x00\x80", 3: b"\x01\x02\x03"}, {7: b"\xff\x00\x80"})
    assert world.leds.tolist() == [[255, 0, 128], [0, 0, 0]], "a silent robot is dark"


def test_noise_of_leds_counts_full_brightness_as_one(state: States, scope: Scope) -> None:
    world = world_of()
    leds = mounted('<virtual_leds_actuator vs:high="0.5"/>', scope)
    act(world, state, leds, {7: b"\xff\x10\x00"})
    assert world.leds[0].tolist() == [128, 16, 0]


def test_a_message_is_its_length_and_that_many_bytes(state: States, scope: Scope) -> None:
    world = world_of()
    speak = mounted('<virtual_range_and_bearing_actuator data_size="3"/>', scope)
    assert speak.actuator.layout == "4*u1"
    least = mounted('<virtual_range_and_bearing_actuator data_size="1"/>', scope)
    assert least.actuator.layout == "2*u1"
    argos = messages.from_argos(element_of('<epuck_range_and_bearing data_size="1"/>'), scope)
    assert argos.layout == "2*u1"
    act(world, state, speak, {7: b"\x02\x05\x06\x07", 3: b"\xff\x01\x02\x03"})
    assert world.messages["length"].tolist() == [2, 3], "no longer than there is room"
    assert world.messages["data"][:, :4].tolist() == [[5, 6, 0, 0], [1, 2, 3, 0]]
    act(world, state, speak, {3: b"\x00\x01\x02\x03"})
    assert world.messages["length"].tolist() == [0, 0]
    assert not world.messages["data"].any()


def pheromone(level: float, count: float) -> bytes:
    return struct.pack("<2f", level, count)


def test_pheromone_is_released_by_rate_and_by_drops(state: States, scope: Scope) -> None:
    world = world_of()
    release = mounted('<virtual_pheromone_actuator field="trail" max_rate="4"/>', scope)
    first = {7: pheromone(2.0, 0.0), 3: pheromone(100.0, 1.5)}
    second = {7: pheromone(0.0, 0.5), 3: pheromone(0.0, 1.5)}
    act(world, state, release, first, second, second)
    trail = world.fields["trail"]
    assert math.isclose(trail.total(), 0.1 * (2.0 + 4.0) + 1.5 + 0.5, rel_tol=1e-6)
    assert world.fields["alarm"].total() == 0.0
    here, there = trail.value([[0.5, 0.25], [-0.5, 0.0]])
    assert 0.0 < here < there
    assert trail.value([[0.0, 0.8]])[0] == 0.0


def cleaning(scope: Scope) -> MountedActuator:
    text = '<virtual_cleaning_actuator pollutant_entity="polluter" rate="5"/>'
    return mounted(text, scope)


def test_cleaning_shrinks_the_polluted_area_in_proportion(state: States, scope: Scope) -> None:
    source = scope.sources[0]
    world = world_of(sources=(source,))
    full, half = struct.pack("<f", 1.0), struct.pack("<f", 0.5)
    act(world, state, cleaning(scope), {7: full, 3: full}, {7: half})
    # Robot 3 stands behind the source: of an amount of 2, 0.5 and 0.25 are gone.
    assert math.isclose(world.results["pollution_left"], 1.25 / 2.0)
    cone = world.cone(source)
    assert cone is not None
    area = np.linalg.det(cone.vertices()[1:] - cone.vertices()[0])
    whole = source.cone_at(0.0, 0.0, 0).vertices()
    assert math.isclose(area / np.linalg.det(whole[1:] - whole[0]), 1.25 / 2.0)


def test_cleaning_ends_with_nothing_left_and_takes_no_more(state: States, scope: Scope) -> None:
    source = scope.sources[0]
    world = world_of(sources=(source,))
    full = struct.pack("<f", 1.0)
    act(world, state, cleaning(scope), *[{7: full}] * 3)
    reach = world.cone(source)
    assert reach is not None and not reach.contains([0.5, 0.25]), "the cone no longer reaches it"
    left = world.results["pollution_left"]
    act(world, state, cleaning(scope), *[{7: full}] * 3)
    assert world.results["pollution_left"] == left
    world.stock.clean(source, 100.0)
    assert world.cone(source) is None and world.stock.share(source) == 0.0
    world.reset()
    assert world.stock.share(source) == 1.0


def test_a_source_without_an_amount_stays_as_it_is(scope: Scope) -> None:
    endless = scope.sources[1]
    world = world_of(sources=(endless,))
    assert world.stock.clean(endless, 1e9) == 1e9
    assert world.stock.share(endless) == 1.0


def test_the_amount_of_a_source_stands_in_its_sensor(scope: Scope) -> None:
    text = '<virtual_pollutant_sensor pollutant_entity="polluter" {}/>'
    for setting, amount in (('vs:amount="0.5"', 0.5), ('vs:amount="20"', 20.0), ("", math.inf)):
        devices.mount_sensor(element_of(text.format(setting)), scope)
        assert scope.sources[-1].amount == amount
    with pytest.raises(ConfigError, match=r"vs:amount: 0.*range"):
        devices.mount_sensor(element_of(text.format('vs:amount="0"')), scope)


WRONG = [
    ("<virtual_pheromone_actuator/>", "field: is missing, expected the id of a <vs:field>"),
    ('<virtual_pheromone_actuator field="x"/>', "there is no field 'x' in the arena; there are: a"),
    ('<virtual_pheromone_actuator field="trail" max_rate="0"/>', "max_rate: 0 is out of range"),
    ('<virtual_cleaning_actuator pollutant_entity="robot"/>', "needs a <virtual_pollutant_sensor>"),
    ('<virtual_cleaning_actuator pollutant_entity="endless"/>', "and a 'vs:amount'"),
    ('<virtual_cleaning_actuator pollutant_entity="nobody"/>', "there is no 'nobody'"),
    ('<virtual_cleaning_actuator pollutant_entity="polluter" rate="nan"/>', "'nan' is not a num"),
    (
        '<virtual_range_and_bearing_actuator data_size="17"/>',
        "17 is out of range, expected 1 to 16",
    ),
    ('<virtual_leds_actuator colour="red"/>', "is not an attribute of it"),
    ('<virtual_leds_actuator vs:drop_out="2"/>', "2 is out of range"),
    ('<virtual_leds_actuator vs:high="-1"/>', "is below all that the device can give"),
    ('<virtual_leds_actuator implementation="x"/>', "'x' is not one of: default"),
]


@pytest.mark.parametrize(("text", "said"), WRONG)
def test_wrong_elements_are_refused_with_their_line(text: str, said: str, scope: Scope) -> None:
    with pytest.raises(ConfigError) as caught:
        mounted(text, scope)
    assert str(caught.value).startswith("x.argos:1: ") and said in str(caught.value)


def test_what_c_is_pointed_to_is_still_there(
    state: States, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Freed memory is what the next array of its size gets: a segfault in a lab, once a day."""
    seen = []

    def show(how: Any, *rest: Any) -> int:
        taken = [np.full(how.robots, 77_000, dtype=np.int32) for _ in range(100)]
        seen.append([how.rows[robot] for robot in range(how.robots)])
        return len(taken)

    monkeypatch.setattr(leds, "kernels", SimpleNamespace(vs_shine_show=show))
    world = world_of()
    world.update(state({7: (0.5, 0.25, 0.0), 3: (-0.5, 0.0, 0.0)}, STEP_NS), 0)
    rows = np.array([1, 0], dtype=np.intp)
    leds.LedsActuator().apply(world, rows, np.zeros((2, 3)), np.zeros((2, 3)))
    assert seen == [[1, 0]]


def fields_of(world: World) -> list[Any]:
    return [field.concentration.tobytes() for field in world.fields.values()]


def test_who_reports_first_changes_no_bit_of_the_world(state: States, scope: Scope) -> None:
    """Robots in one cell, and in one cone: their deeds add up the same in any order."""
    worlds = []
    for order in ((7, 3), (3, 7)):
        world = world_of(sources=tuple(scope.sources[:1]))
        mounts = [
            mounted('<virtual_pheromone_actuator field="trail"/>', scope),
            cleaning(scope),
        ]
        bank = ActuatorBank(mounts, (7, 3))
        for timestep in range(5):
            places = {7: (0.41, 0.03, 0), 3: (0.42, 0.04, 0), 22: (0.0, 0.0, 0)}
            world.update(state(places, (timestep + 1) * STEP_NS), timestep)
            said = {tag: struct.pack("<3f", 0.1 * tag, 0.7 * timestep, 0.01 * tag) for tag in order}
            bank.apply(world, said)
            world.step()
        worlds.append(world)
    first, second = worlds
    assert fields_of(first) == fields_of(second)
    assert first.results == second.results
    assert ARENA.contains(0.41, 0.03)
