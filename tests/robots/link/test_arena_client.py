"""The arena tracking client, against a tracker of the original system and against our server."""

from __future__ import annotations

import math
import select
import struct
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.rigs.processes import free_port
from tests.robots.link.arena_rig import (
    ONE_SHOT,
    PATIENCE_S,
    START,
    STOP,
    OldTracker,
    Told,
    locate,
    message,
    state,
)
from tests.robots.link.rig import Clock
from vsense.base.arena import ArenaState
from vsense.robots.link.status import LinkError
from vsense.robots.link.trackers.client import STATE_DT_NS, ArenaClient, ArenaDialog, TrackerEnded
from vsense.robots.link.trackers.server import ArenaServer
from vsense.run.watch import Watch

TAGS = (23, 24)
ROBOT = "23 1.0 2.0 3.0 0.5 -0.25 90.0"
S = 1_000_000_000

Coming = Future[tuple[ArenaState, object]]


@pytest.fixture
def tracker() -> Iterator[OldTracker]:
    made = OldTracker()
    yield made
    made.close()


@pytest.fixture
def client(tracker: OldTracker, told: Told) -> Iterator[ArenaClient]:
    made = ArenaClient("127.0.0.1", tracker.port, TAGS, told)
    yield made
    made.close()


@pytest.fixture
def begin(client: ArenaClient) -> Iterator[Callable[[], Coming]]:
    """Has another thread wait for the next state."""
    with ThreadPoolExecutor(1) as pool:
        yield lambda: pool.submit(client.next, PATIENCE_S)
        client.close()


def first_state(tracker: OldTracker, begin: Callable[[], Coming]) -> ArenaState:
    """Plays the start of every conversation: one ONE_SHOT and its answer."""
    coming = begin()
    tracker.accept()
    assert tracker.command() == ONE_SHOT
    tracker.send(f"0 {ROBOT}")
    return coming.result()[0]


def in_run(tracker: OldTracker, client: ArenaClient, begin: Callable[[], Coming]) -> Coming:
    """Plays a conversation up to START_EXPERIMENT; the next state is being waited for."""
    first_state(tracker, begin)
    client.start()
    coming = begin()
    assert tracker.command() == START
    return coming


def test_one_shots_before_a_run_give_states(tracker: OldTracker, begin: Callable) -> None:
    state = first_state(tracker, begin)
    (robot,) = state.robots
    assert (robot["tag"], robot["x_m"], robot["y_m"]) == (23, 0.5, -0.25)
    assert robot["yaw_rad"] == pytest.approx(math.pi / 2)
    coming = begin()
    assert tracker.command() == ONE_SHOT
    tracker.send(f"0 {ROBOT}")
    later = coming.result()[0]
    assert later.timestep == state.timestep + 1
    assert later.capture_ns - state.capture_ns >= STATE_DT_NS // 2


def test_a_state_of_a_run_that_is_over_is_asked_for_again(
    tracker: OldTracker, begin: Callable, client: ArenaClient
) -> None:
    coming = begin()
    tracker.accept()
    assert tracker.command() == ONE_SHOT
    tracker.send(f"812 {ROBOT}")
    assert tracker.command() == ONE_SHOT
    tracker.send("0")
    assert len(coming.result()[0].robots) == 0
    assert client.counters.ignored == 1


def test_a_run_is_started_streamed_and_stopped(
    tracker: OldTracker, client: ArenaClient, begin: Callable
) -> None:
    coming = in_run(tracker, client, begin)
    tracker.send(f"1 {ROBOT}")
    first = coming.result()[0]
    coming = begin()
    tracker.send(f"4 {ROBOT}")
    assert coming.result()[0].timestep == first.timestep + 3
    client.stop()
    coming = begin()
    assert tracker.command() == STOP
    tracker.send(f"5 {ROBOT}")
    assert tracker.command() == ONE_SHOT
    tracker.send("0")
    assert coming.result()[0].timestep == first.timestep + 4
    assert client.counters.ignored == 1


def test_length_zero_ends_the_run(
    tracker: OldTracker, client: ArenaClient, begin: Callable
) -> None:
    coming = in_run(tracker, client, begin)
    tracker.sock.sendall(b"\0\0\0\0")
    with pytest.raises(TrackerEnded, match="ended"):
        coming.result()
    coming = begin()
    assert tracker.command() == ONE_SHOT
    tracker.send("0")
    assert coming.result()[0].timestep > 0


def test_the_newest_of_several_states_is_given(
    tracker: OldTracker, client: ArenaClient, begin: Callable
) -> None:
    coming = in_run(tracker, client, begin)
    tracker.sock.sendall(b"".join(message(f"{n} {ROBOT}") for n in range(1, 6)))
    state = coming.result()[0]
    while client.counters.states < 6:
        state = begin().result()[0]
    assert state.timestep >= 5
    assert client.counters.skipped <= 4


def test_defect_1_a_state_in_single_bytes_is_whole(
    tracker: OldTracker, client: ArenaClient, begin: Callable
) -> None:
    coming = in_run(tracker, client, begin)
    for byte in message(f"1 {ROBOT} 24 0 0 0 1.5 0.125 -90"):
        tracker.sock.sendall(bytes((byte,)))
    robots = coming.result()[0].robots
    assert robots["tag"].tolist() == [23, 24] and robots["x_m"].tolist() == [0.5, 1.5]


@pytest.mark.parametrize("cut", (0, 3, 4, 20, 33))
def test_after_a_disconnection_at_any_byte_the_run_is_taken_up_again(
    tracker: OldTracker, client: ArenaClient, begin: Callable, cut: int, told: Told
) -> None:
    coming = in_run(tracker, client, begin)
    tracker.sock.sendall(message(f"1 {ROBOT}")[:cut])
    tracker.hang_up()
    tracker.accept()
    assert tracker.command() == START
    tracker.send(f"1 {ROBOT}")
    state = coming.result()[0]
    assert state.timestep >= 1 and client.connections == 2
    told.wait("has closed the connection; trying again")
    told.wait("connected", times=2)


def test_timesteps_go_on_by_the_clock_over_a_gap() -> None:
    dialog = ArenaDialog(TAGS, latency_ns=0)
    dialog.running = True
    for connection in range(2):
        now_ns = 100 * S + connection * 2 * S
        dialog.connected(now_ns)
        assert dialog.command(now_ns) == START
        state = dialog.receive(message(f"1 {ROBOT}"), now_ns)
    assert state is not None
    first_ns = 100 * S // STATE_DT_NS - 1
    assert state.timestep - first_ns == 2 * S // STATE_DT_NS


def test_defect_6_waiting_costs_nothing(
    tracker: OldTracker, client: ArenaClient, begin: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    polls = []
    real = select.poll
    monkeypatch.setattr(select, "poll", lambda: polls.append(1) or real())
    first_state(tracker, begin)
    with pytest.raises(LinkError, match=r"0.3 s"):
        client.next(0.3)
    assert len(polls) <= 12


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (struct.pack(">I", 0xFFFFFFFF), "of 4294967295 bytes, expected at most"),
        (message("1 5 6"), "3 tokens"),
        (message(f"x {ROBOT}"), "timestep 'x'"),
        (message(f"1 {ROBOT}") + message(f"1000000 {ROBOT}"), "timestep 1000000 after 1"),
    ],
)
def test_defect_7_bytes_that_are_no_state_cost_the_connection_only(
    tracker: OldTracker, client: ArenaClient, begin: Callable, data: bytes, reason: str, told: Told
) -> None:
    coming = in_run(tracker, client, begin)
    tracker.sock.sendall(data)
    told.wait(f"does not speak the protocol: an arena state.*{reason}"[:30])
    tracker.accept()
    assert tracker.command() == START
    tracker.send(f"1 {ROBOT}")
    assert len(coming.result()[0].robots) == 1
    assert any(reason in line for line in told.lines)


def test_a_tracker_that_is_not_there_is_told_once_and_tried_again(told: Told) -> None:
    port = free_port()
    client = ArenaClient("127.0.0.1", port, TAGS, told)
    with pytest.raises(LinkError, match=f"127.0.0.1:{port}: no arena state in 0.8 s"):
        client.next(0.8)
    assert len(told.lines) == 1 and "cannot be reached: Connection refused" in told.lines[0]
    client.close()


def test_an_unknown_host_is_refused_at_once(told: Told) -> None:
    with pytest.raises(LinkError, match=r"tracker no\.such\.host\.invalid:4040"):
        ArenaClient("no.such.host.invalid", 4040, TAGS, told)


def test_closing_ends_a_wait(tracker: OldTracker, client: ArenaClient, begin: Callable) -> None:
    coming = begin()
    tracker.accept()
    client.close()
    with pytest.raises(LinkError, match="closed"):
        coming.result()
    client.close()


def test_latency_dates_states_back(tracker: OldTracker, told: Told) -> None:
    clock = Clock()
    dialog = ArenaDialog(TAGS, latency_ns=40_000_000)
    dialog.connected(clock())
    dialog.command(10 * S)
    state = dialog.receive(message("0"), 10 * S)
    assert state is not None and state.capture_ns == 10 * S - 40_000_000


def test_places_are_moved_into_the_arena() -> None:
    dialog = ArenaDialog(TAGS, 0, origin_m=(2.5, -1.0))
    dialog.command(S)
    state = dialog.receive(message(f"0 {ROBOT}"), S)
    assert state is not None
    assert (state.robots["x_m"][0], state.robots["y_m"][0]) == (0.5 - 2.5, -0.25 + 1.0)


@given(st.lists(st.integers(0, 9), max_size=6), st.booleans(), st.integers(1, 60))
def test_defect_1_any_chunking_gives_the_same_last_state(
    steps: list[int], running: bool, size: int
) -> None:
    stream = b"".join(message(f"{n} {ROBOT}") for n in steps)

    def last(chunk: int) -> tuple[int | None, int, int]:
        dialog = ArenaDialog(TAGS, 0)
        dialog.running = running
        dialog.command(S)
        newest = None
        for start in range(0, len(stream), chunk):
            newest = dialog.receive(stream[start : start + chunk], S) or newest
        counters = dialog.counters
        return newest.timestep if newest else None, counters.states, counters.ignored

    assert last(size) == last(len(stream) or 1)


def test_our_server_and_our_client_agree(told: Told) -> None:
    server = ArenaServer("127.0.0.1", 0, locate, told)
    server.start()
    client = ArenaClient("127.0.0.1", server.port, TAGS, told)
    server.publish(state(5, (23, 0.1, 0.2, 3.1), (99, 0.0, 0.0, 0.0)))
    first, frames = client.next(PATIENCE_S)
    assert first.robots["tag"].tolist() == [23] and first.unnamed == 1 and frames == ()
    client.start()
    watch = Watch(client, Clock())
    watch.start()
    assert server.wait_for_run(PATIENCE_S)
    for timestep in range(6, 16):
        server.publish(state(timestep, (23, 0.001 * timestep, 0.2, -3.1), (24, 1.0, 1.0, 0.0)))
    newest = watch.next(PATIENCE_S).state
    while newest.robots["x_m"][0] < 0.015:
        newest = watch.next(PATIENCE_S).state
    assert newest.robots["tag"].tolist() == [23, 24]
    assert newest.robots["yaw_rad"][0] == pytest.approx(-3.1, abs=1e-4)
    assert client.counters.states == 11
    client.close()
    watch.close()
    server.close()
