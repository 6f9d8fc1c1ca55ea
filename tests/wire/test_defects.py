"""Defects of the original system (its wire and buffers) that this one must not have."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.wire.robot_session import Event, RobotSession
from tests.wire.strategies import MS, Link, S, reseal
from vsense.base.native import WireError, ffi, lib
from vsense.robots.link.table import Entry, Table
from vsense.robots.link.wire import (
    PACKET_MAX,
    Header,
    Hello,
    PacketType,
    Wanted,
    Welcome,
    decode,
    encode,
    packet_length,
)


@given(st.data())
def test_defect_01_split_segments(data: st.DataObject) -> None:
    """The original wrote every chunk at its buffer's start: a split segment was garbage."""
    link = Link()
    link.sessions = 1
    stream = link.welcome(S)
    stream += link.state(S + 1, Wanted.RUN) + link.state(S + 2, Wanted.STOP)
    cuts = data.draw(st.lists(st.integers(0, len(stream)), max_size=12).map(sorted))
    events = []
    for start, end in zip([0, *cuts], [*cuts, len(stream)]):
        events += link.robot.tcp_in(stream[start:end], link.robot_ns(S))
    assert events == [Event.OPEN, Event.STATE, Event.STATE]
    assert link.robot.c.wanted == Wanted.STOP


def test_defect_03_a_robot_that_reconnects_in_mid_run_gets_everything() -> None:
    link = Link()
    link.greet(S)
    link.deliver(link.state(2 * S, Wanted.RUN), 2 * S)
    link.robot.disconnect()
    assert link.greet(3 * S) == [Event.OPEN]
    one = struct.pack("<f", 1.0)
    link.deliver(link.state(3 * S, Wanted.RUN, values=[(one, 3 * S)]), 3 * S)
    assert link.robot.c.wanted == Wanted.RUN
    assert link.robot.value("pollutant") == (one, 3 * S)


def test_defect_05_values_carry_age_and_sequence() -> None:
    link = Link()
    link.greet(S)
    link.deliver(link.state(2 * S), 2 * S + 4 * MS)
    value = link.robot.value("pollutant")
    assert value is not None
    age_ns = link.robot.age_ns(value[1], link.robot_ns(2 * S + 30 * MS))
    assert abs(age_ns - 30 * MS) < MS
    assert link.robot.c.peer.rx_sequence == 1


@given(st.integers(0, 2**16 - 1), st.integers(0, 2**16 - 1))
def test_defect_07_sizes_from_the_wire_are_checked(length: int, params: int) -> None:
    """The original took a u32 from the wire and allocated it."""
    prefix = b"VS\3\2\0\0" + struct.pack("<H", length)
    try:
        assert packet_length(prefix) == length <= PACKET_MAX
    except WireError as error:
        assert error.name == "VS_ERR_LENGTH"
        assert not 72 <= length <= PACKET_MAX
    link = Link()
    welcome = encode(Header(PacketType.WELCOME), Welcome(link.table, 1, 0, "a=b\n"))
    lying = reseal(welcome[:80] + struct.pack("<H", params) + welcome[82:])
    if params != 4:
        with pytest.raises(WireError):
            decode(lying)


def test_defect_08_colours_are_not_swapped() -> None:
    """Bytes travel in the order of the layout, R G B, as they lie in the payload."""
    link = Link(Table([Entry(5, "ground_rgb", "3*u1")]))
    link.greet(S)
    red = bytes([255, 10, 0])
    datagram = link.state(2 * S, values=[(red, 2 * S)])
    assert red in datagram
    link.deliver(datagram, 2 * S)
    assert link.robot.value("ground_rgb") == (red, 2 * S)


def test_defect_12_a_robot_that_nobody_sees_is_not_silently_where_it_was() -> None:
    link = Link()
    link.greet(S)
    seen_ns = 2 * S
    for now_ns in (2 * S, 3 * S, 4 * S):
        link.deliver(link.state(now_ns, values=[(b"\0\0\x80?", seen_ns)]), now_ns)
        value = link.robot.value("pollutant")
        assert value is not None
        age_ns = link.robot.age_ns(value[1], link.robot_ns(now_ns))
        assert abs(age_ns - (now_ns - seen_ns)) < MS
    link.deliver(link.state(5 * S, values=[(bytes(4), -1)]), 5 * S)
    assert link.robot.value("pollutant") is None


def test_defect_14_unchanged_is_not_dead() -> None:
    """What did not change is sent again, so that silence means loss."""
    link = Link()
    link.greet(S)
    values = [(b"\0\0\x80?", 2 * S)]
    for i in range(3):
        now_ns = 2 * S + i * 50 * MS
        assert link.deliver(link.state(now_ns, values=values), now_ns) == (0, Event.STATE)
        assert link.robot.value("pollutant") == values[0]
        assert link.robot.c.received_ns == link.robot_ns(now_ns)


def test_defect_15_version_sequence_time_and_authentication() -> None:
    link = Link()
    link.greet(S)
    packet = link.state(2 * S)
    header, _ = link.robot.open_packet(packet)
    assert packet[2] == lib.VS_VERSION
    assert (header.sequence, header.capture_ns, header.send_ns) == (1, 2 * S, 2 * S)
    for at in range(len(packet) - 16, len(packet)):
        forged = bytearray(packet)
        forged[at] ^= 1
        assert link.deliver(bytes(forged), 2 * S)[0] == lib.VS_ERR_TAG


def test_defect_16_identity_is_the_robots_own_and_sensors_have_names() -> None:
    robot = RobotSession(b"0123456789abcdef", 23)
    _, hello = decode(robot.connect(S))
    assert isinstance(hello, Hello)
    assert (hello.uid, hello.tag) == (b"0123456789abcdef", 23)
    one, other = Table([Entry(1, "light", "f4")]), Table([Entry(9, "light", "f4")])
    for table in (one, other):
        link = Link(table)
        link.greet(S)
        assert lib.vs_table_find(ffi.addressof(link.robot.c, "table"), b"light") == 0
