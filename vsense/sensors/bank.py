"""All virtual sensors of a run: recomputes what is due and keeps what each robot is sent.

All readings are sent in every timestep. One that was not renewed, because its sensor is not due,
its condition does not hold, it was dropped, or no camera saw the robot, goes out again with its old
capture time: its age grows on the robot.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsense.sensors.base import MountedSensor, SensorError, layout_dtype, scale_of
from vsense.sensors.quality import Delay, Distortion, generator
from vsense.sensors.readings import SensorReadings
from vsense.world.sightings import NEVER_NS, in_order
from vsense.world.world import World


class TableEntry(NamedTuple):
    """One row of the sensor table.

    `id` is the number on the wire, from 1 in the order of the experiment file; controllers bind to
    `name`; `layout` is "[count*]type", `size` the bytes of one reading.
    """

    id: int
    name: str
    layout: str
    size: int


class SensorBank:
    """The virtual sensors of all robots of a run; `table` has one entry per sensor."""

    def __init__(
        self,
        sensors: Sequence[MountedSensor],
        tags: Iterable[int],
        blind: bool = False,
        seed: int = 0,
        stream: str = "",
    ) -> None:
        """Mounts the sensors on every robot.

        Args:
            sensors: what the experiment asks for.
            tags: the robots. One that is not in the world is not seen.
            blind: hold every reading at 0, at its normal capture time: the control experiment.
            seed: of the noise and the drop-out.
            stream: what tells their chance from that of another bank with the same seed.

        Raises:
            SensorError: a sensor's layout is wrong.
        """
        self._tags = list(tags)
        self._slots = [
            _Slot(mounted, len(self._tags), blind, generator(seed, stream + mounted.sensor.name))
            for mounted in sensors
        ]
        self.table = tuple(slot.entry(i + 1) for i, slot in enumerate(self._slots))
        self._sizes = [entry.size for entry in self.table]
        self._block = np.zeros((len(self._tags), sum(self._sizes)), dtype=np.uint8)
        self._captures_ns = np.zeros((len(self._tags), len(self._slots)), dtype=np.int64)

    def encode(self, world: World, timestep: int) -> SensorReadings:
        """Recomputes what is due and gives what every robot, by tag, is sent in this timestep.

        The capture time is NEVER_NS where nothing has been measured yet; the value is 0 then.
        `timestep` is that of the arena state, from 0.

        Raises:
            SensorError: a sensor gave a number that is not finite or does not fit its layout.
        """
        robots = in_order(world.robots, self._tags)
        begin = 0
        for i, (slot, size) in enumerate(zip(self._slots, self._sizes)):
            values, self._captures_ns[:, i] = slot.step(world, robots, timestep)
            self._block[:, begin : begin + size] = values.view(np.uint8)
            begin += size
        block, captures_ns = self._block.copy(), self._captures_ns.copy()
        return SensorReadings(self._tags, self._sizes, block, captures_ns)


_Held = tuple[NDArray[Any], NDArray[np.int64]]


class _Slot:
    """One sensor with the last readings of all robots: n of them, k numbers each."""

    def __init__(
        self, mounted: MountedSensor, robots: int, blind: bool, random: np.random.Generator
    ) -> None:
        self._sensor, quality = mounted.sensor, mounted.quality
        self._quality, self._updating, self._blind = quality, mounted.updating, blind
        self._count, dtype = layout_dtype(self._sensor.layout)
        self._scale = scale_of(self._sensor)
        self._values = np.zeros((robots, self._count), dtype=dtype)
        self._captures_ns = np.full(robots, NEVER_NS, dtype=np.int64)
        self._timesteps = np.full(robots, -quality.update_every, dtype=np.int64)
        self._random = random
        self._distortion = Distortion(quality, self._scale, robots, self._count)
        # Without latency nothing waits, and nothing has to be kept.
        self._delay = Delay(quality.latency, self._kept()) if quality.latency else None

    def entry(self, number: int) -> TableEntry:
        size = self._count * self._values.itemsize
        return TableEntry(number, self._sensor.name, self._sensor.layout, size)

    def step(self, world: World, robots: NDArray[np.void], timestep: int) -> _Held:
        """Renews what is due; gives values (n, k) and capture times (n,) of the robots."""
        due = robots["seen"] & (timestep - self._timesteps >= self._quality.update_every)
        self._timesteps[due] = timestep
        if self._quality.drop_out > 0.0:
            due &= self._random.random(len(due)) >= self._quality.drop_out
        if due.any():
            self._renew(world, robots, due)
        if self._delay is None:
            return self._values, self._captures_ns
        return self._delay.push(self._kept())

    def _renew(self, world: World, robots: NDArray[np.void], due: NDArray[np.bool_]) -> None:
        rows = np.flatnonzero(due)
        if not self._blind:
            fresh = self._measured(world, robots[due], due)
            never = self._captures_ns[rows] == NEVER_NS
            sent = self._values[rows]
            rows_due = never | self._updating.due(self._sensor, self._scale, sent, fresh)
            rows, fresh = rows[rows_due], fresh[rows_due]
            self._values[rows] = fresh
        self._captures_ns[rows] = robots["capture_ns"][rows]

    def _measured(
        self, world: World, robots: NDArray[np.void], due: NDArray[np.bool_]
    ) -> NDArray[Any]:
        """Reads the sensor with all its faults: (m, k) as on the wire."""
        values = self._read(world, robots)
        if self._quality.distorts:
            values = self._distortion.apply(values, due, world.time_s, self._random)
            values = np.clip(values, *_range(self._values.dtype))
            tidy = getattr(self._sensor, "tidy", None)
            values = tidy(values) if callable(tidy) else values
        if self._values.dtype.kind != "f":
            values = np.rint(values)
        return values.astype(self._values.dtype)

    def _read(self, world: World, robots: NDArray[np.void]) -> NDArray[np.float64]:
        """Reads the perfect sensor and checks that every number can travel."""
        name, layout = self._sensor.name, self._sensor.layout
        values = np.asarray(self._sensor.read(world, robots), dtype=np.float64)
        expected = (len(robots), self._count)
        if values.shape != expected:
            raise SensorError(f"sensor {name!r}: gave shape {values.shape}, expected {expected}")
        low, high = _range(self._values.dtype)
        fits = (values >= low) & (values <= high)
        if not fits.all():
            wrong = values[~fits].flat[0]
            raise SensorError(f"sensor {name!r}: {wrong} does not fit its layout {layout!r}")
        return values

    def _kept(self) -> _Held:
        return self._values.copy(), self._captures_ns.copy()


def _range(dtype: np.dtype[Any]) -> tuple[float, float]:
    limits = np.finfo(dtype) if dtype.kind == "f" else np.iinfo(dtype)
    return float(limits.min), float(limits.max)
