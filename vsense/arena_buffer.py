"""The thesis's double buffer between tracking and world: the newest arena state, never torn.

One thread writes arena states, another reads the newest; neither ever waits for the other
(`c_src/vs_latest.h`). A reader that was slow finds the newest state and sees from the sequence
how many it has missed.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np

from vsense.arena import POSE, ArenaState
from vsense.native import check, ffi, lib

_HEAD = struct.Struct("<qqqqqq")


class Stamped(NamedTuple):
    """An arena state as it lay in the buffer.

    Attributes:
        state: the arena state.
        done_ns: when it was written, as the writer said.
        sequence: its number, from 1; gaps are states that nobody read.
    """

    state: ArenaState
    done_ns: int
    sequence: int


class ArenaBuffer:
    """The newest arena state, for one writing and one reading thread."""

    def __init__(self, robots: int) -> None:
        """Makes an empty buffer.

        Args:
            robots: most robots that a state can hold.
        """
        # Every robot may be listed and its tag be a duplicate.
        size = _HEAD.size + robots * (POSE.itemsize + 4)
        self._memory = ffi.new("uint8_t[]", lib.VS_LATEST_SLOTS * size)
        self._buffer = ffi.new("struct vs_latest *")
        self._stamp = ffi.new("struct vs_latest_stamp *")
        self._size = size
        lib.vs_latest_init(self._buffer, self._memory, size)

    def write(self, state: ArenaState, done_ns: int) -> None:
        """Makes a state the newest; the writing thread only.

        Raises:
            WireError: it holds more robots than the buffer was made for.
        """
        robots = np.ascontiguousarray(state.robots, POSE)
        duplicates = np.array(state.duplicates, "<u4")
        numbers = (state.timestep, done_ns, state.detected, state.unnamed, len(robots))
        data = _HEAD.pack(*numbers, len(duplicates)) + robots.tobytes() + duplicates.tobytes()
        slot = lib.vs_latest_write_begin(self._buffer)
        if len(data) <= self._size:
            ffi.memmove(slot, data, len(data))
        check(lib.vs_latest_write_commit(self._buffer, len(data), state.capture_ns))

    def read(self) -> Stamped | None:
        """Gives the newest state, None before the first; the reading thread only."""
        slot = lib.vs_latest_read(self._buffer, self._stamp)
        if slot == ffi.NULL:
            return None
        data = bytes(ffi.buffer(slot, self._stamp.size))
        timestep, done_ns, detected, unnamed, robots, duplicates = _HEAD.unpack_from(data)
        poses = np.frombuffer(data, POSE, robots, _HEAD.size)
        tags = np.frombuffer(data, "<u4", duplicates, _HEAD.size + poses.nbytes)
        state = ArenaState(
            timestep=timestep,
            capture_ns=int(self._stamp.capture_ns),
            robots=poses,
            detected=detected,
            unnamed=unnamed,
            duplicates=tuple(tags.tolist()),
        )
        return Stamped(state, done_ns, int(self._stamp.sequence))
