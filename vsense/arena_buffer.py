"""The thesis's double buffer between tracking and world: the newest arena state, never torn.

One thread writes arena states, another reads the newest; neither ever waits for the other
(`c_src/vs_latest.h`). A reader that was slow finds the newest state and sees from the sequence
how many it has missed.
"""

from __future__ import annotations

import struct
from typing import Any, NamedTuple

import numpy as np

from vsense.arena import IMAGE_POSE, POSE, SIGHTING, ArenaState
from vsense.native import check, ffi, lib

_HEAD = struct.Struct("<qqqqq")
_TAG = np.dtype("<u4")
_NAMES = np.dtype("u1")
_LISTS: tuple[Any, ...] = (POSE, _TAG, SIGHTING, _TAG, _NAMES, IMAGE_POSE)
_SIGHTINGS_PER_ROBOT = 4
"""A tag may be read at several places at once, and seen by several cameras."""
_NAMES_MAX = 4096
"""Bytes of all cameras' ids."""


class Stamped(NamedTuple):
    """An arena state as it lay in the buffer.

    Attributes:
        state: the arena state.
        ready_ns: when the last picture that it was made from was in memory.
        done_ns: when it was written, as the writer said.
        sequence: its number, from 1; gaps are states that nobody read.
    """

    state: ArenaState
    ready_ns: int
    done_ns: int
    sequence: int


class ArenaBuffer:
    """The newest arena state, for one writing and one reading thread."""

    def __init__(self, robots: int) -> None:
        """Makes an empty buffer.

        Args:
            robots: most robots that a state can hold.
        """
        places = SIGHTING.itemsize + IMAGE_POSE.itemsize
        entry = POSE.itemsize + 2 * _TAG.itemsize + _SIGHTINGS_PER_ROBOT * places
        self._size = _HEAD.size + 8 * len(_LISTS) + _NAMES_MAX + robots * entry
        self._memory = ffi.new("uint8_t[]", lib.VS_LATEST_SLOTS * self._size)
        self._buffer = ffi.new("struct vs_latest *")
        self._stamp = ffi.new("struct vs_latest_stamp *")
        lib.vs_latest_init(self._buffer, self._memory, self._size)

    def write(self, state: ArenaState, ready_ns: int, done_ns: int) -> None:
        """Makes a state the newest; the writing thread only.

        Raises:
            WireError: it holds more than the buffer was made for.
        """
        head = (state.timestep, ready_ns, done_ns, state.detected, state.unnamed)
        data = _HEAD.pack(*head)
        names = np.frombuffer("\0".join(state.cameras).encode(), _NAMES)
        lists: tuple[Any, ...] = (
            state.robots,
            state.duplicates,
            state.sightings,
            state.joined,
            names,
            state.images,
        )
        for rows, dtype in zip(lists, _LISTS):
            array = np.asarray(rows, dtype)
            data += struct.pack("<q", len(array)) + array.tobytes()
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
        timestep, ready_ns, done_ns, detected, unnamed = _HEAD.unpack_from(data)
        at = _HEAD.size
        lists: list[Any] = []
        for dtype in _LISTS:
            (count,) = struct.unpack_from("<q", data, at)
            lists.append(np.frombuffer(data, dtype, count, at + 8))
            at += 8 + count * dtype.itemsize
        state = ArenaState(
            timestep=timestep,
            capture_ns=int(self._stamp.capture_ns),
            robots=lists[0],
            detected=detected,
            unnamed=unnamed,
            duplicates=tuple(lists[1].tolist()),
            sightings=lists[2],
            joined=tuple(lists[3].tolist()),
            cameras=tuple(lists[4].tobytes().decode().split("\0")) if len(lists[4]) else (),
            images=lists[5],
        )
        return Stamped(state, ready_ns, done_ns, int(self._stamp.sequence))
