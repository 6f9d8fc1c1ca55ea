"""Trouble in the robots' telemetry reaches a person once, and so does its end."""

from __future__ import annotations

from dataclasses import replace

from tests.run.test_link_counters import status
from vsense.robots.link.status import RobotStatus
from vsense.robots.link.wire import StopCause
from vsense.run.robots import PATIENCE_NS, RobotAlarms

STEP_NS = PATIENCE_NS // 4


def lines(history: list[RobotStatus]) -> list[str]:
    complaints = RobotAlarms()
    return [
        line
        for number, now in enumerate(history)
        for line in complaints.update({7: now}, number * STEP_NS)
    ]


def test_base_that_does_not_answer_is_told_once_and_so_is_its_return() -> None:
    well, mute = status(1, battery_low=255), status(1, stop_cause=StopCause.BASE, battery_low=255)
    assert lines([well] * 9) == []
    assert lines([mute] * 4 + [well]) == [], "a daemon that starts looks for its base for a moment"
    assert lines([well] + [mute] * 12) == [
        "robot epuck_7_0: its base does not answer: its wheels are held"
    ]
    assert lines([mute] * 6 + [well] * 3 + [mute] * 6) == [
        "robot epuck_7_0: its base does not answer: its wheels are held",
        "robot epuck_7_0: its base answers again",
        "robot epuck_7_0: its base does not answer: its wheels are held",
    ]


def test_low_battery_is_told() -> None:
    low = status(1, battery_low=1)
    assert lines([low] * 6) == ["robot epuck_7_0: its battery is low"]


def test_power_saving_is_told_and_an_unknown_one_is_not() -> None:
    on, off, unknown = (status(1, power_saving=value) for value in (1, 0, 255))
    assert lines([unknown] * 6 + [on] * 6 + [off]) == [
        "robot epuck_7_0: its Wi-Fi's power saving is on: readings come late;"
        " 'vsense robot deploy' turns it off",
        "robot epuck_7_0: its Wi-Fi's power saving is off",
    ]


def test_robot_that_is_gone_or_never_spoke_complains_of_nothing() -> None:
    gone = replace(status(1, stop_cause=StopCause.BASE), connected=False)
    silent = replace(status(1), telemetry=None)
    assert lines([gone] * 9 + [silent] * 9) == []
