"""What somebody who hears every packet, and sends any, can do: with keys nothing that matters.

The attacker here knows the protocol and everything but the robots' keys. Without keys it knows
these, too: then the host says what is happening, and what was done heals by itself.
"""

from __future__ import annotations

import json
import select
import socket
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import pytest

from tests.rigs.places import ROOT
from tests.robots.link.rig import (
    KEYS,
    MS,
    PATIENCE_S,
    Clock,
    Frozen,
    Robot,
    S,
    Server,
    closed,
    keyed_session,
    reading,
    works,
)
from tests.wire.robot_session import Event, RobotSession
from tests.wire.strategies import reseal
from vsense.base.native import WireError, lib
from vsense.robots.link._links import GREETED_EACH, HELLO_NS
from vsense.robots.link.keys import INSECURE, LinkTrust
from vsense.robots.link.status import RobotStatus
from vsense.robots.link.wire import (
    PUBLISHED,
    GoodbyeCause,
    Header,
    Notice,
    PacketType,
    RefuseCode,
    Wanted,
    answer_key,
    encode,
    packet_length,
    session_keys,
)

MakeRobot = Callable[..., Robot]
UID = b"\1" * 16
SEQUENCE_AT, RUN_AT, WANTED_AT = 12, 16, 56


@dataclass
class Attacker:
    """A station on the robots' network, with an address of its own."""

    server: Server
    udp: socket.socket
    connections: list[socket.socket]
    sent: int = 0

    def send(self, datagram: bytes) -> None:
        """A datagram to the host."""
        self.udp.sendto(datagram, ("127.0.0.1", self.server.port))
        self.sent += 1

    def connect(self, *packets: bytes) -> socket.socket:
        """A connection to the host that begins with these packets."""
        address = ("127.0.0.1", self.server.port)
        made = socket.create_connection(address, PATIENCE_S, ("127.0.0.2", 0))
        self.connections.append(made)
        made.sendall(b"".join(packets))
        return made


@pytest.fixture
def open_house(frozen: Frozen) -> Iterator[Server]:
    """A server that takes robots without keys."""
    made = Server(frozen, trust=INSECURE)
    yield made
    made.close()


@pytest.fixture
def attacker() -> Iterator[Callable[[Server], Attacker]]:
    made: list[Attacker] = []

    def make(server: Server) -> Attacker:
        udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        udp.bind(("127.0.0.2", 0))
        made.append(Attacker(server, udp, []))
        return made[-1]

    yield make
    for one in made:
        for sock in (one.udp, *one.connections):
            sock.close()


MakeAttacker = Callable[[Server], Attacker]


def packets(robot: Robot, way: str) -> list[bytes]:
    """Everything that was heard of a robot's link, packet by packet."""
    found, stream = [], b"".join(data for of, data in robot.wire if of == way)
    while stream:
        length = packet_length(stream) or len(stream)
        found.append(stream[:length])
        stream = stream[length:]
    return found


def changed(packet: bytes, at: int, value: int, size: int, key: bytes | None) -> bytes:
    """A packet with another number in it, tagged with a key or as it was."""
    made = packet[:at] + value.to_bytes(size, "little") + packet[at + size :]
    return made if key is None else reseal(made, key)


def settled(server: Server, one: Robot, attacker: Attacker | None = None) -> RobotStatus:
    """The victim's status once the host has read all that both have sent.

    It is counted: datagrams of two sockets may overtake each other, even on loopback.
    """
    sent = one.copies + (attacker.sent if attacker else 0)

    def read() -> int:
        victim = server.server.robots()[1]
        judged = victim.accepted + sum(victim.dropped.values())
        return judged + sum(server.server.strays().values())

    one.until(lambda: read() >= sent)
    assert read() == sent
    return server.server.robots()[1]


def forgeries(robot: Robot) -> list[bytes]:
    """Telemetry that would change everything, with every key that the attacker has."""
    newest = packets(robot, "up")[-1]
    keys = [None, PUBLISHED, KEYS.robot_key(b"\2" * 16), bytes(16)]
    keys += [answer_key(PUBLISHED, packets(robot, "up")[0])]
    keys += session_keys(PUBLISHED, packets(robot, "up")[0], packets(robot, "down")[0])
    made = [changed(newest, SEQUENCE_AT, n, 4, key) for key in keys for n in (9, 900, 2**32 - 2)]
    return made + [changed(newest, RUN_AT, 2**32 - 1, 4, key) for key in keys]


def test_what_was_heard_changes_nothing_when_it_comes_again(
    still: Server, robot: MakeRobot, attacker: MakeAttacker
) -> None:
    one, thief = robot(still, 1).join(), attacker(still)
    for step in range(1, 6):
        assert works(still, one, step)
    before = still.server.robots()[1]
    for packet in [*packets(one, "up"), *packets(one, "down")]:
        thief.send(packet)
    after = settled(still, one, thief)
    assert (after.accepted, after.sessions, after.telemetry) == (
        *(before.accepted, before.sessions, before.telemetry),
    )
    assert works(still, one, 6), "nor does anything go to the attacker now"
    c = one.session.c
    state = (c.wanted, c.run, c.timestep, c.peer.rx_sequence, c.fresh_ns)
    for packet in [*packets(one, "down"), *packets(one, "up")]:
        code, _ = one.session.udp_in(packet, one.now_ns())
        assert code < 0
    assert (c.wanted, c.run, c.timestep, c.peer.rx_sequence, c.fresh_ns) == state
    assert still.kinds(1) == ["connected"]


def test_whoever_passes_on_what_it_hears_faster_takes_nothing_away(
    still: Server, frozen: Frozen, robot: MakeRobot, attacker: MakeAttacker
) -> None:
    """The host answers where the newest datagram came from, and both have sent the same one."""
    one, thief = robot(still, 1).join(), attacker(still)
    for step in range(1, 30):
        packet = one.session.telemetry(one.now_ns())
        accepted = still.server.robots()[1].accepted
        thief.send(packet)
        one.until(lambda n=accepted: still.server.robots()[1].accepted > n)
        one.send(packet)
        settled(still, one, thief)
        still.server.publish(step, frozen(), {})
        one.timestep(step)
        frozen.advance(50 * MS)
    one.say()
    frozen.advance(1 * S)
    one.say()
    settled(still, one, thief)
    assert works(still, one, 99)
    assert still.server._roster.robots[1].copied is None, "it is over"


def test_nothing_that_is_made_up_is_believed_by_the_host(
    still: Server, robot: MakeRobot, attacker: MakeAttacker
) -> None:
    one, thief = robot(still, 1).join(), attacker(still)
    before = still.server.robots()[1]
    made = forgeries(one)
    for packet in made:
        thief.send(packet)
    after = settled(still, one, thief)
    assert after.accepted == before.accepted
    assert after.dropped["tag"] == before.dropped["tag"] + len(made)
    assert works(still, one, 1)


def test_nothing_that_is_made_up_moves_the_robot(still: Server, robot: MakeRobot) -> None:
    one = robot(still, 1).join()
    still.server.command(Wanted.STOP)
    one.until(lambda: one.session.c.wanted == Wanted.STOP)
    newest = [p for p in packets(one, "down") if p[3] == PacketType.STATE][-1]
    up, down = packets(one, "up")[0], packets(one, "down")[0]
    for key in (PUBLISHED, KEYS.robot_key(b"\2" * 16), *session_keys(PUBLISHED, up, down)):
        for ahead in (1, 1000, 10**6):
            moved = changed(newest, WANTED_AT, Wanted.RUN, 1, None)
            sequence = one.session.c.peer.rx_sequence + ahead
            forged = changed(moved, SEQUENCE_AT, sequence, 4, key)
            assert one.session.udp_in(forged, one.now_ns())[0] == lib.VS_ERR_TAG
    assert one.session.c.wanted == Wanted.STOP
    bye = Header(PacketType.GOODBYE, session=one.session.c.peer.session)
    forged = encode(bye, Notice(GoodbyeCause.TAKEN_OVER))
    assert one.session.tcp_in(forged, one.now_ns()) == [Event.DOUBTED]
    assert one.session.c.open and one.session.c.wanted == Wanted.STOP


def test_a_greeting_that_was_heard_opens_nothing(
    still: Server, frozen: Frozen, robot: MakeRobot, attacker: MakeAttacker
) -> None:
    """Neither one of today, nor one of yesterday that this host has never seen."""
    one, thief = robot(still, 1).join(), attacker(still)
    hello, proof = packets(one, "up")[:2]
    assert closed(thief.connect(hello, proof)), "no greeting counts twice"
    assert "127.0.0.2 repeats a greeting" in still.wait("refused", 1).text
    mirror = thief.connect(keyed_session(UID, 1).connect(S), proof)
    assert mirror.recv(4096)[3] == PacketType.WELCOME, "the robot itself may have greeted anew"
    for packet in forgeries(one):
        thief.send(packet)
    assert works(still, one, 1)
    assert still.server.robots()[1].sessions == 1
    for step in range(2, 12):
        frozen.advance(HELLO_NS // 10)
        assert works(still, one, step)
    assert closed(mirror)
    assert "did not show that it is a robot" in still.wait("protocol_error", None).text
    assert still.kinds(1) == ["connected", "refused"]
    assert works(still, one, 99)


def test_nobody_takes_a_place_before_the_robot_comes(
    still: Server, frozen: Frozen, robot: MakeRobot, attacker: MakeAttacker
) -> None:
    """By greetings of yesterday, with another key, or without one."""
    one, thief = robot(still, 1).join(), attacker(still)
    one.tcp.close()
    still.wait("lost", 1)
    frozen.advance(2 * S)
    squatters = [thief.connect(keyed_session(UID, 1).connect(S)) for _ in range(3)]
    for key in (None, KEYS.robot_key(b"\2" * 16)):
        squatters.append(thief.connect(RobotSession(UID, 1, key=key).connect(S)))
    assert [sock.recv(4096)[3] for sock in squatters] == [PacketType.WELCOME] * 3 + [
        PacketType.REFUSE
    ] * 2
    assert not still.server.robots()[1].connected
    robot(still, 1).join()
    assert still.server.robots()[1].connected
    assert still.server.robots()[1].uid == UID


def test_a_repeated_greeting_pushes_no_robot_out(
    still: Server, robot: MakeRobot, attacker: MakeAttacker
) -> None:
    """Its answer is on its way while somebody sends what it has just said, and said before."""
    one, thief = robot(still, 1).join(), attacker(still)
    one.tcp.close()
    still.wait("lost", 1)
    sessions = still.server.robots()[1].sessions
    one.connect()
    hellos = [packet for packet in packets(one, "up") if packet[3] == PacketType.HELLO]
    assert select.select([one.tcp], [], [], PATIENCE_S)[0], "the answer is there, and not yet read"
    thief.connect(hellos[-1])  # this one is answered from the thief's address, once
    for _ in range(2 * GREETED_EACH):
        for hello in hellos:
            assert closed(thief.connect(hello))
    one.until(lambda: bool(one.session.c.open))
    one.say()
    one.until(lambda: still.server.robots()[1].sessions > sessions)


def test_a_copy_that_arrives_before_the_greeting_keeps_no_robot_out(
    still: Server, robot: MakeRobot, attacker: MakeAttacker
) -> None:
    one, thief = robot(still, 1).join(), attacker(still)
    one.tcp.close()
    still.wait("lost", 1)

    def copy(hello: bytes) -> None:
        assert select.select([thief.connect(hello)], [], [], PATIENCE_S)[0], "it is answered"
        assert closed(thief.connect(hello)), "once"

    one.open(copy)


@pytest.mark.parametrize("keyed", [False, True])
def test_whoever_has_no_right_key_is_refused_and_told_of(
    still: Server, robot: MakeRobot, attacker: MakeAttacker, keyed: bool
) -> None:
    one, thief = robot(still, 1).join(), attacker(still)
    key = KEYS.robot_key(b"\2" * 16) if keyed else None
    stranger = RobotSession(UID, 1, key=key)
    answer = thief.connect(stranger.connect(S)).recv(4096)
    heard = stranger.tcp_in(answer, S)
    assert heard == [Event.DOUBTED if keyed else Event.REFUSED]
    text = "another key than this host's" if keyed else "no key, and this host takes no robot"
    assert stranger.notice.code == RefuseCode.KEY and text in stranger.notice.text
    assert "robot 1 has" in still.wait("refused", 1).text
    assert still.server.robots()[1].refused == "", "it is connected, whoever says what"
    assert works(still, one, 1)


def test_a_host_that_has_no_key_says_so_of_robots_that_have_one(
    open_house: Server, robot: MakeRobot
) -> None:
    one = robot(open_house, 1).connect()
    one.event(Event.DOUBTED)
    assert "this host has none" in open_house.wait("refused", 1).text
    assert "this host has none" in open_house.server.robots()[1].refused


def test_a_host_without_the_key_changes_nothing_at_the_robot(robot: MakeRobot) -> None:
    ours, theirs = keyed_session(UID, 1), RobotSession(UID, 1)
    hello = ours.connect(S)
    theirs.connect(S)
    refuse = encode(Header(PacketType.REFUSE), Notice(1, "go"), answer_key(PUBLISHED, hello))
    assert ours.tcp_in(refuse, S) == [Event.DOUBTED]
    assert ours.c.phase == lib.VS_PHASE_WAIT
    with pytest.raises(WireError, match="tag"):
        ours.tcp_in(encode(Header(PacketType.REFUSE), Notice(1, "go")), S)


def test_stop_comes_both_ways_and_nothing_older_starts_again(
    still: Server, robot: MakeRobot
) -> None:
    one = robot(still, 1).join()
    still.server.command(Wanted.RUN)
    still.server.publish(1, still.clock(), {1: reading(1.0, 5)})
    one.until(lambda: one.session.c.wanted == Wanted.RUN)
    one.wire.clear()
    one.udp_open = False  # every datagram is jammed
    still.server.command(Wanted.STOP)
    one.until(lambda: one.session.c.wanted == Wanted.STOP)
    one.until(lambda: len(packets(one, "down")) > len(set(packets(one, "down"))))
    one.udp_open = True
    for packet in packets(one, "down"):
        one.session.udp_in(packet, one.now_ns())
    assert one.session.c.wanted == Wanted.STOP


def test_without_keys_a_deaf_host_says_so_and_hears_again(
    open_house: Server, frozen: Frozen, robot: MakeRobot, attacker: MakeAttacker
) -> None:
    one, thief = robot(open_house, 1, keyed=False).join(), attacker(open_house)
    _, up = session_keys(PUBLISHED, packets(one, "up")[0], packets(one, "down")[0])
    assert works(open_house, one, 1)
    newest = packets(one, "up")[-1]
    thief.send(changed(newest, SEQUENCE_AT, 2**32 - 2, 4, up))
    assert settled(open_house, one, thief).dropped["jump"] == 1
    assert works(open_house, one, 2)
    sequence = one.session.c.peer.tx_sequence
    thief.send(changed(newest, SEQUENCE_AT, sequence + 1000, 4, up))
    text = open_house.wait("doubt", 1).text
    assert "come from 127.0.0.2 now, no longer from 127.0.0.1" in text
    for _ in range(11):
        received = open_house.server.robots()[1].received
        one.say()
        one.until(lambda n=received: open_house.server.robots()[1].received > n)
        frozen.advance(100 * MS)
    one.event(Event.GOODBYE)
    assert one.session.notice.code == GoodbyeCause.RENEW
    assert "its session is renewed" in open_house.wait("doubt", 1, times=2).text
    one.join()
    assert works(open_house, one, 3)


def test_a_goodbye_without_the_key_ends_nothing(still: Server, robot: MakeRobot) -> None:
    one = robot(still, 1).join()
    bye = Header(PacketType.GOODBYE, session=one.session.c.peer.session)
    one.tcp.sendall(encode(bye, Notice(GoodbyeCause.END)))
    assert "says goodbye in its name; it stays" in still.wait("doubt", 1).text
    assert works(still, one, 1)
    assert still.server.robots()[1].sessions == 1


def test_what_comes_again_to_a_host_that_hears_renews_nothing(
    still: Server, frozen: Frozen, robot: MakeRobot, attacker: MakeAttacker
) -> None:
    one, thief = robot(still, 1).join(), attacker(still)
    assert works(still, one, 1)
    old = packets(one, "up")[-1]
    for timestep in range(2, 14):
        assert works(still, one, timestep)
        thief.send(old)
        settled(still, one, thief)
        frozen.advance(100 * MS)
        still.server.publish(timestep, still.clock(), {})
    assert works(still, one, 14)
    status = still.server.robots()[1]
    assert status.dropped["older"] >= 12 and status.sessions == 1


def test_one_straggler_before_a_silence_renews_nothing(
    still: Server, frozen: Frozen, robot: MakeRobot
) -> None:
    one = robot(still, 1).join()
    assert works(still, one, 1)
    for _ in range(3):
        one.say()
        older = settled(still, one).dropped["older"]
    # Not the first: that may have been said before the robot knew the run.
    one.send(packets(one, "up")[2])
    assert settled(still, one).dropped["older"] == older + 1
    frozen.advance(3 * S)
    assert works(still, one, 2)
    assert still.server.robots()[1].sessions == 1


def test_without_keys_a_stolen_session_is_told_of(
    open_house: Server, robot: MakeRobot, attacker: MakeAttacker
) -> None:
    one, thief = robot(open_house, 1, keyed=False).join(), attacker(open_house)
    assert open_house.wait("connected", 1).text.endswith("controller test, without a key")
    other = RobotSession(UID, 1)
    sock = thief.connect(other.connect(S))
    while not other.c.open:
        other.tcp_in(sock.recv(4096), S)
    sock.sendall(other.telemetry(S))
    text = open_house.wait("takeover", 1).text
    assert "from 127.0.0.2" in text and text.endswith("the old one, from 127.0.0.1, is closed")
    one.event(Event.GOODBYE)


def version_1(tag: int) -> bytes:
    """A HELLO as robots sent it first: header, uid, nonce, tag, capabilities, two texts, tail."""
    body = UID + bytes(8) + struct.pack("<HH", tag, 0) + b"\5robot\4test"
    head = struct.pack("<HBBHH", lib.VS_MAGIC, 1, PacketType.HELLO, 0, 56 + len(body) + 20)
    return head + bytes(48) + body + bytes(20)


def version_2() -> bytes:
    """What a vsensed of that version once said, to whom it may concern."""
    recorded = json.loads((ROOT / "tests" / "golden" / "version_2.json").read_text())
    return bytes.fromhex(recorded["hello"])


@pytest.mark.parametrize("hello", [version_1(1), version_2()], ids=["1", "2"])
def test_a_robot_with_an_older_protocol_is_told_of_by_name(
    still: Server, attacker: MakeAttacker, hello: bytes
) -> None:
    sock = attacker(still).connect(hello)
    assert sock.recv(4096)[3] == PacketType.REFUSE
    expected = "robot 1 runs an older vsensed: bring it this one with 'vsense robot"
    assert expected in still.wait("refused", 1).text
    assert still.server.robots()[1].refused.startswith("runs an older vsensed")
    assert closed(sock)


def test_a_robot_that_shows_the_key_before_the_one_it_was_brought_is_not_believed(
    robot: MakeRobot,
) -> None:
    """Somebody may have stolen that one; the robot itself is told what to do."""
    host = Server(Clock(), trust=LinkTrust(KEYS.followed(), brought={UID: 2}))
    try:
        robot(host, 1).connect()
        assert "has its former key 1, but was brought a newer one" in host.wait("refused", 1).text
        assert not host.server.robots()[1].connected
    finally:
        host.close()


def test_a_robot_with_an_older_key_is_taken_and_told_of(robot: MakeRobot) -> None:
    followed = KEYS.followed()
    host = Server(Clock(), trust=LinkTrust(followed))
    try:
        robot(host, 1).join()
        text = host.wait("connected", 1).text
        assert "it has key 1, the newest is 2: bring it one with 'vsense robot deploy'" in text
        assert host.server.robots()[1].key == 1
    finally:
        host.close()


def test_a_host_with_keys_takes_others_only_if_it_was_told_so(robot: MakeRobot) -> None:
    host = Server(Clock(), trust=LinkTrust(KEYS, insecure=True))
    try:
        robot(host, 1).join()
        robot(host, 2, keyed=False).join()
        assert {tag: one.key for tag, one in host.server.robots().items()} == {1: 1, 2: None}
        thief = robot(host, 1, keyed=False).connect()
        thief.event(Event.REFUSED)
        assert thief.session.notice.code == RefuseCode.TAG_IN_USE, "the uid alone is nobody's"
        assert host.server.robots()[1].key == 1
    finally:
        host.close()
