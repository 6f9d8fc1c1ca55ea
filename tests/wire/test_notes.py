"""What a controller says: shown values are levels, log lines arrive once, whatever is lost."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from tests.wire.strategies import MS, Link, S
from vsense.robots.link._peer import Orders
from vsense.robots.link.status import LogLines
from vsense.robots.link.wire import Telemetry, Wanted

LINE = 1, "first"


def test_a_line_is_told_once() -> None:
    lines = LogLines()
    lines.open(b"u", 5)
    assert lines.add(0, "") == []
    assert lines.add(*LINE) == ["logged: first"]
    assert lines.add(*LINE) == []
    assert lines.heard == 1


def test_missing_lines_are_counted() -> None:
    lines = LogLines()
    lines.open(b"u", 5)
    lines.add(*LINE)
    assert lines.add(4, "fourth") == ["2 of its log lines are lost", "logged: fourth"]


def test_a_session_of_the_same_daemon_tells_nothing_twice_and_a_new_daemon_begins_anew() -> None:
    lines = LogLines()
    lines.open(b"u", 5)
    lines.add(*LINE)
    lines.open(b"u", 5)
    assert (lines.heard, lines.add(*LINE)) == (1, [])
    lines.open(b"u", 6)
    assert (lines.heard, lines.add(*LINE)) == (0, ["logged: first"])
    lines.open(b"v", 6)
    assert lines.add(*LINE) == ["logged: first"]


def test_the_robot_hears_how_far_the_host_has_heard() -> None:
    link = Link()
    link.greet(S)
    values = [(bytes(4), 2 * S)]
    state = link.host.send_state(Orders(1, Wanted.RUN), 1, 2 * S, values, 2 * S, log_heard=7)
    assert link.deliver(state, 2 * S)[0] == 0
    assert link.robot.c.state.log_heard == 7


def test_an_offer_counts_where_table_or_params_differ() -> None:
    link = Link()
    link.greet(S)
    assert link.robot.c.offer == 1
    link.robot.disconnect()
    link.greet(2 * S)
    assert link.robot.c.offer == 1


@given(st.lists(st.tuples(st.booleans(), st.booleans()), min_size=1, max_size=60))
def test_every_line_arrives_in_order_over_any_loss(ways: list[tuple[bool, bool]]) -> None:
    """The robot repeats its oldest unheard line; either way may lose a packet."""
    lines, robot_heard, told = LogLines(), 0, []
    lines.open(b"u", 5)
    for up, down in [*ways, *[(True, True)] * 40]:
        number = robot_heard + 1
        if number <= 8 and up:
            told += lines.add(number, str(number))
        if down:
            robot_heard = lines.heard
    assert told == [f"logged: {number}" for number in range(1, 9)]


def test_a_whole_telemetry_carries_what_was_shown_and_logged() -> None:
    link = Link()
    link.greet(S)
    shown = (("state", "searching"), ("n", 0.5))
    said = Telemetry(payload=bytes(4), log_number=3, log="saw red", shown=shown)
    packet = link.robot.telemetry(link.robot_ns(2 * S), said)
    got = link.host.receive_telemetry(packet, True, 2 * S + MS)
    assert got is not None
    heard = got[1]
    assert (heard.log_number, heard.log, heard.shown) == (3, "saw red", shown)
