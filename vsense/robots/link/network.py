"""The server's thread: one port number for TCP and UDP, one selector over both, the heartbeats.

The port is taken on TCP and UDP or not at all, so that no two servers share it. The thread waits
in the selector only, no longer than to the next deadline. The runtime's thread calls `send`, so
that readings leave without waiting for this one.
"""

from __future__ import annotations

import contextlib
import errno
import os
import selectors
import socket
import time
from collections import Counter, deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from vsense.base.clock import real_s
from vsense.base.native import WireError
from vsense.robots.link._links import FINISH_NS, READ, Connections
from vsense.robots.link._session import Address, HostSession, PendingSession
from vsense.robots.link._shared import ServerState, Waker
from vsense.robots.link.status import LinkError, LinkEvent
from vsense.robots.link.wire import GoodbyeCause, session_of

TCP_BACKLOG = 512
"""Connections that the kernel keeps until they are accepted; whoever finds no place there tries
again after a second."""

EPHEMERAL_TRIES = 32
"""How often a free TCP port is given back because its UDP half is taken."""

_REASONS = {
    errno.EADDRINUSE: "is in use: {holder} runs there; stop it or choose another port",
    errno.EADDRNOTAVAIL: "is not an address of this machine",
    errno.EACCES: "needs privileges: choose a port from 1024 on",
}


@dataclass(frozen=True, slots=True)
class Ports:
    """A server's two non-blocking sockets on one port number; `tcp` listens."""

    tcp: socket.socket
    udp: socket.socket
    port: int


def bind(host: str, port: int) -> Ports:
    """Takes a port number on TCP and on UDP of an interface; 0 takes any that is free on both.

    Raises:
        LinkError: the host is unknown, or another program has the number on TCP or on UDP.
    """
    family, address = _resolve(host)
    for _ in range(EPHEMERAL_TRIES):
        tcp = _open(family, socket.SOCK_STREAM, address, port)
        number = int(tcp.getsockname()[1])
        try:
            return Ports(tcp, _open(family, socket.SOCK_DGRAM, address, number), number)
        except LinkError:
            tcp.close()
            if port != 0:
                raise
    raise LinkError(f"{host}: no port is free on both TCP and UDP")


def listen(host: str, port: int) -> tuple[socket.socket, int]:
    """Takes a port number on TCP only; 0 takes any that is free.

    Returns the listening, non-blocking socket and its port number.

    Raises:
        LinkError: the host is unknown, or another program has the number.
    """
    family, address = _resolve(host)
    tcp = _open(family, socket.SOCK_STREAM, address, port)
    return tcp, int(tcp.getsockname()[1])


def _resolve(host: str) -> tuple[int, tuple[Any, ...]]:
    """Family and socket address of a host name; the address's second item is the port."""
    try:
        kind, flags = socket.SOCK_STREAM, socket.AI_PASSIVE
        addresses = socket.getaddrinfo(host or None, 0, type=kind, flags=flags)
    except (OSError, UnicodeError) as error:
        text = getattr(error, "strerror", None) or "not a host name"
        raise LinkError(f"cannot listen on '{host}': {text}") from error
    return int(addresses[0][0]), tuple(addresses[0][4])


def _open(family: int, kind: int, address: tuple[Any, ...], port: int) -> socket.socket:
    """Binds one non-blocking socket; a TCP socket listens.

    Never SO_REUSEPORT, and SO_REUSEADDR on TCP only: there it lets a restarted server pass
    connections in TIME_WAIT, on UDP it would let two servers share the port.
    """
    opened = socket.socket(family, kind)
    try:
        opened.setblocking(False)
        if kind == socket.SOCK_STREAM:
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        opened.bind((address[0], port, *address[2:]))
        if kind == socket.SOCK_STREAM:
            opened.listen(TCP_BACKLOG)
    except OSError as error:
        opened.close()
        reason = _REASONS.get(error.errno or 0, f"cannot be used: {error.strerror}")
        if error.errno == errno.EADDRINUSE:
            reason = reason.format(holder=_holder(port))
        layer = "TCP" if kind == socket.SOCK_STREAM else "UDP"
        raise LinkError(f"{layer} port {port} on {address[0]} {reason}") from error
    return opened


_MOST_LETTERS = 80
"""Of a command that holds a port."""


def _holder(port: int) -> str:
    """Which process has a port, with its command and since when, as far as it may be looked at.

    Source of the formats: Linux, proc_net_tcp(5) and proc(5).
    """
    sockets = set[str]()
    for table in ("tcp", "tcp6", "udp", "udp6"):
        with contextlib.suppress(OSError):
            rows = [line.split() for line in Path(f"/proc/net/{table}").read_text().splitlines()]
            ours = [row for row in rows[1:] if int(row[1].rpartition(":")[2], 16) == port]
            sockets |= {f"socket:[{row[9]}]" for row in ours}
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):  # it has ended, or is another account's
            if any(_target(file) in sockets for file in (process / "fd").iterdir()):
                words = (process / "cmdline").read_bytes().decode(errors="replace").split("\0")
                began = time.strftime("%d %b %H:%M", time.localtime(process.stat().st_mtime))
                return f"process {process.name} ({_command(words)}, since {began})"
    return "another server"


def _target(link: Path) -> str:
    """Where a link leads; "": it is gone."""
    try:
        return os.readlink(link)
    except FileNotFoundError:
        return ""


def _command(words: Sequence[str]) -> str:
    """A process's command for people: what was typed, without the interpreter before it."""
    typed = [word for word in words if word]
    for place, word in enumerate(typed):
        if word == "vsense" or word.endswith(("/vsense", "/vsense/__main__.py")):
            typed = ["vsense", *typed[place + 1 :]]
            break
    return " ".join(typed)[:_MOST_LETTERS]


DATAGRAMS = 256
"""Datagrams taken in a row before TCP and the heartbeats have their turn."""

DATAGRAM_ROOM = 2048
"""More bytes than any packet has, so that a datagram that is too long is seen to be so."""

TOGETHER_NS = 5_000_000
"""What is due so soon leaves at once: a swarm's heartbeats then need few looks at all robots, where
each of 100 would need one of its own."""

FEW = 8
"""Robots for which the lock is kept in a row: the readings of a timestep wait no longer."""

SELECT_TIMEOUT_NS = 250_000_000
"""Longest wait in the selector: deadlines of connections are kept to this accuracy."""


class ServerThread:
    """The sockets of a server and the work of its thread.

    Attributes:
        strays: datagrams that belong to no open session, by reason.
        silent: no STATE leaves any more; everything else goes on.
    """

    def __init__(self, shared: ServerState, ports: Ports) -> None:
        self.strays: Counter[str] = Counter()
        self.silent = False
        self._shared = shared
        self._ports = ports
        self._due_ns = 0
        self._ending = False
        self._parting: deque[tuple[HostSession, str]] = deque()
        self._failed: deque[tuple[HostSession, Exception]] = deque()
        self._selector = selectors.DefaultSelector()
        self._waker = Waker()
        self._selector.register(self._waker, READ, self._woken)
        self._selector.register(ports.udp, READ, self._receive)
        self._links = Connections(shared, ports.tcp, self._selector, self._offered, self._opened)

    # --- any thread

    def send(self, robot: HostSession, now_ns: int, surely: bool = False) -> None:
        """Sends the newest STATE to a robot with an open session; the lock is held.

        With `surely` it goes on both ways at once, also where UDP works. What fails here fails for
        this robot alone: the thread ends its session.
        """
        self._pass_on(robot, self._make(robot, now_ns), now_ns, surely)

    def send_all(self, robots: Iterable[HostSession]) -> None:
        """As `send`, to some robots in their order: a few packets are made, then these leave."""
        waiting = iter(robots)
        while few := [*islice(waiting, FEW)]:
            made = [(r, self._make(r, self._shared.clock())) for r in few]
            for robot, packet in made:
                self._pass_on(robot, packet, self._shared.clock(), False)

    def _make(self, robot: HostSession, now_ns: int) -> bytes:
        """A robot's next STATE; b"": none leaves."""
        try:
            if not self.silent:
                return robot.state(self._shared.roster.orders.of(robot.tag), now_ns)
            robot.plan(now_ns)
        except Exception as error:
            self._fail(robot, error)
        return b""

    def _pass_on(self, robot: HostSession, packet: bytes, now_ns: int, surely: bool) -> None:
        if not packet:
            return
        try:
            by_tcp = surely or robot.by_tcp(now_ns)
            for way in robot.ways(now_ns):
                try:
                    self._ports.udp.sendto(packet, way)
                except OSError:
                    robot.unsent += not by_tcp
            if by_tcp:
                self._links.put_state(robot, packet)
        except Exception as error:
            self._fail(robot, error)

    def _fail(self, robot: HostSession, error: Exception) -> None:
        """Has the thread end the session of a robot at whose packets a defect was met."""
        self._failed.append((robot, error))
        self.wake()

    def wake(self) -> None:
        """Has the thread look at deadlines and unfinished streams at once."""
        self._waker.wake()

    def wake_for_streams(self) -> None:
        """As `wake`, if `send` has left a stream unfinished."""
        if self._links.dirty:
            self.wake()

    def part(self, robots: Sequence[HostSession], text: str) -> None:
        """Ends the sessions of robots soon, with a text for each."""
        self._parting.extend((robot, text) for robot in robots)
        self.wake()

    def end(self) -> None:
        """Has `run` return soon."""
        self._ending = True
        self.wake()

    # --- the server's thread

    def run(self) -> None:
        """Serves until `end`."""
        while not self._ending:
            self.turn()

    def turn(self) -> None:
        """Waits for a socket or the next deadline, and does all that is due."""
        wait_ns = min(max(self._due_ns - self._shared.clock(), 0), SELECT_TIMEOUT_NS)
        for key, mask in self._selector.select(real_s(wait_ns / 1e9)):
            key.data(mask)
        while self._failed:
            failed, error = self._failed.popleft()
            if failed.open:  # the runtime may have sent it more meanwhile
                self._links.contain(error, failed)
        while self._parting:
            robot, text = self._parting.popleft()
            self._links.dismiss(robot, GoodbyeCause.END, text)
        self._links.settle()
        if self._shared.clock() >= self._due_ns:
            self._keep_time()

    def finish(self, cause: GoodbyeCause, text: str) -> None:
        """Says goodbye to all robots and gives them a moment to read it."""
        self._links.finish(cause, text)
        until_ns = self._shared.clock() + FINISH_NS
        while len(self._links) and self._shared.clock() < until_ns:
            self.turn()

    def close(self) -> None:
        """Closes every socket."""
        self._links.close()
        self._selector.close()
        for handle in (self._ports.tcp, self._ports.udp, self._waker):
            handle.close()

    def _offered(self, pending: PendingSession) -> bytes:
        """The first STATE, which follows the WELCOME; b"": none leaves any more."""
        if self.silent:
            return b""
        orders = self._shared.roster.orders.of(pending.robot.tag)
        return pending.robot.first_state(pending, orders, self._shared.clock())

    def _opened(self) -> None:
        """Has the next STATE leave at once."""
        self._due_ns = 0

    def _woken(self, _mask: int) -> None:
        self._waker.drain()
        self._due_ns = 0

    def _receive(self, _mask: int) -> None:
        heard = []
        with contextlib.suppress(OSError):
            for _ in range(DATAGRAMS):
                heard.append((*self._ports.udp.recvfrom(DATAGRAM_ROOM), self._shared.clock()))
        for datagram, source, now_ns in heard:
            self._dispatch(datagram, source, now_ns)

    def _dispatch(self, datagram: bytes, source: Address, now_ns: int) -> None:
        """Gives a datagram to the robot whose session it names; answers a new address at once."""
        try:
            session = session_of(datagram)
        except WireError as error:
            self.strays[error.name] += 1
            return
        talker: HostSession | PendingSession | None = None
        try:
            with self._shared.lock:
                roster = self._shared.roster
                talker = roster.of_session(session) or roster.pending(session)
                events = self._take(talker, session, datagram, source, now_ns)
            self._shared.notify_all(events)
        except Exception as error:
            self._links.contain(error, talker)

    def _take(
        self,
        talker: HostSession | PendingSession | None,
        session: int,
        datagram: bytes,
        source: Address,
        now_ns: int,
    ) -> list[LinkEvent]:
        """Has whose session it is take a datagram; gives what to tell; under the lock."""
        if talker is None:
            self.strays["VS_ERR_SESSION"] += 1
            return []
        if isinstance(talker, HostSession):
            robot: HostSession | None = talker
            _, events = talker.receive(datagram, source, now_ns)
        else:
            events = self._links.prove(talker, datagram, source, now_ns)
            robot = self._shared.roster.of_session(session)
            if robot is None:
                self.strays[WireError(talker.peer.fault).name] += 1
        if robot is not None and robot.due_ns <= now_ns:
            self.send(robot, self._shared.clock())
        return events

    def _keep_time(self) -> None:
        """Sends what is due now or soon, notices silence, and finds the next deadline."""
        now_ns = self._shared.clock()
        due_ns = now_ns + SELECT_TIMEOUT_NS
        waiting = iter(self._shared.roster.robots.values())
        while few := [*islice(waiting, FEW)]:
            due_ns = min(due_ns, self._keep_time_of(few, now_ns, due_ns))
        self._links.keep_time(now_ns)
        self._shared.tick(now_ns)
        self._due_ns = due_ns

    def _keep_time_of(self, robots: Sequence[HostSession], now_ns: int, idle_ns: int) -> int:
        """Does for a few robots what is due; gives when their next STATE is, else `idle_ns`."""
        events: list[tuple[HostSession, list[LinkEvent]]] = []
        with self._shared.lock:
            there = [robot for robot in robots if robot.open]
            for robot in there:
                try:
                    events.append((robot, robot.tick(now_ns)))
                except Exception as error:
                    self._fail(robot, error)
            self.send_all(r for r in there if r.due_ns <= now_ns + TOGETHER_NS)
            due_ns = min((robot.due_ns for robot in there), default=idle_ns)
        for robot, its in events:
            try:
                self._shared.notify_all(its)
            except Exception as error:
                self._links.contain(error, robot)
        return due_ns
