"""The host's view of one robot: sequences, acceptance filter, counters, echoes (`vs_peer.h`).

`Presence` judges from times alone whether a robot is there, and whether UDP reaches it. A robot
that is gone and one whose datagrams are blocked look alike at first; what still comes over TCP
distinguishes them. A robot that was just welcomed may try UDP for a second before it uses TCP.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from vsense.base.native import ffi, lib
from vsense.robots.link.status import EventKind
from vsense.robots.link.table import STAY, Direction, Goal, Output, Table, numbers_of, text_of
from vsense.robots.link.wire import (
    DATAGRAM_MAX,
    NEVER_US,
    TELEMETRY_NUMBERS,
    Header,
    Hello,
    Notice,
    ReadingValues,
    Telemetry,
    Wanted,
    Welcome,
    answer_key,
    encode,
    header_of,
    header_to,
    open_packet,
    session_keys,
    shown_of,
)


@dataclass(frozen=True, slots=True)
class Orders:
    """What the host wants of all robots, repeated in every STATE.

    `run` is the run's number, which never goes down. With RUN, `from_timestep` is the first
    timestep in which the robots run; those of `resting` stand meanwhile. Those of `held`, which has
    why by tag, stand as in a pause, with HOME, too: they go on in the same run.
    """

    run: int = 1
    wanted: Wanted = Wanted.IDLE
    from_timestep: int = 0
    resting: frozenset[int] = frozenset()
    held: Mapping[int, str] = field(default_factory=dict)

    def of(self, tag: int) -> Orders:
        """What the robot with a tag is told."""
        if self.wanted == Wanted.RUN and tag in self.resting:
            return replace(self, wanted=Wanted.IDLE)
        stands = self.wanted in (Wanted.RUN, Wanted.HOME) and tag in self.held
        return replace(self, wanted=Wanted.PAUSE) if stands else self


SEQUENCE_RESERVE = 1000
"""Sequence numbers that are kept for the time between noticing that they run out and the end."""


@dataclass(frozen=True, slots=True)
class Greeting:
    """A HELLO whose tag was right.

    Attributes:
        packet: the whole HELLO.
        root: what the session's keys are made of.
        key: number of the swarm key that this is made of; None: the robot has no key.
        origin: where the robot is, for people.
        note: what else to say of the robot once it is there.
        other_program: which it runs in place of the file's, in words; "": it runs the file's.
    """

    packet: bytes
    header: Header
    hello: Hello
    root: bytes
    key: int | None
    origin: str
    note: str = ""
    other_program: str = ""


class Peer:
    """One robot's bookkeeping over all its sessions; its counters never go down.

    Attributes:
        fault: why the newest packet that came was dropped, a negative `enum vs_err`; 0: it was not.
    """

    def __init__(self) -> None:
        self._peer = ffi.new("struct vs_peer *")
        lib.vs_peer_init(self._peer)
        self._counted = ffi.addressof(self._peer, "counters")
        self._table = Table()
        self._sensors: list[tuple[int, int]] = []
        self._put: tuple[ReadingValues, int] | None = None
        self._header = ffi.new("struct vs_header *")
        self._state = ffi.new("struct vs_state *")
        self._payload = ffi.buffer(self._state.payload)
        self._telemetry = ffi.new("struct vs_telemetry *")
        self.fault = 0
        self._output = Output(DATAGRAM_MAX)

    def open(self, session: int, table: Table, hello_send_ns: int, now_ns: int) -> None:
        """Opens a session, whose number is not 0 and was never used before by this host.

        `hello_send_ns` is the send time in the HELLO's header, the robot's clock; `now_ns`, the
        host's, when it came.
        """
        self._table, self._put = table, None
        self._sensors = [(offset, size) for _, offset, size in table.of_direction(Direction.SENSOR)]
        lib.vs_peer_open(self._peer, session, table.hash, hello_send_ns, now_ns)

    def set_keys(self, sent: bytes, received: bytes) -> None:
        """Sets the keys of what is sent and of what comes in the open session."""
        lib.vs_peer_set_keys(self._peer, sent, received)

    def adopt(self, proved: Peer) -> None:
        """Goes on with the session of another peer, which was only now proved; counts go on."""
        lib.vs_peer_adopt(self._peer, proved._peer)
        self._table, self._sensors, self._put = proved._table, proved._sensors, None

    def welcome(
        self, root: bytes, hello: bytes, header: Header, message: Welcome, now_ns: int
    ) -> bytes:
        """Answers the HELLO that the session was opened for, and sets the session's keys.

        They are made of `root`, the robot's own key or the published one.

        Raises:
            WireError: a field of the message is outside its range.
        """
        key = answer_key(root, hello)
        self.set_keys(key, key)
        packet = self.encode(header, message, now_ns)
        self.set_keys(*session_keys(root, hello, packet))
        return packet

    def close(self) -> None:
        """Ends the session: every packet is foreign from now on."""
        lib.vs_peer_close(self._peer)

    def encode(self, header: Header, message: Hello | Welcome | Notice, now_ns: int) -> bytes:
        """Makes a packet for TCP; session, table hash, times, flags and tag are filled in.

        Raises:
            WireError: a field of the message is outside its range.
        """
        stamped = header_to(header)
        lib.vs_peer_stamp(self._peer, now_ns, stamped)
        return encode(header_of(stamped), message, bytes(self._peer.tx_key))

    def send_state(
        self,
        orders: Orders,
        timestep: int,
        capture_ns: int,
        values: ReadingValues,
        now_ns: int,
        log_heard: int = 0,
        goal: Goal = STAY,
    ) -> bytes:
        """Makes the next STATE packet; send the same bytes on every path it is to take.

        The arena was seen at `capture_ns`, host's clock; `values` are in the table's order;
        `log_heard` is the number of the robot's newest log line that has come; `goal` counts with
        HOME.

        Raises:
            WireError: no session is open, or VS_ERR_SEQUENCE: renew the session.
            ValueError: the values do not fit the table.
        """
        self._put_values(values, capture_ns)
        self._state.wanted, self._state.from_timestep = orders.wanted, orders.from_timestep
        self._state.log_heard = log_heard
        to = goal if orders.wanted == Wanted.HOME else STAY
        self._state.goal_x_mm, self._state.goal_y_mm, self._state.goal_heading = to
        header = self._header
        header.run, header.timestep, header.capture_ns = orders.run, timestep, capture_ns
        code = lib.vs_peer_send_state(
            self._peer, self._table.cdata, header, self._state, now_ns, *self._output.arguments
        )
        return self._output.packet(code)

    def _put_values(self, values: ReadingValues, capture_ns: int) -> None:
        put = self._put
        if put is not None and put[0] is values and put[1] == capture_ns:
            return  # a heartbeat says again what was said
        self._put = None
        if len(values) != len(self._sensors):
            raise ValueError(f"{len(values)} values for {len(self._sensors)} sensors")
        for rank, ((offset, size), (payload, value_ns)) in enumerate(zip(self._sensors, values)):
            if len(payload) != size:
                raise ValueError(f"sensor {rank}: {len(payload)} bytes, expected {size}")
            self._payload[offset : offset + size] = payload
            self._state.older_us[rank] = older_us(capture_ns, value_ns)
        self._put = values, capture_ns

    def receive_telemetry(
        self, packet: bytes, udp: bool, now_ns: int
    ) -> tuple[Header, Telemetry] | None:
        """Passes one whole packet through the acceptance filter; None if it was dropped.

        It came as a datagram (`udp`) or over TCP, at `now_ns`, host's clock.
        """
        via = lib.VS_VIA_UDP if udp else lib.VS_VIA_TCP
        code = lib.vs_peer_receive_telemetry(
            self._peer,
            self._table.cdata,
            via,
            ffi.from_buffer(packet),
            len(packet),
            now_ns,
            self._header,
            self._telemetry,
        )
        self.fault = int(code)
        if code < 0:
            return None
        payload = bytes(ffi.buffer(self._telemetry.payload, self._table.cdata.actuator_bytes))
        return header_of(self._header), telemetry_of(self._telemetry, payload)

    def open_packet(self, packet: bytes) -> tuple[Header, bytes]:
        """Checks frame and tag of a packet of the open session; gives its header and body.

        Raises:
            WireError: it is no valid packet, or of another session.
        """
        return open_packet(packet, bytes(self._peer.rx_key))

    def udp_silent(self, now_ns: int) -> bool:
        """Whether no datagram of the open session was heard for 1 s."""
        return bool(lib.vs_peer_udp_silent(self._peer, now_ns))

    def over_tcp(self, now_ns: int) -> bool:
        """Whether state must go over TCP as well as UDP: either end hears no UDP."""
        return bool(lib.vs_peer_over_tcp(self._peer, now_ns))

    @property
    def session(self) -> int:
        """Number of the open session, 0 if none is."""
        return int(self._peer.session)

    @property
    def sent(self) -> int:
        """STATE packets that were sent so far."""
        return int(self._peer.counters.sent)

    @property
    def udp_heard(self) -> bool:
        """Whether a datagram of the open session has come."""
        return bool(self._peer.udp_heard)

    @property
    def worn(self) -> bool:
        """Whether the session has hardly a sequence number left: it must be renewed."""
        return bool(self._peer.tx_sequence > lib.VS_SEQUENCE_MAX - SEQUENCE_RESERVE)

    @property
    def counters(self) -> dict[str, int]:
        """STATE packets `sent`, packets `received`, `accepted`, and not accepted by reason."""
        return counters_of(self._counted)


_COUNTERS = tuple(name for name, _ in ffi.typeof("struct vs_counters").fields)
_COUNTER_NUMBERS = numbers_of("struct vs_counters", _COUNTERS)


def counters_of(cdata: Any) -> dict[str, int]:
    """Copies what a `struct vs_counters *` is of: `received` is `accepted` and all after it."""
    return dict(zip(_COUNTERS, _COUNTER_NUMBERS.unpack_from(ffi.buffer(cdata))))


def older_us(capture_ns: int, value_ns: int) -> int:
    """How much older than the header's capture time a value is, as STATE gives it [us].

    A negative `value_ns` was never measured.
    """
    if value_ns < 0:
        return NEVER_US
    return min(max(capture_ns - value_ns, 0) // 1000, NEVER_US - 1)


def telemetry_of(cdata: Any, payload: bytes) -> Telemetry:
    """Copies a `struct vs_telemetry`."""
    numbers = TELEMETRY_NUMBERS.unpack_from(ffi.buffer(cdata))
    log = text_of(cdata.log) if cdata.log_number else ""
    shown = shown_of(bytes(cdata.shown[0 : cdata.shown_len])) if cdata.shown_len else ()
    return Telemetry._make((*numbers, payload, log, shown))


LOST_AFTER_NS = 1_000_000_000
"""A robot that was not heard for this long is lost, and its tag is free for another one."""

PresenceChange = tuple[EventKind, str]
"""What has changed, and how to say it."""


class Presence:
    """Whether one robot is there, over all its sessions.

    Attributes:
        since_ns: when the newest session opened, host's clock; None before the first.
        heard_ns: when the newest valid packet came, same clock.
        lost: the open session has fallen silent, and that was reported.
        left: the robot said goodbye after its newest session.
        starts: its daemon was started so often, as far as it was heard.
    """

    def __init__(self) -> None:
        self.since_ns: int | None = None
        self.heard_ns: int | None = None
        self.lost = False
        self.left = False
        self.starts = 0
        self._started: int | None = None
        self._udp = True

    def open(self, now_ns: int, started: int) -> None:
        """A session opens, of a daemon that says when it was `started`."""
        self.starts += started != self._started
        self._started = started
        self.since_ns = self.heard_ns = now_ns
        self.lost = self.left = False
        self._udp = True

    def holds(self, now_ns: int) -> bool:
        """Whether the robot holds its tag against others: it was just heard and did not leave."""
        return not self.left and self._recent(now_ns)

    def hear(self, peer: Peer, now_ns: int) -> list[PresenceChange]:
        """A packet of the open session was accepted."""
        self.heard_ns = now_ns
        changes: list[PresenceChange] = [("back", "heard again")] if self.lost else []
        self.lost = False
        return changes + self._watch_udp(peer, now_ns)

    def tick(self, peer: Peer, now_ns: int) -> list[PresenceChange]:
        """Time has passed in the open session."""
        if self.lost:
            return []
        changes = self._watch_udp(peer, now_ns)
        if now_ns - self._counted_from_ns(peer) >= LOST_AFTER_NS:
            self.lost = True
            changes.append(("lost", "nothing heard for 1 s"))
        return changes

    def _recent(self, now_ns: int) -> bool:
        return self.heard_ns is not None and now_ns - self.heard_ns < LOST_AFTER_NS

    def _counted_from_ns(self, peer: Peer) -> int:
        """Since when silence counts: the first second belongs to the attempt at UDP."""
        assert self.heard_ns is not None and self.since_ns is not None
        if peer.udp_heard:
            return self.heard_ns
        return max(self.heard_ns, self.since_ns + LOST_AFTER_NS)

    def _watch_udp(self, peer: Peer, now_ns: int) -> list[PresenceChange]:
        udp = not peer.over_tcp(now_ns)
        if udp == self._udp:
            return []
        if not udp and peer.udp_heard and not self._recent(now_ns):
            return []  # silent on every way: `tick` reports that
        self._udp = udp
        if udp:
            return [("udp_back", "UDP works again")]
        who = "no UDP from it" if peer.udp_silent(now_ns) else "it hears no UDP from us"
        return [("no_udp", f"{who} for 1 s: state goes over TCP")]
