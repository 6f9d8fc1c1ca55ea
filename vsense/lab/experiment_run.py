"""The command `vsense lab`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from vsense.config.opening import choose_seed, open_experiment
from vsense.config.placement import settle
from vsense.config.specs import Experiment
from vsense.config.subset import first_robots
from vsense.console import Console
from vsense.errors import VsenseError
from vsense.interruption import INTERRUPTED, interruption
from vsense.lab import metrics, report
from vsense.lab.session import Session
from vsense.link.wire import Telemetry
from vsense.pictures.story import spoken
from vsense.run import directory as run_directory
from vsense.runtime import Step

COMPLAINTS_TIMESTEP = 10
"""By then every controller has begun and said what it misses."""


def run(options: argparse.Namespace) -> int:
    """Runs an experiment in the lab and reports about it.

    Returns:
        0, or 130 after Ctrl-C or SIGTERM: what was measured until then is reported all the same.

    Raises:
        VsenseError: it cannot run, or something failed in mid-run; what was measured until then
            is reported first.
    """
    console = Console()
    experiment = _experiment(options)
    if experiment is None:
        return 0
    seed = choose_seed(options, experiment)
    experiment = settle(experiment, seed)
    directory = run_directory.make(options.output, experiment.name, seed)
    port = experiment.port if options.port is None else options.port
    _warn(console, experiment)
    failure: VsenseError | None = None
    with interruption() as interrupted:
        session = Session(
            experiment, seed, directory, port, options.blind, console, interrupted, options.base
        )
        with session:
            session.wait_until_ready()
            _announce(console, experiment, seed, directory)
            try:
                session.live(_progress(console, session))
            except VsenseError as error:
                failure = error
        console.end_progress()
        if session.recording.steps:
            _report(options, session, seed, console)
        else:
            console.say("vsense: the run ended before its first timestep: nothing was measured")
        if failure is not None:
            raise failure
        return INTERRUPTED if interrupted.is_set() else 0


def _experiment(options: argparse.Namespace) -> Experiment | None:
    """The experiment with the command line's changes; None with `--dry`."""
    experiment = open_experiment(options)
    return None if experiment is None else first_robots(experiment, options.robots)


def _warn(console: Console, experiment: Experiment) -> None:
    for warning in experiment.warnings:
        console.say(f"vsense: {warning}")
    if experiment.tracker is not None:
        place = f"{experiment.file}:{experiment.tracker.line}"
        console.say(f"vsense: {place}: its tracker is left alone: the lab has its own cameras")


def _announce(console: Console, experiment: Experiment, seed: int, directory: Path) -> None:
    console.say(
        f"{experiment.name}: {len(experiment.robots)} robots, seed {seed},"
        f" {experiment.length_s:g} s; logs in {directory}"
    )


def _progress(console: Console, session: Session) -> Any:
    """Makes the function that keeps the live line up to date."""
    experiment = session.experiment
    length = f"/{experiment.length_s:g}" if experiment.length_s else ""

    def show(step: Step) -> None:
        if step.run_timestep == COMPLAINTS_TIMESTEP:
            for complaint in session.swarm.complaints():
                console.say(f"vsense: {complaint}")
        robots = session.server.robots().values()
        connected = sum(robot.connected for robot in robots)
        lit = sum(_is_lit(robot.telemetry) for robot in robots if robot.connected)
        latency_ms = (step.sent_ns - step.ready_ns) / 1e6
        console.progress(
            f"{step.run_timestep * experiment.timestep_s:5.1f}{length} s"
            f"  timestep {step.run_timestep}  robots {connected}/{len(robots)}"
            f"{_measured(session)}  lit {lit}  picture to sent {latency_ms:.0f} ms"
        )

    return show


def _measured(session: Session) -> str:
    """What the host knows of the experiment's success: robots in the cone, or its measures."""
    world, source = session.world, report.pollution(session.experiment)
    if source is None:
        return "".join(f"  {spoken(name)} {value:.3g}" for name, value in world.results.items())
    cone, robots = world.cone(source), world.robots
    places = np.stack((robots["x_m"], robots["y_m"]), axis=-1)
    return f"  in the cone {0 if cone is None else int(cone.contains(places).sum())}"


def _is_lit(telemetry: Telemetry | None) -> bool:
    return telemetry is not None and bool(telemetry.leds & report.RING_LEDS)


def _report(options: argparse.Namespace, session: Session, seed: int, console: Console) -> None:
    """Measures, writes, prints, and draws last."""
    measured = report.gather(session)
    summary = {
        "experiment": session.experiment.name,
        "seed": seed,
        "blind": bool(options.blind),
        "robots": len(session.experiment.robots),
        "cameras": len(session.cameras),
        **metrics.figures(measured),
        "vision": session.eyes.figures(),
        "measures": session.recording.measures,
    }
    run_directory.write_summary(session.directory, summary, options.json)
    console.say(report.table(summary))
    drawing = session.directory / f"{session.experiment.name}.png"
    report.draw(session, measured, options.blind, seed, drawing)
    console.say(f"picture: {drawing}")
