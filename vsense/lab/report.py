"""After a run in the lab: gathers what every process noted, and shows it to a person."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.config.specs import Experiment
from vsense.lab import metrics, picture
from vsense.lab.microcontrollers import read_actuations
from vsense.lab.session import Session
from vsense.lab.shared import LabError
from vsense.lab.stitch import top_view
from vsense.lab.trace import read_trace
from vsense.lab.truth_log import read_truth
from vsense.runtime import Step
from vsense.world.pollution import PollutantSource

RING_LEDS = 0xFF


def gather(session: Session) -> metrics.Run:
    """Puts together what host, cameras, microcontrollers and daemons noted.

    The processes must have ended: their files are complete then.

    Raises:
        LabError: a file is missing or broken.
    """
    experiment, recording = session.experiment, session.recording
    truth = _rows_of(read_truth(session.truth_log), [step.timestep for step in recording.steps])
    steps = _timesteps(recording.steps, truth)
    robots = len(experiment.robots)
    source = pollution(experiment)
    actuations = read_actuations(session.floor.log)
    interrupted = session.interrupted.is_set() or not experiment.timesteps
    traces = [read_trace(robot, "pollutant" if source else None) for robot in session.swarm.robots]
    return metrics.Run(
        timesteps=steps,
        wanted=int(steps["run_timestep"][-1]) + 1 if interrupted else experiment.timesteps,
        dt_ns=session.dt_ns,
        tags=tuple(robot.tag for robot in experiment.robots),
        sightings=[step.state.sightings for step in recording.steps],
        truth=metrics.Truth(
            poses=truth["poses"][:, :robots],
            depth_m=_depth_m(source, experiment, truth["poses"], steps["run_timestep"]),
            lit=(truth["leds"][:, :robots] & RING_LEDS) != 0,
        ),
        object_tags=tuple(thing.tag for thing in experiment.objects),
        object_poses=truth["poses"][:, robots:],
        traces=[_within(trace, steps) for trace in traces],
        actuated=[actuations["time_ns"][actuations["robot"] == i] for i in range(robots)],
        turn=source.turn_timestep if source else None,
        lateness_ms=recording.lateness_ms,
        link={
            "sent": recording.sent,
            "received": recording.received,
            "dropped": recording.dropped,
            "reconnects": recording.reconnects,
        },
    )


def pollution(experiment: Experiment) -> PollutantSource | None:
    """The pollutant source that the figures are about: the file's first, if it has one."""
    return experiment.sources[0] if experiment.sources else None


def _timesteps(steps: list[Step], truth: NDArray[np.void]) -> NDArray[np.void]:
    """The timesteps that the host lived."""
    rows = [
        (s.timestep, s.run_timestep, s.capture_ns, render_ns, s.arena_ns, s.sent_ns)
        for s, render_ns in zip(steps, truth["render_ns"])
    ]
    return np.array(rows, metrics.TIMESTEP)


def _rows_of(truth: NDArray[np.void], timesteps: list[int]) -> NDArray[np.void]:
    """The truth at the timesteps that the host lived."""
    rows = np.searchsorted(truth["timestep"], timesteps)
    if rows[-1] >= len(truth) or (truth["timestep"][rows] != timesteps).any():
        raise LabError("the truth log does not hold every timestep of the run")
    return truth[rows]


def _true_source(
    source: PollutantSource, experiment: Experiment, poses: NDArray[np.float64]
) -> NDArray[np.float64]:
    """True poses of what pollutes, a robot or an object, out of those of all bodies."""
    tags = [robot.tag for robot in experiment.robots]
    tags += [thing.tag for thing in experiment.objects]
    return np.asarray(poses[..., tags.index(source.tag), :])


def _depth_m(
    source: PollutantSource | None,
    experiment: Experiment,
    poses: NDArray[np.float64],
    run_timesteps: NDArray[np.int64],
) -> NDArray[np.float64] | None:
    """How deep each robot truly is in the cone of the true source; None without a cone."""
    if source is None:
        return None
    robots = len(experiment.robots)
    depth_m = np.empty((len(poses), robots))
    for row, (x_m, y_m, _) in enumerate(_true_source(source, experiment, poses)):
        cone = source.cone_at(x_m, y_m, int(run_timesteps[row]))
        depth_m[row] = -cone.edge_distance(poses[row, :robots, :2])
    return depth_m


def _within(trace: NDArray[np.void], steps: NDArray[np.void]) -> NDArray[np.void]:
    """The control steps of the run's timesteps."""
    first, last = steps["timestep"][0], steps["timestep"][-1]
    during: NDArray[np.bool_] = (trace["timestep"] >= first) & (trace["timestep"] <= last)
    return np.asarray(trace[during])


def draw(session: Session, run: metrics.Run, blind: bool, seed: int, path: Path) -> None:
    """Draws the picture of the run.

    Raises:
        LabError: the file cannot be written.
    """
    experiment = session.experiment
    before, after = metrics.phase_ends(run)
    titles = {before: "at the end" if after is None else "before the wind turned"}
    titles[after] = "after the wind turned"
    scenes = [_scene(session, run, title, row) for row, title in titles.items() if row is not None]
    image = picture.draw(
        f"{experiment.name}{', blind' if blind else ''}",
        f"{len(run.tags)} robots seen by {len(session.cameras)} cameras, seed {seed}",
        [scene for scene in scenes if scene is not None],
        _curve(run, experiment.timestep_s, after is not None),
    )
    if not cv2.imwrite(str(path), image):
        raise LabError(f"{path}: cannot be written")


def _curve(run: metrics.Run, timestep_s: float, turned: bool) -> picture.Curve | None:
    """The swarm over time; None without a cone."""
    series = metrics.counts(run.truth)
    if series is None:
        return None
    begins = np.append(run.timesteps["run_timestep"], run.timesteps["run_timestep"][-1] + 1)
    turn_s = run.turn * timestep_s if turned and run.turn is not None else None
    return picture.Curve(begins * timestep_s, *series, robots=len(run.tags), turn_s=turn_s)


def _scene(session: Session, run: metrics.Run, title: str, row: int) -> picture.Scene | None:
    """The arena as it was at a row of the run, or at the newest one before it with a picture."""
    experiment = session.experiment
    pictures = session.recording.pictures
    timesteps = run.timesteps["run_timestep"].tolist()
    shown = next((r for r in range(row, -1, -1) if timesteps[r] in pictures), None)
    if shown is None:
        return None
    view = top_view(
        pictures[timesteps[shown]],
        session.cameras,
        experiment.arena,
        picture.PANEL_PX_PER_M,
        experiment.marker.height_m,
    )
    poses = run.truth.poses[shown].copy()
    poses[:, :2] -= experiment.arena.centre_m[:2]
    depth_m = run.truth.depth_m
    return picture.Scene(
        title=f"{title}, t = {timesteps[shown] * experiment.timestep_s:.1f} s",
        view=view,
        cone_m=_cone_m(experiment, run, shown),
        poses=poses,
        lit=run.truth.lit[shown],
        inside=np.zeros(len(poses), bool) if depth_m is None else depth_m[shown] >= 0,
    )


def _cone_m(experiment: Experiment, run: metrics.Run, row: int) -> NDArray[np.float64] | None:
    """The true cone's corners relative to the arena's middle."""
    source = pollution(experiment)
    if source is None:
        return None
    bodies = np.concatenate((run.truth.poses[row], run.object_poses[row]))
    x_m, y_m, _ = _true_source(source, experiment, bodies)
    cone = source.cone_at(x_m, y_m, int(run.timesteps["run_timestep"][row]))
    return cone.vertices() - experiment.arena.centre_m[:2]


def table(summary: dict[str, Any]) -> str:
    """The summary as a person reads it."""
    tracking, sensing, link = summary["tracking"], summary["sensing"], summary["link"]
    swarm, latency = summary["swarm"], summary["latency_ms"]
    rows = [
        ("run", f"{summary['timesteps']} timesteps, {summary['late_timesteps']} late"),
        (
            "tracking",
            f"{tracking['detected_mean']} markers named per timestep,"
            f" {tracking['wrong_ids']} wrong ids;"
            f" rms error {tracking['position_rmse_mm']} mm, {tracking['heading_rmse_deg']} deg",
        ),
        (
            "sensing",
            f"{sensing['readings']} of {sensing['expected']} readings held,"
            f" {_percent(sensing['fresh_share'])} fresh; agree with the truth"
            f" {_percent(sensing['agreement_in'])} inside the cone,"
            f" {_percent(sensing['agreement_out'])} outside",
        ),
        ("swarm", _phase(swarm, "before", summary["robots"])),
        ("", _phase(swarm, "after", summary["robots"])),
        (
            "link",
            f"{link['received']} of {link['sent']} datagrams received,"
            f" {link['dropped']} dropped, {link['reconnects']} reconnects",
        ),
        ("clocks", f"age wrong by {summary['clock']['age_error_ms_p99']} ms (99th percentile)"),
    ]
    lines = [f"{name:<10}{text}" for name, text in rows]
    lines.append(f"{'latency':<10}{'from capture, in ms':<22}{'p50':>8}{'p99':>8}{'max':>8}")
    for name, spread in latency.items():
        figures = "".join(f"{_number(spread[key]):>8}" for key in ("p50", "p99", "max"))
        lines.append(f"{'':<10}{name.replace('_', ' '):<22}{figures}")
    return "\n".join(lines)


def _phase(swarm: dict[str, Any], when: str, robots: int) -> str:
    inside, lit = swarm[f"in_cone_{when}_turn"], swarm[f"lit_{when}_turn"]
    if inside is None:
        return f"nothing to count {when} a turn of the wind"
    return f"{inside} of {robots} robots in the cone {when} the wind turned, {lit} of them lit"


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.2f} %"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"
