"""Wheels and noise of a lab, identified from recordings of its runs: nobody drives for that alone.

Between two pictures a robot goes forward by f and turns by w; nominal wheels would have gone L and
R at the speeds that it reports. With a the nominal axle,

    f = (l L + r R) / 2         w = (r R - l L) / (b a)

l, r (a wheel's way over the nominal one) and b (the axle over the nominal one) are found by least
squares, without the worst outliers: r / l from turns, which show it best. The spread of the
residuals is the robot's: of its wheels, its motors' timing, and the cameras' noise. Source:
Borenstein and Feng, Measurement and correction of systematic odometry errors in mobile robots,
1996. `vsense robot calibrate` fits the same model to poses of markers (`_motion_fit.py` there),
with each marker's offset: other measurements, another estimator, other last digits.

A report of wheel speeds is some time old, and wheels obey some time later: by how much reported
speeds have to be shifted to explain the motion best is found first, for all robots together.

Of a robot that stands the second differences of what is measured are noise alone: those of white
noise have 6 times its variance. Spreads are medians of absolute deviations (times 1.4826), so that
a robot that was pushed, or a reading that a shadow has cut, counts little.

Arrays follow the recording's arena states and its robots: (n,) states, (r,) robots.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats, wrap_angle
from vsense.base.message_bus import DAMAGED
from vsense.monitor.recording.form import ExperimentMessage, RecordingError
from vsense.monitor.recording.reader import Recording
from vsense.world.robot_models import EPUCK, WHEELS, RobotModel

Flags = NDArray[np.bool_]

HINDERED_M = 0.03
"""Whose body is so near to another one may be held or pushed by it."""
AT_WALL_M = 0.05
"""Whose body is so near to the arena's border may be held by a wall, which is 2 cm thick."""


@dataclass(frozen=True, slots=True)
class WheelOrders:
    """The wheel speeds that one robot obeys, as it reports them.

    Attributes:
        times_s: (m,) since when; a speed is kept until the next one.
        speeds: (m, 2) left and right [steps/s], those that its motors make of them.
        step_m: way of a nominal wheel in a step.
    """

    times_s: Floats
    speeds: Floats
    step_m: float

    def ways_m(self, times_s: Floats) -> Floats:
        """The ways that nominal wheels would have gone up to some times, (k, 2); NaN: not known."""
        spans = np.diff(self.times_s, append=self.times_s[-1:])[:, None] * self.speeds
        ways = np.vstack((np.zeros((1, 2)), np.cumsum(spans, axis=0)[:-1])) * self.step_m
        columns = [np.interp(times_s, self.times_s, ways[:, k], np.nan, np.nan) for k in (0, 1)]
        return np.stack(columns, axis=-1)

    def stood(self, times_s: Floats) -> Flags:
        """Whether both speeds were 0 for 0.5 s, and are up to 0.1 s after, (k,)."""
        turns = np.abs(self.speeds).sum(axis=1, keepdims=True).repeat(2, axis=1)
        along = WheelOrders(self.times_s, turns, self.step_m)
        ways = along.ways_m(times_s + 0.1) - along.ways_m(times_s - 0.5)
        return np.asarray(ways[:, 0] == 0.0)


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
        axles_m: (r,) distances of their wheels, nominal.
        readings: by sensor's name, (n, r, k) its values; NaN: not known.
    """

    timestep_s: float
    tags: tuple[int, ...]
    times_s: Floats
    poses: Floats
    free: Flags
    orders: tuple[WheelOrders | None, ...]
    axles_m: Sequence[float]
    readings: Mapping[str, Floats]

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
    experiment = ExperimentMessage.read(recording.experiment)
    gathered = _Gathered(experiment)
    try:
        topics = {"/arena", "/robots", *(["/readings"] if sensing else [])}
        for message in recording.messages(topics):
            gathered.receive(message.topic, message.time_ns, message.data)
        if not gathered.times_ns:
            raise RecordingError(f"{recording.path}: holds no run")
        return gathered.motion()
    except DAMAGED as error:
        raise RecordingError(f"{recording.path}: is damaged: {error!r}") from None


class _Gathered:
    """Takes the messages of a recording."""

    def __init__(self, experiment: ExperimentMessage) -> None:
        self._experiment = experiment
        self._models = [_model(robot) for robot in experiment.robots]
        self.tags = tuple(int(robot["tag"]) for robot in experiment.robots)
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
                told_ns, row = time_ns - (heard_ms or 0.0) * 1e6, self._row[tag]
                turns = self._models[row].motor_speed
                self._orders[row].append((told_ns, turns(left), turns(right)))

    def motion(self) -> RunMotion:
        """All of it, in seconds since the run's first picture."""
        zero_ns, poses = self.times_ns[0], np.array(self._poses)
        times_s = (np.array(self.times_ns) - zero_ns) / 1e9
        told = zip(self._orders, self._models)
        orders = tuple(_orders(rows, zero_ns, model.step_m) for rows, model in told)
        radii_m = np.array([model.radius_m for model in self._models])
        free = _free(poses, self._experiment.arena or {}, radii_m)
        step_s = float(self._experiment.timestep_s or 0.1)
        axles_m = [model.axle_m for model in self._models]
        return RunMotion(step_s, self.tags, times_s, poses, free, orders, axles_m, self._values())

    def _values(self) -> dict[str, Floats]:
        """The readings at the times of the run, of the first controller's sensors."""
        if not self._readings:
            return {}
        sensors = self._experiment.controllers[0]["sensors"]
        shape = len(self.times_ns), len(self.tags)
        tables = [np.full((*shape, int(sensor["count"])), np.nan) for sensor in sensors]
        for place, time_ns in enumerate(self.times_ns):
            data = self._readings.get(time_ns)
            for tag, values in zip(*((data["tag"], data["values"]) if data else ((), ()))):
                for into, value in zip(tables, values):
                    if tag in self._row and len(value) == into.shape[2]:
                        into[place, self._row[tag]] = value
        return {sensor["name"]: values for sensor, values in zip(sensors, tables)}


def _model(robot: Mapping[str, Any]) -> RobotModel:
    """An e-puck with what a recording says of a robot's body and wheels."""
    told = {name: robot[name] for name in ("radius_m", *WHEELS) if name in robot}
    return replace(EPUCK, **told)


def _orders(
    rows: list[tuple[float, float, float]], zero_ns: int, step_m: float
) -> WheelOrders | None:
    """A robot's orders by time; None: fewer than two are known."""
    table = np.array(sorted(rows), np.float64).reshape(-1, 3)
    _, first = np.unique(table[:, 0], return_index=True)
    table = table[first]
    if len(table) < 2:
        return None
    return WheelOrders((table[:, 0] - zero_ns) / 1e9, table[:, 1:], step_m)


def _free(poses: Floats, arena: Mapping[str, Any], radii_m: Floats) -> Flags:
    """Where nobody and no border is near, (n, r)."""
    places = poses[..., :2]
    apart = np.linalg.norm(places[:, :, None] - places[:, None], axis=-1)
    apart[:, range(poses.shape[1]), range(poses.shape[1])] = np.inf
    touching_m = radii_m[:, None] + radii_m
    alone = ~(apart < touching_m + HINDERED_M).any(axis=2) & np.isfinite(places).all(axis=2)
    if not arena:
        return np.asarray(alone)
    half = np.array(arena["size_m"][:2]) / 2.0 - (radii_m + AT_WALL_M)[:, None]
    inside = (np.abs(places - np.array(arena["centre_m"][:2])) < half).all(axis=2)
    return np.asarray(alone & inside)


SHIFTS_S = np.arange(-100, 301, 10) / 1e3
"""Shifts that are tried."""
FEWEST_STEPS = 50
"""Numbers that a spread or a fit needs."""
_TURNED = 0.1
"""Who turns less than by this share of its way shows nothing of its axle."""
_OUTLIER = 4.0
_ROUNDS = 4
_MAD = 1.4826


@dataclass(frozen=True, slots=True)
class IdentifiedRobot:
    """What was found of a robot's wheels.

    Attributes:
        steps: timesteps that it was found from.
        way_over_told: how far both wheels go, over what nominal ones would have, at those speeds.
        right_over_left: the ratio of both.
        axle_over_nominal: the distance of the wheels; both None: it hardly turned.
        forward_noise_mm, turn_noise_deg: standard deviations of what is left over in a timestep.
    """

    tag: int
    steps: int
    way_over_told: float
    right_over_left: float | None
    axle_over_nominal: float | None
    forward_noise_mm: float
    turn_noise_deg: float


@dataclass(frozen=True, slots=True)
class StandingNoise:
    """Noise of what is measured of robots that stand: `sigma` in a unit, from `samples` numbers."""

    what: str
    unit: str
    sigma: float
    samples: int


def shift_of(runs: Iterable[RunMotion]) -> float | None:
    """By how much reported speeds are shifted [s]; the median of the runs, None: unknown."""
    shifts_s = [shift for run in runs if (shift := _shift(run)) is not None]
    return float(np.median(shifts_s)) if shifts_s else None


def _shift(run: RunMotion) -> float | None:
    """The shift with which reported speeds explain best how fast robots went."""
    forward, _, good = run.steps()
    costs = []
    for shift_s in SHIFTS_S:
        ways = np.stack(
            [_nominal_ways(run, row, shift_s).mean(axis=1) for row in range(len(run.tags))], -1
        )
        here = good & np.isfinite(ways)
        if here.sum() < FEWEST_STEPS or not np.any(ways[here]):
            return None
        factor = np.sum(ways[here] * forward[here]) / np.sum(ways[here] ** 2)
        costs.append(float(np.abs(forward[here] - factor * ways[here]).mean()))
    return float(SHIFTS_S[int(np.argmin(costs))])


def _nominal_ways(run: RunMotion, row: int, shift_s: float) -> Floats:
    """What a robot's nominal wheels would have gone from state to state, (n - 1, 2) [m]."""
    orders = run.orders[row]
    if orders is None:
        return np.full((len(run.times_s) - 1, 2), np.nan)
    return np.asarray(np.diff(orders.ways_m(run.times_s - shift_s), axis=0))


def robots_of(runs: Sequence[RunMotion], shift_s: float) -> list[IdentifiedRobot]:
    """What was found of each robot of some runs, those of which enough is known, by tag."""
    rows: dict[int, list[Floats]] = {}
    axles_m = {tag: axle_m for run in runs for tag, axle_m in zip(run.tags, run.axles_m)}
    for run in runs:
        forward, turn, good = run.steps()
        for row, tag in enumerate(run.tags):
            ways = _nominal_ways(run, row, shift_s)
            here = good[:, row] & np.isfinite(ways).all(axis=1) & (ways != 0.0).any(axis=1)
            table = np.column_stack((ways, forward[:, row], turn[:, row]))
            rows.setdefault(tag, []).append(table[here])
    tables = ((tag, np.concatenate(tables)) for tag, tables in sorted(rows.items()))
    return [robot for tag, table in tables if (robot := _robot(tag, table, axles_m[tag]))]


def _robot(tag: int, table: Floats, axle_m: float) -> IdentifiedRobot | None:
    """Fits one robot: (k, 4) nominal left and right [m], forward [m], turn [rad]."""
    if len(table) < FEWEST_STEPS:
        return None
    ways, forward, turn = table[:, :2], table[:, 2], table[:, 3]
    (left_turn, right_turn), turn_residuals = _fit(ways * (-1.0, 1.0), turn)
    turned = float(np.abs(ways[:, 1] - ways[:, 0]).mean())
    has_turned = turned > _TURNED * float(np.abs(ways).mean()) and left_turn > 0.0
    ratio = right_turn / left_turn if has_turned else 1.0
    (left,), forward_residuals = _fit((ways @ (0.5, 0.5 * ratio))[:, None], forward)
    return IdentifiedRobot(
        tag=tag,
        steps=len(table),
        way_over_told=left * (1.0 + ratio) / 2.0,
        right_over_left=ratio if has_turned else None,
        axle_over_nominal=left / (left_turn * axle_m) if has_turned else None,
        forward_noise_mm=1e3 * spread(forward_residuals),
        turn_noise_deg=math.degrees(spread(turn_residuals)),
    )


def _fit(columns: Floats, target: Floats) -> tuple[list[float], Floats]:
    """Least squares of (k, c) columns, again without outliers; and all that is left over, (k,)."""
    inliers = np.ones(len(columns), bool)
    for _ in range(_ROUNDS):
        solution = np.linalg.lstsq(columns[inliers], target[inliers], rcond=None)[0]
        residuals = target - columns @ solution
        limit = _OUTLIER * spread(residuals[inliers])
        inliers = np.abs(residuals) <= max(limit, 1e-12)
    return [float(value) for value in solution], residuals


def standing_noise(runs: Iterable[RunMotion]) -> list[StandingNoise]:
    """The noise of poses of robots that stand, and of their virtual sensors' readings."""
    values_of: dict[tuple[str, str], list[Floats]] = {}
    for run in runs:
        still = _three(run.still(), run)
        for axis, name in enumerate(("x", "y")):
            values = _second(run.poses[..., axis])[still]
            values_of.setdefault((name, "mm"), []).append(1e3 * values)
        turns = np.diff(wrap_angle(np.diff(run.poses[..., 2], axis=0)), axis=0)
        values_of.setdefault(("heading", "deg"), []).append(np.degrees(turns[still]))
        for name, values in run.readings.items():
            values_of.setdefault((name, ""), []).append(_second(values)[still].ravel())
    noise = []
    for (name, unit), parts in values_of.items():
        values = np.concatenate(parts)
        values = values[np.isfinite(values)]
        if len(values) >= FEWEST_STEPS:
            sigma = spread(values) / math.sqrt(6.0)
            noise.append(StandingNoise(name, unit, sigma, len(values)))
    return noise


def _three(still: Flags, run: RunMotion) -> Flags:
    """Where a robot stood in three timesteps that follow each other, (n - 2, r)."""
    near = np.diff(run.times_s) < 1.5 * run.timestep_s
    return np.asarray(still[:-2] & still[1:-1] & still[2:] & (near[:-1] & near[1:])[:, None])


def _second(values: Floats) -> Floats:
    return np.asarray(np.diff(values, 2, axis=0))


def spread(values: Floats) -> float:
    """The standard deviation of most of (n,) values around 0, by their median size."""
    return _MAD * float(np.median(np.abs(values))) if len(values) else 0.0
