"""Many timesteps in one call of C: `c_src/host/vs_sim.h`.

It calls the kernels that `Simulation.step` calls, in the same order and on the same memory. Where
there is something for Python in a timestep, C comes back in the middle of it: after everybody was
seen, for `pre_step`, actuators and fields, and after its own sensors were read, for the others, for
`post_step` and the picture of the run. Python finds the world there as ever, and pays for what it
looks at. The results are the same bits.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsense.base.errors import VsenseError
from vsense.base.native import WireError, kernel_ffi, kernels, lib, pointer
from vsense.modes.sim._chained_bank import ChainedBank, kernel_of
from vsense.modes.sim._record import SimulatedTracker, SimulationRecord
from vsense.robots.inprocess import ProgramKernel
from vsense.run.environment import Environment
from vsense.run.programs import Programs
from vsense.world.actuators.base import ActuatorError
from vsense.world.physics.motion import Physics
from vsense.world.physics.proximity_ring import ProximityRing
from vsense.world.sensors.base import SensorError

_SEEN: int = kernels.VS_SIM_SEEN
_SENSED: int = kernels.VS_SIM_SENSED


_RING = "proximity"
"""What controllers call the robot's own ring."""


class ChainTimes(NamedTuple):
    """Of a timestep [ns]: its length, and from the capture to rings, controllers and wheels."""

    timestep: int
    sense: int
    control: int
    act: int


class ChainedParts(NamedTuple):
    """What a simulation is made of.

    Attributes:
        after: is called with the timestep of the run when everything has been sensed, where
            `is_watched`; gives the physics, which may be another one then.
        is_watched: somebody wants every timestep's world.
    """

    physics: Physics
    rings: ProximityRing
    tracker: SimulatedTracker
    environment: Environment
    programs: Programs
    record: SimulationRecord
    after: Callable[[int], Physics]
    is_watched: bool


class Chain:
    """Timesteps of a run in which the robots run, from its second one.

    Attributes:
        wheels: (n, 2) int16, what the robots' wheels were told last.
        leds: (n,) uint16, their LEDs.
        done: timesteps of the newest `run`.
        cdata: the `struct vs_sim *`.
    """

    def __init__(self, parts: ChainedParts, times: ChainTimes) -> None:
        """See `chained`."""
        self._parts, self._world = parts, parts.environment.world
        robots = len(parts.record.tags)
        self.wheels, self.leds = np.zeros((robots, 2), np.int16), np.zeros(robots, np.uint16)
        self.done = 0
        self._present = np.frombuffer(parts.programs.present, dtype=np.uint32)
        self._keep_alive: list[Any] = []
        robots_of = dict(parts.programs.by_controller())
        self._banks = [
            ChainedBank(self._world, equipment, robots_of.get(equipment.controller))
            for equipment in parts.environment.equipment
        ]
        equipped = [part for part in parts.environment.equipment if part.tags]
        is_virtual = [_RING in {entry.name for entry in part.sensors.table} for part in equipped]
        # What stands before the robot's own ring hides it from the controller.
        self._rings = None if all(is_virtual) else parts.rings
        self._followed: object = None
        self.cdata = self._new_chain(times)
        self._follow_world(0)

    def run(self, timestep: int, capture_ns: int, run_timestep: int, most: int) -> None:
        """Runs up to `most` timesteps, fewer where somebody has to look at the controllers.

        `done` says how many there were, also after an error. A controller that cannot go on is in
        the newest timestep, and the wheels have not obeyed it: `Programs.check` says so.

        Args:
            timestep: the first one, from the simulation's beginning.
            capture_ns: its capture time.
            run_timestep: the same timestep, from the run's beginning.

        Raises:
            VsenseError: something in the virtual world has failed.
        """
        sim = self.cdata
        sim.timestep, sim.capture_ns, sim.at = timestep, capture_ns, kernels.VS_SIM_BEGUN
        sim.first, sim.called = timestep - run_timestep, 0
        self.done = 0
        for bank in self._banks:
            bank.begin()
        # Since the last call people may have changed the world.
        self._follow_world(0)
        count = min(most, self._point_to(run_timestep))
        try:
            self._go_on(run_timestep, count)
        finally:
            self._parts.tracker.use(self.done)
            if self._rings is not None:
                self._rings.use(self.done)
            for bank in self._banks:
                bank.use(self.done)
        if not sim.stops:
            last_ns = capture_ns + (self.done - 1) * int(sim.dt_ns)
            self._world.advanced(last_ns, run_timestep + self.done - 1)

    def _go_on(self, run_timestep: int, count: int) -> None:
        """Runs `count` timesteps at most."""
        sim = self.cdata
        while self.done < count:
            code = kernels.vs_sim_run(sim, count - self.done)
            self.done += sim.done
            if code == lib.VS_ERR_SPACE:
                self._crowd.grow()
            elif code < 0:
                raise self._failure(code)
            elif sim.said:
                self._hear(run_timestep + self.done)
            elif sim.at == _SEEN:
                self._evolve(run_timestep + self.done)
            elif sim.at == _SENSED:
                self._look(run_timestep + self.done)
            else:
                return
            if self._parts.environment.finished:
                count = self.done + 1

    def _failure(self, code: int) -> VsenseError:
        """The error that C has given; raises that of whoever was asked for the floor."""
        self._world.floor.check()
        at, number = self.cdata.at, self.cdata.failed
        if at == _SEEN:
            names = [kernel.name for bank in self._banks for kernel in bank.acting_in_c]
            return ActuatorError(f"actuator {names[number]!r}: was asked for too much")
        if at == kernels.VS_SIM_EVOLVED:
            names = [kernel.name for bank in self._banks for kernel in bank.in_c]
            return SensorError(f"sensor {names[number]!r}: gave what does not fit its layout")
        self._parts.programs.check()
        return WireError(code, "robots whose run is over")

    def _hear(self, run_timestep: int) -> None:
        """What happens after C has called a loop function that says something, or could not."""
        sim, at = self.cdata, self.cdata.at
        is_called = sim.said == kernels.VS_CXX_SAID
        self._advance_world(run_timestep)
        sim.called = self._parts.environment.heard(sim.called - is_called, is_called)
        if at == _SENSED:
            self._end_look(run_timestep)
        self._follow_world(self.done + (at == _SENSED))

    def _advance_world(self, run_timestep: int) -> None:
        """Tells Python's world how far it is."""
        sim = self.cdata
        is_standing = sim.at == _SENSED and sim.crowd != kernel_ffi.NULL
        self._world.advanced(sim.capture_ns, run_timestep, is_standing)

    def _evolve(self, run_timestep: int) -> None:
        """What happens after everybody was seen."""
        sim, environment = self.cdata, self._parts.environment
        self._advance_world(run_timestep)
        if not sim.called:
            environment.pre_step()
            sim.called = 1
        self._follow_world(self.done)
        if not self._evolves_in_c:
            environment.act(self._parts.programs.reports())
            sim.at = kernels.VS_SIM_EVOLVED
            self._follow_world(self.done)

    def _look(self, run_timestep: int) -> None:
        """What happens after C has sensed."""
        sim, parts = self.cdata, self._parts
        self._advance_world(run_timestep)
        for bank in self._banks:
            bank.step(sim.timestep)
        if sim.called < kernels.VS_CXX_FLOOR:
            parts.environment.post_step()
            sim.called = kernels.VS_CXX_FLOOR
        self._end_look(run_timestep)
        self._follow_world(self.done + 1)

    def _end_look(self, run_timestep: int) -> None:
        """Takes over what has become of the world."""
        self.cdata.physics = self._parts.after(run_timestep).cdata

    def _follow_world(self, used: int) -> None:
        """Points to the world anew if something in it has changed.

        `used` is for how many timesteps of the newest call the sensors have been read.
        """
        sim, world = self.cdata, self._world
        qualities = [equipment.sensors.version for equipment in self._parts.environment.equipment]
        loop = self._parts.environment.loop_kernel() or kernel_ffi.NULL
        rates = [(f.as_c(), *f.rates) for f in world.fields.values()]
        now = world.version, qualities, rates, loop
        if now == self._followed:
            return
        self._followed, self._crowd = now, world.crowd
        sim.world, sim.loop = world.sightings.cdata, loop
        for bank in self._banks:
            bank.follow(self._crowd, used)
        self._follow_sensors()
        self._follow_actuators()
        sim.stops = self._stops()

    def _follow_sensors(self) -> None:
        """Points to what senses."""
        sim, sensors = self.cdata, [sensor for bank in self._banks for sensor in bank.in_c]
        self._sensor_rows = kernel_ffi.new("struct vs_sim_sensor[]", max(len(sensors), 1))
        rows = iter(self._sensor_rows)
        for bank in self._banks:
            bank.set_rows(rows)
        sim.sensors, sim.sensors_count = self._sensor_rows, len(sensors)
        is_asked = any(sensor.read.bodies for sensor in sensors)
        sim.crowd = self._crowd.crowd if is_asked else kernel_ffi.NULL

    def _follow_actuators(self) -> None:
        """Points to what acts, and to fields, if all actuators are C: their order counts."""
        sim, world = self.cdata, self._world
        kernels_in_c = [row for bank in self._banks for row in bank.actuators()]
        rows = [row for row in kernels_in_c if row is not None]
        self._evolves_in_c = len(rows) == len(kernels_in_c)
        fields = list(world.fields.values()) if self._evolves_in_c else []
        for field in fields:
            field.prepare(world.timestep_s)
        self._acting = (
            kernel_ffi.new("struct vs_sim_actuator[]", rows if self._evolves_in_c else []),
            kernel_ffi.new("struct vs_spread[]", [field.spread[0] for field in fields]),
        )
        sim.actuators, sim.fields = self._acting
        sim.actuators_count, sim.fields_count = map(len, self._acting)

    def _stops(self) -> int:
        """In which moments of a timestep Python has something to do."""
        hooks = self._parts.environment.hooks if not self.cdata.loop else ()
        evolves = int("pre_step" in hooks or not self._evolves_in_c)
        senses = any(bank.in_python for bank in self._banks)
        looks = int(bool(hooks) or self._parts.is_watched or senses or not self._evolves_in_c)
        return evolves << _SEEN | looks << _SENSED

    def _point_to(self, run_timestep: int) -> int:
        """Sets where a timestep takes its random numbers from; for how many they are enough."""
        sim, parts = self.cdata, self._parts
        ahead = [parts.tracker.errors()]
        if self._rings is not None:
            ahead.append(self._rings.noise())
            sim.noise = pointer("double", ahead[-1])
        sim.errors = pointer("double", ahead[0])
        self._drawn = ahead
        rows = iter(self._sensor_rows)
        for bank in self._banks:
            bank.begin()
            ahead += bank.set_rows(rows)
        poses, leds = parts.record.poses[run_timestep:], parts.record.leds[run_timestep:]
        sim.kept_poses, sim.kept_leds = pointer("double", poses), pointer("uint16_t", leds)
        return min(map(len, ahead))

    def _new_chain(self, times: ChainTimes) -> Any:
        """Makes the `struct vs_sim`."""
        parts, sim = self._parts, kernel_ffi.new("struct vs_sim *")
        sim.physics, sim.tracker = parts.physics.cdata, parts.tracker.cdata
        if self._rings is not None:
            sim.rings = self._rings.cdata
        sim.dt_ns, sim.sense_ns, sim.control_ns, sim.act_ns = times
        sim.wheels, sim.leds = pointer("int16_t", self.wheels), pointer("uint16_t", self.leds)
        sim.present = pointer("uint32_t", self._present)
        self._programs = kernel_ffi.new("struct vs_sim_program[]", len(parts.programs.parts()))
        for row, (number, rows, robots) in zip(self._programs, parts.programs.parts()):
            self._set_program(row, number, rows.astype(np.uint32), kernel_of(robots))
        sim.programs, sim.programs_count = self._programs, len(self._programs)
        return sim

    def _set_program(
        self, row: Any, number: int, rows: NDArray[np.uint32], program: ProgramKernel
    ) -> None:
        self._keep_alive += [rows, program]
        row.number, row.robots, row.rows = number, len(rows), pointer("uint32_t", rows)
        addresses = ("step", "all", "now", "timestep", "capture_ns", "now_ns", "logged", "failed")
        for name in addresses:
            field = getattr(row, name)
            setattr(row, name, kernel_ffi.cast(kernel_ffi.typeof(field), getattr(program, name)))
        row.prox, row.wheels = pointer("int16_t", program.prox), pointer("int16_t", program.wheels)
        row.leds = pointer("uint16_t", program.leds)
        row.shown = pointer("uint8_t", program.shown)
        row.shown_before = pointer("uint8_t", program.shown_before)
        row.shown_bytes = program.shown.nbytes


def chained(parts: ChainedParts, times: ChainTimes) -> Chain | None:
    """Makes the chain of a simulation, or gives None where its timesteps cannot be chained.

    They cannot where the next capture comes before the wheels obey, where virtual robots run
    controllers, and where C cannot step a program.
    """
    environment = parts.environment
    if environment.drives or times.timestep <= times.act:
        return None
    by_id = {equipment.controller: equipment for equipment in environment.equipment}
    for controller, robots in parts.programs.by_controller():
        if list(by_id[controller].tags) != list(robots.tags) or robots.kernel() is None:
            return None
        robots.sense(by_id[controller].sensors.newest)
    return Chain(parts, times)
