"""Rooms of what comes by a network or a socket: other trackers, the original's clients, pages,
terminals, requests, and robots that know their keys and say what they like."""

from __future__ import annotations

import json
import math
import re
import struct
from itertools import count
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from tests.fuzz import mutate
from tests.fuzz.robots import TABLE, Robot, hello
from vsense.base.arena import POSE, ArenaState
from vsense.base.native import WireError
from vsense.monitor.ui._sentences import read as read_sentence
from vsense.monitor.ui.access import AccessControl, Forbidden, Tokens
from vsense.monitor.ui.control_socket import ControlSocket
from vsense.robots.link._peer import Peer
from vsense.robots.link._roster import SessionTable
from vsense.robots.link._streams import Inbox
from vsense.robots.link.keys import LinkTrust, SwarmKeys
from vsense.robots.link.legacy.protocol import LEGACY_SENSORS, Translation, encode_real
from vsense.robots.link.status import LinkError
from vsense.robots.link.table import Direction, Entry, ExpectedRobot, Table
from vsense.robots.link.trackers._repair import Repair
from vsense.robots.link.trackers.client import ArenaDialog
from vsense.robots.link.trackers.lines import LINE_MAX, LineInbox, SenderClock, parse
from vsense.robots.link.trackers.protocol import encode_state
from vsense.robots.link.trackers.server import ArenaSession
from vsense.robots.link.wire import (
    PUBLISHED,
    decode,
    packet_length,
    session_keys,
    session_of,
    uid_of,
)
from vsense.run.orders import Order

S = 1_000_000_000
TAGS = (1, 2, 3)
WIRE_REFUSALS = (WireError, LinkError)
ACCESS_REFUSALS = (Forbidden,)


def prepare_nothing(folder: Path) -> None:
    """Every case begins anew."""


def _state_is_sound(state: ArenaState) -> None:
    robots = state.robots
    for name in ("x_m", "y_m", "yaw_rad"):
        assert np.isfinite(robots[name][robots["seen"]]).all()
    assert len(set(robots["tag"].tolist())) == len(robots)


def _line(random: Random, timestep: int) -> dict[str, Any]:
    robots = [
        {"tag": tag, "x_m": random.uniform(-1, 1), "y_m": 0.5, "yaw_rad": random.uniform(-4, 4)}
        for tag in TAGS
    ]
    return {"timestep": timestep, "capture_ns": timestep * 10**8, "robots": robots}


def lines(random: Random, scene: None) -> None:
    """A tracker's JSON lines, and what is made of them: each is refused, or gives a sound state."""
    said = []
    for timestep in range(1, 2 + mutate.few(random)):
        line = _line(random, timestep)
        said.append(mutate.as_json(random, line) if random.random() < 0.7 else json.dumps(line))
    data = "\n".join(said).encode("utf-8", "surrogatepass") + b"\n"
    if random.random() < 0.1:
        data = mutate.raw(random, data)
    inbox, clock, repair = LineInbox(), SenderClock(), Repair(TAGS)
    before, now_ns = 0, 5 * S
    for piece in mutate.chunks(random, data):
        now_ns += random.randrange(10**8)
        for _, text in inbox.feed(piece):
            if text is None or not text.strip():
                continue
            try:
                line = parse(text)
            except LinkError:
                continue
            if 1 <= line.timestep - before <= 100_000:
                capture_ns = clock.host_ns(line, now_ns)
                assert -(2**63) <= capture_ns <= now_ns
                _state_is_sound(repair.follow(line.robots, line.timestep - before, capture_ns))
                before = line.timestep
        assert len(inbox._bytes) <= LINE_MAX


def _arena_state(random: Random, timestep: int) -> bytes:
    robots = np.zeros(3, dtype=POSE)
    robots["tag"], robots["seen"] = TAGS, True
    robots["x_m"] = [random.uniform(-1, 1) for _ in TAGS]
    return encode_state(timestep, robots, np.ones((3, 3)))


def _original_tracker(random: Random) -> None:
    dialog = ArenaDialog(TAGS, 10**7, (0.1, 0.2))
    now_ns = 5 * S
    dialog.connected(now_ns)
    for timestep in range(mutate.few(random, 6)):
        dialog.running = random.random() < 0.7
        dialog.command(now_ns)
        body = _arena_state(random, timestep if dialog.running else 0)
        if random.random() < 0.6:
            changed = mutate.text(random, body[4:].decode("ascii")).encode("utf-8", "replace")
            body = struct.pack(">I", len(changed)) + changed
        if random.random() < 0.1:
            body = mutate.raw(random, body)
        for piece in mutate.chunks(random, body):
            now_ns += random.randrange(10**8)
            state = dialog.receive(piece, now_ns)
            if state is not None:
                _state_is_sound(state)
            dialog.due_ns  # noqa: B018


def _original_client(random: Random) -> None:
    session = ArenaSession(lambda robots: np.zeros((len(robots), 3)), lambda line: None)
    robots = np.zeros(1, dtype=POSE)
    robots["seen"] = True
    for timestep in range(mutate.few(random, 8)):
        commands = b"".join(struct.pack(">I", random.choice((0, 1, 2, 2, 9))) for _ in range(3))
        state = ArenaState(timestep, timestep * S, robots, 1)
        newest = state if random.random() < 0.5 else None
        for piece in mutate.chunks(random, mutate.raw(random, commands)):
            session.receive(piece, newest)
        session.publish(state)
        session.outbox.wrote(len(session.outbox.chunk()) if random.random() < 0.5 else 0)
    assert session.timestep >= 0


def original(random: Random, scene: None) -> None:
    """The original tracking protocol: as its client, and as its server."""
    (_original_tracker if random.random() < 0.7 else _original_client)(random)


def legacy(random: Random, scene: None) -> None:
    """Readings of any bytes for robots with the original client: each number has 12 bytes."""
    layouts = ("f4", "3*f4", "4*f4", "8*f4", "3*u1", "8*u2", "2*i4")
    names = [*LEGACY_SENSORS, "mine"]
    entries = [
        Entry(place, name, random.choice(layouts), Direction.SENSOR)
        for place, name in enumerate(random.sample(names, mutate.few(random, len(names))))
    ]
    translation = Translation(entries)
    values = []
    for entry, _, size in Table(entries).of_direction(Direction.SENSOR):
        assert entry in entries
        values.append((random.randbytes(size), random.choice((-1, 0, 5 * S))))
    found = translation.payloads(values)
    assert all(isinstance(payload, bytes) for payload in found.values())
    real = struct.unpack("<d", random.randbytes(8))[0]
    if np.isfinite(real):
        assert len(encode_real(real)) == 12


_SENTENCES: tuple[dict[str, Any], ...] = (
    {"order": "start", "value": 1},
    {"order": "speed", "value": 2.5},
    {"look": 23},
    {"look": None},
    {"look": [23, 24]},
    {"refresh": True},
    {"pictures": ["left", "right"]},
    {"got": 12},
    {"change": {"kind": "move", "name": "lamp", "x_m": 0.5, "y_m": -0.25, "final": False}},
    {
        "change": {
            "kind": "set",
            "name": "light",
            "controller": "moth",
            "setting": "bias",
            "value": 1,
        }
    },
)


def sentences(random: Random, scene: None) -> None:
    """What a page says: it is understood, or a ValueError says why not."""
    said = mutate.as_json(random, random.choice(_SENTENCES))
    name, value = read_sentence(said)
    assert name in ("order", "change", "look", "refresh", "pictures", "got")
    if name == "order":
        assert isinstance(value[1], float) and abs(value[1]) < 2**53
    if name == "change":
        numbers = (value.x_m, value.y_m, value.yaw_rad or 0.0)
        assert all(math.isfinite(number) for number in numbers) and len(value.name) <= 200
    if name == "look":
        assert len(value) <= 16 and all(0 <= tag < 2**53 for tag in value)
    if name == "got":
        assert 0 <= value < 2**53


def prepare_socket(folder: Path) -> ControlSocket:
    """A control socket without its socket."""

    def give(order: Order) -> str:
        assert np.isfinite(order.value), "an order's value is no number"
        return f"{order.by}: {order.kind.value}"

    made = object.__new__(ControlSocket)
    made._status, made._give = (lambda: {"state": "idle"}), give
    return made


def control_socket(random: Random, scene: ControlSocket) -> None:
    """What a terminal says by the control socket: one line is answered, whatever it is."""
    asked = random.choice(
        ({"ask": "status"}, {"order": "pause", "value": 0, "by": "terminal"}, {"order": "start"})
    )
    line = mutate.as_json(random, asked).encode("utf-8", "surrogatepass")[:4096]
    if random.random() < 0.1:
        line = mutate.raw(random, line)
    answer = scene.answer(line)
    assert answer.keys() & {"state", "text", "error"}
    json.dumps(answer).encode()


_HEADERS = ("127.0.0.1:8080", "localhost:8080", "[::1]:8080", "robots.local", "192.168.1.5:80")
_ORIGINS = ("http://127.0.0.1:8080", "https://localhost:8080", "http://evil.example", "null")


def access(random: Random, scene: None) -> None:
    """Hosts, origins and tokens of any text: admitted, or Forbidden with a reason."""
    tokens = Tokens("a-long-token", "another-token")
    control = AccessControl(
        random.choice(("127.0.0.1", "0.0.0.0", "::1")), 8080, tokens, random.random() < 0.5
    )
    host, origin = random.choice(_HEADERS), random.choice(_ORIGINS)
    token: str | None = random.choice(("a-long-token", "another-token", "wrong", ""))
    if random.random() < 0.7:
        host = mutate.text(random, host)
        origin = mutate.text(random, origin)
        token = mutate.text(random, token or "")
    rights = control.rights(None if random.random() < 0.2 else token, {control.cookie: host})
    assert (
        rights.value == "none" or token in ("a-long-token", "another-token") or host in tokens.look
    )
    control.check_origin({"Host": host, "Origin": origin}, random.random() < 0.5)
    plain = re.sub(r"[\t\r\n]", "", origin).strip()
    named = re.match(r"https?://([^/?#]*)", plain, re.IGNORECASE)
    assert named is None or named[1].strip().lower() == host.strip().lower()
    control.check_host({"Host": host})


def wire(random: Random, scene: None) -> None:
    """Packets and tables of any bytes: each is refused by a WireError, or read."""
    packet = hello(random, random.randrange(65536), random.randbytes(8), PUBLISHED)
    if random.random() < 0.2:
        packet = TABLE.encode()
        assert Table.decode(packet) == TABLE
        Table.decode(mutate.raw(random, packet))
        return
    damaged = mutate.raw(random, packet)
    inbox = Inbox()
    for piece in mutate.chunks(random, damaged + packet):
        inbox.feed(piece[: inbox.room])
        inbox.next()
    packet_length(damaged)
    session_of(damaged)
    uid_of(damaged)
    decode(damaged)


def roster(random: Random, scene: None) -> None:
    """Robots that greet and report, with keys or without: what nobody with a key has made changes
    nothing, and sequence numbers only rise."""
    swarm = SwarmKeys({1: b"\1" * 32, 2: b"\2" * 32})
    numbers = count(1)
    expected = {tag: ExpectedRobot(f"epuck_{tag}", TABLE) for tag in (5, 6)}
    insecure = random.random() < 0.3
    ours = SessionTable(expected, 10**8, 1, LinkTrust(swarm, insecure), lambda: next(numbers))
    now_ns = S
    pendings = []
    for _ in range(12):
        now_ns += random.randrange(10**9)
        kind, tag = random.randrange(6), random.choice((5, 6, 7))
        if kind < 2:
            uid = random.choice((b"a", b"b")).ljust(16)
            keyed = random.choice((1, 2, None))
            root = PUBLISHED if keyed is None else swarm.robot_key(uid, keyed)
            packet = hello(random, tag, uid, root)
            if random.random() < 0.2:
                packet = mutate.raw(random, packet)
            try:
                answer = ours.greet(packet, "10.0.0.5", now_ns)
            except WireError:
                continue
            assert answer.pending is None or insecure or keyed is not None
            if answer.pending is not None:
                robot = Robot(random, uid, root)
                robot.up = session_keys(root, packet, answer.packet)[1]
                robot.session = answer.pending.peer.session
                pendings.append((answer.pending, robot))
        elif pendings:
            pending, robot = random.choice(pendings)
            right = random.random() < 0.7
            packet = robot.telemetry(robot.up if right else PUBLISHED, now_ns)
            if random.random() < 0.1:
                packet, right = mutate.raw(random, packet), right
            source = random.choice((None, ("10.0.0.5", 7), ("10.0.0.6", 8)))
            _take(ours, pending, packet, source, now_ns, right)
        for each in ours.robots.values():
            each.tick(now_ns)
            each.status(now_ns)


def _take(
    ours: SessionTable, pending: Any, packet: bytes, source: Any, now_ns: int, right: bool
) -> None:
    """A packet goes where the network's thread would give it."""
    try:
        number = session_of(packet)
    except WireError:
        return
    waiting = ours.pending(number)
    if waiting is not None:
        proved = ours.prove(waiting, packet, source, now_ns)
        assert proved is None or right, "a session was proved without its key"
        return
    robot = ours.of_session(number)
    if robot is None:
        return
    peer: Peer = robot.peer
    before = int(peer._peer.rx_sequence)
    accepted, _ = robot.receive(packet, source, now_ns)
    assert not accepted or (right and int(peer._peer.rx_sequence) > before)
    counted = peer.counters
    assert counted["received"] == sum(
        value for name, value in counted.items() if name not in ("sent", "received")
    )
