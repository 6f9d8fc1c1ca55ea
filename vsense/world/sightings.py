"""Last sightings of tagged things: POSE arrays that outlive the arena states."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import POSE
from vsense.base.native import kernel_ffi, kernels, pointer
from vsense.world.entities import VirtualRobot

NEVER_NS = -1
"""Capture time of what no camera has seen yet."""


def unseen(tags: Sequence[int]) -> NDArray[np.void]:
    """A POSE array of things that no camera has seen yet."""
    poses = np.zeros(len(tags), dtype=POSE)
    poses["tag"] = tags
    poses["capture_ns"] = NEVER_NS
    return poses


def _fields() -> Any:
    """Where rows of POSE have what C reads and writes: a `struct vs_pose_fields *`."""
    at = {name: offset for name, (_, offset, *_) in (POSE.fields or {}).items()}
    numbers = (at[name] for name in ("tag", "x_m", "speed_m_s", "capture_ns", "seen"))
    return kernel_ffi.new("struct vs_pose_fields *", (POSE.itemsize, *numbers))


POSE_FIELDS = _fields()


class LastSightings:
    """Where robots and tagged things were seen last, as C takes it.

    Attributes:
        count: rows of both.
        cdata: the `struct vs_world *`.
    """

    def __init__(self, robots: NDArray[np.void], real: int, things: NDArray[np.void]) -> None:
        """`robots` and `things` are POSE arrays that change in place, the `real` robots first."""
        self._arrays = robots, things
        self.count = len(robots) + len(things)
        self.cdata: Any = kernel_ffi.new("struct vs_world *")
        self.cdata.fields = POSE_FIELDS
        self.cdata.robots, self.cdata.things = (pointer("uint8_t", rows) for rows in self._arrays)
        self.cdata.real, self.cdata.robots_all = real, len(robots)
        self.cdata.thing_count = len(things)

    def update(self, seen: NDArray[np.void], capture_ns: int) -> None:
        """Overwrites the rows of the tags that a camera saw; the others stay, not seen.

        `seen` is a POSE array sorted by tag. Virtual robots are seen at `capture_ns`.
        """
        rows = np.ascontiguousarray(seen)
        kernels.vs_world_update(self.cdata, pointer("uint8_t", rows), len(rows), capture_ns)


def recent(poses: NDArray[np.void], now_ns: int, memory_ns: int) -> NDArray[np.bool_]:
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
    values: NDArray[Any],
    before: Sequence[int],
    after: Sequence[int],
    rows: NDArray[Any] | None = None,
) -> NDArray[Any]:
    """Moves rows of the tags `before` to those of `after`; new tags have theirs of `rows`, or 0."""
    if rows is None:
        rows = np.zeros((len(after), *values.shape[1:]), dtype=values.dtype)
    places = {tag: row for row, tag in enumerate(before)}
    for row, tag in enumerate(after):
        if tag in places:
            rows[row] = values[places[tag]]
    return rows


def read_only(poses: NDArray[np.void]) -> NDArray[np.void]:
    """A view that cannot be written to."""
    view: NDArray[np.void] = poses.view()
    view.flags.writeable = False
    return view
