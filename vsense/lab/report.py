"""After a run in the lab: gathers the notes of all processes, and shows them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.config.specs import Experiment, RobotSpec
from vsense.lab import metrics
from vsense.lab.metrics import SwarmTruth
from vsense.lab.microcontrollers import read_actuations
from vsense.lab.session import RunNotes, Session
from vsense.lab.shared import LabError
from vsense.lab.stitch import top_view
from vsense.lab.swarm import read_trace
from vsense.lab.truth import read_truth
from vsense.link.robots.status import RING_LEDS
from vsense.pictures import run_figure
from vsense.pictures.arena_view import WIDTH_PX
from vsense.pictures.canvas import Image
from vsense.pictures.run_figure import spoken
from vsense.run.figures import link_row, number, percent
from vsense.run.runtime import Step

JUDGED = "pollutant"
"""The sensor whose values are compared with the truth."""


def gather(session: Session, recording: RunNotes) -> metrics.MeasuredRun:
    """Puts together what host, cameras, microcontrollers and daemons noted of a run.

    The processes have ended, so that their files are complete.

    Raises:
        LabError: a file is missing or broken.
    """
    experiment, robots = session.experiment, len(session.experiment.robots)
    truth = _rows_of(read_truth(session.truth_log), [step.timestep for step in recording.steps])
    steps = _timesteps(recording.steps, truth)
    actuations = read_actuations(session.floor.log)
    sensors = [_sensors_of(experiment, robot) for robot in experiment.robots]
    judged = [experiment.source is not None and JUDGED in names for names in sensors]
    return metrics.MeasuredRun(
        timesteps=steps,
        wanted=_wanted(recording, experiment, steps),
        dt_ns=session.dt_ns,
        tags=tuple(robot.tag for robot in experiment.robots),
        sightings=[step.state.sightings for step in recording.steps],
        truth=SwarmTruth(
            poses=truth["poses"][:, :robots],
            depth_m=metrics.depths_in_cone(
                experiment, truth["poses"], steps["run_timestep"], recording.samples.shares
            ),
            lit=(truth["leds"][:, :robots] & RING_LEDS) != 0,
        ),
        object_tags=tuple(thing.tag for thing in experiment.objects),
        object_poses=truth["poses"][:, robots:],
        traces=[
            _within(read_trace(robot, names, JUDGED if judge else None), steps)
            for robot, names, judge in zip(session.swarm.robots, sensors, judged)
        ],
        sensing=[bool(names) for names in sensors],
        judged=judged,
        actuated=[actuations[actuations["robot"] == i] for i in range(robots)],
        turn=experiment.turn_timestep,
        lateness_ms=recording.lateness_ms,
        link=recording.link,
    )


def _wanted(recording: RunNotes, experiment: Experiment, steps: NDArray[np.void]) -> int:
    """The timesteps that the run had."""
    whole = recording.ended == "time" and experiment.timesteps > 0
    return experiment.timesteps if whole else int(steps["run_timestep"][-1]) + 1


def _sensors_of(experiment: Experiment, robot: RobotSpec) -> list[str]:
    return [mounted.sensor.name for mounted in experiment.controller_of(robot).sensors]


def _timesteps(steps: list[Step], truth: NDArray[np.void]) -> NDArray[np.void]:
    rows = [
        (s.timestep, s.run_timestep, s.capture_ns, render_ns, s.arena_ns, s.sent_ns)
        for s, render_ns in zip(steps, truth["render_ns"])
    ]
    return np.array(rows, metrics.TIMESTEP)


def _rows_of(truth: NDArray[np.void], timesteps: list[int]) -> NDArray[np.void]:
    """The truth at the timesteps that the host handled."""
    rows = np.searchsorted(truth["timestep"], timesteps)
    if rows[-1] >= len(truth) or (truth["timestep"][rows] != timesteps).any():
        raise LabError("the truth log does not hold every timestep of the run")
    return truth[rows]


def _within(trace: NDArray[np.void], steps: NDArray[np.void]) -> NDArray[np.void]:
    """The control steps of the run's timesteps."""
    first, last = steps["timestep"][0], steps["timestep"][-1]
    during: NDArray[np.bool_] = (trace["timestep"] >= first) & (trace["timestep"] <= last)
    return np.asarray(trace[during])


def draw(session: Session, recording: RunNotes, run: metrics.MeasuredRun, path: Path) -> None:
    """Draws the picture of a run; PictureError where the file cannot be written."""
    experiment, pictures = session.experiment, recording.pictures
    numbers = run.timesteps["run_timestep"]
    figure = run.truth.figure(experiment, numbers, recording.samples)

    def view(timestep: int) -> Image | None:
        if not pictures.get(timestep):
            return None
        zoom = WIDTH_PX / experiment.arena.size_m[0]
        height_m = experiment.marker.height_m
        return top_view(pictures[timestep], session.cameras, experiment.arena, zoom, height_m)

    cameras = len(session.cameras)
    subtitle = f"{len(run.tags)} robots seen by {cameras} cameras, seed {recording.seed}"
    run_figure.save(figure, path, session.setup.blind, subtitle, view)


def table(summary: dict[str, Any]) -> str:
    """The summary as text."""
    tracking, sensing = summary["tracking"], summary["sensing"]
    swarm, latency, vision = summary["swarm"], summary["latency_ms"], summary["vision"]
    rows = [
        ("run", f"{summary['timesteps']} timesteps, {summary['late_timesteps']} late"),
        (
            "tracking",
            f"{tracking['detected_mean']} markers named per timestep,"
            f" {tracking['wrong_ids']} wrong ids;"
            f" rms error {tracking['position_rmse_mm']} mm, {tracking['heading_rmse_deg']} deg",
        ),
        (
            "cameras",
            f"{vision['left_out']} timesteps left out, {vision['old_pictures']} old pictures"
            f" dropped, {vision['overflows']} with more than the tables hold,"
            f" {vision['camera_events']} times something to tell",
        ),
        (
            "sensing",
            f"{sensing['readings']} of {sensing['expected']} readings held,"
            f" {percent(sensing['fresh_share'], 2)} fresh; agree with the truth"
            f" {percent(sensing['agreement_in'], 2)} inside the cone,"
            f" {percent(sensing['agreement_out'], 2)} outside",
        ),
        *metrics.swarm_rows(swarm, summary["robots"]),
        *(("measure", f"{spoken(name)}: {value:g}") for name, value in summary["measures"].items()),
        link_row(summary["link"]),
        ("clocks", f"age wrong by {summary['clock']['age_error_ms_p99']} ms (99th percentile)"),
    ]
    lines = [f"{name:<10}{text}" for name, text in rows]
    lines.append(f"{'latency':<10}{'from capture, in ms':<22}{'p50':>8}{'p99':>8}{'max':>8}")
    for name, spread in latency.items():
        figures = "".join(f"{number(spread[key]):>8}" for key in ("p50", "p99", "max"))
        lines.append(f"{'':<10}{name.replace('_', ' '):<22}{figures}")
    return "\n".join(lines)
