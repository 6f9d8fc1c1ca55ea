"""The microcontrollers of the lab's robots: real firmware code behind real pseudo-terminals."""

from __future__ import annotations

import os
import struct
import tty
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsense.lab.shared import LabError
from vsense.native import ffi, lib

ACTUATION = np.dtype(
    [
        ("time_ns", "<i8"),
        ("robot", "<u2"),
        ("left_steps_s", "<i2"),
        ("right_steps_s", "<i2"),
        ("leds", "<u2"),
    ]
)
"""One actuator frame as a microcontroller applied it; an actuation log is these, end to end.

`time_ns` is the host's monotonic clock when the firmware applied the frame; `robot` the robot's
index; the speeds are those that the motors turn with from then on; `leds` what is lit from then
on, bits 0-7 ring, 8 body, 9 front.
"""

LIGHT_RAW = 3000
"""What every light sensor reads, higher is darker: the lab's rooms are evenly lit."""

_RECORD = struct.Struct("<qHhhH")
_FIFO_NS = 16 * lib.EPUCK_ARGOS_BYTE_NS
"""A serial driver hands bytes on when its buffer of 16 is full or the line falls silent. So does
a terminal here: bytes come out of it when this time has passed or all are through, not one by one,
which would wake a daemon for each."""
_NEVER_US = 2**64 - 1


class Actuation(NamedTuple):
    """One actuator frame as a microcontroller applied it: a row of `ACTUATION`."""

    time_ns: int
    robot: int
    left_steps_s: int
    right_steps_s: int
    leds: int


class Microcontrollers:
    """One emulated microcontroller and its terminal per robot.

    A terminal's other end is held open here: daemons come and go, the microcontroller and what
    it remembers stay. Nothing here waits: bytes that nobody reads are lost when the terminal is
    full, as on a wire. Time is an argument in ns and never goes back.

    Attributes:
        slaves: path of the terminal that each robot's daemon opens.
        due_ns: when `advance` has something to do again, None while all lines are idle.
    """

    def __init__(self, count: int) -> None:
        """Powers `count` microcontrollers on.

        Raises:
            LabError: there are not that many pseudo-terminals.
        """
        self._firmware: Any = ffi.new("struct fw_argos[]", count)
        self._programs = [self._firmware + robot for robot in range(count)]
        for program in self._programs:
            lib.fw_argos_init(program)
        self._prox = self._inputs("prox", count)
        self._inputs("light", count)[:] = LIGHT_RAW
        self._bytes: Any = ffi.new("uint8_t[]", lib.FW_LINE_CAPACITY)
        self._waiting = [b""] * count
        self._handed_ns = [0] * count
        self._busy: set[int] = set()
        self._sent_bytes = self._lost_bytes = 0
        self.due_ns: int | None = None
        self._ends: list[tuple[int, int]] = []
        try:
            for _ in range(count):
                self._ends.append(_raw_terminal())
        except OSError as error:
            made = len(self._ends)
            self.close()
            raise LabError(f"pseudo-terminals: {made} of {count}, then: {error.strerror}") from None
        self._robots = {master: robot for robot, (master, _) in enumerate(self._ends)}
        self.slaves = [os.ttyname(slave) for _, slave in self._ends]

    def readable(self) -> list[int]:
        """The descriptors whose bytes `receive` would take now."""
        return [master for master, robot in self._robots.items() if not self._waiting[robot]]

    def receive(self, masters: Iterable[int], now_ns: int) -> None:
        """Puts what daemons wrote on the lines to their microcontrollers.

        Args:
            masters: the descriptors of `readable` that have bytes.
            now_ns: when the bytes came.
        """
        for master in masters:
            robot = self._robots[master]
            self._waiting[robot] += os.read(master, lib.FW_LINE_CAPACITY)
            self._offer(robot, now_ns)
            self._busy.add(robot)
        self._plan(now_ns)

    def advance(self, now_ns: int) -> list[Actuation]:
        """Lets all microcontrollers live on to `now_ns` and hands out the bytes they sent.

        Returns:
            The actuator frames applied since the last call, in order for each robot.
        """
        applied: list[Actuation] = []
        for robot in sorted(self._busy):
            program = self._programs[robot]
            while lib.fw_argos_advance(program, now_ns // 1000):
                applied.append(_applied(program, robot))
            self._offer(robot, now_ns)
            due_ns = lib.fw_argos_due_us(program) * 1000
            if now_ns >= min(self._handed_ns[robot] + _FIFO_NS, due_ns):
                self._transmit(robot, now_ns)
        self._plan(now_ns)
        return applied

    def sense(self, prox_raw: NDArray[np.int16]) -> None:
        """Sets what the proximity sensors (count, 8) measure from now on, ps0..ps7."""
        self._prox[:] = prox_raw

    def counters(self) -> dict[str, int]:
        """What went over the lines since power on, summed over all robots.

        `frames`, `overlapped_bytes` and `overflowed_bytes` as in `fw_argos.h`; `sent_bytes` to
        the daemons, and `lost_bytes` that a full terminal did not take.
        """
        return {
            "sent_bytes": self._sent_bytes,
            "lost_bytes": self._lost_bytes,
            "frames": sum(program.frames for program in self._programs),
            "overlapped_bytes": sum(program.overlapped for program in self._programs),
            "overflowed_bytes": sum(program.overflowed for program in self._programs),
        }

    def close(self) -> None:
        """Hangs all terminals up."""
        for ends in self._ends:
            for descriptor in ends:
                os.close(descriptor)
        self._ends = []

    def _inputs(self, field: str, count: int) -> NDArray[np.int16]:
        """A view (count, 8) of one array in the inputs of all firmwares."""
        view: NDArray[np.int16] = np.ndarray(
            (count, 8),
            dtype=np.int16,
            buffer=ffi.buffer(self._firmware),
            offset=ffi.offsetof("struct fw_argos", "inputs", field),
            strides=(ffi.sizeof("struct fw_argos"), 2),
        )
        return view

    def _offer(self, robot: int, now_ns: int) -> None:
        waiting = self._waiting[robot]
        if waiting:
            took = lib.fw_argos_receive(
                self._programs[robot], waiting, len(waiting), now_ns // 1000
            )
            self._waiting[robot] = waiting[took:]

    def _transmit(self, robot: int, now_ns: int) -> None:
        count = lib.fw_argos_transmit(
            self._programs[robot], self._bytes, lib.FW_LINE_CAPACITY, now_ns // 1000
        )
        if not count:
            return
        self._handed_ns[robot] = now_ns
        try:
            written = os.write(self._ends[robot][0], ffi.buffer(self._bytes, count))
        except BlockingIOError:
            written = 0
        self._sent_bytes += written
        self._lost_bytes += count - written

    def _plan(self, now_ns: int) -> None:
        """Forgets who has become idle and sets when there is something to do again."""
        soonest_us = _NEVER_US
        for robot in list(self._busy):
            due_us = lib.fw_argos_due_us(self._programs[robot])
            soonest_us = min(soonest_us, due_us)
            if due_us == _NEVER_US and not self._waiting[robot]:
                self._busy.remove(robot)
        self.due_ns = min(soonest_us * 1000, now_ns + _FIFO_NS) if self._busy else None


class ActuationLog:
    """Writes every applied actuator frame to a file of `ACTUATION` records."""

    def __init__(self, path: Path) -> None:
        """Starts an empty log.

        Raises:
            LabError: the file cannot be written.
        """
        self._path = path
        self._pending = bytearray()
        self.flush(new=True)

    def append(self, actuation: Actuation) -> None:
        """Adds one record; `flush` brings it to the file."""
        self._pending += _RECORD.pack(*actuation)

    def flush(self, new: bool = False) -> None:
        """Brings all records so far to the file; a `new` one loses what it held.

        Raises:
            LabError: the file cannot be written.
        """
        try:
            with open(self._path, "wb" if new else "ab") as file:
                file.write(self._pending)
        except OSError as error:
            raise LabError(f"{self._path}: {error.strerror}") from None
        self._pending.clear()


def read_actuations(path: Path) -> NDArray[np.void]:
    """Reads an actuation log: (n,) `ACTUATION`; a last record cut short is left out.

    Raises:
        LabError: the file cannot be read.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise LabError(f"{path}: {error.strerror}") from None
    return np.frombuffer(content, dtype=ACTUATION, count=len(content) // ACTUATION.itemsize)


def _raw_terminal() -> tuple[int, int]:
    """A new pseudo-terminal that changes no byte: its master, which never blocks, and slave."""
    master, slave = os.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    return master, slave


def _applied(program: Any, robot: int) -> Actuation:
    outputs = program.outputs
    return Actuation(
        program.applied_us * 1000,
        robot,
        outputs.left_steps_s,
        outputs.right_steps_s,
        outputs.leds,
    )
