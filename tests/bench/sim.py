"""`scripts/bench sim`: how many robots a simulation steps in a second of one processor's time.

The world is that of the comparison with ARGoS 3, for 15, 100 and 1000 robots: e-pucks anywhere in a
square with four walls, 0.48 m^2 for each as in the pollutant experiment; four lights, 0.4 m above
the middles of its quarters, each of which reaches as far as the square is wide (intensity 0.4 per
metre of that); timesteps of 0.1 s. Each robot has 8 light sensors with `epuck_light`'s formula, for
which bodies stand in the way, the proximity ring (8 sensors, as `epuck_proximity`), two wheels, and
the controller `wander.c`, which reads both rings in every step. Nothing is drawn, and nothing is
kept but poses.

Then, in the same world and with as many robots as in most published experiments, come the devices
that their files ask for, each alone and all together, with ARGoS's noise and the controller
`devices.c`, which reads and sets them all: virtual proximity, ground, range-and-bearing both ways,
and the omnidirectional camera with the LEDs that it sees.

A run is one of a campaign. Its rate is robots times timesteps over the processor time between the
first timestep and the last; what comes before, start-up, is reported apart: the time of a whole
`vsense sim` of one second. The sizes take turns; each rate is the median of its rounds.
"""

from __future__ import annotations

import math
import os
import resource
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vsense.base.native import kernel_ffi, kernels
from vsense.base.processes import python_module
from vsense.base.terminal import aligned
from vsense.modes.sim._chain import Chain
from vsense.modes.sim._simulation import WARM_UP_TIMESTEPS, Simulation
from vsense.modes.sim.job import Job, Setup
from vsense.modes.sim.outcome import Task
from vsense.modes.sim.watch import simulate_all
from vsense.run.programs import shared_objects

ROBOTS = (15, 100, 1000)
TIMESTEP_S = 0.1
LIGHTS = 4

CONTROLLER = Path(__file__).parent / "wander.c"
DEVICES_CONTROLLER = CONTROLLER.with_name("devices.c")
DEVICES_ROBOTS = 20
_NOISE = 'noise_level="0.05"'
_RAB = '<epuck_range_and_bearing implementation="medium" medium="rab" data_size="4" {} />'
DEVICES = {
    "proximity": ((), (f'<epuck_proximity vs:virtual="true" {_NOISE} />',)),
    "ground": ((), (f'<epuck_ground implementation="rot_z_only" {_NOISE} />',)),
    "range and bearing": (
        (_RAB.format('range="0.7"'),),
        (_RAB.format('loss_probability="0.85"'),),
    ),
    "camera and LEDs": (
        ('<epuck_rgb_leds medium="leds" />',),
        ('<epuck_omnidirectional_camera implementation="rot_z_only" medium="leds" />',),
    ),
}
"""Actuators and sensors by what they are called in the report."""
ALL_DEVICES = "all of these"

_ROOM_M2 = 3.0 * 2.4 / 15
_LIGHT_HEIGHT_M = 0.4
_INTENSITY_PER_M = 0.4
_WALL_M = 0.02
STEPS_OF_ALL = 60_000
"""Robots times timesteps of a run, at least MIN_STEPS timesteps."""
MIN_STEPS = 200
_SEED = 14
_REPEATS = 50

Say = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class SimRow:
    """One size of swarm; `us_per_timestep` says where the time of a timestep goes."""

    robots: int
    timesteps: int
    robot_steps_per_s: float
    us_per_timestep: dict[str, float]


def run(rounds: int, say: Say, robots: Sequence[int] = ROBOTS) -> dict[str, Any]:
    """Runs the benchmark: in each round each number of robots has its turn.

    Returns:
        The report: `rows`, see `SimRow` and `parts_us` (and the `rest`), `devices`, the rate with
        each of them alone, and `startup_s`, the processor time of a run of one second.

    Raises:
        VsenseError: the controller cannot be built, or a simulation failed.
    """
    rates: dict[int, list[float]] = {count: [] for count in robots}
    startups = []
    with tempfile.TemporaryDirectory(prefix="vsense-bench-") as folder:
        paths = {count: _written(count, Path(folder)) for count in robots}
        tasks = {count: task(path, timesteps_of(count)) for count, path in paths.items()}
        devices = {name: _with_devices(name, Path(folder)) for name in (*DEVICES, ALL_DEVICES)}
        with_devices: dict[str, list[float]] = {name: [] for name in devices}
        for turn in range(rounds + 1):
            say(f"round {turn} of {rounds}" if turn else "warming up")
            for count in robots:
                rates[count].append(_rate(tasks[count]))
            for name, device in devices.items():
                with_devices[name].append(_rate(device))
            startups.append(startup_s(paths[min(robots)]))
        say("the parts of a timestep")
        parts = {count: parts_us(task) for count, task in tasks.items()}
    rows = []
    for count, spent in rates.items():
        rate = float(np.median(spent[1:]))
        rest_us = 1e6 * count / rate - sum(parts[count].values())
        where = {**parts[count], "rest": max(rest_us, 0.0)}
        rows.append(SimRow(count, timesteps_of(count), rate, where))
    return {
        "rows": [asdict(row) for row in rows],
        "devices": {name: float(np.median(spent[1:])) for name, spent in with_devices.items()},
        "startup_s": float(np.median(startups[1:])),
    }


def _with_devices(name: str, folder: Path) -> Task:
    """A run with one of the devices, or with all."""
    names = [name] if name in DEVICES else list(DEVICES)
    actuators, sensors = ("".join(x for n in names for x in DEVICES[n][kind]) for kind in (0, 1))
    text = experiment_text(DEVICES_ROBOTS)
    if "proximity" in names:
        text = text.replace('<epuck_proximity implementation="default" />', "")
    for old, new in (
        ("</actuators>", f"{actuators}</actuators>"),
        ("</sensors>", f"{sensors}</sensors>"),
        ('<led id="leds" />', '<led id="leds" /><range_and_bearing id="rab" />'),
        (str(CONTROLLER), str(DEVICES_CONTROLLER)),
    ):
        assert old in text
        text = text.replace(old, new)
    path = folder / f"{name.replace(' ', '-')}.argos"
    path.write_text(text)
    return task(path, timesteps_of(DEVICES_ROBOTS))


def timesteps_of(robots: int) -> int:
    """How long a run of so many robots is."""
    return max(STEPS_OF_ALL // robots, MIN_STEPS)


def task(path: Path, timesteps: int) -> Task:
    """One run of an experiment, ready to be simulated."""
    setup = Setup(str(path), timesteps * TIMESTEP_S)
    experiment = setup.load()
    libraries = {name: str(path) for name, path in shared_objects(experiment).items()}
    return Task(Job(setup, _SEED, libraries), experiment)


def _rate(task: Task) -> float:
    """Simulates a run; gives robot-steps per second of processor time."""
    ((_, result),) = simulate_all([task], 1, threading.Event(), lambda workers: None)
    return float(result["robots"] * result["timesteps"] / result["cpu_s"])


def parts_us(task: Task) -> dict[str, float]:
    """Times each kernel of a timestep alone, after a run: processor time [us], medians.

    `physics` moves everything on by a timestep; `world` is the tracker's state and its update of
    the world; `bodies` sorts what stands in the way of light; `sensors` are the virtual ones;
    `rings` the robots' proximity sensors; `controllers` are the robots' programs.
    """
    chain = _run_of(task)  # it keeps what the structure points to
    sim, poses, tracker = chain.cdata, chain.cdata.physics.poses, chain.cdata.tracker
    nothing = kernel_ffi.new("double[]", 8 * len(task.experiment.robots))

    def see() -> None:
        kernels.vs_tracker_see(tracker, poses, nothing, sim.capture_ns)
        kernels.vs_world_update(sim.world, tracker.states, tracker.count, sim.capture_ns)

    def sense() -> None:
        for sensor in sim.sensors[0 : sim.sensors_count]:
            sensor.read(sensor.sensor, sensor.scene, sensor.sent.fresh)
            kernels.vs_sent_renew(sensor.sent, sim.capture_ns)

    def move() -> None:
        sim.capture_ns += sim.dt_ns
        kernels.vs_physics_advance(sim.physics, sim.capture_ns)

    (program,) = sim.programs[0 : sim.programs_count]

    def control() -> None:
        program.timestep[0] += 1
        program.capture_ns[0] += sim.dt_ns
        program.now_ns[0] += sim.dt_ns
        program.step(program.all, program.now)

    return {
        "physics": _median_us(move),
        "world": _median_us(see),
        "bodies": _median_us(lambda: kernels.vs_crowd_stand(sim.crowd, sim.capture_ns)),
        "sensors": _median_us(sense),
        "rings": _median_us(lambda: kernels.vs_rings_read(sim.rings, poses, nothing)),
        "controllers": _median_us(control),
    }


def _run_of(task: Task) -> Chain:
    """The timesteps in C of a run after its last one, whose controllers can go on."""
    libraries = {name: Path(path) for name, path in task.job.libraries.items()}
    run, timestep = Simulation(task.experiment, libraries, task.job.seed), -WARM_UP_TIMESTEPS
    while timestep < task.experiment.timesteps:
        timestep += run.go_on(timestep)
    assert run.chain is not None
    return run.chain


def _median_us(work: Callable[[], object]) -> float:
    spent = []
    for _ in range(_REPEATS):
        begin = time.thread_time_ns()
        work()
        spent.append(time.thread_time_ns() - begin)
    return 1e-3 * float(np.median(spent))


def startup_s(path: Path) -> float:
    """Processor time [s] of a campaign of one run of one second, all processes together."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryDirectory(prefix="vsense-bench-") as folder:
        words = ["sim", str(path), "--duration", "1", "--runs", "1", "-j", "1"]
        subprocess.run(
            [*python_module("vsense"), *words, "-o", f"{folder}/results.csv"],
            check=True,
            capture_output=True,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _written(robots: int, folder: Path) -> Path:
    """Writes the world of so many robots; gives its file."""
    path = folder / f"wander-{robots}.argos"
    path.write_text(experiment_text(robots))
    return path


def experiment_text(robots: int) -> str:
    """The experiment file of the world with so many robots."""
    side_m = math.sqrt(robots * _ROOM_M2)
    half_m, far_m = side_m / 2, side_m / 2 - 0.05
    long, thick = f"{side_m + 2 * _WALL_M}", f"{_WALL_M}"
    places = [("north", 0, 1), ("south", 0, -1), ("east", 1, 0), ("west", -1, 0)]
    walls = [
        f'<box id="wall_{name}" size="{thick if x else long},{thick if y else long},0.08"'
        f' movable="false"><body position="{x * half_m},{y * half_m},0" orientation="0,0,0" />'
        "</box>"
        for name, x, y in places
    ]
    lights = [
        f'<light id="light_{k}" position="{x * side_m / 4},{y * side_m / 4},{_LIGHT_HEIGHT_M}"'
        f' orientation="0,0,0" color="yellow" intensity="{_INTENSITY_PER_M * side_m}"'
        ' medium="leds" />'
        for k, (x, y) in enumerate([(-1, -1), (-1, 1), (1, -1), (1, 1)][:LIGHTS])
    ]
    return _EXPERIMENT.format(
        library=CONTROLLER,
        arena=f"{side_m + 0.1},{side_m + 0.1},1",
        things="\n    ".join([*walls, *lights]),
        far=far_m,
        robots=robots,
        tags=" ".join(map(str, range(1, robots + 1))),
        dt=round(1 / TIMESTEP_S),
    )


_EXPERIMENT = """<?xml version="1.0" ?>
<argos-configuration xmlns:vs="urn:vsense:1">
  <framework><experiment length="60" ticks_per_second="{dt}" random_seed="1" /></framework>
  <controllers>
    <wander_controller id="wander" library="{library}">
      <actuators><epuck_wheels implementation="default" /></actuators>
      <sensors>
        <epuck_proximity implementation="default" />
        <virtual_light_sensor implementation="default" formula="epuck" vs:angles="false" />
      </sensors>
      <params />
    </wander_controller>
  </controllers>
  <arena size="{arena}" center="0,0,0.5">
    {things}
    <distribute>
      <position method="uniform" min="-{far},-{far},0" max="{far},{far},0" />
      <orientation method="uniform" min="-180,0,0" max="180,0,0" />
      <entity quantity="{robots}" max_trials="1000" vs:tags="{tags}">
        <e-puck id="epuck"><controller config="wander" /></e-puck>
      </entity>
    </distribute>
  </arena>
  <vs:rig><vs:marker family="arrow4x4" height="0.06" /></vs:rig>
  <physics_engines><dynamics2d id="dyn2d" /></physics_engines>
  <media><led id="leds" /></media>
</argos-configuration>
"""


def table(report: dict[str, Any]) -> str:
    """The report as text."""
    lines = [("robots", "robot-steps/s", "times real time")]
    for row in report["rows"]:
        rate = row["robot_steps_per_s"]
        times = rate / row["robots"] * TIMESTEP_S
        lines.append((str(row["robots"]), f"{rate:,.0f}", f"{times:,.0f}"))
    lines += [("", "", "")]
    lines += [("robots", "part", "us of a timestep")]
    for row in report["rows"]:
        spent = row["us_per_timestep"].items()
        lines += [(str(row["robots"]), part, f"{us:.1f}") for part, us in spent]
    lines += [("", "", "")]
    lines += [(f"{DEVICES_ROBOTS} with", "robot-steps/s", "")]
    lines += [(name, f"{rate:,.0f}", "") for name, rate in report["devices"].items()]
    startup = f"start-up of a run: {report['startup_s']:.2f} s of processor time"
    return "\n".join([*aligned(lines, left=0), "", startup])
