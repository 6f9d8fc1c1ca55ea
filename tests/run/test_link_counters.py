"""Counters of the links over all lives of every daemon, and trouble in the telemetry."""

from __future__ import annotations

from dataclasses import replace

from tests.run.stage import counted
from vsense.robots.link.status import RobotStatus
from vsense.robots.link.wire import StopCause
from vsense.run.robots import TROUBLE_DELAY_NS, LinkCounters, RobotAlarms


def test_repeated_packets_do_not_count_as_received() -> None:
    counters = LinkCounters()
    counters.update({7: counted(100, received=110, old=9, foreign=2, corrupt=1)})
    assert (counters.sent, counters.received, counters.dropped) == (100, 98, 12)


def test_restarted_daemon_adds_to_what_the_first_had_received() -> None:
    counters = LinkCounters()
    counters.update({7: counted(100, received=100)})
    counters.update({7: counted(150, sessions=2, received=5)})
    counters.update({7: counted(200, sessions=2, received=60, old=1)})
    assert (counters.sent, counters.received, counters.dropped) == (200, 159, 1)
    assert counters.sessions == 2


def test_what_a_daemon_received_of_an_earlier_server_does_not_count() -> None:
    counters = LinkCounters()
    counters.update({7: counted(3, received=1812, old=9)})
    assert (counters.received, counters.dropped) == (3, 0)
    counters.update({7: counted(100, received=1908, old=10)})
    assert (counters.received, counters.dropped) == (98, 1)
    counters.update({7: counted(150, sessions=2, received=40)})
    assert (counters.received, counters.dropped) == (138, 1)


def test_no_more_is_received_than_was_sent() -> None:
    counters = LinkCounters()
    counters.update({7: counted(3, received=1811)})
    counters.update({7: counted(100, received=1909)})
    assert (counters.sent, counters.received) == (100, 100), "two of the three were on their way"


def test_replaced_guard_is_told_once_and_again_after_a_restart() -> None:
    counters = LinkCounters()
    assert counters.update({7: counted(1, received=1)}) == []
    assert len(counters.update({7: counted(2, received=2, guard_restarts=1)})) == 1
    assert counters.update({7: counted(3, received=3, guard_restarts=1)}) == []
    assert len(counters.update({7: counted(4, received=1, guard_restarts=1)})) == 1


def test_robot_that_never_spoke_has_received_nothing() -> None:
    counters = LinkCounters()
    silent = counted(10)
    counters.update({7: silent})
    assert (counters.sent, counters.received) == (10, 0)


def test_sessions_that_a_defect_has_ended_are_counted_for_each_run() -> None:
    counters = LinkCounters()
    counters.update({7: replace(counted(10), defects=2)})
    assert counters.defects == 2
    counters = counters.from_here()
    counters.update({7: replace(counted(20), defects=3)})
    assert counters.defects == 1


STEP_NS = TROUBLE_DELAY_NS // 4


def lines(history: list[RobotStatus]) -> list[str]:
    complaints = RobotAlarms()
    return [
        line if level == "warning" else f"{level}: {line}"
        for number, now in enumerate(history)
        for line, level in complaints.update({7: now}, number * STEP_NS)
    ]


def test_base_that_does_not_answer_is_told_once_and_so_is_its_return() -> None:
    well, mute = counted(1, battery_low=255), counted(1, stop_cause=StopCause.BASE, battery_low=255)
    assert lines([well] * 9) == []
    assert lines([mute] * 4 + [well]) == [], "a daemon that starts looks for its base for a moment"
    assert lines([well] + [mute] * 12) == ["robot 7: its base does not answer: its wheels are held"]
    assert lines([mute] * 6 + [well] * 3 + [mute] * 6) == [
        "robot 7: its base does not answer: its wheels are held",
        "info: robot 7: its base answers again",
        "robot 7: its base does not answer: its wheels are held",
    ]


def test_low_battery_is_told() -> None:
    low = counted(1, battery_low=1)
    assert lines([low] * 6) == ["robot 7: its battery is low"]


def test_power_saving_is_told_and_an_unknown_one_is_not() -> None:
    on, off, unknown = (counted(1, power_saving=value) for value in (1, 0, 255))
    assert lines([unknown] * 6 + [on] * 6 + [off]) == [
        "robot 7: its Wi-Fi's power saving is on: readings come late;"
        " 'vsense robot deploy' turns it off",
        "info: robot 7: its Wi-Fi's power saving is off",
    ]


def test_robot_that_is_gone_or_never_spoke_complains_of_nothing() -> None:
    gone = replace(counted(1, stop_cause=StopCause.BASE), connected=False)
    silent = replace(counted(1), telemetry=None)
    assert lines([gone] * 9 + [silent] * 9) == []
