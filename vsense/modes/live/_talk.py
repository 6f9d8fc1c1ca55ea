"""What a person is told while robots are tracked: the live line, who joined, and the summary."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from vsense.base.arena import ArenaState
from vsense.base.terminal import Console
from vsense.monitor.recording import calibration_words
from vsense.run.control import Control, State
from vsense.vision.calibration.checked import of_tracking
from vsense.vision.cameras.grabber import Troubles
from vsense.vision.tracking.arena_tracker import TrackerCounters
from vsense.vision.tracking.specs import TrackingSession

BAR_WIDTH = 24

_WINDOW_NS = 2_000_000_000
_DRAW_NS = 100_000_000


class Talk:
    """Keeps the live line up to date; says once which robots have joined."""

    def __init__(self, console: Console, clock: Callable[[], int], timesteps: int | None) -> None:
        """`clock` is monotonic [ns]; `timesteps` None: it is not known how many there will be."""
        self._console = console
        self._clock = clock
        self._timesteps = timesteps
        self._begun_ns = clock()
        self._last_ns = self._begun_ns
        self._spent_ns = 0
        self._drawn_ns = 0
        self._done = 0
        self._pictures = 0
        self._detected = 0
        self._recent: deque[int] = deque()
        self._joined: set[int] = set()

    def say(self, text: str) -> None:
        """Says something of its own."""
        self._console.say(f"vsense: {text}")

    def timestep(self, state: ArenaState, pictures: int) -> None:
        """Counts a timestep and draws the live line now and then."""
        now_ns = self._clock()
        self._spent_ns += now_ns - self._last_ns
        self._last_ns = now_ns
        self._done += 1
        self._pictures += pictures
        self._detected += state.detected
        for tag in sorted(set(state.joined) - self._joined):
            self.say(f"robot {tag} was not on the roster and has joined")
        self._joined.update(state.joined)
        self._recent.append(now_ns)
        while now_ns - self._recent[0] > _WINDOW_NS:
            self._recent.popleft()
        if now_ns - self._drawn_ns >= _DRAW_NS or self._done == self._timesteps:
            self._drawn_ns = now_ns
            self._console.progress(self._line(state, pictures, now_ns))

    def expect(self, timesteps: int | None) -> None:
        """Takes how many timesteps there will be, None: nobody knows."""
        self._timesteps = timesteps

    def rest(self, control: Control, state: ArenaState) -> None:
        """Draws the live line of a timestep that belongs to no run."""
        self._last_ns = now_ns = self._clock()
        if now_ns - self._drawn_ns >= _DRAW_NS:
            self._drawn_ns = now_ns
            words = {State.PAUSED: "suspended", State.ENDED: "ended"}.get(control.state, "waits")
            seen = int(state.robots["seen"].sum())
            self._console.progress(f"run {control.run} {words}: {seen} robots seen")

    def summary(self, missed: int, counters: TrackerCounters, troubles: Troubles) -> None:
        """Says what was done in all; `missed` timesteps were left out."""
        self._console.end_progress()
        elapsed_s = max(self._spent_ns / 1e9, 1e-9)
        per_timestep = self._detected / max(self._done, 1)
        self.say(
            f"{self._done} timesteps, {self._pictures} pictures in {elapsed_s:.1f} s:"
            f" {self._done / elapsed_s:.1f} timesteps/s, {self._pictures / elapsed_s:.1f}"
            f" pictures/s; {per_timestep:.2f} robots detected per timestep"
        )
        if missed:
            self.say(f"{missed} timesteps were left out to keep pace; --offline takes them all")
        for note in [*counters.notes(), *troubles.summary()]:
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
        left_s = (self._timesteps - self._done) / rate
        return f"[{bar}] {self._done}/{self._timesteps}: {facts}, {left_s:.0f} s left"

    def _rate(self, now_ns: int) -> float:
        """Timesteps per second over the last two seconds."""
        earlier = self._done > len(self._recent)
        since_ns = self._recent[0] if earlier else self._begun_ns
        counted = len(self._recent) - earlier
        if not counted:  # slower than that: since the beginning
            counted, since_ns = self._done, self._begun_ns
        return counted / max((now_ns - since_ns) / 1e9, 1e-6)


def told_of(session: TrackingSession) -> str:
    """What to say of a session's calibration when it begins; "" where it was never checked."""
    checks = of_tracking(session)
    return calibration_words(checks) if checks["checks"] else ""
