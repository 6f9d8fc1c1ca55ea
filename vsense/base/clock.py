"""The host's clock."""

from __future__ import annotations

import time

from vsense.base.errors import UsageError

_real_time = 1000
_permille = _real_time


def host_ns() -> int:
    """Nanoseconds on the clock that all times of the host are of.

    NTP slews `time.monotonic_ns` by up to 10 % while it corrects the calendar; robots measure the
    age of what they are sent against the host's clock, and nobody slews this one (clock_gettime(2),
    CLOCK_MONOTONIC_RAW). In a lab that is slower than real time it goes slower, see `slow`.
    """
    return time.clock_gettime_ns(time.CLOCK_MONOTONIC_RAW) * _permille // _real_time


_CLOCK_RANGE = 1 << 64


def clock_difference_ns(a_ns: int, b_ns: int) -> int:
    """How far a time of a 64-bit clock is after another one, from -2^63 on; negative: before it.

    Each may be of another machine's clock, whose zero is anywhere: it may have wrapped since, or
    be about to. As `difference` in `c_src/vs_clock.c`.
    """
    return (a_ns - b_ns + (_CLOCK_RANGE >> 1)) % _CLOCK_RANGE - (_CLOCK_RANGE >> 1)


def slow(permille: int) -> None:
    """Has this process's clock go at `permille` / 1000 of real time; before its first reading.

    For a lab, whose processes and daemons (`vsensed --clock-permille`) all have the same pace.

    Raises:
        UsageError: it is not from 1 to 1000.
    """
    global _permille
    if not 1 <= permille <= _real_time:
        raise UsageError(f"pace: expected 1 to 1000 permille, got {permille}")
    _permille = permille


def pace() -> float:
    """How fast the host's clock goes; 1.0 is real time."""
    return _permille / _real_time


def real_s(time_s: float) -> float:
    """Real seconds in which the host's clock goes on by `time_s`: for whatever waits for it."""
    return time_s * _real_time / _permille
