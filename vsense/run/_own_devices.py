"""What robots measure and light themselves, of which their controller on the host knows.

The controller's runtime in this process has no ring, board or battery. What a robot says of its own
sensors is given to it as if it came from the host, under the sensors' own names and with the time
at which the robot said it; a virtual sensor of the same name wins, and with "+" it is fused with
the robot's own as `robot/robot.c` does it. Layouts are those of `robot/controllers/remote.c`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats
from vsense.base.readings import SensorReadings
from vsense.robots.hosted import MESSAGE, OWN_ENTRIES
from vsense.robots.link.table import Direction, Entry, Table
from vsense.robots.python_swarm import OWN_COUNTS, RGB
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
