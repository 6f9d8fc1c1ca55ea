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
from vsense.lab.optics import EXPOSURE_NS
from vsense.lab.session import Session
from vsense.lab.shared import LabError
from vsense.lab.stitch import top_view
from vsense.lab.trace import read_trace
from vsense.lab.truth_log import read_truth
from vsense.world.pollution import PollutantSource

RING_LEDS = 0xFF


def gather(session: Session) -> metrics.Run:
    """Puts together what host, cameras, microcontrollers and daemons noted.

    The processes must have ended: their files are complete then.

    Raises:
        LabError: a file is missing or broken.
    """
    experiment, recording = session.experiment, session.recording
    steps = np.array(
        [
            (s.timestep, s.capture_ns, s.ready_ns, s.arena_ns, s.sent_ns, s.state.detected)
            for s in recording.steps
        ],
        metrics.TIMESTEP,
    )
    truth = _rows_of(read_truth(session.truth_log), steps)
    robots = len(experiment.robots)
    poses = truth["poses"]
    source = pollution(experiment)
    lit = (truth["leds"][:, :robots] & RING_LEDS) != 0
    actuations = read_actuations(session.floor.log)
    tags = tuple(robot.tag for robot in experiment.robots)
    traces = [read_trace(robot, "pollutant", session.dt_ns) for robot in session.swarm.robots]
    return metrics.Run(
        timesteps=steps,
        wanted=experiment.timesteps or len(steps),
        dt_ns=session.dt_ns,
        exposure_ns=EXPOSURE_NS,
        tags=tags,
        poses=[step.state.robots for step in recording.steps],
        truth=metrics.Truth(poses[:, :robots], _depth(source, experiment, poses), lit),
        object_tags=tuple(thing.tag for thing in experiment.objects),
        object_poses=poses[:, robots:],
        traces=[_within(trace, steps) for trace in traces],
        actuated=[actuations["time_ns"][actuations["robot"] == i] for i in range(robots)],
        turn=source.turn_timestep,
        lateness_ms=recording.lateness_ms,
        link={
            "sent": recording.sent,
            "received": recording.received,
            "dropped": recording.dropped,
            "reconnects": recording.reconnects,
        },
    )


def pollution(experiment: Experiment) -> PollutantSource:
    """The experiment's one pollutant source.

    Raises:
        LabError: there is none, or more than one: the lab's figures are about one cone.
    """
    if len(experiment.sources) != 1:
        raise LabError(
            f"{experiment.file}: the lab measures one pollutant cone,"
            f" this experiment has {len(experiment.sources)}"
        )
    return experiment.sources[0]


def _rows_of(truth: NDArray[np.void], steps: NDArray[np.void]) -> NDArray[np.void]:
    """The truth at the timesteps of the run."""
    rows = np.searchsorted(truth["timestep"], steps["timestep"])
    if len(steps) and (
        rows[-1] >= len(truth) or (truth["timestep"][rows] != steps["timestep"]).any()
    ):
        raise LabError("the truth log does not hold every timestep of the run")
    return truth[rows]


def _depth(
    source: PollutantSource, experiment: Experiment, poses: NDArray[np.float64]
) -> NDArray[np.float64]:
    """How deep each robot truly is in the cone of the true source, per timestep."""
    robots = len(experiment.robots)
    index = robots + [thing.tag for thing in experiment.objects].index(source.tag)
    depth = np.empty((len(poses), robots))
    for k, row in enumerate(poses):
        cone = source.cone_at(row[index, 0], row[index, 1], k)
        depth[k] = -cone.edge_distance(row[:robots, :2])
    return depth


def _within(trace: NDArray[np.void], steps: NDArray[np.void]) -> NDArray[np.void]:
    """The control steps of the run's timesteps."""
    if not len(steps):
        return trace[:0]
    first, last = steps["timestep"][0], steps["timestep"][-1]
    during: NDArray[np.bool_] = (trace["timestep"] >= first) & (trace["timestep"] <= last)
    return np.asarray(trace[during])


def draw(session: Session, run: metrics.Run, blind: bool, seed: int, path: Path) -> None:
    """Draws `pollutant.png`; needs at least one timestep.

    Raises:
        LabError: the file cannot be written.
    """
    experiment = session.experiment
    last = len(run.timesteps) - 1
    turned = run.turn is not None and run.turn <= last
    moments = [("before the wind turned", run.turn - 1)] if turned and run.turn else []
    moments.append(("after the wind turned" if turned else "at the end", last))
    inside, lit = metrics.counts(run.truth)
    time_s = np.arange(last + 2, dtype=np.float64) * experiment.timestep_s
    image = picture.draw(
        f"{experiment.name}{', blind' if blind else ''}",
        f"{len(run.tags)} robots seen by {len(session.cameras)} cameras, seed {seed}",
        [_scene(session, run, title, k) for title, k in moments if k in session.recording.pictures],
        picture.Curve(
            time_s,
            inside,
            lit,
            len(run.tags),
            run.turn * experiment.timestep_s if turned and run.turn is not None else None,
        ),
    )
    if not cv2.imwrite(str(path), image):
        raise LabError(f"{path}: cannot be written")


def _scene(session: Session, run: metrics.Run, title: str, k: int) -> picture.Scene:
    """The arena at timestep `k` of the run."""
    experiment = session.experiment
    source = pollution(experiment)
    x_m, y_m = run.object_poses[k, run.object_tags.index(source.tag), :2]
    view = top_view(
        session.recording.pictures[k],
        session.cameras,
        experiment.arena,
        picture.PANEL_PX_PER_M,
        experiment.marker.height_m,
    )
    centre = np.array(experiment.arena.centre_m[:2])
    poses = run.truth.poses[k].copy()
    poses[:, :2] -= centre
    return picture.Scene(
        title=f"{title}, t = {k * experiment.timestep_s:.1f} s",
        view=view,
        cone_m=source.cone_at(x_m, y_m, k).vertices() - centre,
        poses=poses,
        lit=run.truth.lit[k],
        inside=run.truth.depth_m[k] >= 0,
    )


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
        return f"the wind did not turn: nothing {when} it"
    return f"{inside} of {robots} robots in the cone {when} the wind turned, {lit} of them lit"


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.2f} %"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"
