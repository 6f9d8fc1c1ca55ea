"""Cameras whose pictures are older than their stamps: motion explains what they contradict.

A camera that is late by some time shows a robot where another one has shown it that much earlier.
Two cameras' ways of the robots that both of them see are laid over each other, one shifted in time:
where they fit far better than unshifted, one camera is late. A wrong calibration shifts places, not
times, and robots that stand say nothing.
"""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain, combinations, islice, pairwise
from statistics import median
from typing import NamedTuple

import numpy as np

from vsense.base.arena import Floats
from vsense.vision.cameras.source import Shot

TRANSFERS = 64
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
        self._apart_ns: deque[int] = deque(maxlen=TRANSFERS)
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
        if shot.capture_ns is not None or shot.stamp_ns is None:
            known_ns = arrived_ns if shot.capture_ns is None else shot.capture_ns
            self._times_ns.append(known_ns)
            return min(known_ns, arrived_ns), 0
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


_Way = deque[tuple[int, float, float]]
_Pair = tuple[str, str]

WAYS_WINDOW_S = 8.0
"""Ways are remembered so long."""
EVERY_S = 1.0
"""They are compared so often."""
LEAST_DELAY_S = 0.06
"""Less is usual where cameras are not triggered: half a period, and what a driver takes."""
GONE_S = 0.04
MOST_S = 0.6
_STEP_S = 0.05
_NEXT_S = 0.35
"""Places further apart in time are not joined."""
_LEAST_VIEWS = 24
_LEAST_M = 0.002
_EXPLAINED = 0.4
"""Of the contradiction, what may be left where one camera's ways are shifted."""
_SHARP_S = 0.1
"""Shifted by so much more or less, ways have to fit far worse: otherwise they tell no time."""
_AGREE_S = 0.03
_TIMES = 3
"""Comparisons in a row that have to say the same."""
_PAIRS = 2
"""Compared in one call, so that none takes long."""
_MOST_VIEWS = 200
_OPEN_S = 20.0
"""So long ways may be waited for."""

_SHIFTS_S = np.arange(-MOST_S, MOST_S + 0.5 * _STEP_S, _STEP_S)


class Lag(NamedTuple):
    """How much later one camera is than another.

    Attributes:
        lag_s: By so much, if `is_sure`.
        apart_m: So far its places are off apart from that.
        is_sure: Whether robots' ways tell.
        is_open: Whether they may tell soon: robots drive, and were not seen for long.
    """

    lag_s: float
    apart_m: float
    is_sure: bool
    is_open: bool = False

    @property
    def is_lag(self) -> bool:
        """Whether one of the two is late."""
        return self.is_sure and abs(self.lag_s) > GONE_S


_UNKNOWN = Lag(0.0, 0.0, False)
_OPEN = Lag(0.0, 0.0, False, True)


class CameraDelays:
    """Remembers where each camera has seen each robot, and compares the cameras' ways."""

    def __init__(self) -> None:
        self._ways: dict[str, dict[int, _Way]] = defaultdict(dict)
        self._begun_ns = 0
        self._left: list[_Pair] = []
        self._sure: dict[_Pair, float] = {}
        self._lags: dict[_Pair, Lag] = {}
        self._met_ns: dict[_Pair, int] = {}
        self._recent: dict[str, deque[float]] = {}
        self.late_s: dict[str, float] = {}
        """The cameras that are late, by how much."""

    def see(self, camera: str, capture_ns: int, places: Mapping[int, Sequence[float]]) -> None:
        """Takes the places [m] of the tags that a picture shows once."""
        ways = self._ways[camera]
        for tag, (x_m, y_m) in places.items():
            way = ways.setdefault(tag, deque())
            if way and capture_ns <= way[-1][0]:
                way.clear()  # a recording begins again, or a clock was set back
            way.append((capture_ns, x_m, y_m))
        for tag, way in list(ways.items()):
            while way and abs(capture_ns - way[0][0]) > 1e9 * WAYS_WINDOW_S:
                way.popleft()
            if not way:
                del ways[tag]

    def compare(self, now_ns: int) -> list[tuple[str, float | None]]:
        """Compares all cameras, now and then.

        Returns the cameras that have begun to be late, with by how much [s], and with None those
        that are no longer.
        """
        if not self._left:
            if abs(now_ns - self._begun_ns) < 1e9 * EVERY_S:
                return []
            self._begun_ns, self._sure = now_ns, {}
            self._left = [pair for pair in combinations(sorted(self._ways), 2) if self._meet(pair)]
        for pair in self._left[:_PAIRS]:
            lag = self._weigh(pair, now_ns)
            if lag.is_sure:
                self._sure[pair] = lag.lag_s
            if lag.is_sure or not self._lags.get(pair, _UNKNOWN).is_lag:
                self._lags[pair] = lag
        self._left = self._left[_PAIRS:]
        return [] if self._left else self._judge()

    def _meet(self, pair: _Pair) -> bool:
        """Whether two cameras have seen the same robots lately."""
        return not self._ways[pair[0]].keys().isdisjoint(self._ways[pair[1]])

    def _judge(self) -> list[tuple[str, float | None]]:
        """Returns the cameras for which something has changed; see `compare`."""
        changes: list[tuple[str, float | None]] = []
        for camera, late_s in _delays(self._sure).items():
            recent = self._recent.setdefault(camera, deque(maxlen=_TIMES))
            recent.append(late_s)
            if len(recent) < _TIMES or max(recent) - min(recent) > _AGREE_S:
                continue
            if camera not in self.late_s and min(recent) > LEAST_DELAY_S:
                self.late_s[camera] = late_s
                changes.append((camera, late_s))
            elif camera in self.late_s and max(recent) < GONE_S:
                del self.late_s[camera]
                changes.append((camera, None))
        return changes

    def lag(self, first: str, second: str) -> Lag:
        """Returns by how much the first of two cameras is later, as they were compared last.

        The first is that whose id is the lesser.
        """
        both = first in self._ways and second in self._ways
        return self._lags.get((first, second), _OPEN if both else _UNKNOWN)

    def _weigh(self, pair: _Pair, now_ns: int) -> Lag:
        first, second = (self._ways[camera] for camera in pair)
        lag = _lag(first, second)
        met_ns = self._met_ns.setdefault(pair, now_ns)
        return _UNKNOWN if lag.is_open and now_ns - met_ns > 1e9 * _OPEN_S else lag


def _delays(lags: Mapping[_Pair, float]) -> dict[str, float]:
    """Returns how late cameras are; of those that are compared, the earliest is not late."""
    delays: dict[str, float] = {}
    for group in _groups(lags):
        place = {camera: row for row, camera in enumerate(group)}
        mine = {pair: lag for pair, lag in lags.items() if pair[0] in place}
        design = np.zeros((len(mine) + 1, len(group)))
        design[-1] = 1.0
        for row, (first, second) in enumerate(mine):
            design[row, place[first]], design[row, place[second]] = 1.0, -1.0
        solved = np.linalg.lstsq(design, np.array([*mine.values(), 0.0]), rcond=None)[0]
        delays.update(zip(group, (solved - solved.min()).tolist(), strict=True))
    return delays


def _groups(pairs: Iterable[_Pair]) -> list[list[str]]:
    """Returns the cameras that are compared with each other, directly or through others."""
    groups: list[set[str]] = []
    for pair in pairs:
        touched = [group for group in groups if group & set(pair)]
        groups = [group for group in groups if group not in touched]
        groups.append(set(pair).union(*touched))
    return [sorted(group) for group in groups]


def _lag(first: Mapping[int, _Way], second: Mapping[int, _Way]) -> Lag:
    tags = sorted(first.keys() & second.keys())
    every = sum(len(first[tag]) for tag in tags) // _MOST_VIEWS + 1
    ways = [(_rows(islice(first[tag], 0, None, every)), _rows(second[tag])) for tag in tags]
    here = _off(ways, np.array([-_SHARP_S, 0.0, _SHARP_S]))
    if not np.isfinite(here.off_m).all():
        return _OPEN
    if here.off_m.max() < _LEAST_M:
        return _UNKNOWN  # they stand
    if _is_sharp(here.off_m, 1, 1):  # as nearly always
        return Lag(0.0, float(here.apart_m[1]), True)
    off = _off(ways, _SHIFTS_S)
    best, reach = int(off.off_m.argmin()), round(_SHARP_S / _STEP_S)
    if not _is_sharp(off.off_m, best, reach):
        return _OPEN
    vertex = _vertex(off.off_m[best - 1 : best + 2] ** 2)
    return Lag(float(_SHIFTS_S[best]) + _STEP_S * vertex, float(off.apart_m[best]), True)


def _rows(views: Iterable[tuple[int, float, float]]) -> Floats:
    """Returns (n, 3) the views of a way."""
    return np.fromiter(chain.from_iterable(views), np.float64).reshape(-1, 3)


def _is_sharp(off_m: Floats, best: int, reach: int) -> bool:
    """Whether ways fit at one shift, and far worse beside it."""
    if not reach <= best < len(off_m) - reach:
        return False
    beside_m = min(off_m[best - reach], off_m[best + reach])
    finite = np.isfinite(off_m[best - reach : best + reach + 1]).all()
    return bool(finite and max(off_m[best] / _EXPLAINED, _LEAST_M) < beside_m)


class _Off(NamedTuple):
    """For each of (k,) shifts, what the calibration leaves of the gaps [m], and their mean [m]."""

    off_m: Floats
    apart_m: Floats


def _off(ways: Sequence[tuple[Floats, Floats]], shifts_s: Floats) -> _Off:
    """Compares two cameras' ways of some robots, (n, 3) and (m, 3) each: times [ns], x, y."""
    off = _Off(np.full(len(shifts_s), np.inf), np.zeros(len(shifts_s)))
    if not ways:
        return off
    gap = np.concatenate([_gaps(*way, shifts_s) for way in ways], axis=1)
    place = np.concatenate([first[:, 1:] for first, _ in ways])
    for row, gaps in enumerate(gap):
        valid = np.isfinite(gaps[:, 0])
        if valid.sum() >= _LEAST_VIEWS:
            # A wrong calibration maps places; robots that all drive in one circle tell no time.
            form = np.column_stack((np.ones(valid.sum()), place[valid] - place[valid].mean(axis=0)))
            shares, *_ = np.linalg.lstsq(form, gaps[valid], rcond=None)
            left = gaps[valid] - form @ shares
            off.off_m[row] = np.sqrt((left**2).sum(axis=1).mean())
            off.apart_m[row] = np.hypot(*shares[0])
    return off


def _gaps(first: Floats, second: Floats, shifts_s: Floats) -> Floats:
    """Returns where the first camera sees a robot minus where the second has seen it before.

    The ways are those of `_off`. Returns (shifts, n, 2), NaN where the second did not see it then.
    """
    time_s, known_s = 1e-9 * (first[:, 0] - first[0, 0]), 1e-9 * (second[:, 0] - first[0, 0])
    wanted_s = time_s - shifts_s[:, np.newaxis]
    if len(known_s) < 2:
        return np.full((*wanted_s.shape, 2), np.nan)
    after = np.searchsorted(known_s, wanted_s)
    is_between = (after > 0) & (after < len(known_s))
    after = np.clip(after, 1, len(known_s) - 1)
    is_between &= known_s[after] - known_s[after - 1] < _NEXT_S
    seen = np.stack([np.interp(wanted_s, known_s, second[:, axis]) for axis in (1, 2)], axis=-1)
    return np.where(is_between[..., np.newaxis], first[:, 1:] - seen, np.nan)


def _vertex(values: Floats) -> float:
    """Returns where the parabola through three values has its least, from the middle one."""
    bend = values[0] - 2.0 * values[1] + values[2]
    return float(0.5 * (values[0] - values[2]) / bend) if bend > 0.0 else 0.0
