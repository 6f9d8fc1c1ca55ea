"""Robots whose controller is Python or Lua: it runs on this host, and their daemons obey it.

They run the shipped controller `remote`: `command` goes down as any reading, with its age, and
`own` comes up. So all that stops a robot stops these, too: silence, old commands, an emergency
stop, a controller that has failed.

The controller's runtime in this process has no ring, board or battery. What a robot says of its own
sensors is given to it as if it came from the host, under the sensors' own names and with the time
at which the robot said it; a virtual sensor of the same name wins, and with "+" it is fused with
the robot's own as `robot/robot.c` does it. Layouts are those of `robot/controllers/remote.c`.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from vsense.base import interruption
from vsense.base.arena import ArenaState, Floats
from vsense.base.readings import SensorReadings, SwarmReadings, TimedReadings
from vsense.config.specs import ControllerSpec, Experiment
from vsense.robots.hosted import MESSAGE, OWN_ENTRIES, STEP_MAX_S, HostedProgram
from vsense.robots.inprocess import CONTROL_NS
from vsense.robots.link.table import Direction, Entry, Table
from vsense.robots.link.wire import ShownData, Wanted
from vsense.robots.program import kind_of
from vsense.robots.python_swarm import OWN_COUNTS, RGB
from vsense.run.programs import Programs, failed_words
from vsense.world.world import NEVER_NS

OWN_NUMBERS = sum(1 + count for count in OWN_COUNTS.values())
"""Of the entry `own`: of each sensor how many numbers are known, and room for them."""
_PLACES = dict(zip(OWN_COUNTS, accumulate((1 + n for n in OWN_COUNTS.values()), initial=0)))
"""Where each sensor begins in it."""
_LIGHTS = (Entry(OWN_ENTRIES + 50, RGB, "12*u1"), Entry(OWN_ENTRIES + 51, MESSAGE, "5*u1"))
LIGHT_BYTES = 17
_STALE_TIMESTEPS = 2.5


class OwnDevices:
    """The own devices of the n robots of a controller that runs here.

    Attributes:
        tags: the robots.
        table: what their controller reads and sets: `virtual`, and the own devices.
    """

    def __init__(self, virtual: Table, tags: Sequence[int], timestep_ns: int) -> None:
        self.tags, self._stale_ns = tuple(tags), _STALE_TIMESTEPS * timestep_ns
        self._rows = {tag: row for row, tag in enumerate(self.tags)}
        kept = [entry for entry in virtual.entries if entry.direction == Direction.SENSOR]
        sizes = [size for *_, size in virtual.of_direction(Direction.SENSOR)]
        starts = [0, *accumulate(sizes)]
        self._fused = {
            entry.name[1:]: (column, slice(at, at + size), f"<{entry.layout.rpartition('*')[2]}")
            for column, (entry, at, size) in enumerate(zip(kept, starts, sizes))
            if entry.name.startswith("+")
        }
        self._columns = [i for i, entry in enumerate(kept) if not entry.name.startswith("+")]
        names = {entry.name for entry in kept}
        self._own = [name for name in OWN_COUNTS if name not in names]
        acts = [entry for entry in virtual.entries if entry.direction == Direction.ACTUATOR]
        self._act_bytes = sum(size for *_, size in virtual.of_direction(Direction.ACTUATOR))
        more = [entry for entry in _LIGHTS if entry.name not in {a.name for a in acts}]
        own = [
            Entry(OWN_ENTRIES + i, name, f"{OWN_COUNTS[name]}*f4")
            for i, name in enumerate(self._own)
        ]
        self._starts = starts
        self._sizes = [sizes[i] for i in self._columns] + [4 * OWN_COUNTS[n] for n in self._own]
        up = [Entry(e.id, e.name, e.layout, Direction.ACTUATOR) for e in more]
        self.table = Table([*(kept[i] for i in self._columns), *own, *acts, *up])
        self._values = np.zeros((len(tags), OWN_NUMBERS))
        self._own_ns = np.full(len(tags), NEVER_NS)

    def hear(self, tag: int, numbers: bytes, measured_ns: int) -> None:
        """Takes what a robot says of its sensors, and when it has measured that."""
        row = self._rows[tag]
        self._values[row], self._own_ns[row] = np.frombuffer(numbers, "<f4"), measured_ns

    def sense(self, virtual: SensorReadings, capture_ns: int) -> SensorReadings:
        """What the controller senses: virtual readings of this timestep, and the own ones."""
        parts = [virtual.block[:, self._starts[i] : self._starts[i + 1]] for i in self._columns]
        times = [virtual.captures_ns[:, i] for i in self._columns]
        for name in self._own:
            count, start = OWN_COUNTS[name], _PLACES[name]
            values = self._values[:, start + 1 : start + 1 + count].copy()
            known = (self._values[:, start] > 0) & (self._own_ns != NEVER_NS)
            if name in self._fused:
                self._fuse(name, values, virtual, capture_ns)
            parts.append(values.astype("<f4").view(np.uint8))
            # What is newer than the picture counts as new as that: nothing is from the future.
            times.append(np.where(known, np.minimum(self._own_ns, capture_ns), NEVER_NS))
        block = np.ascontiguousarray(np.hstack(parts))
        return SensorReadings(self.tags, self._sizes, block, np.column_stack(times))

    def _fuse(self, name: str, values: Floats, virtual: SensorReadings, capture_ns: int) -> None:
        column, place, kind = self._fused[name]
        other = np.ascontiguousarray(virtual.block[:, place]).view(kind)
        taken_ns = virtual.captures_ns[:, column]
        fresh = (taken_ns != NEVER_NS) & (capture_ns - taken_ns <= self._stale_ns)
        both = min(values.shape[1], other.shape[1])
        values[fresh, :both] = np.maximum(values[fresh, :both], other[fresh, :both])

    def acts(self, reports: Mapping[int, bytes]) -> dict[int, bytes]:
        """What virtual actuators do, by tag; {}: there are none."""
        if not self._act_bytes:
            return {}
        return {tag: reports[tag][: self._act_bytes] for tag in self.tags}

    def lights(self, reports: Mapping[int, bytes]) -> NDArray[np.int16]:
        """(n, 17) what coloured LEDs and the board for messages are to do."""
        done = np.zeros((len(self.tags), LIGHT_BYTES), np.int16)
        for row, tag in enumerate(self.tags):
            given = np.frombuffer(reports[tag][self._act_bytes :], np.uint8)
            done[row, : len(given)] = given
        return done


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
    timer = signal.setitimer(signal.ITIMER_REAL, STEP_MAX_S, STEP_MAX_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
        signal.setitimer(signal.ITIMER_REAL, *timer)
        interruption.look()  # a signal may have come


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
