"""What people order, and the states that follow."""

from __future__ import annotations

import threading

import pytest

from vsense.link.robots.wire import Wanted
from vsense.run.control import Control, Order, OrderError, OrderKind, State


class Played:
    """A control, what it told the robots, and what it told people."""

    def __init__(self, **options: bool) -> None:
        self.commands: list[Wanted] = []
        self.said: list[str] = []
        self.starts = 0
        self.control = Control(self.commands.append, self.said.append, **options)

    def give(self, kind: OrderKind, by: str = "Ann", value: float = 0.0) -> str:
        return self.control.give(Order(kind, by, value))

    def begin(self) -> bool:
        def start() -> None:
            self.starts += 1

        return self.control.begin(start)

    @property
    def can(self) -> set[OrderKind]:
        return set(self.control.can)


@pytest.fixture
def played() -> Played:
    return Played()


@pytest.fixture
def running(played: Played) -> Played:
    assert played.begin()
    return played


def test_a_run_that_is_waited_for_can_be_started_early(played: Played) -> None:
    assert played.control.state == State.WAITING and not played.control.asked
    assert played.give(OrderKind.START) == "run 1 starts"
    assert played.control.asked and played.begin()
    assert played.control.state == State.RUNNING and not played.control.asked
    assert played.said == ["Ann: run 1 starts"] and played.control.by == "Ann"


def test_of_two_people_who_press_start_the_second_is_told(played: Played) -> None:
    played.give(OrderKind.START)
    with pytest.raises(OrderError, match="Ann has asked for it already"):
        played.give(OrderKind.START, "Bob")
    assert played.control.by == "Ann"
    played.begin()
    with pytest.raises(OrderError, match="run 1 is going on already"):
        played.give(OrderKind.START, "Bob")


def test_pause_tells_the_robots_at_once_and_start_goes_on(running: Played) -> None:
    assert running.give(OrderKind.PAUSE) == "run 1 is paused"
    assert running.commands == [Wanted.PAUSE]
    assert running.give(OrderKind.START) == "run 1 goes on"
    assert running.control.state == State.PAUSED, "only the run's thread starts anything"
    assert running.begin() and running.control.state == State.RUNNING and running.starts == 2


def test_stop_ends_the_run_and_start_begins_the_next(running: Played) -> None:
    running.give(OrderKind.STOP)
    assert running.commands == [Wanted.STOP]
    assert (running.control.state, running.control.why) == (State.ENDED, "stopped by Ann")
    assert not running.begin(), "whoever was about to start it comes too late"
    assert running.give(OrderKind.START) == "run 2 begins"
    assert running.control.next_asked
    running.control.next_run()
    assert (running.control.run, running.control.state) == (2, State.WAITING)
    assert running.control.asked, "it was asked to begin, so it does"


def test_reset_ends_the_run_and_the_next_one_waits(running: Played) -> None:
    assert running.give(OrderKind.RESET) == "reset: run 2 waits for a start"
    assert running.commands == [Wanted.STOP] and running.control.why == "reset by Ann"
    assert running.control.next_asked
    running.control.next_run()
    assert running.control.holds and not running.control.asked
    running.control.ready()
    assert running.control.state == State.READY


@pytest.mark.parametrize("before", list(State))
def test_an_emergency_stop_always_works_and_only_a_reset_ends_it(before: State) -> None:
    played = Played()
    played.begin()
    played.control.state = before
    assert OrderKind.EMERGENCY in played.can
    played.give(OrderKind.EMERGENCY)
    assert played.commands == [Wanted.STOP] and played.control.state == State.EMERGENCY
    assert not played.begin() and played.starts == 1
    for kind in (OrderKind.START, OrderKind.PAUSE, OrderKind.STOP):
        with pytest.raises(OrderError):
            played.give(kind)
    played.control.next_run()
    assert played.control.state == State.EMERGENCY, "no new run ends it"


def test_an_emergency_before_the_run_costs_no_run(played: Played) -> None:
    played.give(OrderKind.EMERGENCY)
    assert played.give(OrderKind.RESET) == "reset: run 1 waits for a start"
    assert played.control.state == State.WAITING and not played.control.next_asked


def test_a_run_that_suspends_is_resumed_where_it_was() -> None:
    played = Played(suspends=True)
    played.begin()
    assert "suspended" in played.give(OrderKind.STOP)
    assert played.commands == [Wanted.STOP] and played.control.state == State.PAUSED
    played.give(OrderKind.START)
    assert played.begin() and played.control.run == 1
    played.give(OrderKind.RESET)
    assert played.control.state == State.ENDED


@pytest.mark.parametrize("kind", [OrderKind.PAUSE, OrderKind.STOP, OrderKind.RESET])
def test_before_the_run_there_is_nothing_to_end(played: Played, kind: OrderKind) -> None:
    with pytest.raises(OrderError, match=f"cannot {kind.value}: run 1 is not running"):
        played.give(kind)
    assert played.commands == [] and played.said == [] and played.control.by is None


@pytest.mark.parametrize("kind", [OrderKind.PLAY, OrderKind.SPEED, OrderKind.SEEK])
def test_what_only_a_replay_can_do_is_refused(played: Played, kind: OrderKind) -> None:
    with pytest.raises(OrderError, match="only a replay"):
        played.give(kind)


def test_recording_is_switched_where_there_is_something_to_switch(played: Played) -> None:
    assert OrderKind.RECORD not in played.can
    with pytest.raises(OrderError, match="nothing is recorded here"):
        played.give(OrderKind.RECORD, value=1)
    played.control.record = lambda on: f"recording {on}"
    assert OrderKind.RECORD in played.can
    assert played.give(OrderKind.RECORD, value=1) == "recording True"


@pytest.mark.parametrize("state", list(State))
def test_what_is_offered_is_obeyed_and_nothing_else(state: State) -> None:
    for kind in (
        OrderKind.START,
        OrderKind.PAUSE,
        OrderKind.STOP,
        OrderKind.RESET,
        OrderKind.EMERGENCY,
    ):
        played = Played()
        if state not in (State.WAITING, State.READY):
            played.begin()
        played.control.state = state
        if kind in played.can:
            played.give(kind)
        else:
            with pytest.raises(OrderError):
                played.give(kind)


def test_a_start_that_was_only_asked_for_can_be_withdrawn(played: Played) -> None:
    played.give(OrderKind.START)
    assert played.give(OrderKind.STOP, "Bob") == "the start is withdrawn"
    assert not played.control.asked and played.commands == []
    played.begin()
    played.give(OrderKind.PAUSE)
    played.give(OrderKind.START)
    assert played.give(OrderKind.PAUSE) == "run 1 stays paused"
    assert not played.control.asked
    played.give(OrderKind.STOP)
    played.give(OrderKind.START)
    assert played.give(OrderKind.STOP) == "the start is withdrawn"
    assert not played.control.next_asked


def test_a_reset_holds_one_run_only(running: Played) -> None:
    running.give(OrderKind.RESET)
    running.control.next_run()
    assert running.control.holds
    running.give(OrderKind.START)
    running.begin()
    running.control.end("time")
    running.control.next_run()
    assert not running.control.holds


def test_an_emergency_just_before_the_start_is_left_by_a_reset(played: Played) -> None:
    played.give(OrderKind.EMERGENCY)
    assert not played.begin()
    assert played.give(OrderKind.RESET) == "reset: run 2 waits for a start"
    assert played.control.next_asked


def test_a_slow_disk_holds_up_no_emergency_stop(played: Played) -> None:
    def slow(on: bool) -> str:
        thread = threading.Thread(target=played.give, args=(OrderKind.EMERGENCY,))
        thread.start()
        thread.join(20)
        assert not thread.is_alive()
        return "recording"

    played.control.record = slow
    played.give(OrderKind.RECORD, value=1)
    assert played.commands == [Wanted.STOP]
