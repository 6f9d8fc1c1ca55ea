"""How good a lab is, by its own runs: latency, accuracy of poses, wheels and noise."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from statistics import median
from typing import Any

from vsense.config.roster import Roster
from vsense.studies.benchmark.evidence import RunEvidence
from vsense.studies.benchmark.identification import robots_of, shift_of, standing_noise


def latency(runs: Sequence[RunEvidence]) -> dict[str, Any] | None:
    """How late readings and wheels are; None in simulation, where time is the experiment's.

    `stations`: from the middle of an exposure (of `picture_...`: from the last picture in memory;
    of `arena_to_sent`: from the arena state), the median of the runs' medians, and the greatest of
    their 99th percentiles and of all.
    """
    told = [run.summary["latency_ms"] for run in runs if "latency_ms" in run.summary]
    if not told:
        return None
    stations = {
        f"{name}_ms": _spread([one[name] for one in told if name in one])
        for name in dict.fromkeys(name for one in told for name in one)
    }
    late = [run.row.late for run in runs if run.row.late is not None]
    return {
        "stations": {name: spread for name, spread in stations.items() if spread},
        "late_share_mean": sum(late) / len(late) if late else None,
        "late_share_worst": max(late, default=None),
    }


def _spread(told: Sequence[Mapping[str, float | None]]) -> dict[str, float]:
    """The spread of a latency over runs; empty where none has it."""
    known = [one for one in told if one.get("p50") is not None]
    if not known:
        return {}
    worst = {name: max(float(one[name] or 0.0) for one in known) for name in ("p99", "max")}
    return {"p50": median(float(one["p50"] or 0.0) for one in known), **worst}


def accuracy(runs: Sequence[RunEvidence]) -> dict[str, Any]:
    """How true poses are.

    `truth`: in the lab, what was read of markers against where they truly were; `calibration`: what
    `vsense calibrate check` found of the cameras in use, or the lab of those of `--calibrate`; both
    None where nothing is known. `seen_share`: robots that were seen in a timestep.
    """
    told = [run.summary["tracking"] for run in runs if "tracking" in run.summary]
    known = [run.calibration for run in runs if run.calibration]
    robots = [run.row.robots or 0 for run in runs]
    seen = sum(_seen(run) for run in runs)
    return {
        "truth": _against_truth(told) if told else None,
        "calibration": known[-1] if known else None,
        "seen_share": seen / sum(robots) if sum(robots) else None,
    }


def _seen(run: RunEvidence) -> float:
    """How many robots were seen in a timestep."""
    if "tracking" in run.summary:
        return float(run.summary["tracking"]["detected_mean"] or 0.0)
    if "arena" in run.summary:
        return float(run.summary["arena"]["seen_mean"] or 0.0)
    return float(run.row.robots or 0)


def _against_truth(told: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    return {
        "position_rms_mm": _rms([one["position_rmse_mm"] for one in told]),
        "heading_rms_deg": _rms([one["heading_rmse_deg"] for one in told]),
        "wrong_ids": sum(one["wrong_ids"] for one in told),
    }


def _rms(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return math.sqrt(sum(value**2 for value in known) / len(known)) if known else None


def noise(runs: Sequence[RunEvidence], roster: Roster | None) -> dict[str, Any]:
    """What the runs tell of wheels and noise; see `identification`.

    `told_shift_ms`: by how much told speeds were shifted in time; `robots`: of each robot;
    `standing`: of poses and readings of robots that stand; `roster`: by tag, what `vsense robot
    calibrate` has measured before.
    """
    motions = [run.motion for run in runs]
    shift_s = shift_of(motions)
    known = {} if roster is None else {
        str(robot.tag): values
        for robot in roster.robots
        if (values := {n: v for n, v in asdict(robot.calibration).items() if v})
    }  # fmt: skip
    return {
        "told_shift_ms": None if shift_s is None else 1e3 * shift_s,
        "robots": [asdict(one) for one in robots_of(motions, shift_s or 0.0)],
        "standing": [asdict(one) for one in standing_noise(motions)],
        "roster": known,
    }
