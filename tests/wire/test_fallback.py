"""A network without UDP: both ends notice, go over TCP, and come back when it does."""

from __future__ import annotations

import pytest

from tests.wire.robot_session import Event
from tests.wire.strategies import MS, Link, S
from vsense.base.native import lib


def exchange(link: Link, now_ns: int, down: bool, up: bool) -> None:
    """One round as both ends play it: UDP always, TCP as well where it is due."""
    state, telemetry = link.state(now_ns), link.robot.telemetry(link.robot_ns(now_ns))
    if down:
        link.deliver(state, now_ns)
    if link.host.over_tcp(now_ns):
        link.robot.tcp_in(state, link.robot_ns(now_ns))
    if up:
        link.host.receive_telemetry(telemetry, True, now_ns)
    if link.robot.over_tcp(link.robot_ns(now_ns)):
        link.host.receive_telemetry(telemetry, False, now_ns)


def run(link: Link, start_ns: int, seconds: float, down: bool, up: bool) -> list[Event]:
    """Rounds every 50 ms; the robot's events of time."""
    events = []
    for i in range(round(seconds * 20)):
        now_ns = start_ns + i * 50 * MS
        exchange(link, now_ns, down, up)
        events.append(link.robot.tick(link.robot_ns(now_ns)))
    return [event for event in events if event != Event.NONE]


def is_over_tcp(link: Link, now_ns: int) -> tuple[bool, bool]:
    return link.host.over_tcp(now_ns), link.robot.over_tcp(link.robot_ns(now_ns))


@pytest.mark.parametrize(
    ("down", "up"), [(False, False), (False, True), (True, False)], ids=["none", "up", "down"]
)
def test_without_udp_state_goes_over_tcp_and_comes_back(down: bool, up: bool) -> None:
    link = Link()
    link.greet(S)
    assert run(link, S, 1.0, True, True) == []
    assert is_over_tcp(link, 2 * S) == (False, False)
    assert run(link, 2 * S, 3.0, down, up) == ([] if down else [Event.UDP_LOST])
    assert is_over_tcp(link, 5 * S) == (True, True)
    accepted = link.robot.counters["accepted"], link.host.counters["accepted"]
    assert run(link, 5 * S, 1.0, down, up) == []
    assert (link.robot.counters["accepted"], link.host.counters["accepted"]) == (
        accepted[0] + 20,
        accepted[1] + 20,
    )
    assert run(link, 6 * S, 1.0, True, True) == ([] if down else [Event.UDP_UP])
    assert is_over_tcp(link, 7 * S) == (False, False)


def test_silence_of_udp_counts_from_the_welcome() -> None:
    link = Link()
    link.greet(S)
    just_before, then = link.robot_ns(2 * S - 1), link.robot_ns(2 * S)
    for _ in range(2):  # the first goes over TCP, too, whatever UDP does
        link.robot.telemetry(just_before)
    assert link.robot.tick(just_before) == Event.NONE
    assert not link.robot.over_tcp(just_before)
    assert link.robot.tick(then) == Event.UDP_LOST
    assert link.robot.over_tcp(then)
    assert link.robot.tick(then) == Event.NONE
    assert link.host.open_packet(link.robot.telemetry(then))[0].flags == lib.VS_FLAG_NO_UDP


def test_udp_is_up_again_even_if_tcp_was_faster_each_time() -> None:
    link = Link()
    link.greet(S)
    assert link.robot.tick(link.robot_ns(3 * S)) == Event.UDP_LOST
    state = link.state(3 * S)
    assert link.robot.tcp_in(state, link.robot_ns(3 * S)) == [Event.STATE]
    assert link.deliver(state, 3 * S + MS) == (lib.VS_ERR_REPEATED, Event.NONE)
    assert link.robot.tick(link.robot_ns(3 * S + MS)) == Event.UDP_UP


def test_an_old_datagram_once_more_does_not_pretend_that_udp_works() -> None:
    link = Link()
    link.greet(S)
    state = link.state(S)
    link.deliver(state, S)
    link.deliver(state, 2 * S)
    assert link.robot.tick(link.robot_ns(2 * S)) == Event.UDP_LOST


def test_nothing_goes_over_tcp_without_a_session() -> None:
    link = Link()
    assert is_over_tcp(link, 100 * S) == (False, False)
    link.greet(S)
    assert link.robot.tick(link.robot_ns(3 * S)) == Event.UDP_LOST
    link.robot.disconnect()
    assert not link.robot.over_tcp(link.robot_ns(4 * S))
    assert link.robot.tick(link.robot_ns(4 * S)) == Event.NONE
