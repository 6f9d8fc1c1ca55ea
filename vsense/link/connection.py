"""One accepted TCP connection: a non-blocking socket with its inbox and outbox.

No method waits, and no trouble of the socket leaves this module as an exception: it comes back
as a reason in words, so that one robot's broken connection is one robot's event.
"""

from __future__ import annotations

import contextlib
import socket

from vsense.link.session import HostSession
from vsense.link.streams import Inbox, Outbox
from vsense.link.wire import DATAGRAM_MAX

SEND_BUFFER = 16_384
"""Bytes that the kernel may hold for a slow peer: with more, old readings would pile up there."""

DISCARD = 4096
"""Bytes that are read and thrown away at a time, once the host has ended the conversation."""


def prepare(sock: socket.socket, most_unsent: int) -> None:
    """Makes an accepted socket one that never waits and holds little of what is old.

    Args:
        sock: the socket.
        most_unsent: bytes that may wait unsent in the kernel before it takes no more.
    """
    sock.setblocking(False)
    with contextlib.suppress(OSError):
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, most_unsent)


class Connection:
    """A robot's TCP connection, or that of somebody who has not greeted yet.

    Attributes:
        sock: the socket.
        origin: the peer's address without its port, for people.
        inbox: received bytes.
        outbox: what is still to be written.
        robot: whose session this carries; None before the greeting and after the session's end.
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
        self.deadline_ns = deadline_ns
        self.finishing = False
        self.broken = ""
        # At most one STATE waits unsent in the kernel; a newer one replaces it here, not there.
        prepare(sock, DATAGRAM_MAX)

    def read(self) -> bool:
        """Moves what has come into the inbox, one system call's worth; sets `broken` at the end.

        Returns:
            Whether there is anything new in the inbox.
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
        """Ends the conversation: one last packet, then the end of the stream.

        The socket stays open until the peer has closed its side, so that unread bytes of the
        peer do not make the kernel reset the connection before the last packet was read.

        Args:
            last: REFUSE or GOODBYE; may be empty.
            deadline_ns: when it is closed even if the peer keeps it open.
        """
        self.robot = None
        self.finishing = True
        self.deadline_ns = deadline_ns
        self.outbox.drop_state()
        if last:
            self.outbox.put(last)
        self.write()

    def close(self) -> None:
        """Closes the socket."""
        self.sock.close()
