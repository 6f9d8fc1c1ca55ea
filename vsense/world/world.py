"""The world of one run: what the cameras saw last, and what is not there at all.

It reads no clock: every age follows from the capture times that the arena state carries. The
same arena states therefore give the same world, live and in a replay.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from vsense.arena import POSE, ArenaState
from vsense.world.pollution import Cone, PollutantSource

NEVER_NS = -1
"""Capture time of what no camera has seen yet."""


class World:
    """What virtual sensors read; one `update` per timestep.

    Attributes:
        robots: POSE array, one row per robot of the run in the order of `tags`. `seen` tells
            whether the row is of this timestep; a robot that is not seen keeps its last
            sighting, whose `capture_ns` (NEVER_NS before the first) tells how old it is.
        capture_ns: capture time of the newest arena state, 0 before the first.
        run_timestep: timestep of the run, from 0.
    """

    def __init__(self, tags: Iterable[int], sources: Sequence[PollutantSource] = ()) -> None:
        """Makes an unseen world.

        Args:
            tags: markers of the robots of the run, without repetition.
            sources: what pollutes.
        """
        self.robots = _unseen(list(tags))
        self.capture_ns = 0
        self.run_timestep = 0
        self._sources = tuple(sources)
        self._source_poses = _unseen([source.tag for source in self._sources])

    def update(self, state: ArenaState, run_timestep: int) -> None:
        """Takes over what the cameras saw.

        Args:
            state: the arena state of this timestep.
            run_timestep: timestep of the run, from 0; 0 also before the run.
        """
        self.capture_ns = state.capture_ns
        self.run_timestep = run_timestep
        _take(self.robots, state.robots)
        _take(self._source_poses, state.robots)

    def age_ns(self, source: PollutantSource) -> int | None:
        """How old the source's last sighting is; None: it was never seen."""
        captured = int(self._pose(source)["capture_ns"])
        return None if captured == NEVER_NS else self.capture_ns - captured

    def cone(self, source: PollutantSource) -> Cone | None:
        """Gives the polluted triangle of a source.

        A source that is not seen pollutes on from where it was seen last, until that sighting
        is older than the source's `memory_ns`.

        Returns:
            The triangle, or None while there is none.
        """
        age_ns = self.age_ns(source)
        if age_ns is None or age_ns > source.memory_ns:
            return None
        pose = self._pose(source)
        return source.cone_at(float(pose["x_m"]), float(pose["y_m"]), self.run_timestep)

    def _pose(self, source: PollutantSource) -> np.void:
        row: np.void = self._source_poses[self._sources.index(source)]
        return row


def _unseen(tags: list[int]) -> NDArray[np.void]:
    poses = np.zeros(len(tags), dtype=POSE)
    poses["tag"] = tags
    poses["capture_ns"] = NEVER_NS
    return poses


def _take(kept: NDArray[np.void], seen: NDArray[np.void]) -> None:
    """Overwrites the kept rows of the tags that a camera saw; the others stay, not seen.

    Args:
        kept: POSE array, changed in place.
        seen: POSE array sorted by tag.
    """
    kept["seen"] = False
    if len(seen) == 0:
        return
    place = np.minimum(np.searchsorted(seen["tag"], kept["tag"]), len(seen) - 1)
    fresh = seen["seen"][place] & (seen["tag"][place] == kept["tag"])
    kept[fresh] = seen[place[fresh]]
