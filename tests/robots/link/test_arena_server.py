"""The arena tracking server, against a client of the original system."""

from __future__ import annotations

import errno
import math
import selectors
import socket
import struct
import threading
from collections.abc import Callable, Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.robots.link.arena_rig import (
    ONE_SHOT,
    PATIENCE_S,
    START,
    STOP,
    OldClient,
    Told,
    exactly,
    locate,
    message,
    state,
)
from tests.robots.link.rig import Clock
from vsense.robots.link.status import LinkError
from vsense.robots.link.trackers.server import IDLE_MAX_NS, WRITE_MAX_NS, ArenaServer, ArenaSession

ROBOT = (23, 0.1, -0.2, math.pi / 2)
TEXT = "23 23.50 46.25 -45.000 0.10000 -0.20000 90.000"


@pytest.fixture
def server(told: Told, clock: Clock) -> Iterator[ArenaServer]:
    made = ArenaServer("127.0.0.1", 0, locate, told, clock)
    made.start()
    yield made
    made.close()


@pytest.fixture
def connect(server: ArenaServer) -> Iterator[Callable[..., OldClient]]:
    made: list[OldClient] = []

    def client(receive_buffer: int | None = None) -> OldClient:
        made.append(OldClient(server.port, receive_buffer))
        return made[-1]

    yield client
    for one in made:
        one.close()


def started(client: OldClient, server: ArenaServer) -> OldClient:
    """Has the client start a run, and waits until the server knows."""
    client.send(START)
    assert server.wait_for_run(PATIENCE_S)
    return client


def test_one_shot_is_answered_byte_for_byte(server: ArenaServer, connect: Callable) -> None:
    server.publish(state(812, ROBOT))
    client = connect()
    client.sock.sendall(b"\0\0\0\2")
    expected = message(f"0 {TEXT}")
    assert exactly(client.sock, len(expected)) == expected


def test_one_shot_before_the_first_state_waits_for_it(
    server: ArenaServer, connect: Callable, told: Told
) -> None:
    client = connect()
    client.send(ONE_SHOT, ONE_SHOT, 99)
    told.wait("command 99")
    server.publish(state(5, ROBOT))
    assert client.read() == client.read() == f"0 {TEXT}"


def test_timesteps_count_in_runs_only_and_from_one(server: ArenaServer, connect: Callable) -> None:
    client = connect()
    server.publish(state(40))
    for _ in range(2):
        client.send(ONE_SHOT, ONE_SHOT)
        assert [client.timestep(), client.timestep()] == [0, 0]
        started(client, server)
        for timestep in (41, 42, 45):
            server.publish(state(timestep, ROBOT))
        assert [client.timestep() for _ in range(3)] == [1, 2, 5]
        client.send(ONE_SHOT)
        assert client.timestep() == 5
        client.send(STOP)


def test_nothing_follows_a_stop(server: ArenaServer, connect: Callable, told: Told) -> None:
    """A length 0 after STOP would end the next experiment of the original's client."""
    server.publish(state(1))
    client = started(connect(), server)
    client.send(STOP)
    told.wait("the run has ended after 0 timesteps")
    server.publish(state(2))
    client.send(STOP, ONE_SHOT)
    assert client.read() == "0"


def test_end_of_a_recording_is_length_zero_and_another_run_can_follow(
    server: ArenaServer, connect: Callable
) -> None:
    client = started(connect(), server)
    server.publish(state(1))
    server.end_run()
    assert [client.read(), client.read()] == ["1", ""]
    assert not server.running
    started(client, server)
    server.publish(state(7))
    assert client.read() == "1"


def test_the_last_state_is_repeated_with_rising_timesteps_until_the_client_stops(
    server: ArenaServer, connect: Callable, told: Told
) -> None:
    client = connect()
    assert not server.repeat(PATIENCE_S), "there is no state, and no run"
    server.publish(state(8, ROBOT))
    assert not server.repeat(PATIENCE_S), "there is no run"
    started(client, server)
    server.publish(state(9, ROBOT))
    assert server.repeat(0.0) and server.repeat(0.0)
    assert [client.read() for _ in range(3)] == [f"{timestep} {TEXT}" for timestep in (1, 2, 3)]
    client.send(STOP)
    assert not server.repeat(PATIENCE_S), "it returns as soon as the run is over"
    told.wait("the run has ended")


@pytest.mark.parametrize("how", ["another run", "has left", "closed"])
def test_repeating_ends_with_its_run(server: ArenaServer, connect: Callable, how: str) -> None:
    server.publish(state(1, ROBOT))
    client = started(connect(), server)
    repeated: list[bool] = []
    repeating = threading.Thread(target=lambda: repeated.append(server.repeat(PATIENCE_S)))
    repeating.start()
    assert client.timestep() == 1
    if how == "another run":
        client.send(STOP, START)
    elif how == "has left":
        client.close()
    else:
        server.close()
    repeating.join(PATIENCE_S)
    assert repeated == [False]


@pytest.mark.parametrize("in_run", [True, False])
def test_closing_ends_the_run_and_the_stream(
    server: ArenaServer, connect: Callable, in_run: bool
) -> None:
    client = connect()
    server.publish(state(1))
    client.send(ONE_SHOT)
    assert client.read() == "0"
    if in_run:
        started(client, server)
    server.close()
    assert client.read() == ("" if in_run else None)
    assert not exactly(client.sock, 1)
    with pytest.raises(ConnectionRefusedError):
        OldClient(server.port)


def test_clients_are_served_one_after_another(server: ArenaServer, connect: Callable) -> None:
    server.publish(state(1, ROBOT))
    first = started(connect(), server)
    second = connect()
    second.send(ONE_SHOT)
    server.publish(state(2))
    assert first.timestep() == 1
    second.sock.setblocking(False)
    with pytest.raises(BlockingIOError):
        second.sock.recv(1)
    second.sock.settimeout(PATIENCE_S)
    first.close()
    assert second.read() == "0"
    assert not server.running


def test_a_silent_client_makes_way_for_one_that_waits(
    server: ArenaServer, connect: Callable, told: Told, clock: Clock
) -> None:
    server.publish(state(1))
    silent = connect()
    told.wait("has connected")
    second = connect()
    second.send(ONE_SHOT)
    clock.advance(IDLE_MAX_NS)
    assert second.read() == "0"
    assert silent.read() is None
    told.wait("asks for nothing, and another one waits")
    clock.advance(10 * IDLE_MAX_NS)
    second.send(ONE_SHOT)
    assert second.read() == "0", "nobody waits"


def test_a_client_in_a_run_makes_way_for_nobody(
    server: ArenaServer, connect: Callable, clock: Clock
) -> None:
    first, second = started(connect(), server), connect()
    second.send(ONE_SHOT)
    clock.advance(100 * IDLE_MAX_NS)
    server.publish(state(1))
    assert first.timestep() == 1
    clock.advance(100 * IDLE_MAX_NS)
    server.publish(state(2))
    assert first.timestep() == 2


def test_a_crowd_waits_in_few_places_and_is_told_in_few_lines(
    server: ArenaServer, connect: Callable, told: Told, clock: Clock
) -> None:
    server.publish(state(1))
    crowd = [connect() for _ in range(200)]
    told.wait("too many clients wait")
    for one in crowd[-1:]:
        one.send(ONE_SHOT)
    clock.advance(IDLE_MAX_NS)
    told.wait("has connected", 2)
    clock.advance(IDLE_MAX_NS)
    assert crowd[-1].read() == "0"
    assert sum(one.read() is None for one in crowd[1:100]) == 99
    assert len(told.lines) < 20


def test_without_descriptors_it_waits_and_goes_on(told: Told, clock: Clock) -> None:
    class Full(socket.socket):
        tries = 0

        def accept(self) -> tuple[socket.socket, tuple[str, int]]:
            Full.tries += 1
            if Full.tries == 1:
                raise OSError(errno.EMFILE, "Too many open files")
            return super().accept()

    server = ArenaServer("127.0.0.1", 0, locate, told, clock)
    server._selector.unregister(server._listener)
    server._listener = Full(fileno=server._listener.detach())
    server._selector.register(server._listener, selectors.EVENT_READ)
    server.start()
    server.publish(state(1))
    client = OldClient(server.port)
    client.send(ONE_SHOT)
    told.wait("this machine: cannot accept a connection: Too many open files")
    assert Full.tries == 1
    clock.advance(10**9)
    assert client.read() == "0"
    client.close()
    server.close()


@pytest.mark.parametrize("sent", range(0, 9))
def test_a_client_may_leave_after_any_byte_it_sent(
    server: ArenaServer, connect: Callable, sent: int
) -> None:
    server.publish(state(1))
    client = connect()
    client.sock.sendall(struct.pack(">II", START, ONE_SHOT)[:sent])
    client.sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", sent % 2, 0))
    client.close()
    following = connect()
    following.send(ONE_SHOT)
    assert following.read() == "0"


@pytest.mark.parametrize("read", [0, 1, 3, 4, 5, 20, 51])
def test_a_client_may_leave_after_any_byte_it_read(
    server: ArenaServer, connect: Callable, read: int, told: Told
) -> None:
    client = started(connect(), server)
    server.publish(state(1, ROBOT))
    exactly(client.sock, read)
    client.close()
    told.wait("of a run")
    server.publish(state(2, ROBOT))
    following = connect()
    following.send(ONE_SHOT)
    assert following.timestep() == 0


def test_wrong_commands_are_told_and_ignored(
    server: ArenaServer, connect: Callable, told: Told
) -> None:
    server.publish(state(1))
    client = connect()
    client.send(3, 0xFFFFFFFF, ONE_SHOT)
    assert client.read() == "0"
    assert [line for line in told.lines if "not known" in line] == [
        f"127.0.0.1: command {n} is not known, expected 0, 1 or 2; it is ignored"
        for n in (3, 4294967295)
    ]


def test_a_peer_that_is_no_client_is_let_go(
    server: ArenaServer, connect: Callable, told: Told
) -> None:
    client = connect()
    client.sock.sendall(b"GET /index.html HTTP/1.1\r\nHost: here\r\n\r\n")
    told.wait("too many unknown commands")
    assert client.read() is None
    assert sum("not known" in line for line in told.lines) == 8


def test_asking_without_reading_is_bounded(
    server: ArenaServer, connect: Callable, told: Told
) -> None:
    connect().send(*[ONE_SHOT] * 65)
    told.wait("asks for states and does not read them")


def test_a_slow_client_misses_states_and_holds_nobody_up(
    server: ArenaServer, connect: Callable
) -> None:
    client = started(connect(receive_buffer=4096), server)
    robots = [(tag, 0.0, 0.0, 0.0) for tag in range(40)]
    last = 2000
    for timestep in range(1, last + 1):
        server.publish(state(timestep, *robots))
    steps = [client.timestep()]
    while steps[-1] != last:
        steps.append(client.timestep())
    assert steps == sorted(set(steps)) and len(steps) < last / 2


def test_a_client_that_takes_nothing_any_more_makes_room(
    server: ArenaServer, connect: Callable, told: Told, clock: Clock
) -> None:
    started(connect(receive_buffer=4096), server)
    robots = [(tag, 0.0, 0.0, 0.0) for tag in range(100)]
    for timestep in range(200):
        server.publish(state(timestep, *robots))
    clock.advance(WRITE_MAX_NS + 1)
    told.wait("has taken nothing for 10 s in timestep 200 of a run")
    following = connect()
    following.send(ONE_SHOT)
    assert following.timestep() == 0


def test_forgetting_makes_one_shot_wait_for_the_next_recording(
    server: ArenaServer, connect: Callable, told: Told
) -> None:
    server.publish(state(9, ROBOT))
    server.forget()
    client = connect()
    client.send(ONE_SHOT, 99)
    told.wait("command 99")
    server.publish(state(0))
    assert client.read() == "0"


def test_a_taken_port_is_told(server: ArenaServer, told: Told) -> None:
    with pytest.raises(LinkError, match=f"TCP port {server.port} .* is in use"):
        ArenaServer("127.0.0.1", server.port, locate, told)


def test_closing_twice_and_without_start_is_fine(told: Told) -> None:
    made = ArenaServer("127.0.0.1", 0, locate, told)
    made.close()
    made.close()


@given(
    st.lists(st.sampled_from([START, STOP, ONE_SHOT, 7]), max_size=12), st.integers(1, 7), st.data()
)
def test_any_chunking_of_commands_gives_the_same_answers(
    commands: list[int], size: int, data: st.DataObject
) -> None:
    stream = struct.pack(f">{len(commands)}I", *commands)
    newest = data.draw(st.sampled_from([None, state(3, ROBOT)]))

    def played(chunk: int) -> tuple[bytes, list[str], int, str]:
        told: list[str] = []
        session = ArenaSession(locate, told.append)
        for start in range(0, len(stream), chunk):
            session.receive(stream[start : start + chunk], newest)
        session.publish(state(4, ROBOT))
        written = b""
        while part := bytes(session.outbox.chunk()):
            session.outbox.wrote(len(part))
            written += part
        return written, told, session.timestep, session.refused

    assert played(size) == played(len(stream) or 1)
