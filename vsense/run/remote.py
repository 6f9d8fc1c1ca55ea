"""Robots whose controller is Python or Lua: it runs on this host, and their daemons obey it.

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
from vsense.robots.link.wire import ShownData, Wanted
from vsense.robots.program import kind_of
from vsense.run._own_devices import LIGHT_BYTES, OWN_NUMBERS, OwnDevices
from vsense.run.programs import Programs, failed_words

COMMAND = "command"
REMOTE_TABLE = Table(
    [
        Entry(1, COMMAND, "20*i2", Direction.SENSOR),
        Entry(2, "own", f"{OWN_NUMBERS}*f4", Direction.READING),
    ]
)
"""What these robots are told, and tell: see `robot/controllers/remote.c`."""


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
    """The robots of a run that controllers of this process drive, at least one.

    Attributes:
        tables: what the robots of each of the controllers are told, by its id.
        commands: by tag, what each robot is sent.
        shown: by tag, what its controller shows to people.

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
        self._devices = {
            name: OwnDevices(
                tables[name], [t for t, c in driven.items() if c == name], experiment.timestep_ns
            )
            for name in dict.fromkeys(driven.values())
        }
        given = {name: devices.table for name, devices in self._devices.items()}
        self._tags = list(driven)
        rows = {tag: row for row, tag in enumerate(driven)}
        self._rows = {n: [rows[tag] for tag in d.tags] for n, d in self._devices.items()}
        self._programs = Programs(experiment, driven, libraries, given, seed)
        self._rings = np.zeros((len(driven), 8), np.int16)
        self._reports: Mapping[int, bytes] = {}
        self.commands: Mapping[int, TimedReadings] = {}
        self.shown = dict[int, ShownData]()

    def hear(
        self, reports: Mapping[int, bytes], heard_ns: Mapping[int, int], capture_ns: int
    ) -> dict[int, bytes]:
        """Takes what these robots say of themselves; gives what all robots' actuators report.

        `heard_ns` has when the host has heard each of them; others: at `capture_ns`.
        """
        heard = dict(reports)
        for devices in self._devices.values():
            for tag in devices.tags:
                own = REMOTE_TABLE.readings(heard.pop(tag))["own"] if tag in heard else None
                if own is not None and own[1] is not None:
                    devices.hear(tag, own[0], heard_ns.get(tag, capture_ns) - 1000 * own[1])
        return {**heard, **{tag: b for tag, b in self._reports.items() if tag in reports}}

    def control(self, state: ArenaState, run_timestep: int, readings: SwarmReadings) -> None:
        """Runs every controller's step; `readings` are what each tag senses virtually."""
        capture_ns = state.capture_ns
        sensed = {n: d.sense(readings.parts[n], capture_ns) for n, d in self._devices.items()}
        with _limited(self._programs):
            self._programs.step(
                Wanted.RUN if run_timestep >= 0 else Wanted.IDLE,
                0,
                state.timestep,
                (capture_ns, capture_ns + CONTROL_NS),
                SwarmReadings(sensed),
                self._rings,
            )
        reports = self._programs.reports()
        self._reports = {t: b for d in self._devices.values() for t, b in d.acts(reports).items()}
        self.shown.update(self._programs.shown())
        lights = np.zeros((len(self._tags), LIGHT_BYTES), np.int16)
        for name, devices in self._devices.items():
            lights[self._rows[name]] = devices.lights(reports)
        wheels, leds = self._programs.wheels_steps_s, self._programs.leds
        block = np.column_stack((wheels, leds.astype(np.int16), lights)).astype("<i2")
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
