"""A camera's clock and rate: when each picture was taken, and whether the pictures are slow."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from itertools import pairwise
from statistics import median

from vsense.vision.cameras.source import Shot

WINDOW = 64
"""Pictures that the shortest transfer is taken from: 6 s at 10 Hz, 0.3 ms of drift at 50 ppm."""
JUMP_NS = 100_000_000
"""A difference that is a clock's jump: no network delays several pictures alike by so much."""
CERTAIN_NS = 10_000_000_000
"""One that is a jump however irregularly pictures come: none is delayed by so much."""
BEHIND_NS = 40_000_000
"""A lasting step back that is a jump, too: it would cost triggered pictures."""
STEADY_NS = 20_000_000
"""Delays that differ by less than this are the same delay: the clock is behind."""
PICTURES = 3
"""Pictures in a row that confirm a jump or a repetition."""
SPAN_S = 0.3
SLOW = 1.25
PROMPT = 1.1
"""Intervals over the wanted one at which pictures become too slow, and prompt again."""


class ClockMap:
    """Maps a camera's clock to the host's.

    A picture never arrives before it was taken, so the smallest difference between arrival and
    stamp among the last pictures is the clocks' difference, apart from the shortest transfer time.
    """

    def __init__(self) -> None:
        self._apart_ns: deque[int] = deque(maxlen=WINDOW)
        self._newest_ns: int | None = None

    def capture_ns(self, stamp_ns: int, arrived_ns: int) -> tuple[int, int]:
        """Returns when a picture was taken, and how far the camera's clock jumped ahead; 0: not.

        `stamp_ns` is by the camera's clock; `arrived_ns` and the result are by the host's.
        """
        apart_ns = arrived_ns - stamp_ns
        jump_ns = 0
        if self._has_jumped(stamp_ns, apart_ns):
            jump_ns = min(self._apart_ns) - apart_ns
            self._apart_ns.clear()
        self._newest_ns = stamp_ns
        self._apart_ns.append(apart_ns)
        return stamp_ns + min(self._apart_ns), jump_ns

    def _has_jumped(self, stamp_ns: int, apart_ns: int) -> bool:
        if self._newest_ns is None or not self._apart_ns:
            return False
        if stamp_ns < self._newest_ns:
            return True
        least_ns, before = min(self._apart_ns), [*self._apart_ns][-PICTURES:]
        if apart_ns < least_ns - JUMP_NS:
            # A prompt picture after some that were late by chance is no jump.
            is_known = len(before) == PICTURES and _steady(before)
            return is_known or apart_ns < least_ns - CERTAIN_NS
        last = [*before, apart_ns][-PICTURES:]
        return _steady(last) and all(ns > least_ns + BEHIND_NS for ns in last)


def _steady(times_ns: Sequence[int]) -> bool:
    return max(times_ns) - min(times_ns) < STEADY_NS


class FrameTiming:
    """Watches the times of one camera's pictures."""

    def __init__(self, rate_hz: float | None) -> None:
        """Takes the wanted pictures per second; None: unknown."""
        self._period_ns = None if rate_hz is None else 1e9 / rate_hz
        self.slow = False
        self.repeats = 0
        self._stamp_ns: int | None = None
        # Fast cameras may pause briefly: their rate is measured over some tenths of a second.
        self._intervals = max(PICTURES, round(SPAN_S * (rate_hz or 0.0)))
        self.forget()

    def forget(self) -> None:
        """Starts again after a reopening; slow and frozen states stay."""
        self._clock = ClockMap()
        self._times_ns: deque[int] = deque(maxlen=self._intervals + 1)

    def skip(self) -> None:
        """Notes an unusable picture: the time to the next one is no interval."""
        self._times_ns.clear()

    def repeated(self, shot: Shot) -> bool:
        """Whether a picture has the stamp of the one before, and so is the same picture."""
        again = shot.stamp_ns is not None and shot.stamp_ns == self._stamp_ns
        self.repeats = self.repeats + 1 if again else 0
        self._stamp_ns = shot.stamp_ns
        return again

    def capture_ns(self, shot: Shot, arrived_ns: int) -> tuple[int, int]:
        """Returns when a picture was taken [host's ns], and how far the camera's clock jumped."""
        if shot.stamp_ns is None:
            self._times_ns.append(arrived_ns)
            return arrived_ns, 0
        capture_ns, jump_ns = self._clock.capture_ns(shot.stamp_ns, arrived_ns)
        if jump_ns:
            self._times_ns.clear()
        self._times_ns.append(capture_ns)
        # No picture is taken after it has arrived.
        return min(capture_ns, arrived_ns), jump_ns

    def rate_change(self) -> float | None:
        """Returns the rate [Hz] when pictures become too slow or recover, else None."""
        if self._period_ns is None or len(self._times_ns) <= self._intervals:
            return None
        # The median, because a single lost picture does not change the rate.
        interval_ns = median(b - a for a, b in pairwise(self._times_ns))
        limit = PROMPT if self.slow else SLOW
        if (interval_ns > limit * self._period_ns) == self.slow:
            return None
        self.slow = not self.slow
        return 1e9 / max(interval_ns, 1.0)


def jump_in_words(jump_ns: int) -> str:
    """Says how far a clock jumped: "ahead by 3600.00 s"."""
    return f"{'ahead' if jump_ns > 0 else 'back'} by {abs(jump_ns) / 1e9:.2f} s"
