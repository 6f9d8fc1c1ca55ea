"""The robot's session against the host's peer: newest wins, whatever the network does."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.wire.robot_session import Event, RobotSession
from tests.wire.strategies import MS, POLLUTANT, Link, S, balance, reseal
from vsense.base.native import WireError, lib
from vsense.robots.link._peer import Orders, Peer
from vsense.robots.link.table import Table
from vsense.robots.link.wire import (
    PUBLISHED,
    GoodbyeCause,
    Header,
    Hello,
    Notice,
    PacketType,
    RefuseCode,
    Telemetry,
    Wanted,
    Welcome,
    answer_key,
    decode,
    decode_body,
    encode,
    open_packet,
)


def test_hello_says_who_the_robot_is() -> None:
    robot = RobotSession(b"u" * 16, 23, "epuck_23", "pollutant")
    header, hello = decode(robot.connect(5 * S, nonce=b"n" * 16, uptime_s=77))
    texts = "epuck_23", "pollutant", "9.9", "abc"
    known = {"nonce": b"n" * 16, "started": 5, "uptime_s": 77, "capabilities": 2}
    assert hello == Hello(b"u" * 16, 23, *texts, **known)
    assert (header.session, header.send_ns, header.echo_ns) == (0, 5 * S, 0)
    assert robot.tcp_out(5 * S) == b""


def test_welcome_opens_and_carries_everything() -> None:
    link = Link()
    link.sessions = 9
    params = "stop_probability=0.3\nspeed_cm_s=10\n"
    welcome = Welcome(link.table, 100_000, 42, params, b"h" * 16)
    events = link.robot.tcp_in(link.welcome(S, welcome), link.robot_ns(S))
    c = link.robot.c
    assert events == [Event.OPEN]
    assert (c.open, c.peer.session, c.seed, c.timestep_ns) == (1, 9, 42, 100 * MS)
    assert (link.robot.table, link.robot.params) == (POLLUTANT, params)
    assert (c.wanted, c.fresh_ns, c.received_ns) == (Wanted.IDLE, 0, 0)
    assert link.robot.value("pollutant") is None
    assert link.robot.clock(link.robot_ns(S)) is not None


def test_state_brings_values_with_their_capture_time() -> None:
    link = Link()
    link.greet()
    one = struct.pack("<f", 1.0)
    datagram = link.state(2 * S, from_timestep=5, values=[(one, 2 * S - 250 * MS)])
    assert link.deliver(datagram, 2 * S + 3 * MS) == (0, Event.STATE)
    c = link.robot.c
    assert link.robot.value("pollutant") == (one, 2 * S - 250 * MS)
    assert (c.wanted, c.run, c.timestep, c.from_timestep) == (Wanted.RUN, 1, 1, 5)
    assert c.received_ns == c.fresh_ns == link.robot_ns(2 * S + 3 * MS)
    with pytest.raises(WireError, match="drops"):
        link.robot.value("drops")
    with pytest.raises(WireError, match="unknown"):
        link.robot.value("unknown")


def test_fresh_needs_a_capture_time_that_advanced() -> None:
    """A frozen tracker sends on, but nothing that it says keeps wheels turning."""
    link = Link()
    link.greet()
    link.deliver(link.state(2 * S, capture_ns=2 * S), 2 * S)
    for now_ns, capture_ns in ((3 * S, 2 * S), (4 * S, 2 * S - 1)):
        link.deliver(link.state(now_ns, capture_ns=capture_ns), now_ns)
        assert link.robot.c.received_ns == link.robot_ns(now_ns)
        assert link.robot.c.fresh_ns == link.robot_ns(2 * S)
        assert link.robot.c.capture_ns == capture_ns
    link.deliver(link.state(5 * S, capture_ns=2 * S + 1), 5 * S)
    assert link.robot.c.fresh_ns == link.robot_ns(5 * S)


@given(
    st.lists(st.sampled_from(Wanted), min_size=1, max_size=12),
    st.lists(st.tuples(st.integers(0, 11), st.integers(0, 2000)), max_size=40),
)
def test_lost_late_or_repeated_datagrams_never_leave_a_wrong_wanted_state(
    commands: list[Wanted], arrivals: list[tuple[int, int]]
) -> None:
    """Any subset in any order, some twice, some damaged; then one datagram arrives intact."""
    link = Link()
    link.greet()
    sent = [link.state(2 * S + i * 50 * MS, wanted) for i, wanted in enumerate(commands)]
    newest = -1
    for step, (which, damage) in enumerate(arrivals):
        index = which % len(sent)
        datagram = bytearray(sent[index])
        intact = damage >= 8 * len(datagram)
        if not intact:
            datagram[damage // 8] ^= 1 << damage % 8
        code, event = link.deliver(bytes(datagram), 3 * S + step * MS)
        accepted = intact and index > newest
        assert (code == 0, event == Event.STATE) == (accepted, accepted)
        newest = index if accepted else newest
        assert link.robot.c.peer.rx_sequence == newest + 1
        assert link.robot.c.wanted == (commands[newest] if newest >= 0 else Wanted.IDLE)
    assert balance(link.robot.counters)
    assert link.robot.counters["received"] == len(arrivals)
    link.deliver(link.state(5 * S, Wanted.STOP), 5 * S)
    assert link.robot.c.wanted == Wanted.STOP


def test_datagrams_of_another_session_run_or_table_are_dropped_and_counted() -> None:
    link, other = Link(), Link()
    link.sessions = 6
    link.greet()
    other.greet()
    assert link.deliver(other.state(2 * S), 2 * S)[0] == lib.VS_ERR_SESSION
    foreign = Link(Table())
    foreign.sessions = 6
    foreign.greet()
    assert link.deliver(foreign.state(2 * S), 2 * S)[0] == lib.VS_ERR_TAG
    strange = reseal(foreign.state(2 * S), bytes(link.robot.c.peer.rx_key))
    assert link.deliver(strange, 2 * S)[0] == lib.VS_ERR_TABLE
    late = link.state(2 * S)
    link.run = 2
    assert link.deliver(link.state(3 * S), 3 * S)[0] == 0
    assert link.deliver(late, 3 * S)[0] == lib.VS_ERR_RUN
    mirrored = link.robot.telemetry(3 * S)
    assert link.deliver(mirrored, 3 * S)[0] == lib.VS_ERR_TAG
    mirrored = reseal(mirrored, bytes(link.robot.c.peer.rx_key))
    assert link.deliver(mirrored, 3 * S)[0] == lib.VS_ERR_TYPE
    counters = link.robot.counters
    names = ("foreign_session", "foreign_table", "foreign_run", "foreign_type", "tag")
    assert [counters[name] for name in names] == [1, 1, 1, 1, 2]
    assert balance(counters)


def test_nothing_is_accepted_without_a_session() -> None:
    link = Link()
    link.greet()
    datagram = link.state(2 * S)
    link.robot.disconnect()
    assert link.deliver(datagram, 2 * S) == (lib.VS_ERR_SESSION, Event.NONE)
    with pytest.raises(WireError) as caught:
        link.robot.telemetry(link.robot_ns(2 * S))
    assert caught.value.name == "VS_ERR_STATE"


def test_counters_go_on_over_sessions_and_telemetry_reports_them() -> None:
    link = Link()
    link.greet()
    datagram = link.state(2 * S)
    for data in (datagram, datagram, datagram[:-1]):
        link.deliver(data, 2 * S)
    link.robot.disconnect()
    link.greet(3 * S)
    link.deliver(datagram, 3 * S)
    sent = Telemetry(Wanted.RUN, stop_cause=3, battery_mv=3700, payload=struct.pack("<I", 12))
    heard = link.host.receive_telemetry(
        link.robot.telemetry(link.robot_ns(3 * S), sent), True, 3 * S
    )
    assert heard is not None
    _, said = heard
    assert (said.received, said.old, said.foreign, said.corrupt) == (4, 1, 1, 1)
    assert (said.state, said.stop_cause, said.battery_mv) == (Wanted.RUN, 3, 3700)
    assert said.payload == struct.pack("<I", 12)
    assert said.wanted == Wanted.IDLE
    assert said.clock_bound_us < 100


def test_wanted_state_is_echoed() -> None:
    link = Link()
    link.greet()
    link.run = 4
    link.deliver(link.state(2 * S, Wanted.PAUSE), 2 * S)
    heard = link.host.receive_telemetry(link.robot.telemetry(link.robot_ns(2 * S)), True, 2 * S)
    assert heard is not None
    header, said = heard
    assert (said.wanted, said.wanted_run, header.run) == (Wanted.PAUSE, 4, 4)
    assert (header.timestep, header.capture_ns) == (1, 2 * S)


def test_refuse_and_goodbye_end_the_session_with_a_reason() -> None:
    robot = RobotSession(bytes(16), 23)
    key = answer_key(PUBLISHED, robot.connect(S))
    why = Notice(RefuseCode.TAG_IN_USE, "tag 23 is in use")
    assert robot.tcp_in(encode(Header(PacketType.REFUSE), why, key), S) == [Event.REFUSED]
    assert (robot.notice, robot.c.phase) == (why, lib.VS_PHASE_DOWN)
    link = Link()
    link.greet()
    bye = Notice(GoodbyeCause.TAKEN_OVER, "taken over")
    packet = link.host.encode(Header(PacketType.GOODBYE), bye, 2 * S)
    assert link.robot.tcp_in(packet, link.robot_ns(2 * S)) == [Event.GOODBYE]
    assert (link.robot.notice, link.robot.c.open) == (bye, 0)


def test_robot_says_goodbye_once() -> None:
    link = Link()
    link.greet()
    text = "é" * 150
    packet = link.robot.goodbye(GoodbyeCause.END, text, link.robot_ns(2 * S))
    header, body = link.host.open_packet(packet)
    notice = decode_body(header, body)
    assert header.session == link.host.session
    assert notice == Notice(GoodbyeCause.END, "é" * 100)
    assert link.robot.tcp_out(link.robot_ns(2 * S)) == b""
    with pytest.raises(WireError):
        link.robot.goodbye(GoodbyeCause.END, "", link.robot_ns(2 * S))


@pytest.mark.parametrize("chunk", [1, 2, 7, 71, 72, 1000])
def test_any_chunking_gives_the_same_events(chunk: int) -> None:
    link = Link()
    link.sessions = 1
    stream = link.welcome(S)
    stream += b"".join(link.state(2 * S + i) for i in range(3))
    stream += link.host.encode(Header(PacketType.GOODBYE), Notice(0), 2 * S)
    events = []
    for at in range(0, len(stream), chunk):
        events += link.robot.tcp_in(stream[at : at + chunk], link.robot_ns(2 * S))
    assert events == [Event.OPEN, *[Event.STATE] * 3, Event.GOODBYE]


def break_order(link: Link, what: str) -> bytes:
    welcome, key = Welcome(link.table, 100_000), bytes(link.robot.c.peer.rx_key)
    if what == "second welcome":
        return link.host.encode(Header(PacketType.WELCOME), welcome, 2 * S)
    if what == "late refusal":
        return encode(Header(PacketType.REFUSE), Notice(1), key)
    if what == "goodbye of another session":
        return encode(Header(PacketType.GOODBYE, session=99), Notice(0), key)
    if what == "a robot's packet":
        return encode(Header(PacketType.HELLO), Hello(bytes(16), 1, "", ""), key)
    if what == "damage":
        return link.state(2 * S)[:-16] + bytes(16)
    return b"GET / HTTP/1.1\r\n"


@pytest.mark.parametrize(
    ("what", "name"),
    [
        ("second welcome", "VS_ERR_TYPE"),
        ("late refusal", "VS_ERR_TYPE"),
        ("goodbye of another session", "VS_ERR_SESSION"),
        ("a robot's packet", "VS_ERR_TYPE"),
        ("damage", "VS_ERR_TAG"),
        ("another protocol", "VS_ERR_MAGIC"),
    ],
)
def test_a_host_that_breaks_the_protocol_is_named_and_left(what: str, name: str) -> None:
    link = Link()
    link.greet()
    with pytest.raises(WireError) as caught:
        link.robot.tcp_in(break_order(link, what), link.robot_ns(2 * S))
    assert caught.value.name == name
    assert (link.robot.c.phase, link.robot.c.open) == (lib.VS_PHASE_DOWN, 0)
    with pytest.raises(WireError) as caught:
        link.robot.tcp_in(b"V", link.robot_ns(2 * S))
    assert caught.value.name == "VS_ERR_STATE"
    assert link.greet(3 * S) == [Event.OPEN]


@pytest.mark.parametrize(
    ("header", "name"),
    [
        (Header(PacketType.WELCOME, session=0, table_hash=POLLUTANT.hash), "VS_ERR_SESSION"),
        (Header(PacketType.WELCOME, session=1, table_hash=1), "VS_ERR_TABLE"),
    ],
)
def test_a_welcome_that_contradicts_itself_is_refused(header: Header, name: str) -> None:
    robot = RobotSession(bytes(16), 23)
    key = answer_key(PUBLISHED, robot.connect(S))
    with pytest.raises(WireError) as caught:
        robot.tcp_in(encode(header, Welcome(POLLUTANT, 100_000), key), S)
    assert caught.value.name == name


def test_a_stale_state_on_tcp_is_dropped_without_closing_the_stream() -> None:
    link = Link()
    link.greet()
    first, second = link.state(2 * S, Wanted.RUN), link.state(2 * S + 1, Wanted.STOP)
    assert link.deliver(second, 2 * S)[0] == 0
    assert link.robot.tcp_in(first + second, link.robot_ns(3 * S)) == []
    assert link.robot.c.wanted == Wanted.STOP
    assert link.robot.counters["older"] == link.robot.counters["repeated"] == 1


def test_no_packet_can_be_so_far_ahead_that_all_others_are_old() -> None:
    link = Link()
    link.greet()
    link.run = 1_800_000_000
    heard = link.robot.telemetry(link.robot_ns(2 * S))
    assert link.host.receive_telemetry(heard, True, 2 * S) is not None
    assert link.deliver(link.state(2 * S), 2 * S)[0] == 0
    key = bytes(link.robot.c.peer.rx_key)
    for at, honest, most in ((12, 1, lib.VS_SEQUENCE_JUMP), (16, link.run, lib.VS_RUN_JUMP)):
        for ahead, code in ((most + 1, lib.VS_ERR_JUMP), (2**32 - 2 - honest, lib.VS_ERR_JUMP)):
            packet = link.state(3 * S)
            forged = packet[:at] + (honest + ahead).to_bytes(4, "little") + packet[at + 4 :]
            assert link.deliver(reseal(forged, key), 3 * S)[0] == code
    assert link.deliver(link.state(4 * S), 4 * S)[0] == 0
    assert link.robot.counters["jump"] == 4
    # The host hears of the run only once the robot has.
    said = link.robot.telemetry(link.robot_ns(4 * S))
    assert link.host.receive_telemetry(said, True, 4 * S) is not None


def test_the_last_sequence_number_is_never_sent() -> None:
    link = Link()
    link.greet()
    link.robot.c.peer.tx_sequence = 2**32 - 3
    last = link.robot.telemetry(link.robot_ns(2 * S))
    assert link.host.open_packet(last)[0].sequence == 2**32 - 2
    with pytest.raises(WireError) as caught:
        link.robot.telemetry(link.robot_ns(2 * S))
    assert caught.value.name == "VS_ERR_SEQUENCE"
    assert link.robot.counters["sent"] == 1


def test_a_new_session_starts_the_sequences_anew() -> None:
    host = Peer()
    for session in (1, 2):
        host.open(session, Table(), 1, S)
        packet = host.send_state(Orders(), 1, S, [], S)
        assert open_packet(packet)[0].sequence == 1
    with pytest.raises(ValueError, match="1 values for 0 sensors"):
        host.send_state(Orders(), 1, S, [(b"", 0)], S)


@pytest.mark.parametrize("capture_ns", [2**64 - 1, 2**63, 60 * S])
def test_one_capture_in_the_future_does_not_end_freshness(capture_ns: int) -> None:
    link = Link()
    link.greet()
    link.deliver(link.state(2 * S, capture_ns=capture_ns), 2 * S)
    assert link.robot.c.fresh_ns == 0
    link.deliver(link.state(3 * S, capture_ns=3 * S), 3 * S)
    assert link.robot.c.fresh_ns == link.robot_ns(3 * S)


def test_robot_renews_a_session_whose_numbers_are_used_up() -> None:
    link = Link()
    link.greet()
    link.robot.c.peer.tx_sequence = 2**32 - 2
    with pytest.raises(WireError):
        link.robot.telemetry(link.robot_ns(2 * S))
    header, body = link.host.open_packet(link.robot.tcp_out(link.robot_ns(2 * S)))
    notice = decode_body(header, body)
    assert isinstance(notice, Notice)
    assert (header.type, notice.code) == (PacketType.GOODBYE, GoodbyeCause.RENEW)
    assert link.greet(3 * S) == [Event.OPEN]
