"""All virtual actuators of a run: makes levels and growths of the robots' reports, applies them.

A report may come twice, late or not at all; what happens in the world does not depend on it:
* A level holds until the next report. A robot that is silent has level 0 in everything.
* Of a counter only the growth since the last count acts, which is remembered for each robot and
  sender. A count below the last one means that the robot has restarted: it counts from 0.
* Robots act in the order of the world's rows, whatever order their reports came in.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats
from vsense.base.native import kernel_ffi, pointer
from vsense.world.actuators.base import ActuatorError, ApplyFunction, MountedActuator, RowNumbers
from vsense.world.sensors.bank import TableEntry
from vsense.world.sensors.base import NUMBERS, layout_dtype
from vsense.world.sensors.quality import Delay, Distortion, Quality, generator
from vsense.world.sightings import NEVER_NS
from vsense.world.world import World

NO_SENDERS: Mapping[int, bytes] = MappingProxyType({})


class ActuatorBank:
    """The virtual actuators of all robots of a run; `table` has one entry per actuator."""

    def __init__(
        self,
        actuators: Sequence[MountedActuator],
        tags: Sequence[int],
        seed: int = 0,
        first_id: int = 1,
        stream: str = "",
    ) -> None:
        """Mounts the actuators on every robot.

        `seed` is that of the noise and the drop-out, `first_id` the first actuator's number on the
        wire; the others follow. `stream` tells their chance from that of another bank.

        Raises:
            SensorError: an actuator's layout is wrong.
        """
        self._tags = list(tags)
        self._slots = [
            _Slot(mounted, len(self._tags), generator(seed, stream + mounted.actuator.name))
            for mounted in actuators
        ]
        self.table = tuple(slot.entry(first_id + i) for i, slot in enumerate(self._slots))
        self._size = sum(entry.size for entry in self.table)

    def kernels(
        self, world: World, robots: NDArray[np.void], reports: NDArray[np.uint8]
    ) -> list[ActuatorKernel | None]:
        """What does the same as `apply` for each actuator without Python, where C can.

        Args:
            robots: theirs in the world, all of which have been seen and report.
            reports: (n, bytes) where their reports are at each step.
        """
        ends = np.cumsum([entry.size for entry in self.table]).tolist()
        return [
            slot.kernel(world, robots, reports[:, end - entry.size : end])
            for slot, entry, end in zip(self._slots, self.table, ends)
        ]

    def apply(
        self, world: World, reports: Mapping[int, bytes], senders: Mapping[int, bytes] = NO_SENDERS
    ) -> None:
        """Applies the reports of all robots for one timestep, in which `world` was updated.

        Args:
            reports: by tag, the actuators' block of each robot's newest report. A robot that is
                not in it is silent.
            senders: by tag, who reports, where more than one robot may have had the tag.

        Raises:
            ActuatorError: a report has another size than the table says.
        """
        if not self._slots:
            return
        heard = [i for i, tag in enumerate(self._tags) if tag in reports]
        tags = [self._tags[i] for i in heard]
        for tag in tags:
            if len(reports[tag]) != self._size:
                said = f"a report of {len(reports[tag])} byte, expected {self._size}"
                raise ActuatorError(f"robot with tag {tag}: {said}")
        who = [senders.get(tag, b"") for tag in tags]
        place = {tag: row for row, tag in enumerate(world.robots["tag"].tolist())}
        rows = np.array([place.get(tag, -1) for tag in self._tags], dtype=np.intp)
        start = 0
        for slot, entry in zip(self._slots, self.table):
            parts = b"".join(reports[tag][start : start + entry.size] for tag in tags)
            slot.step(world, rows, np.array(heard, dtype=np.intp), who, parts)
            start += entry.size


class ActuatorKernel(NamedTuple):
    """One actuator of all robots of a bank as C hears and applies it.

    Attributes:
        name: of the actuator.
        apply: see `ApplyFunction`.
        heard: the `struct vs_heard *`.
    """

    name: str
    apply: ApplyFunction
    heard: Any


class _Slot:
    """One actuator with the last reports of all robots: n robots, k numbers each."""

    def __init__(self, mounted: MountedActuator, robots: int, random: np.random.Generator) -> None:
        actuator, quality = mounted.actuator, mounted.quality
        self._actuator, self._quality = actuator, quality
        self._count, self._dtype = layout_dtype(actuator.layout)
        shape = (robots, self._count)
        largest = float(np.finfo(np.float32).max)
        bounds = (actuator.scale.low, actuator.scale.high)
        self._low, self._high = (np.clip(bound, -largest, largest) for bound in bounds)
        self._levels, self._pending = np.zeros(shape), np.zeros(shape)
        self._counts = _Counts(shape)
        self._renewed = -quality.update_every
        self._random = random
        self._distortion = Distortion(quality, actuator.scale, robots, self._count)
        self._delay = Delay(quality.latency, (np.zeros(shape), np.zeros(shape)))
        self._heard: Any = None

    def kernel(
        self, world: World, robots: NDArray[np.void], reports: NDArray[np.uint8]
    ) -> ActuatorKernel | None:
        """How C hears and applies it, if C can do both."""
        given = getattr(self._actuator, "kernel", None)
        if self._quality != Quality() or not callable(given):
            return None
        apply = given(world, robots)
        if not isinstance(apply, ApplyFunction):
            return None
        return ActuatorKernel(self._actuator.name, apply, self._as_c(reports))

    def _as_c(self, reports: NDArray[np.uint8]) -> Any:
        """Makes the `struct vs_heard *`, which goes on with the counts; lives as long as this."""
        struct = self._heard = kernel_ffi.new("struct vs_heard *")
        shape = self._levels.shape
        bounds = [np.broadcast_to(b, shape[1:]) for b in (self._low, self._high)]
        self._bounds = [np.ascontiguousarray(bound, dtype=np.float64) for bound in bounds]
        self._growth = np.zeros(shape)
        struct.robots, struct.count = shape
        struct.type = NUMBERS[self._dtype]
        struct.block = kernel_ffi.cast("const uint8_t *", reports.ctypes.data)
        struct.stride = reports.strides[0]
        struct.low, struct.high = (pointer("double", b) for b in self._bounds)
        arrays = (self._counts.last, self._levels, self._growth)
        struct.last, struct.levels, struct.growth = (pointer("double", array) for array in arrays)
        return struct

    def entry(self, number: int) -> TableEntry:
        size = self._count * self._dtype.itemsize
        return TableEntry(number, self._actuator.name, self._actuator.layout, size)

    def step(
        self, world: World, rows: RowNumbers, heard: RowNumbers, who: Sequence[bytes], parts: bytes
    ) -> None:
        """Takes the reports of one timestep and acts.

        `rows` (n,) are the robots' in the world, -1 where there is none; `heard` (m,) those that
        report, `who` (m,) the senders, `parts` their numbers as on the wire, robot after robot.
        """
        said = self._numbers(parts)
        self._pending[heard] += self._counts.growth(heard, who, said)
        present = rows >= 0
        present[present] = world.robots["capture_ns"][rows[present]] != NEVER_NS
        due = present & self._due(world.run_timestep)
        self._renew(world, heard, said, due)
        growth = np.where(due[:, None], self._pending, 0.0)
        self._pending[due] = 0.0
        levels, growth = self._delay.push((self._levels.copy(), growth))
        order = np.flatnonzero(present)
        order = order[np.argsort(rows[order], kind="stable")]
        self._actuator.apply(world, rows[order], levels[order], growth[order])

    def _numbers(self, parts: bytes) -> Floats:
        """Reads numbers (m, k) from the wire, within the actuator's bounds."""
        with np.errstate(invalid="ignore"):  # a NaN of any kind is 0
            raw = np.frombuffer(parts, dtype=self._dtype).astype(np.float64)
            numbers = np.where(np.isnan(raw), 0.0, raw).reshape(-1, self._count)
        limited: Floats = np.minimum(np.maximum(numbers, self._low), self._high)
        return limited

    def _due(self, run_timestep: int) -> NDArray[np.bool_]:
        """Which robots' reports take effect in this timestep, (n,)."""
        due = np.zeros(len(self._levels), dtype=bool)
        if run_timestep - self._renewed >= self._quality.update_every:
            self._renewed = run_timestep
            due[:] = True
        if self._quality.drop_out > 0.0:
            due &= self._random.random(len(due)) >= self._quality.drop_out
        return due

    def _renew(self, world: World, heard: RowNumbers, said: Floats, due: NDArray[np.bool_]) -> None:
        """Takes over the levels that are due; what is off stays off, whatever the noise."""
        if len(heard) == len(due) and due.all() and not self._quality.distorts:
            self._levels[:] = said
            return
        fresh = self._levels.copy()
        fresh[heard] = said
        if self._quality.distorts and due.any():
            noisy = self._distortion.apply(fresh[due], due, world.time_s, self._random)
            fresh[due] = np.where(fresh[due] == 0.0, 0.0, noisy)
        self._levels[due] = fresh[due]
        silent = np.ones(len(due), dtype=bool)
        silent[heard] = False
        self._levels[silent] = 0.0


class _Counts:
    """The last counts of every robot and sender, 0 at first; `last` those of who reports now."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self.last = np.zeros(shape)
        self._who: list[bytes | None] = [None] * shape[0]
        self._earlier: dict[tuple[int, bytes], Floats] = {}

    def growth(self, heard: RowNumbers, who: Sequence[bytes], counts: Floats) -> Floats:
        """By how much counts (m, k) have grown, 0 or more; remembers them."""
        same = len(heard) == len(self._who) and self._who == who
        for robot, sender in () if same else zip(heard.tolist(), who):
            before = self._who[robot]
            if before != sender:
                if before is not None:
                    self._earlier[robot, before] = self.last[robot].copy()
                self.last[robot] = self._earlier.get((robot, sender), 0.0)
                self._who[robot] = sender
        last = self.last[heard]
        self.last[heard] = counts
        return np.maximum(np.where(counts >= last, counts - last, counts), 0.0)
