"""The original virtual sensor server with robots that share no code with it."""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Iterator

import pytest

from tests.robots.link.legacy_rig import Client, Relay
from vsense.robots.link.keys import INSECURE
from vsense.robots.link.legacy.protocol import LegacySwarm, Translation
from vsense.robots.link.legacy.server import MixedServer
from vsense.robots.link.status import LinkError, LinkEvent
from vsense.robots.link.table import Entry, ExpectedRobot, Table
from vsense.robots.link.wire import ReadingValues, Wanted

PATIENCE_S = 20.0
TABLE = Table([Entry(1, "pollutant", "f4"), Entry(2, "gps", "3*f4")])
NUMBERS = {30: (23, "epuck_23_30"), 31: (24, "epuck_24_31")}
EXPECTED = {tag: ExpectedRobot(name, TABLE) for tag, name in NUMBERS.values()}


class Events:
    """What the server tells; it can be waited for."""

    def __init__(self) -> None:
        self.events: list[LinkEvent] = []
        self._news = threading.Condition()

    def __call__(self, event: LinkEvent) -> None:
        with self._news:
            self.events.append(event)
            self._news.notify_all()

    def wait(self, part: str, times: int = 1) -> None:
        with self._news:
            enough = lambda: sum(part in f"{e.kind}: {e.text}" for e in self.events) >= times  # noqa: E731
            assert self._news.wait_for(enough, PATIENCE_S), self.events


@pytest.fixture
def events() -> Events:
    return Events()


@pytest.fixture
def server(events: Events) -> Iterator[MixedServer]:
    made = MixedServer(
        ("127.0.0.1", 0),
        LegacySwarm(dict.fromkeys(EXPECTED, Translation(TABLE.entries)), NUMBERS),
        host="127.0.0.1",
        port=0,
        timestep_ns=100_000_000,
        seed=1,
        expected=EXPECTED,
        trust=INSECURE,
        on_event=events,
    )
    made.start()
    yield made
    legacy = made._legacy
    made.close()
    assert legacy is not None and not legacy._thread.is_alive()


def readings(pollutant: float, x_m: float) -> ReadingValues:
    return [(struct.pack("<f", pollutant), 7), (struct.pack("<3f", x_m, 0.5, -1.0), 7)]


def run(server: MixedServer, timesteps: int) -> None:
    """Lives a whole run: two timesteps before the first, the run, the end."""
    server.command(Wanted.RUN, 12)
    for timestep in range(10, 12 + timesteps):
        values = {23: readings(timestep % 2, timestep / 8), 24: readings(0.0, 1.0)}
        server.publish(timestep, timestep, values)
    server.command(Wanted.STOP)


@pytest.mark.parametrize("mode", ["plain", "split", "delayed", "merged"])
def test_a_whole_run_over_any_network(server: MixedServer, events: Events, mode: str) -> None:
    port = server.legacy_port if mode == "plain" else Relay(server.legacy_port, 30, mode).port
    client, other = Client(port, 30), Client(server.legacy_port, 31)
    client.start()
    other.start()
    events.wait("connected with the original client", 2)
    assert {tag: s.connected for tag, s in server.robots().items()} == {23: True, 24: True}
    run(server, 20)
    robot = client.finish()
    assert robot.table == {7: 12, 3: 36}
    assert robot.started and robot.ended
    assert robot.values == {7: (31 % 2,), 3: (31 / 8, 0.5, -1.0)}
    assert len(robot.updates) == 20 and set(robot.updates[0]) == {3, 7}
    still = other.finish()
    assert still.values[3] == (1.0, 0.5, -1.0)
    assert len(still.updates) == 1, "a robot without changes gets nothing"
    assert server.robots()[23].telemetry is None


def test_who_drops_out_is_back_in_mid_run(server: MixedServer, events: Events) -> None:
    first = Client(server.legacy_port, 30)
    events.wait("connected with the original client")
    server.command(Wanted.RUN, 5)
    server.publish(5, 5, {23: readings(1.0, 0.25)})
    first.sock.close()
    events.wait("lost: robot 23: ")
    second = Client(server.legacy_port, 30)
    events.wait("connected with the original client", 2)
    server.publish(6, 6, {23: readings(1.0, 0.25)})
    server.command(Wanted.STOP)
    second.start()
    robot = second.finish()
    assert robot.ended and robot.values == {7: (1.0,), 3: (0.25, 0.5, -1.0)}


def test_a_robot_that_comes_twice_counts_once(server: MixedServer, events: Events) -> None:
    first = Client(server.legacy_port, 30)
    events.wait("connected with the original client")
    second = Client(server.legacy_port, 30)
    events.wait("robot 23: has come again")
    first.start()
    assert not first.finish().started
    server.command(Wanted.RUN, 1)
    server.publish(1, 1, {23: readings(1.0, 0.25)})
    server.command(Wanted.STOP)
    second.start()
    assert second.finish().ended


def test_a_robot_that_takes_nothing_delays_nobody(server: MixedServer, events: Events) -> None:
    stuck = Client(server.legacy_port, 31, receive_buffer=1024)
    client = Client(server.legacy_port, 30)
    client.start()
    events.wait("connected with the original client", 2)
    server.command(Wanted.RUN, 0)
    for timestep in range(3000):
        values = {tag: readings(timestep % 2, timestep) for tag in (23, 24)}
        server.publish(timestep, timestep, values)
    server.command(Wanted.STOP)
    assert client.finish().values[3][0] == 2999
    stuck.start()
    robot = stuck.finish()
    assert robot.ended and robot.values[3][0] == 2999, "what it takes late is the newest"


@pytest.mark.parametrize(
    ("octet", "say", "text"),
    [
        (77, b"", "from 127.0.0.77: no robot's number is 77; expected: 30, 31"),
        (30, b"VS", "says something, which the original client never does: turned away"),
    ],
)
def test_strangers_are_turned_away(
    server: MixedServer, events: Events, octet: int, say: bytes, text: str
) -> None:
    client = Client(server.legacy_port, octet)
    client.sock.sendall(say)
    events.wait(text)
    client.start()
    assert not client.finish().started


def test_a_place_is_taken_from_nobody_at_another_address(
    server: MixedServer, events: Events
) -> None:
    client = Client(server.legacy_port, 30)
    client.start()
    events.wait("connected with the original client")
    thief = socket.create_connection(("127.0.0.1", server.legacy_port), 5.0, ("127.7.7.30", 0))
    events.wait("127.7.7.30: epuck_23_30 is connected, from 127.0.0.30")
    assert thief.recv(1) == b""
    run(server, 3)
    assert client.finish().ended
    thief.close()


def test_a_robot_that_comes_again_and_again_keeps_one_connection(
    server: MixedServer, events: Events
) -> None:
    crowd = [Client(server.legacy_port, 30) for _ in range(100)]
    events.wait("it came 6 times in the last 10 s")
    run(server, 3)
    learnt = []
    for one in crowd:
        one.start()
        learnt.append(one.finish())
    assert sum(robot.ended for robot in learnt) == 1
    assert len(events.events) < 20


def test_the_end_reaches_everybody_when_the_host_closes(
    server: MixedServer, events: Events
) -> None:
    client = Client(server.legacy_port, 30)
    client.start()
    events.wait("connected with the original client")
    server.command(Wanted.RUN, 0)
    server.publish(0, 0, {23: readings(1.0, 0.25)})
    server.close()
    assert client.finish().ended


def test_a_port_that_is_taken(server: MixedServer) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        other = MixedServer(
            ("127.0.0.1", taken.getsockname()[1]),
            LegacySwarm(dict.fromkeys(EXPECTED, Translation(TABLE.entries)), NUMBERS),
            host="127.0.0.1",
            port=0,
            timestep_ns=100_000_000,
            seed=1,
            expected={},
            trust=INSECURE,
            on_event=lambda event: None,
        )
        with pytest.raises(LinkError, match="is in use"):
            other.start()
        other.close()
