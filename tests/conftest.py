"""What all tests share: arena states made by hand, and what happens where a tool is missing."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Mapping

import numpy as np
import pytest
from hypothesis import settings

from vsense.arena import POSE, ArenaState

# A busy machine is no defect: no property has to hold within a wall-clock time.
settings.register_profile("vsense", deadline=None)
settings.load_profile("vsense")


def require_tool(name: str, package: str) -> str:
    """Gives the tool's path, or skips the test (under CI: fails it), naming the Debian package."""
    path = shutil.which(name)
    if path is None:
        text = f"needs {name}: apt install {package}"
        if os.environ.get("CI"):
            pytest.fail(text)
        pytest.skip(text)
    return path


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
