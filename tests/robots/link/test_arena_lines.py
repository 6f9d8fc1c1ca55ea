"""The JSON-lines link: any other tracker as a source of arena states."""

from __future__ import annotations

import errno
import json
import math
import re
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.robots.link.arena_rig import PATIENCE_S, Told, state
from tests.robots.link.rig import Clock
from vsense.robots.link.status import LinkError
from vsense.robots.link.trackers import lines as arena_lines
from vsense.robots.link.trackers.lines import (
    BAD_MAX,
    CANDIDATES_EACH,
    LINE_MAX,
    TRACKER_SILENCE_NS,
    ArenaListener,
    Line,
    LineInbox,
    SenderClock,
    parse,
)
from vsense.robots.link.trackers.protocol import TrackerReport

EXAMPLE = (
    '{"timestep": 17, "capture_ns": 81234567890123, "send_ns": 81234601234567, "robots": ['
    ' {"tag": 23, "x_m": 0.512, "y_m": -0.103, "yaw_rad": 1.5708}]}'
)
MS = 1_000_000


class Tracker:
    """Some tracker that writes lines."""

    def __init__(self, listener: ArenaListener) -> None:
        self.sock = socket.create_connection(("127.0.0.1", listener.port), PATIENCE_S)
        self.answers = self.sock.makefile("r")

    def write(self, *lines: str) -> None:
        self.sock.sendall("".join(f"{line}\n" for line in lines).encode())

    def step(self, timestep: int, x_m: float = 0.5, tag: int = 23) -> None:
        robot = {"tag": tag, "x_m": x_m, "y_m": 0, "yaw_rad": 0}
        self.write(json.dumps({"timestep": timestep, "capture_ns": timestep, "robots": [robot]}))

    def answer(self) -> dict:
        return json.loads(self.answers.readline())

    def close(self) -> None:
        self.answers.close()
        self.sock.close()


@pytest.fixture
def listener(told: Told, clock: Clock) -> Iterator[ArenaListener]:
    made = ArenaListener("127.0.0.1", 0, (23, 24), told, clock)
    yield made
    made.close()


@pytest.fixture
def tracker(listener: ArenaListener) -> Iterator[Tracker]:
    made = Tracker(listener)
    yield made
    made.close()


def test_the_documented_example_is_read() -> None:
    assert parse(EXAMPLE.encode()) == Line(
        17, 81234567890123, 81234601234567, (TrackerReport(23, 0.512, -0.103, 1.5708),)
    )


def test_the_page_about_it_is_true(listener: ArenaListener) -> None:
    page = (Path(arena_lines.__file__).parents[1] / "TRACKERS.md").read_text()
    (example,) = re.findall(r"```json\n(.*?)```", page, re.S)
    first, second = (parse(line.encode()) for line in example.splitlines())
    assert first.timestep + 1 == second.timestep and len(second.robots) == 1
    (program,) = re.findall(r"```python\n(.*?)```", page, re.S)
    words = [sys.executable, "-c", program, "127.0.0.1", str(listener.port)]
    with subprocess.Popen(words) as tracker:
        for _ in range(2):
            state, _ = listener.next(PATIENCE_S)
            (robot,) = state.robots
            assert math.hypot(robot["x_m"], robot["y_m"]) == pytest.approx(0.5)
        tracker.kill()
    (said,) = re.findall(r"```\n(\{.*)\n```", page)
    with pytest.raises(LinkError) as error:
        parse(b'{"timestep":1,"capture_ns":1,"robots":[{"tag":1,"x_m":"a","y_m":0,"yaw_rad":0}]}')
    assert json.loads(said)["error"] == str(error.value)


def test_what_vsense_track_writes_is_read() -> None:
    arena = state(12, (23, 0.5, 0.25, 3.0), (24, 1.0, 1.0, 0.0), unseen=(24,))
    line = parse(arena.to_json().encode())
    assert line == Line(12, 1012, 1012, (TrackerReport(23, 0.5, 0.25, 3.0),))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"timestep": -1}, "-1.*number.*0"),
        ({"timestep": 1.5}, "timestep.*1.5"),
        ({"timestep": True}, "timestep.*True"),
        ({"timestep": None}, "timestep.*missing"),
        ({"capture_ns": "now"}, "capture_ns.*'now'"),
        ({"send_ns": 2**62 + 1}, "send_ns.*4611686018427387905"),
        ({"robots": 3}, "3.*list"),
        ({"robots": [{}] * 1025}, "list.*1024"),
        ({"robots": [7]}, r"robots\[0\].*7.*object"),
        ({"robots": [{"tag": 1}]}, r"robots\[0\].x_m.*missing"),
        (
            {"robots": [{"tag": 1, "x_m": "a" * 99, "y_m": 0, "yaw_rad": 0}]},
            r"robots\[0\].x_m is 'a{36}\.\.\., expected a number",
        ),
        (
            {"robots": [{"tag": 1, "x_m": 0, "y_m": 1e9, "yaw_rad": 0}]},
            r"robots\[0\].y_m.*1000000000.0",
        ),
        (
            {"robots": [{"tag": 1, "x_m": 0, "y_m": 0, "yaw_rad": math.nan}]},
            r"robots\[0\].yaw_rad",
        ),
        (
            {"robots": [{"tag": 1, "x_m": 0, "y_m": 0, "yaw_rad": 0, "seen": 1}]},
            r"robots\[0\].seen.*1.*false",
        ),
    ],
)
def test_wrong_members_are_named(change: dict, reason: str) -> None:
    with pytest.raises(LinkError, match=reason):
        parse(json.dumps(json.loads(EXAMPLE) | change).encode())


@pytest.mark.parametrize("text", [b"{", b"", b"\xff", b"[" * 100_000, b"1" * 10_000])
def test_what_is_no_json_is_refused(text: bytes) -> None:
    with pytest.raises(LinkError, match="JSON"):
        parse(text)


@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
        lambda inner: (
            st.lists(inner, max_size=3)
            | st.dictionaries(
                st.sampled_from(
                    ["timestep", "capture_ns", "robots", "tag", "x_m", "y_m", "yaw_rad"]
                ),
                inner,
            )
        ),
    )
)
def test_any_json_is_a_line_or_one_named_error(value: object) -> None:
    try:
        parse(json.dumps(value).encode())
    except LinkError as error:
        assert str(error)


@given(st.lists(st.binary(max_size=30).map(lambda b: b.replace(b"\n", b"")), max_size=6), st.data())
def test_any_chunking_gives_the_same_lines(lines: list[bytes], data: st.DataObject) -> None:
    stream = b"".join(line + b"\n" for line in lines)
    cuts = data.draw(st.lists(st.integers(0, len(stream)), max_size=8).map(sorted))
    inbox, found = LineInbox(), []
    for start, end in zip([0, *cuts], [*cuts, len(stream)]):
        found += inbox.feed(stream[start:end])
    assert found == list(enumerate(lines, 1))


def test_a_line_that_never_ends_takes_bounded_memory() -> None:
    inbox = LineInbox()
    for _ in range(40):
        assert inbox.feed(b"x" * (LINE_MAX // 10)) == []
        assert len(inbox._bytes) <= LINE_MAX
    assert inbox.feed(b"\nnext\n") == [(1, None), (2, b"next")]


@given(st.lists(st.integers(0, 50 * MS), min_size=2, max_size=30), st.integers(-(10**15), 10**15))
def test_capture_times_are_never_early_by_more_than_the_quickest_line(
    delays_ns: list[int], shift_ns: int
) -> None:
    """Every line was captured 30 ms before it was sent, on a clock with another zero."""
    clock = SenderClock()
    quickest_ns = delays_ns[0]
    for step, delay_ns in enumerate(delays_ns):
        true_ns = 10**15 + step * 100 * MS
        line = Line(step, true_ns + shift_ns, true_ns + shift_ns + 30 * MS, ())
        arrived_ns = true_ns + 30 * MS + delay_ns
        quickest_ns = min(quickest_ns, delay_ns)
        drift_ns = step * 100 * MS * 250 // 1_000_000
        late_ns = clock.host_ns(line, arrived_ns) - true_ns
        assert 0 <= late_ns <= quickest_ns + drift_ns
        assert true_ns + late_ns <= arrived_ns


def test_lines_become_states(listener: ArenaListener, tracker: Tracker) -> None:
    tracker.write(EXAMPLE)
    first, frames = listener.next(PATIENCE_S)
    assert first.robots["tag"].tolist() == [23] and first.robots["x_m"][0] == 0.512
    assert frames == ()
    tracker.write(EXAMPLE.replace("17", "20").replace('"tag": 23, "x_m": 0', '"tag": 77, "x_m": 3'))
    second, _ = listener.next(PATIENCE_S)
    assert second.timestep == first.timestep + 3
    assert second.unnamed == 1 and not second.robots["seen"].any()


def test_the_newest_of_several_lines_is_given(listener: ArenaListener, tracker: Tracker) -> None:
    for timestep in range(1, 21):
        tracker.step(timestep, 0.01 * timestep)
    state, _ = listener.next(PATIENCE_S)
    while listener.counters.states < 20:
        state, _ = listener.next(PATIENCE_S)
    assert state.robots["x_m"][0] == pytest.approx(0.2)


def test_a_clock_that_is_set_back_is_told_once(
    listener: ArenaListener, tracker: Tracker, told: Told, clock: Clock
) -> None:
    """From then on all lines seem to be old: robots stand, and somebody should know why."""
    theirs_ns = 5_000_000_000
    for timestep in range(1, 41):
        clock.advance(100 * MS)
        theirs_ns += 100 * MS - (2000 * MS if timestep == 10 else 0)
        line = {"timestep": timestep, "capture_ns": theirs_ns, "robots": []}
        tracker.write(json.dumps(line))
        listener.next(PATIENCE_S)
    (line,) = (line for line in told.lines if "s old" in line)
    assert "its lines are 2.0 s old, robots stand: " in line and "its clock was set back" in line


def test_a_bad_line_is_answered_and_the_next_one_is_good(
    listener: ArenaListener, tracker: Tracker, told: Told
) -> None:
    tracker.step(5)
    listener.next(PATIENCE_S)
    tracker.write("{", "", "[]", '{"timestep": 1}', "?", "?")
    tracker.step(5)
    tracker.step(6)
    assert listener.next(PATIENCE_S)[0].timestep == 1
    answers = [tracker.answer() for _ in range(6)]
    assert [answer["line"] for answer in answers] == [2, 4, 5, 6, 7, 8]
    assert answers[2]["error"] == "capture_ns is missing, expected a whole number from 0"
    assert answers[5]["error"] == "timestep is 5 after 5, expected more"
    assert listener.counters.bad_lines == 6
    assert sum(": line " in line for line in told.lines) == 3


def test_a_second_tracker_is_refused_until_the_first_falls_silent(
    listener: ArenaListener, tracker: Tracker, told: Told, clock: Clock
) -> None:
    tracker.step(1)
    listener.next(PATIENCE_S)
    second = Tracker(listener)
    with pytest.raises(LinkError, match=r"0.01 s"):
        listener.next(0.01)
    told.wait("refused, one on 127.0.0.1 is writing")
    assert second.answer() == {"error": "a tracker on 127.0.0.1 is writing already"}
    second.close()
    clock.advance(TRACKER_SILENCE_NS)
    third = Tracker(listener)
    third.step(1, 0.75)
    state, _ = listener.next(PATIENCE_S)
    assert state.robots["x_m"][0] == 0.75 and state.timestep == 1
    told.wait("has fallen silent, another one takes over")
    third.close()


@pytest.mark.parametrize("writes", [b"", b"garbage\n", b"{}\n" * 100, b'{"timestep"', b"\n" * 99])
def test_only_valid_lines_hold_the_place(
    listener: ArenaListener, told: Told, clock: Clock, writes: bytes
) -> None:
    """Somebody who came first, and goes on writing, keeps no tracker out."""
    first = Tracker(listener)
    first.sock.sendall(writes)
    with pytest.raises(LinkError):
        listener.next(0.05)
    ours = Tracker(listener)
    for timestep in range(1, 4):
        with suppress(ConnectionError):  # it may have been closed
            first.sock.sendall(writes)
        ours.step(timestep)
        listener.next(PATIENCE_S)
        clock.advance(TRACKER_SILENCE_NS)
    assert listener.counters.states == 3 and listener.counters.connections == 1
    for one in (first, ours):
        one.close()


def test_a_tracker_that_turns_to_garbage_loses_its_place(
    listener: ArenaListener, tracker: Tracker, told: Told, clock: Clock
) -> None:
    tracker.step(1)
    listener.next(PATIENCE_S)
    clock.advance(TRACKER_SILENCE_NS)
    tracker.write("garbage")
    other = Tracker(listener)
    other.step(7, 0.75)
    assert listener.next(PATIENCE_S)[0].robots["x_m"][0] == 0.75
    told.wait("has fallen silent, another one takes over")
    other.close()


def test_a_flood_on_the_port_is_few_lines_and_no_tracker_misses_a_line(
    listener: ArenaListener, tracker: Tracker, told: Told, clock: Clock
) -> None:
    tracker.step(1)
    listener.next(PATIENCE_S)
    for number in range(2, 52):
        crowd = [Tracker(listener) for _ in range(4)]
        for one in crowd:
            one.write("garbage")
        tracker.step(number)
        listener.next(PATIENCE_S)
        with pytest.raises(LinkError):
            listener.next(0.01)
        for one in crowd:
            one.close()
    assert listener.counters.states == 51
    assert len(told.lines) < 25
    clock.advance(10 * TRACKER_SILENCE_NS)
    with pytest.raises(LinkError):
        listener.next(0.01)
    assert " more from 127.0.0.1 in the last 10 s: connections and bad lines" in told.lines[-1]


def test_silent_ones_take_no_more_than_their_places(listener: ArenaListener, told: Told) -> None:
    crowd = [Tracker(listener) for _ in range(CANDIDATES_EACH + 2)]
    with pytest.raises(LinkError):
        listener.next(0.2)
    assert [one.answers.readline() for one in crowd[:2]] == ["", ""]
    crowd[-1].step(1)
    assert listener.next(PATIENCE_S)[0].robots["seen"].all()
    told.wait("127.0.0.1: no valid line")
    for one in crowd:
        one.close()


def test_bad_lines_of_others_do_not_delay_the_tracker(listener: ArenaListener, told: Told) -> None:
    noisy = Tracker(listener)
    noisy.write(*["x"] * 30_000)
    with pytest.raises(LinkError):
        listener.next(0.2)
    assert listener.counters.bad_lines == BAD_MAX
    told.wait("closed after 16 bad lines and no valid one")
    noisy.close()


def test_without_descriptors_it_does_not_turn_in_circles(
    listener: ArenaListener, told: Told, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Full(socket.socket):
        tries = 0

        def accept(self) -> tuple[socket.socket, tuple[str, int]]:
            Full.tries += 1
            if Full.tries == 1:
                raise OSError(errno.EMFILE, "Too many open files")
            return super().accept()

    monkeypatch.setattr(listener, "_listener", Full(fileno=listener._listener.detach()))
    tracker = Tracker(listener)
    tracker.step(1)
    with pytest.raises(LinkError):
        listener.next(0.1)
    assert Full.tries == 1
    told.wait("this machine: cannot accept a connection: Too many open files")
    clock.advance(TRACKER_SILENCE_NS)
    assert listener.next(PATIENCE_S)[0].robots["seen"].all()
    tracker.close()


def test_a_tracker_may_leave_in_the_middle_of_a_line_and_come_back(
    listener: ArenaListener, tracker: Tracker, told: Told
) -> None:
    tracker.sock.sendall(EXAMPLE.encode()[:50])
    tracker.close()
    again = Tracker(listener)
    again.step(1)
    with pytest.raises(LinkError):
        while True:
            listener.next(0.2)
    again.close()
    last = Tracker(listener)
    last.step(3)
    assert listener.next(PATIENCE_S)[0].robots["seen"].all()
    told.wait("has closed the connection", times=1)
    last.close()


def test_silence_is_an_error_and_closing_ends_it(listener: ArenaListener) -> None:
    with pytest.raises(LinkError, match=f"port {listener.port}: no arena state in 0.01 s"):
        listener.next(0.01)
    listener.close()
    listener.close()
    with pytest.raises(LinkError, match="closed"):
        listener.next(0.01)
