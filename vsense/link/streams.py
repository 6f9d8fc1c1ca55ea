"""One robot's TCP stream without its socket: bytes in, packets out, and the other way round.

What comes in is cut into packets and bounded by one packet; what goes out is a few packets in
order and, of STATE, the newest only: a slow stream holds old readings nowhere but in the
kernel, and never more than a handful of kilobytes here.
"""

from __future__ import annotations

from collections import deque

from vsense.link.wire import PACKET_MAX, packet_length


class Inbox:
    """Cuts received bytes into packets, however the network chunked them."""

    def __init__(self) -> None:
        self._bytes = bytearray()

    @property
    def room(self) -> int:
        """How many bytes may be fed before the next packet is taken out, at least 1."""
        return PACKET_MAX - len(self._bytes)

    def feed(self, data: bytes) -> None:
        """Appends received bytes, at most `room` of them."""
        if len(data) > self.room:
            raise ValueError(f"{len(data)} bytes for an inbox with room for {self.room}")
        self._bytes += data

    def next(self) -> bytes | None:
        """Takes the next whole packet out, or returns None until more bytes have come.

        Raises:
            WireError: the bytes are no vsense packet; the stream is lost.
        """
        length = packet_length(self._bytes)
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
