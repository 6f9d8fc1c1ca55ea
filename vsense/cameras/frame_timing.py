"""A camera's clock and rate: when each picture was taken, and whether they come as they should."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from itertools import pairwise
from statistics import median

from vsense.cameras.source import Shot

WINDOW = 64
"""Pictures over which the shortest way from a camera is looked for: 6 s at 10 Hz, in which a clock
that runs 50 ppm wrong moves by 0.3 ms."""
JUMP_NS = 100_000_000
"""A camera's clock that is so far off all at once has jumped; networks are not late by so much
for several pictures in the same way."""
BEHIND_NS = 40_000_000
"""One that falls back by so much and stays there has jumped, too: it costs triggered pictures."""
STEADY_NS = 20_000_000
"""Pictures that are late by the same amount up to this are not late: the clock is behind."""
PICTURES = 3
"""So many pictures show what a single one may only suggest."""
SPAN_S = 0.3
SLOW = 1.25
PROMPT = 1.1
"""Intervals, relative to the wanted one, from which pictures are too slow, and no longer are."""


class ClockMap:
    """Maps a camera's clock to the host's.

    A picture arrives after it was taken, and never before: of the last pictures the one that was
    quickest tells how far the clocks are apart, and all others were later on their way. What is
    left is the quickest way's own time.
    """

    def __init__(self) -> None:
        self._apart_ns: deque[int] = deque(maxlen=WINDOW)
        self._newest_ns: int | None = None

    def capture_ns(self, stamp_ns: int, arrived_ns: int) -> tuple[int, bool]:
        """Gives when a picture was taken, by the host's clock, and whether the camera's jumped.

        Args:
            stamp_ns: When it was taken, by the camera's clock.
            arrived_ns: When it arrived, by the host's clock.
        """
        apart_ns = arrived_ns - stamp_ns
        jumped = self._has_jumped(stamp_ns, apart_ns)
        if jumped:
            self._apart_ns.clear()
        self._newest_ns = stamp_ns
        self._apart_ns.append(apart_ns)
        return stamp_ns + min(self._apart_ns), jumped

    def _has_jumped(self, stamp_ns: int, apart_ns: int) -> bool:
        if self._newest_ns is None or not self._apart_ns:
            return False
        if stamp_ns < self._newest_ns:
            return True
        least_ns, before = min(self._apart_ns), [*self._apart_ns][-PICTURES:]
        if apart_ns < least_ns - JUMP_NS:
            # After pictures that were late by chance, one that is not is no jump.
            return len(before) == PICTURES and _steady(before)
        last = [*before, apart_ns][-PICTURES:]
        return _steady(last) and all(ns > least_ns + BEHIND_NS for ns in last)


def _steady(times_ns: Sequence[int]) -> bool:
    return max(times_ns) - min(times_ns) < STEADY_NS


class FrameTiming:
    """Watches the times of one camera's pictures."""

    def __init__(self, rate_hz: float | None) -> None:
        """Begins before the first picture.

        Args:
            rate_hz: How many per second are wanted; None: unknown.
        """
        self._period_ns = None if rate_hz is None else 1e9 / rate_hz
        self.slow = False
        self.repeats = 0
        self._stamp_ns: int | None = None
        # Fast cameras may pause for a moment: their rate is that of some tenths of a second.
        self._intervals = max(PICTURES, round(SPAN_S * (rate_hz or 0.0)))
        self.forget()

    def forget(self) -> None:
        """Starts again: the camera was reopened. What was slow or frozen may still be so."""
        self._clock = ClockMap()
        self._times_ns: deque[int] = deque(maxlen=self._intervals + 1)

    def skip(self) -> None:
        """A picture came that could not be used: the time to the next one says nothing."""
        self._times_ns.clear()

    def repeated(self, shot: Shot) -> bool:
        """Whether a picture has the stamp of the one before: it is that one once more."""
        again = shot.stamp_ns is not None and shot.stamp_ns == self._stamp_ns
        self.repeats = self.repeats + 1 if again else 0
        self._stamp_ns = shot.stamp_ns
        return again

    def capture_ns(self, shot: Shot, arrived_ns: int) -> tuple[int, bool]:
        """Gives when a picture was taken, by the host's clock, and whether the camera's jumped."""
        if shot.stamp_ns is None:
            self._times_ns.append(arrived_ns)
            return arrived_ns, False
        capture_ns, jumped = self._clock.capture_ns(shot.stamp_ns, arrived_ns)
        if jumped:
            self._times_ns.clear()
        self._times_ns.append(capture_ns)
        # The quickest way may have been slower at first: nothing is taken after it has arrived.
        return min(capture_ns, arrived_ns), jumped

    def rate_change(self) -> float | None:
        """Gives the rate [Hz] where pictures have become too slow, or are no longer."""
        if self._period_ns is None or len(self._times_ns) <= self._intervals:
            return None
        # The median: a single picture that never came is no rate.
        interval_ns = median(b - a for a, b in pairwise(self._times_ns))
        limit = PROMPT if self.slow else SLOW
        if (interval_ns > limit * self._period_ns) == self.slow:
            return None
        self.slow = not self.slow
        return 1e9 / max(interval_ns, 1.0)
