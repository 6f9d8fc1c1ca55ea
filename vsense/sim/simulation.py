"""One simulated run: physics, virtual world and controller runtimes on one virtual clock.

A timestep goes as in the lab (medians of `vsense lab pollutant`, 120 s): the cameras expose, 10 ms
later their pictures are there, at 24 ms the robots have composed their own sensors' readings, at
30 ms their controllers run, and at 31 ms the wheels obey. Shorter timesteps overlap, as in the lab.
Nothing reads a clock: a seed gives the same bits every time.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vsense.config.placement import settle
from vsense.config.specs import Experiment
from vsense.link.robots.wire import Values, Wanted
from vsense.physics.motion import floor_of
from vsense.physics.proximity_ring import ProximityRing
from vsense.pictures.run_samples import RunSamples
from vsense.robot.inprocess import ACT_NS, CONTROL_NS
from vsense.run.environment import Environment
from vsense.run.programs import Programs
from vsense.sim.record import Record, SimulatedTracker

EPOCH_NS = 1_000_000_000
"""The virtual clock at the first timestep; 0 stands for "never" on the wire."""

WARM_UP = 3
"""Timesteps before the run: after so many fresh states wheels may turn (robot/safety.h)."""

SENSE_NS = 20_000_000
"""From the capture to the last reading of the proximity sensors before a control step: their frame
is composed after 24 ms, and they measure every 10 ms."""


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
    """

    def __init__(
        self,
        experiment: Experiment,
        libraries: Mapping[str, Path],
        seed: int,
        blind: bool = False,
        progress: Any = None,
    ) -> None:
        """Puts everything in its place.

        Args:
            experiment: it has a length.
            libraries: its controllers' programs, as `shared_objects` gives them.
            blind: hold the virtual sensors at 0.
            progress: see `Programs`.

        Raises:
            VsenseError: something in the experiment cannot be had.
        """
        experiment = settle(experiment, seed)
        self.environment = Environment(experiment, seed, blind)
        self.record = Record(experiment)
        self.samples: RunSamples | None = None
        self._dt_ns, self._source = experiment.timestep_ns, experiment.source
        self._physics = floor_of(experiment, EPOCH_NS)
        self._rings = ProximityRing(self._physics.near, seed)
        self._tracker = SimulatedTracker((*self.record.tags, *self.record.object_tags), seed)
        controllers = {robot.tag: robot.controller for robot in experiment.robots}
        tables = self.environment.tables
        self._robots = Programs(experiment, controllers, libraries, tables, seed, progress)
        self._leds = np.zeros_like(self._robots.leds)
        self._reports, self._events = dict[int, bytes](), list[_Event]()
        self._names = {robot.tag: robot.id for robot in experiment.robots}
        self._timestep = self._numbers = 0

    def run(self) -> dict[str, float]:
        """Runs all timesteps; returns the experiment's own results by name.

        Raises:
            VsenseError: something in the virtual world has failed.
        """
        for run_timestep in range(-WARM_UP, len(self.record.timesteps)):
            self.step(run_timestep)
        self._advance(self._capture_ns())
        if self.samples is not None:
            self.samples.end(self.environment.world)
        return self.environment.end()

    def step(self, run_timestep: int) -> None:
        """Runs one timestep, negative before the run, up to the moment before the next capture."""
        capture_ns = self._capture_ns()
        self._advance(capture_ns)
        poses, world = self._physics.poses, self.environment.world
        state = self._tracker.update(poses, self._timestep, capture_ns)
        readings = self.environment.step(state, run_timestep, self._reports)
        if run_timestep >= 0:
            left = 1.0 if self._source is None else world.stock.share(self._source)
            self.record.note(run_timestep, poses, self._leds, left)
            if self.samples is not None:
                self.samples.add(run_timestep, world)
        self._plan(capture_ns + SENSE_NS, self._control(capture_ns, self._timestep, readings))
        self._timestep += 1

    def complaints(self) -> list[str]:
        """What the controllers asked for in vain, or do not know."""
        return self._robots.complaints()

    def _capture_ns(self) -> int:
        """Capture time of the next timestep."""
        return EPOCH_NS + self._timestep * self._dt_ns

    def _control(
        self, capture_ns: int, timestep: int, readings: dict[int, Values]
    ) -> Callable[[], None]:
        """Makes the event in which the robots sense and their controllers run."""

        def happen() -> None:
            prox_raw = self._rings.read(self._physics.bodies)
            wanted = Wanted.RUN if timestep >= WARM_UP else Wanted.IDLE
            times_ns = capture_ns, capture_ns + CONTROL_NS
            self._robots.step(wanted, WARM_UP, timestep, times_ns, readings, prox_raw)
            self._note(timestep - WARM_UP)
            act_ns = capture_ns + ACT_NS
            self._plan(act_ns, self._obey(act_ns, self._robots.reports()))

        return happen

    def _note(self, run_timestep: int) -> None:
        """Keeps what controllers show and log in a timestep of the run."""
        for tag, values in self._robots.shown():
            self.record.note_shown(run_timestep, tag, values)
        for tag, text in self._robots.logged():
            self.record.note_event(run_timestep, f"robot {tag} ({self._names[tag]}): {text}")
        for tag, text in self.environment.logged():
            self.record.note_event(run_timestep, f"virtual robot {tag}: {text}")

    def _obey(self, time_ns: int, reports: dict[int, bytes]) -> Callable[[], None]:
        """Makes the event in which wheels and LEDs follow the controllers."""
        wheels, leds = self._robots.wheels_steps_s.copy(), self._robots.leds.copy()

        def happen() -> None:
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
