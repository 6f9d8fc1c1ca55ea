"""A real server on loopback, robots with real sockets, and a clock that tests may turn.

Nothing here sleeps: every wait is for a packet or an event, and gives up after `PATIENCE_S`.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import struct
import threading
import time
from collections.abc import Callable

from tests.wire.robot_session import Event, RobotSession
from vsense.base.clock import host_ns
from vsense.robots.link.keys import LinkTrust, SwarmKeys
from vsense.robots.link.server import VirtualSensorServer
from vsense.robots.link.status import LinkEvent
from vsense.robots.link.table import Direction, Entry, ExpectedRobot, Table
from vsense.robots.link.wire import PACKET_MAX, GoodbyeCause, ReadingValues, Telemetry

PATIENCE_S = 20.0
LOOK_AGAIN_S = 0.005
MS = 1_000_000
S = 1000 * MS
TABLE = Table([Entry(7, "pollutant", "f4"), Entry(8, "pushes", "u4", Direction.ACTUATOR)])


KEYS = SwarmKeys({1: bytes(range(32))})
KEYED = LinkTrust(KEYS)


def keyed_session(uid: bytes, tag: int) -> RobotSession:
    """A robot's session that has the robot's own key."""
    return RobotSession(uid, tag, key=KEYS.robot_key(uid))


def reading(value: float, capture_ns: int) -> ReadingValues:
    """A robot's readings as `publish` takes them."""
    return [(struct.pack("<f", value), capture_ns)]


class Clock:
    """The machine's monotonic clock plus what a test adds to it."""

    def __init__(self) -> None:
        self._ahead_ns = 0

    def __call__(self) -> int:
        return host_ns() + self._ahead_ns

    def advance(self, length_ns: int) -> None:
        self._ahead_ns += length_ns


class Frozen:
    """A clock that stands still until it is told to go on."""

    def __init__(self) -> None:
        self._now_ns = 100 * S

    def __call__(self) -> int:
        return self._now_ns

    def advance(self, length_ns: int) -> None:
        self._now_ns += length_ns


class Server:
    """A server with robots 1 and 2, whose events can be waited for."""

    def __init__(
        self,
        clock: Callable[[], int],
        port: int = 0,
        seed: int = 1,
        born_s: float = 1.8e9,
        trust: LinkTrust = KEYED,
    ) -> None:
        self.clock = clock
        self.events: list[LinkEvent] = []
        self._news = threading.Condition()
        self.server = VirtualSensorServer(
            trust=trust,
            host="127.0.0.1",
            port=port,
            timestep_ns=100 * MS,
            seed=seed,
            expected={t: ExpectedRobot(f"epuck_{t}", TABLE, "speed_cm_s=10\n") for t in (1, 2)},
            on_event=self._heard,
            clock=clock,
            calendar=lambda: born_s,
        )
        self.port = self.server.start()

    def _heard(self, event: LinkEvent) -> None:
        with self._news:
            self.events.append(event)
            self._news.notify_all()

    def kinds(self, tag: int | None) -> list[str]:
        """What was told of a robot so far."""
        return [event.kind for event in list(self.events) if event.tag == tag]

    def wait(self, kind: str, tag: int | None, times: int = 1) -> LinkEvent:
        """Waits until an event was told for the n-th time."""

        def found() -> list[LinkEvent]:
            return [e for e in self.events if (e.kind, e.tag) == (kind, tag)]

        with self._news:
            came = self._news.wait_for(lambda: len(found()) >= times, PATIENCE_S)
            assert came, f"no {kind} of {tag}; told were {[e.text for e in self.events]}"
            return found()[times - 1]

    def close(self) -> None:
        self.server.close(GoodbyeCause.END, "the test has ended")
        assert not [event.text for event in self.events if event.kind == "defect"]


class Robot:
    """A robot with real sockets; it does only what the test makes it do.

    Attributes:
        events: what its session told.
        drops: errors for which datagrams were dropped.
        udp_open: False: a firewall between it and the host eats every datagram.
        wire: what went "up" to the host and came "down", as somebody hears who listens.
        copies: packets of its session that it has sent, on every way.
    """

    def __init__(
        self, server: Server, tag: int, uid: bytes | None = None, keyed: bool = True
    ) -> None:
        who = uid or bytes([tag % 256]) * 16
        self.session = keyed_session(who, tag) if keyed else RobotSession(who, tag)
        self.events: list[Event] = []
        self.udp_open = True
        self.wire: list[tuple[str, bytes]] = []
        self.copies = 0
        self._server = server
        self.udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.udp.bind(("127.0.0.1", 0))
        self.udp.setblocking(False)
        self.tcp = socket.socket()

    def now_ns(self) -> int:
        return self._server.clock() + 1234 * S

    def connect(self, overheard: Callable[[bytes], object] = lambda hello: None) -> Robot:
        """Opens a TCP connection and sends HELLO, which is `overheard` before it arrives."""
        self.tcp.close()
        self.session.disconnect()
        self.tcp = socket.create_connection(("127.0.0.1", self._server.port), PATIENCE_S)
        hello = self.session.connect(self.now_ns(), os.urandom(16))
        self.wire.append(("up", hello))
        overheard(hello)
        self.tcp.sendall(hello)
        return self

    def join(self) -> Robot:
        """Connects until there is a session and state comes over UDP."""
        self.open()
        self.until(lambda: bool(self.session.c.peer.udp_heard))
        return self

    def open(self, overheard: Callable[[bytes], object] = lambda hello: None) -> Robot:
        """Connects until there is a session, and says its first word, which proves that."""
        sessions = self._sessions()
        self.connect(overheard)
        self.until(lambda: bool(self.session.c.open))
        self.say()
        self.until(lambda: self._sessions() > sessions)
        return self

    def _sessions(self) -> int:
        return self._server.server.robots()[self.session.c.config.tag].sessions

    def say(self, telemetry: Telemetry | None = None) -> None:
        """Sends one telemetry on every way that it needs now."""
        packet = self.session.telemetry(self.now_ns(), telemetry)
        self.wire.append(("up", packet))
        if self.udp_open:
            self.send(packet)
        if self.session.over_tcp(self.now_ns()):
            self.tcp.sendall(packet)
            self.copies += 1

    def send(self, packet: bytes) -> None:
        """Sends one of its packets over UDP, perhaps not for the first time."""
        self.udp.sendto(packet, ("127.0.0.1", self._server.port))
        self.copies += 1

    def until(self, done: Callable[[], bool]) -> None:
        """Takes what comes until the condition holds; it may be about the server, too."""
        end_s = time.monotonic() + PATIENCE_S
        while not done():
            assert time.monotonic() < end_s, f"waited in vain; told were {self.events}"
            for ready in select.select([self.tcp, self.udp], [], [], LOOK_AGAIN_S)[0]:
                self._take(ready)

    def _take(self, ready: socket.socket) -> None:
        if ready is self.udp:
            datagram = self.udp.recv(PACKET_MAX)
            self.wire.append(("down", datagram))
            if self.udp_open:
                self.events.append(self.session.udp_in(datagram, self.now_ns())[1])
            return
        data = self.tcp.recv(PACKET_MAX)
        assert data, f"the host closed the connection; told were {self.events}"
        self.wire.append(("down", data))
        self.events += self.session.tcp_in(data, self.now_ns())

    def timestep(self, timestep: int) -> None:
        """Waits for the STATE of a timestep."""
        self.until(lambda: self.session.c.timestep == timestep)

    def event(self, event: Event) -> None:
        """Waits until the session has told this event."""
        self.until(lambda: event in self.events)

    def value(self) -> float:
        """The newest reading."""
        newest = self.session.value("pollutant")
        assert newest is not None
        return float(struct.unpack("<f", newest[0])[0])

    def close(self) -> None:
        self.tcp.close()
        self.udp.close()


MakeRobot = Callable[..., Robot]


def heard_since(server: Server, robot: Robot, accepted: int) -> bool:
    return server.server.robots()[robot.session.c.config.tag].accepted > accepted


def works(server: Server, robot: Robot, timestep: int) -> bool:
    """Whether a robot gets a reading and the host its telemetry."""
    server.server.publish(timestep, server.clock(), {})
    robot.timestep(timestep)
    accepted = server.server.robots()[robot.session.c.config.tag].accepted
    robot.say()
    robot.until(lambda: heard_since(server, robot, accepted))
    return True


def closed(sock: socket.socket) -> bool:
    """Waits until the host has closed a connection."""
    with contextlib.suppress(ConnectionResetError):
        while sock.recv(4096):
            pass
    return True
