"""Waiting, starting, living and stopping, on a played stage."""

from __future__ import annotations

import weakref

import pytest

from tests.run.stage import DT_NS, MS, S, Stage, experiment
from vsense.base.errors import NoMorePictures, VsenseError
from vsense.robots.link.status import RobotStatus
from vsense.robots.link.trackers.client import TrackerEnded
from vsense.robots.link.wire import Telemetry, Wanted
from vsense.run import runner
from vsense.run.control import State
from vsense.run.homing._homing import Homing
from vsense.run.homing.floor import DrivingFloor
from vsense.run.orders import Order, OrderKind
from vsense.run.runtime import Step


@pytest.fixture
def stage() -> Stage:
    """Everybody is there, and nothing has failed yet."""
    made = Stage(experiment())
    made.connected = made.seen = made.tags
    return made


def failing(error: Exception) -> object:
    def fail() -> None:
        raise error

    return fail


def test_it_waits_until_the_last_one_is_connected_and_seen() -> None:
    stage = Stage(experiment())
    first, second = (robot.tag for robot in stage.experiment.robots)
    stage.acts = {
        2: lambda: stage.connected.update({first}),
        3: lambda: stage.seen.update(stage.tags),
        4: lambda: stage.connected.update({second}),
    }
    assert stage.runner.wait().complete
    assert stage.calls == 4 and stage.done == []
    assert f"waiting: 0 of 2 robots connected (not {first}, {second}), 0 of 3" in (
        stage.terminal.getvalue()
    )


def test_without_any_arena_state_it_says_so_and_keeps_waiting(stage: Stage) -> None:
    stage.silent = True
    stage.acts = {40: lambda: setattr(stage, "silent", False)}
    assert stage.runner.wait().complete
    assert "no arena state yet" in stage.terminal.getvalue()
    assert "stand still" not in stage.terminal.getvalue()
    assert stage.runner.silences == []


def test_a_timestep_takes_one_snapshot_of_the_robots(stage: Stage) -> None:
    stage.seen = set()
    stage.acts = {4: lambda: stage.seen.update(stage.tags)}
    assert stage.runner.wait().complete
    assert stage.snapshots == stage.checks == stage.calls == 4
    assert stage.runner.robots.keys() == {robot.tag for robot in stage.experiment.robots}


def test_a_limit_ends_the_wait_with_the_names(stage: Stage) -> None:
    stage.connected = set()
    found = stage.runner.wait(1.0)
    assert found.absent == tuple(robot.id for robot in stage.experiment.robots)
    assert stage.now_ns - 1000 * S == pytest.approx(1.1 * S)


def test_an_interruption_ends_the_wait(stage: Stage) -> None:
    stage.connected = set()
    stage.acts = {3: stage.interrupted.set}
    assert not stage.runner.wait().complete
    assert stage.calls == 3


def test_a_run_has_its_timesteps_and_ends(stage: Stage) -> None:
    stage.runner.wait()
    lived = [step.run_timestep for step in stage.runner.timesteps()]
    assert lived == [0, 1, 2, 3, 4]
    assert stage.runner.ended == "time" and stage.done == ["start"]
    stage.runner.stop()
    assert stage.done == ["start", "stop", "silence"]
    assert (stage.runner.counters.sent, stage.runner.counters.received) == (20, 20)


@pytest.mark.parametrize("how", ["time", "interrupted", "emergency"])
def test_robots_act_on_the_last_readings_unless_they_shall_stop_at_once(
    stage: Stage, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    waits_s: list[float] = []

    def at_once(length_s: float) -> float:
        waits_s.append(length_s)
        return 0.0

    monkeypatch.setattr(runner, "real_s", at_once)
    stage.runner.wait()
    if how == "interrupted":
        stage.interrupted.set()
    elif how == "emergency":
        stage.runner.control.give(Order(OrderKind.EMERGENCY, "Ada"))
    assert len(list(stage.runner.timesteps())) == (5 if how == "time" else 0)
    stage.runner.stop()
    assert waits_s == ([0.1] if how == "time" else [])


def test_without_a_length_it_goes_on_until_it_is_interrupted() -> None:
    stage = Stage(experiment(timesteps=0))
    stage.acts = {1000: stage.interrupted.set}
    lived = [step.run_timestep for step in stage.runner.timesteps()]
    assert lived == list(range(998)) and stage.runner.ended == "interrupted"


def test_a_silence_is_told_and_survived(stage: Stage) -> None:
    stage.experiment = experiment(timesteps=60)
    stage = Stage(stage.experiment, connected=stage.connected, seen=stage.seen)
    stage.acts = {
        6: lambda: setattr(stage, "silent", True),
        16: lambda: setattr(stage, "silent", False),
    }
    lived = [step.run_timestep for step in stage.runner.timesteps()]
    (silence,) = stage.runner.silences
    assert silence.duration_s == pytest.approx(2.6, abs=0.01)
    assert lived[:4] == [0, 1, 2, 28], "the run's time goes on meanwhile"
    assert silence.run_timestep == 2 and lived[-1] == 59 and stage.runner.ended == "time"
    said = stage.terminal.getvalue()
    assert said.count("the robots stand still until there is one") == 1
    assert "arena states are back after 2.6 s" in said


def test_a_silence_to_the_end_ends_with_the_runs_time(stage: Stage) -> None:
    stage = Stage(experiment(timesteps=20), connected=stage.connected, seen=stage.seen)
    stage.acts = {8: lambda: setattr(stage, "silent", True)}
    begun_ns = stage.now_ns
    lived = [step.run_timestep for step in stage.runner.timesteps()]
    assert lived == [0, 1, 2, 3, 4] and stage.runner.ended == "time"
    assert 20 * DT_NS <= stage.now_ns - begun_ns <= 20 * DT_NS + 500 * MS
    stage.runner.stop()
    assert len(stage.runner.silences) == 1
    assert "are back" not in stage.terminal.getvalue()


@pytest.mark.parametrize(
    "end", [NoMorePictures("the recording ends"), TrackerEnded("it has ended")]
)
def test_an_end_of_the_source_is_no_failure(stage: Stage, end: VsenseError) -> None:
    stage.acts = {6: failing(end)}  # type: ignore[dict-item]
    assert [step.run_timestep for step in stage.runner.timesteps()] == [0, 1, 2]
    assert stage.runner.ended == str(end)


def test_a_failure_gets_through(stage: Stage) -> None:
    stage.acts = {6: failing(VsenseError("loop.py:3: no"))}  # type: ignore[dict-item]
    with pytest.raises(VsenseError, match=r"loop\.py:3"):
        list(stage.runner.timesteps())


def test_new_sessions_and_guards_in_mid_run_are_counted(stage: Stage) -> None:
    tag = stage.experiment.robots[0].tag
    told = Telemetry(received=10, guard_restarts=1)
    stage.acts = {5: lambda: stage.statuses.update({tag: {"sessions": 3, "telemetry": told}})}
    for _ in stage.runner.timesteps():
        pass
    stage.runner.stop()
    assert stage.runner.reconnects == 2
    assert stage.terminal.getvalue().count("its guard was replaced") == 1


def test_a_start_waits_for_somebody_to_start(stage: Stage) -> None:
    stage.connected = set()
    give = stage.runner.control.give
    stage.acts = {
        2: lambda: give(Order(OrderKind.START, "Ann")),
        6: lambda: setattr(stage, "connected", {min(stage.tags)}),
    }
    found = stage.runner.wait()
    assert stage.calls == 6 and len(found.absent) == 1, "and for no more than one"


def test_while_links_are_measured_a_run_waits_and_a_start_ends_that(stage: Stage) -> None:
    words = iter(["1 of 2 s", "2 of 2 s", ""])
    assert stage.runner.wait(busy=lambda: next(words)).complete
    assert stage.calls == 3 and "1 of 2 s" in stage.terminal.getvalue() and not list(words)
    give = stage.runner.control.give
    stage.acts = {6: lambda: give(Order(OrderKind.START, "Ann"))}
    stage.runner.wait(busy=lambda: "for ever")
    assert stage.calls == 6


def test_a_moment_without_an_arena_state_makes_nobody_disappear(stage: Stage) -> None:
    stage.acts = {
        1: lambda: setattr(stage, "connected", set()),
        3: lambda: setattr(stage, "silent", True),
        4: lambda: setattr(stage, "connected", stage.tags),
    }
    assert stage.runner.wait().complete and stage.calls == 4


def test_a_paused_run_lives_no_timestep_and_goes_on(stage: Stage) -> None:
    give = stage.runner.control.give
    stage.acts = {
        6: lambda: give(Order(OrderKind.PAUSE, "Ann")),
        12: lambda: give(Order(OrderKind.START, "Ann")),
    }
    stage.runner.wait()
    lived = [step.run_timestep for step in stage.runner.timesteps()]
    assert stage.done == ["start", "PAUSE", "hold", "resume"]
    assert lived[:3] == [0, 1, 2] and lived[-1] == 4 and stage.runner.ended == "time"


def test_after_a_run_it_rests_until_somebody_wants_the_next(stage: Stage) -> None:
    stage.runner.wait()
    assert len(list(stage.runner.timesteps())) == 5
    stage.runner.stop()
    calls = stage.calls
    stage.acts = {calls + 3: lambda: stage.runner.control.give(Order(OrderKind.START, "Ann"))}
    assert stage.runner.rest() and stage.calls == calls + 3
    stage.runner.next_run(None)  # type: ignore[arg-type]
    assert (stage.runner.control.run, stage.runner.control.asked) == (2, True)
    assert (stage.runner.counters.sent, stage.runner.silences) == (0, [])


def test_a_pause_keeps_nothing_of_the_timestep_before_it(stage: Stage) -> None:
    stage.runner.wait()
    give, kept, newest = stage.runner.control.give, list[bool](), list[weakref.ref[object]]()
    for step in stage.runner.timesteps():
        if not newest:
            newest.append(weakref.ref(step.state.robots))
            give(Order(OrderKind.PAUSE, "test"))
            stage.acts = {
                stage.calls + 1: lambda: kept.append(newest[0]() is not None),
                stage.calls + 2: lambda: give(Order(OrderKind.START, "test")),
            }
        del step
    assert kept == [False] and stage.runner.ended == "time"


def test_a_robot_that_goes_on_after_stop_is_said_before_the_run_is_over(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    tag = min(robot.tag for robot in stage.experiment.robots)
    begun_ns = stage.now_ns
    stage.statuses[tag] = {
        "telemetry": Telemetry(state=Wanted.RUN, received=10),
        "wanted": Wanted.STOP,
        "ordered_ns": begun_ns,
        "heard_ns": begun_ns + 400 * MS,
    }
    snapshot = stage.robots

    def robots() -> dict[int, RobotStatus]:
        stage.now_ns += 50 * MS
        return snapshot()

    monkeypatch.setattr(stage, "robots", robots)
    stage.interrupted.set()
    stage.runner.stop()
    assert "does NOT stop: LIFT IT (told to stop 0.20 s ago, it reports that it runs)" in (
        stage.terminal.getvalue()
    )
    assert stage.done == ["stop", "silence"]


def test_a_robot_that_says_nothing_after_an_emergency_stop_is_seen_moving(stage: Stage) -> None:
    """Its board hangs: nothing that it has reported is newer than the order."""
    hung, other = sorted(robot.tag for robot in stage.experiment.robots)
    stage.seen, stage.connected = {hung, other}, {hung, other}
    runs, stands = (Telemetry(state=w, received=10) for w in (Wanted.RUN, Wanted.STOP))
    stage.statuses[hung] = {"telemetry": runs, "wanted": Wanted.RUN}
    stage.statuses[other] = {"telemetry": runs, "wanted": Wanted.RUN}
    stage.runner.wait(0.0)
    ordered_ns, step = stage.now_ns, stage.step
    told = {"wanted": Wanted.STOP, "ordered_ns": ordered_ns}
    stage.statuses[hung] |= told | {"heard_ns": ordered_ns - 10 * MS}
    stage.statuses[other] = told | {"telemetry": stands, "heard_ns": ordered_ns + 60 * MS}

    def drives(timeout_s: float) -> Step:
        made = step(timeout_s)
        rows = made.state.robots
        rows["capture_ns"] = made.state.capture_ns
        rows["x_m"][rows["tag"] == hung] = 0.12 * (stage.now_ns - ordered_ns) / 1e9
        return made

    stage.step = drives  # type: ignore[method-assign]
    stage.runner.control.give(Order(OrderKind.EMERGENCY, "test"))
    stage.runner.stop()
    lines = [line for line in stage.terminal.getvalue().splitlines() if "LIFT IT" in line]
    assert len(lines) == 1 and lines[0].startswith(f"ROBOT {hung} does NOT stop: LIFT IT")
    assert lines[0].endswith("(told to stop 0.30 s ago, the cameras see it move)")
    # Pages hear of the alarm at once, and see it move, though the run's loop has ended.
    shown = [[alarm.text for alarm in alarms] for silent, alarms in stage.observed if not silent]
    # One state is of before the stop, six follow it within the 0.6 s that robots are watched.
    assert shown == 3 * [[]] + 4 * [[f"robot {hung} does NOT stop: lift it"]]


def test_the_arena_is_shown_while_last_reports_are_waited_for(stage: Stage) -> None:
    """A robot that hung says nothing more; its host is silent for less than the second after which
    the others would say that no UDP comes through."""
    stage.connected = stage.seen = stage.tags
    hung, other = sorted(robot.tag for robot in stage.experiment.robots)
    stands = {"telemetry": Telemetry(state=Wanted.STOP, received=10), "heard_ns": 1}
    stage.statuses = {hung: {**stands, "sent": 11}, other: stands}
    begun_ns = stage.now_ns
    stage.runner.stop()
    assert [silent for silent, _ in stage.observed] == 6 * [False]
    assert stage.now_ns - begun_ns == 0.6 * S


def test_a_pause_when_the_last_robot_arrives_does_not_lose_the_run(stage: Stage) -> None:
    homing = Homing({}, {}, {}, DrivingFloor.of(stage.experiment, False))
    control = stage.runner.control

    def arrive_paused() -> None:
        homing.done = True
        control.give(Order(OrderKind.PAUSE, "Ada"))

    def go_on() -> None:
        assert control.state is State.HOMING_PAUSED and stage.done == ["HOME", "PAUSE"]
        control.home(lambda: stage.done.append("HOME"))

    stage.acts = {2: arrive_paused, 5: go_on}
    stage.runner.home(homing)
    assert stage.calls == 5 and stage.done == ["HOME", "PAUSE", "HOME", "IDLE"]
    assert [step.run_timestep for step in stage.runner.timesteps()] == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("kind", [OrderKind.EMERGENCY, OrderKind.STOP, None])
def test_what_ends_the_way_home_lets_no_robot_drive_again(
    stage: Stage, kind: OrderKind | None
) -> None:
    homing = Homing({}, {}, {}, DrivingFloor.of(stage.experiment, False))
    control = stage.runner.control
    give = stage.interrupted.set if kind is None else lambda: control.give(Order(kind, "Ada"))
    stage.acts = {3: give}
    stage.runner.home(homing)
    assert stage.calls == 3 and stage.done == ["HOME", "IDLE" if kind is None else "STOP"]
    assert list(stage.runner.timesteps()) == [] and "start" not in stage.done


def test_a_tracker_that_ends_on_the_way_home_has_the_robots_stand(stage: Stage) -> None:
    homing = Homing({}, {}, {}, DrivingFloor.of(stage.experiment, False))
    stage.acts = {3: failing(TrackerEnded("the tracker has ended"))}  # type: ignore[dict-item]
    with pytest.raises(VsenseError, match="has ended"):
        stage.runner.home(homing)
    assert stage.done == ["HOME", "IDLE"]
