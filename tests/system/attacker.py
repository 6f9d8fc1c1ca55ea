"""A station on the robots' network: it hears every packet, and forges any.

It knows the protocol, and the published key of those that have none. What robots and host make of
what it sends is the tests' affair. `Attacker` knows what to send; `LoopbackAttacker` is on the
loopback, and needs the right to open raw sockets.
"""

from __future__ import annotations

import contextlib
import os
import socket
import struct
import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from tests.conftest import lack
from tests.wire.strategies import reseal
from vsense.base.native import WireError
from vsense.robots.link.wire import (
    PUBLISHED,
    Header,
    Hello,
    PacketType,
    Wanted,
    encode,
    packet_length,
    session_keys,
    uid_of,
)

ALL_PROTOCOLS = 0x0003
LOCAL = socket.inet_aton("127.0.0.1")
TCP, UDP = 6, 17
SEQUENCE_AT, CAPTURE_AT, WANTED_AT, FROM_AT = 12, 24, 56, 60
AHEAD_NS = 20_000_000
REMEMBERED = 5000


@dataclass
class Heard:
    """What was heard of one session.

    Attributes:
        host, robot: their ports for datagrams.
        down, up: addresses from and to of datagrams to the robot, and to the host.
        hello, welcome: the packets that opened it, b"": they were missed.
        state, telemetry: the newest datagrams.
    """

    host: int = 0
    robot: int = 0
    down: bytes = LOCAL + LOCAL
    up: bytes = LOCAL + LOCAL
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
    """Hears whatever IP packet `hear` is given, and sends with `mouth`.

    Attributes:
        port: the host's; what others on this machine do is let alone.
        mouth: sends an IP packet.
        sessions: what was heard, by the session's number.
        datagrams: the newest that were heard by UDP: addresses and ports from and to, and a packet.
        hellos: greetings that were heard.
        sent: how many datagrams it has sent.
    """

    port: int
    mouth: Callable[[bytes], object]
    sessions: dict[int, Heard] = field(default_factory=dict)
    datagrams: list[tuple[bytes, int, int, bytes]] = field(default_factory=list)
    hellos: list[bytes] = field(default_factory=list)
    sent: int = 0
    _greetings: dict[int, bytes] = field(default_factory=dict)

    def spoof(self, way: bytes, source: int, target: int, packet: bytes) -> None:
        """A datagram from anybody's port to anybody's."""
        udp = struct.pack("!HHHH", source, target, 8 + len(packet), 0) + packet
        head = struct.pack("!BBHHHBBH8s", 0x45, 0, 20 + len(udp), 0, 0, 64, UDP, 0, way)
        total = sum(struct.unpack("!10H", head))
        total = (total & 0xFFFF) + (total >> 16)
        checksum = ~((total & 0xFFFF) + (total >> 16)) & 0xFFFF
        with contextlib.suppress(OSError):
            self.mouth(head[:10] + struct.pack("!H", checksum) + head[12:] + udp)
        self.sent += 1

    def drive(self, session: Heard, ahead: int, wanted: Wanted = Wanted.RUN) -> None:
        """Tells a robot what to do, in the host's name, `ahead` of the host's packets."""
        if not session.state:
            return
        made = bytearray(session.state)
        (sequence,) = struct.unpack_from("<I", made, SEQUENCE_AT)
        (capture_ns,) = struct.unpack_from("<Q", made, CAPTURE_AT)
        struct.pack_into("<I", made, SEQUENCE_AT, min(sequence + ahead, 2**32 - 2))
        struct.pack_into("<Q", made, CAPTURE_AT, capture_ns + AHEAD_NS)
        struct.pack_into("<I", made, FROM_AT, 0)
        made[WANTED_AT] = wanted
        for key in {session.keys[0], PUBLISHED}:
            self.spoof(session.down, session.host, session.robot, reseal(bytes(made), key))
        self.spoof(session.down, session.host, session.robot, bytes(made))

    def deafen(self, session: Heard, ahead: int) -> None:
        """Speaks to the host in a robot's name, far ahead of the robot."""
        if not session.telemetry:
            return
        made = bytearray(session.telemetry)
        (sequence,) = struct.unpack_from("<I", made, SEQUENCE_AT)
        struct.pack_into("<I", made, SEQUENCE_AT, min(sequence + ahead, 2**32 - 2))
        for key in {session.keys[1], PUBLISHED}:
            self.spoof(session.up, session.robot, session.host, reseal(bytes(made), key))
        self.spoof(session.up, session.robot, session.host, bytes(made))

    def replay(self, last: int) -> None:
        """Sends the newest datagrams that were heard once more, both ways."""
        for heard in self.datagrams[-last:]:
            self.spoof(*heard)

    def greet_again(self, host: str = "127.0.0.1") -> list[socket.socket]:
        """Greets the host with everything that any robot greeted with."""
        made = []
        for hello in self.hellos[:20]:
            sock = socket.create_connection((host, self.port), 5)
            sock.sendall(hello)
            made.append(sock)
        return made

    def squat(self, tags: Iterable[int], host: str = "127.0.0.1") -> list[socket.socket]:
        """Greets the host as the robots with these tags: with a uid of its own, and heard ones."""
        uids = {uid_of(hello) for hello in self.hellos}
        made = []
        for tag in tags:
            for uid in [os.urandom(16), *sorted(uids)[:3]]:
                hello = encode(Header(PacketType.HELLO), Hello(uid, tag, "squatter", "spin"))
                sock = socket.create_connection((host, self.port), 5)
                sock.sendall(hello)
                made.append(sock)
        return made

    def hear(self, packet: bytes) -> None:
        """Takes an IP packet."""
        if len(packet) > 28 and packet[0] >> 4 == 4 and packet[9] in (TCP, UDP):
            self._hear(packet[9], packet[12:20], packet[4 * (packet[0] & 15) :])

    def _hear(self, kind: int, way: bytes, segment: bytes) -> None:
        source, target = struct.unpack_from("!HH", segment)
        data = segment[8:] if kind == UDP else segment[4 * (segment[12] >> 4) :]
        if self.port not in (source, target) or data[:3] != b"VS\3" or len(data) < 72:
            return
        with contextlib.suppress(WireError):
            packet = data[: packet_length(data) or len(data)]
            self._note(kind, way, source, target, packet)

    def _note(self, kind: int, way: bytes, source: int, target: int, packet: bytes) -> None:
        heard = self.sessions.setdefault(struct.unpack_from("<I", packet, 8)[0], Heard())
        if packet[3] == PacketType.HELLO:
            self._greetings[source] = packet
            self.hellos.append(packet)
        elif packet[3] == PacketType.WELCOME:
            heard.hello, heard.welcome = self._greetings.get(target, b""), packet
        if kind != UDP:
            return
        self.datagrams.append((way, source, target, packet))
        del self.datagrams[:-REMEMBERED]
        if packet[3] == PacketType.STATE:
            heard.down, heard.host, heard.robot, heard.state = way, source, target, packet
        elif packet[3] == PacketType.TELEMETRY:
            heard.up, heard.telemetry = way, packet


class LoopbackAttacker(Attacker):
    """Hears all that passes on this machine's loopback, from when it is made until `close`."""

    def __init__(self, port: int) -> None:
        try:
            self._ears = socket.socket(
                socket.AF_PACKET, socket.SOCK_DGRAM, socket.htons(ALL_PROTOCOLS)
            )
            self._ears.bind(("lo", ALL_PROTOCOLS))
            self._mouth = socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_RAW)
        except PermissionError:
            lack("no raw sockets here: run as root")
        super().__init__(port, lambda packet: self._mouth.sendto(packet, ("127.0.0.1", 0)))
        self._ended = False
        self._ears.settimeout(0.1)
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._ended = True
        self._thread.join()
        self._ears.close()
        self._mouth.close()

    def _listen(self) -> None:
        while not self._ended:
            try:
                packet, where = self._ears.recvfrom(65536)
            except TimeoutError:
                continue
            if where[2] == socket.PACKET_OUTGOING:
                self.hear(packet)
