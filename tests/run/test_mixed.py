"""Mixed swarms: what robots of several controllers have for themselves, and what they share."""

from __future__ import annotations

import struct
import threading
from pathlib import Path

import pytest

from tests.conftest import States, require_tool
from vsense.config.experiment import load
from vsense.config.specs import Experiment
from vsense.modes.sim._simulation import Simulation
from vsense.modes.sim.job import Job, Setup
from vsense.modes.sim.outcome import Task
from vsense.modes.sim.watch import simulate_all
from vsense.robots.inprocess import SimError
from vsense.robots.link.table import Direction
from vsense.run.environment import Environment
from vsense.run.programs import shared_objects, told_programs

STEP_NS = 100_000_000

TALKER = """
#include "controller.h"

struct talker { int lamp; };

static void init(void *state, struct vs_robot *robot)
{
    ((struct talker *)state)->lamp = vs_robot_actuator(robot, "led_color");
    vs_robot_log(robot, "NAME begins");
}

static void step(void *state, struct vs_robot *robot)
{
    vs_robot_actuate(robot, ((struct talker *)state)->lamp, 0, 200.0);
    vs_robot_set_wheels(robot, SPEED, SPEED);
    if (vs_robot_param(robot, "die", 0.0) > 0.0)
        __builtin_trap();
}

const struct vs_controller vs_controller = {"NAME", sizeof(struct talker), init, step};
"""

FILE = """<argos-configuration xmlns:vs="urn:vsense:1">
  <framework><experiment length="2" ticks_per_second="10" random_seed="1" /></framework>
  <controllers>
    <dog_controller id="dog" library="dog.c">
      <actuators><virtual_leds_actuator /></actuators>
      <sensors>
        <virtual_field_sensor field="grass" />
        <gps_virtual_sensor noise_std_dev="0.1" />
      </sensors>
      <params bark="loud" />
    </dog_controller>
    <sheep_controller id="sheep" library="sheep.c">
      <actuators>
        <virtual_pheromone_actuator field="grass" name="graze" />
      </actuators>
      <sensors><gps_virtual_sensor noise_std_dev="0.1" /></sensors>
    </sheep_controller>
  </controllers>
  <arena size="3,2.4,1" center="0,0,0.5">
    <vs:field id="grass" cell="0.1" evaporation="0" />
    <e-puck id="a_1_0"><body position="0,0,0" orientation="0,0,0" />
      <controller config="sheep" /></e-puck>
    <e-puck id="b_2_1"><body position="0,-0.5,0" orientation="0,0,0" />
      <controller config="dog" /></e-puck>
    <e-puck id="c_3_2"><body position="0,-1,0" orientation="0,0,0" />
      <controller config="sheep" /></e-puck>
    <e-puck id="wolf" vs:virtual="true"><body position="0,0.8,0" orientation="0,0,0" />
      <controller config="dog" /></e-puck>
  </arena>
</argos-configuration>
"""
WOLF = 0x10000


@pytest.fixture(scope="module")
def experiment(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    require_tool("cc", "build-essential")
    folder = tmp_path_factory.mktemp("mixed")
    for name, speed in (("sheep", "100"), ("dog", "300")):
        (folder / f"{name}.c").write_text(TALKER.replace("NAME", name).replace("SPEED", speed))
    (folder / "mixed.argos").write_text(FILE)
    return load(folder / "mixed.argos")


def sensed(reading: tuple[bytes, int]) -> tuple[float, ...]:
    return struct.unpack("<3f", reading[0])


def test_each_controller_has_a_table_of_its_own(experiment: Experiment) -> None:
    environment = Environment(experiment, 1)
    dog, sheep = environment.equipment
    assert (sheep.tags, dog.tags) == ((1, 3), (2, WOLF))
    assert [e.name for e in sheep.table.entries] == ["gps", "graze"]
    assert [e.name for e in dog.table.entries] == ["pheromone", "gps", "led_color"]
    assert [e.id for e in dog.table.entries] == [1, 2, 3]
    assert [e.name for e in environment.entries(Direction.SENSOR)[WOLF]] == ["pheromone", "gps"]
    driven = environment.world.driven_by("dog")
    assert environment.world.robots["tag"][driven].tolist() == [2, WOLF]


def test_what_one_does_in_the_world_another_senses(experiment: Experiment, state: States) -> None:
    environment = Environment(experiment, 1)
    places = {1: (0.5, 0.5, 0.0), 2: (0.5, 0.5, 0.0), 3: (-0.5, 0.0, 0.0)}
    said = {1: struct.pack("<2f", 0.0, 7.0), 2: struct.pack("<3B", 9, 8, 7)}
    readings: dict[int, list[tuple[bytes, int]]] = {}
    for step in range(2):
        arena = state(places, (step + 1) * STEP_NS)
        readings = environment.step(arena, step, said)  # type: ignore[assignment]
    assert [len(readings[tag]) for tag in (1, 2, 3, WOLF)] == [1, 2, 1, 2]
    assert sensed(readings[2][0])[0] > 100.0, "the sheep's seven on a square decimetre"
    assert environment.world.leds[:2].tolist() == [[0, 0, 0], [9, 8, 7]]


def test_noise_of_one_controller_is_not_that_of_another(
    experiment: Experiment, state: States
) -> None:
    places = {1: (0.5, 0.5, 0.0), 2: (0.5, 0.5, 0.0)}
    readings = Environment(experiment, 1).step(state(places, STEP_NS), 0, {})
    assert sensed(readings[1][0])[:2] != sensed(readings[2][1])[:2]


def test_each_robot_runs_its_own_program(experiment: Experiment) -> None:
    run = Simulation(experiment, shared_objects(experiment), 1)
    run.run()
    ways_m = run.record.poses[-1, :, 0] - run.record.poses[0, :, 0]
    assert ways_m[1] == pytest.approx(3.0 * ways_m[0], rel=0.02)
    assert ways_m[2] == pytest.approx(ways_m[0], rel=1e-3)
    assert run.environment.world.entities["wolf"].x_m == pytest.approx(ways_m[1], rel=0.2)  # type: ignore[union-attr]
    words = sorted(text for _, text in run.record.events)
    assert words == [
        "robot 1: logged: sheep begins",
        "robot 2: logged: dog begins",
        "robot 3: logged: sheep begins",
        f"virtual robot {WOLF}: logged: dog begins",
    ]
    complaints = run.complaints()
    assert "controller 'sheep': nobody offers the virtual actuator 'led_color'" in complaints
    assert "controller 'dog' does not know the parameter 'bark': ignored" in complaints


def test_whose_program_crashes_is_named(experiment: Experiment) -> None:
    setup = Setup(str(experiment.path), 0.5, settings={"sheep.die": "1"})
    libraries = {name: str(path) for name, path in shared_objects(experiment).items()}
    task = Task(Job(setup, 1, libraries), setup.load())
    with pytest.raises(SimError, match=r"robot 1, .*'sheep\.c'"):
        list(simulate_all([task], 1, threading.Event(), lambda workers: None))


def test_what_robots_will_tell_is_known_before_they_come(experiment: Experiment) -> None:
    told = told_programs(experiment)
    assert {id: program.name for id, program in told.items()} == {"dog": "dog", "sheep": "sheep"}
    assert all(len(program.hash) == 12 for program in told.values())
    (controller,) = load("pollutant").controllers
    assert Path(controller.library).stem == told_programs(load("pollutant"))["wanderer"].name
