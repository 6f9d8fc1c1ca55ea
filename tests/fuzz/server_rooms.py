"""The room of the robots' server: its thread, driven by hand, with two robots that have their keys.

One says in every field what it likes, by datagram and by stream; the other is honest. Whatever the
first one says, nothing of it may be met by the net under the server's thread
(`Connections.contain`), and the second one's session goes on.
"""

from __future__ import annotations

import json
import socket
import struct
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from random import Random

from tests.fuzz import mutate
from tests.fuzz.robots import TABLE, Robot, S, any_whole, hello
from tests.wire.robot_session import RobotSession
from vsense.base.native import WireError
from vsense.robots.link.keys import LinkTrust, SwarmKeys
from vsense.robots.link.network import Ports, ServerThread
from vsense.robots.link.server import VirtualSensorServer
from vsense.robots.link.status import LinkEvent
from vsense.robots.link.table import ExpectedRobot
from vsense.robots.link.wire import Notice, PacketType, Wanted, encode, packet_length, session_keys
from vsense.robots.link.wire import session_of as number_of

WILD, HONEST = 5, 6
SWARM = SwarmKeys({1: b"\1" * 32})
UPTIMES_NS = (S, 60 * S, 40 * 86_400 * S)
"""How long the host has been on: robots' clocks may be anything then."""


def prepare(folder: Path) -> list[socket.socket]:
    """Three places that datagrams may come from, so that what is sent there harms nobody."""
    places = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(3)]
    for place in places:
        place.bind(("127.0.0.1", 0))
    return places


class _House:
    """A server whose thread takes its turns when it is told to.

    Attributes:
        now_ns: the host's clock.
        told: what people were told.
    """

    def __init__(self, now_ns: int, listener: socket.socket, udp: socket.socket) -> None:
        self.now_ns = now_ns
        self.told: list[LinkEvent] = []
        self.server = VirtualSensorServer(
            host="",
            port=0,
            timestep_ns=S // 10,
            seed=1,
            expected={tag: ExpectedRobot(f"epuck_{tag}", TABLE) for tag in (WILD, HONEST)},
            trust=LinkTrust(SWARM),
            on_event=self.told.append,
            clock=lambda: self.now_ns,
            calendar=lambda: 1.0,
        )
        self.network = ServerThread(self.server._shared, Ports(listener, udp, 0))
        self.server._network = self.network
        self._timestep = 0

    def connect(self, packet: bytes) -> tuple[socket.socket, bytes]:
        """Somebody greets; gives the connection, and what it was answered."""
        ours, theirs = socket.socketpair()
        theirs.setblocking(False)
        self.network._links._welcome(ours, ("10.0.0.5", 1), self.now_ns)
        theirs.sendall(packet)
        self.turn()
        return theirs, theirs.recv(1 << 16)

    def hear(self, packet: bytes, place: socket.socket) -> None:
        """A datagram comes."""
        self.network._dispatch(packet, place.getsockname(), self.now_ns)

    def turn(self) -> None:
        """The thread does all that is due, and waits for nothing."""
        self.network.wake()
        self.network.turn()

    def look(self) -> None:
        """What the runtime asks in a timestep."""
        self._timestep += 1
        values = [(struct.pack("<f", 1.0), self.now_ns)]
        self.server.publish(self._timestep, self.now_ns, {WILD: values})
        self.server.robots()
        self.server.reports()
        for figures in self.server.measured().values():
            json.dumps(asdict(figures), allow_nan=False)
            for share in (figures.loss_up, figures.loss_down, figures.late):
                assert share is None or 0.0 <= share <= 1.0


@contextmanager
def _house(now_ns: int) -> Iterator[_House]:
    listener, udp = socket.socket(socket.AF_UNIX), socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    listener.bind("")  # Linux gives it an abstract name
    listener.listen(1)
    for sock in (listener, udp):
        sock.setblocking(False)
    made = _House(now_ns, listener, udp)
    try:
        yield made
    finally:
        made.network.close()


class _Wild(Robot):
    """The robot that says what it likes, in the house."""

    def __init__(self, random: Random, house: _House, places: list[socket.socket]) -> None:
        super().__init__(random, b"w" * 16, SWARM.robot_key(b"w" * 16))
        self._house, self._places = house, places
        self._sock: socket.socket | None = None

    def greet(self) -> None:
        """Opens another connection; the session is opened by the first telemetry that is taken."""
        with suppress(WireError):
            packet = hello(self.random, WILD, self.uid, self.root)
            if self._sock is not None and self.random.random() < 0.5:
                self._sock.close()
            self._sock, answer = self._house.connect(packet)
            welcome = answer[: packet_length(answer) or 0]
            if welcome[3] == PacketType.WELCOME:
                self.session = number_of(welcome)
                self.up = session_keys(self.root, packet, welcome)[1]
                self.sequence = 0

    def say(self) -> None:
        """One packet, as a datagram or in the stream, or on both ways."""
        random = self.random
        try:
            packet = self._packet()
        except WireError:
            return
        if random.random() < 0.7:
            self._house.hear(packet, random.choice(self._places))
        if self._sock is not None and random.random() < 0.4:
            with suppress(OSError):
                for piece in mutate.chunks(random, packet):
                    self._sock.sendall(piece)
                    self._house.turn()
                self._sock.recv(1 << 16)

    def _packet(self) -> bytes:
        if self.random.random() < 0.9:
            return self.telemetry(self.up, self._house.now_ns)
        kind = self.random.choice((PacketType.GOODBYE, PacketType.GOODBYE, PacketType.REFUSE))
        code = any_whole(self.random, 8)
        notice = Notice(code, mutate.text(self.random, "the robot ends")[:60])
        return encode(self.header(kind, self._house.now_ns), notice, self.up)

    def close(self) -> None:
        if self._sock is not None:
            self._sock.close()


def server(random: Random, scene: list[socket.socket]) -> None:
    """A robot with its key says anything: it harms nobody, and nothing of it is a surprise."""
    with _house(random.choice(UPTIMES_NS)) as house:
        honest = RobotSession(b"h" * 16, HONEST, key=SWARM.robot_key(b"h" * 16))
        sock, answer = house.connect(honest.connect(house.now_ns))
        honest.tcp_in(answer, house.now_ns)
        wild = _Wild(random, house, scene[:2])
        if random.random() < 0.8:
            house.server.measure()
        if random.random() < 0.5:
            house.server.command(Wanted.RUN)
        for step in range(16):
            house.now_ns += random.randrange(S // 4)
            house.hear(honest.telemetry(house.now_ns), scene[2])
            wild.greet() if step == 0 or random.random() < 0.1 else wild.say()
            house.turn()
            house.look()
            defects = [event.text for event in house.told if event.kind == "defect"]
            assert not defects, defects[0]
        robots = house.server.robots()
        assert robots[HONEST].connected and robots[HONEST].sessions == 1
        assert [robot.defects for robot in robots.values()] == [0, 0]
        wild.close()
        sock.close()
