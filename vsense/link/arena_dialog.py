"""The client's side of the original protocol without its socket: what to ask, what to believe.

Before a run it asks for single states (ONE_SHOT) and waits for those of timestep 0, as the
original's client does; in a run it takes the stream.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

from vsense.arena import ArenaState
from vsense.link.arena_repair import Repair
from vsense.link.arena_wire import Command, Report, StateInbox, decode_state
from vsense.link.status import LinkError

PERIOD_NS = 100_000_000
"""Between two ONE_SHOTs: the original's timestep."""
JUMP_MAX = 100_000
"""Timesteps that a tracker can have left out."""


@dataclass(slots=True)
class DialogCounters:
    """What came so far.

    Attributes:
        states: arena states taken.
        skipped: of these, not given out because a newer one was there already.
        ignored: states that do not belong to the present mode: of a run that is over, or
            repeated.
    """

    states: int = 0
    skipped: int = 0
    ignored: int = 0


class ArenaDialog:
    """What is said on one connection after another.

    Attributes:
        running: whether the tracker shall be in a run; set by the user.
        over: the tracker has ended the run; cleared by the user.
        counters: what came so far.
        repair: makes arena states of reports.
    """

    def __init__(
        self, tags: Collection[int], latency_ns: int, origin_m: tuple[float, float] = (0.0, 0.0)
    ) -> None:
        """Begins without a connection.

        Args:
            tags: the tags of the experiment.
            latency_ns: from the middle of an exposure to the arrival of its state.
            origin_m: where the arena's origin lies in the tracker's frame.
        """
        self.running = False
        self.over = False
        self.counters = DialogCounters()
        self.repair = Repair(tags)
        self._latency_ns = latency_ns
        self._origin_m = origin_m
        self._timestep = -1
        self._capture_ns = 0
        self.connected(0)

    def connected(self, now_ns: int) -> None:
        """Begins again: nothing has been said on this connection yet."""
        self._inbox = StateInbox()
        self._streaming = False
        self._asked = False
        self._theirs: int | None = None
        self._due_ns = now_ns

    @property
    def due_ns(self) -> int | None:
        """When there is something to ask; None: it is the tracker's turn."""
        return None if self._streaming or self._asked else self._due_ns

    def command(self, now_ns: int) -> Command | None:
        """Gives what the tracker has to be told now."""
        if self._streaming != self.running:
            self._streaming, self._asked, self._theirs = self.running, False, None
            self._due_ns = now_ns
            return Command.START_EXPERIMENT if self.running else Command.STOP_EXPERIMENT
        if self._streaming or self._asked or now_ns < self._due_ns:
            return None
        self._asked, self._due_ns = True, now_ns + PERIOD_NS
        return Command.ONE_SHOT

    def receive(self, data: bytes, now_ns: int) -> ArenaState | None:
        """Takes bytes of the tracker in; gives the newest arena state in them.

        Raises:
            LinkError: the tracker does not speak the protocol; the connection is lost.
        """
        newest = None
        for body in self._inbox.feed(data):
            state = self._take(body, now_ns)
            self.counters.skipped += newest is not None and state is not None
            newest = state or newest
        return newest

    def _take(self, body: bytes, now_ns: int) -> ArenaState | None:
        """Makes an arena state of a message, if it belongs to what was asked for."""
        self._asked = False
        if not body:
            # Length 0: the tracker has ended the run, unless we have done so already.
            if self._streaming:
                self.running, self._streaming, self.over = False, False, True
            return None
        theirs, reports = decode_state(body)
        if theirs == self._theirs or (theirs != 0) != self._streaming:
            self.counters.ignored += 1
            return None
        return self._state(self._step(theirs, now_ns), reports, now_ns)

    def _step(self, theirs: int, now_ns: int) -> int:
        """How many timesteps have passed since the last state."""
        if not self._streaming:
            return 1
        known, self._theirs = self._theirs, theirs
        if known is None or theirs < known:
            # A new run counts from 0: only the clock knows.
            return max(1, round((now_ns - self._capture_ns) / PERIOD_NS))
        if theirs - known > JUMP_MAX:
            raise LinkError(f"an arena state of timestep {theirs} after {known}")
        return theirs - known

    def _state(self, step: int, reports: Sequence[Report], now_ns: int) -> ArenaState:
        self._timestep += step
        self._capture_ns = max(self._capture_ns, now_ns - self._latency_ns)
        self.counters.states += 1
        x_m, y_m = self._origin_m
        ours = [replace(r, x_m=r.x_m - x_m, y_m=r.y_m - y_m) for r in reports]
        return self.repair.update(ours, self._timestep, self._capture_ns)
