"""Arena states made by hand."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pytest

from vsense.arena import POSE, ArenaState

Place = tuple[float, float, float]
States = Callable[..., ArenaState]


@pytest.fixture(scope="session")
def state() -> States:
    """Makes an arena state: `places` by tag, all seen now but those in `lost`."""

    def make(
        places: Mapping[int, Place], capture_ns: int, lost: frozenset[int] = frozenset()
    ) -> ArenaState:
        robots = np.zeros(len(places), dtype=POSE)
        for row, (tag, place) in zip(robots, sorted(places.items())):
            row["tag"], row["seen"], row["capture_ns"] = tag, tag not in lost, capture_ns
            row["x_m"], row["y_m"], row["yaw_rad"] = place
        return ArenaState(capture_ns // 10**8, capture_ns, robots, len(places) - len(lost))

    return make
