"""Robots whose controller is Python: it runs on this host, and their daemons do what it says.

They run the shipped controller `remote`: `command` goes down as any reading, with its age, and
`own` comes up. So all that stops a robot stops these, too: silence, old commands, an emergency
stop, a controller that has failed.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

import numpy as np

from vsense.base.arena import ArenaState
from vsense.base.readings import SwarmReadings, TimedReadings
from vsense.config.specs import ControllerSpec, Experiment
from vsense.robots.hosted import STEP_MAX_S, HostedProgram
from vsense.robots.inprocess import CONTROL_NS
from vsense.robots.link.table import Direction, Entry, Table
from vsense.robots.link.wire import Wanted
from vsense.robots.program import kind_of
from vsense.run.programs import Programs, failed_words

COMMAND = "command"
REMOTE_TABLE = Table(
    [Entry(1, COMMAND, "3*i2", Direction.SENSOR), Entry(2, "own", "8*i2", Direction.READING)]
)
"""What these robots are told: left and right wheel [step/s] and LEDs; their own ring, raw."""


@contextmanager
def _limited(programs: Programs) -> Iterator[None]:
    """Raises TimeoutError in users' code that does not return: whose it is fails, others go on."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(*_: object) -> None:
        parts = [program for *_, program in programs.parts()]
        if any(isinstance(part, HostedProgram) and part.notes[1] for part in parts):
            raise TimeoutError(f"did not return within {STEP_MAX_S:g} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, STEP_MAX_S, STEP_MAX_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


class RemoteSwarm:
    """The robots of a run that controllers in Python drive, at least one.

    Attributes:
        tables: what the robots of each of the controllers are told, by its id.
        commands: by tag, what each robot is sent.

    Raises:
        VsenseError: a controller cannot be run.
    """

    def __init__(
        self,
        experiment: Experiment,
        controllers: Sequence[ControllerSpec],
        tables: Mapping[str, Table],
        seed: int,
    ) -> None:
        """`controllers` are those that run here; `tables` has what their robots sense and do."""
        libraries = {c.id: kind_of(c.program).build(c.program) for c in controllers}
        self.tables = dict.fromkeys(libraries, REMOTE_TABLE)
        driven = {robot.tag: experiment.controller_of(robot).id for robot in experiment.robots}
        driven = {tag: name for tag, name in driven.items() if name in libraries}
        self._tags = list(driven)
        self._programs = Programs(experiment, driven, libraries, tables, seed)
        self._ring = np.zeros((len(driven), 8), np.int16)
        self._reports: Mapping[int, bytes] = {}
        self.commands: Mapping[int, TimedReadings] = {}

    def hear(self, reports: Mapping[int, bytes]) -> dict[int, bytes]:
        """Takes what these robots say of themselves; gives what all robots' actuators report."""
        heard = dict(reports)
        for row, tag in enumerate(self._tags):
            own = REMOTE_TABLE.readings(heard.pop(tag))["own"] if tag in heard else None
            if own is not None and own[1] is not None:
                self._ring[row] = np.frombuffer(own[0], "<i2")
        return {**heard, **{tag: b for tag, b in self._reports.items() if tag in reports}}

    def control(self, state: ArenaState, run_timestep: int, readings: SwarmReadings) -> None:
        """Runs every controller's step; `readings` are what each tag senses virtually."""
        capture_ns = state.capture_ns
        with _limited(self._programs):
            self._programs.step(
                Wanted.RUN if run_timestep >= 0 else Wanted.IDLE,
                0,
                state.timestep,
                (capture_ns, capture_ns + CONTROL_NS),
                readings,
                self._ring,
            )
        self._reports = self._programs.reports()
        wheels, leds = self._programs.wheels_steps_s, self._programs.leds
        block = np.column_stack((wheels, leds.astype(np.int16))).astype("<i2")
        self.commands = {
            tag: [(block[row].tobytes(), capture_ns)] for row, tag in enumerate(self._tags)
        }

    def logged(self) -> list[tuple[int, str]]:
        """See `Programs.logged`."""
        return list(self._programs.logged())

    def failed(self) -> list[str]:
        """See `Environment.failed`."""
        return failed_words(self._programs.failures())

    def end(self) -> None:
        """See `Program.end`."""
        self._programs.end()
