"""The command `vsense lab`."""

from __future__ import annotations

import argparse
import json
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import Any

from vsense.config.experiment import load
from vsense.config.specs import Experiment
from vsense.errors import UsageError
from vsense.lab import metrics, report
from vsense.lab.console import Console
from vsense.lab.session import Session
from vsense.lab.shared import LabError
from vsense.link.wire import Telemetry
from vsense.runtime import Step

INTERRUPTED = 130


def run(options: argparse.Namespace) -> int:
    """Runs an experiment in the lab and reports about it.

    Returns:
        0, or 130 after Ctrl-C or SIGTERM: what was measured until then is reported all the same.

    Raises:
        VsenseError: it cannot run; one clear line.
    """
    console = Console()
    experiment = _experiment(options)
    report.pollution(experiment)
    seed = experiment.seed if options.seed is None else options.seed
    seed = seed or time.time_ns() % (2**32 - 1) + 1
    directory = _directory(options.output, experiment.name, seed)
    port = experiment.port if options.port is None else options.port
    for warning in experiment.warnings:
        console.say(f"vsense: {warning}")
    with _interruption(console) as interrupted:
        session = Session(experiment, seed, directory, port, options.blind, console, interrupted)
        with session:
            session.wait_until_ready()
            _announce(console, experiment, seed, directory)
            session.live(_moments(experiment), _progress(console, session))
        console.end_progress()
        _finish(options, session, seed, console)
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
    return replace(experiment, robots=experiment.robots[: options.robots])


def _directory(wanted: Path | None, name: str, seed: int) -> Path:
    """Makes the run directory."""
    directory = wanted or Path("runs") / f"{time.strftime('%Y-%m-%d-%H%M%S')}-{name}-seed{seed}"
    try:
        directory.mkdir(parents=True, exist_ok=True)
        (directory / ".writable").touch()
        (directory / ".writable").unlink()
    except OSError as error:
        raise LabError(f"cannot write to {directory}: {error.strerror}") from None
    return directory.resolve()


@contextmanager
def _interruption(console: Console) -> Iterator[threading.Event]:
    """Turns Ctrl-C and SIGTERM into an event, so that everything ends in order."""
    interrupted = threading.Event()

    def interrupt(number: int, frame: FrameType | None) -> None:
        interrupted.set()

    before = {
        number: signal.signal(number, interrupt) for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield interrupted
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _announce(console: Console, experiment: Experiment, seed: int, directory: Path) -> None:
    console.say(
        f"{experiment.name}: {len(experiment.robots)} robots, seed {seed},"
        f" {experiment.length_s:g} s; logs in {directory}"
    )


def _moments(experiment: Experiment) -> set[int]:
    """Timesteps whose pictures the report shows: the last before the wind turns."""
    turn = report.pollution(experiment).turn_timestep
    return set() if turn is None else {turn - 1}


def _progress(console: Console, session: Session) -> Any:
    """Makes the function that keeps the live line up to date."""
    experiment = session.experiment
    length = f"/{experiment.length_s:g}" if experiment.length_s else ""

    def show(step: Step) -> None:
        robots = session.server.robots().values()
        connected = sum(robot.connected for robot in robots)
        lit = sum(_is_lit(robot.telemetry) for robot in robots if robot.connected)
        values = session.runtime.readings.values()
        inside = sum(any(any(value) for value, _ in readings) for readings in values)
        latency_ms = (step.sent_ns - step.ready_ns) / 1e6
        console.progress(
            f"{step.run_timestep * experiment.timestep_s:5.1f}{length} s"
            f"  timestep {step.run_timestep}  robots {connected}/{len(robots)}"
            f"  in the cone {inside}  lit {lit}  picture to sent {latency_ms:.0f} ms"
        )

    return show


def _is_lit(telemetry: Telemetry | None) -> bool:
    return telemetry is not None and bool(telemetry.leds & report.RING_LEDS)


def _finish(options: argparse.Namespace, session: Session, seed: int, console: Console) -> None:
    """Measures, draws, prints."""
    if not session.recording.steps:
        console.say("vsense: the run ended before its first timestep: nothing was measured")
        return
    measured = report.gather(session)
    summary = {
        "experiment": session.experiment.name,
        "seed": seed,
        "blind": bool(options.blind),
        "robots": len(session.experiment.robots),
        "cameras": len(session.cameras),
        **metrics.figures(measured),
    }
    drawing = session.directory / f"{session.experiment.name}.png"
    report.draw(session, measured, options.blind, seed, drawing)
    text = json.dumps(summary, indent=2)
    (session.directory / "summary.json").write_text(text + "\n")
    console.say(report.table(summary))
    console.say(f"picture: {drawing}")
    if options.json:
        print(text)
    sys.stdout.flush()
