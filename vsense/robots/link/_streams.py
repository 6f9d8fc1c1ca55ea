"""One robot's TCP stream: received bytes are cut into packets, packets wait to be written.

What comes in is bounded by one packet; what goes out is a few packets in order and, of STATE, the
newest only. No method waits or raises an error of the socket: `Connection.broken` says in words
what happened, so that one robot's broken connection is one robot's event.
"""

from __future__ import annotations

import contextlib
import socket
from collections import deque

from vsense.base.native import check, lib
from vsense.robots.link._session import HostSession, PendingSession
from vsense.robots.link.wire import DATAGRAM_MAX, PacketType, packet_length

VERSION_AT = 2
OLDER_TAG_AT = {1: 80, 2: 100}
"""Where the tag stood in a HELLO of an older version: behind header, uid, nonce and, in the second,
start and uptime."""


class Inbox:
    """Cuts received bytes into packets, however the network chunked them."""

    def __init__(self) -> None:
        self._bytes = bytearray()

    @property
    def room(self) -> int:
        """How many bytes may be fed before the next packet is taken out, at least 1."""
        return DATAGRAM_MAX - len(self._bytes)

    @property
    def older_tag(self) -> int | None:
        """The tag of the robot whose HELLO of an older version of the protocol is here, if any."""
        version, kind = self._bytes[VERSION_AT : VERSION_AT + 2] or (0, 0)
        at = OLDER_TAG_AT.get(version, len(self._bytes))
        if kind != PacketType.HELLO or len(self._bytes) < at + 2:
            return None
        return int.from_bytes(self._bytes[at : at + 2], "little")

    @property
    def newer(self) -> str:
        """What to say where a version of the protocol is here that came after ours, else ""."""
        if len(self._bytes) <= VERSION_AT or self._bytes[VERSION_AT] <= lib.VS_VERSION:
            return ""
        theirs = f"newer than this host (protocol version {self._bytes[VERSION_AT]})"
        return f"its vsensed is {theirs}: bring vsense up to date here"

    def feed(self, data: bytes) -> None:
        """Appends received bytes, at most `room` of them."""
        if len(data) > self.room:
            raise ValueError(f"{len(data)} bytes for an inbox with room for {self.room}")
        self._bytes += data

    def next(self) -> bytes | None:
        """Takes the next whole packet out, or returns None until more bytes have come.

        Raises:
            WireError: the bytes are no packet that a robot sends; the stream is lost.
        """
        length = packet_length(self._bytes)
        if length is not None and length > DATAGRAM_MAX:
            check(lib.VS_ERR_LENGTH, "a robot's packet")  # only WELCOME may be longer
        if length is None or length > len(self._bytes):
            return None
        packet = bytes(self._bytes[:length])
        del self._bytes[:length]
        return packet


class Outbox:
    """What is still to be written: packets in order, and after them the newest STATE."""

    def __init__(self) -> None:
        self._current = memoryview(b"")
        self._ordered: deque[bytes] = deque()
        self._state: bytes | None = None

    def put(self, packet: bytes) -> None:
        """Adds a packet that must arrive: WELCOME, REFUSE or GOODBYE, one of each at most."""
        self._ordered.append(packet)

    def put_state(self, packet: bytes) -> bool:
        """Adds the newest STATE; says whether it replaces one that had not begun to leave."""
        replaced = self._state is not None
        self._state = packet
        return replaced

    def drop_state(self) -> None:
        """Forgets a STATE that has not begun to leave: nothing may follow a GOODBYE."""
        self._state = None

    def chunk(self) -> memoryview:
        """The bytes to write next: the rest of the packet in hand, or a new one; empty if none.

        A packet that has begun to leave is finished first, so a partial write never tears it.
        """
        if not self._current:
            if self._ordered:
                self._current = memoryview(self._ordered.popleft())
            elif self._state is not None:
                self._current, self._state = memoryview(self._state), None
        return self._current

    def wrote(self, count: int) -> None:
        """Says how many bytes of the last `chunk` the kernel took."""
        self._current = self._current[count:]

    def __bool__(self) -> bool:
        """Whether anything is left to write."""
        return bool(self._current) or bool(self._ordered) or self._state is not None


SEND_BUFFER = 16_384
"""Bytes that the kernel may hold for a slow peer: with more, old readings would pile up there."""

DISCARD = 4096
"""Bytes that are read and thrown away at a time, once the host has ended the conversation."""


def prepare(sock: socket.socket, most_unsent: int) -> None:
    """Makes an accepted socket never wait, and the kernel hold at most `most_unsent` bytes."""
    sock.setblocking(False)
    with contextlib.suppress(OSError):
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, most_unsent)


class Connection:
    """A TCP connection of a robot, or of a peer that has not greeted yet.

    Attributes:
        origin: the peer's address without its port, for people.
        robot: whose session this carries; None before it is open and after its end.
        pending: the session that was offered here, until it opens.
        deadline_ns: while robot is None, when the connection is closed at the latest.
        finishing: nothing but the outbox leaves any more, and what comes is thrown away.
        broken: why the socket can no longer be used, "" while it can.
    """

    def __init__(self, sock: socket.socket, origin: str, deadline_ns: int) -> None:
        self.sock = sock
        self.origin = origin
        self.inbox = Inbox()
        self.outbox = Outbox()
        self.robot: HostSession | None = None
        self.pending: PendingSession | None = None
        self.deadline_ns = deadline_ns
        self.finishing = False
        self.broken = ""
        # At most one STATE waits unsent in the kernel; a newer one replaces it here, not there.
        prepare(sock, DATAGRAM_MAX)

    def read(self) -> bool:
        """Moves what has come into the inbox, one system call's worth; sets `broken` at the end.

        Returns whether there is anything new in the inbox.
        """
        try:
            data = self.sock.recv(DISCARD if self.finishing else self.inbox.room)
        except (BlockingIOError, InterruptedError):
            return False
        except OSError as error:
            self.broken = f"broke: {error.strerror}"
            return False
        if not data:
            self.broken = "was closed"
            return False
        if not self.finishing:
            self.inbox.feed(data)
        return not self.finishing

    def write(self) -> None:
        """Writes as much of the outbox as the kernel takes now; sets `broken` on an error."""
        if self.broken:
            return
        try:
            while chunk := self.outbox.chunk():
                self.outbox.wrote(self.sock.send(chunk))
            if self.finishing:
                self.sock.shutdown(socket.SHUT_WR)
        except (BlockingIOError, InterruptedError):
            return
        except OSError as error:
            self.broken = f"broke: {error.strerror}"

    def finish(self, last: bytes, deadline_ns: int) -> None:
        """Ends the conversation: REFUSE, GOODBYE or no last packet, then the end of the stream.

        The socket stays open until the peer has closed its side, or `deadline_ns`: unread bytes of
        the peer must not make the kernel reset the connection before the last packet was read.
        """
        self.robot = None
        self.finishing = True
        self.deadline_ns = deadline_ns
        self.outbox.drop_state()
        if last:
            self.outbox.put(last)
        self.write()

    def close(self) -> None:
        self.sock.close()
