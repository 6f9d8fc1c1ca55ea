"""The thesis's double buffer between tracking and world: the newest arena state, never torn.

One thread writes arena states, another reads the newest; neither ever waits for the other
(`c_src/vs_latest.h`). A reader that was slow finds the newest state and sees from the sequence
how many it has missed.

The thread that watches the arena: the newest arena state waits in the buffer.
"""

from __future__ import annotations

import struct
import threading
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from vsense.arena import IMAGE_POSE, POSE, SIGHTING, ArenaState, Frame
from vsense.cameras.grabber import GrabberError
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


WATCH_TIMEOUT_S = 2.0
"""Cameras that deliver nothing for this long have failed."""

MOST_TAGS = 1024


class NoArenaState(GrabberError):
    """No arena state came in time; nothing has failed, and the next one may still come."""


class ArenaSource(Protocol):
    """Where the arena states come from: cameras of our own, or another tracker's link."""

    def next(self, timeout_s: float) -> tuple[ArenaState, Sequence[Frame]]:
        """Waits for the newest arena state.

        Returns:
            The state, and the pictures that it was made from, if they are here.

        Raises:
            VsenseError: no state came in time, or there will be no more.
        """

    def start_run(self) -> None:
        """The robots are about to start; any thread."""

    def stop_run(self) -> None:
        """The robots have stopped; any thread."""


class Watch:
    """The thread that watches the arena: the newest arena state goes into the buffer."""

    def __init__(self, source: ArenaSource, clock: Callable[[], int]) -> None:
        self._source = source
        self._clock = clock
        self._buffer = ArenaBuffer(MOST_TAGS)
        self._news = threading.Event()
        self._ending = threading.Event()
        self._failure: BaseException | None = None
        self._frames: dict[int, Sequence[Frame]] = {}
        self._given = 0
        self._thread = threading.Thread(target=self._run, name="vsense-watch", daemon=True)

    def start(self) -> None:
        """Starts the thread."""
        self._thread.start()

    def close(self) -> None:
        """Ends the thread; it may take until the next arena state comes."""
        self._ending.set()
        self._thread.join(2 * WATCH_TIMEOUT_S)

    def next(self, timeout_s: float) -> tuple[Stamped, Sequence[Frame]]:
        """Waits for an arena state that was not given yet, and gives the newest.

        Returns:
            The state with its times, and the pictures that it was made from.

        Raises:
            NoArenaState: nothing came in time.
            VsenseError: the cameras, the tracker, or the link to it, have failed.
        """
        while True:
            if not self._news.wait(timeout_s):
                raise NoArenaState(f"no arena state in {timeout_s:g} s")
            # A failure is for every caller: the thread is no more.
            if self._failure is not None:
                raise self._failure
            self._news.clear()
            newest = self._buffer.read()
            # News of a state that was given already: it came between clear and read.
            if newest is not None and newest.sequence > self._given:
                self._given = newest.sequence
                return newest, self._frames.get(newest.state.timestep, ())

    def _run(self) -> None:
        """The thread. A failure is kept for whoever waits for the next state."""
        try:
            while not self._ending.is_set():
                state, frames = self._source.next(WATCH_TIMEOUT_S)
                done_ns = self._clock()
                ready_ns = max((frame.ready_ns for frame in frames), default=done_ns)
                # Replaced whole, with the set before it: the reader may still ask for that one.
                before = list(self._frames.items())[-1:]
                self._frames = dict([*before, (state.timestep, frames)])
                self._buffer.write(state, ready_ns, done_ns)
                self._news.set()
        except BaseException as failure:
            self._failure = failure
            self._news.set()
