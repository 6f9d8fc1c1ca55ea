"""The true poses of every body of the lab: a ring for the present, a log for the report.

One process writes a record per tick of its physics into the ring, others read the truth at any
moment of the last 256 ticks; no process waits for another. A record that is read while it is being
written shows a wrong checksum, which needs no memory ordering from the processor: a reader takes
the tick before it for the newest, and reads again only where the writer has gone on.

The log holds the truth at every capture: a header, the number of bodies, and one record per
timestep, all little endian.
"""

from __future__ import annotations

import os
import struct
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats, wrap_angle
from vsense.base.shared import LabError, LogFile, SharedBlock, file_errors

LedStates = NDArray[np.uint16]

TICKS = 256
"""Ticks that the ring remembers."""

_MAGIC = 0x31_54_55_52_54_53_56
_HEADER = np.dtype([("magic", "i8"), ("bodies", "i8")])


def _record_dtype(bodies: int) -> np.dtype[np.void]:
    """One tick; `sequence` counts from 1, `checksum` is a CRC-32 of the record with 0 in it."""
    return np.dtype(
        [
            ("sequence", "i8"), ("time_ns", "i8"),
            ("poses", "f8", (bodies, 3)), ("leds", "u2", (bodies,)), ("checksum", "u4"),
        ],
        align=True,
    )  # fmt: skip


def _ring_size(bodies: int) -> int:
    return _HEADER.itemsize + TICKS * _record_dtype(bodies).itemsize


def make_ring(bodies: int) -> SharedBlock:
    """Makes an empty ring; writer and readers open its `name`."""
    block = SharedBlock.anonymous("vsense-truth", _ring_size(bodies))
    block.bytes[: _HEADER.itemsize].view(_HEADER)[0] = (_MAGIC, bodies)
    return block


class TruthWriter:
    """The ring's only writer."""

    def __init__(self, name: str, bodies: int) -> None:
        """Empties the ring `name` of `make_ring`, or makes one under that plain name.

        Raises:
            LabError: the ring is there for another number of bodies.
        """
        self._block = SharedBlock.open(name, _ring_size(bodies))
        header = self._block.bytes[: _HEADER.itemsize].view(_HEADER)
        if header["magic"][0] not in (0, _MAGIC) or header["bodies"][0] not in (0, bodies):
            raise LabError(
                f"truth ring {name}: made for {header['bodies'][0]} bodies, not {bodies}"
            )
        header[0] = (_MAGIC, bodies)
        dtype = _record_dtype(bodies)
        self._slots = self._block.bytes[_HEADER.itemsize :][: TICKS * dtype.itemsize]
        self._slots = self._slots.reshape(TICKS, dtype.itemsize)
        self._slots[:] = 0
        self._bytes = np.zeros(dtype.itemsize, dtype=np.uint8)
        self._record = self._bytes.view(dtype)
        self._sequence = 0

    def write(self, time_ns: int, poses: Floats, leds: NDArray[np.integer]) -> None:
        """Publishes one tick, later than the one before, on the host's monotonic clock.

        `poses` (n, 3) are x [m], y [m], yaw [rad] of every body, arena frame; `leds` (n,) LED
        bits: 0-7 ring, 8 body, 9 front.
        """
        self._sequence += 1
        self._record[0] = (self._sequence, time_ns, poses, leds, 0)
        self._record["checksum"] = zlib.crc32(self._bytes.data)
        self._slots[self._sequence % TICKS] = self._bytes

    def close(self) -> None:
        """Releases the ring, and removes it where this writer has made it."""
        self._slots = self._slots[:0]
        self._block.close()


class TruthReader:
    """Reads the truth of `bodies` bodies at any recent moment."""

    def __init__(self, name: str) -> None:
        """Opens a ring; raises LabError where there is none of that name."""
        self._block = SharedBlock.open(name)
        header = self._block.bytes[: _HEADER.itemsize].view(_HEADER)[0]
        if header["magic"] != _MAGIC:
            raise LabError(f"truth ring {name}: not a truth ring")
        self.bodies = int(header["bodies"])
        self._dtype = _record_dtype(self.bodies)
        self._slots = self._block.bytes[_HEADER.itemsize :][: TICKS * self._dtype.itemsize]
        self._slots = self._slots.reshape(TICKS, self._dtype.itemsize)
        self._times = self._slots.view(self._dtype)["time_ns"][:, 0]

    def newest_ns(self) -> int:
        """Time of the newest whole tick, 0 while there is none.

        Raises:
            LabError: the ring holds records, and none of them is whole.
        """
        while True:
            times = self._times.copy()
            # One record at most is being written: the tick before it is whole.
            for slot in np.argsort(times)[::-1]:
                if not times[slot]:
                    return 0
                record = self._read(int(slot))
                if record is not None:
                    return int(record["time_ns"])
            if np.array_equal(times, self._times):
                raise LabError("truth ring: its records are broken")

    def at(self, time_ns: int) -> tuple[Floats, LedStates]:
        """Poses and LED bits at one moment on the host's monotonic clock; see `TruthWriter.write`.

        Poses are interpolated between the ticks on both sides; LEDs are those of the tick before.

        Raises:
            LabError: the ring does not reach back or forward to that moment.
        """
        while True:
            times = self._times.copy()
            pair = self._around(times, time_ns)
            if pair is not None:
                return _interpolate(*pair, time_ns)
            # Where the writer has gone on, the ring may still reach to that moment; where it has
            # not, the record is the one that is being written.
            if np.array_equal(times, self._times):
                raise LabError(
                    f"truth ring: asked for {time_ns} ns, it holds no whole tick on one side of it"
                )

    def close(self) -> None:
        """Releases the ring."""
        self._slots, self._times = self._slots[:0], self._times[:0]
        self._block.close()

    def _around(self, times: NDArray[np.int64], time_ns: int) -> tuple[np.void, np.void] | None:
        """The ticks on both sides of a moment; None where one of them is not whole.

        `times` are those of all slots. Raises as `at`.
        """
        earlier = np.where((times > 0) & (times <= time_ns), times, 0)
        before = int(np.argmax(earlier))
        if earlier[before] == 0 or times.max() < time_ns:
            written = times[times > 0]
            span = f"{written.min()} .. {written.max()}" if written.size else "nothing yet"
            raise LabError(f"truth ring: asked for {time_ns} ns, it holds {span}")
        after = before if times[before] == time_ns else (before + 1) % TICKS
        first, second = self._read(before), self._read(after)
        if first is None or second is None:
            return None
        in_order = int(second["sequence"] - first["sequence"]) == (0 if after == before else 1)
        around = first["time_ns"] <= time_ns <= second["time_ns"]
        return (first, second) if in_order and around else None

    def _read(self, slot: int) -> np.void | None:
        """A copy of one record; None while it is being written or was never written."""
        record = self._slots[slot].copy().view(self._dtype)
        checksum = int(record["checksum"][0])
        record["checksum"] = 0
        written = zlib.crc32(record.view(np.uint8).data) == checksum
        return record[0] if written and record["sequence"][0] % TICKS == slot else None


def _interpolate(before: np.void, after: np.void, time_ns: int) -> tuple[Floats, LedStates]:
    span = int(after["time_ns"]) - int(before["time_ns"])
    share = (time_ns - int(before["time_ns"])) / span if span else 0.0
    change = after["poses"] - before["poses"]
    change[:, 2] = wrap_angle(change[:, 2])
    poses = before["poses"] + share * change
    poses[:, 2] = wrap_angle(poses[:, 2])
    return poses, before["leds"].copy()


_LOG_HEADER = struct.Struct("<8sQ")
LOG_MAGIC = b"vstruth2"
"""Its last digit is the format's number."""


def truth_dtype(bodies: int) -> np.dtype[np.void]:
    """One timestep of a truth log; poses and LEDs as in `TruthWriter.write`, at `capture_ns`.

    Fields:
        timestep: number of the trigger.
        capture_ns: middle of the exposure.
        ready_ns: the last picture was in memory.
        render_ns: how long it took to draw the bodies: the lab's readout of the sensor.
    """
    return np.dtype(
        [
            ("timestep", "<i8"), ("capture_ns", "<i8"), ("ready_ns", "<i8"),
            ("render_ns", "<i8"), ("poses", "<f8", (bodies, 3)), ("leds", "<u2", (bodies,)),
        ]
    )  # fmt: skip


class TruthLog:
    """Writes a truth log."""

    def __init__(self, path: Path, bodies: int) -> None:
        """Begins a new file; LabError where it cannot be written."""
        self._record = np.zeros(1, dtype=truth_dtype(bodies))
        self._file = LogFile(path, "truth log")
        self._file.append(_LOG_HEADER.pack(LOG_MAGIC, bodies))

    def append(
        self,
        timestep: int,
        capture_ns: int,
        ready_ns: int,
        render_ns: int,
        poses: Floats,
        leds: LedStates,
    ) -> None:
        """Adds one timestep; see `truth_dtype`."""
        self._record[0] = (timestep, capture_ns, ready_ns, render_ns, poses, leds)
        self._file.append(self._record.tobytes())

    def close(self) -> None:
        """Ends the file."""
        self._file.close()


def read_truth(path: str | Path, offset: int = 0) -> NDArray[np.void]:
    """Reads a truth log (timesteps,); a last record that is not whole is left out.

    Args:
        path: of the file.
        offset: records that end before this byte of it are left out.

    Raises:
        LabError: the file cannot be read, or is no truth log.
    """
    with file_errors(f"truth log {path}"), Path(path).open("rb") as file:
        head = file.read(_LOG_HEADER.size)
        if len(head) < _LOG_HEADER.size:
            raise LabError(f"truth log {path}: {len(head)} bytes are no truth log")
        magic, bodies = _LOG_HEADER.unpack(head)
        if magic != LOG_MAGIC:
            raise LabError(f"truth log {path}: begins with {magic!r}, expected {LOG_MAGIC!r}")
        dtype = truth_dtype(bodies)
        file.seek(max(offset - len(head), 0) // dtype.itemsize * dtype.itemsize, os.SEEK_CUR)
        content = file.read()
    return np.frombuffer(content, dtype=dtype, count=len(content) // dtype.itemsize)


def truth_at(truth: NDArray[np.void], timesteps: NDArray[np.int64]) -> NDArray[np.void]:
    """The records of rising timesteps, up to the first one that a truth log lacks."""
    rows = np.searchsorted(truth["timestep"], timesteps)
    rows = rows[rows < len(truth)]
    lacking = truth["timestep"][rows] != timesteps[: len(rows)]
    return truth[rows[: np.argmax(lacking)] if lacking.any() else rows]
