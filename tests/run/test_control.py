"""What people order, and the states that follow."""

from __future__ import annotations

import threading
from typing import Any

import pytest

from vsense.robots.link.wire import Wanted
from vsense.run.control import (
    ROBOT_RULES,
    SIMULATION_RULES,
    TRACKING_RULES,
    Control,
    OrderRules,
    State,
)
from vsense.run.orders import Order, OrderError, OrderKind


class Played:
    """A control, what it told the robots, and what it told people."""

    def __init__(self, **options: Any) -> None:
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


SITUATIONS: dict[str, tuple[str, State, bool, bool]] = {
    # how to get there, then state, whether a start and whether the next run is asked for
    "waiting": ("", State.WAITING, False, False),
    "waiting, asked": ("start", State.WAITING, True, False),
    "ready": ("ready", State.READY, False, False),
    "ready, asked": ("ready start", State.READY, True, False),
    "running": ("begin", State.RUNNING, False, False),
    "paused": ("begin pause", State.PAUSED, False, False),
    "paused, asked": ("begin pause start", State.PAUSED, True, False),
    "ended": ("begin end", State.ENDED, False, False),
    "ended, asked": ("begin end start", State.ENDED, False, True),
    "reset": ("begin reset", State.ENDED, False, True),
    "homing": ("home", State.HOMING, False, False),
    "resting": ("home pause", State.HOMING_PAUSED, False, False),
    "resting, asked": ("home pause start", State.HOMING_PAUSED, True, False),
    "emergency": ("begin emergency", State.EMERGENCY, False, False),
    "early emergency": ("emergency", State.EMERGENCY, False, False),
}

HALTED = "EMERGENCY STOP: all robots must stand until a reset"

WALK = """
waiting         | start     | waiting, asked  | -     | run 1 starts
waiting         | pause     | refused         | -     | cannot pause: run 1 is not running
waiting         | stop      | refused         | -     | cannot stop: run 1 is not running
waiting         | reset     | refused         | -     | cannot reset: run 1 is not running
waiting         | emergency | early emergency | STOP  | HALTED
waiting, asked  | start     | refused         | -     | Ann has asked for it already
waiting, asked  | pause     | refused         | -     | cannot pause: run 1 is not running
waiting, asked  | stop      | waiting         | -     | the start is withdrawn
waiting, asked  | reset     | refused         | -     | cannot reset: run 1 is not running
waiting, asked  | emergency | early emergency | STOP  | HALTED
ready           | start     | ready, asked    | -     | run 1 starts
ready           | pause     | refused         | -     | cannot pause: run 1 is not running
ready           | stop      | refused         | -     | cannot stop: run 1 is not running
ready           | reset     | refused         | -     | cannot reset: run 1 is not running
ready           | emergency | early emergency | STOP  | HALTED
ready, asked    | start     | refused         | -     | Ann has asked for it already
ready, asked    | pause     | refused         | -     | cannot pause: run 1 is not running
ready, asked    | stop      | ready           | -     | the start is withdrawn
ready, asked    | reset     | refused         | -     | cannot reset: run 1 is not running
ready, asked    | emergency | early emergency | STOP  | HALTED
running         | start     | refused         | -     | run 1 is going on already
running         | pause     | paused          | PAUSE | run 1 is paused
running         | stop      | ended           | STOP  | run 1 is stopped
running         | reset     | reset           | STOP  | reset: run 2 waits for a start
running         | emergency | emergency       | STOP  | HALTED
paused          | start     | paused, asked   | -     | run 1 goes on
paused          | pause     | refused         | -     | cannot pause: run 1 is paused
paused          | stop      | ended           | STOP  | run 1 is stopped
paused          | reset     | reset           | STOP  | reset: run 2 waits for a start
paused          | emergency | emergency       | STOP  | HALTED
paused, asked   | start     | refused         | -     | Ann has asked for it already
paused, asked   | pause     | paused          | -     | run 1 stays paused
paused, asked   | stop      | ended           | STOP  | run 1 is stopped
paused, asked   | reset     | reset           | STOP  | reset: run 2 waits for a start
paused, asked   | emergency | emergency       | STOP  | HALTED
ended           | start     | ended, asked    | -     | run 2 begins
ended           | pause     | refused         | -     | cannot pause: run 1 is ended
ended           | stop      | refused         | -     | cannot stop: run 1 is ended
ended           | reset     | reset           | -     | reset: run 2 waits for a start
ended           | emergency | emergency       | STOP  | HALTED
ended, asked    | start     | refused         | -     | Ann has asked for it already
ended, asked    | pause     | refused         | -     | cannot pause: run 1 is ended
ended, asked    | stop      | ended           | -     | the start is withdrawn
ended, asked    | reset     | reset           | -     | reset: run 2 waits for a start
ended, asked    | emergency | emergency       | STOP  | HALTED
reset           | start     | ended, asked    | -     | run 2 begins
reset           | pause     | refused         | -     | cannot pause: run 1 is ended
reset           | stop      | refused         | -     | cannot stop: run 1 is ended
reset           | reset     | reset           | -     | reset: run 2 waits for a start
reset           | emergency | emergency       | STOP  | HALTED
homing          | start     | refused         | -     | run 1 is going on already
homing          | pause     | resting         | PAUSE | the robots rest on their way home
homing          | stop      | ended           | STOP  | run 1 is stopped on the way home
homing          | reset     | reset           | STOP  | reset: run 2 waits for a start
homing          | emergency | early emergency | STOP  | HALTED
resting         | start     | resting, asked  | -     | the robots drive on to their starts
resting         | pause     | refused         | -     | cannot pause: run 1 is homing paused
resting         | stop      | ended           | STOP  | run 1 is stopped on the way home
resting         | reset     | reset           | STOP  | reset: run 2 waits for a start
resting         | emergency | early emergency | STOP  | HALTED
resting, asked  | start     | refused         | -     | Ann has asked for it already
resting, asked  | pause     | resting         | -     | the robots go on resting
resting, asked  | stop      | ended           | STOP  | run 1 is stopped on the way home
resting, asked  | reset     | reset           | STOP  | reset: run 2 waits for a start
resting, asked  | emergency | early emergency | STOP  | HALTED
emergency       | start     | refused         | -     | after an emergency stop: reset first
emergency       | pause     | refused         | -     | cannot pause: run 1 is emergency
emergency       | stop      | refused         | -     | cannot stop: run 1 is emergency
emergency       | reset     | reset           | -     | reset: run 2 waits for a start
emergency       | emergency | emergency       | STOP  | HALTED
early emergency | start     | refused         | -     | after an emergency stop: reset first
early emergency | pause     | refused         | -     | cannot pause: run 1 is emergency
early emergency | stop      | refused         | -     | cannot stop: run 1 is emergency
early emergency | reset     | waiting         | -     | reset: run 1 waits for a start
early emergency | emergency | early emergency | STOP  | HALTED
"""
ROWS = [tuple(cell.strip() for cell in row.split("|")) for row in WALK.strip().splitlines()]

SUSPENDED = "run 1 is suspended: start resumes it, reset ends it"


def reach(situation: str, **options: Any) -> Played:
    """A run in a situation, in which nobody has said anything yet."""
    played = Played(**options)
    steps = {
        "begin": played.begin,
        "home": lambda: played.control.home(lambda: None),
        "ready": played.control.ready,
        "end": lambda: played.control.end("time"),
    }
    for step in SITUATIONS[situation][0].split():
        steps[step]() if step in steps else played.give(OrderKind(step))
    played.commands.clear()
    played.said.clear()
    assert_in(played, situation, *([OrderKind.RECORD] if "record" in options else []))
    return played


def assert_in(played: Played, situation: str, *more: OrderKind) -> None:
    control = played.control
    assert (control.state, control.asked, control.next_asked) == SITUATIONS[situation][1:]
    offered = {OrderKind(row[1]) for row in ROWS if row[0] == situation and row[2] != "refused"}
    assert played.can == {*offered, *more}


def test_the_walk_meets_every_order_in_every_situation() -> None:
    kinds = ("start", "pause", "stop", "reset", "emergency")
    assert [row[:2] for row in ROWS] == [(each, kind) for each in SITUATIONS for kind in kinds]
    assert {found[1] for found in SITUATIONS.values()} == set(State)


@pytest.mark.parametrize(
    ("situation", "kind", "then", "command", "text"), ROWS, ids=[f"{r[0]}: {r[1]}" for r in ROWS]
)
def test_what_every_order_does(
    situation: str, kind: str, then: str, command: str, text: str
) -> None:
    played, said = reach(situation), HALTED if text == "HALTED" else text
    if then == "refused":
        before = played.control.by
        with pytest.raises(OrderError) as refused:
            played.give(OrderKind(kind), "Bob")
        assert str(refused.value) == said
        assert_in(played, situation)
        assert (played.said, played.commands, played.control.by) == ([], [], before)
        return
    assert played.give(OrderKind(kind), "Bob") == said
    assert_in(played, then)
    assert (played.said, played.control.by) == ([f"Bob: {said}"], "Bob")
    assert played.commands == ([] if command == "-" else [Wanted[command]])


@pytest.mark.parametrize("situation", ["running", "paused", "paused, asked"])
def test_where_stop_suspends_a_start_resumes(situation: str) -> None:
    played = reach(situation, suspends=True)
    assert played.give(OrderKind.STOP) == SUSPENDED
    assert played.commands == [Wanted.STOP]
    assert_in(played, "paused")


@pytest.mark.parametrize("situation", SITUATIONS)
def test_in_every_situation_a_recording_can_be_switched_and_no_replay_steered(
    situation: str,
) -> None:
    played = reach(situation, record=lambda on: f"recording {on}")
    for kind in (OrderKind.PLAY, OrderKind.SPEED, OrderKind.SEEK):
        with pytest.raises(OrderError, match="replay"):
            played.give(kind)
    assert played.give(OrderKind.RECORD, value=1) == "recording True"
    assert OrderKind.RECORD in played.can
    assert_in(played, situation, OrderKind.RECORD)


def test_a_run_that_is_waited_for_can_be_started_early(played: Played) -> None:
    assert played.control.state == State.WAITING and not played.control.asked
    assert played.give(OrderKind.START) == "run 1 starts"
    assert played.control.asked and played.begin()
    assert played.control.state == State.RUNNING and not played.control.asked
    assert played.said == ["Ann: run 1 starts"] and played.control.by == "Ann"


def test_of_two_people_who_press_start_the_second_is_told(played: Played) -> None:
    played.give(OrderKind.START)
    with pytest.raises(OrderError, match=r"Ann .*asked"):
        played.give(OrderKind.START, "Bob")
    assert played.control.by == "Ann"
    played.begin()
    with pytest.raises(OrderError, match=r"run 1 .*going"):
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


def test_no_new_run_ends_an_emergency(running: Played) -> None:
    running.give(OrderKind.EMERGENCY)
    assert running.control.why == "emergency stop by Ann"
    assert not running.begin() and running.starts == 1
    running.control.next_run()
    assert running.control.state == State.EMERGENCY


def test_a_run_that_suspends_is_resumed_where_it_was() -> None:
    played = Played(suspends=True)
    played.begin()
    assert "suspended" in played.give(OrderKind.STOP)
    assert played.commands == [Wanted.STOP] and played.control.state == State.PAUSED
    played.give(OrderKind.START)
    assert played.begin() and played.control.run == 1
    played.give(OrderKind.RESET)
    assert played.control.state == State.ENDED


@pytest.mark.parametrize("rules", [ROBOT_RULES, TRACKING_RULES, SIMULATION_RULES])
def test_every_kind_of_process_knows_what_to_do_with_every_order(rules: OrderRules) -> None:
    known = {*rules.refused, *rules.kinds, *rules.valued}
    assert known == set(OrderKind) and not rules.refused.keys() & rules.valued.keys()
    assert {len(moves) for moves in rules.table.values()} == {len(rules.kinds)}


@pytest.mark.parametrize("kind", list(OrderKind))
def test_a_tracker_obeys_as_a_run_does_but_stops_no_robot(kind: OrderKind) -> None:
    run, tracker = Played(), Played(rules=TRACKING_RULES)
    answers = []
    for played in (run, tracker):
        played.begin()
        try:
            answers.append(played.give(kind))
        except OrderError as error:
            answers.append(str(error))
    assert (answers[0] == answers[1]) == (kind is not OrderKind.EMERGENCY)
    assert run.can - tracker.can <= {OrderKind.EMERGENCY}


def test_recording_is_switched_where_there_is_something_to_switch(played: Played) -> None:
    assert OrderKind.RECORD not in played.can
    with pytest.raises(OrderError, match="recorded"):
        played.give(OrderKind.RECORD, value=1)
    played = Played(record=lambda on: f"recording {on}")
    assert OrderKind.RECORD in played.can
    assert played.give(OrderKind.RECORD, value=1) == "recording True"


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


def test_a_slow_disk_holds_up_no_emergency_stop() -> None:
    def slow(on: bool) -> str:
        thread = threading.Thread(target=played.give, args=(OrderKind.EMERGENCY,))
        thread.start()
        thread.join(20)
        assert not thread.is_alive()
        return "recording"

    played = Played(record=slow)
    played.give(OrderKind.RECORD, value=1)
    assert played.commands == [Wanted.STOP]


def test_on_the_way_home_pause_stop_and_emergency_work(played: Played) -> None:
    control = played.control

    def drive() -> None:
        played.commands.append(Wanted.HOME)

    assert control.home(drive) and control.state is State.HOMING
    played.give(OrderKind.PAUSE)
    assert (control.state, played.commands[-1]) == (State.HOMING_PAUSED, Wanted.PAUSE)
    assert not control.asked and not control.arrive(lambda: None)
    played.give(OrderKind.START)
    # The run's own thread has them drive on.
    assert control.asked and played.commands[-1] is Wanted.PAUSE
    assert control.home(drive) and not control.asked
    assert played.begin() and control.state is State.RUNNING


@pytest.mark.parametrize(
    ("kind", "state"),
    [
        (OrderKind.STOP, State.ENDED),
        (OrderKind.RESET, State.ENDED),
        (OrderKind.EMERGENCY, State.EMERGENCY),
    ],
)
@pytest.mark.parametrize("paused", [False, True])
def test_what_ends_the_way_home_starts_no_run(
    played: Played, kind: OrderKind, state: State, paused: bool
) -> None:
    control = played.control
    control.home(lambda: None)
    if paused:
        played.give(OrderKind.PAUSE)
    played.give(kind)
    assert (control.state, played.commands[-1]) == (state, Wanted.STOP)
    assert not control.home(lambda: None) and not control.arrive(lambda: None)
    assert not played.begin() and played.starts == 0
