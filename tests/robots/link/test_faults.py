"""One robot's trouble is never another's: real sockets, and every kind of trouble."""

from __future__ import annotations

import contextlib
import os
import socket
import struct
from collections.abc import Callable, Iterator

import pytest

from tests.robots.link.rig import (
    MS,
    PATIENCE_S,
    TABLE,
    Clock,
    Frozen,
    Robot,
    Server,
    closed,
    keyed_session,
    reading,
    works,
)
from tests.wire.robot_session import Event, RobotSession
from vsense.base.native import lib
from vsense.robots.link._links import HELLO_NS, UNGREETED_EACH, UNGREETED_MAX
from vsense.robots.link._roster import TAG_HINT
from vsense.robots.link.keys import INSECURE
from vsense.robots.link.server import VirtualSensorServer
from vsense.robots.link.status import LinkError, LinkEvent, cut_text
from vsense.robots.link.table import ExpectedRobot
from vsense.robots.link.wire import (
    GoodbyeCause,
    Header,
    Hello,
    PacketType,
    RefuseCode,
    decode,
    encode,
)

MakeRobot = Callable[..., Robot]
Connect = Callable[[], socket.socket]


@pytest.fixture
def pending(still: Server) -> Iterator[Connect]:
    """Opens TCP connections that are no robot's."""
    made: list[socket.socket] = []

    def connect() -> socket.socket:
        made.append(socket.create_connection(("127.0.0.1", still.port), PATIENCE_S))
        return made[-1]

    yield connect
    for sock in made:
        sock.close()


def reset(sock: socket.socket) -> None:
    """Closes a connection so that the other end's next call fails."""
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    sock.close()


def in_fallback(still: Server, frozen: Frozen, robot: Robot) -> Robot:
    """A robot whose UDP is blocked, after both sides have noticed."""
    robot.udp_open = False
    robot.open()
    for _ in range(5):
        frozen.advance(250 * MS)
        robot.session.tick(robot.now_ns())
        robot.say()
    still.wait("no_udp", robot.session.c.config.tag)
    return robot


def test_defect_01_any_split_of_the_stream_is_the_same_stream(
    still: Server, robot: MakeRobot
) -> None:
    one = robot(still)
    one.tcp = socket.create_connection(("127.0.0.1", still.port), PATIENCE_S)
    one.tcp.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    for byte in one.session.connect(one.now_ns()):
        one.tcp.send(bytes([byte]))
    one.until(lambda: bool(one.session.c.open))
    packets = b"".join(one.session.telemetry(one.now_ns()) for _ in range(3))
    for start in range(0, len(packets), 50):
        one.tcp.send(packets[start : start + 50])
    one.until(lambda: still.server.robots()[1].accepted == 3)


def test_defect_02_robots_that_break_while_they_are_served_harm_nobody(
    still: Server, frozen: Frozen, robot: MakeRobot
) -> None:
    """The dying robot's state goes over TCP, so that the send itself fails in `publish`."""
    two = robot(still, 2).join()
    for times in range(1, 6):
        one = in_fallback(still, frozen, robot(still, 1))
        two.say()
        reset(one.tcp)
        timestep = 100 * times
        while "lost" not in still.kinds(1)[-1:]:
            timestep += 1
            still.server.publish(timestep, frozen(), {1: reading(1.0, 5)})
            two.timestep(timestep)
        assert works(still, two, timestep + 1)
        still.wait("lost", 1, times)


def test_defect_04_a_stuck_robot_delays_nobody_and_piles_nothing_up(
    still: Server, frozen: Frozen, robot: MakeRobot
) -> None:
    """It never reads: once its stream is full, only the newest reading waits for it."""
    two = robot(still, 2).join()
    one = in_fallback(still, frozen, robot(still, 1))
    one.tcp.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    timestep = 0
    while still.server.robots()[1].superseded < 200:
        timestep += 1
        still.server.publish(timestep, frozen(), {1: reading(1.0, 5), 2: reading(0.0, 5)})
        two.timestep(timestep)
    assert works(still, two, timestep + 1)
    one.timestep(timestep + 1)  # reads at last: whole packets, and the newest one among them
    assert one.value() == 1.0
    assert Event.GOODBYE not in one.events


def test_a_silent_robot_is_told_and_the_other_goes_on(
    still: Server, frozen: Frozen, robot: MakeRobot
) -> None:
    robot(still, 1).join()
    two = robot(still, 2).join()
    for step in range(1, 6):
        frozen.advance(250 * MS)
        assert works(still, two, step)
    assert still.wait("lost", 1).text == "robot 1: nothing heard for 1 s"
    assert still.kinds(2) == ["connected"]


@pytest.mark.parametrize("where", ["its tick", "who takes its events"])
def test_what_fails_at_one_silent_robot_costs_nobody_else(
    still: Server, frozen: Frozen, robot: MakeRobot, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    other = robot(still, 2).join()
    robot(still, 1).join()
    take = still.server._throttle._on_event

    def fails(what: LinkEvent | int) -> None:
        if not isinstance(what, LinkEvent) or (what.kind, what.tag) == ("lost", 1):
            raise RuntimeError("a defect")
        take(what)

    if where == "its tick":
        monkeypatch.setattr(still.server._roster.robots[1], "tick", fails)
    else:
        monkeypatch.setattr(still.server._throttle, "_on_event", fails)
    for timestep in range(1, 6):
        frozen.advance(250 * MS)
        assert works(still, other, timestep)
    assert "RuntimeError: a defect" in still.wait("defect", 1).text
    assert still.server.robots()[1].defects == 1
    still.events.clear()


def test_defect_07_a_huge_length_from_the_wire_is_refused_at_once(
    still: Server, pending: Connect, robot: MakeRobot
) -> None:
    two = robot(still, 2).join()
    bad = pending()
    bad.sendall(struct.pack("<HBBHH", lib.VS_MAGIC, lib.VS_VERSION, PacketType.HELLO, 0, 65535))
    assert b"length" in bad.recv(4096)
    assert closed(bad)
    assert still.wait("refused", None).text.startswith("refused a robot from 127.0.0.1: ")
    assert works(still, two, 1)


@pytest.mark.parametrize("garbage", [b"GET / HTTP/1.0\r\n\r\n", bytes(100_000), os.urandom(5000)])
def test_bytes_that_no_robot_sends_end_their_connection_only(
    still: Server, pending: Connect, robot: MakeRobot, garbage: bytes
) -> None:
    two = robot(still, 2).join()
    bad = pending()
    with contextlib.suppress(ConnectionError):
        bad.sendall(garbage)
    assert closed(bad)
    assert "not a robot" in still.wait("protocol_error", None).text
    assert works(still, two, 1)


def test_a_robot_that_breaks_the_protocol_is_named_and_may_come_again(
    still: Server, robot: MakeRobot
) -> None:
    one, two = robot(still, 1).join(), robot(still, 2).join()
    packet = bytearray(one.session.telemetry(one.now_ns()))
    packet[60] ^= 1
    one.tcp.sendall(packet)
    one.event(Event.GOODBYE)
    assert one.session.notice.code == GoodbyeCause.PROTOCOL
    text = still.wait("protocol_error", 1).text
    assert text.startswith("robot 1: broke the protocol: ")
    assert works(still, two, 1)
    one.join()
    assert still.server.robots()[1].sessions == 2


def test_a_second_hello_on_one_connection_breaks_the_protocol(
    still: Server, robot: MakeRobot
) -> None:
    one = robot(still, 1).join()
    one.tcp.sendall(keyed_session(b"\1" * 16, 1).connect(one.now_ns()))
    one.event(Event.GOODBYE)
    still.wait("protocol_error", 1)


def test_garbage_datagrams_are_counted_and_disturb_nobody(still: Server, robot: MakeRobot) -> None:
    one, two = robot(still, 1).join(), robot(still, 2).join()
    stale = one.session.telemetry(one.now_ns())
    one.say()
    forged = bytearray(stale)
    forged[8] ^= 0xFF
    for datagram in (b"", b"x", os.urandom(1500), bytes(forged), stale, stale + b"more"):
        two.udp.sendto(datagram, ("127.0.0.1", still.port))
    assert works(still, two, 1)
    assert works(still, one, 2)  # nor did the stale datagram's source become its address
    strays = still.server.strays()
    assert sum(strays.values()) == 5
    assert strays["VS_ERR_SESSION"] == 1
    status = still.server.robots()[1]
    assert status.dropped["older"] == 1
    assert status.received == status.accepted + sum(status.dropped.values())


def test_datagrams_of_an_ended_session_are_strays(still: Server, robot: MakeRobot) -> None:
    one = robot(still, 1).join()
    old = one.session.telemetry(one.now_ns())
    one.tcp.close()
    still.wait("lost", 1)
    one.open()
    one.udp.sendto(old, ("127.0.0.1", still.port))
    one.until(lambda: still.server.strays() == {"VS_ERR_SESSION": 1})


def test_who_connects_and_says_nothing_is_closed(
    still: Server, frozen: Frozen, pending: Connect, robot: MakeRobot
) -> None:
    """Half open: no HELLO, or half of one."""
    two = robot(still, 2).join()
    quiet, half = pending(), pending()
    half.sendall(RobotSession(b"\1" * 16, 1).connect(1)[:40])
    assert works(still, two, 1)
    frozen.advance(HELLO_NS)
    assert closed(quiet) and closed(half)
    assert "did not greet within 2 s" in still.wait("protocol_error", None).text
    assert works(still, two, 2)


def test_a_crowd_of_strangers_cannot_keep_a_robot_out(
    still: Server, pending: Connect, robot: MakeRobot
) -> None:
    """The oldest pending makes way: memory and descriptors are bounded, the door stays open."""
    crowd = [pending() for _ in range(UNGREETED_EACH + 10)]
    one = robot(still, 1).join()
    assert all(closed(sock) for sock in crowd[:10])
    assert works(still, one, 1)
    assert still.wait("protocol_error", None).text == "127.0.0.1: too many connections at once"


def test_a_crowd_from_many_addresses_cannot_keep_a_robot_out(
    still: Server, robot: MakeRobot
) -> None:
    crowd = [
        socket.create_connection(("127.0.0.1", still.port), PATIENCE_S, (f"127.0.1.{n}", 0))
        for n in range(1, UNGREETED_MAX + 20)
    ]
    one = robot(still, 1).join()
    assert all(closed(sock) for sock in crowd[:19])
    assert works(still, one, 1)
    for sock in crowd:
        sock.close()


def test_an_established_robot_is_not_limited_by_strangers_of_its_address(
    still: Server, pending: Connect, robot: MakeRobot
) -> None:
    one, two = robot(still, 1).join(), robot(still, 2).join()
    crowd = [pending() for _ in range(200)]
    assert closed(crowd[0])
    assert works(still, one, 1) and works(still, two, 2)
    assert still.server.robots()[1].sessions == 1


@pytest.mark.parametrize("tag", [0, 3, 65535])
def test_an_unknown_tag_is_refused_and_both_sides_say_so(
    still: Server, robot: MakeRobot, tag: int
) -> None:
    one = robot(still, tag).connect()
    one.event(Event.REFUSED)
    assert one.session.notice.code == RefuseCode.TAG_UNKNOWN
    text = f"tag {tag} is not in this experiment; expected: 1, 2. {TAG_HINT}"
    assert one.session.notice.text == cut_text(text)
    assert "--for EXPERIMENT" in text and "--roster robots.toml" in text
    assert still.wait("refused", tag).text == f"refused a robot from 127.0.0.1: {text}"


def test_defect_15_another_version_is_refused_and_both_sides_say_so(
    still: Server, pending: Connect
) -> None:
    newer = pending()
    hello = bytearray(encode(Header(PacketType.HELLO), Hello(b"\1" * 16, 1, "robot", "test")))
    hello[2] = lib.VS_VERSION + 1
    newer.sendall(hello)
    header, notice = decode(newer.recv(4096))
    assert header.type == PacketType.REFUSE
    text = "newer than this host (protocol version 4): bring vsense up to date here"
    assert text in str(notice) and text in still.wait("refused", None).text
    assert closed(newer)


def test_blocked_udp_goes_over_tcp_and_comes_back(
    still: Server, frozen: Frozen, robot: MakeRobot
) -> None:
    one = in_fallback(still, frozen, robot(still, 1))
    assert one.session.c.udp_lost  # both ends know
    assert works(still, one, 5)
    assert not still.server.robots()[1].udp
    one.udp_open = True
    one.say()  # the host answers at once where this came from
    one.until(lambda: bool(one.session.c.peer.udp_heard))
    one.say()
    still.wait("udp_back", 1)
    assert still.server.robots()[1].udp
    assert still.kinds(1) == ["connected", "no_udp", "udp_back"]


def test_udp_blocked_towards_the_robot_alone(
    still: Server, frozen: Frozen, robot: MakeRobot
) -> None:
    """Its datagrams arrive, ours do not: it says so, and gets its state over TCP."""
    one = robot(still, 1).open()
    one.udp_open = False
    for times in range(2, 7):
        frozen.advance(240 * MS)
        packet = one.session.telemetry(one.now_ns())
        one.udp.sendto(packet, ("127.0.0.1", still.port))
        one.until(lambda times=times: still.server.robots()[1].accepted == times)
    assert "it hears no UDP from us" in still.wait("no_udp", 1).text
    still.server.publish(9, frozen(), {})
    one.timestep(9)


def test_used_up_sequence_numbers_renew_the_session(
    still: Server, frozen: Frozen, robot: MakeRobot
) -> None:
    one = robot(still, 1).join()
    still.server._roster.robots[1].peer._peer.tx_sequence = lib.VS_SEQUENCE_MAX - 10
    frozen.advance(50 * MS)
    one.event(Event.GOODBYE)
    assert one.session.notice.code == GoodbyeCause.RENEW
    one.join()
    assert works(still, one, 1)


def test_a_datagram_that_the_kernel_refuses_is_counted_for_its_robot(
    still: Server, robot: MakeRobot
) -> None:
    robot(still, 1).join()
    two = robot(still, 2).join()
    still.server._roster.robots[1].address = ("127.0.0.1", 0)
    assert works(still, two, 1)
    assert still.server.robots()[1].unsent == 1


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_fault_of_the_thread_reaches_the_runtime(clock: Clock, robot: MakeRobot) -> None:
    def broken(_: LinkEvent) -> None:
        raise KeyError("listener")

    server = VirtualSensorServer(
        host="127.0.0.1",
        port=0,
        timestep_ns=100 * MS,
        seed=1,
        expected={1: ExpectedRobot("epuck_1", TABLE)},
        trust=INSECURE,
        on_event=broken,
    )
    port = server.start()
    with socket.create_connection(("127.0.0.1", port), PATIENCE_S) as sock:
        sock.sendall(b"not a robot")
        assert closed(sock)
    server.close()
    with pytest.raises(LinkError, match="listener"):
        server.publish(1, 1, {})
