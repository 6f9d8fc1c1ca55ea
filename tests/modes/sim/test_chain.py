"""Timesteps in C as far as they are C: the same bits, notes and failures as one after the other."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from tests.bench.sim import CONTROLLER
from tests.conftest import require_tool
from tests.modes.sim.conftest import LENGTH_S, results_of, world_of
from vsense.base.errors import VsenseError
from vsense.base.files import PACKAGE_FOLDER
from vsense.config.experiment import load
from vsense.config.specs import Experiment, Stage
from vsense.modes.sim._chain import Chain
from vsense.modes.sim._simulation import WARM_UP_TIMESTEPS, Simulation
from vsense.monitor.pictures.run_samples import RunSamples
from vsense.run.changing import Change, carry_out
from vsense.run.programs import shared_objects

SHIPPED = sorted((PACKAGE_FOLDER / "config" / "experiments").glob("*.argos"))

LIGHT = '<virtual_light_sensor implementation="default" formula="epuck" vs:angles="false" />'

TALKING = r"""
#include "controller.h"

struct talker { int light; int steps; };

static void init(void *state, struct vs_robot *robot)
{
    ((struct talker *)state)->light = vs_robot_sensor(robot, "light");
}

static void step(void *state, struct vs_robot *robot)
{
    struct talker *t = state;
    struct vs_reading light = vs_robot_read(robot, t->light);

    t->steps++;
    vs_robot_set_wheels(robot, 300, 200 + (int)(vs_robot_random(robot) * 200.0));
    vs_robot_set_leds(robot, t->steps % 7);
    if (t->steps % 40 == 0)
        vs_robot_show(robot, "light", light.value);
    if (t->steps % 60 == 0)
        vs_robot_log(robot, "hello");
}

const struct vs_controller vs_controller = {"talker", sizeof(struct talker), init, step};
"""


@pytest.fixture(autouse=True)
def compiler() -> None:
    require_tool("cc", "build-essential")


def outcome(run: Simulation) -> tuple[object, ...]:
    """All that comes of a run, its failure too."""
    try:
        ended: object = run.run()
    except VsenseError as error:
        ended = type(error).__name__, str(error)
    return *results_of(run), len(run.record.timesteps), ended


def both_ways(
    experiment: Experiment,
    monkeypatch: pytest.MonkeyPatch,
    sampled: bool = False,
    blind: bool = False,
) -> tuple[tuple[object, ...], tuple[object, ...], int]:
    """The run in C, the run in Python, and how many timesteps of the first one were C."""
    in_c = [0]
    whole = Chain.run

    def counted(chain: Chain, *args: int) -> None:
        try:
            whole(chain, *args)
        finally:
            in_c[0] += chain.done

    runs = []
    for chained in (True, False):
        with monkeypatch.context() as patch:
            patch.setattr(Chain, "run", counted)
            if not chained:
                patch.setattr(Simulation, "_chained", lambda run: None)
            run = Simulation(experiment, shared_objects(experiment), 3, blind)
            run.samples = RunSamples(experiment) if sampled else None
            runs.append(outcome(run))
    return runs[0], runs[1], in_c[0]


GROUND = '<virtual_rgb_ground_sensor implementation="default" />'

VARIANTS = {
    "plain": (),
    "uniform noise": ((LIGHT, LIGHT.replace("formula", "noise_level='0.05' formula")),),
    "normal noise": ((LIGHT, LIGHT.replace("formula", "noise_std_dev='0.05' formula")),),
    "thesis": ((LIGHT, LIGHT.replace("epuck", "thesis")),),
    "no sensor": ((LIGHT, ""),),
    "fast": (('ticks_per_second="10"', 'ticks_per_second="25"'),),
    "latency": ((LIGHT, LIGHT.replace("formula", "vs:latency='2' formula")),),
    "drop-out": ((LIGHT, LIGHT.replace("formula", "vs:drop_out='0.2' formula")),),
    "condition": ((LIGHT, LIGHT.replace("formula", "vs:update='change' formula")),),
    "Python beside C": ((LIGHT, f"<gps_virtual_sensor implementation='default' />{LIGHT}"),),
    "wheels": (
        ('<epuck_wheels implementation="default" />', '<epuck_wheels noise_std_dev="0.1" />'),
    ),
    "whole numbers": ((LIGHT, LIGHT + GROUND),),
    "noisy whole numbers": ((LIGHT, LIGHT + GROUND.replace(" imp", " noise_level='0.1' imp")),),
}


@pytest.mark.parametrize("name", VARIANTS)
def test_c_gives_the_same_bits(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    experiment = world_of(tmp_path, 15, *VARIANTS[name])
    in_c, in_python, timesteps = both_ways(experiment, monkeypatch)
    assert in_c == in_python
    assert timesteps == experiment.timesteps - 1


def test_what_cannot_be_chained_is_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    faster = 'ticks_per_second="10"', 'ticks_per_second="40"'
    *_, timesteps = both_ways(world_of(tmp_path, 3, faster), monkeypatch)
    assert timesteps == 0


@pytest.mark.parametrize(
    "blind", [False, pytest.param(True, marks=pytest.mark.campaign)], ids=["seeing", "blind"]
)
@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_experiments_are_the_same(
    path: Path, blind: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment = load(str(path), LENGTH_S, {}, Stage.SIM)
    in_c, in_python, timesteps = both_ways(experiment, monkeypatch, not blind, blind)
    assert in_c == in_python
    assert timesteps == experiment.timesteps - 1


def with_loop(folder: Path, code: str, *changes: tuple[str, str]) -> Experiment:
    """The world with loop functions, a field and all devices that C knows."""
    (folder / "hooks.py").write_text(code)
    field = '<vs:field id="trail" cell="0.1" evaporation="0.1" diffusion="0.001" />'
    zone = '<vs:zone id="goal" shape="circle" radius="0.4" position="0.3,0.2,0" color="red" />'
    sensors = (
        LIGHT
        + GROUND
        + '<destination_virtual_sensor implementation="default" vs:target="goal" />'
        + '<virtual_field_sensor implementation="default" field="trail" noise_level="0.5" />'
    )
    wheels = '<epuck_wheels implementation="default" />'
    leaving = f'{wheels}<virtual_pheromone_actuator implementation="default" field="trail" />'
    (folder / "loop.c").write_text(LEAVING)
    wander = f'library="{CONTROLLER}"'
    return world_of(
        folder,
        6,
        (LIGHT, sensors),
        (wheels, leaving),
        (wander, 'library="loop.c"'),
        ("<distribute>", f"{field}{zone}<distribute>"),
        ("</controllers>", '</controllers><loop_functions library="hooks.py" />'),
        *changes,
    )


LEAVING = r"""
#include "controller.h"

struct leaving { int ids[5]; double sum; };

static void init(void *state, struct vs_robot *robot)
{
    static const char *names[] = {"light", "rgb_ground", "destination", "pheromone"};
    struct leaving *s = state;

    for (int i = 0; i < 4; i++)
        s->ids[i] = vs_robot_sensor(robot, names[i]);
    s->ids[4] = vs_robot_actuator(robot, "pheromone_release");
}

static void step(void *state, struct vs_robot *robot)
{
    struct leaving *s = state;
    double values[8];

    for (int i = 0; i < 4; i++) {
        int count = vs_robot_values(robot, s->ids[i], values, 8);

        for (int k = 0; k < count; k++)
            s->sum += values[k];
    }
    s->sum -= 1000.0 * (int)(s->sum / 1000.0);
    vs_robot_actuate(robot, s->ids[4], 0, vs_robot_random(robot));
    vs_robot_actuate(robot, s->ids[4], 1, (int)(s->sum / 100.0));
    vs_robot_set_wheels(robot, 300 + (int)(s->sum / 10.0), 300);
}

const struct vs_controller vs_controller = {"leaving", sizeof(struct leaving), init, step};
"""

HEARING = r"""
#include "controller.h"

struct hearing { int sensors[4]; int message, leds, steps; };

static void init(void *state, struct vs_robot *robot)
{
    static const char *names[] = {"proximity", "ground", "range_and_bearing",
                                  "omnidirectional_camera"};
    struct hearing *s = state;

    for (int i = 0; i < 4; i++)
        s->sensors[i] = vs_robot_sensor(robot, names[i]);
    s->message = vs_robot_actuator(robot, "message");
    s->leds = vs_robot_actuator(robot, "rgb_leds");
}

static void step(void *state, struct vs_robot *robot)
{
    struct hearing *s = state;
    double values[128], sum = 0.0;

    for (int i = 0; i < 4; i++) {
        int count = vs_robot_values(robot, s->sensors[i], values, 128);

        for (int k = 0; k < count; k++)
            sum += values[k] * (1 + k % 3);
    }
    sum -= 200.0 * (int)(sum / 200.0);
    vs_robot_actuate(robot, s->message, 0, s->steps++ % 5);
    for (int k = 1; k < 5; k++)
        vs_robot_actuate(robot, s->message, k, (int)sum + k);
    for (int k = 0; k < 9; k++)
        vs_robot_actuate(robot, s->leds, k, k % 3 ? (int)sum : 0);
    vs_robot_set_wheels(robot, 300 + (int)sum, 300 - (int)sum);
}

const struct vs_controller vs_controller = {"hearing", sizeof(struct hearing), init, step};
"""


def test_what_published_files_ask_for_is_all_c(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All devices of a published e-puck, with noise that is drawn from the world's chance."""
    (tmp_path / "hearing.c").write_text(HEARING)
    rab = "<epuck_range_and_bearing implementation='medium' medium='rab' data_size='4' {} />"
    wheels = '<epuck_wheels implementation="default" />'
    ring = '<epuck_proximity implementation="default" />'
    heard = rab.format("loss_probability='0.5' noise_std_dev='0.02' real_range_noise='true'")
    seen = "<epuck_omnidirectional_camera medium='leds' noise_std_dev='0.02' />"
    shining = "<epuck_rgb_leds medium='leds' />" + rab.format("range='0.7'")
    experiment = world_of(
        tmp_path,
        12,
        (wheels, wheels + shining),
        (ring, ring.replace("/>", "vs:virtual='true' noise_level='0.05' />") + heard + seen),
        (LIGHT, LIGHT + "<epuck_ground implementation='rot_z_only' noise_level='0.05' />"),
        ('<led id="leds" />', '<led id="leds" /><range_and_bearing id="rab" />'),
        (f'library="{CONTROLLER}"', 'library="hearing.c"'),
    )
    stops = []
    whole = Chain.run

    def stopped(chain: Chain, *args: int) -> None:
        whole(chain, *args)
        stops.append(chain.cdata.stops)

    monkeypatch.setattr(Chain, "run", stopped)
    in_c, in_python, timesteps = both_ways(experiment, monkeypatch)
    assert in_c == in_python
    assert timesteps == experiment.timesteps - 1
    assert set(stops) == {0}


CHANGES = {
    "only looks": "    world.results['east'] = float(world.robots['x_m'].mean())",
    "moves a zone": "    world.move('goal', 0.1 * t % 1.0, 0.0)",
    "takes the goal away": "    world.remove('goal') if t == 20 else None",
    "moves a light": "    world.put(Light('spot', (0.1 * t % 1.0, 0.0, 0.3), 1.0 + t % 3))",
    "puts a box": "    world.put(Box(f'box_{t}', (0.1 * t % 1.0, 0.3, 0), (0.1, 0.1, 0.2)))",
    "puts a robot": "    world.put(VirtualRobot('ghost', 70000, 0.01 * t % 1.0, 0.1))",
    "paints the floor": "    world.floor = Floor(color=(t % 256, 9, 9))",
    "fills the field": "    world.fields['trail'].fill(t % 7)",
    "changes its array": "    f = world.fields['trail']; f.concentration = f.concentration * 2 % 9",
    "changes its rate": "    world.fields['trail'].evaporation_per_s = 0.01 * (t % 5)",
}
HOOKS = """
from vsense.world.entities import *
from vsense.world.fields import Floor

def {hook}(world):
    t = world.run_timestep
{change}
    if t == {wrong}:
        raise ValueError("enough")
"""


@pytest.mark.parametrize("hook", ["pre_step", "post_step"])
@pytest.mark.parametrize("name", CHANGES)
def test_loop_functions_change_what_they_like(
    name: str, hook: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code = HOOKS.format(hook=hook, change=CHANGES[name], wrong=-1)
    experiment = with_loop(tmp_path, code)
    in_c, in_python, timesteps = both_ways(experiment, monkeypatch, sampled=True)
    assert in_c == in_python
    assert timesteps == experiment.timesteps - 1


@pytest.mark.parametrize("hook", ["pre_step", "post_step"])
def test_what_fails_fails_at_its_time(
    hook: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code = HOOKS.format(hook=hook, change="    pass", wrong=77)
    in_c, in_python, timesteps = both_ways(with_loop(tmp_path, code), monkeypatch, sampled=True)
    assert in_c == in_python
    assert in_c[-2] == 77 and "hooks.py" in str(in_c[-1])
    assert timesteps == 76


def test_a_sensor_that_cannot_travel_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dazzle = "    world.put(Light('sun', (0.0, 0.0, 0.3), 1e6 if t < 50 else 1e25))"
    code = HOOKS.format(hook="post_step", change=dazzle, wrong=-1)
    thesis = (LIGHT, LIGHT.replace("epuck", "thesis"))
    experiment = with_loop(tmp_path, code, thesis)
    monkeypatch.setattr("vsense.world.entities.MAX_INTENSITY", 1e30)
    in_c, in_python, _ = both_ways(experiment, monkeypatch)
    assert in_c[:-1] == in_python[:-1]
    assert in_c[-2] == 51
    for ended in (in_c[-1], in_python[-1]):
        assert isinstance(ended, tuple) and ended[0] == "SensorError" and "'light'" in ended[1]


def test_notes_have_their_times(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "talker.c").write_text(TALKING)
    library = f'library="{CONTROLLER}"'
    experiment = world_of(tmp_path, 4, (library, 'library="talker.c"'))
    in_c, in_python, timesteps = both_ways(experiment, monkeypatch)
    assert in_c == in_python
    assert timesteps == experiment.timesteps - 1
    events = in_c[3]
    assert isinstance(events, list)
    assert [time_s for time_s, _ in events] == [5.9] * 4 + [11.9] * 4 + [17.9] * 4


def test_what_people_change_is_the_same_in_c(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A lamp, a wall that is in the way, a noise and a latency, between calls of a run in C."""
    experiment = world_of(tmp_path, 15, (LIGHT, LIGHT + GROUND))
    (light, _), (wall, *_) = experiment.controllers[0].sensors, experiment.boxes
    own = {"controller": experiment.controllers[0].id, "name": light.sensor.name}
    wanted: dict[int, dict[str, Any]] = {
        7: {"kind": "move", "name": "light_0", "x_m": 0.2, "y_m": 0.3},
        20: {"kind": "set", "setting": "noise_level", "value": 0.05, **own},
        31: {"kind": "move", "name": wall.id, "x_m": 0.1, "y_m": 0.0},
        40: {"kind": "set", "setting": "latency", "value": 2, **own},
        55: {"kind": "set", "setting": "latency", "value": 0, **own},
        60: {"kind": "add", "x_m": 0.0, "y_m": 0.2},
    }
    chained = Simulation._chained

    def run(changes: Mapping[int, Mapping[str, Any]], in_c: bool) -> tuple[object, ...]:
        monkeypatch.setattr(Simulation, "_chained", chained if in_c else lambda run: None)
        made = Simulation(experiment, shared_objects(experiment), 3)
        at = -WARM_UP_TIMESTEPS
        while at < experiment.timesteps:
            if at in changes:
                carry_out(Change.read(changes[at]), made.environment, made.ground)
            at += made.go_on(at, 1 if at < 0 else min(t - at for t in (*wanted, 99999) if t > at))
        assert (made.chain is not None) is in_c
        return results_of(made)

    changed = run(wanted, True)
    assert changed == run(wanted, False)
    for left_out in (20, 31):
        assert changed != run({t: c for t, c in wanted.items() if t != left_out}, True)
