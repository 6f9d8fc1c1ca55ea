"""One timestep of the virtual world: its order, its actuators, its virtual robots, its hooks."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.rigs.lines import in_sight
from vsense.base.arena import ArenaState
from vsense.base.errors import ConfigError, VsenseError
from vsense.base.readings import SensorReadings
from vsense.config.experiment import load
from vsense.monitor.ui import messages
from vsense.robots.link.table import Direction, Entry, Table
from vsense.robots.python_swarm import OWN_COUNTS
from vsense.run.environment import Environment
from vsense.run.remote import OwnDevices
from vsense.world.sightings import NEVER_NS

States = Callable[..., ArenaState]
STEP_NS = 100_000_000
ROBOTS = {31: (0.3, 0.0, 0.0), 1843: (-0.5, 0.2, 1.0), 4334: (0.0, 0.6, 0.0)}
PLACES = {**ROBOTS, 7167: (0.0, -0.5, 0.0)}

CONTROLLER = """
#include "controller.h"

struct sower { int trail; int drop; int color; double dropped; };

static void init(void *state, struct vs_robot *robot)
{
    struct sower *s = state;

    s->trail = vs_robot_sensor(robot, "pheromone");
    s->drop = vs_robot_actuator(robot, "pheromone_release");
    s->color = vs_robot_actuator(robot, "led_color");
}

static void step(void *state, struct vs_robot *robot)
{
    struct sower *s = state;

    s->dropped += 1.0;
    vs_robot_actuate(robot, s->drop, 1, s->dropped);
    vs_robot_actuate(robot, s->color, 0, vs_robot_read(robot, s->trail).value > 1.0 ? 255.0 : 0.0);
    vs_robot_set_wheels(robot, 1000, 1000);
}

const struct vs_controller vs_controller = {"sower", sizeof(struct sower), init, step};
"""

EXPERIMENT = """<argos-configuration xmlns:vs="urn:vsense:1">
  <framework><experiment length="10" ticks_per_second="10" random_seed="1" /></framework>
  <controllers>
    <sower_controller id="sower" library="sower.c">
      <sensors><virtual_field_sensor field="trail" name="pheromone" /></sensors>
      <actuators>
        <virtual_pheromone_actuator field="trail" />
        <virtual_leds_actuator />
      </actuators>
      <params />
    </sower_controller>
  </controllers>
  <arena size="3,3,1" center="0,0,0.5">
    <vs:field id="trail" cell="0.05" evaporation="0.1" />
    MORE
    <e-puck id="epuck_31_1"><body position="0.3,0,0" orientation="0,0,0" />
      <controller config="sower" /></e-puck>
    <e-puck id="epuck_1843_2"><body position="-0.5,0.2,0" orientation="0,0,0" />
      <controller config="sower" /></e-puck>
  </arena>
  LOOP
</argos-configuration>
"""


def environment(folder: Path, more: str = "", loop: str = "", other: bool = False) -> Environment:
    (folder / "sower.c").write_text(CONTROLLER)
    (folder / "loop.py").write_text(loop)
    hooks = '<loop_functions library="loop.py" goal="3" />' if loop else ""
    text = EXPERIMENT.replace("MORE", more).replace("LOOP", hooks)
    if other:
        start, end = text.index("<controllers>") + 13, text.index("</controllers>")
        text = text[:end] + text[start:end].replace('id="sower"', 'id="other"') + text[end:]
    (folder / "sower.argos").write_text(text)
    return Environment(load(folder / "sower.argos"), seed=1)


def report(level: float = 0.0, dropped: float = 0.0, red: int = 0) -> bytes:
    return struct.pack("<2f3B", level, dropped, red, 0, 0)


def value(readings: list[tuple[bytes, int]]) -> float:
    return float(struct.unpack("<3f", readings[0][0])[0])


def test_the_table_holds_sensors_and_then_actuators(tmp_path: Path) -> None:
    (equipment,) = environment(tmp_path).equipment
    assert equipment.table.entries == (
        Entry(1, "pheromone", "3*f4", Direction.SENSOR),
        Entry(2, "pheromone_release", "2*f4", Direction.ACTUATOR),
        Entry(3, "led_color", "3*u1", Direction.ACTUATOR),
    )


def test_a_deed_is_felt_in_the_timestep_in_which_it_arrives(tmp_path: Path, state: States) -> None:
    here = environment(tmp_path)
    close = {31: (0.3, 0.0, 0.0), 1843: (0.32, 0.0, 0.0)}
    before = here.step(state(close, STEP_NS), 0, {31: report()})
    after = here.step(state(close, 2 * STEP_NS), 1, {31: report(dropped=2.0, red=9)})
    assert value(before[1843]) == 0.0 < value(after[1843])
    assert here.world.leds.tolist() == [[9, 0, 0], [0, 0, 0]]
    left = 2.0 * math.exp(-0.1 * 0.1)
    assert math.isclose(here.world.fields["trail"].total(), left, rel_tol=1e-6)


def test_nothing_acts_and_nothing_evolves_before_the_run(tmp_path: Path, state: States) -> None:
    here = environment(tmp_path)
    for timestep in range(3):
        readings = here.step(state(ROBOTS, timestep * STEP_NS), -1, {31: report(5.0, 5.0, 9)})
    assert here.world.fields["trail"].total() == 0.0 and not here.world.leds.any()
    assert set(readings) == {31, 1843} and readings[31][0][1] == 2 * STEP_NS


def test_reset_forgets_the_run_and_keeps_its_world(tmp_path: Path, state: States) -> None:
    here = environment(tmp_path)
    world = here.world
    states = [state(ROBOTS, timestep * STEP_NS) for timestep in range(4)]
    first = [here.step(s, i, {31: report(1.0, i)}) for i, s in enumerate(states)]
    here.reset()
    assert here.world is world and world.fields["trail"].total() == 0.0
    assert [here.step(s, i, {31: report(1.0, i)}) for i, s in enumerate(states)] == first


def test_another_sender_with_the_tag_counts_for_itself(tmp_path: Path, state: States) -> None:
    here = environment(tmp_path, more="")
    here.world.fields["trail"].evaporation_per_s = 0.0
    for timestep, (sender, count) in enumerate([(b"a", 5.0), (b"b", 1.0), (b"a", 6.0)]):
        arena = state(ROBOTS, timestep * STEP_NS)
        here.step(arena, timestep, {31: report(dropped=count)}, {31: sender})
    assert math.isclose(here.world.fields["trail"].total(), 7.0, rel_tol=1e-6)


LOOP = """
def reset(world):
    world.results["calls"] = 0

def pre_step(world):
    world.results["calls"] += 1
    world.fields["trail"].fill(float(world.params["goal"]))

def post_step(world):
    if world.run_timestep == 2:
        raise RuntimeError("no more")

def end(world):
    return {"total": world.fields["trail"].total()}
"""


def test_loop_functions_are_called_around_the_timesteps_of_the_run(
    tmp_path: Path, state: States
) -> None:
    here = environment(tmp_path, loop=LOOP)
    here.step(state(ROBOTS, 0), -1, {})
    assert here.world.results["calls"] == 0
    readings = here.step(state(ROBOTS, STEP_NS), 0, {})
    assert math.isclose(value(readings[31]), 3.0 * math.exp(-0.01), rel_tol=1e-6)
    here.step(state(ROBOTS, 2 * STEP_NS), 1, {})
    results = here.end()
    assert results["calls"] == 2 and results["total"] == here.world.fields["trail"].total()
    with pytest.raises(VsenseError, match=r"loop\.py:11:.*post_step:"):
        here.step(state(ROBOTS, 3 * STEP_NS), 2, {})


GHOST = """<e-puck id="ghost" vs:virtual="true"><body position="X,0.6,0" orientation="0,0,0" />
    <controller config="sower" /></e-puck>"""


def ghost_of(here: Environment) -> tuple[float, float]:
    row = here.world.robots[-1]
    assert row["tag"] >= 0x10000 and row["seen"]
    return float(row["x_m"]), float(row["y_m"])


def live(here: Environment, state: States, timesteps: int, start: int = 0) -> dict[int, float]:
    """Lives timesteps with both real robots standing; gives the last pheromone readings."""
    readings: dict[int, list[tuple[bytes, int]]] = {}
    for step in range(start, start + timesteps):
        arena = state(PLACES, (step + 1) * STEP_NS)
        readings = here.step(arena, step - 3, {})  # type: ignore[assignment]
    return {tag: value(row) for tag, row in readings.items()}


def test_a_virtual_robot_moves_acts_and_senses_like_the_others(
    tmp_path: Path, state: States
) -> None:
    here = environment(tmp_path, GHOST.replace("X", "-0.5"))
    live(here, state, 3)
    assert ghost_of(here) == (-0.5, 0.6), "it stands before the run"
    felt = live(here, state, 10, 3)
    x_m, y_m = ghost_of(here)
    assert 0.1 < x_m + 0.5 < 0.13 and y_m == pytest.approx(0.6, abs=1e-6)
    assert here.world.fields["trail"].total() > 5.0
    assert felt[0x10000] > 1.0 and here.world.leds[-1].tolist() == [255, 0, 0]
    eye, goal = np.array([[x_m, 0.4, 0.05]]), np.array([[x_m, 0.8, 0.05]])
    assert not in_sight(eye, goal, here.world.bodies()).any(), "it stands in the way of others"


def test_physical_virtual_and_moving_things_stop_a_virtual_robot(
    tmp_path: Path, state: States
) -> None:
    wall = '<box id="door" size="0.1,0.5,0.1" movable="false" vs:physical="false">'
    wall += '<body position="0.3,0.6,0" orientation="0,0,0" /></box>'
    here = environment(tmp_path, wall + GHOST.replace("X", "-0.2"))
    live(here, state, 45)
    assert ghost_of(here)[0] == pytest.approx(0.25 - 0.035, abs=1e-3)
    here.world.move("door", 0.3, -1.2)
    live(here, state, 10, 45)
    assert ghost_of(here)[0] > 0.3, "the door has opened"


def test_a_scene_that_changes_all_the_time_does_not_hold_virtual_robots(
    tmp_path: Path, state: States
) -> None:
    wall = '<box id="door" size="0.1,0.5,0.1" movable="false" vs:physical="false">'
    wall += '<body position="1,-1,0" orientation="0,0,0" /></box>'
    still = environment(tmp_path, wall + GHOST.replace("X", "-0.5"))
    moving = environment(tmp_path, wall + GHOST.replace("X", "-0.5"))
    for step in range(13):
        live(still, state, 1, step)
        moving.world.move("door", 1.0, -1.0 + 0.01 * step)
        live(moving, state, 1, step)
    assert ghost_of(still)[0] > -0.4
    assert ghost_of(moving)[0] == pytest.approx(ghost_of(still)[0], abs=0.005)


def test_a_virtual_robot_stands_still_through_a_pause(tmp_path: Path, state: States) -> None:
    here = environment(tmp_path, GHOST.replace("X", "-0.5"))
    live(here, state, 10)
    before_m = ghost_of(here)[0]
    live(here, state, 1, 610)
    assert ghost_of(here)[0] == pytest.approx(before_m, abs=1e-6)
    live(here, state, 2, 611)
    assert 0.0 < ghost_of(here)[0] - before_m < 0.05, "and goes on from there"


def test_a_virtual_robot_cannot_push_a_real_one(tmp_path: Path, state: States) -> None:
    here = environment(tmp_path, GHOST.replace("X", "-0.5"))
    for step in range(45):
        here.step(state({31: (0.0, 0.6, 0.0)}, (step + 1) * STEP_NS), step - 3, {})
    assert ghost_of(here)[0] == pytest.approx(-0.07, abs=2e-3)


def test_a_virtual_robot_of_another_model_drives_and_stands_as_its_file_says(
    tmp_path: Path, state: States
) -> None:
    """Its body meets a real one 8 cm before its middle; real e-pucks have controllers of theirs."""
    thymio = GHOST.replace("vs:virtual=", 'vs:model="thymio2" vs:virtual=').replace("X", "-0.5")
    with pytest.raises(ConfigError, match="of the models epuck and thymio2: each needs"):
        environment(tmp_path, thymio)
    here = environment(tmp_path, thymio.replace("sower", "other"), other=True)
    assert here.world.models[0x10000].name == "thymio2"
    for step in range(45):
        here.step(state({31: (0.0, 0.6, 0.0)}, (step + 1) * STEP_NS), step - 3, {})
    assert ghost_of(here)[0] == pytest.approx(-0.035 - 0.08, abs=2e-3)
    data = messages.world(here.world)["entities"][-1]
    assert (data["model"], data["radius_m"]) == ("thymio2", 0.08)


def test_loop_functions_may_move_and_remove_virtual_robots(tmp_path: Path, state: States) -> None:
    here = environment(tmp_path, GHOST.replace("X", "-0.5"))
    live(here, state, 6)
    here.world.move("ghost", 0.0, -1.0, math.pi / 2)
    live(here, state, 1, 6)
    x_m, y_m = ghost_of(here)
    assert x_m == pytest.approx(0.0, abs=1e-6) and -1.0 < y_m < -0.9
    here.world.remove("ghost")
    readings = here.step(state(ROBOTS, STEP_NS * 8), 5, {})
    assert len(here.world.robots) == 2 and set(readings) == {31, 1843, 0x10000}


def test_a_puppet_stays_where_it_is_put(tmp_path: Path, state: States) -> None:
    puppet = GHOST.replace("X", "-0.5").replace('<controller config="sower" />', "")
    here = environment(tmp_path, puppet)
    live(here, state, 8)
    assert ghost_of(here) == (-0.5, 0.6)


def test_a_virtual_robot_repeats_its_run_bit_by_bit(tmp_path: Path, state: States) -> None:
    one, same = (environment(tmp_path, GHOST.replace("X", "-0.5")) for _ in range(2))
    for here in (one, same):
        live(here, state, 12)
    assert one.world.robots.tobytes() == same.world.robots.tobytes()
    np.testing.assert_array_equal(
        one.world.fields["trail"].concentration, same.world.fields["trail"].concentration
    )
    assert NEVER_NS not in one.world.robots["capture_ns"]


def test_own_sensors_are_where_a_robot_has_put_them() -> None:
    """`remote.c` says of each sensor how many numbers are known, then them, one after the other."""
    devices = OwnDevices(Table(), [31], STEP_NS)
    numbers = [
        number
        for at, count in enumerate(OWN_COUNTS.values())
        for number in (count, *(100.0 * at + n for n in range(count)))
    ]
    devices.hear(31, np.array(numbers, "<f4").tobytes(), 7)
    none = SensorReadings([31], [], np.zeros((1, 0), np.uint8), np.zeros((1, 0), np.int64))
    readings = devices.sense(none, 7)[31]
    for at, (count, (data, measured_ns)) in enumerate(zip(OWN_COUNTS.values(), readings)):
        values = np.frombuffer(data, "<f4").tolist()
        assert (values, measured_ns) == ([100.0 * at + n for n in range(count)], 7)
    assert len(readings) == len(OWN_COUNTS)


def test_virtual_numbers_count_beside_own_ones_while_they_are_fresh() -> None:
    """Of `+proximity` and the ring the larger one, each; 2.5 timesteps long."""
    tags = [1, 2, 3, 4]
    devices = OwnDevices(Table([Entry(1, "+proximity", "8*f4")]), tags, STEP_NS)
    own = np.zeros(sum(1 + count for count in OWN_COUNTS.values()), "<f4")
    own[:9] = 8, *range(0, 80, 10)
    for tag in tags:
        devices.hear(tag, own.tobytes(), 7)
    now_ns = 10 * STEP_NS
    taken_ns = [now_ns, now_ns - 5 * STEP_NS // 2, now_ns - 5 * STEP_NS // 2 - 1, NEVER_NS]
    block = np.full((4, 8), 35.0, "<f4").view(np.uint8)
    virtual = SensorReadings(tags, [32], block, np.array(taken_ns).reshape(4, 1))
    sensed = devices.sense(virtual, now_ns)
    rings = [np.frombuffer(sensed[tag][0][0], "<f4").tolist() for tag in tags]
    alone = [*range(0, 80, 10)]
    assert rings == [[max(35, n) for n in alone]] * 2 + [alone] * 2
