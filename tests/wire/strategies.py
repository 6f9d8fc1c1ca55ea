"""Hypothesis strategies for packets, and both ends of a link on virtual time."""

from __future__ import annotations

from typing import Any

from hypothesis import strategies as st

from tests.wire.robot_session import Event, RobotSession
from vsense.base.native import ffi, lib
from vsense.robots.link._peer import Orders, Peer
from vsense.robots.link.table import Direction, Entry, Table
from vsense.robots.link.wire import (
    PUBLISHED,
    Header,
    Hello,
    Notice,
    PacketType,
    ReadingValues,
    Telemetry,
    Wanted,
    Welcome,
    decode,
)

MS = 1_000_000
S = 1000 * MS

u8 = st.integers(0, 2**8 - 1)
u16 = st.integers(0, 2**16 - 1)
i16 = st.integers(-(2**15), 2**15 - 1)
u32 = st.integers(0, 2**32 - 1)
u64 = st.integers(0, 2**64 - 1)
uids = st.binary(min_size=16, max_size=16)

KINDS = ("u1", "i2", "u2", "i4", "u4", "f4")


STEERING = frozenset(
    map(chr, [*range(0x20), *range(0x7F, 0xA0), 0x61C, 0x200E, 0x200F, *range(0x2028, 0x202F)])
) | frozenset(map(chr, range(0x2066, 0x206A)))
"""Characters that no text has: they would steer a terminal, or turn a line around."""


def texts(most: int, least: int = 0) -> st.SearchStrategy[str]:
    """Clean texts of at most so many bytes of UTF-8."""
    characters = st.characters(codec="utf-8", exclude_categories=("Cs",)).filter(
        lambda c: c not in STEERING
    )
    return st.text(characters, min_size=least, max_size=most).filter(
        lambda text: len(text.encode()) <= most
    )


layouts = st.one_of(
    st.sampled_from(KINDS), st.builds("{}*{}".format, st.integers(1, 8), st.sampled_from(KINDS))
)


@st.composite
def tables(draw: st.DrawFn, most: int = 8) -> Table:
    names = draw(st.lists(texts(31, 1), max_size=most, unique=True))
    ids = draw(st.lists(u8, min_size=len(names), max_size=len(names), unique=True))
    return Table(
        Entry(number, name, draw(layouts), draw(st.sampled_from(Direction)))
        for number, name in zip(ids, names)
    )


def headers(kind: PacketType, table_hash: int | None = None) -> st.SearchStrategy[Header]:
    hashes = u32 if table_hash is None else st.just(table_hash)
    return st.builds(
        Header, st.just(kind), u16, st.just(0), u32, u32, u32, u32, u64, u64, u64, u32, hashes
    )


hellos = st.builds(Hello, uids, u16, *[texts(31)] * 4, uids, u64, u32, *[u16] * 4)
welcomes = st.builds(
    Welcome,
    tables(),
    st.integers(1, 2**32 - 1),
    u32,
    st.lists(texts(40), max_size=8).map(lambda lines: "".join(f"{line}\n" for line in lines)),
    uids,
)
messages: st.SearchStrategy[tuple[Header, Hello | Welcome | Notice]] = st.one_of(
    st.tuples(headers(PacketType.HELLO), hellos),
    st.tuples(headers(PacketType.WELCOME), welcomes),
    st.tuples(headers(PacketType.REFUSE), st.builds(Notice, u16, texts(200))),
    st.tuples(headers(PacketType.GOODBYE), st.builds(Notice, u8, texts(200))),
)


@st.composite
def telemetries(draw: st.DrawFn, table: Table) -> Telemetry:
    states = st.sampled_from(Wanted)
    size = table.cdata.actuator_bytes
    return Telemetry(
        draw(states), draw(states), draw(u8), draw(st.sampled_from([0, 1, 255])), draw(u32),
        draw(u32), draw(i16), draw(i16), draw(u16), draw(u16), draw(u32), draw(u32), draw(u32),
        draw(u32), draw(u32), draw(u32), draw(u32), draw(st.integers(-128, 127)),
        draw(st.sampled_from([0, 1, 255])), draw(u16), draw(u32), draw(u32), draw(u32), draw(u32),
        draw(st.binary(min_size=size, max_size=size)),
    )  # fmt: skip


def reseal(packet: bytes, key: bytes = PUBLISHED) -> bytes:
    """Makes length and tag of a changed packet right again."""
    body = packet[:6] + len(packet).to_bytes(2, "little") + packet[8:-16]
    tag = ffi.new("uint8_t[16]")
    lib.vs_tag_make(key, body, len(body), tag)
    return body + bytes(tag)


POLLUTANT = Table([Entry(1, "pollutant", "f4"), Entry(2, "drops", "u4", Direction.ACTUATOR)])


class Link:
    """One host and one robot on virtual time; what travels between them is the test's affair.

    Attributes:
        robot_ahead_ns: what the robot's clock shows when the host's shows 0.
    """

    def __init__(self, table: Table = POLLUTANT, robot_ahead_ns: int = 7 * S) -> None:
        self.table = table
        self.robot_ahead_ns = robot_ahead_ns
        self.robot = RobotSession(bytes(range(16)), 23)
        self.host = Peer()
        self.sessions = 0
        self.run = 1
        self.timestep = 0

    def greet(self, now_ns: int = S) -> list[Event]:
        """HELLO and WELCOME over a TCP connection without delay."""
        self.sessions += 1
        welcome = self.welcome(now_ns)
        return self.robot.tcp_in(welcome, self.robot_ns(now_ns))

    def welcome(self, now_ns: int, welcome: Welcome | None = None) -> bytes:
        """The robot connects; gives the WELCOME for it, of the session `sessions`."""
        hello = self.robot.connect(self.robot_ns(now_ns))
        header, _ = decode(hello)
        self.host.open(self.sessions, self.table, header.send_ns, now_ns)
        message = welcome or Welcome(self.table, 100_000)
        return self.host.welcome(PUBLISHED, hello, Header(PacketType.WELCOME), message, now_ns)

    def state(self, now_ns: int, wanted: Wanted = Wanted.RUN, **changes: Any) -> bytes:
        """The host's next STATE, of the next timestep; capture time is `now_ns`."""
        self.timestep += 1
        capture_ns = changes.get("capture_ns", now_ns)
        values: ReadingValues = changes.get("values") or [
            (bytes(size), capture_ns) for _, _, size in self.table.of_direction(Direction.SENSOR)
        ]
        orders = Orders(self.run, wanted, changes.get("from_timestep", 0))
        return self.host.send_state(orders, self.timestep, capture_ns, values, now_ns)

    def deliver(self, datagram: bytes, now_ns: int) -> tuple[int, Event]:
        """Brings a datagram to the robot."""
        return self.robot.udp_in(datagram, self.robot_ns(now_ns))

    def robot_ns(self, now_ns: int) -> int:
        """The robot's clock when the host's shows now_ns."""
        return (now_ns + self.robot_ahead_ns) % 2**64


def balance(counters: Any) -> bool:
    """Whether received = accepted + everything that was dropped."""
    dropped = sum(counters[n] for n in counters if n not in ("sent", "received", "accepted"))
    return bool(counters["received"] == counters["accepted"] + dropped)


def with_length(header: Header, packet: bytes) -> Header:
    """The header as it comes back from the packet."""
    return header._replace(length=len(packet))
