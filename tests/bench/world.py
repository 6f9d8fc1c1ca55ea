"""`scripts/bench world`: one timestep of the virtual world, and the speed of a simulation.

A timestep here is the update of the world with a new arena state, all light readings of all robots
(24 sensors each, 4 lights, the generic formula; robots are in each other's light) and their bytes
for the wire. Each robot has as much room as in the pollutant experiment. The lights hang just above
the robots, which therefore stand in the way of many rays.

One thread does it all; only its own processor time counts, not that of a busy machine.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from vsense.base.arena import POSE, ArenaState
from vsense.base.readings import SensorReadings
from vsense.base.xml.element import Document, Element
from vsense.config.devices import mount_sensor
from vsense.modes.sim.job import Job, Setup
from vsense.modes.sim.outcome import Task
from vsense.modes.sim.watch import simulate_all
from vsense.run.programs import shared_objects
from vsense.world import Light, World
from vsense.world.sensors.bank import SensorBank
from vsense.world.sensors.base import Scope

ROBOTS = (15, 100, 1000)
SENSORS = 24
LIGHTS = 4
EXPERIMENT = "pollutant"

_ROOM_M2 = 3.0 * 2.4 / 15
_LIGHT_HEIGHT_M = 0.1
_INTENSITY = 0.3
_STATES = 8
_STEP_M = 0.012
_STEP_NS = 100_000_000
_STEPS_OF_ALL = 20_000
"""Robots times timesteps of each round, at least _MIN_STEPS timesteps."""
_MIN_STEPS = 20
_SEED = 14

Say = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class WorldRow:
    """One size of swarm; times are medians of a timestep."""

    robots: int
    ms_per_step: float
    us_per_robot: float


class SensingSwarm:
    """Robots that drive among lights, and their sensors; `states` follow each other."""

    def __init__(self, robots: int) -> None:
        columns = math.ceil(math.sqrt(robots))
        pitch_m = math.sqrt(_ROOM_M2)
        random = np.random.default_rng(_SEED)
        cells = np.stack(np.divmod(np.arange(robots), columns), axis=1) - 0.5 * (columns - 1)
        places = cells * pitch_m + random.uniform(-0.3, 0.3, (robots, 2))
        headings = random.uniform(-math.pi, math.pi, robots)
        self.states = [self._state(places, headings, k) for k in range(_STATES)]
        reach_m = 0.25 * columns * pitch_m
        corners = [(-1, -1), (-1, 1), (1, -1), (1, 1)][:LIGHTS]
        lights = [
            Light(f"light{x}{y}", (x * reach_m, y * reach_m, _LIGHT_HEIGHT_M), _INTENSITY)
            for x, y in corners
        ]
        tags = list(range(robots))
        settings = {"formula": "generic", "vs:ring": str(SENSORS), "vs:angles": "false"}
        element = Element(Document("bench"), "virtual_light_sensor", 1, settings)
        self.world = World(tags, entities=lights)
        self._bank = SensorBank([mount_sensor(element, Scope({}, 0))], tags)
        self._timestep = 0

    def step(self) -> SensorReadings:
        """Handles a timestep; returns the readings of every robot."""
        state = self.states[self._timestep % _STATES]
        self.world.update(state, self._timestep)
        self.world.step()
        self._timestep += 1
        return self._bank.encode(self.world, self._timestep)

    def _state(self, places: Any, headings: Any, timestep: int) -> ArenaState:
        robots = np.zeros(len(places), dtype=POSE)
        robots["tag"] = np.arange(len(places))
        robots["x_m"] = places[:, 0] + timestep * _STEP_M * np.cos(headings)
        robots["y_m"] = places[:, 1] + timestep * _STEP_M * np.sin(headings)
        robots["yaw_rad"], robots["seen"], robots["confidence"] = headings, True, 1.0
        robots["capture_ns"] = timestep * _STEP_NS
        return ArenaState(timestep, timestep * _STEP_NS, robots, len(places))


def run(rounds: int, say: Say, robots: Sequence[int] = ROBOTS) -> dict[str, Any]:
    """Runs the benchmark: in each round each number of robots has its turn.

    Returns:
        The report: `rows`, `floor_ms` for the largest swarm, `sim_speedup`.

    Raises:
        VsenseError: the experiment's controller cannot be built, or a simulation failed.
    """
    swarms = {count: SensingSwarm(count) for count in robots}
    times: dict[int, list[float]] = {count: [] for count in robots}
    floor, speedups = [], []
    simulate = simulation()
    for turn in range(rounds + 1):
        say(f"round {turn} of {rounds}" if turn else "warming up")
        for count, swarm in swarms.items():
            spent = [_timed(swarm.step) for _ in range(max(_STEPS_OF_ALL // count, _MIN_STEPS))]
            times[count] += spent if turn else []
        floor.append(brute_force_floor(max(robots)))
        if turn:
            speedups.append(simulate())
    medians = {count: float(np.median(spent)) for count, spent in times.items()}
    return {
        "rows": [asdict(WorldRow(count, ms, 1e3 * ms / count)) for count, ms in medians.items()],
        "floor_ms": float(np.median(floor[1:])),
        "sim_speedup": float(np.median(speedups)),
    }


def brute_force_floor(robots: int) -> float:
    """Times one NumPy operation on every pair of ray and body, robot by robot [ms]."""
    pairs = np.ones((SENSORS * LIGHTS, robots))

    def touch() -> None:
        for _ in range(robots):
            np.multiply(pairs, pairs, out=pairs)

    return _timed(touch)


def simulation() -> Callable[[], float]:
    """Makes a function that simulates the experiment and returns simulated seconds per second."""
    setup = Setup(EXPERIMENT)
    experiment = setup.load()
    libraries = {name: str(path) for name, path in shared_objects(experiment).items()}

    def simulate() -> float:
        job = Job(setup, _SEED, libraries)
        done = simulate_all([Task(job, experiment)], 1, threading.Event(), lambda workers: None)
        ((_, result),) = done
        return float(result["timesteps"] * result["timestep_s"] / result["wall_s"])

    return simulate


def table(report: dict[str, Any]) -> str:
    """The report as text."""
    lines = [f"{'robots':>6}  {'ms/timestep':>11}  {'us/robot':>8}"]
    for row in report["rows"]:
        robots, ms, us = row["robots"], row["ms_per_step"], row["us_per_robot"]
        lines.append(f"{robots:6d}  {ms:11.3f}  {us:8.2f}")
    floor = f"floor: one NumPy operation on every pair of ray and body {report['floor_ms']:.1f} ms"
    sim = f"vsense sim {EXPERIMENT}: {report['sim_speedup']:.0f} simulated seconds per second"
    return "\n".join([*lines, "", floor, sim])


def _timed(work: Callable[[], object]) -> float:
    begin = time.thread_time()
    work()
    return 1e3 * (time.thread_time() - begin)
