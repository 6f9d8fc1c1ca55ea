"""The host's end of one robot's link, sans-I/O: packets and times in, packets and events out.

One `HostSession` lasts as long as its server and goes through all sessions of one tag, so that
counters, readings and the tag's last holder survive every reconnection.
"""

from __future__ import annotations

from typing import Any

from vsense.link.robots.peer import Change, Orders, Peer, Presence
from vsense.link.robots.status import (
    EventKind,
    LinkEvent,
    LogLines,
    Reporter,
    RobotStatus,
    cut_text,
)
from vsense.link.robots.table import Direction, Table
from vsense.link.robots.wire import (
    GoodbyeCause,
    Header,
    Hello,
    Notice,
    PacketType,
    Telemetry,
    Values,
    Welcome,
)

HEARTBEAT_NS = 50_000_000
"""A STATE leaves at least this often."""

REPEAT_NS = 10_000_000
"""Distance between the three STATE packets that say STOP."""

STOP_PACKETS = 3

_NO_HELLO = Hello(b"", 0, "", "")

Address = tuple[Any, ...]
"""Where datagrams come from and go to, as the socket module says it."""


class HostSession:
    """What the host knows of one robot, and the packets between the two.

    Attributes:
        name: the robot's name in the experiment.
        peer: sequences, acceptance filter and counters of the link.
        address: source of the newest accepted datagram of the open session, None before it.
        due_ns: when the next STATE is due at the latest; of no meaning while no session is open.
        superseded: STATE packets that a newer one replaced in a slow TCP stream.
        unsent: STATE packets that the kernel refused on their only way.
        reporter: what the robot's virtual actuators say.
        refused: why a robot with this tag has been turned away since the last session, or "".
    """

    def __init__(self, tag: int, name: str, table: Table) -> None:
        self.tag = tag
        self.name = name
        self.peer = Peer()
        self.address: Address | None = None
        self.due_ns = 0
        self.superseded = 0
        self.unsent = 0
        self.refused = ""
        self._table = table
        self._uid: bytes | None = None
        self._hello = _NO_HELLO
        self._sessions = 0
        self._presence = Presence()
        self.reporter = Reporter()
        self._log = LogLines()
        self._repeats = 0
        self._repeat_ns = 0
        self._telemetry: Telemetry | None = None
        self._timestep = 0
        self._capture_ns = 0
        self._sizes = [size for _, _, size in table.of_direction(Direction.SENSOR)]
        self._values: Values = []
        self.forget()

    @property
    def label(self) -> str:
        """The robot for people."""
        return f"robot {self.tag} ({self.name})"

    @property
    def open(self) -> bool:
        """Whether a session is open; the robot may be silent in it."""
        return self.peer.session != 0

    def taken_from(self, uid: bytes, now_ns: int) -> bool:
        """Whether another robot than this uid has the tag: just heard, and it did not leave."""
        return self._uid not in (None, uid) and self._presence.holds(now_ns)

    def greet(
        self, session: int, hello: Hello, header: Header, origin: str, now_ns: int
    ) -> LinkEvent:
        """Opens a session in place of the one that was open.

        Args:
            session: its number, not 0 and never used before.
            hello, header: the robot's greeting, not `taken_from` it, and the greeting's header.
            origin: where the robot is, for people.
            now_ns: when the greeting came, host's clock.
        """
        event = self._greeting(hello, origin, now_ns)
        self.peer.open(session, self._table, header.send_ns, now_ns)
        self._uid, self._hello, self.refused = hello.uid, hello, ""
        self.reporter.open(hello.uid)
        self._log.open(hello.uid, hello.started)
        self._sessions += 1
        self._presence.open(now_ns)
        self.due_ns = now_ns
        self.address = None
        return event

    def _greeting(self, hello: Hello, origin: str, now_ns: int) -> LinkEvent:
        where = f"from {origin}, controller {hello.controller or 'unnamed'}"
        if self._uid is None:
            return self._event("connected", f"connected {where}", now_ns)
        if self._uid != hello.uid:
            text = f"connected {where}; it is another robot than before: uid {hello.uid.hex()}"
            return self._event("connected", text, now_ns)
        if self.open and self._presence.holds(now_ns):
            text = f"opened a new session {where}; the old one is closed"
            return self._event("takeover", text, now_ns)
        return self._event("reconnected", f"reconnected {where}", now_ns)

    def welcome(self, welcome: Welcome, orders: Orders, now_ns: int) -> bytes:
        """The answer to the greeting that opened the session."""
        return self.peer.encode(self._header(PacketType.WELCOME, orders.run), welcome, now_ns)

    def goodbye(self, cause: GoodbyeCause, text: str, run: int, now_ns: int) -> bytes:
        """The packet that ends the robot's session; `close` must follow."""
        header = self._header(PacketType.GOODBYE, run)
        return self.peer.encode(header, Notice(cause, cut_text(text)), now_ns)

    def _header(self, kind: PacketType, run: int) -> Header:
        return Header(kind, run=run, timestep=self._timestep, capture_ns=self._capture_ns)

    def close(self) -> None:
        """Ends the session without a packet; every packet is foreign from now on."""
        self.peer.close()
        self.reporter.close()
        self.address = None
        self._repeats = 0

    def broke(self, reason: str, now_ns: int) -> list[LinkEvent]:
        """Ends the session because its connection ended; `lost` unless reported already."""
        known = self._presence.lost
        self.close()
        return [] if known else [self._event("lost", f"its connection {reason}", now_ns)]

    def left(self, notice: Notice, now_ns: int) -> LinkEvent:
        """Ends the session because the robot said goodbye; its tag is free at once."""
        self.close()
        self._presence.left = True
        return self._event("goodbye", f"says goodbye: {notice.text or 'no reason given'}", now_ns)

    def hold(self, timestep: int, capture_ns: int, values: Values | None) -> None:
        """Takes the newest readings, to be repeated until the next ones.

        `values` are in the table's order; None leaves the old ones, which age. The arena was seen
        at `capture_ns`, host's clock.

        Raises:
            ValueError: the readings do not fit the table.
        """
        if values is not None:
            sizes = [len(payload) for payload, _ in values]
            if sizes != self._sizes:
                raise ValueError(f"{self.label}: readings of {sizes} byte, expected {self._sizes}")
            self._values = values
        self._timestep, self._capture_ns = timestep, capture_ns

    def forget(self) -> None:
        """Sets every reading to "never measured": a new run begins."""
        self._timestep = 0
        self._values = [(bytes(size), -1) for size in self._sizes]

    def repeat_stop(self, now_ns: int) -> None:
        """Has two more STATE packets leave soon after the one that said STOP at now_ns."""
        self._repeats = STOP_PACKETS - 1
        self.due_ns = self._repeat_ns = now_ns + REPEAT_NS

    def state(self, orders: Orders, now_ns: int) -> bytes:
        """The next STATE: all readings and the orders; an open session only."""
        packet = self.peer.send_state(
            orders, self._timestep, self._capture_ns, self._values, now_ns, self._log.heard
        )
        self.plan(now_ns)
        return packet

    def plan(self, sent_ns: int) -> None:
        """Sets when the STATE after that of sent_ns is due."""
        # A STATE that leaves in between is no repetition of STOP.
        if self._repeats and sent_ns >= self._repeat_ns:
            self._repeats -= 1
            self._repeat_ns = sent_ns + REPEAT_NS
        self.due_ns = self._repeat_ns if self._repeats else sent_ns + HEARTBEAT_NS

    def by_tcp(self, now_ns: int) -> bool:
        """Whether STATE must go over TCP: no datagram has shown a way yet, or none gets through."""
        return self.address is None or self.peer.over_tcp(now_ns)

    def receive(
        self, header: Header, body: bytes, source: Address | None, now_ns: int
    ) -> tuple[bool, list[LinkEvent]]:
        """Takes one packet that should be TELEMETRY, as `open_packet` gives it.

        `source` is the datagram's, None for TCP; it came at `now_ns`, host's clock. Returns
        whether it was accepted (`peer.counters` says why not), and what that changed.
        """
        telemetry = self.peer.receive_telemetry(header, body, source is not None, now_ns)
        if telemetry is None:
            return False, []
        self._telemetry = telemetry
        self.reporter.receive(header, telemetry, now_ns)
        if source is not None and source != self.address:
            self.address, self.due_ns = source, now_ns
        events = self._told(self._presence.hear(self.peer, now_ns), now_ns)
        for text in self._log.add(telemetry.log_number, telemetry.log):
            events.append(self._event("log", text, now_ns))
        return True, events

    def tick(self, now_ns: int) -> list[LinkEvent]:
        """Gives what has changed only because time has passed."""
        return self._told(self._presence.tick(self.peer, now_ns), now_ns) if self.open else []

    def _told(self, changes: list[Change], now_ns: int) -> list[LinkEvent]:
        return [self._event(kind, text, now_ns) for kind, text in changes]

    def _event(self, kind: EventKind, text: str, now_ns: int) -> LinkEvent:
        return LinkEvent(kind, self.tag, f"{self.label}: {text}", now_ns)

    def status(self, now_ns: int) -> RobotStatus:
        """A snapshot."""
        udp = self.open and self.address is not None and not self.peer.over_tcp(now_ns)
        hello, counters = self._hello, self.peer.counters
        return RobotStatus(
            tag=self.tag,
            name=self.name,
            connected=self.open and not self._presence.lost,
            uid=self._uid,
            controller=hello.controller,
            version=hello.version,
            hash=hello.hash,
            since_ns=self._presence.since_ns,
            heard_ns=self._presence.heard_ns,
            udp=udp,
            telemetry=self._telemetry,
            sessions=self._sessions,
            sent=counters.pop("sent"),
            superseded=self.superseded,
            unsent=self.unsent,
            received=counters.pop("received"),
            accepted=counters.pop("accepted"),
            dropped=counters,
            refused=self.refused,
        )
