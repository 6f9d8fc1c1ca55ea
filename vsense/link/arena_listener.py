"""The receiving end of the JSON-lines link (`arena_lines`): any other tracker as a source.

It never waits anywhere but in `next`, and there in the kernel; it needs no thread of its own.
"""

from __future__ import annotations

import contextlib
import json
import select
import socket
import threading
import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

from vsense.arena import ArenaState, Frame
from vsense.link.arena_lines import LINE_MAX, ClockMap, LineInbox, parse
from vsense.link.arena_repair import Repair
from vsense.link.ports import listen
from vsense.link.status import LinkError

SILENCE_NS = 1_000_000_000
"""A tracker that writes nothing for this long has to make room for another."""
TOLD_MAX = 3
"""Bad lines of one connection that a person is told of; the tracker is told of all."""

_JUMP_MAX = 100_000
_CHUNK = 65_536


@dataclass(slots=True)
class ListenerCounters:
    """What happened on the link so far.

    Attributes:
        states: arena states taken.
        skipped: of these, not given out because a newer one was there already.
        bad_lines: lines that were none.
        connections: trackers that were listened to.
        refused: trackers that were sent away because another one was writing.
    """

    states: int = 0
    skipped: int = 0
    bad_lines: int = 0
    connections: int = 0
    refused: int = 0


class _Tracker:
    """The tracker that is being listened to."""

    def __init__(self, sock: socket.socket, origin: str, now_ns: int) -> None:
        self.sock = sock
        self.origin = origin
        self.heard_ns = now_ns
        self.inbox = LineInbox()
        self.clock = ClockMap()
        self.timestep: int | None = None
        self.told = 0


class ArenaListener:
    """A source of arena states; `next` belongs to one thread, `close` to any."""

    def __init__(
        self,
        host: str,
        port: int,
        tags: Collection[int],
        tell: Callable[[str], None],
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """Takes the port.

        Args:
            host: name or address of the interface to listen on.
            port: its number; 0 takes any that is free.
            tags: the tags of the experiment.
            tell: takes a line for a person; must not wait.
            clock: the host's monotonic clock [ns].

        Raises:
            LinkError: the host is unknown, or the port is taken.
        """
        self._listener, self.port = listen(host, port)
        self.counters = ListenerCounters()
        self.repair = Repair(tags)
        self._tell = tell
        self._clock = clock
        self._busy = threading.Lock()
        self._closed = False
        self._tracker: _Tracker | None = None
        self._timestep = -1
        self._capture_ns = 0
        self._wake_in, self._wake_out = socket.socketpair()
        self._wake_out.setblocking(False)

    def start_run(self) -> None:
        """The link has no runs: a tracker writes as long as it is connected."""

    def stop_run(self) -> None:
        """See `start_run`."""

    def next(self, timeout_s: float) -> tuple[ArenaState, Sequence[Frame]]:
        """Waits for the newest arena state.

        Returns:
            The state, with a timestep greater than all before, and no pictures.

        Raises:
            LinkError: no state came in time, or `close` was called.
        """
        with self._busy:
            deadline_ns = self._clock() + round(timeout_s * 1e9)
            while not self._closed:
                left_ns = deadline_ns - self._clock()
                if left_ns <= 0:
                    who = self._tracker.origin if self._tracker else f"port {self.port}"
                    raise LinkError(f"tracker on {who}: no arena state in {timeout_s:g} s")
                state = self._wait(left_ns)
                if state is not None:
                    return state, ()
        raise LinkError(f"tracker on port {self.port}: the link is closed")

    def close(self) -> None:
        """Ends a `next` that waits, and the connection; can be called again."""
        self._closed = True
        with contextlib.suppress(OSError):
            self._wake_out.send(b"\0")
        with self._busy:
            self._let_go("")
            for sock in (self._listener, self._wake_in, self._wake_out):
                sock.close()

    def _wait(self, left_ns: int) -> ArenaState | None:
        """Waits for a socket and does what is due; gives the newest state that came."""
        poll = select.poll()
        tracker = self._tracker
        for sock in (self._wake_in, self._listener, *([tracker.sock] if tracker else [])):
            poll.register(sock, select.POLLIN)
        ready = {descriptor for descriptor, _ in poll.poll(-(-left_ns // 1_000_000))}
        state = None
        if tracker is not None and tracker.sock.fileno() in ready:
            state = self._read(tracker)
        if self._listener.fileno() in ready:
            self._accept()
        return state

    def _accept(self) -> None:
        try:
            sock, address = self._listener.accept()
        except OSError:
            return
        sock.setblocking(False)
        origin, now_ns = str(address[0]), self._clock()
        if self._tracker is not None and now_ns - self._tracker.heard_ns < SILENCE_NS:
            self.counters.refused += 1
            _answer(sock, {"error": f"a tracker on {self._tracker.origin} is writing already"})
            sock.close()
            self._tell(f"tracker on {origin}: refused, one on {self._tracker.origin} is writing")
            return
        self._let_go("has fallen silent, another one takes over")
        self._tracker = _Tracker(sock, origin, now_ns)
        self.counters.connections += 1
        self._tell(f"tracker on {origin}: connected")

    def _read(self, tracker: _Tracker) -> ArenaState | None:
        """Takes all that has come and gives the newest state."""
        try:
            data = tracker.sock.recv(_CHUNK)
        except (BlockingIOError, InterruptedError):
            return None
        except OSError as error:
            self._let_go(f"is gone: {error.strerror}")
            return None
        if not data:
            self._let_go("has closed the connection")
            return None
        tracker.heard_ns = self._clock()
        newest = None
        for number, text in tracker.inbox.feed(data):
            try:
                state = self._take(tracker, text)
            except LinkError as error:
                self._complain(tracker, number, str(error))
                continue
            self.counters.skipped += newest is not None and state is not None
            newest = state or newest
        return newest

    def _take(self, tracker: _Tracker, text: bytes | None) -> ArenaState | None:
        """Makes an arena state of a line; None of an empty one."""
        if text is None:
            raise LinkError(f"longer than {LINE_MAX} bytes")
        if not text.strip():
            return None
        line = parse(text)
        step = 1 if tracker.timestep is None else line.timestep - tracker.timestep
        if not 1 <= step <= _JUMP_MAX:
            raise LinkError(f"timestep is {line.timestep} after {tracker.timestep}, expected more")
        tracker.timestep = line.timestep
        self._timestep += step
        # A line that was quicker than all before moves the clock, but never time back.
        mapped_ns = tracker.clock.host_ns(line, tracker.heard_ns)
        self._capture_ns = max(self._capture_ns, mapped_ns)
        self.counters.states += 1
        return self.repair.update(line.robots, self._timestep, self._capture_ns)

    def _complain(self, tracker: _Tracker, number: int, error: str) -> None:
        self.counters.bad_lines += 1
        tracker.told += 1
        _answer(tracker.sock, {"line": number, "error": error})
        if tracker.told <= TOLD_MAX:
            more = " (more of this is only counted)" if tracker.told == TOLD_MAX else ""
            self._tell(f"tracker on {tracker.origin}: line {number}: {error}{more}")

    def _let_go(self, reason: str) -> None:
        tracker, self._tracker = self._tracker, None
        if tracker is not None:
            tracker.sock.close()
            if reason:
                self._tell(f"tracker on {tracker.origin} {reason}")


def _answer(sock: socket.socket, values: dict[str, object]) -> None:
    """Writes one line, if the tracker reads; one that does not read misses it."""
    with contextlib.suppress(OSError):
        sock.send(json.dumps(values).encode() + b"\n")
