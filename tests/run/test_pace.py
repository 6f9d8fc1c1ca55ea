"""Timesteps by the clock, whatever a tracker's rate."""

from __future__ import annotations

from random import Random

from hypothesis import given
from hypothesis import strategies as st

from vsense.run.runtime import Pace

MS = 1_000_000
STEP_NS = 100 * MS

starts = st.integers(-(10**18), 10**18)


def numbers(pace: Pace, times_ns: list[int]) -> list[int]:
    """The timesteps that begin."""
    found = [pace.timestep(time_ns) for time_ns in times_ns]
    return [number for number in found if number is not None]


@given(starts, st.lists(st.integers(-24 * MS, 24 * MS), max_size=200))
def test_a_tracker_of_the_same_rate_begins_every_timestep(start: int, jitter_ns: list[int]) -> None:
    times = [start + n * STEP_NS + late for n, late in enumerate([0, *jitter_ns])]
    assert numbers(Pace(STEP_NS), times) == list(range(len(times)))


@given(starts, st.integers(-900, 900), st.randoms(use_true_random=False))
def test_a_clock_that_is_a_little_off_costs_no_timestep(
    start: int, per_100k: int, random: Random
) -> None:
    period_ns = STEP_NS + STEP_NS * per_100k // 100_000
    times = [start + n * period_ns + random.randint(-5 * MS, 5 * MS) for n in range(500)]
    assert numbers(Pace(STEP_NS), times) == list(range(len(times)))


@given(starts, st.floats(0.15, 12.0), st.integers(0, 10 * MS))
def test_timesteps_take_their_time_at_any_rate(start: int, rate: float, jitter_ns: int) -> None:
    """`rate`: states per timestep."""
    times = [
        start + round(n * STEP_NS / rate) + (jitter_ns if n % 3 == 1 else 0)
        for n in range(round(300 * rate))
    ]
    found = numbers(Pace(STEP_NS), times)
    passed = (times[-1] - start) / STEP_NS
    assert abs(found[-1] - passed) <= 1.5 + 0.011 * passed
    assert found == sorted(set(found)), "they grow"
    if rate >= 2.5:
        assert found == list(range(len(found))), "a fast tracker leaves none out"


@given(starts, st.integers(5, 10_000), st.integers(-40 * MS, 40 * MS))
def test_a_pause_leaves_its_timesteps_out(start: int, pause: int, late_ns: int) -> None:
    pace = Pace(STEP_NS)
    numbers(pace, [start + n * STEP_NS for n in range(10)])
    assert pace.timestep(start + (10 + pause) * STEP_NS + late_ns) == 10 + pause


def test_a_state_that_comes_twice_begins_nothing() -> None:
    pace = Pace(STEP_NS)
    assert numbers(pace, [7, 7, 7 + STEP_NS, 7 + STEP_NS, 7]) == [0, 1]
