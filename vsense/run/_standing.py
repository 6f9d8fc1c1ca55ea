"""Decides which robots stand while others run, and why: the only place that does.

Whoever is not seen may be carried away, under a table, or on its way to the stairs. Its readings
are old, and nobody knows what it drives at. Whoever is where no robot may be is seen, and stands
all the same. A robot for which several rows hold stands until none does.

| robot | stands |
| --- | --- |
| not seen for `unseen_s` | until it was seen in `SIGHTINGS` arena states in a row |
| not seen yet in this run | the same, counted from its start |
| outside of the fence, or in a forbidden zone | until it was seen in `SIGHTINGS` states in a row where it may be, by `MARGIN_M` |
| too near to what it keeps off | the same, also on its way home |
| last seen at such a place, and not since | yes |
| seen where it may be, or not seen for a shorter time | no |
| while no arena state comes at all | by itself, 0.4 s after its last fresh STATE |
| on its way home | by the guide (`vsense.run.homing`), which moves nobody that is not seen, and leads it back inside of the fence |
| virtual | no: it has no body |
| with the original's client | no: it cannot be held |
| left out of the run, its battery is low | no: it stands anyway |
| not seen, with `unseen_s` None (`vs:unseen="drive"`) | no |
"""  # noqa: E501 (a table)

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import ArenaState
from vsense.config.specs import Experiment

SIGHTINGS = 3
"""So many arena states in a row in which a robot is free of a cause: one may be an error."""
MARGIN_M = 0.02
"""So far inside of a limit a robot goes on: at the limit itself, errors would have it start and
stop."""
MEMORY_NS = 5_000_000_000
"""What robots keep off is where it was seen last, for so long."""

MOST_STEP_NS = 300_000_000
"""Of the time between two arena states so much counts: in a longer one nobody could be seen."""

NOT_SEEN = "not seen"


class _Cause:
    """For one cause, who stands.

    Attributes:
        whys: of those that stand now, in words, by tag.
        stood_ns: how long each robot has stood, by tag; none that never did.
    """

    def __init__(self) -> None:
        self.whys: dict[int, str] = {}
        self.stood_ns: dict[int, int] = {}
        self._free = Counter[int]()

    def update(self, tag: int, why: str, is_free: bool, elapsed_ns: int) -> bool:
        """Takes why a robot has to stand now, "": it need not; gives whether that is new.

        From then on it stands until it is free in `SIGHTINGS` states in a row.
        """
        self._free[tag] = self._free[tag] + 1 if is_free else 0
        if tag not in self.whys and not why:
            return False
        before = self.stood_ns.get(tag, 0)
        was_standing = tag in self.whys
        self.stood_ns[tag] = before + (elapsed_ns if was_standing else 0)
        if self._free[tag] >= SIGHTINGS:
            del self.whys[tag]
        else:
            self.whys[tag] = why or self.whys[tag]
        return was_standing != (tag in self.whys)


class StandingRobots:
    """Watches where robots are, and which of them are seen, while a run goes on.

    Args:
        experiment: whose robots these are, with its fence.

    Attributes:
        reasons: why robots stand now, in words, by tag.
    """

    def __init__(self, experiment: Experiment) -> None:
        self._robots = [robot.tag for robot in experiment.robots]
        tags, self._fence = experiment.tags, experiment.fence
        called = {id: id for id in tags} | {r.id: f"robot {r.tag}" for r in experiment.robots}
        keep_off = self._fence.keep_off.items()
        # A robot that does not play has no place.
        self._keep_off = {tags[id]: (called[id], far_m) for id, far_m in keep_off if id in tags}
        limit_s = experiment.unseen_s
        self._limit_ns = None if limit_s is None else round(limit_s * 1e9)
        self._last_places: dict[int, tuple[int, NDArray[np.float64]]] = {}
        self.begin()

    def begin(self) -> None:
        """A run begins: nobody stands, and all may go on unseen for a while."""
        self.reasons: Mapping[int, str] = {}
        self._unseen, self._fenced = _Cause(), _Cause()
        self._unseen_ns = Counter[int]()
        self._state_ns: int | None = None

    def stood_s(self, tag: int) -> tuple[float, float]:
        """How long a robot has stood in this run because it was not seen, and for the fence."""
        unseen, fenced = (cause.stood_ns.get(tag, 0) for cause in (self._unseen, self._fenced))
        return unseen / 1e9, fenced / 1e9

    def update(
        self, state: ArenaState, homing: bool = False, exempt: Collection[int] = ()
    ) -> list[str]:
        """Takes the next arena state; gives a line for each robot that stands, or goes on.

        A time without arena states, or in which the run is paused, counts for nobody. On the way
        home (`homing`) robots stand only for what they keep off. Nothing is said of those that are
        `exempt`, by tag: they stand anyway, or cannot be held.
        """
        now_ns, before_ns = state.capture_ns, self._state_ns
        self._state_ns = now_ns
        elapsed_ns = 0 if before_ns is None else min(now_ns - before_ns, MOST_STEP_NS)
        rows = state.robots[state.robots["seen"]]
        whys, free = self._places(rows, now_ns, homing)
        seen = set(rows["tag"].tolist())
        lines: list[str] = []
        for tag in self._robots:
            if tag in exempt:
                continue
            self._unseen_ns[tag] = 0 if tag in seen else self._unseen_ns[tag] + elapsed_ns
            lost = self._lost(tag) if not homing else ""
            if self._unseen.update(tag, lost, tag in seen, elapsed_ns):
                lines.append(self._line(tag, self._unseen, "is seen again"))
            if self._fenced.update(tag, whys.get(tag, ""), tag in free, elapsed_ns):
                lines.append(self._line(tag, self._fenced, "is where it may be"))
        self.reasons = {**self._fenced.whys, **dict.fromkeys(self._unseen.whys, NOT_SEEN)}
        return lines

    def pause(self) -> None:
        """The run is paused: the time until its next arena state counts for nobody."""
        self._state_ns = None

    def _lost(self, tag: int) -> str:
        """Why a robot has to stand that is not seen; "": it is, or not for long enough."""
        unseen_ns = self._unseen_ns[tag]
        is_lost = self._limit_ns is not None and unseen_ns >= self._limit_ns
        return f"{NOT_SEEN} for {unseen_ns / 1e9:.1f} s" if is_lost else ""

    def _line(self, tag: int, cause: _Cause, again: str) -> str:
        if tag in cause.whys:
            return f"robot {tag} stands: {cause.whys[tag]}"
        stands = any(tag in other.whys for other in (self._unseen, self._fenced))
        stood = f"it stood {cause.stood_ns[tag] / 1e9:.1f} s"
        return f"robot {tag} {again}{'' if stands else ' and goes on'}; {stood}"

    def _places(
        self, rows: NDArray[np.void], now_ns: int, homing: bool
    ) -> tuple[dict[int, str], set[int]]:
        """Of those that are seen, by tag why each may not be where it is; and who is well inside.

        `rows` are of an arena state, of what is seen.
        """
        tags = rows["tag"]
        points = np.stack((rows["x_m"], rows["y_m"]), axis=-1)
        for tag in self._keep_off:
            for point in points[tags == tag]:
                self._last_places[tag] = now_ns, point
        whys, free = dict[int, str](), set(tags.tolist())
        for why, depths_m in self._depths(tags, points, now_ns, homing):
            whys |= dict.fromkeys(tags[depths_m < 0.0].tolist(), why)
            free -= set(tags[depths_m < MARGIN_M].tolist())
        return whys, free

    def _depths(
        self, tags: NDArray[np.void], points: NDArray[np.float64], now_ns: int, homing: bool
    ) -> Iterator[tuple[str, NDArray[np.float64]]]:
        """For every limit its name, and how far from it each robot is, negative: beyond."""
        if not homing:
            yield "outside of the fence", self._fence.boundary.depth_m(points)
            for number, zone in enumerate(self._fence.forbidden, 1):
                yield f"in forbidden zone {number}", -zone.depth_m(points)
        for tag, (name, far_m) in self._keep_off.items():
            seen_ns, place = self._last_places.get(tag, (0, None))
            if place is not None and now_ns - seen_ns <= MEMORY_NS:
                away_m = np.linalg.norm(points - place, axis=-1) - far_m
                yield f"nearer than {far_m:g} m to {name}", np.where(tags == tag, np.inf, away_m)
