"""The clock estimate: its error is never larger than the bound that it gives."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from hypothesis import given
from hypothesis import strategies as st

from tests.wire.strategies import MS, Link, S
from vsense.base.clock import clock_difference_ns
from vsense.base.native import check, ffi, lib

HOUR = 3600 * S
delays = st.sampled_from([0, 60 * MS]) | st.integers(0, 60 * MS)
holds = st.sampled_from([0, 10 * S]) | st.integers(0, 100 * MS)
drifts_ppb = st.sampled_from([-100_000, 0, 100_000]) | st.integers(-100_000, 100_000)
AGE_UNKNOWN = 2**64 - 1


@dataclass(frozen=True)
class Clocks:
    """True time to each end's clock; the host's is the true one.

    Attributes:
        ahead_ns: what the robot's clock shows at true time 0.
        drift_ppb: how much too fast the robot's clock runs, in 1e-9.
        slews: what NTP does to it besides: from when, until when, how much too fast in 1e-9.
    """

    ahead_ns: int
    drift_ppb: int
    slews: tuple[tuple[int, int, int], ...] = ()

    def robot(self, true_ns: int) -> int:
        shown_ns = true_ns + self.ahead_ns + true_ns * self.drift_ppb // 10**9
        for begin_ns, end_ns, ppb in self.slews:
            slewed_ns = min(true_ns, end_ns) - begin_ns
            shown_ns += max(slewed_ns, 0) * ppb // 10**9
        return shown_ns % 2**64


# An emulated robot's clock may be before its zero, and pass it.
ahead = st.integers(-HOUR, HOUR) | st.integers(-60 * S, 0)
clocks = st.builds(Clocks, ahead, drifts_ppb)


@st.composite
def slewed_clocks(draw: st.DrawFn) -> Clocks:
    """A robot's clock that NTP slews for a while, and then for another."""
    pair, slews, begin_ns = draw(clocks), [], draw(st.integers(0, 20 * S))
    for _ in range(2):
        end_ns = begin_ns + draw(st.integers(0, 60 * S))
        ppb = draw(st.sampled_from([-80_000_000, 80_000_000, -101_000_000, 101_000_000]))
        slews.append((begin_ns, end_ns, ppb))
        begin_ns = end_ns + draw(st.integers(0, 20 * S))
    return Clocks(pair.ahead_ns, pair.drift_ppb, tuple(slews))


@st.composite
def trips(draw: st.DrawFn) -> tuple[int, int, int, int]:
    """Pause before, way up, hold, way down [ns]."""
    return draw(st.integers(0, 10 * S)), draw(delays), draw(holds), draw(delays)


def errors_within_bounds(
    pair: Clocks, journeys: list[tuple[int, int, int, int]], wait_ns: int, slewed: bool
) -> Iterator[bool]:
    """After each packet, and so long after it: is the estimate's error within its bound?"""
    clock = ffi.new("struct vs_clock *")
    offset, bound = ffi.new("int64_t *"), ffi.new("uint64_t *")
    lib.vs_clock_init(clock, slewed)
    now_ns = S
    for pause_ns, up_ns, hold_ns, down_ns in journeys:
        sent_ns = now_ns + pause_ns
        answered_ns = sent_ns + up_ns + hold_ns
        now_ns = answered_ns + down_ns
        echo_ns, here_ns = pair.robot(sent_ns), pair.robot(now_ns)
        code = lib.vs_clock_sample(clock, echo_ns, answered_ns, hold_ns // 1000, here_ns)
        assert code == 0 or not slewed
        if clock.samples == 0:
            continue
        for later_ns in (now_ns, now_ns + wait_ns):
            check(lib.vs_clock_estimate(clock, pair.robot(later_ns), offset, bound))
            error_ns = clock_difference_ns(pair.robot(later_ns) + offset[0], later_ns)
            yield abs(error_ns) <= bound[0]


@given(clocks, st.lists(trips(), min_size=1, max_size=30), st.integers(0, 60 * S))
def test_error_is_within_the_bound_for_any_delays_and_drift(
    pair: Clocks, journeys: list[tuple[int, int, int, int]], wait_ns: int
) -> None:
    assert all(errors_within_bounds(pair, journeys, wait_ns, slewed=False))


@given(slewed_clocks(), st.lists(trips(), min_size=1, max_size=30), st.integers(0, 60 * S))
def test_error_is_within_the_bound_where_ntp_slews_the_robots_clock(
    pair: Clocks, journeys: list[tuple[int, int, int, int]], wait_ns: int
) -> None:
    assert all(errors_within_bounds(pair, journeys, wait_ns, slewed=True))


def test_a_slewed_clock_would_break_the_bound_of_one_that_nobody_slews() -> None:
    pair = Clocks(0, 0, ((10 * S, 20 * S, 80_000_000),))
    journeys = [(50 * MS, MS, MS, MS)] * 300
    assert not all(errors_within_bounds(pair, journeys, 100 * MS, slewed=False))
    assert all(errors_within_bounds(pair, journeys, 100 * MS, slewed=True))


@given(clocks, st.lists(trips(), min_size=1, max_size=30))
def test_the_best_sample_rules_until_it_has_aged(
    pair: Clocks, journeys: list[tuple[int, int, int, int]]
) -> None:
    clock = ffi.new("struct vs_clock *")
    offset, bound = ffi.new("int64_t *"), ffi.new("uint64_t *")
    lib.vs_clock_init(clock, False)
    now_ns = S
    for pause_ns, up_ns, hold_ns, down_ns in journeys:
        sent_ns = now_ns + pause_ns
        now_ns = sent_ns + up_ns + hold_ns + down_ns
        here_ns = pair.robot(now_ns)
        aged_ns = None
        if lib.vs_clock_estimate(clock, here_ns, offset, bound) == 0:
            aged_ns = bound[0]
        answered_ns = now_ns - down_ns
        lib.vs_clock_sample(clock, pair.robot(sent_ns), answered_ns, hold_ns // 1000, here_ns)
        check(lib.vs_clock_estimate(clock, here_ns, offset, bound))
        assert aged_ns is None or bound[0] <= aged_ns
        # Drift counts twice: what the clocks really did, and what they might have done.
        assert bound[0] <= (up_ns + down_ns) // 2 + (up_ns + hold_ns + down_ns) // 2000 + 3000


@given(st.integers(0, 2**64 - 1), st.integers(0, 2**64 - 1), st.integers(0, 2**32 - 1))
def test_no_sample_from_the_wire_can_do_harm(echo_ns: int, send_ns: int, hold_us: int) -> None:
    clock = ffi.new("struct vs_clock *")
    offset, bound = ffi.new("int64_t *"), ffi.new("uint64_t *")
    lib.vs_clock_init(clock, False)
    assert lib.vs_clock_estimate(clock, S, offset, bound) == lib.VS_ERR_STATE
    code = lib.vs_clock_sample(clock, echo_ns, send_ns, hold_us, 100 * S)
    away_ns = 100 * S - echo_ns
    slack_ns = -(-away_ns // 4000) + 1000
    believable = 0 < echo_ns <= 100 * S and hold_us * 1000 <= away_ns + slack_ns
    if code == 0:
        assert lib.vs_clock_estimate(clock, 100 * S, offset, bound) == 0
    if believable or echo_ns in (0, 100 * S + 1):
        assert code == (0 if believable else lib.VS_ERR_ARGUMENT)


@given(ahead, st.integers(0, 40 * MS), st.integers(0, 40 * MS))
def test_age_of_a_value_is_right_within_the_bound(ahead_ns: int, up_ns: int, down_ns: int) -> None:
    """HELLO and WELCOME give the first estimate, TELEMETRY and STATE the later ones."""
    link = Link(robot_ahead_ns=ahead_ns)
    assert link.robot.age_ns(0, link.robot_ns(S)) == AGE_UNKNOWN
    link.greet(S)
    for i in range(1, 5):
        now_ns = S + i * 50 * MS
        packet = link.robot.telemetry(link.robot_ns(now_ns))
        assert link.host.receive_telemetry(packet, True, now_ns + up_ns) is not None
        datagram = link.state(now_ns + up_ns + 7 * MS, capture_ns=now_ns - 30 * MS)
        arrival_ns = now_ns + up_ns + 7 * MS + down_ns
        assert link.deliver(datagram, arrival_ns)[0] == 0
        age_ns = link.robot.age_ns(now_ns - 30 * MS, link.robot_ns(arrival_ns))
        true_ns = arrival_ns - (now_ns - 30 * MS)
        estimate = link.robot.clock(link.robot_ns(arrival_ns))
        assert estimate is not None
        assert abs(age_ns - true_ns) <= estimate[1]


def test_an_age_is_never_negative() -> None:
    link = Link()
    link.greet(S)
    assert link.robot.age_ns(2 * S, link.robot_ns(S)) == 0


@given(
    st.integers(0, 2**64 - 1)
    | st.integers(0, 2**36)
    | st.integers(0, 2**32).map(lambda n: n * 1000)
)
def test_whole_microseconds_without_a_division(ns: int) -> None:
    assert lib.vs_clock_us(ns) == ns // 1000
