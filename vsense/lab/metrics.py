"""The figures of one run, every one measured: what `vsense lab --json` prints.

Latencies count from the middle of the exposure, less the time spent rendering, which stands for
the sensor's readout and is reported by itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.arena import wrap_angle

TIMESTEP = np.dtype(
    [
        ("timestep", "i8"),
        ("capture_ns", "i8"),
        ("ready_ns", "i8"),
        ("arena_ns", "i8"),
        ("sent_ns", "i8"),
        ("detected", "i8"),
    ]
)
"""One timestep of the host; times on the host's monotonic clock."""

EDGE_MARGIN_M = 0.005
"""Closer than this to the cone's edge the truth itself is a matter of millimetres: not judged."""

MISNAMED_M = 0.035
"""A named marker farther than a robot's radius from that robot's true place is a wrong id."""


@dataclass(frozen=True, slots=True)
class Truth:
    """Where everything really was, per timestep of the run.

    Attributes:
        poses: (timesteps, robots, 3) x, y in m and yaw in rad at the capture time.
        depth_m: (timesteps, robots) how deep in the cone: positive inside, negative outside.
        lit: (timesteps, robots) whether the robot's red LEDs were on at the capture time.
    """

    poses: NDArray[np.float64]
    depth_m: NDArray[np.float64]
    lit: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Run:
    """Everything that was noted during one run; arrays of robots follow `tags`.

    Attributes:
        timesteps: (n,) TIMESTEP.
        wanted: number of timesteps the run was to have.
        dt_ns: length of a timestep.
        exposure_ns: exposure of one picture.
        tags: the robots' tags.
        poses: per timestep the POSE array of the arena state.
        truth: the true poses, cone depths and LEDs.
        object_tags: tags of the tagged objects that are no robots.
        object_poses: (timesteps, objects, 3) their true poses.
        traces: per robot a `trace.TRACE` array with host times.
        actuated: per robot the sorted times [ns] at which a motor command was applied.
        turn: the run's timestep at which the wind turns, or None.
        lateness_ms: the canary's ticks.
        link: counters `sent`, `received`, `dropped`, `reconnects`.
    """

    timesteps: NDArray[np.void]
    wanted: int
    dt_ns: int
    exposure_ns: int
    tags: tuple[int, ...]
    poses: list[NDArray[np.void]]
    truth: Truth
    object_tags: tuple[int, ...]
    object_poses: NDArray[np.float64]
    traces: list[NDArray[np.void]]
    actuated: list[NDArray[np.int64]]
    turn: int | None
    lateness_ms: list[float]
    link: dict[str, int]


def figures(run: Run) -> dict[str, Any]:
    """Computes all figures of a run under the names that scripts rely on."""
    steps = run.timesteps
    late = (steps["sent_ns"] - steps["capture_ns"]) > run.dt_ns
    missing = run.wanted - len(steps)
    return {
        "timesteps": len(steps),
        "late_timesteps": int(late.sum()) + max(missing, 0),
        "duration_s": round((int(np.ptp(steps["capture_ns"])) + run.dt_ns) / 1e9, 3),
        "tracking": tracking(run),
        "latency_ms": latencies(run),
        "sensing": sensing(run),
        "clock": {"age_error_ms_p99": _round(_percentile(age_errors_ms(run), 99))},
        "swarm": swarm(run),
        "link": dict(run.link),
    }


def tracking(run: Run) -> dict[str, float | int | None]:
    """Detections against the truth; only robots seen in a timestep count, predictions do not."""
    distance, turn = [np.empty(0)], [np.empty(0)]
    for k, poses in enumerate(run.poses):
        seen = poses[poses["seen"]]
        truth = np.array([_true_pose(run, k, int(tag)) for tag in seen["tag"]]).reshape(-1, 3)
        distance.append(np.hypot(seen["x_m"] - truth[:, 0], seen["y_m"] - truth[:, 1]))
        turn.append(wrap_angle(seen["yaw_rad"] - truth[:, 2]))
    all_distances, all_turns = np.concatenate(distance), np.concatenate(turn)
    right = all_distances <= MISNAMED_M
    return {
        "detected_mean": _round(_mean(run.timesteps["detected"]), 4),
        "wrong_ids": int((~right).sum()),
        "position_rmse_mm": _round(1000 * _rms(all_distances[right])),
        "heading_rmse_deg": _round(np.degrees(_rms(all_turns[right]))),
    }


def _true_pose(run: Run, k: int, tag: int) -> NDArray[np.float64]:
    """True pose of a tag; a tag that nothing here wears is infinitely far away."""
    if tag in run.tags:
        return np.asarray(run.truth.poses[k, run.tags.index(tag)])
    if tag in run.object_tags:
        return np.asarray(run.object_poses[k, run.object_tags.index(tag)])
    return np.full(3, np.inf)


def latencies(run: Run) -> dict[str, dict[str, float | None]]:
    """All latencies as percentiles in ms."""
    steps = run.timesteps
    readout_ns = steps["ready_ns"] - steps["capture_ns"] - run.exposure_ns // 2
    origin = dict(zip(steps["capture_ns"].tolist(), (steps["capture_ns"] + readout_ns).tolist()))
    to_robot: list[float] = []
    to_control: list[float] = []
    to_wheels: list[float] = []
    for trace, applied in zip(run.traces, run.actuated):
        _, first = np.unique(trace["newest_ns"], return_index=True)
        for line in trace[first]:
            start = origin.get(int(line["newest_ns"]))
            if start is None:
                continue
            to_robot.append((line["rx_ns"] - start) / 1e6)
            to_control.append((line["now_ns"] - start) / 1e6)
            # The first command applied after the controller ran is the one it gave.
            index = np.searchsorted(applied, line["now_ns"])
            if index < len(applied):
                to_wheels.append((applied[index] - start) / 1e6)
    return {
        "capture_to_arena": _spread((steps["arena_ns"] - steps["capture_ns"] - readout_ns) / 1e6),
        "arena_to_sent": _spread((steps["sent_ns"] - steps["arena_ns"]) / 1e6),
        "capture_to_robot": _spread(to_robot),
        "capture_to_control": _spread(to_control),
        "capture_to_wheels": _spread(to_wheels),
        "render": _spread(readout_ns / 1e6),
        "canary": _spread(run.lateness_ms),
    }


def sensing(run: Run) -> dict[str, float | int | None]:
    """What the controllers held against what they should have held.

    Every robot-timestep of the run is one reading expected. It agrees when the value held at the
    control step of that timestep equals the value from the true poses at the capture time it
    names; one that is missing, stale or names no capture time of this run is wrong.
    """
    row = {int(capture): k for k, capture in enumerate(run.timesteps["capture_ns"])}
    inside_ok: list[bool] = []
    outside_ok: list[bool] = []
    readings = fresh = 0
    for robot, trace in enumerate(run.traces):
        lines = _first_lines(trace)
        for k, timestep in enumerate(run.timesteps["timestep"].tolist()):
            line = lines.get(timestep)
            named = None
            if line is not None:
                readings += 1
                fresh += not line["stale"]
                named = row.get(int(line["capture_ns"]))
            depth = run.truth.depth_m[k if named is None else named, robot]
            if abs(depth) < EDGE_MARGIN_M:
                continue
            right = (
                line is not None
                and named is not None
                and not line["stale"]
                and (line["value"] >= 0.5) == (depth > 0)
            )
            (inside_ok if depth > 0 else outside_ok).append(bool(right))
    expected = len(run.tags) * run.wanted
    return {
        "readings": readings,
        "expected": expected,
        "agreement_in": _round(_mean(inside_ok), 5),
        "agreement_out": _round(_mean(outside_ok), 5),
        "fresh_share": _round(fresh / expected, 5) if expected else None,
    }


def _first_lines(trace: NDArray[np.void]) -> dict[int, np.void]:
    """Each timestep's first control step that held a value."""
    known = trace[trace["known"]]
    timesteps, first = np.unique(known["timestep"], return_index=True)
    return {int(timestep): known[index] for timestep, index in zip(timesteps, first)}


def age_errors_ms(run: Run) -> NDArray[np.float64]:
    """How wrong each robot was about the age of what it held, in ms."""
    lines = np.concatenate([trace[trace["known"]] for trace in run.traces])
    true_age_ns = lines["now_ns"] - lines["newest_ns"]
    return np.asarray(np.abs(lines["age_ns"] - true_age_ns) / 1e6)


def swarm(run: Run) -> dict[str, int | None]:
    """Robots in the cone, and lit there, at the last timestep of each phase."""
    last = len(run.timesteps) - 1
    before = last if run.turn is None else min(run.turn, len(run.timesteps)) - 1
    inside, lit = counts(run.truth)

    def at(k: int, series: NDArray[np.int64]) -> int | None:
        return int(series[k]) if 0 <= k <= last else None

    turned = run.turn is not None and run.turn <= last
    after = last if turned else -1
    return {
        "in_cone_before_turn": at(before, inside),
        "lit_before_turn": at(before, lit),
        "in_cone_after_turn": at(after, inside),
        "lit_after_turn": at(after, lit),
    }


def counts(truth: Truth) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Robots in the cone, and robots lit in the cone, per timestep."""
    inside = truth.depth_m >= 0
    return inside.sum(axis=1), (inside & truth.lit).sum(axis=1)


def _spread(values_ms: NDArray[np.float64] | list[float]) -> dict[str, float | None]:
    return {
        "p50": _round(_percentile(values_ms, 50)),
        "p99": _round(_percentile(values_ms, 99)),
        "max": _round(_percentile(values_ms, 100)),
    }


def _percentile(values: NDArray[np.float64] | list[float], q: float) -> float | None:
    return float(np.percentile(values, q)) if len(values) else None


def _mean(values: NDArray[np.float64] | list[bool]) -> float | None:
    return float(np.mean(values)) if len(values) else None


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


def _round(value: float | None, digits: int = 3) -> float | None:
    return None if value is None or np.isnan(value) else round(float(value), digits)
