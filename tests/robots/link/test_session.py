"""The host's session against the robot's, over every kind of bad network, on virtual time."""

from __future__ import annotations

import struct
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.robots.link.simulation import (
    CALM,
    HOUR_NS,
    MS,
    TABLE,
    TAG,
    S,
    Simulation,
    Weather,
    weathers,
)
from tests.wire.robot_session import Event
from vsense.robots.link._peer import Orders
from vsense.robots.link._session import HEARTBEAT_NS, HostSession
from vsense.robots.link.wire import Wanted

orders = st.lists(st.tuples(st.sampled_from(Wanted), st.integers(0, 100)), max_size=5)


def told(simulation: Simulation) -> list[str]:
    return [event.kind for event in simulation.events]


@settings(max_examples=100)
@given(
    seed=st.integers(0, 2**32 - 1),
    weather=weathers,
    orders=orders,
    offset_ns=st.integers(-HOUR_NS, HOUR_NS),
)
def test_any_network_that_heals_leaves_both_ends_right(
    seed: int, weather: Weather, orders: list[tuple[Wanted, int]], offset_ns: int
) -> None:
    """Level-triggered orders converge, nothing older is ever applied, counters balance."""
    simulation = Simulation(seed, offset_ns)
    simulation.run(200 * MS)
    simulation.weather = weather
    for wanted, from_timestep in orders:
        simulation.order(wanted, from_timestep)
        simulation.run(simulation.random.randrange(600) * MS)
    simulation.weather = CALM
    simulation.run(2 * S)

    robot, host = simulation.robot, simulation.host
    expected = simulation.roster.orders
    c = robot.session.c
    assert (c.run, c.wanted, c.from_timestep) == (1, expected.wanted, expected.from_timestep)
    assert simulation.now_ns - c.capture_ns <= 140 * MS
    status = host.status(simulation.now_ns)
    assert status.connected and status.udp
    assert status.telemetry is not None and status.telemetry.wanted == expected.wanted
    assert status.received == status.accepted + sum(status.dropped.values())
    counters = robot.session.counters
    drops = sum(counters.values()) - sum(counters[k] for k in ("sent", "received", "accepted"))
    assert counters["received"] == counters["accepted"] + drops


@settings(max_examples=100)
@given(seed=st.integers(0, 2**32 - 1), weather=weathers)
def test_nothing_older_is_ever_applied(seed: int, weather: Weather) -> None:
    simulation = Simulation(seed)
    simulation.weather = weather
    simulation.run(2 * S)
    for (session, sequence, capture_ns), later in pairwise(simulation.robot.seen):
        if session == later[0]:
            assert sequence < later[1] and capture_ns <= later[2]


@settings(max_examples=100)
@given(seed=st.integers(0, 2**32 - 1), weather=weathers)
def test_a_state_leaves_at_least_every_50_ms(seed: int, weather: Weather) -> None:
    simulation = Simulation(seed)
    simulation.run(100 * MS)
    simulation.weather = weather
    simulation.states.clear()
    start_ns, open_all_along = simulation.now_ns, weather.breaks == 0
    simulation.run(2 * S)
    if open_all_along:
        assert simulation.host.open
        gaps = [b - a for a, b in pairwise([start_ns, *simulation.states, simulation.now_ns])]
        assert max(gaps) <= HEARTBEAT_NS


def test_stop_leaves_at_once_and_three_times_10_ms_apart() -> None:
    simulation = Simulation(1)
    simulation.run(215 * MS)  # neither a timestep nor a heartbeat falls into the next 30 ms
    simulation.states.clear()
    start_ns = simulation.now_ns
    simulation.order(Wanted.STOP)
    simulation.run(30 * MS)
    assert simulation.states == [start_ns, start_ns + 10 * MS, start_ns + 20 * MS]
    assert simulation.robot.session.c.wanted == Wanted.STOP


def test_a_timestep_between_two_stops_is_not_one_of_them() -> None:
    simulation = Simulation(1)
    simulation.run(195 * MS)
    simulation.states.clear()
    start_ns = simulation.now_ns
    simulation.order(Wanted.STOP)
    simulation.run(30 * MS)
    assert simulation.states == [start_ns + ms * MS for ms in (0, 5, 10, 20)]


def test_who_joins_has_its_data_with_the_welcome() -> None:
    """Defect 3: a robot that reconnects in mid-run gets everything at once."""
    simulation = Simulation(1)
    simulation.run(S)
    simulation.order(Wanted.RUN, 5)
    simulation.break_tcp()
    simulation.run(20 * MS)
    c = simulation.robot.session.c
    assert (c.open, c.wanted, c.from_timestep) == (1, Wanted.RUN, 5)
    assert simulation.robot.session.value("pollutant") is not None
    assert told(simulation) == ["connected", "lost", "reconnected"]
    assert simulation.host.status(simulation.now_ns).sessions == 2


def test_a_new_connection_of_the_same_robot_takes_its_session_over() -> None:
    simulation = Simulation(1)
    simulation.run(S)
    simulation.break_tcp(told=False)
    simulation.run(S)
    assert told(simulation) == ["connected", "takeover"]
    assert simulation.host.status(simulation.now_ns).udp


@pytest.mark.parametrize(("down", "up"), [(False, False), (False, True), (True, False)])
def test_blocked_udp_goes_over_tcp_and_comes_back(down: bool, up: bool) -> None:
    simulation = Simulation(1)
    simulation.weather = Weather(down=down, up=up)
    simulation.run(3 * S)
    assert told(simulation) == ["connected", "no_udp"]
    status = simulation.host.status(simulation.now_ns)
    assert status.connected and not status.udp
    assert simulation.now_ns - simulation.robot.seen[-1][2] <= 140 * MS
    assert simulation.now_ns - (status.heard_ns or 0) <= 60 * MS
    simulation.weather = CALM
    simulation.run(S)
    assert told(simulation) == ["connected", "no_udp", "udp_back"]
    assert simulation.host.status(simulation.now_ns).udp
    assert Event.UDP_LOST in simulation.robot.events  # both ends say so
    assert not simulation.robot.session.c.udp_lost


def test_udp_that_breaks_in_mid_run_is_told_from_a_robot_that_is_gone() -> None:
    simulation = Simulation(1)
    simulation.run(3 * S)
    simulation.weather = Weather(down=False, up=False)
    simulation.run(2 * S)
    assert told(simulation)[-1] == "no_udp"
    assert simulation.host.status(simulation.now_ns).connected


def test_a_silent_robot_is_lost_after_a_second_and_back_with_its_first_packet() -> None:
    """Defect 12 seen from the link: silence is told, never mistaken for "unchanged"."""
    simulation = Simulation(1)
    simulation.run(S)
    simulation.robot.due_ns = simulation.now_ns + 10 * S
    heard_ns = simulation.host.status(simulation.now_ns).heard_ns or 0
    simulation.run(3 * S)
    lost = simulation.events[-1]
    assert lost.kind == "lost" and S <= lost.time_ns - heard_ns <= S + HEARTBEAT_NS
    assert not simulation.host.status(simulation.now_ns).connected
    simulation.robot.due_ns = simulation.now_ns
    simulation.run(10 * MS)
    assert told(simulation) == ["connected", "lost", "back"]


def test_datagrams_go_where_the_newest_accepted_one_came_from() -> None:
    """Defect 16: a robot is known by its session, not by its address."""
    simulation = Simulation(1)
    simulation.run(S)
    packet = simulation.robot.session.telemetry(simulation.now_ns)
    accepted, _ = simulation.host.receive(packet, ("elsewhere", 9), simulation.now_ns)
    assert accepted and simulation.host.address == ("elsewhere", 9)
    accepted, _ = simulation.host.receive(packet, ("a thief", 9), simulation.now_ns)
    assert not accepted and simulation.host.address == ("elsewhere", 9)


def test_an_unseen_robot_is_sent_its_old_reading_with_its_old_time() -> None:
    simulation = Simulation(1)
    simulation.run(S + 20 * MS)
    session, host = simulation.robot.session, simulation.host
    value = session.value("pollutant")
    assert value is not None
    host.hold(99, simulation.now_ns, None)
    session.udp_in(host.state(Orders(), simulation.now_ns), simulation.now_ns)
    assert session.c.capture_ns == simulation.now_ns
    assert session.value("pollutant") == value


def test_readings_that_do_not_fit_the_table_are_refused_whole() -> None:
    host = HostSession(TAG, "epuck_23", TABLE)
    with pytest.raises(ValueError, match=r"robot 23:.*\[4, 2\] byte"):
        host.hold(1, 2, [(struct.pack("<f", 1), 1), (b"ab", 1)])


def test_a_new_run_begins_with_nothing_measured() -> None:
    simulation = Simulation(1)
    simulation.run(S)
    simulation.host.forget()
    packet = simulation.host.state(Orders(run=2), simulation.now_ns)
    simulation.robot.session.udp_in(packet, simulation.now_ns)
    assert simulation.robot.session.c.run == 2
    assert simulation.robot.session.value("pollutant") is None


def test_readings_that_replace_others_of_the_same_moment_are_sent_again_and_again() -> None:
    simulation = Simulation(1)
    simulation.run(200 * MS)
    host, now_ns = simulation.host, simulation.now_ns
    for first, second in ((b"abcd", b"efgh"), (b"efgh", b"ijkl")):
        host.hold(3, now_ns, [(first, now_ns), (second, now_ns)])
        for _ in range(2):
            packet = host.state(Orders(), now_ns)
            assert first in packet and second in packet
