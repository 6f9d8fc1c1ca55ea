"""The host's end of one robot's link, sans-I/O: packets and times in, packets and events out.

One `HostSession` lasts as long as its server and goes through all sessions of one tag, so that
counters, readings and the tag's last holder survive every reconnection.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from vsense.base.native import lib
from vsense.robots.link._meter import LinkMeter
from vsense.robots.link._peer import Greeting, Orders, Peer, Presence, PresenceChange
from vsense.robots.link.status import (
    EventKind,
    LinkEvent,
    LogLines,
    Reporter,
    RobotStatus,
    cut_text,
    switched_on_again,
)
from vsense.robots.link.table import STAY, Direction, Goal, Table
from vsense.robots.link.wire import (
    GoodbyeCause,
    Header,
    Hello,
    Notice,
    PacketType,
    ReadingValues,
    Telemetry,
    Welcome,
)

HEARTBEAT_NS = 50_000_000
"""A STATE leaves at least this often."""

STOP_REPEAT_NS = 10_000_000
"""Distance between the three STATE packets that say STOP."""

STOP_PACKETS = 3

_NO_HELLO, _NO_ORDERS = Hello(b"", 0, "", ""), Orders()

Address = tuple[Any, ...]
"""Where datagrams come from and go to, as the socket module says it."""

COPIED_NS = 1_000_000_000
"""Datagrams go to a second source of the robot's for so long after it was heard."""

DEAF_NS = 1_000_000_000
"""A session in which nothing but packets that come too late or too early was heard for this long is
renewed: somebody has made the host believe in a sequence or a run that the robot is far from."""

_OUT_OF_ORDER = frozenset({lib.VS_ERR_OLDER, lib.VS_ERR_JUMP, lib.VS_ERR_RUN})


@dataclass(eq=False, slots=True)
class PendingSession:
    """A session that was offered to a robot.

    It changes nothing until a first valid packet of it shows that whoever greeted has the key: a
    greeting alone may be a copy of an earlier one.
    """

    robot: HostSession
    greeting: Greeting
    peer: Peer
    seed: int


class HostSession:
    """What the host knows of one robot, and the packets between the two.

    Attributes:
        name: the robot's name in the experiment.
        peer: sequences, acceptance filter and counters of the link.
        address: source of the newest accepted datagram of the open session, None before it.
        copied: a second source of the same datagrams, which somebody passes on; None: none.
        origin: the address of the newest session's greeting, "" before.
        due_ns: when the next STATE is due at the latest; of no meaning while no session is open.
        superseded: STATE packets that a newer one replaced in a slow TCP stream.
        unsent: STATE packets that the kernel refused on their only way.
        defects: exceptions at its packets that nobody expected; each has ended a session.
        reporter: what the robot's virtual actuators say.
        meter: measures the link; None: nobody wants that.
        refused, other_program: see `RobotStatus`.
        reseeded: the next run has another seed than the session: it is renewed, and until then the
            robot counts as not connected.
    """

    def __init__(self, tag: int, name: str, table: Table) -> None:
        self.tag, self.name = tag, name
        self.peer = Peer()
        self.address: Address | None = None
        self.copied: Address | None = None
        self._copied_ns = self.due_ns = 0
        self.superseded = self.unsent = self.defects = 0
        self.refused, self.other_program, self.reseeded = "", "", False
        self._table = table
        self._uid: bytes | None = None
        self._hello, self.origin = _NO_HELLO, ""
        self._key: int | None = None
        self._astray_ns: tuple[int, int] | None = None
        self._sessions = 0
        self._presence = Presence()
        self.reporter = Reporter()
        self.meter: LinkMeter | None = None
        self._log = LogLines()
        self._repeats = self._repeat_ns = 0
        self._telemetry: Telemetry | None = None
        self._timestep, self._capture_ns, self._goal = 0, 0, STAY
        self._sizes = [size for _, _, size in table.of_direction(Direction.SENSOR)]
        self._values: ReadingValues = []
        self.forget()

    @property
    def label(self) -> str:
        """The robot for people."""
        return f"robot {self.tag}"

    @property
    def runs(self) -> tuple[str, str]:
        """What it called its controller in its newest session, and its source's hash."""
        return self._hello.controller, self._hello.hash

    @property
    def open(self) -> bool:
        """Whether a session is open; the robot may be silent in it."""
        return self.peer.session != 0

    def taken_from(self, uid: bytes, keyed: bool, now_ns: int) -> bool:
        """Whether another robot than this uid has the tag: just heard, and it did not leave.

        Whoever has no key is another one than a robot that has, whatever its uid.
        """
        another = self._uid not in (None, uid) or (self._key is not None and not keyed)
        return another and self._presence.holds(now_ns)

    def offer(
        self, number: int, greeting: Greeting, welcome: Welcome, run: int, now_ns: int
    ) -> tuple[PendingSession, bytes]:
        """Offers a session, and gives it with the WELCOME; nothing else changes yet.

        Args:
            number: the session's, not 0 and never used before.
            greeting: of a robot that the tag is not `taken_from`; it came at now_ns, host's clock.
            welcome: the answer.
            run: number of the run.
        """
        peer = Peer()
        peer.open(number, self._table, greeting.header.send_ns, now_ns)
        header = self._header(PacketType.WELCOME, run)
        packet = peer.welcome(greeting.root, greeting.packet, header, welcome, now_ns)
        return PendingSession(self, greeting, peer, welcome.seed), packet

    def adopt(self, proved: PendingSession, now_ns: int) -> list[LinkEvent]:
        """Goes on with a session that was proved to be the robot's, in place of the open one.

        Gives what there is to say; nothing of a robot that was asked to come back.
        """
        greeting, hello = proved.greeting, proved.greeting.hello
        is_asked = self.reseeded and hello.uid == self._uid
        events = [] if is_asked else [self._greeting(greeting, now_ns)]
        self.reseeded = False
        self.peer.adopt(proved.peer)
        self._uid, self._hello, self.refused = hello.uid, hello, ""
        self.origin, self._key = greeting.origin, greeting.key
        self.other_program = greeting.other_program
        self.reporter.open(hello.uid)
        self._log.open(hello.uid, hello.started)
        self._sessions += 1
        self._presence.open(now_ns, hello.started)
        self._astray_ns, self.due_ns = None, now_ns
        self.address = self.copied = None
        return events

    def _greeting(self, greeting: Greeting, now_ns: int) -> LinkEvent:
        """What to say of a robot whose session opens."""
        hello, origin = greeting.hello, greeting.origin
        where = f"from {origin}, controller {hello.controller or 'unnamed'}"
        note = "" if greeting.key is not None else ", without a key"
        note += greeting.note and f": {greeting.note}"
        if self._uid is None:
            return self._event("connected", f"connected {where}{note}", now_ns)
        if self._uid != hello.uid:
            other = f"it is another robot than before: uid {hello.uid.hex()}"
            return self._event("connected", f"connected {where}{note}; {other}", now_ns)
        if self.open and self._presence.holds(now_ns):
            old = "the old one" if origin == self.origin else f"the old one, from {self.origin},"
            text = f"opened a new session {where}{note}; {old} is closed"
            return self._event("takeover", text, now_ns)
        since_ns = self._presence.since_ns
        assert since_ns is not None
        again = switched_on_again(self._hello, hello, (now_ns - since_ns) / 1e9)
        return self._event("reconnected", f"{again}reconnected {where}{note}", now_ns)

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
        self.address = self.copied = None
        self._repeats = 0

    def broke(self, reason: str, now_ns: int) -> list[LinkEvent]:
        """Ends the session because its connection ended; `lost` unless reported already."""
        reported = self._presence.lost
        self.close()
        return [] if reported else [self._event("lost", f"its connection {reason}", now_ns)]

    def left(self, notice: Notice, now_ns: int) -> LinkEvent:
        """Ends the session because the robot said goodbye; its tag is free at once."""
        self.close()
        self._presence.left = True
        return self._event("goodbye", f"says goodbye: {notice.text or 'no reason given'}", now_ns)

    def hold(
        self, timestep: int, capture_ns: int, values: ReadingValues | None, goal: Goal = STAY
    ) -> None:
        """Takes the newest readings, to be repeated until the next ones.

        `values` are in the table's order; None leaves the old ones, which age. The arena was seen
        at `capture_ns`, host's clock; `goal` is as seen from where the robot was then.

        Raises:
            ValueError: the readings do not fit the table.
        """
        if values is not None:
            sizes = [len(payload) for payload, _ in values]
            if sizes != self._sizes:
                raise ValueError(f"{self.label}: readings of {sizes} byte, expected {self._sizes}")
            self._values = values
        self._timestep, self._capture_ns, self._goal = timestep, capture_ns, goal

    def forget(self) -> None:
        """Sets every reading to "never measured": a new run begins."""
        self._timestep = 0
        self._values = [(bytes(size), -1) for size in self._sizes]

    def repeat_stop(self, now_ns: int) -> None:
        """Has two more STATE packets leave soon after the one that said STOP at now_ns."""
        self._repeats = STOP_PACKETS - 1
        self.due_ns = self._repeat_ns = now_ns + STOP_REPEAT_NS

    def first_state(self, pending: PendingSession, orders: Orders, now_ns: int) -> bytes:
        """The STATE that follows the WELCOME of a session that was offered."""
        hello = pending.greeting.hello
        heard = self._log.heard_of(hello.uid, hello.started)
        return pending.peer.send_state(
            orders, self._timestep, self._capture_ns, self._values, now_ns, heard
        )

    def state(self, orders: Orders, now_ns: int) -> bytes:
        """The next STATE: all readings and the orders; an open session only."""
        readings = self._timestep, self._capture_ns, self._values
        packet = self.peer.send_state(orders, *readings, now_ns, self._log.heard, self._goal)
        self.plan(now_ns)
        return packet

    def plan(self, sent_ns: int) -> None:
        """Sets when the STATE after that of sent_ns is due."""
        # A STATE that leaves in between is no repetition of STOP.
        if self._repeats and sent_ns >= self._repeat_ns:
            self._repeats -= 1
            self._repeat_ns = sent_ns + STOP_REPEAT_NS
        self.due_ns = self._repeat_ns if self._repeats else sent_ns + HEARTBEAT_NS

    def by_tcp(self, now_ns: int) -> bool:
        """Whether STATE must go over TCP: no datagram has shown a way yet, or none gets through."""
        return self.address is None or self.peer.over_tcp(now_ns)

    def receive(
        self, packet: bytes, source: Address | None, now_ns: int
    ) -> tuple[bool, list[LinkEvent]]:
        """Takes one whole packet that should be TELEMETRY.

        `source` is the datagram's, None for TCP; it came at `now_ns`, host's clock. Returns
        whether it was accepted (`peer.counters` and `peer.fault` say why not), and what that
        changed.
        """
        heard = self.peer.receive_telemetry(packet, source is not None, now_ns)
        if heard is None:
            self._note_drop(now_ns)
            if self.peer.fault == lib.VS_ERR_REPEATED and source is not None:
                self._note_copy(source, now_ns)
            return False, []
        return True, self.take(*heard, source, now_ns)

    def take(
        self, header: Header, telemetry: Telemetry, source: Address | None, now_ns: int
    ) -> list[LinkEvent]:
        """Acts on telemetry that was accepted; see `receive`."""
        self._astray_ns = None
        self._telemetry = telemetry
        self.reporter.receive(header, telemetry, now_ns)
        if self.meter is not None:
            self.meter.hear(header, telemetry, self.peer.sent, now_ns)
        events = []
        if source is not None and source != self.address:
            events += self._moved(source, now_ns)
            if source == self.copied:
                self.copied = self.address
            self.address, self.due_ns = source, now_ns
        events += self._events(self._presence.hear(self.peer, now_ns), now_ns)
        for text in self._log.add(telemetry.log_number, telemetry.log):
            events.append(self._event("log", text, now_ns))
        return events

    def _note_copy(self, source: Address, now_ns: int) -> None:
        """The newest datagram has come again: either source may be the robot, both are sent to."""
        if self.address is None:
            # The first packet comes both ways, and TCP was faster.
            self.address, self.due_ns = source, now_ns
        elif source != self.address:
            self.copied, self._copied_ns = source, now_ns

    def ways(self, now_ns: int) -> list[Address]:
        """Where datagrams for the robot go."""
        if self.copied is not None and now_ns - self._copied_ns >= COPIED_NS:
            self.copied = None
        return [way for way in (self.address, self.copied) if way is not None]

    def _moved(self, source: Address, now_ns: int) -> list[LinkEvent]:
        """Says so where what may be anybody's comes from another place."""
        before = self.address
        if self._key is not None or before is None or before[0] == source[0]:
            return []
        text = f"its packets come from {source[0]} now, no longer from {before[0]}"
        return [self._event("doubt", f"{text}: without a key anybody can send them", now_ns)]

    def _note_drop(self, now_ns: int) -> None:
        if self.peer.fault in _OUT_OF_ORDER:
            first_ns = self._astray_ns[0] if self._astray_ns else now_ns
            self._astray_ns = first_ns, now_ns

    @property
    def outworn(self) -> str:
        """Why the session must be renewed; "" if it need not be."""
        if self.reseeded:
            return "the next run has another seed"
        return "sequence numbers used up" if self.peer.worn else ""

    @property
    def deaf(self) -> bool:
        """Whether only packets out of their order have come for so long that no other will."""
        return self._astray_ns is not None and self._astray_ns[1] - self._astray_ns[0] >= DEAF_NS

    def tick(self, now_ns: int) -> list[LinkEvent]:
        """Gives what has changed only because time has passed."""
        return self._events(self._presence.tick(self.peer, now_ns), now_ns) if self.open else []

    def _events(self, changes: list[PresenceChange], now_ns: int) -> list[LinkEvent]:
        return [self._event(kind, text, now_ns) for kind, text in changes]

    def _event(self, kind: EventKind, text: str, now_ns: int) -> LinkEvent:
        return LinkEvent(kind, self.tag, f"{self.label}: {text}", now_ns)

    def status(self, now_ns: int, orders: Orders = _NO_ORDERS, ordered_ns: int = 0) -> RobotStatus:
        """A snapshot; `orders` are all robots', given at `ordered_ns`."""
        udp = self.open and self.address is not None and not self.peer.over_tcp(now_ns)
        hello, counters = self._hello, self.peer.counters
        connected = self.open and not self._presence.lost and not self.reseeded
        return RobotStatus(
            tag=self.tag,
            name=self.name,
            connected=connected,
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
            defects=self.defects,
            received=counters.pop("received"),
            accepted=counters.pop("accepted"),
            dropped=counters,
            refused="" if connected else self.refused,
            other_program=self.other_program,
            starts=self._presence.starts,
            key=self._key if self.open else None,
            drives_home=bool(hello.capabilities & lib.VS_CAPABLE_HOME),
            wanted=orders.of(self.tag).wanted,
            ordered_ns=ordered_ns,
            held=orders.held.get(self.tag, ""),
        )
