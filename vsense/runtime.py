"""The runtime: every timestep of the host, from the pictures to the datagrams.

Two threads, as in the thesis: one watches the arena (grabber and tracker, or the link to another
tracker), the other lives in the world (world, virtual sensors, server); between them lies the
latest-value buffer, so a slow world never holds the cameras up. Nothing of the host but this
module, the links and the lab reads a clock: every other box is told the time.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from vsense.arena import ArenaState, Frame
from vsense.arena_buffer import ArenaBuffer, Stamped
from vsense.environment import Environment
from vsense.link.server import VirtualSensorServer
from vsense.link.wire import Values, Wanted
from vsense.tracking.grabbers import Grabber, GrabberError

START_LEAD = 3
"""START names a timestep this many ahead, so that one lost datagram delays no robot."""

WATCH_TIMEOUT_S = 2.0
"""Cameras that deliver nothing for this long have failed."""

MOST_TAGS = 1024


class NoArenaState(GrabberError):
    """No arena state came in time; nothing has failed, and the next one may still come."""


class Tracker(Protocol):
    """What turns pictures into the arena state."""

    def update(self, frames: Sequence[Frame]) -> ArenaState:
        """Finds and follows the robots in one timestep's pictures."""


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


class Pictures:
    """The source with cameras of our own."""

    def __init__(self, grabber: Grabber, tracker: Tracker) -> None:
        """Takes both, without owning them."""
        self._grabber = grabber
        self._tracker = tracker

    def next(self, timeout_s: float) -> tuple[ArenaState, Sequence[Frame]]:
        """Waits for pictures and tracks the robots in them.

        Raises:
            GrabberError: no picture came in time.
            VsenseError: the tracker has failed.
        """
        frames = self._grabber.next(timeout_s)
        return self._tracker.update(frames), frames

    def start_run(self) -> None:
        """Cameras are watched in a run and out of it."""

    def stop_run(self) -> None:
        """See `start_run`."""


@dataclass(frozen=True, slots=True)
class Step:
    """One timestep as the host lived it; times are the host's monotonic clock in ns.

    Attributes:
        timestep: the cameras' trigger number.
        run_timestep: timestep of the run, from 0; -1 before it.
        capture_ns: middle of the exposure.
        ready_ns: the last picture was in memory.
        arena_ns: the arena state was done.
        sent_ns: the last robot's datagram had left.
        state: the arena state.
        frames: the pictures; valid until the grabber needs their memory again.
    """

    timestep: int
    run_timestep: int
    capture_ns: int
    ready_ns: int
    arena_ns: int
    sent_ns: int
    state: ArenaState
    frames: Sequence[Frame]

    def without_frames(self) -> Step:
        """The same, without holding on to the pictures."""
        return replace(self, frames=())


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
            self._news.clear()
            if self._failure is not None:
                raise self._failure
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


class Runtime:
    """Calls every box of the host in order.

    The world updates, senses and sends in the same timestep in which the arena state arrived.

    Attributes:
        readings: what every robot was sent last, by tag: (value, capture time) per sensor.
    """

    def __init__(
        self,
        source: ArenaSource,
        environment: Environment,
        server: VirtualSensorServer,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._source = source
        self._watch = Watch(source, clock)
        self._environment = environment
        self._server = server
        self.readings: Mapping[int, Values] = {}
        self._last_timestep = -1
        self._first_timestep: int | None = None

    def open(self) -> None:
        """Begins to watch the arena."""
        self._watch.start()

    def close(self) -> None:
        """Ends the watch."""
        self._watch.close()

    def start(self) -> int:
        """Starts all robots together a few timesteps from now.

        Returns:
            The timestep that is the run's first.
        """
        self._source.start_run()
        self._first_timestep = self._last_timestep + START_LEAD
        self._server.command(Wanted.RUN, self._first_timestep)
        return self._first_timestep

    def stop(self) -> None:
        """Stops all robots at once."""
        self._server.command(Wanted.STOP)
        self._source.stop_run()

    def step(self, timeout_s: float = 2 * WATCH_TIMEOUT_S) -> Step:
        """Lives one timestep: waits for its arena state and has the readings sent.

        Raises:
            NoArenaState: none came in time.
            VsenseError: a box of the host has failed.
        """
        newest, frames = self._watch.next(timeout_s)
        state = newest.state
        self._last_timestep = state.timestep
        run_timestep = self._run_timestep(state.timestep)
        reports = self._server.reports()
        payloads = {tag: report.payload for tag, report in reports.items()}
        senders = {tag: report.uid for tag, report in reports.items()}
        self.readings = self._environment.step(state, run_timestep, payloads, senders)
        sent_ns = self._server.publish(state.timestep, state.capture_ns, self.readings)
        return Step(
            timestep=state.timestep,
            run_timestep=run_timestep,
            capture_ns=state.capture_ns,
            ready_ns=newest.ready_ns,
            arena_ns=newest.done_ns,
            sent_ns=sent_ns,
            state=state,
            frames=frames,
        )

    def _run_timestep(self, timestep: int) -> int:
        if self._first_timestep is None or timestep < self._first_timestep:
            return -1
        return timestep - self._first_timestep
