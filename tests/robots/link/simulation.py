"""Host and robot sessions over a bad network on virtual time, repeatable for a seed.

UDP loses, repeats, delays and so reorders; TCP only delays, until it breaks. The host's half is
`SessionTable` and `HostSession`, the robot's half the C session that the daemon runs.
"""

from __future__ import annotations

import heapq
import random
import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import count

from hypothesis import strategies as st

from tests.robots.link.rig import KEYS, keyed_session
from tests.wire.robot_session import Event
from vsense.robots.link._peer import Orders
from vsense.robots.link._roster import SessionTable
from vsense.robots.link._session import HostSession
from vsense.robots.link._streams import Inbox
from vsense.robots.link.keys import LinkTrust
from vsense.robots.link.status import LinkEvent
from vsense.robots.link.table import Direction, Entry, ExpectedRobot, Table
from vsense.robots.link.wire import Telemetry, Wanted, session_of

MS = 1_000_000
S = 1000 * MS
HOUR_NS = 3_600 * S
TICK_NS = 5 * MS
TIMESTEP_NS = 100 * MS
CAPTURE_LAG_NS = 30 * MS
TAG = 23
TABLE = Table(
    [
        Entry(7, "pollutant", "f4"),
        Entry(9, "clockwork", "u4"),
        Entry(10, "pushes", "u4", Direction.ACTUATOR),
    ]
)


@dataclass(frozen=True)
class Weather:
    """How bad the network is.

    Attributes:
        loss, repeats: share of datagrams that vanish, that arrive twice.
        delay_ns: longest delay, each one is drawn anew.
        down, up: whether any datagram gets to the robot, to the host.
        breaks: share of timesteps in which the TCP connection breaks.
    """

    loss: float = 0.0
    repeats: float = 0.0
    delay_ns: int = MS
    down: bool = True
    up: bool = True
    breaks: float = 0.0


CALM = Weather()
weathers = st.builds(
    Weather,
    loss=st.floats(0, 0.6),
    repeats=st.floats(0, 0.5),
    delay_ns=st.integers(1, 300 * MS),
    down=st.booleans(),
    up=st.booleans(),
    breaks=st.sampled_from([0.0, 0.1]),
)


class Robot:
    """The robot's half: connects again whenever it is down, and checks all that it accepts.

    Attributes:
        offset_ns: host's clock minus the robot's.
        seen: session, sequence and capture time of every STATE that it accepted, in order.
        events: everything that its session told.
        due_ns: when its next telemetry leaves, host's clock.
        control_step: of its daemon; grows with every timestep that it lives.
        pushes: count of its virtual actuator.
    """

    def __init__(self, offset_ns: int) -> None:
        self.session = keyed_session(b"u" * 16, TAG)
        self.offset_ns = offset_ns
        self.seen: list[tuple[int, int, int]] = []
        self.events: list[Event] = []
        self.due_ns = 0
        self.control_step = 0
        self.pushes = 0

    def restart(self) -> None:
        """Another daemon takes the place of this one."""
        self.session = keyed_session(b"u" * 16, TAG)
        self.control_step = self.pushes = 0

    def heard(self, events: list[Event], now_ns: int) -> None:
        """Acts on events; now_ns is the host's clock."""
        self.events += events
        session = self.session
        if Event.OPEN in events:
            self.due_ns = now_ns
        if Event.STATE not in events:
            return
        c = session.c
        self.seen.append((c.peer.session, c.peer.rx_sequence, c.capture_ns))
        value = session.value("clockwork")
        if value is not None:
            assert struct.unpack("<I", value[0])[0] == value[1] // TIMESTEP_NS
            assert value[1] <= c.capture_ns
        clock = session.clock((now_ns - self.offset_ns) % 2**64)
        if clock is not None:
            assert abs(clock[0] - self.offset_ns) <= clock[1]


class Simulation:
    """One host, one robot, one network.

    Attributes:
        now_ns: the host's clock.
        events: everything the host told.
        states: when the host sent a STATE.
    """

    def __init__(self, seed: int, offset_ns: int = 0) -> None:
        self.random = random.Random(seed)
        self.weather = CALM
        # A host that was started a minute ago: robots' clocks are before or behind their zero.
        self.now_ns = 60 * S
        self.roster = SessionTable(
            {TAG: ExpectedRobot("epuck_23", TABLE)},
            TIMESTEP_NS,
            seed,
            LinkTrust(KEYS),
            lambda: self.random.getrandbits(32),
        )
        self.host: HostSession = self.roster.robots[TAG]
        self.robot = Robot(offset_ns)
        self.events: list[LinkEvent] = []
        self.states: list[int] = []
        self._order = count()
        self._queue: list[tuple[int, int, Callable[[], None]]] = []
        self._tcp_free_ns = 0
        self._inbox = Inbox()
        self._connection = 0
        self._greeted = self._opened = 0
        self._connected = False
        self._timestep = 0
        self._port = 1000

    def run(self, length_ns: int) -> None:
        """Lets time pass."""
        end_ns = self.now_ns + length_ns
        while self.now_ns < end_ns:
            self.now_ns += TICK_NS
            while self._queue and self._queue[0][0] <= self.now_ns:
                heapq.heappop(self._queue)[2]()
            self._host_turn()
            self._robot_turn()

    def publish(self) -> None:
        """One timestep: the reading says in which timestep it was made."""
        self._timestep += 1
        self.robot.control_step += 1
        if self.random.random() < self.weather.breaks:
            self.break_tcp(told=self.random.random() < 0.5)
        capture_ns = self.now_ns - CAPTURE_LAG_NS
        value = struct.pack("<I", capture_ns // TIMESTEP_NS)
        pollutant = struct.pack("<f", 1.0)
        self.host.hold(self._timestep, capture_ns, [(pollutant, capture_ns), (value, capture_ns)])
        if self.host.open:
            self._send()

    def order(self, wanted: Wanted, from_timestep: int = 0) -> None:
        """Commands the robot."""
        self.roster.orders = Orders(self.roster.orders.run, wanted, from_timestep)
        if self.host.open:
            self._send()
            if wanted == Wanted.STOP:
                self.host.repeat_stop(self.now_ns)

    def break_tcp(self, told: bool = True) -> None:
        """The connection ends, and what was on its way is gone; the host may not notice."""
        self._connected = False
        self.robot.session.disconnect()
        self._port += 1
        if told and self.host.open:
            self.events += self.host.broke("broke", self.now_ns)

    def _host_turn(self) -> None:
        if self.now_ns % TIMESTEP_NS == 0:
            self.publish()
        if self.host.open:
            self.events += self.host.tick(self.now_ns)
            if self.host.due_ns <= self.now_ns:
                self._send()

    def _send(self) -> None:
        packet = self.host.state(self.roster.orders, self.now_ns)
        self.states.append(self.now_ns)
        if self.host.address is not None:
            self._udp(packet, self._udp_to_robot, self.weather.down)
        if self.host.by_tcp(self.now_ns):
            self._tcp(packet, self._tcp_to_robot, self._opened)

    def _robot_turn(self) -> None:
        session, here_ns = self.robot.session, self._robot_ns()
        if not self._connected:
            self._connected = True
            self._connection += 1
            self._inbox = Inbox()
            self._tcp(session.connect(here_ns), self._tcp_to_host, self._connection)
        self.robot.heard([session.tick(here_ns)], self.now_ns)
        if session.c.open and self.now_ns >= self.robot.due_ns:
            self.robot.due_ns = self.now_ns + 50 * MS
            pushes = struct.pack("<I", self.robot.pushes)
            said = Telemetry(control_step=self.robot.control_step, payload=pushes)
            packet = session.telemetry(here_ns, said)
            source = ("robot", self._port)
            deliver = partial(self._udp_to_host, source)
            self._udp(packet, deliver, self.weather.up)
            if session.over_tcp(here_ns):
                self._tcp(packet, self._tcp_to_host, self._connection)

    def _robot_ns(self) -> int:
        return (self.now_ns - self.robot.offset_ns) % 2**64

    def _udp(self, packet: bytes, deliver: Callable[[bytes], None], gets_through: bool) -> None:
        copies = 1 + (self.random.random() < self.weather.repeats)
        for _ in range(copies if gets_through else 0):
            if self.random.random() >= self.weather.loss:
                self._at(self._delay(), partial(deliver, packet))

    def _tcp(self, packet: bytes, deliver: Callable[[bytes], None], connection: int) -> None:
        """In order, in two arbitrary pieces; nothing arrives once there is a newer connection."""
        cut = self.random.randrange(len(packet) + 1)
        self._tcp_free_ns = max(self._tcp_free_ns, self.now_ns + self._delay())

        def arrive(piece: bytes) -> None:
            if self._connected and connection == self._connection and piece:
                deliver(piece)

        for piece in (packet[:cut], packet[cut:]):
            self._at(self._tcp_free_ns - self.now_ns, partial(arrive, piece))

    def _delay(self) -> int:
        return self.random.randrange(1, self.weather.delay_ns + 1)

    def _at(self, delay_ns: int, action: Callable[[], None]) -> None:
        heapq.heappush(self._queue, (self.now_ns + delay_ns, next(self._order), action))

    def _udp_to_robot(self, packet: bytes) -> None:
        _, event = self.robot.session.udp_in(packet, self._robot_ns())
        self.robot.heard([event], self.now_ns)

    def _tcp_to_robot(self, data: bytes) -> None:
        self.robot.heard(self.robot.session.tcp_in(data, self._robot_ns()), self.now_ns)

    def _udp_to_host(self, source: tuple[str, int], packet: bytes) -> None:
        self._heard(packet, source)
        if self.host.open and self.host.due_ns <= self.now_ns:
            self._send()

    def _tcp_to_host(self, data: bytes) -> None:
        self._inbox.feed(data)
        while (packet := self._inbox.next()) is not None:
            if self._greeted == self._connection:
                self._heard(packet, None)
                continue
            self._greeted = self._connection
            answer = self.roster.greet(packet, "the test", self.now_ns)
            assert answer.pending is not None and answer.event is None
            self._tcp(answer.packet, self._tcp_to_robot, self._greeted)
            first = self.host.first_state(answer.pending, self.roster.orders, self.now_ns)
            self._tcp(first, self._tcp_to_robot, self._greeted)

    def _heard(self, packet: bytes, source: tuple[str, int] | None) -> None:
        pending = self.roster.pending(session_of(packet))
        if pending is None:
            self.events += self.host.receive(packet, source, self.now_ns)[1]
            return
        proved = self.roster.prove(pending, packet, source, self.now_ns)
        if proved is not None:
            self._opened = self._greeted
            self.events += proved.events
