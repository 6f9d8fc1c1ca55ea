"""Last sightings of tagged things: POSE arrays that outlive the arena states."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.arena import POSE
from vsense.world.entities import VirtualRobot

NEVER_NS = -1
"""Capture time of what no camera has seen yet."""


def unseen(tags: Sequence[int]) -> NDArray[np.void]:
    """A POSE array of things that no camera has seen yet."""
    poses = np.zeros(len(tags), dtype=POSE)
    poses["tag"] = tags
    poses["capture_ns"] = NEVER_NS
    return poses


def update_poses(kept: NDArray[np.void], seen: NDArray[np.void]) -> None:
    """Overwrites the kept rows of the tags that a camera saw; the others stay, not seen.

    Both are POSE arrays; `kept` is changed in place, `seen` is sorted by tag.
    """
    kept["seen"] = False
    if len(seen) == 0:
        return
    place = np.minimum(np.searchsorted(seen["tag"], kept["tag"]), len(seen) - 1)
    fresh = seen["seen"][place] & (seen["tag"][place] == kept["tag"])
    kept[fresh] = seen[place[fresh]]


def known(poses: NDArray[np.void], now_ns: int, memory_ns: int) -> NDArray[np.bool_]:
    """Which things' last sighting is at most memory_ns older than now_ns."""
    captures_ns = poses["capture_ns"]
    return np.asarray((captures_ns != NEVER_NS) & (now_ns - captures_ns <= memory_ns))


def standing(robots: Sequence[VirtualRobot], now_ns: int) -> NDArray[np.void]:
    """The POSE array of virtual robots: always seen, with full confidence."""
    poses = unseen([robot.tag for robot in robots])
    poses["capture_ns"], poses["seen"], poses["confidence"] = now_ns, True, 1.0
    for pose, robot in zip(poses, robots):
        pose["x_m"], pose["y_m"], pose["yaw_rad"] = robot.x_m, robot.y_m, robot.yaw_rad
    return poses


def in_order(poses: NDArray[np.void], tags: Sequence[int]) -> NDArray[np.void]:
    """The rows of tags in their order; a tag that is not there was never seen."""
    first = poses[: len(tags)]
    if first["tag"].tolist() == list(tags):
        return first
    return carried(poses, poses["tag"].tolist(), tags, unseen(tags))


def carried(
    kept: NDArray[Any],
    before: Sequence[int],
    after: Sequence[int],
    rows: NDArray[Any] | None = None,
) -> NDArray[Any]:
    """Moves rows of the tags `before` to those of `after`; new tags have theirs of `rows`, or 0."""
    if rows is None:
        rows = np.zeros((len(after), *kept.shape[1:]), dtype=kept.dtype)
    places = {tag: row for row, tag in enumerate(before)}
    for row, tag in enumerate(after):
        if tag in places:
            rows[row] = kept[places[tag]]
    return rows


def read_only(poses: NDArray[np.void]) -> NDArray[np.void]:
    """A view that cannot be written to."""
    view: NDArray[np.void] = poses.view()
    view.flags.writeable = False
    return view
