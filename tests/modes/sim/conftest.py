"""Controllers and experiments for simulations, built once."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.bench.sim import experiment_text
from tests.conftest import require_tool
from vsense.config.experiment import load
from vsense.config.specs import Experiment, Stage
from vsense.modes.sim._simulation import Simulation
from vsense.modes.sim.job import Job, Setup
from vsense.modes.sim.outcome import Task, libraries_of
from vsense.robots import build

CALLS = r"""
#include <stdio.h>
#include <stdlib.h>

/* What no controller should have: tells whether the process is fresh. */
static int calls(void)
{
    const char *before = getenv("PROBE_CALLS");
    int now = 1 + (before ? atoi(before) : 0);
    char text[12];

    snprintf(text, sizeof text, "%d", now);
    setenv("PROBE_CALLS", text, 1);
    return now;
}
"""

PROBE = """
#include "controller.h"

struct probe { int heard; int smell; };

static void init(void *state, struct vs_robot *robot)
{
    struct probe *p = state;

    p->smell = vs_robot_sensor(robot, "smell");
    p->heard = vs_robot_actuator(robot, "heard");
    vs_robot_sensor(robot, "moonlight");
}

static void step(void *state, struct vs_robot *robot)
{
    struct probe *p = state;
    struct vs_reading smell = vs_robot_read(robot, p->smell);

    vs_robot_show(robot, "smell", smell.value);
    if (smell.value > 50.0)
        vs_robot_log(robot, "it smells");
    if (smell.value > 90.0)
        for (int i = 0; i < 9; i++)
            vs_robot_log(robot, i == 8 ? "last" : "more");
    vs_robot_actuate(robot, p->heard, 0, vs_robot_random(robot));
    vs_robot_actuate(robot, p->heard, 1, smell.known ? smell.value : -1.0);
    vs_robot_actuate(robot, p->heard, 2, (double)smell.age_ns / 1e6);
    vs_robot_actuate(robot, p->heard, 3, calls());
    vs_robot_set_wheels(robot, (int)vs_robot_param(robot, "speed", 100.0), 3000);
}

const struct vs_controller vs_controller = {"probe", sizeof(struct probe), init, step};
"""

FAULTY = r"""
#include "controller.h"
#include <signal.h>
#include <unistd.h>

enum { NOTHING, SEGMENT, DIVIDE, ABORT, LOOP, EXIT, TALK, KILL };
struct faulty { int fault; int steps; };

static int parent_of(int pid)
{
    char path[32];
    int parent = 0;
    FILE *file;

    snprintf(path, sizeof path, "/proc/%d/stat", pid);
    file = fopen(path, "r");
    if (file && fscanf(file, "%*d %*s %*c %d", &parent) != 1)
        parent = 0;
    if (file)
        fclose(file);
    return parent;
}

static void init(void *state, struct vs_robot *robot)
{
    ((struct faulty *)state)->fault = (int)vs_robot_param(robot, "fault", NOTHING);
    vs_robot_sensor(robot, "pollutant");
    vs_robot_param(robot, "stop_probability", 0.0);
    vs_robot_param(robot, "speed_cm_s", 0.0);
    vs_robot_param(robot, "walk_s", 0.0);
}

static void step(void *state, struct vs_robot *robot)
{
    struct faulty *f = state;
    volatile int zero = 0;
    volatile int forever = 1;

    vs_robot_set_wheels(robot, 300, 100 + calls() / 1000);
    if (++f->steps != 5)
        return;
    switch (f->fault) {
    case SEGMENT: *(volatile int *)(size_t)zero = 1; break;
    case DIVIDE: zero = f->steps / zero; break;
    case ABORT: abort();
    case LOOP: while (forever) {} break;
    case EXIT: exit(7);
    case KILL: kill(parent_of(getppid()), SIGKILL); break; /* of the process behind its own */
    case TALK: puts("{\"result\": 1}"); fflush(stdout); break;
    }
}

const struct vs_controller vs_controller = {"faulty", sizeof(struct faulty), init, step};
"""

LENGTH_S = 20.0


@pytest.fixture(scope="module", autouse=True)
def cache(shared_cache: Path) -> None:
    """Builds land in a folder of the tests' own, shared by all of them and by all workers."""


def library(folder: Path, name: str, source: str) -> Path:
    """Builds a controller's shared object."""
    require_tool("cc", "build-essential")
    (folder / f"{name}.c").write_text(CALLS + source)
    return build.shared(f"{name}.c", folder)


@pytest.fixture(scope="module")
def probe(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A controller that reports what it hears through the actuator `heard` (4 numbers)."""
    return library(tmp_path_factory.mktemp("probe"), "probe", PROBE)


@pytest.fixture(scope="module")
def pollutant() -> Path:
    """The shipped controller."""
    require_tool("cc", "build-essential")
    return build.shared("pollutant")


Writer = Callable[..., Path]


@pytest.fixture(scope="session")
def write_experiment(tmp_path_factory: pytest.TempPathFactory) -> Writer:
    """Writes an experiment beside a controller with faults; changes are (old, new) in its text."""
    folder = tmp_path_factory.mktemp("experiments")
    (folder / "faulty.c").write_text(CALLS + FAULTY)
    shipped = build.source_tree().root / "vsense" / "config" / "experiments" / "pollutant.argos"
    plain = shipped.read_text().replace('library="pollutant"', 'library="faulty.c"')

    def write(name: str, *changes: tuple[str, str]) -> Path:
        text = plain
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        path = folder / f"{name}.argos"
        path.write_text(text)
        return path

    return write


def task_of(path: Path, fault: str = "0", seed: int = 1, **changes: Any) -> Task:
    """One second of an experiment whose controller has a fault, as a worker is asked for it."""
    setup = Setup(str(path), 1.0, settings={"wanderer.fault": fault}, **changes)
    experiment = setup.load()
    libraries = libraries_of(experiment)
    return Task(Job(setup, seed, libraries), experiment)


def world_of(folder: Path, robots: int = 15, *changes: tuple[str, str]) -> Experiment:
    text = experiment_text(robots)
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "world.argos"
    path.write_text(text)
    return load(str(path), LENGTH_S, {}, Stage.SIM)


def results_of(run: Simulation) -> tuple[object, ...]:
    record, samples = run.record, run.samples
    kept = record.poses.tobytes(), record.leds.tobytes(), record.share.tobytes()
    sampled: tuple[object, ...] = ()
    if samples is not None:
        fields = [f.tobytes() for s in samples.snapshots.values() for f in s.fields]
        series = {name: values.tolist() for name, values in samples.measures().items()}
        sampled = sorted(samples.snapshots), fields, series, samples.shares.tolist()
    return *kept, *sampled, record.events, record._shown, run.complaints()
