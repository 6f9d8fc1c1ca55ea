"""The host's clock."""

from __future__ import annotations

import time


def host_ns() -> int:
    """Nanoseconds on the clock that all times of the host are of.

    NTP slews `time.monotonic_ns` by up to 10 % while it corrects the calendar; robots measure the
    age of what they are sent against the host's clock, and nobody slews this one (clock_gettime(2),
    CLOCK_MONOTONIC_RAW).
    """
    return time.clock_gettime_ns(time.CLOCK_MONOTONIC_RAW)
