"""Links are measured as they are: against sums by hand, and in a network whose loss is known."""

from __future__ import annotations

import json
from dataclasses import asdict
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.robots.link.simulation import HOUR_NS, MS, S, Simulation, Weather
from vsense.base.clock import clock_difference_ns
from vsense.robots.link._meter import FIRST_PACKETS, LinkMeter
from vsense.robots.link.status import LinkFigures, RadioStatus, switched_on_again
from vsense.robots.link.wire import Header, Hello, StopCause, Telemetry

OFFSET_NS = 5_000 * S
"""The robot's clock is so far ahead."""


def heard(
    meter: LinkMeter, arrivals: list[tuple[int, int]], ahead_ns: int = OFFSET_NS, **told: int
) -> None:
    """Telemetry numbered from 1 comes at so many ms, after so many ms on the way."""
    for number, (at_ms, way_ms) in enumerate(arrivals, 1):
        header = Header(
            *(6, 0, 0, 9, number),
            send_ns=(ahead_ns + (at_ms - way_ms) * MS) % 2**64,
            echo_ns=(at_ms - 2 * way_ms - 3) * MS,
            hold_us=3_000,
        )
        meter.hear(header, Telemetry(received=number, **told), 2 * number, at_ms * MS)


def test_by_hand() -> None:
    meter = LinkMeter()
    heard(meter, [(100, 4), (150, 4), (210, 14), (250, 4), (450, 4)])
    figures = meter.figures(500 * MS)
    assert (figures.heard_s, figures.packets, figures.sessions) == (0.4, 5, 1)
    assert (figures.round_trip_p50_ms, figures.gap_ms) == (8.0, 200.0)
    # D of RFC 3550, 6.4.1: 0, 10, -10 and 0 ms.
    assert figures.jitter_ms == 5.0
    assert figures.loss_up == 0.0
    # 2 STATEs are sent for each telemetry, of which its robot has taken 1.
    assert figures.loss_down == 0.5
    assert (figures.signal_dbm, figures.power_saving, figures.late) == (None, None, None)


def test_a_link_of_which_nothing_came() -> None:
    assert LinkMeter().figures(7 * S) == LinkFigures()


def test_the_end_is_a_gap_too() -> None:
    meter = LinkMeter()
    heard(meter, [(100, 1), (150, 1)])
    assert meter.figures(2150 * MS).gap_ms == 2000.0


def test_stops_are_counted_when_they_begin_and_not_at_a_sessions_start() -> None:
    meter = LinkMeter()
    causes = [StopCause.STALE] * FIRST_PACKETS + [0, 3, 3, 0, 3]
    for number, cause in enumerate(causes, 1):
        header = Header(6, session=1, sequence=number)
        meter.hear(header, Telemetry(stop_cause=cause), number, number * 50 * MS)
    assert meter.figures(S).stale == 2


def test_what_was_counted_before_is_not_of_this_measurement() -> None:
    meter = LinkMeter()
    for number, (overruns, steps) in enumerate([(7, 1000), (7, 1010), (9, 1100)]):
        told = Telemetry(overruns=overruns, control_step=steps, retries=40 + number, signal_dbm=-70)
        meter.hear(Header(6, session=1, sequence=900 + number), told, 0, number * S)
    figures = meter.figures(3 * S)
    assert (figures.overruns, figures.late, figures.retries) == (2, 0.02, 2)
    assert (figures.signal_dbm, figures.weakest_dbm, figures.loss_up) == (-70.0, -70, 0.0)


def test_a_robots_clock_may_pass_its_zero_and_its_middle() -> None:
    """An emulated robot's is up to an hour behind a host that was started a minute ago."""
    arrivals = [(100, 4), (150, 4), (210, 14), (250, 4), (450, 4)]
    expected = LinkMeter()
    heard(expected, arrivals)
    for sent_first_ns in (-HOUR_NS, -120 * MS, 2**63 - 120 * MS, 2**64 - 1):
        meter = LinkMeter()
        heard(meter, arrivals, ahead_ns=sent_first_ns)
        assert meter.figures(500 * MS) == expected.figures(500 * MS)


def test_no_number_that_a_robot_says_is_too_large() -> None:
    ends = (0, 1, 2**63 - 1, 2**63, 2**64 - 1)
    meter = LinkMeter()
    for number, (send_ns, echo_ns) in enumerate(product(ends, ends)):
        header = Header(*(6, 0, 0, 9, number), send_ns=send_ns, echo_ns=echo_ns, hold_us=2**32 - 1)
        counts = {"received": 2**32 - 1 - number, "overruns": number % 3 << 30}
        told = Telemetry(control_step=number % 2 << 31, old=number << 20, **counts)
        meter.hear(header, told, number, 60 * S + number * MS)
    figures = meter.figures(61 * S)
    json.dumps(asdict(figures), allow_nan=False)
    for share in (figures.loss_up, figures.loss_down, figures.late):
        assert share is None or 0.0 <= share <= 1.0


def test_an_echo_of_what_was_not_sent_yet_is_no_round_trip() -> None:
    meter = LinkMeter()
    for number, echo_ns in enumerate((60 * S, 62 * S, 2**64 - 1), 1):
        meter.hear(Header(*(6, 0, 0, 9, number), echo_ns=echo_ns), Telemetry(), 1, 61 * S)
    assert meter.figures(61 * S).round_trip_p50_ms == 1000.0


@given(st.integers(0, 2**64 - 1), st.integers(0, 2**64 - 1))
def test_differences_of_clocks_are_those_of_64_bits(a_ns: int, b_ns: int) -> None:
    a, b = np.array([a_ns], np.uint64), np.array([b_ns], np.uint64)
    assert clock_difference_ns(a_ns, b_ns) == (a - b).view(np.int64)[0]


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_loss_and_round_trips_of_a_network_that_is_known(loss: float) -> None:
    simulation = Simulation(3, offset_ns=OFFSET_NS)
    simulation.run(S)
    simulation.weather = Weather(loss=loss, delay_ns=20 * MS)
    simulation.host.meter = LinkMeter()
    simulation.run(60 * S)
    figures = simulation.host.meter.figures(simulation.now_ns)
    assert figures.packets > 700
    assert figures.loss_up == pytest.approx(loss, abs=0.04)
    assert figures.loss_down == pytest.approx(loss, abs=0.04)
    assert figures.round_trip_p50_ms is not None and figures.round_trip_p99_ms is not None
    # Each way takes an even 0 to 20 ms, and the simulation's turns up to 5 ms more.
    assert 15.0 <= figures.round_trip_p50_ms <= 30.0
    assert figures.round_trip_p50_ms < figures.round_trip_p99_ms <= 50.0


def test_what_a_radio_does_not_know_is_none() -> None:
    assert RadioStatus.of(Telemetry()) == RadioStatus()
    told = Telemetry(signal_dbm=-61, bit_rate=55, retries=0, power_saving=0)
    assert RadioStatus.of(told) == RadioStatus(-61, 5.5, 0, False)


@pytest.mark.parametrize(
    ("started", "uptime_s", "again"),
    [
        (1, 20, False),  # the same daemon: whatever its clock says
        (2, 700, False),  # another daemon on a board that was never off
        (2, 697, False),
        (2, 20, True),
        (2, 600, True),
    ],
)
def test_a_board_that_was_switched_on_again(started: int, uptime_s: int, again: bool) -> None:
    before = Hello(b"u" * 16, 23, "", "", started=1, uptime_s=100)
    now = Hello(b"u" * 16, 23, "", "", started=started, uptime_s=uptime_s)
    said = switched_on_again(before, now, 600.0)
    assert bool(said) == again
    if again:
        text = f"was switched on again (battery swapped?), up for {uptime_s} s; "
        assert said == text
