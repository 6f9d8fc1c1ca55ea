"""The arena tracking client: arena states from a tracker that speaks the original protocol.

Thesis, 3.3.1. `ArenaDialog` says what to ask and what to believe, without a socket. Before a run it
asks for single states (ONE_SHOT) and waits for those of timestep 0, as the original's client does;
in a run it takes the stream. The client waits nowhere but in `next`, and there in the kernel; a
connection that is lost is made again.
"""

from __future__ import annotations

import contextlib
import errno
import os
import select
import socket
import threading
import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

from vsense.arena import ArenaState, Frame
from vsense.link.robots.network import Waker
from vsense.link.robots.status import LinkError
from vsense.link.trackers.protocol import (
    StateInbox,
    TrackerCommand,
    TrackerReport,
    decode_state,
    encode_command,
)
from vsense.link.trackers.repair import Repair, RepairCounters

PERIOD_NS = 100_000_000
"""Between two ONE_SHOTs: the original's timestep."""
JUMP_MAX = 100_000
"""Timesteps that a tracker can have left out."""


@dataclass(slots=True)
class DialogCounters:
    """What came so far.

    Attributes:
        states: arena states taken.
        skipped: of these, not given out because a newer one was there already.
        ignored: states that do not belong to the present mode: of a run that is over, or
            repeated.
    """

    states: int = 0
    skipped: int = 0
    ignored: int = 0


class ArenaDialog:
    """What is said on one connection after another.

    Args:
        tags: the tags of the experiment.
        latency_ns: from the middle of an exposure to the arrival of its state.
        origin_m: where the arena's origin lies in the tracker's frame.

    Attributes:
        running: whether the tracker shall be in a run; set by the user.
        over: the tracker has ended the run; cleared by the user.
        counters: what came so far.
        repair: makes arena states of reports.
    """

    def __init__(
        self, tags: Collection[int], latency_ns: int, origin_m: tuple[float, float] = (0.0, 0.0)
    ) -> None:
        self.running = False
        self.over = False
        self.counters = DialogCounters()
        self.repair = Repair(tags)
        self._latency_ns = latency_ns
        self._origin_m = origin_m
        self._timestep = -1
        self._capture_ns = 0
        self.connected(0)

    def connected(self, now_ns: int) -> None:
        """Begins again: nothing has been said on this connection yet."""
        self._inbox = StateInbox()
        self._streaming = False
        self._asked = False
        self._theirs: int | None = None
        self._due_ns = now_ns

    @property
    def due_ns(self) -> int | None:
        """When there is something to ask; None: it is the tracker's turn."""
        return None if self._streaming or self._asked else self._due_ns

    def command(self, now_ns: int) -> TrackerCommand | None:
        """Gives what the tracker has to be told now."""
        if self._streaming != self.running:
            self._streaming, self._asked, self._theirs = self.running, False, None
            self._due_ns = now_ns
            return (
                TrackerCommand.START_EXPERIMENT if self.running else TrackerCommand.STOP_EXPERIMENT
            )
        if self._streaming or self._asked or now_ns < self._due_ns:
            return None
        self._asked, self._due_ns = True, now_ns + PERIOD_NS
        return TrackerCommand.ONE_SHOT

    def receive(self, data: bytes, now_ns: int) -> ArenaState | None:
        """Takes bytes of the tracker in; gives the newest arena state in them.

        Raises:
            LinkError: the tracker does not speak the protocol; the connection is lost.
        """
        newest = None
        for body in self._inbox.feed(data):
            state = self._receive(body, now_ns)
            self.counters.skipped += newest is not None and state is not None
            newest = state or newest
        return newest

    def _receive(self, body: bytes, now_ns: int) -> ArenaState | None:
        """Makes an arena state of a message, if it belongs to what was asked for."""
        self._asked = False
        if not body:
            # Length 0: the tracker has ended the run, unless we have done so already.
            if self._streaming:
                self.running, self._streaming, self.over = False, False, True
            return None
        theirs, reports = decode_state(body)
        if theirs == self._theirs or (theirs != 0) != self._streaming:
            self.counters.ignored += 1
            return None
        return self._state(self._step(theirs, now_ns), reports, now_ns)

    def _step(self, theirs: int, now_ns: int) -> int:
        """How many timesteps have passed since the last state."""
        if not self._streaming:
            return 1
        known, self._theirs = self._theirs, theirs
        if known is None or theirs < known:
            # A new run counts from 0: only the clock knows.
            return max(1, round((now_ns - self._capture_ns) / PERIOD_NS))
        if theirs - known > JUMP_MAX:
            raise LinkError(f"an arena state of timestep {theirs} after {known}")
        return theirs - known

    def _state(self, step: int, reports: Sequence[TrackerReport], now_ns: int) -> ArenaState:
        self._timestep += step
        self._capture_ns = max(self._capture_ns, now_ns - self._latency_ns)
        self.counters.states += 1
        x_m, y_m = self._origin_m
        ours = [replace(r, x_m=r.x_m - x_m, y_m=r.y_m - y_m) for r in reports]
        return self.repair.update(ours, self._timestep, self._capture_ns)


RETRY_NS = 500_000_000
"""Between two attempts to connect."""

_CHUNK = 65_536


class TrackerEnded(LinkError):
    """The tracker has ended its run."""


class ArenaClient:
    """A source of arena states, which connects in `next`; that is for one thread, the rest for any.

    Args:
        host: name or address of the tracker.
        port: its port.
        tags: the tags of the experiment.
        tell: takes a line for a person; must not wait.
        latency_ns: from the middle of an exposure to the arrival of its state. The protocol
            says nothing of it, so it has to be measured and given.
        origin_m: where the arena's origin lies in the tracker's frame.
        clock: the host's monotonic clock [ns].

    Attributes:
        name: host and port of the tracker.
        connections: how often it was connected to; reconnects are one less.

    Raises:
        LinkError: the host is not known.
    """

    def __init__(
        self,
        host: str,
        port: int,
        tags: Collection[int],
        tell: Callable[[str], None],
        latency_ns: int = 0,
        origin_m: tuple[float, float] = (0.0, 0.0),
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.name = f"{host}:{port}"
        self._family, self._address = _find(host, port)
        self.connections = 0
        self._dialog = ArenaDialog(tags, latency_ns, origin_m)
        self._tell = tell
        self._clock = clock
        self._busy = threading.Lock()
        self._closed = False
        self._sock: socket.socket | None = None
        self._connected = False
        self._dial_ns = 0
        self._lost_told = False
        self._waker = Waker()

    @property
    def counters(self) -> DialogCounters:
        """What came so far."""
        return self._dialog.counters

    @property
    def repairs(self) -> RepairCounters:
        """What was wrong with it."""
        return self._dialog.repair.counters

    def start(self) -> None:
        """Has the tracker begin a run."""
        self._dialog.running = True
        self._waker.wake()

    def stop(self) -> None:
        """Has the tracker end its run."""
        self._dialog.running = False
        self._waker.wake()

    def next(self, timeout_s: float) -> tuple[ArenaState, Sequence[Frame]]:
        """Waits for the newest arena state; connects again where the connection is lost.

        Its timestep is greater than all before, and there are no pictures.

        Raises:
            TrackerEnded: the tracker has ended the run.
            LinkError: no state came in time, or `close` was called.
        """
        with self._busy:
            deadline_ns = self._clock() + round(timeout_s * 1e9)
            while not self._closed:
                if self._dialog.over:
                    self._dialog.over = False
                    raise TrackerEnded(f"tracker {self.name}: it has ended the run")
                now_ns = self._clock()
                if now_ns >= deadline_ns:
                    self._lose(f"gave nothing for {timeout_s:g} s")
                    raise LinkError(f"tracker {self.name}: no arena state in {timeout_s:g} s")
                state = self._wait(min(self._act(now_ns), deadline_ns))
                if state is not None:
                    return state, ()
        raise LinkError(f"tracker {self.name}: the link is closed")

    def close(self) -> None:
        """Ends a `next` that waits, and the connection; can be called again."""
        self._closed = True
        self._waker.wake()
        with self._busy:
            self._hang_up()
            self._waker.close()

    def _act(self, now_ns: int) -> int:
        """Connects, or asks, whatever is due; gives the time when something will be."""
        if self._sock is None and now_ns >= self._dial_ns:
            self._dial(now_ns)
        if self._connected:
            command = self._dialog.command(now_ns)
            if command is not None:
                self._send(command)
        due_ns = self._dialog.due_ns if self._connected else None
        if self._sock is None:
            due_ns = self._dial_ns
        return now_ns + RETRY_NS if due_ns is None else due_ns

    def _dial(self, now_ns: int) -> None:
        sock = socket.socket(self._family, socket.SOCK_STREAM)
        sock.setblocking(False)
        with contextlib.suppress(OSError):
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._sock, self._connected = sock, False
        code = sock.connect_ex(self._address)
        if code not in (0, errno.EINPROGRESS):
            self._lose(f"cannot be reached: {os.strerror(code)}")

    def _send(self, command: TrackerCommand) -> None:
        assert self._sock is not None
        try:
            # Four bytes always fit: the tracker has read the command before.
            self._sock.send(encode_command(command))
        except OSError as error:
            self._lose(f"is gone: {error.strerror}")

    def _wait(self, until_ns: int) -> ArenaState | None:
        """Waits for the socket, `_waker` or the time; gives the newest state that came."""
        poll = select.poll()
        poll.register(self._waker, select.POLLIN)
        if self._sock is not None:
            poll.register(self._sock, select.POLLIN if self._connected else select.POLLOUT)
        left_ns = max(until_ns - self._clock(), 0)
        ready = {descriptor for descriptor, _ in poll.poll(-(-left_ns // 1_000_000))}
        if self._waker.fileno() in ready:
            self._waker.drain()
        if self._sock is None or self._sock.fileno() not in ready:
            return None
        if self._connected:
            return self._read(self._sock)
        self._arrive(self._sock)
        return None

    def _arrive(self, sock: socket.socket) -> None:
        """The connection was made, or was refused."""
        code = sock.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if code:
            self._lose(f"cannot be reached: {os.strerror(code)}")
            return
        self._connected, self._lost_told = True, False
        self._dialog.connected(self._clock())
        self.connections += 1
        self._tell(f"tracker {self.name}: connected")

    def _read(self, sock: socket.socket) -> ArenaState | None:
        """Takes what has come; gives the newest state in it."""
        try:
            data = sock.recv(_CHUNK)
            if data:
                return self._dialog.receive(data, self._clock())
            self._lose("has closed the connection")
        except (BlockingIOError, InterruptedError):
            return None
        except OSError as error:
            self._lose(f"is gone: {error.strerror}")
        except LinkError as error:
            self._lose(f"does not speak the protocol: {error}")
        return None

    def _lose(self, reason: str) -> None:
        """Lets the connection go; says so once until there is a new one."""
        self._hang_up()
        self._dial_ns = self._clock() + RETRY_NS
        if not self._lost_told:
            self._lost_told = True
            self._tell(f"tracker {self.name}: {reason}; trying again every {RETRY_NS / 1e9:g} s")

    def _hang_up(self) -> None:
        sock, self._sock = self._sock, None
        self._connected = False
        if sock is not None:
            sock.close()


def _find(host: str, port: int) -> tuple[socket.AddressFamily, tuple[Any, ...]]:
    """The first address of a host.

    Raises:
        LinkError: the host is not known.
    """
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as error:
        text = getattr(error, "strerror", None) or "not a host name"
        raise LinkError(f"tracker {host}:{port}: {text}") from error
    return found[0][0], found[0][4]
