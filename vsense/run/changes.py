"""Changes that people ask for while a run goes on: from their threads into that of the timesteps.

What was carried out is noted with the timestep in which it took effect: the same arena states, the
same deeds of the robots and the same changes give the same readings again
(`vsense.monitor.recording.resense`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from vsense.base.clock import host_ns
from vsense.base.errors import VsenseError
from vsense.run.changing import HANDS, Change, ChangeKind, Ground, carry_out, settings_of
from vsense.run.environment import Environment
from vsense.run.orders import OrderError, RequestQueue

MOST_WAITING = 64
"""Changes that wait for the next timestep; more are refused."""
MOST_AT_ONCE = 8
"""So many are carried out before one timestep: people's hands must not make it late."""
DRAG_TIMEOUT_NS = 1_000_000_000
"""Only the end of a drag is reported; without an end the last place is, after so long."""

ResultCallback = Callable[[str, bool], None]
"""Takes the result of a change, and whether it was carried out; in any thread."""
Ask = Callable[[Change, str, ResultCallback], None]
"""Requests a change, by somebody; see `Changes.ask`."""


class CarriedOut(NamedTuple):
    """A change, who wanted it, and the arena state's and the run's timestep that it came before."""

    timestep: int
    run_timestep: int
    by: str
    change: Change
    text: str

    def data(self) -> dict[str, Any]:
        """The data of `/orders`."""
        return {**self._asdict(), "change": self.change.data()}


class _Request(NamedTuple):
    change: Change
    by: str
    answer: ResultCallback


class Changes:
    """Takes changes from any thread, and carries them out between two timesteps.

    Args:
        say: takes a line for people, in the thread of the timesteps.
        locked: nothing may be changed.
        ground: what of the real arena follows.
        clock: host's monotonic clock [ns].

    Attributes:
        version: grows with everything that was carried out.
        carried: so many were carried out in the present world.
        notes: each takes what was carried out, in the thread of the timesteps.
    """

    def __init__(
        self,
        say: Callable[[str], None],
        locked: bool = False,
        ground: Ground = HANDS,
        clock: Callable[[], int] = host_ns,
    ) -> None:
        self.version = self.carried = 0
        self.notes: list[Callable[[CarriedOut], None]] = []
        self._say, self._locked, self._ground, self._clock = say, locked, ground, clock
        self._requests: RequestQueue[_Request] = RequestQueue()
        self._drags: dict[str, tuple[int, str]] = {}

    def ask(self, change: Change, by: str, answer: ResultCallback) -> None:
        """Takes a change by somebody, which `answer` hears of.

        Raises:
            OrderError: nothing can be changed, or too much waits.
        """
        if self._locked:
            raise OrderError(
                "this run is locked (--locked): nothing of its world can be changed while it runs"
            )
        self._requests.put(_Request(change, by, answer), _check_waiting)

    def carry_out(self, environment: Environment, timestep: int, run_timestep: int) -> None:
        """Changes the world before a timestep; to be called in the thread of the timesteps."""
        for request in self._requests.take(MOST_AT_ONCE):
            try:
                text = carry_out(request.change, environment, self._ground)
            except VsenseError as error:
                request.answer(str(error), False)
                continue
            self.version += 1
            self.carried += 1
            done = CarriedOut(timestep, run_timestep, request.by, request.change, text)
            for note in self.notes:
                note(done)
            request.answer(text, True)
            self._report(request, text)
        for name, (since_ns, line) in list(self._drags.items()):
            if self._clock() - since_ns > DRAG_TIMEOUT_NS:
                del self._drags[name]
                self._say(line)

    def settings(self, environment: Environment) -> dict[str, Any]:
        """See `settings_of`."""
        return settings_of(environment, self._ground, self._locked)

    def _report(self, request: _Request, text: str) -> None:
        line = f"{request.by}: {text}"
        if request.change.kind is ChangeKind.MOVE and not request.change.final:
            self._drags[request.change.name] = self._clock(), line
            return
        self._drags.pop(request.change.name, None)
        self._say(line)


def _check_waiting(pending: Sequence[_Request]) -> None:
    if len(pending) >= MOST_WAITING:
        raise OrderError("too many changes wait for the next timestep: try again")
