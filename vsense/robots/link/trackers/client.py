"""The arena tracking client: arena states from a tracker that speaks the original protocol.

Thesis, 3.3.1. `ArenaDialog` decides without a socket what to ask and what to believe. Before a run
it asks for single states (ONE_SHOT) and waits for those of timestep 0, as the original's client
does; in a run it takes the stream. A connection that is lost is made again.
"""

from __future__ import annotations

import contextlib
import errno
import os
import socket
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from select import POLLIN, POLLOUT
from typing import Any

from vsense.base.arena import ArenaState
from vsense.base.clock import host_ns
from vsense.robots.link.status import LinkError
from vsense.robots.link.trackers._repair import Repair, StateCounters, TrackerLink
from vsense.robots.link.trackers.protocol import (
    StateInbox,
    TrackerCommand,
    decode_state,
    encode_command,
)

STATE_DT_NS = 100_000_000
"""Between two ONE_SHOTs: the original's timestep."""
JUMP_MAX = 100_000
"""Timesteps that a tracker can have left out."""


@dataclass(slots=True)
class DialogCounters(StateCounters):
    """What came so far; `ignored` states are of a run that is over, or repeated."""

    ignored: int = 0


class ArenaDialog:
    """The protocol on one connection after another.

    Args:
        tags: the tags of the experiment.
        latency_ns: from the middle of an exposure to the arrival of its state.
        origin_m: where the arena's origin lies in the tracker's frame.

    Attributes:
        running: whether the tracker shall be in a run; set by the user.
        over: the tracker has ended the run; cleared by the user.
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
        self.connected(0)

    def connected(self, now_ns: int) -> None:
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
        """Gives the command to send now."""
        if self._streaming != self.running:
            self._streaming, self._asked, self._theirs = self.running, False, None
            self._due_ns = now_ns
            return (
                TrackerCommand.START_EXPERIMENT if self.running else TrackerCommand.STOP_EXPERIMENT
            )
        if self._streaming or self._asked or now_ns < self._due_ns:
            return None
        self._asked, self._due_ns = True, now_ns + STATE_DT_NS
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
        steps = self._steps(theirs, now_ns)
        self.counters.states += 1
        x_m, y_m = self._origin_m
        ours = [replace(r, x_m=r.x_m - x_m, y_m=r.y_m - y_m) for r in reports]
        return self.repair.follow(ours, steps, now_ns - self._latency_ns)

    def _steps(self, theirs: int, now_ns: int) -> int:
        """How many timesteps have passed since the last state."""
        if not self._streaming:
            return 1
        last, self._theirs = self._theirs, theirs
        if last is None or theirs < last:
            # A new run counts from 0: only the clock knows.
            return max(1, round((now_ns - self.repair.capture_ns) / STATE_DT_NS))
        if theirs - last > JUMP_MAX:
            raise LinkError(f"an arena state of timestep {theirs} after {last}")
        return theirs - last


REDIAL_NS = 500_000_000
"""Between two attempts to connect."""

_CHUNK = 65_536


class TrackerEnded(LinkError):
    """The tracker has ended its run."""


class ArenaClient(TrackerLink):
    """A source of arena states, which connects in `next` and counts its `connections`.

    Args:
        host, port: of the tracker.
        tags, latency_ns, origin_m: see `ArenaDialog`. The protocol does not say the latency, so it
            has to be measured and given.
        say, clock: see `TrackerLink`.

    Raises:
        LinkError: the host is not known.
    """

    def __init__(
        self,
        host: str,
        port: int,
        tags: Collection[int],
        say: Callable[[str], None],
        latency_ns: int = 0,
        origin_m: tuple[float, float] = (0.0, 0.0),
        clock: Callable[[], int] = host_ns,
    ) -> None:
        self._family, self._address = _find(host, port)
        super().__init__(f"{host}:{port}", say, clock)
        self.connections = 0
        self._dialog = ArenaDialog(tags, latency_ns, origin_m)
        self.expect = self._dialog.repair.expect
        self.counters, self.repairs = self._dialog.counters, self._dialog.repair.counters
        self._sock: socket.socket | None = None
        self._connected = False
        self._dial_ns = 0
        self._lost_told = False

    def start(self) -> None:
        """Has the tracker begin a run."""
        self._dialog.running = True
        self._waker.wake()

    def stop(self) -> None:
        """Has the tracker end its run."""
        self._dialog.running = False
        self._waker.wake()

    def _check(self) -> None:
        if self._dialog.over:
            self._dialog.over = False
            raise TrackerEnded(f"tracker {self.name}: it has ended the run")

    def _miss(self, timeout_s: float) -> str:
        self._lose(f"gave nothing for {timeout_s:g} s")
        return self.name

    def _step(self, until_ns: int) -> ArenaState | None:
        due_ns = self._act(self._clock())
        sock = self._sock
        wanted = {} if sock is None else {sock: POLLIN if self._connected else POLLOUT}
        ready = self._poll(wanted, min(due_ns, until_ns))
        if sock is None or sock.fileno() not in ready:
            return None
        if self._connected:
            return self._read(sock)
        self._arrive(sock)
        return None

    def _act(self, now_ns: int) -> int:
        """Connects, or asks, whatever is due; gives the time of the next action."""
        if self._sock is None and now_ns >= self._dial_ns:
            self._dial(now_ns)
        if self._connected:
            command = self._dialog.command(now_ns)
            if command is not None:
                self._send(command)
        due_ns = self._dialog.due_ns if self._connected else None
        if self._sock is None:
            due_ns = self._dial_ns
        return now_ns + REDIAL_NS if due_ns is None else due_ns

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

    def _arrive(self, sock: socket.socket) -> None:
        code = sock.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if code:
            self._lose(f"cannot be reached: {os.strerror(code)}")
            return
        self._connected, self._lost_told = True, False
        self._dialog.connected(self._clock())
        self.connections += 1
        self._say(f"tracker {self.name}: connected")

    def _read(self, sock: socket.socket) -> ArenaState | None:
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
        """Closes the connection; reports that once until there is a new one."""
        self._hang_up()
        self._dial_ns = self._clock() + REDIAL_NS
        if not self._lost_told:
            self._lost_told = True
            self._say(f"tracker {self.name}: {reason}; trying again every {REDIAL_NS / 1e9:g} s")

    def _hang_up(self) -> None:
        sock, self._sock = self._sock, None
        self._connected = False
        if sock is not None:
            sock.close()


def _find(host: str, port: int) -> tuple[socket.AddressFamily, tuple[Any, ...]]:
    try:
        addresses = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as error:
        text = getattr(error, "strerror", None) or "not a host name"
        raise LinkError(f"tracker {host}:{port}: {text}") from error
    return addresses[0][0], addresses[0][4]
