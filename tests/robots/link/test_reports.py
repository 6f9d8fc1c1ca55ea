"""What the host may act on of a robot's reports, over every kind of bad network."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.robots.link.rig import Frozen, MakeRobot, Server
from tests.robots.link.simulation import CALM, MS, TIMESTEP_NS, S, Simulation, Weather, weathers
from vsense.robots.link.status import LIFE_NS, ActuatorReport, Reporter
from vsense.robots.link.wire import Header, PacketType, Telemetry

UID = b"u" * 16
RUN = 1


class Counter:
    """A host that looks at the newest report in every timestep and adds up the growth."""

    def __init__(self, simulation: Simulation) -> None:
        self.simulation = simulation
        self.total = self.last = self.pushed = 0

    def live(self, length_ns: int, pushes: bool) -> None:
        """Lives on, the robot pushing at random."""
        simulation = self.simulation
        end_ns = simulation.now_ns + length_ns
        while simulation.now_ns < end_ns:
            simulation.run(TIMESTEP_NS)
            more = simulation.random.randrange(3) if pushes else 0
            simulation.robot.pushes += more
            self.pushed += more
            report = simulation.host.reporter.report(RUN, simulation.now_ns)
            if report is None:
                continue
            assert report.uid == UID
            (count,) = struct.unpack("<I", report.payload)
            self.total += count - self.last if count >= self.last else count
            self.last = count


@settings(max_examples=60)
@given(
    seed=st.integers(0, 2**32 - 1),
    storms=st.lists(st.tuples(weathers, st.booleans()), min_size=1, max_size=3),
)
def test_whatever_the_network_does_every_push_counts_once(
    seed: int, storms: list[tuple[Weather, bool]]
) -> None:
    """Loss, repetition, delay, broken connections, and daemons that start again."""
    simulation = Simulation(seed)
    counter = Counter(simulation)
    counter.live(1 * S, pushes=False)
    for weather, restarts in storms:
        simulation.weather = weather
        counter.live(1500 * MS, pushes=True)
        simulation.weather = CALM
        counter.live(2500 * MS, pushes=False)
        if restarts:
            simulation.break_tcp()
            simulation.robot.restart()
            counter.live(2 * S, pushes=False)
    assert counter.total == counter.pushed


def test_a_robot_that_falls_silent_is_left_out_after_a_second() -> None:
    simulation = Simulation(1)
    simulation.robot.pushes = 3
    simulation.run(1 * S)
    report = simulation.host.reporter.report
    assert report(RUN, simulation.now_ns) == ActuatorReport(UID, b"\3\0\0\0")
    simulation.weather = Weather(up=False)
    simulation.break_tcp(told=False)
    assert report(RUN, simulation.now_ns) is not None, "one lost report is nothing"
    assert report(RUN, simulation.now_ns + LIFE_NS) is None
    simulation.break_tcp()
    assert report(RUN, simulation.now_ns) is None, "its session has ended"


def said(step: int, run: int = RUN) -> tuple[Header, Telemetry]:
    return Header(PacketType.TELEMETRY, run=run), Telemetry(control_step=step, payload=b"x")


def test_a_robot_that_talks_but_makes_no_control_step_is_left_out_too() -> None:
    reporter = Reporter()
    reporter.open(UID)
    for now_ns in range(0, 3 * S, 50 * MS):
        reporter.receive(*said(7), now_ns)
    assert reporter.report(RUN, 3 * S) is None
    reporter.receive(*said(8), 3 * S)
    assert reporter.report(RUN, 3 * S + LIFE_NS - 1) == ActuatorReport(UID, b"x")


@pytest.mark.parametrize("run", [0, 2])
def test_a_report_of_another_run_does_not_count(run: int) -> None:
    reporter = Reporter()
    reporter.open(UID)
    reporter.receive(*said(1, run), 0)
    assert reporter.report(RUN, 1) is None


def test_a_session_begins_and_ends_without_a_report() -> None:
    reporter = Reporter()
    assert reporter.report(RUN, 0) is None
    reporter.open(UID)
    reporter.receive(*said(1), 0)
    reporter.close()
    assert reporter.report(RUN, 1) is None
    reporter.open(b"v" * 16)
    assert reporter.report(RUN, 1) is None
    reporter.receive(*said(1), 2)
    assert reporter.report(RUN, 3) == ActuatorReport(b"v" * 16, b"x")


def test_the_server_gives_the_reports_of_its_robots_and_of_its_run(
    still: Server, frozen: Frozen, robot: MakeRobot
) -> None:
    one = robot(still, 1).join()
    robot(still, 2).join()
    still.server.publish(1, frozen(), {})
    one.timestep(1)
    one.say(Telemetry(control_step=5, payload=b"\4\0\0\0"))
    one.until(lambda: 1 in still.server.reports())
    one.until(lambda: still.server.reports()[1] == ActuatorReport(bytes([1]) * 16, b"\4\0\0\0"))
    frozen.advance(LIFE_NS)
    assert still.server.reports() == {}
    one.say(Telemetry(control_step=6, payload=b"\5\0\0\0"))
    one.until(lambda: still.server.reports().get(1) is not None)
    run = still.server.new_run(1)
    assert still.server.reports() == {}, "what was said in another run does not count"
    one.until(lambda: one.session.c.run == run)
    one.say(Telemetry(control_step=7, payload=b"\0\0\0\0"))
    one.until(lambda: set(still.server.reports()) == {1})
