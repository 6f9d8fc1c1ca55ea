"""Many timesteps in one call of C: `c_src/host/vs_sim.h`.

It calls the kernels that `Simulation.step` calls, in the same order and on the same memory, where
Python has nothing to do in between: no loop functions, no virtual actuators or robots, only sensors
that C reads, and no picture. The results are the same bits.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsense.native import check, kernel_ffi, kernels, lib
from vsense.physics.motion import Physics, pointer
from vsense.physics.proximity_ring import ProximityRing
from vsense.robot.inprocess import RobotProgram
from vsense.run.environment import Environment, Equipment
from vsense.run.programs import Programs
from vsense.sensors.bank import SensorKernel
from vsense.sensors.geometry import SensedScene
from vsense.sim.record import Record, SimulatedTracker


class ChainTimes(NamedTuple):
    """Of a timestep [ns]: its length, and from the capture to rings, controllers and wheels."""

    timestep: int
    sense: int
    control: int
    act: int


class ChainedParts(NamedTuple):
    """What a simulation is made of."""

    physics: Physics
    rings: ProximityRing
    tracker: SimulatedTracker
    environment: Environment
    programs: Programs
    record: Record


class Chain:
    """Timesteps of a run in which the robots run, from its second one.

    Attributes:
        wheels: (n, 2) int16, what the robots' wheels were told last.
        leds: (n,) uint16, their LEDs.
        cdata: the `struct vs_sim *`.
    """

    def __init__(self, parts: ChainedParts, sensors: list[SensorKernel], times: ChainTimes) -> None:
        """See `chained`."""
        self._parts, self._sensors = parts, sensors
        robots = len(parts.record.tags)
        self.wheels, self.leds = np.zeros((robots, 2), np.int16), np.zeros(robots, np.uint16)
        self._present = np.frombuffer(parts.programs.present, dtype=np.uint32)
        self._bodies = parts.environment.world.bodies()
        self._kept: list[Any] = []
        self.cdata = self._made(times)

    def run(self, timestep: int, capture_ns: int, run_timestep: int, most: int) -> int:
        """Runs up to `most` timesteps, fewer where somebody has to look at the controllers.

        A controller that cannot go on is in its newest timestep, and the wheels have not obeyed it:
        `Programs.check` says so.

        Args:
            timestep: the first one, from the simulation's beginning.
            capture_ns: its capture time.
            run_timestep: the same timestep, from the run's beginning.

        Returns:
            How many there were, one at least.

        Raises:
            VsenseError: a sensor gave what must not reach a robot.
        """
        sim = self.cdata
        sim.timestep, sim.capture_ns, sim.has_seen = timestep, capture_ns, 0
        count = min(most, self._point_to(run_timestep))
        code, done = kernels.vs_sim_run(sim, count), int(sim.done)
        while code == lib.VS_ERR_SPACE:
            self._bodies.grow()
            code = kernels.vs_sim_run(sim, count - done)
            done += int(sim.done)
        check(code, "a virtual sensor's reading")
        self._parts.tracker.use(done)
        self._parts.rings.use(done)
        for sensor in self._sensors:
            sensor.use(done)
        last_ns = capture_ns + (done - 1) * int(sim.dt_ns)
        self._parts.environment.world.advanced(last_ns, run_timestep + done - 1)
        return done

    def _point_to(self, run_timestep: int) -> int:
        """Sets where a timestep takes its random numbers from; for how many they are enough."""
        sim, parts = self.cdata, self._parts
        ahead = [parts.tracker.errors(), parts.rings.noise()]
        sim.errors, sim.noise = (pointer("double", some) for some in ahead)
        for row, sensor in zip(self._sensor_rows, self._sensors):
            if sensor.noise is not None:
                ahead.append(sensor.noise())
                row.noise = pointer("double", ahead[-1])
        poses, leds = parts.record.poses[run_timestep:], parts.record.leds[run_timestep:]
        sim.kept_poses, sim.kept_leds = pointer("double", poses), pointer("uint16_t", leds)
        self._drawn = ahead
        return min(map(len, ahead))

    def _made(self, times: ChainTimes) -> Any:
        """Makes the `struct vs_sim`."""
        parts, made = self._parts, kernel_ffi.new("struct vs_sim *")
        world = parts.environment.world
        made.physics, made.tracker = parts.physics.cdata, parts.tracker.cdata
        made.world, made.rings = world.sightings.cdata, parts.rings.cdata
        made.crowd = self._bodies.crowd if self._sensors else kernel_ffi.NULL
        made.dt_ns, made.sense_ns, made.control_ns, made.act_ns = times
        made.wheels, made.leds = pointer("int16_t", self.wheels), pointer("uint16_t", self.leds)
        made.present = pointer("uint32_t", self._present)
        self._programs = kernel_ffi.new("struct vs_sim_program[]", len(parts.programs.parts()))
        for row, (number, rows, robots) in zip(self._programs, parts.programs.parts()):
            self._set_program(row, number, rows.astype(np.uint32), robots.program())
        made.programs, made.programs_count = self._programs, len(self._programs)
        self._sensor_rows = kernel_ffi.new("struct vs_sim_sensor[]", max(len(self._sensors), 1))
        for row, sensor in zip(self._sensor_rows, self._sensors):
            self._set_sensor(row, sensor)
        made.sensors, made.sensors_count = self._sensor_rows, len(self._sensors)
        return made

    def _set_program(
        self, row: Any, number: int, rows: NDArray[np.uint32], program: RobotProgram
    ) -> None:
        self._kept += [rows, program]
        row.number, row.robots, row.rows = number, len(rows), pointer("uint32_t", rows)
        for name in ("step", "failure", "all", "now", "timestep", "capture_ns", "now_ns", "logged"):
            field = getattr(row, name)
            setattr(row, name, kernel_ffi.cast(kernel_ffi.typeof(field), getattr(program, name)))
        row.prox, row.wheels = pointer("int16_t", program.prox), pointer("int16_t", program.wheels)
        row.leds = pointer("uint16_t", program.leds)
        row.shown = pointer("uint8_t", program.shown)
        row.shown_before = pointer("uint8_t", program.shown_before)
        row.shown_bytes = program.shown.nbytes

    def _set_sensor(self, row: Any, sensor: SensorKernel) -> None:
        world = self._parts.environment.world
        rows = np.flatnonzero(np.isin(world.robots["tag"], sensor.tags))
        robots = world.robots[rows[0] : rows[-1] + 1]
        scene = SensedScene(world, robots, rows)
        self._kept.append(scene)
        read = kernel_ffi.addressof(sensor.read.library, sensor.read.name)
        row.read, row.sensor = read, sensor.read.cdata
        row.scene, row.sent = scene.cdata, sensor.sent


def chained(parts: ChainedParts, times: ChainTimes) -> Chain | None:
    """Makes the chain of a simulation, or gives None where it needs Python in every timestep."""
    if not parts.environment.is_quiet or times.timestep <= times.act:
        return None
    sensors: list[SensorKernel] = []
    for equipment in parts.environment.equipment:
        own = equipment.sensors.kernels()
        if own is None or not _is_block(parts.environment, equipment):
            return None
        sensors += own
    by_id = {some.controller: some for some in parts.environment.equipment}
    for controller, robots in parts.programs.by_controller():
        if list(by_id[controller].tags) != list(robots.tags):
            return None
        robots.sense(by_id[controller].sensors.newest)
    return Chain(parts, sensors, times)


def _is_block(environment: Environment, equipment: Equipment) -> bool:
    """Whether the robots of a controller follow each other in the world."""
    tags = environment.world.robots["tag"].tolist()
    own = list(equipment.tags)
    return bool(own) and own == tags[tags.index(own[0]) :][: len(own)]
