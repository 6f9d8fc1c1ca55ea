"""Who heard whom, when, and what was lost: of the readings of range and bearing in a recording.

A message does not name its sender: it is the robot that stands where range and bearing say, at the
time of the reading. Who was within reach and was not heard was lost: by chance, behind a body, or
for want of a place. Robots without a marker are not in a recording's arena states, so what virtual
ones say has no sender.
"""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from vsense.monitor.recording.form import ExperimentMessage

COLUMNS = ("timestep", "tag", "sender", "heard", "distance_m", "range_m", "bearing_rad", "age_s")
"""Of heard.csv, after the time."""

SENSOR = "range_and_bearing"
_NEAR_M = 0.1
"""A sender is at most so far from where its message comes from: noise, and moves meanwhile."""
_KEPT = 64
_REACH = re.compile(r'(?:range_and_bearing[^>]*?\srange|\srab_range)="([0-9.eE+-]+)"')

_SIZE = re.compile(r'(?:range_and_bearing[^>]*?\sdata_size|\srab_data_size)="(\d{1,3})"')
"""What a file says of its reach [m], and of the bytes of a message."""
_USUAL_REACH_M, _USUAL_BYTES = 0.8, 4

Pose = tuple[float, float, float]


class Hearing:
    """Follows arena states, and makes rows of readings; for one thread."""

    def __init__(self, experiment: ExperimentMessage) -> None:
        self._radius_m = {
            int(row["tag"]): float(row.get("radius_m") or experiment.body_radius_m or 0.0)
            for row in experiment.robots
        }
        said = [float(text) for text in _REACH.findall(experiment.file_text)]
        self._reach_m = max(said, default=_USUAL_REACH_M)
        sizes = [int(text) for text in _SIZE.findall(experiment.file_text)]
        self._place = 2 + max(sizes, default=_USUAL_BYTES)
        self._states: deque[tuple[int, dict[int, Pose]]] = deque(maxlen=_KEPT)

    def see(self, data: Mapping[str, Any]) -> None:
        """Takes an arena state."""
        robots = data["robots"]
        columns = (robots[name] for name in ("tag", "x_m", "y_m", "yaw_rad"))
        poses = {tag: (x, y, yaw) for tag, x, y, yaw in zip(*columns) if tag in self._radius_m}
        self._states.append((int(data["capture_ns"]), poses))

    def rows(
        self, data: Mapping[str, Any], tag: int, numbers: Sequence[float], taken_ns: int
    ) -> Iterator[list[Any]]:
        """One robot's reading: a row for each message, and for each robot that was not heard."""
        if taken_ns < 0 or not self._states or not numbers:
            return
        poses = min(self._states, key=lambda state: abs(state[0] - taken_ns))[1]
        if tag not in poses:
            return
        age_s = (data["capture_ns"] - taken_ns) / 1e9
        missing = {other: pose for other, pose in poses.items() if other != tag}
        distances = {other: math.dist(poses[tag][:2], p[:2]) for other, p in missing.items()}
        for range_m, bearing_rad in self._messages(numbers):
            sender = self._sender(tag, poses[tag], range_m, bearing_rad, missing)
            missing.pop(sender, None)
            far = distances.get(sender)
            head = [data["timestep"], tag, None if sender < 0 else sender]
            yield [*head, 1, far, range_m, bearing_rad, age_s]
        for other in sorted(missing):
            if distances[other] < self._reach_m:
                yield [data["timestep"], tag, other, 0, distances[other], None, None, age_s]

    def _messages(self, numbers: Sequence[float]) -> Iterator[tuple[float, float]]:
        """Range [m] and bearing [rad] of each message: their number comes first, then places."""
        if (len(numbers) - 1) % self._place:
            raise ValueError(f"{len(numbers)} numbers, expected places of {self._place}")
        for at in range(1, 1 + round(numbers[0]) * self._place, self._place):
            yield numbers[at] / 100.0, numbers[at + 1]

    def _sender(
        self, tag: int, pose: Pose, range_m: float, bearing_rad: float, others: Mapping[int, Pose]
    ) -> int:
        """The nearest robot to where a message comes from; -1: none is near."""
        x, y, yaw = pose
        nearest, least_m = -1, _NEAR_M
        for other, (other_x, other_y, _) in others.items():
            # The range is between the two bodies, not between their middles.
            far = range_m + self._radius_m[tag] + self._radius_m[other]
            at = x + far * math.cos(yaw + bearing_rad), y + far * math.sin(yaw + bearing_rad)
            off_m = math.dist(at, (other_x, other_y))
            if off_m < least_m:
                nearest, least_m = other, off_m
        return nearest
