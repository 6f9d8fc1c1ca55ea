"""Who heard whom, when, and what was lost: of the readings of range and bearing in a recording.

A message does not name its sender: it is the robot that stands where range and bearing say, at the
time of the reading. Who was within reach and was not heard was lost: by chance, behind a body, or
for want of a place. Robots without a marker are not in a recording's arena states, so what virtual
ones say has no sender.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

from vsense.base.message_bus import DAMAGED
from vsense.monitor.recording.form import ExperimentMessage

COLUMNS = ("timestep", "tag", "sender", "heard", "distance_m", "range_m", "bearing_rad", "age_s")
"""Of heard.csv, after the time."""

SENSOR = "range_and_bearing"
_NEAR_M = 0.1
"""A sender is at most so far from where its message comes from: noise, and moves meanwhile."""
_KEPT = 64

PlanarPose = tuple[float, float, float]


class _Ears(NamedTuple):
    """The sensor of a controller: which of its sensors it is, and what `/experiment` says of it."""

    place: int
    numbers: int
    range_m: float
    view_rad: float


class Hearing:
    """Follows arena states, and makes rows of readings; for one thread."""

    def __init__(self, experiment: ExperimentMessage) -> None:
        """Of damaged robots and controllers, and of those before `range_m` was said, none is."""
        self._radius_m: dict[int, float] = {}
        for row in experiment.robots:
            with suppress(*DAMAGED):
                radius_m = float(row.get("radius_m") or experiment.body_radius_m or 0.0)
                self._radius_m[int(row["tag"])] = radius_m
        self._controller_of = experiment.controller_of()
        self._ears = [_ears_of(controller) for controller in experiment.controllers]
        self._said_m = [controller.get("said_range_m") for controller in experiment.controllers]
        self._states: deque[tuple[int, dict[int, PlanarPose]]] = deque(maxlen=_KEPT)

    def see(self, data: Mapping[str, Any]) -> None:
        """Takes an arena state."""
        robots = data["robots"]
        columns = (robots[name] for name in ("tag", "x_m", "y_m", "yaw_rad"))
        poses = {tag: (x, y, yaw) for tag, x, y, yaw in zip(*columns) if tag in self._radius_m}
        self._states.append((int(data["capture_ns"]), poses))

    def rows(self, data: Mapping[str, Any]) -> Iterator[list[Any]]:
        """Readings: a row for each message, and for each robot that could have been heard."""
        for tag, values, taken in zip(data["tag"], data["values"], data["captured_ns"]):
            ears = self._ears[self._controller_of.get(tag, 0)]
            if ears is not None and taken[ears.place] >= 0 and values[ears.place]:
                yield from self._rows_of(data, tag, ears, values[ears.place], taken[ears.place])

    def _rows_of(
        self,
        data: Mapping[str, Any],
        tag: int,
        ears: _Ears,
        numbers: Sequence[float],
        taken_ns: int,
    ) -> Iterator[list[Any]]:
        poses = min(self._states, key=lambda state: abs(state[0] - taken_ns), default=(0, {}))[1]
        if tag not in poses:
            return
        age_s = (data["capture_ns"] - taken_ns) / 1e9
        missing = {other: pose for other, pose in poses.items() if other != tag}
        distances = {other: math.dist(poses[tag][:2], p[:2]) for other, p in missing.items()}
        for at in range(1, 1 + round(numbers[0]) * ears.numbers, ears.numbers):
            range_m, bearing_rad = numbers[at] / 100.0, numbers[at + 1]
            sender = self._sender(tag, poses[tag], range_m, bearing_rad, missing)
            missing.pop(sender, None)
            far = distances.get(sender)
            head = [data["timestep"], tag, None if sender < 0 else sender]
            yield [*head, 1, far, range_m, bearing_rad, age_s]
        for other, pose in sorted(missing.items()):
            said_m = self._said_m[self._controller_of.get(other, 0)] or ears.range_m
            if distances[other] < said_m and _is_ahead(poses[tag], pose, ears.view_rad):
                yield [data["timestep"], tag, other, 0, distances[other], None, None, age_s]

    def _sender(
        self,
        tag: int,
        pose: PlanarPose,
        range_m: float,
        bearing_rad: float,
        others: Mapping[int, PlanarPose],
    ) -> int:
        """The nearest robot to where a message comes from; -1: none is near."""
        x, y, yaw = pose
        nearest, least_m = -1, _NEAR_M
        # The range ends at the bodies, and a sensor takes the others for as wide as its own.
        far = range_m + 2.0 * self._radius_m[tag]
        at = x + far * math.cos(yaw + bearing_rad), y + far * math.sin(yaw + bearing_rad)
        for other, (other_x, other_y, _) in others.items():
            off_m = math.dist(at, (other_x, other_y))
            if off_m < least_m:
                nearest, least_m = other, off_m
        return nearest


def _ears_of(controller: Mapping[str, Any]) -> _Ears | None:
    """None: it has no such sensor, or its recording does not say enough of it."""
    sensors = controller.get("sensors")
    for place, sensor in enumerate(sensors if isinstance(sensors, list) else []):
        with suppress(*DAMAGED):
            if sensor["name"] == SENSOR:
                numbers = (int(sensor["count"]) - 1) // int(sensor["max_messages"])
                return _Ears(place, numbers, float(sensor["range_m"]), float(sensor["view_rad"]))
    return None


def _is_ahead(pose: PlanarPose, other: PlanarPose, view_rad: float) -> bool:
    """Whether a robot is within an angle around straight ahead."""
    x, y, yaw = pose
    bearing_rad = math.atan2(other[1] - y, other[0] - x) - yaw
    return abs(math.remainder(bearing_rad, math.tau)) <= view_rad / 2.0
