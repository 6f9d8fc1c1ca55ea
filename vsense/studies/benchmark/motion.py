"""What a recording tells of robots' motion: where they were seen, and what their wheels were told.

Arrays follow the recording's arena states and its robots: (n,) states, (r,) robots.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import wrap_angle
from vsense.monitor.recording.form import ExperimentMessage, RecordingError
from vsense.monitor.recording.reader import Recording
from vsense.world.entities import BODY_RADIUS_M
from vsense.world.physics.motion import STEP_M, motor_speed

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

BESIDE_M = 2.0 * BODY_RADIUS_M + 0.03
"""Who has another robot so near may be held or pushed by it."""
AT_WALL_M = BODY_RADIUS_M + 0.05
"""Who is so near to the arena's border may be held by a wall, which is 2 cm thick."""


@dataclass(frozen=True, slots=True)
class WheelOrders:
    """What one robot's wheels were told, as it told itself.

    Attributes:
        times_s: (m,) since when; a speed is kept until the next one.
        speeds: (m, 2) left and right [steps/s], those that an e-puck's motors make of them.
    """

    times_s: Floats
    speeds: Floats

    def ways_m(self, times_s: Floats) -> Floats:
        """The ways that nominal wheels would have gone up to some times, (k, 2); NaN: not known."""
        spans = np.diff(self.times_s, append=self.times_s[-1:])[:, None] * self.speeds
        ways = np.vstack((np.zeros((1, 2)), np.cumsum(spans, axis=0)[:-1])) * STEP_M
        found = [np.interp(times_s, self.times_s, ways[:, k], np.nan, np.nan) for k in (0, 1)]
        return np.stack(found, axis=-1)

    def stood(self, times_s: Floats) -> Flags:
        """Whether both wheels had been told to stand for 0.5 s, up to 0.1 s after, (k,)."""
        turns = np.abs(self.speeds).sum(axis=1, keepdims=True).repeat(2, axis=1)
        along = WheelOrders(self.times_s, turns)
        went = along.ways_m(times_s + 0.1) - along.ways_m(times_s - 0.5)
        return np.asarray(went[:, 0] == 0.0)


@dataclass(frozen=True, slots=True)
class RunMotion:
    """The motion in one run.

    Attributes:
        timestep_s: of the experiment.
        tags: (r,) of the robots.
        times_s: (n,) when pictures were taken.
        poses: (n, r, 3) x [m], y [m], yaw [rad]; NaN: not seen.
        free: (n, r) whether nobody and no wall was near.
        orders: of each robot; None: nothing is known.
        readings: by sensor's name and unit, (n, r, k) its values; NaN: not known.
    """

    timestep_s: float
    tags: tuple[int, ...]
    times_s: Floats
    poses: Floats
    free: Flags
    orders: tuple[WheelOrders | None, ...]
    readings: Mapping[tuple[str, str], Floats]

    def still(self) -> Flags:
        """Whether each robot stood alone, (n, r)."""
        stood = [
            np.zeros(len(self.times_s), bool) if orders is None else orders.stood(self.times_s)
            for orders in self.orders
        ]
        return np.asarray(np.stack(stood, axis=-1) & self.free)

    def steps(self) -> tuple[Floats, Floats, Flags]:
        """What robots did from one state to the next.

        Returns:
            (n - 1, r) way forward [m], (n - 1, r) turn [rad], and where both are known of a robot
            that drove freely.
        """
        here, there = self.poses[:-1], self.poses[1:]
        turn = wrap_angle(there[..., 2] - here[..., 2])
        heading = here[..., 2] + turn / 2.0
        x, y = there[..., 0] - here[..., 0], there[..., 1] - here[..., 1]
        # The chord of an arc, made as long as the arc.
        chord = x * np.cos(heading) + y * np.sin(heading)
        forward = chord / np.sinc(turn / (2.0 * np.pi))
        spans_s = np.diff(self.times_s)
        good = (self.free[:-1] & self.free[1:]) & (spans_s < 1.5 * self.timestep_s)[:, None]
        return forward, turn, good & np.isfinite(forward)


def read_motion(recording: Recording, sensing: bool = True) -> RunMotion:
    """Reads the motion in the run of a recording; its readings too if `sensing`.

    Raises:
        RecordingError: it holds no run, or is damaged.
    """
    told = ExperimentMessage.read(recording.experiment)
    gathered = _Gathered(told)
    try:
        topics = {"/arena", "/robots", *(["/readings"] if sensing else [])}
        for message in recording.messages(topics):
            gathered.receive(message.topic, message.time_ns, message.data)
        if not gathered.times_ns:
            raise RecordingError(f"{recording.path}: holds no run")
        return gathered.motion()
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise RecordingError(f"{recording.path}: is damaged: {error!r}") from None


class _Gathered:
    """Takes the messages of a recording."""

    def __init__(self, told: ExperimentMessage) -> None:
        self._told = told
        self.tags = tuple(int(robot["tag"]) for robot in told.robots)
        self._row = {tag: row for row, tag in enumerate(self.tags)}
        self.times_ns: list[int] = []
        self._poses: list[Floats] = []
        self._orders: list[list[tuple[float, float, float]]] = [[] for _ in self.tags]
        self._readings: dict[int, Mapping[str, Any]] = {}

    def receive(self, topic: str, time_ns: int, data: Mapping[str, Any]) -> None:
        if topic == "/robots":
            self._robots(time_ns, data)
        elif topic == "/readings":
            self._readings[data["capture_ns"]] = data
        elif data["run_timestep"] >= 0:
            robots = data["robots"]
            poses = np.full((len(self.tags), 3), np.nan)
            names = ("tag", "seen", "x_m", "y_m", "yaw_rad")
            for tag, seen, *pose in zip(*(robots[name] for name in names)):
                if seen and tag in self._row:
                    poses[self._row[tag]] = pose
            self.times_ns.append(data["capture_ns"])
            self._poses.append(poses)

    def _robots(self, time_ns: int, data: Mapping[str, Any]) -> None:
        names = ("tag", "heard_ms", "left_steps_s", "right_steps_s")
        for tag, heard_ms, left, right in zip(*(data[name] for name in names)):
            if left is not None and tag in self._row:
                told_ns = time_ns - (heard_ms or 0.0) * 1e6
                self._orders[self._row[tag]].append(
                    (told_ns, motor_speed(left), motor_speed(right))
                )

    def motion(self) -> RunMotion:
        """All of it, in seconds since the run's first picture."""
        zero_ns, poses = self.times_ns[0], np.array(self._poses)
        times_s = (np.array(self.times_ns) - zero_ns) / 1e9
        orders = tuple(_orders(rows, zero_ns) for rows in self._orders)
        free = _free(poses, self._told.arena or {})
        step_s = float(self._told.timestep_s or 0.1)
        return RunMotion(step_s, self.tags, times_s, poses, free, orders, self._values())

    def _values(self) -> dict[tuple[str, str], Floats]:
        """The readings at the times of the run, of the first controller's sensors."""
        if not self._readings:
            return {}
        sensors = self._told.controllers[0]["sensors"]
        shape = len(self.times_ns), len(self.tags)
        found = [np.full((*shape, int(sensor["count"])), np.nan) for sensor in sensors]
        for place, time_ns in enumerate(self.times_ns):
            data = self._readings.get(time_ns)
            for tag, values in zip(*((data["tag"], data["values"]) if data else ((), ()))):
                for into, value in zip(found, values):
                    if tag in self._row and len(value) == into.shape[2]:
                        into[place, self._row[tag]] = value
        return {(s["name"], s.get("unit") or ""): v for s, v in zip(sensors, found)}


def _orders(rows: list[tuple[float, float, float]], zero_ns: int) -> WheelOrders | None:
    """A robot's orders by time; None: fewer than two are known."""
    table = np.array(sorted(rows), np.float64).reshape(-1, 3)
    _, first = np.unique(table[:, 0], return_index=True)
    table = table[first]
    if len(table) < 2:
        return None
    return WheelOrders((table[:, 0] - zero_ns) / 1e9, table[:, 1:])


def _free(poses: Floats, arena: Mapping[str, Any]) -> Flags:
    """Where nobody and no border is near, (n, r)."""
    places = poses[..., :2]
    apart = np.linalg.norm(places[:, :, None] - places[:, None], axis=-1)
    apart[:, range(poses.shape[1]), range(poses.shape[1])] = np.inf
    alone = ~(apart < BESIDE_M).any(axis=2) & np.isfinite(places).all(axis=2)
    if not arena:
        return np.asarray(alone)
    half = np.array(arena["size_m"][:2]) / 2.0 - AT_WALL_M
    inside = (np.abs(places - np.array(arena["centre_m"][:2])) < half).all(axis=2)
    return np.asarray(alone & inside)
