"""All virtual sensors of a run: recomputes what is due and keeps what each robot is sent.

All readings are sent in every timestep. One that was not renewed, because its sensor is not due,
its condition does not hold, it was dropped, or no camera saw the robot, goes out again with its old
capture time: its age grows on the robot.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsense.base.errors import instead
from vsense.base.native import check, kernel_ffi, kernels, pointer
from vsense.base.readings import SensorReadings
from vsense.world.sensors.base import (
    NUMBERS,
    MountedSensor,
    ReadFunction,
    SensorError,
    layout_dtype,
    scale_of,
)
from vsense.world.sensors.quality import ALWAYS, Delay, Distortion, Quality, QualityError, generator
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
    """The virtual sensors of all robots of a run.

    Attributes:
        table: one entry per sensor.
        version: grows when a sensor's quality changes.
    """

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
        self._tags, self.version = list(tags), 0
        self._slots = [
            _Slot(mounted, len(self._tags), blind, generator(seed, stream + mounted.sensor.name))
            for mounted in sensors
        ]
        self.table = tuple(slot.entry(i + 1) for i, slot in enumerate(self._slots))
        self._sizes = [entry.size for entry in self.table]
        self._block = np.zeros((len(self._tags), sum(self._sizes)), dtype=np.uint8)
        self._captures_ns = np.zeros((len(self._tags), len(self._slots)), dtype=np.int64)
        ends = np.cumsum(self._sizes).tolist()
        for i, (slot, size, end) in enumerate(zip(self._slots, self._sizes, ends)):
            slot.send_in(self._block[:, end - size : end], self._captures_ns[:, i])

    def encode(self, world: World, timestep: int) -> SensorReadings:
        """Recomputes what is due and gives what every robot, by tag, is sent in this timestep.

        The capture time is NEVER_NS where nothing has been measured yet; the value is 0 then.
        `timestep` is that of the arena state, from 0.

        Raises:
            SensorError: a sensor gave a number that is not finite or does not fit its layout.
        """
        self.step(world, timestep, range(len(self._slots)))
        block, captures_ns = self._block.copy(), self._captures_ns.copy()
        return SensorReadings(self._tags, self._sizes, block, captures_ns)

    def step(self, world: World, timestep: int, numbers: Iterable[int]) -> None:
        """Renews some of the sensors, by their numbers from 0, in `newest`; raises as `encode`."""
        robots = in_order(world.robots, self._tags)
        for number in numbers:
            self._slots[number].step(world, robots, timestep)

    @property
    def qualities(self) -> dict[str, Quality]:
        """How good each sensor is now, by its name."""
        return {slot.name: slot.quality for slot in self._slots}

    def set_quality(self, name: str, setting: str, value: float) -> None:
        """Changes a setting of a sensor from the next timestep on; see `Quality.changed`.

        Raises:
            QualityError: there is no such sensor or setting, or it cannot have this value.
        """
        slots = {slot.name: slot for slot in self._slots}
        if name not in slots:
            raise QualityError(f"there is no sensor {name!r:.60}; {instead(name, slots)}")
        slots[name].set_quality(setting, value)
        self.version += 1

    @property
    def newest(self) -> SensorReadings:
        """The newest readings, in arrays that change with them."""
        return SensorReadings(self._tags, self._sizes, self._block, self._captures_ns)

    def kernels(self, world: World, robots: NDArray[np.void]) -> list[SensorKernel | None]:
        """What reads and sends each of them without Python; None where that is not enough.

        `robots` are theirs in the world. It holds until an entity or the floor changes.
        """
        return [slot.kernel(world, robots) for slot in self._slots]


@dataclass(frozen=True, slots=True)
class SensorKernel:
    """One sensor of all robots of a bank as C reads and sends it.

    Attributes:
        name: of the sensor.
        read: see `ReadFunction`.
        sent: the `struct vs_sent *`.
        noise: gives what is added to the readings to come, (j, n, k), one at least; None: nothing.
        use: is told for how many of the readings to come it was used.
    """

    name: str
    read: ReadFunction
    sent: Any
    noise: Callable[[], NDArray[np.float64]] | None
    use: Callable[[int], None]


_Held = tuple[NDArray[Any], NDArray[np.int64]]


class _Slot:
    """One sensor with the last readings of all robots: n of them, k numbers each."""

    def __init__(
        self, mounted: MountedSensor, robots: int, blind: bool, random: np.random.Generator
    ) -> None:
        self._sensor, quality = mounted.sensor, mounted.quality
        self.name, self.quality = self._sensor.name, quality
        self._updating, self._blind = mounted.updating, blind
        self._count, dtype = layout_dtype(self._sensor.layout)
        self._scale = scale_of(self._sensor)
        self._dtype = dtype
        self._plain: Any = None
        self._values = np.zeros((robots, self._count), dtype=dtype)
        self._captures_ns = np.full(robots, NEVER_NS, dtype=np.int64)
        self._timesteps = np.full(robots, -quality.update_every, dtype=np.int64)
        self._random = random
        self._distortion = Distortion(quality, self._scale, robots, self._count)
        # Without latency nothing waits, and nothing has to be kept.
        self._delay = Delay(quality.latency, self._snapshot()) if quality.latency else None

    def set_quality(self, setting: str, value: float) -> None:
        """See `SensorBank.set_quality`. What waits because of a latency is dropped with it."""
        quality = self.quality = self.quality.changed(setting, value, self._scale)
        self._distortion = Distortion(quality, self._scale, *self._values.shape)
        if setting != "latency":
            self._plain = self._as_c() if self._is_plain else None
            return
        sent, captures_ns = self._sent
        sent[:], captures_ns[:] = self._values, self._captures_ns
        self._values, self._captures_ns = self._snapshot()
        self._delay = Delay(quality.latency, self._snapshot()) if quality.latency else None
        self._wire()

    def entry(self, number: int) -> TableEntry:
        size = self._count * self._values.itemsize
        return TableEntry(number, self._sensor.name, self._sensor.layout, size)

    def send_in(self, block: NDArray[np.uint8], captures_ns: NDArray[np.int64]) -> None:
        """Sets where the robots' values (n, bytes) and their capture times (n,) are to be."""
        captures_ns[:] = self._captures_ns
        self._sent = block.view(self._dtype), captures_ns
        self._wire()

    def _wire(self) -> None:
        """Chooses what renews what is sent."""
        if self._delay is None:  # then all of them are sent as they are
            self._values, self._captures_ns = self._sent
        self._plain = self._as_c() if self._is_plain else None

    def step(self, world: World, robots: NDArray[np.void], timestep: int) -> None:
        """Renews what is due and sends what is."""
        due = robots["seen"] & (timestep - self._timesteps >= self.quality.update_every)
        self._timesteps[due] = timestep
        if self.quality.drop_out > 0.0:
            due &= self._random.random(len(due)) >= self.quality.drop_out
        if self._plain is not None and due.all():
            self._send(world, robots)
        elif due.any():
            self._renew(world, robots, due)
        if self._delay is not None:
            self._sent[0][:], self._sent[1][:] = self._delay.push(self._snapshot())

    def kernel(self, world: World, robots: NDArray[np.void]) -> SensorKernel | None:
        """How C reads and sends it, if C can do both."""
        given = getattr(self._sensor, "kernel", None)
        if self._plain is None or not callable(given):
            return None
        read = given(world, robots)
        if not isinstance(read, ReadFunction):  # a user's sensor may call something else so
            return None
        noise = partial(self._distortion.noise, self._random) if self.quality.distorts else None
        return SensorKernel(self._sensor.name, read, self._plain, noise, self._distortion.use)

    @property
    def _is_plain(self) -> bool:
        """Whether every reading is sent as it is, or with noise that is limited to its bounds."""
        quality, noisy = self.quality, self.quality.distorts
        always = self._updating == ALWAYS and not self._blind
        at_once = not quality.latency and not quality.drop_out and quality.update_every == 1
        tidy = getattr(self._sensor, "tidy", None)
        return always and at_once and (not noisy or (self._distortion.is_noise and tidy is None))

    def _send(self, world: World, robots: NDArray[np.void]) -> None:
        """Reads the sensor for all robots and sends that, if it is plain."""
        self._fresh[:] = self._read(world, robots)
        if self.quality.distorts:
            noise = self._distortion.noise(self._random)[0]
            self._plain.offsets = pointer("double", noise)
            self._distortion.use(1)
        check(kernels.vs_sent_renew(self._plain, 0), self._sensor.name)
        self._captures_ns[:] = robots["capture_ns"]

    def _as_c(self) -> Any:
        """Makes the `struct vs_sent *`; its arrays live as long as this slot."""
        values, captures_ns = self._sent
        bounds = (self._distortion.unit, self._distortion.low, self._distortion.high)
        self._fresh = np.zeros((len(values), self._count))
        self._bounds = [np.ascontiguousarray(array) for array in bounds]
        sent: Any = kernel_ffi.new("struct vs_sent *")
        sent.robots, sent.count = values.shape
        sent.type = NUMBERS[self._dtype]
        sent.block = kernel_ffi.cast("uint8_t *", values.ctypes.data)
        sent.stride, sent.step = values.strides[0], captures_ns.strides[0] // captures_ns.itemsize
        sent.captures_ns = kernel_ffi.cast("int64_t *", captures_ns.ctypes.data)
        sent.fresh = pointer("double", self._fresh)
        sent.unit, sent.low, sent.high = (pointer("double", array) for array in self._bounds)
        return sent

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
        if self.quality.distorts:
            values = self._distortion.apply(values, due, world.time_s, self._random)
            values = np.clip(values, *_range(self._values.dtype))
            tidy = getattr(self._sensor, "tidy", None)
            values = tidy(values) if callable(tidy) else values
        if self._values.dtype.kind != "f":
            values = np.rint(values)
        return values.astype(self._values.dtype)

    def _read(self, world: World, robots: NDArray[np.void]) -> NDArray[np.float64]:
        """Reads the perfect sensor and checks that every number can travel."""
        layout = self._sensor.layout
        # One of a user's own tells where it is written.
        name = f"{getattr(self._sensor, 'place', '')}sensor {self._sensor.name!r}"
        values = np.asarray(self._sensor.read(world, robots), dtype=np.float64)
        expected = (len(robots), self._count)
        if values.shape != expected:
            raise SensorError(f"{name}: gave shape {values.shape}, expected {expected}")
        low, high = _range(self._values.dtype)
        fits = (values >= low) & (values <= high)
        if not fits.all():
            wrong = values[~fits].flat[0]
            raise SensorError(f"{name}: {wrong} does not fit its layout {layout!r}")
        return values

    def _snapshot(self) -> _Held:
        return self._values.copy(), self._captures_ns.copy()


def _range(dtype: np.dtype[Any]) -> tuple[float, float]:
    limits = np.finfo(dtype) if dtype.kind == "f" else np.iinfo(dtype)
    return float(limits.min), float(limits.max)
