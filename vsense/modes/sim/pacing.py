"""How fast a simulation goes that somebody watches: play, pause, single steps, speed."""

from __future__ import annotations

import math

SLOWEST = 0.1
"""Times real time."""
FASTEST = math.inf
"""As fast as it goes."""

FRAME_S = 0.05
"""The page is told the state of the run this often at most."""

_SHARE = 0.5
"""Of what was measured, how much a new stretch's rate counts."""


class SimPace:
    """Says how many timesteps may follow at a time; times [s] are of any steady clock.

    A simulation that cannot keep the speed does not catch up.

    Attributes:
        speed: times real time.
        playing: whether it goes on by itself.
    """

    def __init__(self, timestep_s: float, speed: float = 1.0, playing: bool = True) -> None:
        self.speed, self.playing = speed, playing
        self._timestep_s = timestep_s
        self._steps = 0
        self._due_s: float | None = None
        self._begun_s, self._from = 0.0, -1
        self._rate_hz = 0.0

    def play(self, on: bool) -> None:
        """Goes on by itself, or waits; single steps that were asked for are forgotten."""
        self.playing, self._steps, self._due_s = on, 0, None

    def step(self, count: int = 1) -> None:
        """Pauses, and lets so many more timesteps happen."""
        self.playing, self._due_s = False, None
        self._steps += count

    def set_speed(self, speed: float) -> None:
        """Goes on at so many times real time."""
        self.speed, self._due_s = speed, None

    def grant(self, timestep: int, now_s: float) -> tuple[int, float | None]:
        """How many timesteps may follow now, from this one on; where that is 0, how long to wait.

        None: until something is ordered.
        """
        self._measure(timestep, now_s)
        if self._steps:
            self._steps -= 1
            return 1, None
        if not self.playing:
            return 0, None
        count, wait_s = self._due(now_s)
        if count:
            self._begun_s, self._from = now_s, timestep
        return count, wait_s

    def _due(self, now_s: float) -> tuple[int, float | None]:
        """What `grant` gives while it plays."""
        most = max(int(self._rate_hz * FRAME_S), 1)
        if math.isinf(self.speed):
            return most, None
        period_s = self._timestep_s / self.speed
        if self._due_s is None or now_s - self._due_s > 4.0 * max(period_s, FRAME_S):
            self._due_s = now_s
        if now_s < self._due_s:
            # Those of a frame are made together: nobody sees them one by one.
            return 0, max(self._due_s - now_s, min(FRAME_S, period_s))
        count = min(math.floor((now_s - self._due_s) / period_s) + 1, most)
        self._due_s += count * period_s
        return count, None

    def _measure(self, timestep: int, now_s: float) -> None:
        """Takes the time that the last stretch took."""
        begun_s, first, self._from = self._begun_s, self._from, -1
        if 0 <= first < timestep and now_s > begun_s:
            rate_hz = (timestep - first) / (now_s - begun_s)
            known = _SHARE if self._rate_hz else 1.0
            self._rate_hz += (rate_hz - self._rate_hz) * known
