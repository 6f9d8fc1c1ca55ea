"""All virtual sensors of a run: recomputes what is due and keeps what each robot is sent.

What is sent in a timestep is always everything. A reading that was not recomputed, because its
sensor rests or no camera saw the robot, goes out again with its old capture time: its age grows
on the robot, and nothing pretends to be fresh.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsense.sensors.base import MountedSensor, SensorError, VirtualSensor, layout_dtype
from vsense.world.world import NEVER_NS, World

Values = list[tuple[bytes, int]]
"""One robot's readings in the table's order: value as on the wire, and its capture time [ns]."""


class TableEntry(NamedTuple):
    """One row of the sensor table.

    Attributes:
        id: number on the wire, from 1 in the order of the experiment file.
        name: what controllers bind to.
        layout: "[count*]type".
        size: bytes of one reading.
    """

    id: int
    name: str
    layout: str
    size: int


class SensorBank:
    """The virtual sensors of all robots of a run.

    Attributes:
        table: the sensor table, one entry per sensor.
    """

    def __init__(
        self, sensors: Sequence[MountedSensor], tags: Iterable[int], blind: bool = False
    ) -> None:
        """Mounts the sensors on every robot.

        Args:
            sensors: what the experiment asks for.
            tags: the robots, in the order of the world's `robots`.
            blind: hold every reading at 0, at its normal capture time: the control experiment.

        Raises:
            SensorError: a sensor's layout is wrong.
        """
        self._tags = list(tags)
        self._blind = blind
        self._slots = [_Slot.empty(mounted, len(self._tags)) for mounted in sensors]
        self.table = tuple(slot.entry(i + 1) for i, slot in enumerate(self._slots))

    def encode(self, world: World, timestep: int) -> dict[int, Values]:
        """Recomputes what is due and gives what every robot is sent in this timestep.

        Args:
            world: updated in this timestep, with the bank's robots.
            timestep: of the arena state, from 0.

        Returns:
            Per tag one (value, capture time) per sensor, in the table's order. The capture time
            is NEVER_NS where no camera has seen the robot yet; the value is 0 then.

        Raises:
            SensorError: a sensor gave a number that is not finite or does not fit its layout.
        """
        for slot in self._slots:
            self._refresh(slot, world, timestep)
        packed = [slot.packed() for slot in self._slots]
        return {tag: [column[i] for column in packed] for i, tag in enumerate(self._tags)}

    def _refresh(self, slot: _Slot, world: World, timestep: int) -> None:
        due = world.robots["seen"] & (timestep - slot.timesteps >= slot.update_every)
        if not due.any():
            return
        robots = world.robots[due]
        slot.timesteps[due] = timestep
        slot.captures_ns[due] = robots["capture_ns"]
        if not self._blind:
            slot.values[due] = slot.read(world, robots)


@dataclass(frozen=True, slots=True)
class _Slot:
    """One sensor with the last readings of all robots.

    Attributes:
        values: (n, k) as on the wire.
        captures_ns: (n,) when each row was true.
        timesteps: (n,) in which timestep each row was computed.
    """

    sensor: VirtualSensor
    update_every: int
    values: NDArray[Any]
    captures_ns: NDArray[np.int64]
    timesteps: NDArray[np.int64]

    @classmethod
    def empty(cls, mounted: MountedSensor, robots: int) -> _Slot:
        count, dtype = layout_dtype(mounted.sensor.layout)
        values = np.zeros((robots, count), dtype=dtype)
        captures_ns = np.full(robots, NEVER_NS, dtype=np.int64)
        timesteps = np.full(robots, -mounted.update_every, dtype=np.int64)
        return cls(mounted.sensor, mounted.update_every, values, captures_ns, timesteps)

    def entry(self, number: int) -> TableEntry:
        size = self.values.shape[1] * self.values.itemsize
        return TableEntry(number, self.sensor.name, self.sensor.layout, size)

    def read(self, world: World, robots: NDArray[np.void]) -> NDArray[Any]:
        """Reads the sensor and checks that every number can travel."""
        values = np.asarray(self.sensor.read(world, robots))
        expected = (len(robots), self.values.shape[1])
        if values.shape != expected:
            raise SensorError(
                f"sensor {self.sensor.name!r}: gave shape {values.shape}, expected {expected}"
            )
        low, high = _range(self.values.dtype)
        fits = (values >= low) & (values <= high)
        if not fits.all():
            wrong = values[~fits].flat[0]
            layout = self.sensor.layout
            raise SensorError(
                f"sensor {self.sensor.name!r}: {wrong} does not fit its layout {layout!r}"
            )
        return values.astype(self.values.dtype)

    def packed(self) -> Values:
        """Gives value and capture time of every robot."""
        rows = self.values.tobytes()
        size = len(rows) // max(len(self.values), 1)
        cut = [rows[i * size : (i + 1) * size] for i in range(len(self.values))]
        return list(zip(cut, self.captures_ns.tolist(), strict=True))


def _range(dtype: np.dtype[Any]) -> tuple[float, float]:
    limits = np.finfo(dtype) if dtype.kind == "f" else np.iinfo(dtype)
    return float(limits.min), float(limits.max)
