"""The figures of one run: what `vsense lab --json` prints.

Latencies count from the middle of the exposure, less the time spent rendering, which stands for
the sensor's readout and is a figure of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import wrap_angle
from vsense.config.specs import Experiment
from vsense.monitor.pictures.run_samples import RunSamples
from vsense.world.entities import Arena
from vsense.world.robot_models import EPUCK

if TYPE_CHECKING:
    from vsense.monitor.pictures.run_figure import RunFigure

TIMESTEP = np.dtype(
    [
        ("timestep", "i8"), ("run_timestep", "i8"), ("capture_ns", "i8"),
        ("render_ns", "i8"), ("arena_ns", "i8"), ("sent_ns", "i8"),
    ]
)  # fmt: skip
"""One timestep that the host handled; times on the host's monotonic clock. `timestep` counts the
cameras' triggers, `run_timestep` those of the run; `render_ns` is how long rendering took."""

EDGE_MARGIN_M = 0.005
"""Readings closer than this to the cone's edge are not judged: there the truth itself is a
matter of millimetres."""

NOWHERE_M = 1e6
"""Place of a body that does not exist: a tag that has joined by mistake is a wrong id."""

MISNAMED_M = EPUCK.radius_m
"""A named marker farther than a robot's radius from that robot's true place is a wrong id."""


@dataclass(frozen=True, slots=True)
class MeasuredRun:
    """Everything that was noted during one run; arrays of robots follow `tags`.

    Attributes:
        timesteps: (n,) TIMESTEP, those that the host handled; it may have missed some.
        wanted: number of timesteps that the run had, missed ones included.
        lived: how many the host handled; more than `timesteps` where the logs end before the run.
        tracking: the figures of a `TrackingTally`.
        object_poses: (timesteps, objects, 3) true poses of the tagged things that are no robots.
        traces: per robot a `swarm.TRACE` array with host times.
        sensing: per robot whether it has any virtual sensor.
        judged: per robot whether its trace has the value of the sensor that is judged.
        actuated: per robot the `microcontrollers.ACTUATION` rows that were applied, by time.
        turn: the run's timestep at which the wind turns, or None.
        lateness_ms: the canary's ticks.
        link: counters `sent`, `received`, `dropped`, `reconnects`, `defects`.
    """

    timesteps: NDArray[np.void]
    wanted: int
    lived: int
    dt_ns: int
    tags: tuple[int, ...]
    tracking: dict[str, float | int | None]
    truth: SwarmTruth
    object_poses: NDArray[np.float64]
    traces: list[NDArray[np.void]]
    sensing: list[bool]
    judged: list[bool]
    actuated: list[NDArray[np.void]]
    turn: int | None
    lateness_ms: list[float]
    link: dict[str, int]


UNKNOWN_AGE = -1
"""In a trace: a controller did not know how old what it read was."""


def figures(run: MeasuredRun) -> dict[str, Any]:
    """Computes all figures of a run under the names that scripts rely on."""
    steps = run.timesteps
    late = (steps["sent_ns"] - steps["capture_ns"]) > run.dt_ns
    return {
        "timesteps": len(steps),
        "unlogged_timesteps": run.lived - len(steps),
        "late_timesteps": int(late.sum()) + run.wanted - len(steps),
        "left_out_timesteps": run.wanted - len(steps),
        "duration_s": round((int(np.ptp(steps["capture_ns"])) + run.dt_ns) / 1e9, 3),
        "tracking": dict(run.tracking),
        "latency_ms": latencies(run),
        "sensing": sensing(run),
        "clock": {"age_error_ms_p99": _round(_percentile(age_errors_ms(run), 99))},
        "swarm": swarm(run.truth, steps["run_timestep"], run.turn),
        "link": dict(run.link),
    }


class TrackingTally:
    """Judges what was read of markers against the truth, timestep by timestep.

    Raw detections count, predictions do not.
    """

    def __init__(self, tags: Sequence[int]) -> None:
        """`tags` are those of all bodies, in the order of their true poses."""
        self._row_of = {tag: row for row, tag in enumerate(tags)}
        self._timesteps = self._detected = self._wrong = self._right = 0
        self._squares = np.zeros(2)

    def add(self, seen: NDArray[np.void], poses: NDArray[np.float64]) -> None:
        """Counts a timestep: the SIGHTING array, and the true poses (n, 3) at its capture."""
        rows = [self._row_of.get(tag, -1) for tag in seen["tag"].tolist()]
        # A tag that nobody carries is far from everything.
        truth = np.vstack((poses, (NOWHERE_M, NOWHERE_M, 0.0)))[rows]
        distance_m = np.hypot(seen["x_m"] - truth[:, 0], seen["y_m"] - truth[:, 1])
        right = distance_m <= MISNAMED_M
        turn_rad = wrap_angle(seen["yaw_rad"] - truth[:, 2])[right]
        self._timesteps += 1
        self._detected += len(np.unique(seen["tag"][right]))
        self._wrong += int((~right).sum())
        self._right += len(turn_rad)
        self._squares += np.sum(distance_m[right] ** 2), np.sum(turn_rad**2)

    def figures(self) -> dict[str, float | int | None]:
        """The figures of all timesteps so far."""
        detected = self._detected / self._timesteps if self._timesteps else None
        rms = np.sqrt(self._squares / self._right) if self._right else np.full(2, np.nan)
        return {
            "detected_mean": _round(detected, 4),
            "wrong_ids": self._wrong,
            "position_rmse_mm": _round(1000 * rms[0]),
            "heading_rmse_deg": _round(np.degrees(rms[1])),
        }


def latencies(run: MeasuredRun) -> dict[str, dict[str, float | None]]:
    """All latencies as percentiles in ms."""
    steps = run.timesteps
    origins_ns = steps["capture_ns"] + steps["render_ns"]
    origin = dict(zip(steps["capture_ns"].tolist(), origins_ns.tolist()))
    to_robot: list[float] = []
    to_control: list[float] = []
    to_wheels: list[float] = []
    for trace, applied in zip(run.traces, run.actuated):
        _, first = np.unique(trace["newest_ns"], return_index=True)
        next_ns = np.append(trace["now_ns"][1:], np.iinfo(np.int64).max)
        for line, end_ns in zip(trace[first], next_ns[first]):
            start = origin.get(int(line["newest_ns"]))
            if start is None:
                continue
            to_robot.append((line["rx_ns"] - start) / 1e6)
            to_control.append((line["now_ns"] - start) / 1e6)
            to_wheels += ((t - start) / 1e6 for t in _applied_at(line, int(end_ns), applied))
    return {
        "capture_to_arena": _spread((steps["arena_ns"] - origins_ns) / 1e6),
        "arena_to_sent": _spread((steps["sent_ns"] - steps["arena_ns"]) / 1e6),
        "capture_to_sent": _spread((steps["sent_ns"] - origins_ns) / 1e6),
        "capture_to_robot": _spread(to_robot),
        "capture_to_control": _spread(to_control),
        "capture_to_wheels": _spread(to_wheels),
        "render": _spread(steps["render_ns"] / 1e6),
        "canary": _spread(run.lateness_ms),
    }


def _applied_at(line: np.void, end_ns: int, applied: NDArray[np.void]) -> list[int]:
    """When the wheels took a control step's command, before the next step; empty where not.

    The frames between two control steps may also be the guard's stop, or repeat the command before:
    only one with this step's speeds counts. Some bases are only sent what changes: a step that
    changes nothing has no frame there, and no latency.
    """
    first, end = np.searchsorted(applied["time_ns"], [line["now_ns"], end_ns])
    for row in applied[first:end]:
        if row["left_steps_s"] == line["left"] and row["right_steps_s"] == line["right"]:
            return [int(row["time_ns"])]
    return []


def sensing(run: MeasuredRun) -> dict[str, float | int | None]:
    """Readings of the controllers against the truth.

    One reading is expected for every robot and timestep of the run, missed ones included; where
    only some robots have virtual sensors, of those. It agrees
    when the value at that timestep's control step equals the value from the true poses at its
    capture time; one that is missing, stale or of no capture time of this run is wrong.
    """
    verdicts: dict[bool, list[bool]] = {True: [], False: []}
    readings = fresh = 0
    first = int(run.timesteps["timestep"][0] - run.timesteps["run_timestep"][0])
    robots = [robot for robot, senses in enumerate(run.sensing) if senses] or range(len(run.tags))
    for robot in robots:
        lines = _first_lines(run.traces[robot])
        for timestep in range(first, first + run.wanted):
            line = lines.get(timestep)
            readings += line is not None
            fresh += line is not None and not line["stale"]
            verdict = _verdict(run, robot, timestep, line)
            if verdict is not None:
                verdicts[verdict[0]].append(verdict[1])
    expected = len(robots) * run.wanted
    return {
        "readings": readings,
        "expected": expected,
        "agreement_in": _round(_mean(verdicts[True]), 5),
        "agreement_out": _round(_mean(verdicts[False]), 5),
        "fresh_share": _round(fresh / expected, 5),
    }


def _first_lines(trace: NDArray[np.void]) -> dict[int, np.void]:
    """Each timestep's first control step that held a value."""
    held = trace[trace["known"]]
    timesteps, first = np.unique(held["timestep"], return_index=True)
    return {int(timestep): held[index] for timestep, index in zip(timesteps, first)}


def _verdict(
    run: MeasuredRun, robot: int, timestep: int, line: np.void | None
) -> tuple[bool, bool] | None:
    """Whether the robot truly was in the cone, and whether its reading agrees.

    None where there is no cone, the robot does not sense it, or was too near its edge.
    """
    if run.truth.depth_m is None or not run.judged[robot]:
        return None
    named = None if line is None else _row_at(run.timesteps["capture_ns"], line["capture_ns"])
    # Without a capture time of this run the truth is that of the timestep, or the last before it.
    row = named
    if row is None:
        row = max(int(np.searchsorted(run.timesteps["timestep"], timestep, "right")) - 1, 0)
    depth_m = run.truth.depth_m[row, robot]
    if abs(depth_m) < EDGE_MARGIN_M:
        return None
    inside = bool(depth_m > 0)
    if line is None or named is None or line["stale"]:
        return inside, False
    return inside, bool((line["value"] >= 0.5) == inside)


def _row_at(times: NDArray[np.int64], time: np.int64) -> int | None:
    """The row of a rising array that holds `time` exactly."""
    row = int(np.searchsorted(times, time))
    return row if row < len(times) and times[row] == time else None


def age_errors_ms(run: MeasuredRun) -> NDArray[np.float64]:
    """Errors of the readings' ages that controllers got, in ms, where they were known."""
    lines = np.concatenate([trace[trace["age_ns"] != UNKNOWN_AGE] for trace in run.traces])
    true_age_ns = lines["now_ns"] - lines["capture_ns"]
    return np.asarray(np.abs(lines["age_ns"] - true_age_ns) / 1e6)


def _spread(values_ms: NDArray[np.float64] | list[float]) -> dict[str, float | None]:
    return {
        "p50": _round(_percentile(values_ms, 50)),
        "p99": _round(_percentile(values_ms, 99)),
        "max": _round(_percentile(values_ms, 100)),
    }


def _percentile(values: NDArray[np.float64] | list[float], q: float) -> float | None:
    return float(np.percentile(values, q)) if len(values) else None


def _mean(values: list[int] | list[bool]) -> float | None:
    return float(np.mean(values)) if len(values) else None


def _round(value: float | None, digits: int = 3) -> float | None:
    return None if value is None or np.isnan(value) else round(float(value), digits)


@dataclass(frozen=True, slots=True)
class SwarmTruth:
    """The truth of each robot at the capture times of the timesteps that the host handled.

    Attributes:
        poses: (timesteps, robots, 3) x, y in m and yaw in rad.
        depth_m: (timesteps, robots) depth in the cone, negative outside; None without a cone.
        lit: (timesteps, robots) whether the robot's red LEDs were on.
    """

    poses: NDArray[np.float64]
    depth_m: NDArray[np.float64] | None
    lit: NDArray[np.bool_]

    @property
    def inside(self) -> NDArray[np.bool_] | None:
        """(timesteps, robots) whether the robot was in the cone; None without a cone."""
        return None if self.depth_m is None else self.depth_m >= 0

    def figure(
        self,
        experiment: Experiment,
        run_timesteps: NDArray[np.int64],
        samples: RunSamples,
        part: Arena,
    ) -> RunFigure:
        """The run as `run_figure` draws it, in a part of the arena."""
        from vsense.monitor.pictures.run_figure import (
            RunFigure,  # few runs of a campaign have a picture
        )

        turn, inside = experiment.turn_timestep, self.inside
        truth = self.poses, self.lit, inside, turn
        return RunFigure(experiment, run_timesteps, *truth, samples, part)


def swarm(
    truth: SwarmTruth, run_timesteps: NDArray[np.int64], turn: int | None
) -> dict[str, int | None]:
    """Robots in the cone, and lit there, at the last timestep before and after the wind's turn."""
    inside, lit, figures = truth.inside, truth.lit, dict[str, int | None]()
    for when, row in zip(("before", "after"), _phase_ends(run_timesteps, turn)):
        now = None if inside is None or row is None else inside[row]
        figures[f"in_cone_{when}_turn"] = None if now is None else int(now.sum())
        figures[f"lit_{when}_turn"] = None if now is None else int((now & lit[row]).sum())
    return figures


def swarm_rows(swarm: dict[str, int | None] | None, robots: int) -> list[tuple[str, str]]:
    """The figures of `swarm` as lines of a table; none without a cone."""
    rows = list[tuple[str, str]]()
    if swarm is None:
        return rows
    turned = swarm["in_cone_after_turn"] is not None
    for when in ("before", "after"):
        inside, lit = swarm[f"in_cone_{when}_turn"], swarm[f"lit_{when}_turn"]
        if inside is not None:
            moment = f"{when} the wind turned" if turned else "at the end"
            text = f"{inside} of {robots} robots in the cone {moment}, {lit} of them with LEDs on"
            rows.append(("swarm", text))
    return rows


def _phase_ends(
    run_timesteps: NDArray[np.int64], turn: int | None
) -> tuple[int | None, int | None]:
    """Rows of the last timesteps before the wind turned and after it; None: no such phase."""
    after = len(run_timesteps) - 1
    if turn is None:
        return after, None
    before = int(np.searchsorted(run_timesteps, turn)) - 1
    return (before if before >= 0 else None), (after if after > before else None)


def depths_in_cone(
    experiment: Experiment,
    poses: NDArray[np.float64],
    run_timesteps: NDArray[np.int64],
    shares: Sequence[float] | NDArray[np.float64],
) -> NDArray[np.float64] | None:
    """Depth of each robot in the cone of the first pollutant source; None without one.

    Args:
        poses: (n, bodies, 3) true x_m, y_m, yaw_rad: robots, then objects.
        run_timesteps: (n,) rising.
        shares: (n,) how much was left of the source.

    Returns:
        (n, robots) in m, negative outside, -inf where nothing is left.
    """
    source, robots = experiment.source, len(experiment.robots)
    if source is None:
        return None
    tags = list(experiment.tags.values())
    turn = experiment.turn_timestep
    turned = np.zeros(len(poses), bool) if turn is None else run_timesteps >= turn
    depth_m = np.full((len(poses), robots), -np.inf)
    row = 0
    # A cone mostly stays for many timesteps.
    keys = zip(*poses[:, tags.index(source.tag), :2].T.tolist(), turned.tolist(), shares)
    for (x_m, y_m, _, share), same in groupby(keys):
        rows = slice(row, row + len(list(same)))
        if share > 0.0:
            cone = source.cone_at(x_m, y_m, int(run_timesteps[row]), share)
            depth_m[rows] = -cone.edge_distance(poses[rows, :robots, :2])
        row = rows.stop
    return depth_m
