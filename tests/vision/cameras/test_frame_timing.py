"""A camera's clock and rate, from scripted stamps and arrivals."""

from __future__ import annotations

import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsense.vision.cameras._lateness import JUMP_NS, PICTURES, TRANSFERS, ClockMap, FrameTiming
from vsense.vision.cameras.source import Shot

MS = 1_000_000
S = 1000 * MS
PERIOD_NS = 100 * MS
PICTURE = np.zeros((2, 2), np.uint8)


def shot(stamp_ns: int | None) -> Shot:
    return Shot(PICTURE, stamp_ns)


@given(
    zero_ns=st.integers(-(10**18), 10**18),
    ways_ms=st.lists(st.integers(0, 39), min_size=1, max_size=TRANSFERS),
)
def test_a_picture_is_taken_the_quickest_way_before_it_arrives(
    zero_ns: int, ways_ms: list[int]
) -> None:
    clock = ClockMap()
    for number, way_ms in enumerate(ways_ms):
        stamp_ns = number * PERIOD_NS
        taken_ns = stamp_ns + zero_ns
        mapped_ns, jumped = clock.capture_ns(stamp_ns, taken_ns + way_ms * MS)
        assert not jumped
        assert mapped_ns == taken_ns + min(ways_ms[: number + 1]) * MS


def test_a_clock_that_runs_wrong_is_followed() -> None:
    clock, noise = ClockMap(), random.Random(3)
    worst_ns = 0
    for number in range(36_000):
        taken_ns = number * PERIOD_NS
        stamp_ns = round(taken_ns * (1 + 50e-6)) + 5 * S
        late_ns = int(noise.expovariate(1 / (2 * MS)))
        mapped_ns, jumped = clock.capture_ns(stamp_ns, taken_ns + late_ns)
        assert not jumped
        if number > TRANSFERS:
            worst_ns = max(worst_ns, abs(mapped_ns - taken_ns))
    # An hour at 50 ppm is 180 ms of drift.
    assert worst_ns < 2 * MS


@pytest.mark.parametrize("jump_ns", [-3600 * S, -S, -250 * MS, -70 * MS, 250 * MS, S, 10**17])
def test_a_jump_of_the_clock_is_noticed_within_three_pictures_and_undone(jump_ns: int) -> None:
    clock = ClockMap()
    for number in range(30):
        clock.capture_ns(number * PERIOD_NS, number * PERIOD_NS + 3 * MS)
    jumps = []
    for number in range(30, 40):
        taken_ns = number * PERIOD_NS
        mapped_ns, jumped_ns = clock.capture_ns(taken_ns + jump_ns, taken_ns + 3 * MS)
        jumps.append(jumped_ns)
        if any(jumps):
            assert mapped_ns == taken_ns + 3 * MS
    assert [ns for ns in jumps if ns] == [jump_ns] and jumps.index(jump_ns) < PICTURES


@pytest.mark.parametrize("jump_ns", [3600 * S, -3600 * S])
@pytest.mark.parametrize("late_ms", [5, 20, 60])
def test_a_jump_by_an_hour_is_noticed_however_irregularly_pictures_come(
    jump_ns: int, late_ms: int
) -> None:
    for seed in range(20):
        clock, noise, jumps, arrived_ns = ClockMap(), random.Random(seed), [], 0
        for number in range(40):
            taken_ns = number * PERIOD_NS
            late_ns = min(int(noise.expovariate(1 / (late_ms * MS))), S)
            arrived_ns = max(arrived_ns, taken_ns + late_ns)
            stamp_ns = taken_ns + (jump_ns if number >= 30 else 0)
            mapped_ns, jumped_ns = clock.capture_ns(stamp_ns, arrived_ns)
            jumps.append(jumped_ns)
            assert abs(mapped_ns - taken_ns) <= S
        assert abs(jumps[30] - jump_ns) <= S


@pytest.mark.parametrize("late", [1, 2])
def test_a_camera_whose_first_pictures_were_late_has_not_jumped(late: int) -> None:
    clock = ClockMap()
    for number in range(10):
        taken_ns = number * PERIOD_NS
        delay_ns = S if number < late else 3 * MS
        mapped_ns, jumped = clock.capture_ns(taken_ns, taken_ns + delay_ns)
        assert not jumped and mapped_ns == taken_ns + delay_ns


def test_pictures_that_queued_up_are_no_jump() -> None:
    clock = ClockMap()
    for number in range(30):
        clock.capture_ns(number * PERIOD_NS, number * PERIOD_NS)
    # The host stood still for a second, then took what had queued up one by one.
    for number in range(30, 40):
        taken_ns = number * PERIOD_NS
        assert clock.capture_ns(taken_ns, max(taken_ns, 40 * PERIOD_NS)) == (taken_ns, False)
    assert 5 * PERIOD_NS > JUMP_NS


@pytest.mark.parametrize("stamped", [True, False])
def test_pictures_that_come_too_slowly_are_told_within_three_of_them_and_once(
    stamped: bool,
) -> None:
    pulse, now_ns, changes = FrameTiming(10.0), 0, []
    for period_ms in [100] * 20 + [200] * 5 + [100] * 5:
        now_ns += period_ms * MS
        pulse.capture_ns(shot(now_ns if stamped else None), now_ns)
        changes.append(pulse.rate_change())
    told = [(number, rate) for number, rate in enumerate(changes) if rate is not None]
    assert [number for number, _ in told] == [21, 26]
    assert told[0][1] == pytest.approx(5.0) and told[1][1] == pytest.approx(10.0)
    assert not pulse.slow


def test_a_fast_camera_may_pause_for_a_moment() -> None:
    pulse, now_ns, changes = FrameTiming(100.0), 0, []
    for period_ms in ([10] * 30 + [40]) * 3 + [20] * 40:
        now_ns += period_ms * MS
        pulse.capture_ns(shot(now_ns), now_ns)
        changes.append(pulse.rate_change())
    slow = [number for number, rate in enumerate(changes) if rate is not None]
    assert len(slow) == 1 and 93 < slow[0] <= 93 + 25, "told within half a second"


def test_one_late_picture_and_a_rate_that_nobody_asked_for_are_no_trouble() -> None:
    for pulse in (FrameTiming(10.0), FrameTiming(None)):
        now_ns = 0
        for period_ms in [100] * 10 + [200] + [100] * 10:
            now_ns += period_ms * MS
            pulse.capture_ns(shot(now_ns), now_ns)
            assert pulse.rate_change() is None


def test_what_could_not_be_used_is_not_held_against_the_rate() -> None:
    pulse, now_ns = FrameTiming(10.0), 0
    for number in range(30):
        now_ns += PERIOD_NS
        if number % 3:
            pulse.skip()
        else:
            pulse.capture_ns(shot(now_ns), now_ns)
        assert pulse.rate_change() is None


def test_the_same_stamp_is_the_same_picture() -> None:
    pulse = FrameTiming(10.0)
    assert [pulse.repeated(shot(stamp)) for stamp in (7, 7, 7, 8, None, None)] == [
        False, True, True, False, False, False,
    ]  # fmt: skip
    assert pulse.repeats == 0


def test_without_a_clock_of_its_own_a_picture_is_taken_when_it_arrives() -> None:
    assert FrameTiming(10.0).capture_ns(shot(None), 77) == (77, False)


def test_a_camera_that_is_opened_anew_may_begin_its_clock_anew() -> None:
    pulse = FrameTiming(10.0)
    pulse.capture_ns(shot(10**15), 5)
    pulse.forget()
    assert pulse.capture_ns(shot(0), 9) == (9, False)
