"""One simulated run: physics, virtual world and controller runtimes on one virtual clock.

A timestep goes as in the lab (medians of `vsense lab pollutant`, 120 s): the cameras expose, 10 ms
later their pictures are there, at 24 ms the robots have composed their own sensors' readings, at
30 ms their controllers run, and at 31 ms the wheels obey. Shorter timesteps overlap, as in the lab.
Nothing reads a clock: a seed gives the same bits every time.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import ArenaState, Floats
from vsense.base.errors import VsenseError
from vsense.base.readings import SwarmReadings
from vsense.config.placement import settle
from vsense.config.specs import Experiment
from vsense.modes.sim._chain import Chain, ChainedParts, ChainTimes, chained
from vsense.modes.sim._loop_host import LoopFunctionsHost
from vsense.modes.sim._record import SimulatedTracker, SimulationRecord
from vsense.monitor.pictures.run_samples import RunSamples
from vsense.robots.inprocess import ACT_NS, CONTROL_NS
from vsense.robots.link.wire import Wanted
from vsense.robots.program import ProgramOpener
from vsense.run.changing import Ground
from vsense.run.environment import Environment, physics_of
from vsense.run.programs import RUN_PROGRESS_BYTES, failed_words
from vsense.world.entities import Box, Cylinder
from vsense.world.physics.motion import NoisyWheels, Physics, obstacles
from vsense.world.physics.proximity_ring import ProximityRing

EPOCH_NS = 1_000_000_000
"""The virtual clock at the first timestep; 0 stands for "never" on the wire."""

WARM_UP_TIMESTEPS = 3
"""Timesteps before the run: after so many fresh states wheels may turn (robot/safety.h)."""

SENSE_NS = 20_000_000
"""From the capture to the last reading of the proximity sensors before a control step: their frame
is composed after 24 ms, and they measure every 10 ms."""

MAX_TIMESTEPS = 1 << 30
"""As many timesteps as there are."""


class _Event(NamedTuple):
    """Something that is due; events of one time happen in the order of their numbers."""

    time_ns: int
    number: int
    happen: Callable[[], None]


class Simulation:
    """A run from its first timestep to its last.

    Attributes:
        environment: the virtual world.
        record: the run's timesteps.
        samples: collects what the picture of the run needs; None: there is no picture.
        chain: what runs whole timesteps in C, from the run's second one on; None: nothing does.
        observe: is called with every timestep of the run when everything has been sensed; it looks
            at the run, and changes nothing. None: nobody looks.
        gate: is called with the timestep to come, between two timesteps, and before the first one;
            says how many may follow until it is asked again, 0 ends the run. It may wait. Whoever
            changes the virtual world does it there; see `ground`.
    """

    chain: Chain | None
    samples: RunSamples | None
    observe: Callable[[int], None] | None

    def __init__(
        self,
        experiment: Experiment,
        libraries: Mapping[str, Path],
        seed: int,
        blind: bool = False,
        progress: Any = None,
        openers: Mapping[str, ProgramOpener] | None = None,
    ) -> None:
        """Puts everything in its place.

        Args:
            experiment: it has a length.
            libraries: its programs, as `shared_objects` gives them.
            blind: hold the virtual sensors at 0.
            progress, openers: see `Programs`.

        Raises:
            VsenseError: something in the experiment cannot be had.
        """
        experiment = settle(experiment, seed)
        progress = bytearray(RUN_PROGRESS_BYTES) if progress is None else progress
        # Loop functions may begin below, and ask for the timestep.
        self._timestep, self._numbers, self.chain, self.is_whole = 0, 0, None, True
        present = self._present
        host = LoopFunctionsHost(experiment, libraries, seed, progress, present, openers=openers)
        self.environment = Environment(experiment, seed, blind, host.loop_host())
        self.record = SimulationRecord(experiment)
        self.samples = self.observe = None
        self.gate: Callable[[int], int] = lambda run_timestep: MAX_TIMESTEPS
        self._dt_ns, self._source = experiment.timestep_ns, experiment.source
        self._physics = physics_of(experiment, EPOCH_NS)
        self._rings = ProximityRing(self._physics.near, seed, models=self._physics.models)
        self._tracker = SimulatedTracker((*self.record.tags, *self.record.object_tags), seed)
        self._slip = NoisyWheels(experiment.wheel_noises, seed, self._physics.models)
        self._robots = host.robots or host.opened(self.environment.tables)
        self._driven, self._leds = self._robots.wheels_steps_s.copy(), self._robots.leds.copy()
        self._reports, self._events, self._now_ns = dict[int, bytes](), list[_Event](), EPOCH_NS
        self._version, self._standing = -1, _standing(experiment.boxes, experiment.cylinders)
        self._follow()

    def _present(self) -> int:
        """The timestep that is under way."""
        return self._timestep if self.chain is None else int(self.chain.cdata.timestep)

    def run(self) -> dict[str, float]:
        """Runs all timesteps; returns the experiment's own results by name.

        Raises:
            VsenseError: a controller or something in the virtual world has failed; the record has
                all until then.
        """
        try:
            return self._run()
        except VsenseError:
            self._break_off()
            raise

    def _run(self) -> dict[str, float]:
        run_timestep = -WARM_UP_TIMESTEPS
        while run_timestep < len(self.record.timesteps):
            most = MAX_TIMESTEPS if run_timestep < 0 else self.gate(run_timestep)
            if most > 0:
                run_timestep += self.go_on(run_timestep, most)
            if self.environment.finished or most == 0:
                self.record.end(run_timestep)
                self.is_whole = most > 0
                break
        self._advance(self._capture_ns())
        if self.samples is not None:
            self.samples.end(self.environment.world)
        # Loop functions may use the controllers to the last.
        results = self.environment.end()
        self._robots.end()
        self._note_said(len(self.record.timesteps) - 1)
        return results

    @property
    def ground(self) -> Ground:
        """What of the arena follows changes of the world, which come between two `go_on`."""

        def put(row: int, x_m: float, y_m: float, yaw_rad: float) -> None:
            self._physics.poses[len(self.record.tags) + row] = x_m, y_m, yaw_rad

        return Ground(put, rebuilds=True)

    def go_on(self, run_timestep: int, most: int = MAX_TIMESTEPS) -> int:
        """Runs at least one timestep and `most` at most; says how many."""
        self._follow()
        if run_timestep == 1:
            self.chain = self._chained()
        if self.chain is None:
            self.step(run_timestep)
            return 1
        chain, left = self.chain, min(len(self.record.timesteps) - run_timestep, most)
        chain.cdata.physics = self._physics.cdata
        try:
            chain.run(self._timestep, self._capture_ns(), run_timestep, left)
        finally:
            self._timestep += chain.done
        self._now_ns = self._capture_ns() - self._dt_ns + ACT_NS
        self._robots.check()
        self._note(run_timestep + chain.done - 1)
        return chain.done

    def _chained(self) -> Chain | None:
        """What runs the timesteps in C as far as they are C, if they can be chained."""

        def after(run_timestep: int) -> Physics:
            self._now_ns = self._capture_ns(self._present())
            self._after(run_timestep)
            return self._physics

        tracker, environment = self._tracker, self.environment
        arguments = (self._physics, self._rings, tracker, environment, self._robots, self.record)
        is_watched = self.samples is not None or self.observe is not None
        parts = ChainedParts(*arguments, after, is_watched)
        chain = chained(parts, ChainTimes(self._dt_ns, SENSE_NS, CONTROL_NS, ACT_NS))
        if chain is not None:
            if not self._slip.is_quiet:
                chain.cdata.slip = self._slip.cdata
            chain.wheels[:], chain.leds[:] = self._driven, self._leds
            self._driven, self._leds = chain.wheels, chain.leds
        return chain

    def _break_off(self) -> None:
        """Ends the record of a run that has failed, with the last words of all."""
        done = min(max(self._timestep - WARM_UP_TIMESTEPS, 0), len(self.record.timesteps))
        self.record.end(done)
        self._note(max(done - 1, 0))
        self._note_said(done - 1)
        if self.samples is not None:
            self.samples.end(self.environment.world)

    def step(self, run_timestep: int) -> None:
        """Runs one timestep, negative before the run, until wheels obey or to the next capture."""
        capture_ns = self._capture_ns()
        self._advance(capture_ns)
        poses = self._physics.poses
        state = self._tracker.update(poses, self._timestep, capture_ns)
        readings = self.environment.step(state, run_timestep, self._reports)
        self._after(run_timestep)
        if run_timestep >= 0:
            self.record.note(run_timestep, poses, self._leds)
        self._plan(capture_ns + SENSE_NS, self._control(capture_ns, self._timestep, readings))
        self._timestep += 1
        if self._dt_ns > ACT_NS:  # else the next capture comes first
            self._advance(capture_ns + ACT_NS)

    def _after(self, run_timestep: int) -> None:
        """Takes over what has become of the virtual world in a timestep."""
        self._note_said(run_timestep)
        self._follow()
        if run_timestep < 0:
            return
        world = self.environment.world
        if self._source is not None:
            self.record.share[run_timestep] = world.stock.share(self._source)
        if self.samples is not None:
            self.samples.add(run_timestep, world)
        if self.observe is not None:
            self.observe(run_timestep)

    def _note_said(self, run_timestep: int) -> None:
        """Keeps what loop functions log; before the run, with its first timestep."""
        for text in self.environment.said():
            self.record.note_event(max(run_timestep, 0), f"loop functions: {text}")

    def _follow(self) -> None:
        """Puts robots, and what they can drive against, where loop functions put them."""
        for row, pose in self.environment.moved().items():
            self._physics.poses[row] = pose
        world = self.environment.world
        if world.version[0] == self._version:
            return
        self._version = world.version[0]
        standing = _standing(world.boxes(), world.cylinders())
        if all(np.array_equal(now, before) for now, before in zip(standing, self._standing)):
            return
        self._standing = standing
        robots, boxes, cylinders = len(self.record.tags), *standing
        poses, now_ns = self._physics.poses, max(self._now_ns, EPOCH_NS)
        models = self._physics.models
        self._physics = Physics(
            poses[:robots], poses[robots:], boxes, now_ns, cylinders, models=models
        )
        self._physics.drive_all(self._driven, now_ns)
        self._rings.near = self._physics.near

    def seen(self, run_timestep: int) -> ArenaState:
        """The arena state of the newest timestep, which is this one of the run."""
        return self._tracker.newest(*self.moment(run_timestep))

    def moment(self, run_timestep: int) -> tuple[int, int]:
        """A timestep of the run counted from the beginning, and its capture time [ns]."""
        timestep = run_timestep + WARM_UP_TIMESTEPS
        return timestep, self._capture_ns(timestep)

    @property
    def now_ns(self) -> int:
        """The simulation's clock."""
        return self._now_ns

    @property
    def readings(self) -> SwarmReadings:
        """What all robots sense, in arrays that change with the timesteps."""
        return SwarmReadings({e.controller: e.sensors.newest for e in self.environment.equipment})

    @property
    def wheels_steps_s(self) -> NDArray[np.int16]:
        """(n, 2) what the robots' wheels were told last, left and right."""
        return np.asarray(self._driven)

    @property
    def leds(self) -> NDArray[np.uint16]:
        """(n,) the robots' LEDs, see `SimulationRecord`."""
        return np.asarray(self._leds)

    def reports(self) -> Mapping[int, bytes]:
        """What every robot's virtual actuators say, by tag."""
        return self._robots.reports()

    def failed(self) -> list[str]:
        """Which controllers have failed, and why, in words."""
        return [*failed_words(self._robots.failures()), *self.environment.failed()]

    def complaints(self) -> list[str]:
        """What the controllers asked for in vain, or do not know."""
        return self._robots.complaints()

    def _capture_ns(self, timestep: int | None = None) -> int:
        """Capture time of a timestep, by default the next one."""
        return EPOCH_NS + (self._timestep if timestep is None else timestep) * self._dt_ns

    def _control(
        self, capture_ns: int, timestep: int, readings: SwarmReadings
    ) -> Callable[[], None]:
        """Makes the event in which the robots sense and their controllers run."""

        def happen() -> None:
            prox_raw = self._rings.read(self._physics.bodies)
            wanted = Wanted.RUN if timestep >= WARM_UP_TIMESTEPS else Wanted.IDLE
            times_ns = capture_ns, capture_ns + CONTROL_NS
            self._robots.step(wanted, WARM_UP_TIMESTEPS, timestep, times_ns, readings, prox_raw)
            self._note(timestep - WARM_UP_TIMESTEPS)
            act_ns = capture_ns + ACT_NS
            self._plan(act_ns, self._obey(act_ns, self._robots.reports()))

        return happen

    def _note(self, run_timestep: int) -> None:
        """Keeps what controllers show and log in a timestep of the run."""
        for tag, values in self._robots.shown():
            self.record.note_shown(run_timestep, tag, values)
        for tag, text in self._robots.logged():
            self.record.note_event(run_timestep, f"robot {tag}: {text}")
        for robot, text in self.environment.logged():
            self.record.note_event(run_timestep, f"{robot}: {text}")

    def _obey(self, time_ns: int, reports: dict[int, bytes]) -> Callable[[], None]:
        """Makes the event in which wheels and LEDs follow the controllers."""
        wheels = self._slip.apply(self._robots.wheels_steps_s.copy())
        leds = self._robots.leds.copy()

        def happen() -> None:
            self._driven = wheels
            self._physics.drive_all(wheels, time_ns)
            self._leds, self._reports = leds, reports

        return happen

    def _plan(self, time_ns: int, happen: Callable[[], None]) -> None:
        heapq.heappush(self._events, _Event(time_ns, self._numbers, happen))
        self._numbers += 1

    def _advance(self, time_ns: int) -> None:
        """Moves everything on to a time, with all events that are due then."""
        while self._events and self._events[0].time_ns <= time_ns:
            event = heapq.heappop(self._events)
            self._physics.advance(event.time_ns)
            event.happen()
        self._physics.advance(time_ns)
        self._now_ns = time_ns


def _standing(boxes: Sequence[Box], cylinders: Sequence[Cylinder]) -> tuple[Floats, Floats]:
    """What robots drive against, as `Physics` takes it."""
    return obstacles(
        [box for box in boxes if box.physical], [post for post in cylinders if post.physical]
    )
