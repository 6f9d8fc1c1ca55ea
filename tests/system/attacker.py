"""A station on the robots' network: it hears every packet on the loopback, and forges any.

It knows the protocol, and the published key of those that have none. What robots and host make of
what it sends is the tests' affair. It needs the right to open raw sockets.
"""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
from dataclasses import dataclass, field

from tests.conftest import lack
from tests.wire.strategies import reseal
from vsense.link.robots.wire import PUBLISHED, PacketType, Wanted, packet_length, session_keys
from vsense.native import WireError

ALL_PROTOCOLS = 0x0003
TCP, UDP = 6, 17
SEQUENCE_AT, CAPTURE_AT, WANTED_AT, FROM_AT = 12, 24, 56, 60
AHEAD_NS = 20_000_000


@dataclass
class Heard:
    """What was heard of one session.

    Attributes:
        host, robot: their ports for datagrams.
        hello, welcome: the packets that opened it, b"": they were missed.
        state, telemetry: the newest datagrams.
    """

    host: int = 0
    robot: int = 0
    hello: bytes = b""
    welcome: bytes = b""
    state: bytes = b""
    telemetry: bytes = b""

    @property
    def keys(self) -> tuple[bytes, bytes]:
        """Down and up, as they are for a robot without a key."""
        if not self.hello:
            return PUBLISHED, PUBLISHED
        return session_keys(PUBLISHED, self.hello, self.welcome)


@dataclass
class Attacker:
    """Hears from when it is made until `close`.

    Attributes:
        port: the host's; what others on this machine do is let alone.
        sessions: what was heard, by the session's number.
        datagrams: everything that was heard by UDP: ports from and to, and the packet.
        hellos: greetings that were heard.
        sent: how many datagrams it has sent.
    """

    port: int
    sessions: dict[int, Heard] = field(default_factory=dict)
    datagrams: list[tuple[int, int, bytes]] = field(default_factory=list)
    hellos: list[bytes] = field(default_factory=list)
    sent: int = 0
    _greetings: dict[int, bytes] = field(default_factory=dict)
    _ended: bool = False

    def __post_init__(self) -> None:
        try:
            self._ears = socket.socket(
                socket.AF_PACKET, socket.SOCK_DGRAM, socket.htons(ALL_PROTOCOLS)
            )
            self._ears.bind(("lo", ALL_PROTOCOLS))
            self._mouth = socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_RAW)
        except PermissionError:
            lack("no raw sockets here: run as root")
        self._ears.settimeout(0.1)
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._ended = True
        self._thread.join()
        self._ears.close()
        self._mouth.close()

    def spoof(self, source: int, target: int, packet: bytes) -> None:
        """A datagram from any port of this machine to any other."""
        udp = struct.pack("!HHHH", source, target, 8 + len(packet), 0) + packet
        local = socket.inet_aton("127.0.0.1")
        head = struct.pack("!BBHHHBBH4s4s", 0x45, 0, 20 + len(udp), 0, 0, 64, UDP, 0, local, local)
        with contextlib.suppress(OSError):
            self._mouth.sendto(head + udp, ("127.0.0.1", 0))
        self.sent += 1

    def drive(self, session: Heard, ahead: int) -> None:
        """Tells a robot to run, in the host's name, `ahead` of the host's packets."""
        if not session.state:
            return
        made = bytearray(session.state)
        (sequence,) = struct.unpack_from("<I", made, SEQUENCE_AT)
        (capture_ns,) = struct.unpack_from("<Q", made, CAPTURE_AT)
        struct.pack_into("<I", made, SEQUENCE_AT, min(sequence + ahead, 2**32 - 2))
        struct.pack_into("<Q", made, CAPTURE_AT, capture_ns + AHEAD_NS)
        struct.pack_into("<I", made, FROM_AT, 0)
        made[WANTED_AT] = Wanted.RUN
        for key in {session.keys[0], PUBLISHED}:
            self.spoof(session.host, session.robot, reseal(bytes(made), key))
        self.spoof(session.host, session.robot, bytes(made))

    def deafen(self, session: Heard, ahead: int) -> None:
        """Speaks to the host in a robot's name, far ahead of the robot."""
        if not session.telemetry:
            return
        made = bytearray(session.telemetry)
        (sequence,) = struct.unpack_from("<I", made, SEQUENCE_AT)
        struct.pack_into("<I", made, SEQUENCE_AT, min(sequence + ahead, 2**32 - 2))
        for key in {session.keys[1], PUBLISHED}:
            self.spoof(session.robot, session.host, reseal(bytes(made), key))
        self.spoof(session.robot, session.host, bytes(made))

    def replay(self, last: int) -> None:
        """Sends the newest datagrams that were heard once more, both ways."""
        for source, target, packet in self.datagrams[-last:]:
            self.spoof(source, target, packet)

    def greet_again(self) -> list[socket.socket]:
        """Greets the host with everything that any robot greeted with."""
        made = []
        for hello in self.hellos[:20]:
            sock = socket.create_connection(("127.0.0.1", self.port), 5)
            sock.sendall(hello)
            made.append(sock)
        return made

    def _listen(self) -> None:
        while not self._ended:
            try:
                frame, where = self._ears.recvfrom(65536)
            except TimeoutError:
                continue
            if where[2] == socket.PACKET_OUTGOING and len(frame) > 28 and frame[0] >> 4 == 4:
                size = 4 * (frame[0] & 15)
                if frame[9] in (TCP, UDP):
                    self._hear(frame[9], frame[size:])

    def _hear(self, kind: int, segment: bytes) -> None:
        source, target = struct.unpack_from("!HH", segment)
        data = segment[8:] if kind == UDP else segment[4 * (segment[12] >> 4) :]
        if self.port not in (source, target) or data[:3] != b"VS\2" or len(data) < 72:
            return
        with contextlib.suppress(WireError):
            packet = data[: packet_length(data) or len(data)]
            self._note(kind, source, target, packet)

    def _note(self, kind: int, source: int, target: int, packet: bytes) -> None:
        heard = self.sessions.setdefault(struct.unpack_from("<I", packet, 8)[0], Heard())
        if packet[3] == PacketType.HELLO:
            self._greetings[source] = packet
            self.hellos.append(packet)
        elif packet[3] == PacketType.WELCOME:
            heard.hello, heard.welcome = self._greetings.get(target, b""), packet
        if kind != UDP:
            return
        self.datagrams.append((source, target, packet))
        if packet[3] == PacketType.STATE:
            heard.host, heard.robot, heard.state = source, target, packet
        elif packet[3] == PacketType.TELEMETRY:
            heard.telemetry = packet
