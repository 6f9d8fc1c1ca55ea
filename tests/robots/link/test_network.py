"""The server's thread, driven by hand: it waits in the selector only, and never in circles."""

from __future__ import annotations

import errno
import socket
import threading
from collections.abc import Iterator, Sequence
from typing import Any

import pytest

from tests.robots.link.rig import KEYS, PATIENCE_S, TABLE, Frozen, keyed_session
from tests.wire.robot_session import Event, RobotSession
from vsense.robots.link._links import FINISH_NS, UNGREETED_EACH
from vsense.robots.link._roster import SessionTable
from vsense.robots.link._session import HostSession
from vsense.robots.link._shared import ServerState
from vsense.robots.link.keys import LinkTrust
from vsense.robots.link.network import SELECT_TIMEOUT_NS, Ports, ServerThread, bind
from vsense.robots.link.status import LinkEvent
from vsense.robots.link.table import ExpectedRobot
from vsense.robots.link.wire import GoodbyeCause


class Hand:
    """A network whose turns the test makes, and robots that only send what the test sends."""

    def __init__(self, frozen: Frozen, ports: Ports, tags: Sequence[int] = (1, 2)) -> None:
        self.clock = frozen
        self.port = ports.port
        self.told: list[LinkEvent] = []
        expected = {t: ExpectedRobot(f"epuck_{t}", TABLE) for t in tags}
        roster = SessionTable(expected, 10**8, 1, LinkTrust(KEYS))
        self.shared = ServerState(roster, threading.Lock(), frozen, self.told.append)
        self.network = ServerThread(self.shared, ports)
        self.settle()

    def settle(self) -> None:
        """Makes turns until no socket is ready; a thread would now wait."""
        for _ in range(200):
            self.network.turn()
            if not self.network._selector.select(0):
                return
        raise AssertionError("some socket is ready for ever: the thread would turn in circles")

    def join(self, tag: int) -> tuple[RobotSession, socket.socket]:
        session = keyed_session(bytes([tag]) * 16, tag)
        sock = socket.create_connection(("127.0.0.1", self.port), PATIENCE_S)
        sock.sendall(session.connect(self.clock()))
        self.settle()
        session.tcp_in(sock.recv(4096), self.clock())
        assert session.c.open
        sock.sendall(session.telemetry(self.clock()))
        self.settle()
        assert self.shared.roster.robots[tag].open
        return session, sock

    def send(self, tag: int) -> None:
        with self.shared.lock:
            self.network.send(self.shared.roster.robots[tag], self.clock())


@pytest.fixture
def hand(frozen: Frozen) -> Iterator[Hand]:
    made = Hand(frozen, bind("127.0.0.1", 0))
    yield made
    made.network.close()


def test_defect_06_a_full_stream_is_waited_for_not_asked_again_and_again(hand: Hand) -> None:
    _, sock = hand.join(1)
    robot = hand.shared.roster.robots[1]
    while robot.superseded < 3:
        hand.send(1)
    hand.settle()
    sock.recv(1 << 20)
    hand.settle()
    sock.close()


def test_defect_06_a_peer_that_keeps_its_side_open_is_waited_for(hand: Hand) -> None:
    session, sock = hand.join(1)
    sock.sendall(session.goodbye(GoodbyeCause.END, "", hand.clock()))
    hand.settle()
    assert [event.kind for event in hand.told] == ["connected", "goodbye"]
    hand.clock.advance(FINISH_NS // 2)
    hand.settle()
    assert len(hand.network._links) == 1, "it may read the last word"
    hand.clock.advance(FINISH_NS // 2)
    hand.settle()
    assert len(hand.network._links) == 0
    sock.close()


def test_without_descriptors_the_door_is_closed_for_a_moment(frozen: Frozen) -> None:
    class Full(socket.socket):
        """A listener in a process that has no descriptor left."""

        full = True

        def accept(self) -> tuple[socket.socket, object]:
            if self.full:
                raise OSError(errno.EMFILE, "Too many open files")
            return super().accept()

    ports = bind("127.0.0.1", 0)
    listener = Full(fileno=ports.tcp.detach())
    hand = Hand(frozen, Ports(listener, ports.udp, ports.port))
    sock = socket.create_connection(("127.0.0.1", ports.port), PATIENCE_S)
    # One turn with the door open, one with it closed: then nothing is ready, nothing turns.
    hand.network.turn()
    assert hand.told[-1].text == "cannot accept a connection: Too many open files"
    assert not hand.network._selector.select(0)
    Full.full = False
    hand.network.wake()
    hand.settle()
    assert len(hand.network._links) == 1
    sock.close()
    hand.network.close()


def test_a_connection_that_was_closed_earlier_in_the_same_turn_is_left_alone(hand: Hand) -> None:
    """Defect 2: both sockets of a takeover are ready at once; one handler closes the other's."""
    _, old_sock = hand.join(1)
    new = keyed_session(bytes([1]) * 16, 1)
    new_sock = socket.create_connection(("127.0.0.1", hand.port), PATIENCE_S)
    new_sock.sendall(new.connect(hand.clock()))
    hand.settle()
    new.tcp_in(new_sock.recv(4096), hand.clock())
    new_sock.sendall(new.telemetry(hand.clock()))
    old_sock.sendall(b"not a packet")
    hand.settle()
    assert hand.shared.roster.robots[1].open
    assert "protocol_error" not in [e.kind for e in hand.told if e.tag is None]
    for sock in (old_sock, new_sock):
        sock.close()


def test_the_end_takes_nobody_in_and_waits_for_the_last_words(hand: Hand) -> None:
    session, sock = hand.join(1)

    def read_to_the_end() -> None:
        while data := sock.recv(4096):
            session.tcp_in(data, hand.clock())
        sock.close()

    reader = threading.Thread(target=read_to_the_end)
    reader.start()
    hand.network.finish(GoodbyeCause.END, "good night")
    reader.join()
    assert session.notice.text == "good night"
    assert len(hand.network._links) == 0


def test_the_end_leaves_the_door_closed(hand: Hand) -> None:
    hand.network._links.finish(GoodbyeCause.END, "good night")
    hand.clock.advance(SELECT_TIMEOUT_NS)
    hand.settle()
    with socket.create_connection(("127.0.0.1", hand.port), PATIENCE_S):
        hand.settle()
        assert len(hand.network._links) == 0


def test_a_stream_left_unfinished_wakes_the_thread(hand: Hand) -> None:
    _, sock = hand.join(1)
    hand.network.wake_for_streams()
    assert not hand.network._selector.select(0)
    while not hand.shared.roster.robots[1].superseded:
        hand.send(1)
    hand.network.wake_for_streams()
    assert hand.network._selector.select(0)
    sock.close()


def test_a_hundred_robots_behind_one_relay_come_at_once_among_strangers(frozen: Frozen) -> None:
    """The host was busy: all of them, and as many strangers, are there when it looks."""
    ports = bind("127.0.0.1", 0)
    hand = Hand(frozen, ports, range(100))
    made = []
    for tag in range(100):
        session = keyed_session(tag.to_bytes(16, "big"), tag)
        made.append((session, socket.create_connection(("127.0.0.1", ports.port), PATIENCE_S)))
        made[-1][1].sendall(session.connect(hand.clock()))
        made.append((None, socket.create_connection(("127.0.0.1", ports.port), PATIENCE_S)))
    hand.settle()
    robots = [(session, sock) for session, sock in made if session is not None]
    for session, sock in robots:
        session.tcp_in(sock.recv(4096), hand.clock())
        assert session.c.open
        sock.sendall(session.telemetry(hand.clock()))
        hand.settle()
    assert all(robot.open for robot in hand.shared.roster.robots.values())
    assert len(hand.network._links) <= 100 + UNGREETED_EACH
    for _, sock in made:
        sock.close()
    hand.network.close()


def failing(monkeypatch: pytest.MonkeyPatch, method: str, tag: int = 1) -> None:
    """Has what one robot says meet a bug of ours."""
    works = getattr(HostSession, method)

    def fails(self: HostSession, *rest: Any) -> Any:
        if self.tag == tag:
            raise OverflowError("int too big to convert")
        return works(self, *rest)

    monkeypatch.setattr(HostSession, method, fails)


def told_defect(hand: Hand, tag: int = 1) -> None:
    """It was told once, with its cause and place, and counted for this robot."""
    (event,) = [event for event in hand.told if event.kind == "defect"]
    assert event.tag == tag
    assert f"robot {tag}: a defect in vsense has ended its session" in event.text
    assert "OverflowError: int too big to convert (vsense/robots/link/" in event.text
    robots = hand.shared.roster.robots.values()
    assert [robot.status(hand.clock()).defects for robot in robots] == [1, 0]


@pytest.mark.parametrize("way", ["udp", "tcp"])
def test_a_defect_at_one_robots_packet_ends_its_session_and_no_other(
    hand: Hand, monkeypatch: pytest.MonkeyPatch, way: str
) -> None:
    (one, sock), (two, other_sock) = hand.join(1), hand.join(2)
    packet = one.telemetry(hand.clock())
    with monkeypatch.context() as patch:
        failing(patch, "take")
        if way == "udp":
            hand.network._dispatch(packet, ("127.0.0.1", 9), hand.clock())
        else:
            sock.sendall(packet)
        hand.settle()
    told_defect(hand)
    robots = hand.shared.roster.robots
    assert not robots[1].open and robots[2].open
    events = one.tcp_in(sock.recv(1 << 16), hand.clock())
    assert Event.GOODBYE in events and not one.c.open, "its wheels stop as after any session"
    assert one.notice.code == GoodbyeCause.PROTOCOL and "OverflowError" in one.notice.text
    before = robots[2].peer.counters["accepted"]
    other_sock.sendall(two.telemetry(hand.clock()))
    hand.settle()
    assert robots[2].peer.counters["accepted"] == before + 1
    _, again = hand.join(1)
    assert robots[1].open, "it may come again"
    for each in (sock, other_sock, again):
        each.close()


@pytest.mark.parametrize("opened", [False, True])
def test_a_defect_at_the_first_packet_leaves_no_session_half_open(
    hand: Hand, monkeypatch: pytest.MonkeyPatch, opened: bool
) -> None:
    """It opens the session: on its way the roster knows the robot, and the connection does not."""
    socks = [hand.join(2)[1]]
    if opened:
        socks.append(hand.join(1)[1])
    with monkeypatch.context() as patch:
        failing(patch, "take")
        with pytest.raises(AssertionError):
            hand.join(1)
    told_defect(hand)
    assert not hand.shared.roster.robots[1].open
    hand.clock.advance(FINISH_NS)
    hand.settle()
    assert len(hand.network._links) == 1, "the other robot's"
    socks.append(hand.join(1)[1])
    hand.send(1)
    for sock in socks:
        sock.close()


def test_a_defect_that_shows_in_time_ends_one_session(
    hand: Hand, monkeypatch: pytest.MonkeyPatch
) -> None:
    socks = [hand.join(tag)[1] for tag in (1, 2)]
    with monkeypatch.context() as patch:
        failing(patch, "tick")
        failing(patch, "goodbye")
        hand.network.wake()
        hand.settle()
    told_defect(hand)
    assert hand.shared.roster.robots[2].open and not hand.shared.roster.robots[1].open
    for sock in socks:
        sock.close()


def test_a_defect_where_the_runtime_sends_ends_one_session(
    hand: Hand, monkeypatch: pytest.MonkeyPatch
) -> None:
    socks = [hand.join(tag)[1] for tag in (1, 2)]
    with monkeypatch.context() as patch:
        failing(patch, "state")
        for tag in (1, 2):
            hand.send(tag)
        hand.settle()
    told_defect(hand)
    assert hand.shared.roster.robots[2].open and not hand.shared.roster.robots[1].open
    for sock in socks:
        sock.close()


def test_a_defect_at_a_strangers_greeting_ends_its_connection(
    hand: Hand, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, sock = hand.join(2)
    with monkeypatch.context() as patch:
        failing(patch, "taken_from")
        with pytest.raises(AssertionError):
            hand.join(1)
    (event,) = [event for event in hand.told if event.kind == "defect"]
    assert event.tag is None and event.origin == "127.0.0.1" and "OverflowError" in event.text
    assert hand.shared.roster.robots[2].open
    sock.close()
