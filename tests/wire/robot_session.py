"""The robot's end of the protocol, the very C code that the daemon runs.

Sans-I/O: bytes and the robot's clock [ns] go in, bytes and events come out.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum
from itertools import count
from typing import Any

from vsense.base.native import check, ffi, lib
from vsense.robots.link._peer import counters_of
from vsense.robots.link.table import Output, Table, text_of
from vsense.robots.link.wire import (
    DATAGRAM_MAX,
    PACKET_MAX,
    TELEMETRY_FIELDS,
    GoodbyeCause,
    Header,
    Notice,
    Telemetry,
    open_packet,
    put_text,
)

_NONCES = count(1)


def next_nonce() -> bytes:
    """One that no other greeting of this process has."""
    return next(_NONCES).to_bytes(16, "little")


class Event(IntEnum):
    """What a call of the session brought."""

    NONE = lib.VS_EV_NONE
    OPEN = lib.VS_EV_OPEN
    STATE = lib.VS_EV_STATE
    REFUSED = lib.VS_EV_REFUSED
    GOODBYE = lib.VS_EV_GOODBYE
    UDP_LOST = lib.VS_EV_UDP_LOST
    UDP_UP = lib.VS_EV_UDP_UP
    DOUBTED = lib.VS_EV_DOUBTED


class RobotSession:
    """A robot's session (`vs_session.h`).

    Attributes:
        c: the `struct vs_session`, for reading its fields.
    """

    def __init__(
        self,
        uid: bytes,
        tag: int,
        name: str = "robot",
        controller: str = "test",
        key: bytes | None = None,
    ) -> None:
        """Prepares a robot that is not connected, with its own key or none.

        Raises:
            WireError: name or controller is no clean text of at most 31 bytes.
        """
        config = ffi.new("struct vs_session_config *", {"uid": uid, "tag": tag, "started": 5})
        if key is not None:
            config.keyed, config.key = 1, key
        put_text(config.name, name)
        put_text(config.controller, controller)
        put_text(config.version, "9.9")
        put_text(config.hash, "abc")
        self.c = ffi.new("struct vs_session *")
        self._event = ffi.new("enum vs_event *")
        self._used = ffi.new("size_t *")
        check(lib.vs_session_init(self.c, config))

    def connect(self, now_ns: int, nonce: bytes = b"", uptime_s: int = 60) -> bytes:
        """TCP is up; gives the HELLO, without a nonce with one that no other has."""
        lib.vs_session_connected(self.c, nonce or next_nonce(), uptime_s)
        return self.tcp_out(now_ns)

    def disconnect(self) -> None:
        """TCP is gone."""
        lib.vs_session_disconnected(self.c)

    def tcp_in(self, data: bytes, now_ns: int) -> list[Event]:
        """Takes TCP bytes in one chunk.

        Raises:
            WireError: the host broke the protocol; the session is closed.
        """
        events = []
        rest = data
        while rest:
            code = lib.vs_session_tcp_in(self.c, rest, len(rest), now_ns, self._used, self._event)
            check(code)
            rest = rest[self._used[0] :]
            events.append(Event(self._event[0]))
        return [event for event in events if event != Event.NONE]

    def tcp_out(self, now_ns: int) -> bytes:
        """The packet due on TCP, b"" if none is."""
        out = Output(PACKET_MAX)
        buf, size, length = out.arguments
        return out.packet(lib.vs_session_tcp_out(self.c, buf, size, now_ns, length))

    def udp_in(self, datagram: bytes, now_ns: int) -> tuple[int, Event]:
        """Takes a datagram; gives 0 or the error why it was dropped, and the event."""
        code = lib.vs_session_udp_in(self.c, datagram, len(datagram), now_ns, self._event)
        return int(code), Event(self._event[0])

    def tick(self, now_ns: int) -> Event:
        """Lets time pass."""
        lib.vs_session_tick(self.c, now_ns, self._event)
        return Event(self._event[0])

    def telemetry(self, now_ns: int, telemetry: Telemetry | None = None) -> bytes:
        """One TELEMETRY packet; the session fills in what it knows itself.

        Raises:
            WireError: no session is open, or VS_ERR_SEQUENCE.
        """
        said = telemetry or Telemetry(payload=bytes(self.c.table.actuator_bytes))
        out = Output(DATAGRAM_MAX)
        values: dict[str, Any] = {name: getattr(said, name) for name in TELEMETRY_FIELDS}
        report = ffi.new("struct vs_telemetry *", {**values, "payload": said.payload})
        put_text(report.log, said.log)
        length = ffi.addressof(report, "shown_len")
        for name, value in said.shown:
            text, number = (value.encode(), 0.0) if isinstance(value, str) else (ffi.NULL, value)
            check(lib.vs_shown_set(report.shown, length, name.encode(), number, text))
        return out.packet(lib.vs_session_telemetry(self.c, report, now_ns, *out.arguments))

    def over_tcp(self, now_ns: int) -> bool:
        """Whether telemetry must also go over TCP."""
        return bool(lib.vs_session_over_tcp(self.c, now_ns))

    def goodbye(self, cause: GoodbyeCause, text: str, now_ns: int) -> bytes:
        """Ends the session; gives the GOODBYE.

        Raises:
            WireError: no session is open.
        """
        check(lib.vs_session_goodbye(self.c, cause, text.encode()))
        return self.tcp_out(now_ns)

    def value(self, name: str) -> tuple[bytes, int] | None:
        """Newest value of a sensor and its capture time on the host's clock; None: never measured.

        Raises:
            WireError: the table has no sensor of that name.
        """
        value = ffi.new("struct vs_value *")
        index = check(lib.vs_table_find(ffi.addressof(self.c, "table"), name.encode()), name)
        check(lib.vs_session_value(self.c, index, value), name)
        if not value.known:
            return None
        return bytes(ffi.buffer(value.data, value.size)), int(value.capture_ns)

    def age_ns(self, capture_ns: int, now_ns: int) -> int:
        """Age of something captured at capture_ns on the host's clock; 2^64 - 1 if unknown."""
        return int(lib.vs_session_age_ns(self.c, capture_ns, now_ns))

    def clock(self, now_ns: int) -> tuple[int, int] | None:
        """How far the host's clock is ahead, and the bound of that [ns]; None before a sample."""
        offset, bound = ffi.new("int64_t *"), ffi.new("uint64_t *")
        clock = ffi.addressof(self.c, "clock")
        if lib.vs_clock_estimate(clock, now_ns, offset, bound) < 0:
            return None
        return int(offset[0]), int(bound[0])

    def open_packet(self, packet: bytes) -> tuple[Header, bytes]:
        """Reads a packet of the open session, as `wire.open_packet`."""
        return open_packet(packet, bytes(self.c.peer.rx_key))

    @property
    def table(self) -> Table:
        """The sensor table of the newest WELCOME."""
        return Table.of(ffi.addressof(self.c, "table"))

    @property
    def params(self) -> str:
        """The controller's parameters of the newest WELCOME."""
        return text_of(self.c.params)

    @property
    def notice(self) -> Notice:
        """The newest REFUSE or GOODBYE."""
        return Notice(self.c.notice.code, text_of(self.c.notice.text))

    @property
    def counters(self) -> Mapping[str, int]:
        """The acceptance filter's counters: sent, received, accepted and every drop reason."""
        return counters_of(ffi.addressof(self.c.peer, "counters"))
