"""Counters of the links over all lives of every daemon."""

from __future__ import annotations

from dataclasses import replace

from vsense.robots.link.status import RobotStatus
from vsense.robots.link.wire import Telemetry
from vsense.run.robots import LinkCounters


def status(sent: int, sessions: int = 1, **telemetry: int) -> RobotStatus:
    return RobotStatus(
        tag=7,
        name="epuck_7_0",
        connected=True,
        uid=bytes(16),
        controller="pollutant",
        version="",
        hash="",
        since_ns=0,
        heard_ns=0,
        udp=True,
        telemetry=Telemetry(**telemetry),
        sessions=sessions,
        sent=sent,
        superseded=0,
        unsent=0,
        received=0,
        accepted=0,
        dropped={},
    )


def test_repeated_packets_do_not_count_as_received() -> None:
    counters = LinkCounters()
    counters.update({7: status(100, received=110, old=9, foreign=2, corrupt=1)})
    assert (counters.sent, counters.received, counters.dropped) == (100, 98, 12)


def test_restarted_daemon_adds_to_what_the_first_had_received() -> None:
    counters = LinkCounters()
    counters.update({7: status(100, received=100)})
    counters.update({7: status(150, sessions=2, received=5)})
    counters.update({7: status(200, sessions=2, received=60, old=1)})
    assert (counters.sent, counters.received, counters.dropped) == (200, 159, 1)
    assert counters.sessions == 2


def test_what_a_daemon_received_of_an_earlier_server_does_not_count() -> None:
    counters = LinkCounters()
    counters.update({7: status(3, received=1812, old=9)})
    assert (counters.received, counters.dropped) == (3, 0)
    counters.update({7: status(100, received=1908, old=10)})
    assert (counters.received, counters.dropped) == (98, 1)
    counters.update({7: status(150, sessions=2, received=40)})
    assert (counters.received, counters.dropped) == (138, 1)


def test_no_more_is_received_than_was_sent() -> None:
    counters = LinkCounters()
    counters.update({7: status(3, received=1811)})
    counters.update({7: status(100, received=1909)})
    assert (counters.sent, counters.received) == (100, 100), "two of the three were on their way"


def test_replaced_guard_is_told_once_and_again_after_a_restart() -> None:
    counters = LinkCounters()
    assert counters.update({7: status(1, received=1)}) == []
    assert len(counters.update({7: status(2, received=2, guard_restarts=1)})) == 1
    assert counters.update({7: status(3, received=3, guard_restarts=1)}) == []
    assert len(counters.update({7: status(4, received=1, guard_restarts=1)})) == 1


def test_robot_that_never_spoke_has_received_nothing() -> None:
    counters = LinkCounters()
    silent = status(10)
    counters.update({7: silent})
    assert (counters.sent, counters.received) == (10, 0)


def test_sessions_that_a_defect_has_ended_are_counted_for_each_run() -> None:
    counters = LinkCounters()
    counters.update({7: replace(status(10), defects=2)})
    assert counters.defects == 2
    counters = counters.anew()
    counters.update({7: replace(status(20), defects=3)})
    assert counters.defects == 1
