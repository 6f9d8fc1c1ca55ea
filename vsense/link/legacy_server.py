"""The original virtual sensor server, for robots that still run the original's client.

Readings leave in the caller's thread, in the timestep in which they were made, as far as the
kernel takes them at once; a thread of the server's own listens, goes on with what was left, and
notices who has gone. No robot waits for another.
"""

from __future__ import annotations

import contextlib
import selectors
import socket
import threading
import time
from collections.abc import Callable, Mapping

from vsense.link.legacy_robots import LegacyRobot, LegacySwarm
from vsense.link.ports import listen
from vsense.link.status import EventKind, LinkError, LinkEvent
from vsense.link.wire import Values

STUCK_NS = 5_000_000_000
"""A robot that takes nothing of what waits for it for this long is gone."""

FINISH_S = 0.5
"""How long the end of the experiment may take to leave."""

SEND_BUFFER = 16_384
"""Bytes that the kernel may hold for a slow robot: with more, old readings would pile up there."""

_READ, _WRITE = selectors.EVENT_READ, selectors.EVENT_WRITE
_CHUNK = 4096
_IDLE_S = 0.25
_JOIN_S = 5.0
_KEEPALIVE_S = 1


class _Connection:
    """One robot's socket."""

    def __init__(self, sock: socket.socket, octet: int, robot: LegacyRobot, now_ns: int) -> None:
        self.sock = sock
        self.octet = octet
        self.robot = robot
        self.moved_ns = now_ns
        sock.setblocking(False)
        with contextlib.suppress(OSError):
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
            # One message at most waits unsent in the kernel; a newer one replaces it here.
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, _CHUNK)
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, _KEEPALIVE_S)
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, _KEEPALIVE_S)
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, 3)

    def write(self, now_ns: int) -> str:
        """Writes what the kernel takes now; returns why the connection is lost, or ""."""
        try:
            while chunk := self.robot.chunk():
                self.robot.wrote(self.sock.send(chunk))
                self.moved_ns = now_ns
        except (BlockingIOError, InterruptedError):
            stuck = now_ns - self.moved_ns > STUCK_NS
            return f"has taken nothing for {STUCK_NS // 10**9} s" if stuck else ""
        except OSError as error:
            return f"is gone: {error.strerror}"
        self.moved_ns = now_ns
        return ""

    def read(self) -> str:
        """Reads what no such robot ever says; returns why the connection is lost, or ""."""
        try:
            said = self.sock.recv(_CHUNK)
        except (BlockingIOError, InterruptedError):
            return ""
        except OSError as error:
            return f"is gone: {error.strerror}"
        if said:
            return "says something, which the original client never does: turned away"
        return "has left"


class LegacyServer:
    """Serves robots with the original client; its methods may be called by any thread."""

    def __init__(
        self,
        host: str,
        port: int,
        swarm: LegacySwarm,
        on_event: Callable[[LinkEvent], None],
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """Takes the port; nobody is answered before `start`.

        Args:
            host: name or address of the interface to listen on.
            port: its number; 0 takes any that is free.
            swarm: who may come and what they are told; belongs to this server from now on.
            on_event: takes what a person wants to know; must not wait, nor call the server.
            clock: the host's monotonic clock [ns].

        Raises:
            LinkError: the host is unknown, or the port is taken.
        """
        self._listener, self.port = listen(host, port)
        self._swarm = swarm
        self._on_event = on_event
        self._clock = clock
        self._lock = threading.Lock()
        self._connections: dict[int, _Connection] = {}
        self._ending = False
        self._failure: BaseException | None = None
        self._selector = selectors.DefaultSelector()
        self._wake_in, self._wake_out = socket.socketpair()
        for sock in (self._wake_in, self._wake_out):
            sock.setblocking(False)
        self._selector.register(self._wake_in, _READ)
        self._selector.register(self._listener, _READ)
        self._thread = threading.Thread(target=self._run, name="legacy-server", daemon=True)

    def start(self) -> int:
        """Begins to answer; returns the port."""
        self._thread.start()
        return self.port

    def publish(self, values: Mapping[int, Values], first: bool = False) -> None:
        """Sends every robot what has changed in its readings, now and without waiting for any.

        Args:
            values: by tag, the readings in the table's order.
            first: the experiment starts with them: all robots are told, and whoever comes later.

        Raises:
            LinkError: the server's thread has failed.
        """
        if self._failure is not None:
            raise LinkError(f"the original's virtual sensor server has failed: {self._failure!r}")
        with self._lock:
            for tag, readings in values.items():
                self._swarm.sense(tag, self._swarm.translation.payloads(readings))
            if first:
                self._swarm.start()
            now_ns = self._clock()
            # Whoever is lost is let go by the server's thread.
            left = [c for c in self._connections.values() if c.write(now_ns) or c.robot.pending]
        if left:
            self._wake()

    def end(self) -> None:
        """The experiment ends: all robots are told."""
        with self._lock:
            self._swarm.end()
        self._wake()

    def robots(self) -> dict[int, int]:
        """Who is connected: how many updates each was sent, by tag."""
        with self._lock:
            return {robot.tag: robot.updates for robot in self._swarm.robots.values()}

    def close(self) -> None:
        """Ends the experiment and closes everything; can be called again."""
        self.end()
        self._ending = True
        self._wake()
        if self._thread.is_alive():
            self._thread.join(_JOIN_S)
        self._selector.close()
        for sock in (self._listener, self._wake_in, self._wake_out):
            sock.close()

    def _wake(self) -> None:
        try:
            self._wake_out.send(b"\0")
        except OSError:
            return  # full: it is about to wake; closed: it has ended

    # --- the server's thread

    def _run(self) -> None:
        """The thread. A failure here is a fault of ours: it is kept for the next `publish`."""
        try:
            while not self._ending:
                self._turn(_IDLE_S)
            until_ns = self._clock() + round(FINISH_S * 1e9)
            while self._unsent() and self._clock() < until_ns:
                self._turn(FINISH_S / 10.0)
        except BaseException as failure:
            self._failure = failure
            raise
        finally:
            with self._lock:
                for connection in list(self._connections.values()):
                    self._drop(connection, "")

    def _turn(self, wait_s: float) -> None:
        """Waits for a socket, and does all that is due."""
        for key, _ in self._selector.select(wait_s):
            if key.fileobj is self._wake_in:
                with contextlib.suppress(OSError):
                    self._wake_in.recv(_CHUNK)
            elif key.fileobj is self._listener:
                self._accept()
            elif key.data is not None:
                self._hear(key.data)
        with self._lock:
            for connection in list(self._connections.values()):
                self._settle(connection)

    def _accept(self) -> None:
        try:
            sock, address = self._listener.accept()
        except OSError:
            return
        origin = str(address[0])
        octet = int(origin.rpartition(".")[2]) if origin.count(".") == 3 else 0
        with self._lock:
            robot = self._swarm.join(octet)
            before = self._connections.get(octet)
            if robot is None:
                sock.close()
                self._tell(
                    "refused",
                    None,
                    f"refused a robot with the original client from {origin}: no robot's number is"
                    f" {octet}; expected: {self._swarm.known()}",
                )
                return
            if before is not None:
                self._drop(before, "has come again")
            connection = _Connection(sock, octet, robot, self._clock())
            self._connections[octet] = connection
            self._selector.register(sock, _READ | _WRITE, connection)
        text = f"robot {robot.tag} ({robot.name}): connected with the original client"
        self._tell("connected", robot.tag, text)

    def _hear(self, connection: _Connection) -> None:
        with self._lock:
            if self._connections.get(connection.octet) is connection and (why := connection.read()):
                self._drop(connection, why)

    def _settle(self, connection: _Connection) -> None:
        """Writes what waits; the lock is held."""
        why = connection.write(self._clock())
        if why:
            self._drop(connection, why)
        else:
            events = _READ | (_WRITE if connection.robot.pending else 0)
            self._selector.modify(connection.sock, events, connection)

    def _drop(self, connection: _Connection, why: str) -> None:
        """Lets a robot go; the lock is held."""
        if self._connections.get(connection.octet) is connection:
            del self._connections[connection.octet]
        self._swarm.leave(connection.octet, connection.robot)
        self._selector.unregister(connection.sock)
        connection.sock.close()
        if why:
            robot = connection.robot
            self._tell("lost", robot.tag, f"robot {robot.tag} ({robot.name}): {why}")

    def _tell(self, kind: EventKind, tag: int | None, text: str) -> None:
        self._on_event(LinkEvent(kind, tag, text, self._clock()))

    def _unsent(self) -> bool:
        with self._lock:
            return any(c.robot.pending for c in self._connections.values())
