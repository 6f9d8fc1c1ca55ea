"""The virtual sensor server with real sockets: what robots and the runtime get from it."""

from __future__ import annotations

import threading
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from tests.robots.link.rig import MS, TABLE, Frozen, MakeRobot, S, Server, reading, works
from tests.wire.robot_session import Event
from vsense.base.native import WireError
from vsense.robots.link.keys import INSECURE
from vsense.robots.link.server import VirtualSensorServer
from vsense.robots.link.status import LinkError
from vsense.robots.link.table import ExpectedRobot
from vsense.robots.link.wire import GoodbyeCause, StopCause, Telemetry, Wanted


def test_a_robot_joins_and_is_told_everything(server: Server, robot: MakeRobot) -> None:
    one = robot(server).join()
    assert one.session.table == TABLE
    assert one.session.params == "speed_cm_s=10\n"
    assert one.session.c.timestep_ns == 100 * MS
    event = server.wait("connected", 1)
    assert event.text == "robot 1: connected from 127.0.0.1, controller test"
    status = server.server.robots()[1]
    assert (status.name, status.controller, status.uid) == ("epuck_1", "test", b"\1" * 16)
    assert (status.version, status.hash) == ("9.9", "abc")
    assert status.connected and status.udp and status.sessions == 1
    assert not server.server.robots()[2].connected


def test_every_robot_has_a_seed_of_its_own_and_the_same_each_time(
    server: Server, robot: MakeRobot, clock: Callable[[], int]
) -> None:
    seeds = [robot(server, tag).join().session.c.seed for tag in (1, 2)]
    again = Server(clock, seed=1)
    try:
        assert [robot(again, tag).join().session.c.seed for tag in (1, 2)] == seeds
        assert len(set(seeds)) == 2
    finally:
        again.close()


def test_each_run_carries_its_own_seed_to_the_robots(
    server: Server, robot: MakeRobot, clock: Callable[[], int]
) -> None:
    one = robot(server).join()
    first = one.session.c.seed
    server.server.new_run(1)
    assert server.server.robots()[1].connected, "the same seed: nothing is renewed"
    server.server.new_run(2)
    assert not server.server.robots()[1].connected, "it has not the run's seed yet"
    one.event(Event.GOODBYE)
    assert one.session.notice.code == GoodbyeCause.RENEW
    again = Server(clock, seed=2)
    try:
        expected = robot(again).join().session.c.seed
    finally:
        again.close()
    assert first != one.join().session.c.seed == expected
    one.until(lambda: server.server.robots()[1].connected)
    assert server.kinds(1) == ["connected"], "nobody is told of what was asked for"


def test_a_host_that_died_leaves_no_run_to_its_successor(
    robot: MakeRobot, clock: Callable[[], int]
) -> None:
    runs = []
    for born_s in (1.8e9, 1.8e9 + 30.0):
        host = Server(clock, born_s=born_s)
        try:
            one = robot(host).join()
            host.server.publish(1, clock(), {1: reading(1.0, clock())})
            one.timestep(1)
            runs.append(one.session.c.run)
            assert host.server.new_run(1) == runs[-1] + 1
        finally:
            host.close()
    assert runs[1] > runs[0] + 1


def test_defect_13_readings_leave_in_the_timestep_in_which_they_were_made(
    still: Server, robot: MakeRobot
) -> None:
    """The datagram is on its way before `publish` returns, sent by the caller's own thread."""
    one, two = robot(still, 1).join(), robot(still, 2).join()
    start_ns = still.clock()
    values = {1: reading(1.0, start_ns - 30 * MS), 2: reading(0.0, start_ns - 30 * MS)}
    sent_ns = still.server.publish(41, start_ns - 30 * MS, values)
    assert sent_ns == start_ns
    for it, value in ((one, 1.0), (two, 0.0)):
        it.timestep(41)
        assert it.value() == value
        assert it.session.c.capture_ns == start_ns - 30 * MS


def test_defect_14_unchanged_readings_are_sent_all_the_same(
    server: Server, robot: MakeRobot
) -> None:
    one = robot(server).join()
    for timestep in range(1, 6):
        server.server.publish(timestep, server.clock(), {1: reading(1.0, 5)})
        one.timestep(timestep)
        assert one.value() == 1.0


def test_state_is_repeated_every_50_ms_without_a_timestep(
    still: Server, frozen: Frozen, robot: MakeRobot
) -> None:
    one = robot(still).join()
    still.server.publish(7, frozen() - 30 * MS, {1: reading(1.0, frozen() - 30 * MS)})
    one.timestep(7)
    for _ in range(3):
        sequence = one.session.c.peer.rx_sequence
        frozen.advance(50 * MS)
        one.until(lambda sequence=sequence: one.session.c.peer.rx_sequence > sequence)
        assert (one.session.c.peer.rx_sequence, one.session.c.timestep) == (sequence + 1, 7)


def test_stop_leaves_at_once_and_three_times(
    still: Server, frozen: Frozen, robot: MakeRobot
) -> None:
    one = robot(still).join()
    for _ in range(3):
        sequence = one.session.c.peer.rx_sequence
        if one.session.c.wanted != Wanted.STOP:
            still.server.command(Wanted.STOP)
        else:
            frozen.advance(10 * MS)
        one.until(lambda sequence=sequence: one.session.c.peer.rx_sequence > sequence)
        assert one.session.c.wanted == Wanted.STOP
        assert one.session.c.peer.rx_sequence == sequence + 1


def test_start_names_a_timestep_and_leaves_at_once(still: Server, robot: MakeRobot) -> None:
    both = [robot(still, tag).join() for tag in (1, 2)]
    still.server.command(Wanted.RUN, 120)
    for one in both:
        one.until(lambda one=one: one.session.c.wanted == Wanted.RUN)
        assert one.session.c.from_timestep == 120


def test_a_new_run_leaves_at_once_with_nothing_measured(still: Server, robot: MakeRobot) -> None:
    one = robot(still).join()
    still.server.publish(1, still.clock(), {1: reading(1.0, still.clock())})
    still.server.command(Wanted.RUN)
    run = still.server.new_run(1)
    one.until(lambda: one.session.c.run == run)
    assert one.session.c.wanted == Wanted.IDLE
    assert one.session.value("pollutant") is None


def test_telemetry_comes_up_as_it_is(server: Server, robot: MakeRobot) -> None:
    one = robot(server).join()
    said = Telemetry(
        state=Wanted.RUN,
        stop_cause=StopCause.STALE,
        control_step=77,
        left_steps_s=-300,
        leds=0x1FF,
        battery_mv=3700,
        payload=b"\4\0\0\0",
    )
    one.say(said)
    one.until(lambda: step_of(server) == 77)
    newest = server.server.robots()[1].telemetry
    assert newest is not None
    assert (newest.left_steps_s, newest.leds, newest.payload) == (-300, 0x1FF, b"\4\0\0\0")
    assert (newest.state, newest.stop_cause) == (Wanted.RUN, StopCause.STALE)


def step_of(server: Server) -> int:
    telemetry = server.server.robots()[1].telemetry
    return telemetry.control_step if telemetry is not None else -1


def test_defect_03_a_robot_that_reconnects_in_mid_run_has_its_data_at_once(
    still: Server, robot: MakeRobot
) -> None:
    """Time stands still: nothing comes but what the reconnection itself causes."""
    one = robot(still).join()
    still.server.command(Wanted.RUN, 9)
    still.server.publish(9, still.clock(), {1: reading(1.0, still.clock())})
    one.timestep(9)
    one.tcp.close()
    still.wait("lost", 1)
    one.connect()
    one.until(lambda: bool(one.session.c.open) and one.session.c.timestep == 9)
    assert (one.session.c.wanted, one.value()) == (Wanted.RUN, 1.0)
    one.say()
    assert still.wait("reconnected", 1).text.startswith("robot 1: reconnected from")
    assert still.server.robots()[1].sessions == 2


def test_the_same_robot_takes_its_session_over(server: Server, robot: MakeRobot) -> None:
    old = robot(server, 1).join()
    new = robot(server, 1).join()
    old.event(Event.GOODBYE)
    assert old.session.notice.code == GoodbyeCause.TAKEN_OVER
    server.wait("takeover", 1)
    server.server.publish(3, server.clock(), {})
    new.timestep(3)


def test_who_ends_a_session_that_is_over_ends_no_other(server: Server, robot: MakeRobot) -> None:
    one = robot(server, 1).join()
    links: Any = server.server._network._links
    links.dismiss(SimpleNamespace(tag=1), GoodbyeCause.END, "of an older session")
    links.dismiss(SimpleNamespace(tag=2), GoodbyeCause.END, "it has none")
    assert works(server, one, 3)


def test_another_robot_with_the_same_tag_is_refused_and_both_sides_say_so(
    still: Server, frozen: Frozen, robot: MakeRobot
) -> None:
    robot(still, 1).join()
    thief = robot(still, 1, uid=b"thief" + bytes(11)).connect()
    thief.event(Event.REFUSED)
    assert thief.session.notice.text == still.wait("refused", 1).text.split("127.0.0.1: ")[1]
    assert "tag 1 is in use by another robot" in thief.session.notice.text
    assert still.server.robots()[1].uid == b"\1" * 16
    frozen.advance(S)  # the first one was not heard for 1 s: its tag is free
    thief.open()
    assert "another robot than before" in still.wait("connected", 1, times=2).text


def test_who_says_goodbye_frees_its_tag_at_once(still: Server, robot: MakeRobot) -> None:
    one = robot(still, 1).join()
    one.tcp.sendall(one.session.goodbye(GoodbyeCause.END, "battery empty", one.now_ns()))
    assert still.wait("goodbye", 1).text == "robot 1: says goodbye: battery empty"
    robot(still, 1, uid=b"spare" + bytes(11)).join()
    assert "lost" not in still.kinds(1)


def test_defect_16_identity_is_the_tag_of_the_robot_not_its_address(
    server: Server, robot: MakeRobot
) -> None:
    """Two robots behind one address are two robots, and one that moves stays itself."""
    one, two = robot(server, 1).join(), robot(server, 2).join()
    server.server.publish(1, server.clock(), {1: reading(1.0, 5), 2: reading(0.0, 5)})
    one.timestep(1)
    two.timestep(1)
    assert (one.value(), two.value()) == (1.0, 0.0)
    one.udp, two.udp = two.udp, one.udp
    one.say()
    two.say()
    for timestep, it in ((2, one), (3, two)):
        accepted = server.server.robots()[it.session.c.config.tag].accepted
        assert accepted >= 1
        server.server.publish(timestep, server.clock(), {})
        it.until(lambda it=it, timestep=timestep: it.session.c.timestep >= timestep)


def test_the_host_says_goodbye(server: Server, robot: MakeRobot) -> None:
    one = robot(server).join()
    closing = threading.Thread(target=server.server.close, args=(GoodbyeCause.END, "good night"))
    closing.start()
    one.event(Event.GOODBYE)
    assert one.session.notice.text == "good night"
    one.close()
    closing.join()
    server.server.close()
    assert not server.server.robots()[1].connected


def test_a_silent_server_still_hears(still: Server, frozen: Frozen, robot: MakeRobot) -> None:
    """No STATE leaves, neither by publish nor as heartbeat nor to a new address."""
    one = robot(still).join()
    still.server.command(Wanted.STOP)
    one.until(lambda: one.session.c.wanted == Wanted.STOP)
    still.server.silence()
    sent = still.server.robots()[1].sent
    still.server.publish(5, frozen(), {})
    for step in range(1, 4):
        frozen.advance(100 * MS)
        one.say(Telemetry(control_step=step, payload=bytes(4)))
        one.until(lambda step=step: step_of(still) == step)
    assert still.server.robots()[1].sent == sent


def test_a_server_is_used_in_order(clock: Callable[[], int]) -> None:
    def make(params: str = "") -> VirtualSensorServer:
        return VirtualSensorServer(
            host="127.0.0.1",
            port=0,
            timestep_ns=100 * MS,
            seed=1,
            expected={1: ExpectedRobot("epuck_1", TABLE, params)},
            trust=INSECURE,
            on_event=print,
        )

    server = make()
    server.close()
    with pytest.raises(LinkError, match="has not been started"):
        server.publish(1, 1, {})
    server.start()
    with pytest.raises(LinkError, match="was started already"):
        server.start()
    server.close()
    with pytest.raises(WireError):
        make(params="x" * 4097)


def test_who_is_held_pauses_alone_and_goes_on_in_the_same_run(
    still: Server, robot: MakeRobot
) -> None:
    one, two = robot(still, 1).join(), robot(still, 2).join()
    still.server.command(Wanted.RUN, 7)
    one.until(lambda: one.session.c.wanted == Wanted.RUN)
    still.server.hold_robots({1: "outside"})
    one.until(lambda: one.session.c.wanted == Wanted.PAUSE)
    two.until(lambda: two.session.c.wanted == Wanted.RUN)
    robots = still.server.robots()
    assert [(robots[tag].held, robots[tag].wanted) for tag in (1, 2)] == [
        ("outside", Wanted.PAUSE),
        ("", Wanted.RUN),
    ]
    still.server.hold_robots({})
    one.until(lambda: one.session.c.wanted == Wanted.RUN)
    still.server.hold_robots({1: "outside"})
    still.server.command(Wanted.HOME)
    one.until(lambda: one.session.c.wanted == Wanted.PAUSE)
    two.until(lambda: two.session.c.wanted == Wanted.HOME)
    still.server.command(Wanted.STOP)
    one.until(lambda: one.session.c.wanted == Wanted.STOP)
    still.server.new_run(2)
    assert not still.server.robots()[1].held
