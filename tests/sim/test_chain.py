"""Timesteps in one call of C: the same bits, notes and failures as one after the other."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.conftest import require_tool
from vsense.bench.sim import experiment_text
from vsense.config.experiment import load
from vsense.config.specs import Experiment, Stage
from vsense.robot import build
from vsense.run.programs import shared_objects
from vsense.sim.chain import Chain
from vsense.sim.simulation import Simulation

LIGHT = '<virtual_light_sensor implementation="default" formula="epuck" vs:angles="false" />'
LENGTH_S = 20.0

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


def world(folder: Path, robots: int = 15, *changes: tuple[str, str]) -> Experiment:
    text = experiment_text(robots)
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "world.argos"
    path.write_text(text)
    return load(str(path), LENGTH_S, {}, Stage.SIM)


def told(run: Simulation) -> tuple[object, ...]:
    record = run.record
    kept = record.poses.tobytes(), record.leds.tobytes(), len(record.timesteps)
    return *kept, record.events, record._shown, run.complaints()


def both_ways(
    experiment: Experiment, monkeypatch: pytest.MonkeyPatch
) -> tuple[tuple[object, ...], tuple[object, ...], int]:
    """The run in C, the run in Python, and how many timesteps of the first one were C."""
    in_c = [0]
    whole = Chain.run

    def counted(chain: Chain, *args: int) -> int:
        done = whole(chain, *args)
        in_c[0] += done
        return done

    runs = []
    for chained in (True, False):
        with monkeypatch.context() as patch:
            patch.setattr(Chain, "run", counted)
            if not chained:
                patch.setattr(Simulation, "_chained", lambda run: None)
            run = Simulation(experiment, shared_objects(experiment), 3)
            run.run()
            runs.append(told(run))
    return runs[0], runs[1], in_c[0]


VARIANTS = {
    "plain": (),
    "uniform noise": ((LIGHT, LIGHT.replace("formula", "noise_level='0.05' formula")),),
    "normal noise": ((LIGHT, LIGHT.replace("formula", "noise_std_dev='0.05' formula")),),
    "thesis": ((LIGHT, LIGHT.replace("epuck", "thesis")),),
    "no sensor": ((LIGHT, ""),),
    "fast": (('ticks_per_second="10"', 'ticks_per_second="25"'),),
}


@pytest.mark.parametrize("name", VARIANTS)
def test_c_gives_the_same_bits(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    experiment = world(tmp_path, 15, *VARIANTS[name])
    in_c, in_python, timesteps = both_ways(experiment, monkeypatch)
    assert in_c == in_python
    assert timesteps == experiment.timesteps - 1


@pytest.mark.parametrize(
    "change",
    [
        (LIGHT, LIGHT.replace("formula", "vs:latency='2' formula")),
        (LIGHT, LIGHT.replace("formula", "vs:drop_out='0.2' formula")),
        (LIGHT, LIGHT.replace("formula", "vs:update='change' formula")),
        (LIGHT, "<gps_virtual_sensor implementation='default' />"),
        ('ticks_per_second="10"', 'ticks_per_second="40"'),
        ('<epuck_wheels implementation="default" />', '<epuck_wheels noise_std_dev="0.1" />'),
    ],
)
def test_what_needs_python_gets_it(
    change: tuple[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    *_, timesteps = both_ways(world(tmp_path, 3, change), monkeypatch)
    assert timesteps == 0


def test_notes_have_their_times(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "talker.c").write_text(TALKING)
    library = f'library="{build.source_tree().root / "vsense" / "bench" / "wander.c"}"'
    experiment = world(tmp_path, 4, (library, 'library="talker.c"'))
    in_c, in_python, timesteps = both_ways(experiment, monkeypatch)
    assert in_c == in_python
    assert timesteps == experiment.timesteps - 1
    events = in_c[3]
    assert isinstance(events, list)
    assert [time_s for time_s, _ in events] == [5.9] * 4 + [11.9] * 4 + [17.9] * 4
