"""Robots that no camera sees stand: in the run, until they have been seen again.

Whoever is not seen may be carried away, under a table, or on its way to the stairs. Its readings
are old, and nobody knows what it drives at.

| robot | stands |
| --- | --- |
| not seen for `unseen_s` | until it was seen in `SIGHTINGS` arena states in a row |
| not seen yet in this run | the same, counted from its start |
| seen, or not seen for a shorter time | no |
| while no arena state comes at all | by itself, 0.4 s after its last fresh STATE |
| on its way home | by the guide (`vsense.run.homing`), which moves nobody that is not seen |
| virtual | no: it has no body |
| all, with `unseen_s` None (`vs:unseen="drive"`) | no |
"""

from __future__ import annotations

from collections.abc import Mapping

from vsense.base.arena import ArenaState

SIGHTINGS = 3
"""So many arena states in a row in which a robot is seen set it free: one may be an error."""


MOST_STEP_NS = 300_000_000
"""Of the time between two arena states so much counts: in a longer one nobody could be seen."""


class UnseenRobots:
    """Watches which robots are seen while a run goes on.

    Args:
        names: of the real robots, by tag.
        unseen_s: how long a robot may go on unseen [s]; None: for ever.

    Attributes:
        tags: of those that stand now.
        stood_ns: how long each robot has stood for it in this run, by tag; none that never did.
    """

    def __init__(self, names: Mapping[int, str], unseen_s: float | None) -> None:
        self._limit_ns = None if unseen_s is None else round(unseen_s * 1e9)
        self.begin(names)

    def begin(self, names: Mapping[int, str]) -> None:
        """A run with these robots begins: nobody stands, and all may go on unseen for a while."""
        self.tags: frozenset[int] = frozenset()
        self.stood_ns: dict[int, int] = {}
        self._names = names
        self._unseen_ns: dict[int, int] = {}
        self._sightings: dict[int, int] = {}
        self._state_ns: int | None = None

    def update(self, state: ArenaState) -> list[str]:
        """Takes a running run's next arena state; gives a line for each robot that stands, or goes.

        A time without arena states, or in which the run is paused, counts for nobody.
        """
        if self._limit_ns is None:
            return []
        now_ns, before_ns = state.capture_ns, self._state_ns
        self._state_ns = now_ns
        elapsed_ns = 0 if before_ns is None else min(now_ns - before_ns, MOST_STEP_NS)
        seen = set(state.robots["tag"][state.robots["seen"]].tolist())
        lines: list[str] = []
        for tag, name in self._names.items():
            self._sightings[tag] = self._sightings.get(tag, 0) + 1 if tag in seen else 0
            unseen_ns = 0 if tag in seen else self._unseen_ns.get(tag, 0) + elapsed_ns
            self._unseen_ns[tag] = unseen_ns
            if tag in self.tags:
                self.stood_ns[tag] += elapsed_ns
                if self._sightings[tag] >= SIGHTINGS:
                    self.tags -= {tag}
                    stood = f"it stood {self.stood_ns[tag] / 1e9:.1f} s"
                    lines.append(f"robot {name} is seen again and goes on; {stood}")
            elif unseen_ns >= self._limit_ns:
                self.tags |= {tag}
                self.stood_ns.setdefault(tag, 0)
                lines.append(f"robot {name} stands: not seen for {unseen_ns / 1e9:.1f} s")
        return lines

    def pause(self) -> None:
        """The run is paused: the time until its next arena state counts for nobody."""
        self._state_ns = None
