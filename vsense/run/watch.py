"""The thread that watches the arena, and the double buffer in which its newest state waits."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from vsense.base.arena import ArenaState, Frame
from vsense.base.errors import GrabberError
from vsense.base.native import kernel_ffi, kernels

WATCH_TIMEOUT_S = 2.0
"""Cameras that deliver nothing for this long have failed."""


class NoArenaState(GrabberError):
    """No arena state came in time; nothing has failed, and the next one may still come."""


@dataclass(frozen=True, slots=True)
class Silence:
    """A time in the run without an arena state, in which the robots stood still.

    `run_timestep` is the last timestep before it.
    """

    run_timestep: int
    duration_s: float


class ArenaSource(Protocol):
    """Where the arena states come from: cameras of our own, or another tracker's link."""

    def next(self, timeout_s: float) -> tuple[ArenaState, Sequence[Frame]]:
        """Waits for the newest arena state; gives it with its pictures, if they are here.

        See `vsense.vision.cameras.grabber.Grabber.next` for how long these are valid. VsenseError
        if no state came in time, or there will be no more.
        """

    def start(self) -> None:
        """The robots are about to start; any thread."""

    def stop(self) -> None:
        """The robots have stopped; any thread."""

    def check_cameras(self) -> None:
        """Looks after cameras of our own, when a timestep's work is done; any thread."""


class Stamped(NamedTuple):
    """What a slot of the double buffer holds.

    Attributes:
        frames: the pictures that the state was made from, if they are here.
        ready_ns: when the last of them was in memory.
        done_ns: when the state was written.
        sequence: its number, from 1; gaps are states that were not read.
    """

    state: ArenaState
    frames: Sequence[Frame]
    ready_ns: int
    done_ns: int
    sequence: int


class ArenaBuffer:
    """The thesis's double buffer between tracking and world: the newest arena state, never torn.

    One thread writes, one reads; neither ever waits for the other. They exchange the number of a
    slot (`c_src/host/vs_latest.h`); state and pictures stay where they are. The side that gets a
    slot empties it: the reader takes its content out, the writer drops what was not read. Nothing
    else refers to them here, so lent pictures go back when the reader drops what it took.
    """

    def __init__(self) -> None:
        self._exchange = kernel_ffi.new("struct vs_latest *")
        kernels.vs_latest_init(self._exchange)
        self._slots: list[Stamped | None] = [None] * kernels.VS_LATEST_SLOTS
        self._sequence = 0

    def write(
        self, state: ArenaState, frames: Sequence[Frame], ready_ns: int, done_ns: int
    ) -> None:
        """Makes a state the newest; the writing thread only. See `Stamped` for the arguments."""
        self._sequence += 1
        stamped = Stamped(state, frames, ready_ns, done_ns, self._sequence)
        self._slots[kernels.vs_latest_write_slot(self._exchange)] = stamped
        kernels.vs_latest_write_commit(self._exchange)
        self._slots[kernels.vs_latest_write_slot(self._exchange)] = None

    def read(self) -> Stamped | None:
        """Takes the newest state out, None if it was read before; the reading thread only."""
        slot: int = kernels.vs_latest_read(self._exchange)
        if slot < 0:
            return None
        stamped, self._slots[slot] = self._slots[slot], None
        return stamped


class Watch:
    """The thread that watches the arena: the newest arena state goes into the buffer."""

    def __init__(self, source: ArenaSource, clock: Callable[[], int]) -> None:
        self._source = source
        self._clock = clock
        self._buffer = ArenaBuffer()
        self._news = threading.Event()
        self._ending = threading.Event()
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="vsense-watch", daemon=True)

    def start(self) -> None:
        """Starts the thread."""
        self._thread.start()

    def close(self) -> None:
        """Ends the thread; it may take until the next arena state comes."""
        self._ending.set()
        self._thread.join(2 * WATCH_TIMEOUT_S)

    def next(self, timeout_s: float) -> Stamped:
        """Waits for an arena state that was not given yet, and gives the newest.

        Raises:
            NoArenaState: nothing came in time.
            VsenseError: the cameras, the tracker, or the link to it, have failed.
        """
        while True:
            if not self._news.wait(timeout_s):
                raise NoArenaState(f"no arena state in {timeout_s:g} s")
            # A failure is for every caller: the thread has ended.
            if self._failure is not None:
                raise self._failure
            self._news.clear()
            newest = self._buffer.read()
            # None is news of a state that was given already: it came between clear and read.
            if newest is not None:
                return newest

    def _run(self) -> None:
        """The thread. A failure is kept for the callers of `next`."""
        try:
            while not self._ending.is_set():
                state, frames = self._source.next(WATCH_TIMEOUT_S)
                done_ns = self._clock()
                ready_ns = max((frame.ready_ns for frame in frames), default=done_ns)
                self._buffer.write(state, frames, ready_ns, done_ns)
                # Only the buffer keeps them now: lent pictures go back while the source waits.
                del state, frames
                self._news.set()
        except BaseException as failure:
            self._failure = failure
            self._news.set()
