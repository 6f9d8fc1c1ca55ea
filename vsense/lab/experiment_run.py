"""The command `vsense lab`."""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from vsense.config.experiment import load
from vsense.config.specs import Experiment
from vsense.console import Console
from vsense.errors import UsageError, VsenseError
from vsense.interruption import INTERRUPTED, interruption
from vsense.lab import metrics, report
from vsense.lab.session import Session
from vsense.lab.shared import LabError
from vsense.link.wire import Telemetry
from vsense.runtime import Step

COMPLAINTS_TIMESTEP = 10
"""By then every controller has begun and said what it misses."""

SPARE_PICTURES = 3
"""The very last timestep of a phase may be one that the host missed."""


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
    seed = experiment.seed if options.seed is None else options.seed
    seed = seed or time.time_ns() % (2**32 - 1) + 1
    directory = _directory(options.output, experiment.name, seed)
    port = experiment.port if options.port is None else options.port
    for warning in experiment.warnings:
        console.say(f"vsense: {warning}")
    failure: VsenseError | None = None
    with interruption() as interrupted:
        session = Session(experiment, seed, directory, port, options.blind, console, interrupted)
        with session:
            session.wait_until_ready()
            _announce(console, experiment, seed, directory)
            try:
                session.live(_moments(experiment), _progress(console, session))
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


def _experiment(options: argparse.Namespace) -> Experiment:
    """The experiment with the command line's changes."""
    experiment = load(options.experiment, options.duration)
    if options.robots is None:
        return experiment
    if options.robots > len(experiment.robots):
        raise UsageError(
            f"--robots {options.robots}: {experiment.file} has {len(experiment.robots)}"
        )
    left_out = {robot.tag for robot in experiment.robots[options.robots :]}
    if left_out & {source.tag for source in experiment.sources}:
        raise UsageError(f"--robots {options.robots}: would leave out what pollutes")
    return replace(experiment, robots=experiment.robots[: options.robots])


def _directory(wanted: Path | None, name: str, seed: int) -> Path:
    """Makes the run directory; an earlier run is never written over."""
    stem = f"{time.strftime('%Y-%m-%d-%H%M%S')}-{name}-seed{seed}"
    directory = wanted or Path("runs") / stem
    copies = 1
    while wanted is None and directory.exists():
        copies += 1
        directory = directory.with_name(f"{stem}-{copies}")
    try:
        directory.mkdir(parents=True, exist_ok=True)
        if any(directory.iterdir()):
            raise LabError(f"{directory} is not empty: choose a new folder for this run")
        (directory / "robots").mkdir()
    except OSError as error:
        raise LabError(f"cannot write to {directory}: {error.strerror}") from None
    return directory.resolve()


def _announce(console: Console, experiment: Experiment, seed: int, directory: Path) -> None:
    console.say(
        f"{experiment.name}: {len(experiment.robots)} robots, seed {seed},"
        f" {experiment.length_s:g} s; logs in {directory}"
    )


def _moments(experiment: Experiment) -> range:
    """Timesteps whose pictures the report may show: the last ones before the wind turns."""
    source = report.pollution(experiment)
    if source is None or source.turn_timestep is None:
        return range(0)
    return range(max(source.turn_timestep - SPARE_PICTURES, 0), source.turn_timestep)


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
        inside = _inside(session)
        latency_ms = (step.sent_ns - step.ready_ns) / 1e6
        console.progress(
            f"{step.run_timestep * experiment.timestep_s:5.1f}{length} s"
            f"  timestep {step.run_timestep}  robots {connected}/{len(robots)}"
            f"  in the cone {inside}  lit {lit}  picture to sent {latency_ms:.0f} ms"
        )

    return show


def _inside(session: Session) -> int:
    """How many robots the host takes to be in the cone."""
    source = report.pollution(session.experiment)
    cone = None if source is None else session.world.cone(source)
    if cone is None:
        return 0
    robots = session.world.robots
    return int(cone.contains(np.stack((robots["x_m"], robots["y_m"]), axis=-1)).sum())


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
    }
    text = json.dumps(summary, indent=2)
    path = session.directory / "summary.json"
    try:
        path.write_text(text + "\n")
        if options.json:
            print(text, flush=True)
    except OSError as error:
        raise LabError(f"{error.filename or 'standard output'}: {error.strerror}") from None
    console.say(report.table(summary))
    drawing = session.directory / f"{session.experiment.name}.png"
    report.draw(session, measured, options.blind, seed, drawing)
    console.say(f"picture: {drawing}")
