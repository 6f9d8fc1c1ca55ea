"""What a person sees on standard error while robots are tracked: rate, health, progress."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable

from vsense.arena import ArenaState
from vsense.console import Console
from vsense.tracking.counters import TrackerCounters
from vsense.tracking.grabbers import CameraEvent
from vsense.tracking.troubles import Troubles

BAR_WIDTH = 24

_WINDOW_NS = 2_000_000_000
_DRAW_NS = 100_000_000


class Talk:
    """Keeps the live line up to date and says once what need not be said for ever."""

    def __init__(
        self,
        console: Console,
        clock: Callable[[], int],
        timesteps: int | None,
        troubles: Troubles | None = None,
    ) -> None:
        """Begins the count.

        Args:
            console: where to talk.
            clock: the host's monotonic clock [ns].
            timesteps: how many there will be, or None.
            troubles: where to count what happens to cameras; None: where nobody else looks.
        """
        self._console = console
        self._clock = clock
        self._timesteps = timesteps
        self._begun_ns = clock()
        self._drawn_ns = 0
        self._done = 0
        self._pictures = 0
        self._detected = 0
        self._recent: deque[tuple[int, int]] = deque()
        self._troubles = troubles or Troubles()
        self._joined: set[int] = set()

    def say(self, text: str) -> None:
        """Says something of its own."""
        self._console.say(f"vsense: {text}")

    def events(self, events: Iterable[CameraEvent]) -> None:
        """Says what happened to cameras, the same trouble only a few times."""
        for line in self._troubles.lines(events):
            self.say(line)

    def timestep(self, state: ArenaState, pictures: int) -> None:
        """Counts a timestep and draws the live line now and then."""
        now_ns = self._clock()
        self._done += 1
        self._pictures += pictures
        self._detected += state.detected
        for tag in sorted(set(state.joined) - self._joined):
            self.say(f"robot {tag} was not on the roster and has joined")
        self._joined.update(state.joined)
        self._recent.append((now_ns, pictures))
        while now_ns - self._recent[0][0] > _WINDOW_NS:
            self._recent.popleft()
        if now_ns - self._drawn_ns >= _DRAW_NS or self._done == self._timesteps:
            self._drawn_ns = now_ns
            self._console.progress(self._line(state, pictures, now_ns))

    def recorded(self, dropped: int) -> None:
        """Says how complete a recording is."""
        if dropped:
            self.say(f"the disk was too slow: {dropped} timesteps were not recorded")

    def summary(self, missed: int, counters: TrackerCounters) -> None:
        """Says what was done in all.

        Args:
            missed: timesteps that were left out.
            counters: what the tracker has noticed.
        """
        self._console.end_progress()
        elapsed_s = max((self._clock() - self._begun_ns) / 1e9, 1e-9)
        per_timestep = self._detected / max(self._done, 1)
        self.say(
            f"{self._done} timesteps, {self._pictures} pictures in {elapsed_s:.1f} s:"
            f" {self._done / elapsed_s:.1f} timesteps/s, {self._pictures / elapsed_s:.1f}"
            f" pictures/s; {per_timestep:.2f} robots detected per timestep"
        )
        if missed:
            self.say(f"{missed} timesteps were left out to keep pace; --offline takes them all")
        for note in [*counters.notes(), *self._troubles.summary()]:
            self.say(note)

    def _line(self, state: ArenaState, pictures: int, now_ns: int) -> str:
        rate = self._rate(now_ns)
        robots = state.robots
        facts = f"{rate:.1f} timesteps/s, {pictures} cameras, {int(robots['seen'].sum())} robots"
        lost = [str(tag) for tag in robots["tag"][~robots["seen"]]]
        if lost:
            facts += f", lost: {', '.join(lost[:6])}{' ...' if len(lost) > 6 else ''}"
        if self._timesteps is None:
            return f"timestep {state.timestep}: {facts}"
        share = self._done / max(self._timesteps, 1)
        bar = ("#" * round(share * BAR_WIDTH)).ljust(BAR_WIDTH, "-")
        left_s = (self._timesteps - self._done) / rate if rate else 0.0
        return f"[{bar}] {self._done}/{self._timesteps}: {facts}, {left_s:.0f} s left"

    def _rate(self, now_ns: int) -> float:
        """Timesteps per second over the last two seconds."""
        since_ns = self._recent[0][0] if self._done > len(self._recent) else self._begun_ns
        counted = len(self._recent) - (self._done > len(self._recent))
        return counted / max((now_ns - since_ns) / 1e9, 1e-6)
