"""After a run in the lab: gathers the notes of all processes, and shows them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.base import clock
from vsense.base.terminal import figure, measure_rows
from vsense.config.specs import Experiment, RobotSpec
from vsense.modes.lab import _metrics
from vsense.modes.lab._metrics import SwarmTruth
from vsense.modes.lab._reach import drawn
from vsense.modes.lab.hardware import report_all
from vsense.modes.lab.session import RunNotes, Session
from vsense.monitor.pictures import run_figure
from vsense.robots.link.status import RING_LEDS
from vsense.run.figures import StepTimes, late_text, link_row
from vsense.run.remote import COMMAND
from vsense.run.verdict import judged, table_rows

JUDGED = "pollutant"
"""The sensor whose values are compared with the truth."""


def gather(session: Session, recording: RunNotes) -> _metrics.MeasuredRun:
    """Puts together what host, cameras, microcontrollers and daemons noted of a run.

    All robots stand, and what the run's timesteps were is in the files.

    Raises:
        LabError: a file is missing or broken, or has nothing of the run.
    """
    experiment, robots = recording.experiment, len(recording.experiment.robots)
    times, logs = recording.figures.steps.columns(), recording.logs
    truth, actuations = logs.known_truth(), logs.actuations()
    steps = _timesteps(times[:, : len(truth)], truth)
    sensors = [_sensors_of(experiment, robot) for robot in experiment.robots]
    judged = [experiment.source is not None and JUDGED in names for names in sensors]
    return _metrics.MeasuredRun(
        timesteps=steps,
        wanted=_wanted(recording, experiment, steps),
        lived=len(recording.figures.steps),
        dt_ns=session.dt_ns,
        tags=tuple(robot.tag for robot in experiment.robots),
        tracking=recording.tracking.figures(),
        truth=_swarm_truth(experiment, truth, steps, recording.samples.shares),
        object_poses=truth["poses"][:, robots:],
        traces=[
            _within(logs.trace(robot, names, JUDGED if judge else None), steps)
            for robot, names, judge in zip(recording.robots, sensors, judged)
        ],
        sensing=[bool(names) for names in sensors],
        judged=judged,
        actuated=[actuations[actuations["robot"] == i] for i in range(robots)],
        turn=experiment.turn_timestep,
        lateness_ms=recording.lateness_ms,
        link=recording.link,
    )


def _swarm_truth(
    experiment: Experiment,
    truth: NDArray[np.void],
    steps: NDArray[np.void],
    shares: Sequence[float],
) -> SwarmTruth:
    """The robots' part of the truth, as far as its log goes."""
    robots, numbers = len(experiment.robots), steps["run_timestep"]
    left = shares[: len(truth)]
    return SwarmTruth(
        poses=truth["poses"][:, :robots],
        depth_m=_metrics.depths_in_cone(experiment, truth["poses"], numbers, left),
        lit=(truth["leds"][:, :robots] & RING_LEDS) != 0,
    )


def _wanted(recording: RunNotes, experiment: Experiment, steps: NDArray[np.void]) -> int:
    """The timesteps that the run had, as far as its logs go."""
    complete = recording.record.ended == "time" and experiment.timesteps > 0
    complete = complete and len(steps) == len(recording.figures.steps)
    return experiment.timesteps if complete else int(steps["run_timestep"][-1]) + 1


def _sensors_of(experiment: Experiment, robot: RobotSpec) -> list[str]:
    """What the robot's daemon is sent."""
    controller = experiment.controller_of(robot)
    if controller.program.is_hosted:
        return [COMMAND]
    return [mounted.sensor.name for mounted in controller.sensors]


def _timesteps(times: NDArray[np.int64], truth: NDArray[np.void]) -> NDArray[np.void]:
    steps = np.zeros(len(truth), _metrics.TIMESTEP)
    columns = dict(zip(StepTimes.NAMES, times))
    for name in ("timestep", "run_timestep", "capture_ns", "arena_ns", "sent_ns"):
        steps[name] = columns[name]
    steps["render_ns"] = truth["render_ns"]
    return steps


def _within(trace: NDArray[np.void], steps: NDArray[np.void]) -> NDArray[np.void]:
    """The control steps of the run's timesteps."""
    first, last = steps["timestep"][0], steps["timestep"][-1]
    during: NDArray[np.bool_] = (trace["timestep"] >= first) & (trace["timestep"] <= last)
    return np.asarray(trace[during])


def summarise(
    session: Session, recording: RunNotes, measured: _metrics.MeasuredRun
) -> dict[str, Any]:
    """Gives the figures of the newest run under the names that scripts rely on."""
    summary = {
        "experiment": session.experiment.name,
        "run": session.runner.control.run,
        "seed": recording.seed,
        "blind": session.setup.blind,
        "robots": len(session.experiment.robots),
        "resting": list(recording.resting),
        "parts": list(recording.parts),
        "cameras": len(session.cameras),
        "pace": clock.pace(),
        "light_level": recording.figures.light_level,
        "calibration": None if session.rig is None else session.rig.figures,
        **_metrics.figures(measured),
        "vision": session.tracking.figures(),
        "measures": recording.measures,
    }
    summary |= report_all(session.robots.hardware)
    if not session.experiment.sources:
        del summary["swarm"]
    return judged(summary, recording.record, session.setup.criteria)


def draw(session: Session, recording: RunNotes, run: _metrics.MeasuredRun, path: Path) -> None:
    """Draws the picture of a run; PictureError where the file cannot be written."""
    experiment = session.experiment
    numbers = run.timesteps["run_timestep"]
    poses = np.concatenate((run.truth.poses, run.object_poses), axis=1)
    part = drawn(session.environment.world, experiment.arena, poses)
    figure = run.truth.figure(experiment, numbers, recording.samples, part)
    cameras = len(session.cameras)
    subtitle = f"{len(run.tags)} robots seen by {cameras} cameras, seed {recording.seed}"
    run_figure.save(replace(figure, cameras=recording.seen), path, session.setup.blind, subtitle)


def _agreement(sensing: dict[str, Any]) -> str:
    """How often what robots felt of a cone was true; "" where nobody is to feel one."""
    shares = sensing["agreement_in"], sensing["agreement_out"]
    if shares == (None, None):
        return ""
    inside, outside = (figure(share, " %", 2, 100.0) for share in shares)
    return f"; agree with the truth {inside} inside the cone, {outside} outside"


def _calibration_rows(figures: dict[str, Any] | None) -> list[tuple[str, str]]:
    """How well the cameras are known; none where that is exactly."""
    if figures is None:
        return []
    text = (
        f"{figures['rms_px']} px rms; with it places are wrong by"
        f" {figures['position_rms_mm']} mm rms, headings by {figures['heading_rms_deg']} deg"
    )
    return [("known", text)]


_LATENCIES = {"canary": "a timer of 10 ms, late by"}
"""What rows of the table say in place of keys."""


def _age_words(error_ms: float | None) -> str:
    if error_ms is None:
        return "no reading came: how wrong its age is is not known"
    return f"age wrong by {error_ms} ms (99th percentile)"


def table(summary: dict[str, Any]) -> str:
    """The summary as text."""
    tracking, sensing = summary["tracking"], summary["sensing"]
    latency, vision = summary["latency_ms"], summary["vision"]
    unlogged, pace = summary["unlogged_timesteps"], summary["pace"]
    short = f"; the logs end {unlogged} timesteps before the run" if unlogged else ""
    rows = [
        ("run", f"{summary['timesteps']} timesteps, {late_text(summary)}{short}"),
        *table_rows(summary),
        *([("pace", f"{pace:g}: all times below are of the lab's clock")] if pace < 1.0 else ()),
        (
            "tracking",
            f"{tracking['detected_mean']} markers named per timestep,"
            f" {tracking['wrong_ids']} wrong ids;"
            f" rms error {tracking['position_rmse_mm']} mm, {tracking['heading_rmse_deg']} deg",
        ),
        *_calibration_rows(summary["calibration"]),
        (
            "cameras",
            f"{vision['left_out']} timesteps left out, {vision['old_pictures']} old pictures"
            f" dropped, {vision['overflows']} with too many markers,"
            f" {vision['camera_events']} warnings of cameras",
        ),
        (
            "sensing",
            f"{sensing['readings']} of {sensing['expected']} readings at the robots,"
            f" {figure(sensing['fresh_share'], ' %', 2, 100.0)} fresh{_agreement(sensing)}",
        ),
        *_metrics.swarm_rows(summary.get("swarm"), summary["robots"]),
        *measure_rows(summary["measures"]),
        link_row(summary["link"]),
        ("clocks", _age_words(summary["clock"]["age_error_ms_p99"])),
    ]
    lines = [f"{name:<10}{text}" for name, text in rows]
    lines.append(f"{'latency':<10}{'from capture, in ms':<22}{'p50':>8}{'p99':>8}{'max':>8}")
    for name, spread in latency.items():
        figures = "".join(f"{figure(spread[key]):>8}" for key in ("p50", "p99", "max"))
        lines.append(f"{'':<10}{_LATENCIES.get(name, name.replace('_', ' ')):<22}{figures}")
    return "\n".join(lines)
