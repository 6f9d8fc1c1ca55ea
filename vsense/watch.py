"""The thread that watches the arena: the newest arena state waits in the buffer."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Protocol

from vsense.arena import ArenaState, Frame
from vsense.arena_buffer import ArenaBuffer, Stamped
from vsense.tracking.grabbers import GrabberError

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
