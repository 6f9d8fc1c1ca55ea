"""`vsense lab`: an experiment on this machine."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from vsense.base import clock
from vsense.base.errors import CutShort, UsageError, VsenseError
from vsense.base.terminal import Console, interruption
from vsense.commands import arguments, experiments, hardware, homes
from vsense.config.specs import Experiment, Stage
from vsense.modes.lab import calibrated, report
from vsense.modes.lab.calibrated import CalibratedRig
from vsense.modes.lab.camera_spec import CameraGrid, cameras_above
from vsense.modes.lab.hardware import BASES, told_all
from vsense.modes.lab.session import Session
from vsense.modes.live.session import RunSetup
from vsense.monitor.pictures.run_figure import spoken
from vsense.monitor.ui.room import ControlRoom
from vsense.robots.link import keys
from vsense.robots.link.keys import LinkTrust
from vsense.run import directory as run_directory
from vsense.run.runs_csv import RunRows
from vsense.run.runtime import Step
from vsense.run.several import Series
from vsense.studies.packages import origin

DESCRIPTION = (
    "Runs an experiment in real time on this machine. Everything between the camera's pixels and"
    " the motor command is the real thing: the tracker, the world, the network and one vsensed per"
    " robot; only photons and wheels are simulated."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    experiments.add_experiment(parser, Stage.LAB)
    experiments.add_settings(parser)
    arguments.add_bases(parser, BASES)
    text = "TCP and UDP port; 0 takes a free one (default: the file's)"
    arguments.option(parser, "--port", arguments.port, "P", text)
    experiments.add_insecure(
        parser, "give the lab's robots no keys (default: keys that are made for this lab alone)"
    )
    experiments.add_legacy_port(parser)
    arguments.option(
        parser, "-o --output", Path, "DIR", "folder for picture and logs (default: runs/...)"
    )
    add_cameras(parser)
    add_pace(parser)
    hardware.add_robots(parser)
    experiments.add_room(parser)


def add_pace(group: Any) -> None:
    """Declares how fast the lab's clocks go."""
    text = (
        "all clocks of the lab go at this share of real time, 0.01 to 1, where this machine"
        " cannot keep up with more (default: 1)"
    )
    arguments.option(group, "--pace", hardware.pace, "P", text, 1.0)


def add_cameras(group: Any) -> None:
    """Declares how many cameras the lab has, and how well they are known."""
    text = (
        "so many columns and rows of cameras, up to 8x8; they hang so high, and have so many"
        " pixels, that they see the whole arena (default: as many as it takes, 2x2 at least)"
    )
    arguments.option(group, "--cameras", _grid, "CxR", text)
    text = (
        "hang the cameras as people do, a little off, and know them only from rendered pictures of"
        " a board, as `vsense calibrate rig` would (default: the cameras are known exactly)"
    )
    arguments.flag(group, "--calibrate", text)


def _grid(text: str) -> CameraGrid:
    found = re.fullmatch(r"([1-9][0-9]?)x([1-9][0-9]?)", text)
    if found is None:
        raise argparse.ArgumentTypeError(f"'{text}': expected columns and rows, such as 4x4")
    return int(found[1]), int(found[2])


COMPLAINTS_TIMESTEP = 10
"""By then every controller has begun and reported what it misses."""


def run(options: argparse.Namespace) -> int:
    """Runs an experiment in the lab and reports about it, also after a failure.

    Gives 0, or 130 after Ctrl-C, 143 after SIGTERM: what was measured by then is reported, too.
    """
    opened = experiments.open_experiment(options, stage=Stage.LAB)
    if opened is None:
        return 0
    port = _port(options, opened)
    set_pace(options.pace, opened.host)
    starts = homes.starts_of(options, opened)
    experiment, seed, directory = experiments.prepare(options, opened)
    console = Console()
    _warn(console, experiment, directory)
    with interruption() as interrupted, ControlRoom(experiments.room_of(options), console) as room:
        with interrupted.at_once():
            known = _calibrated(options, experiment, seed, directory, console)
        trust = keys.INSECURE if options.insecure else LinkTrust(keys.make())
        experiments.say_trust(trust, console.say)
        robots = hardware.robots_of(options, experiment)
        made = experiments.made_of(options, experiment, seed) | told_all(robots.hardware)
        who = (experiment.host, port), trust, console, interrupted, room
        setup = RunSetup(experiment, seed, options.blind, *who, made, starts, options.battery)
        base = options.base, options.firmware_watchdog, options.legacy_port
        session = Session(setup, directory, *base, options.cameras, known, robots)
        series = Series(directory, options.runs, room.holds, interrupted)
        rows = RunRows(directory, "lab", dict(options.set))
        failure = _run_all(session, series, rows, room, console)
        console.end_progress()
        try:
            with interrupted.in_time():
                _report_all(options, session, series, rows, console)
        except CutShort:
            console.say(f"vsense: no time for the figures; the run's logs are in {directory}")
            if failure is not None:
                console.say(f"vsense: {failure}", "trouble")
            raise
        if failure is not None:
            raise failure
        return interrupted.code if series.was_broken(session.runner.control) else 0


def _port(options: argparse.Namespace, experiment: Experiment) -> int:
    """The port for robots; raises as `check_doors`."""
    port = experiment.port if options.port is None else int(options.port)
    experiments.check_doors(options, experiment.host, port)
    return port


def _calibrated(
    options: argparse.Namespace,
    experiment: Experiment,
    seed: int,
    directory: Path,
    console: Console,
) -> CalibratedRig | None:
    """Hangs and calibrates the cameras of all runs, and says how well they are known; None where
    they are known exactly."""
    if not options.calibrate:
        return None
    ideal, height_m = cameras_above(experiment, options.cameras), experiment.marker.height_m
    rig = calibrated.calibrate(ideal, experiment.arena, height_m, seed, directory, console.progress)
    console.end_progress()
    console.say(rig.in_words())
    console.say(f"camera files and report: {directory / calibrated.FOLDER}")
    return rig


def set_pace(pace: float, host: str) -> None:
    """Has all clocks go at a pace; UsageError where robots on other machines could come."""
    if pace != 1.0 and not host.startswith("127."):
        raise UsageError(
            "--pace: the robots of a slow lab are on this machine only: expected a vss_host of"
            f" 127.0.0.1, got {host}; --set experiment.vss_host=127.0.0.1"
        )
    clock.slow(round(pace * 1000))


def _run_all(
    session: Session, series: Series, rows: RunRows, room: ControlRoom, console: Console
) -> VsenseError | None:
    """Carries out all runs; returns a failure in one of them, to be raised after the reports."""
    with session:
        experiments.say_legacy_port(session.server, console.say)
        experiments.say_doubts(session.doubts(), console)
        try:
            while True:
                directory = series.directory(session.runner.control.run)
                room.begin_run(session.environment, directory)
                session.wait_until_ready()
                session.home()
                _announce(console, session, directory)
                rows.begin(session.runner.control.run)
                session.run(directory, _progress(console, session))
                room.recorders.end_run()
                if not series.goes_on(session.runner):
                    return None
                session.next_run()
        except VsenseError as error:
            room.fail(error)
            return error


def _warn(console: Console, experiment: Experiment, directory: Path) -> None:
    """Says what will not be as somebody may expect, and keeps what the runs are made from."""
    experiments.say_warnings(console, experiment)
    origin.keep(directory, "lab", [experiment], console.say)
    if experiment.tracker is not None:
        place = f"{experiment.file}:{experiment.tracker.line}"
        console.say(f"vsense: {place}: its tracker is left alone: the lab has its own cameras")


def _announce(console: Console, session: Session, directory: Path) -> None:
    experiment = session.experiment
    console.say(
        f"{experiment.name}: {len(experiment.robots)} robots, seed {session.environment.seed},"
        f" {experiment.length_s:g} s; logs in {directory}"
    )
    camera = session.cameras[0]
    if len(session.cameras) != 4:
        console.say(
            f"{len(session.cameras)} cameras, {camera.position_m[2]:.2f} m high, pictures of"
            f" {camera.width_px} x {camera.height_px} pixels"
        )
    if clock.pace() != 1.0:
        console.say(f"pace {clock.pace():g}: all times are of the lab's clock, which is so slow")


def _progress(console: Console, session: Session) -> Callable[[Step], None]:
    """Makes the function that updates the live line."""
    experiment = session.experiment
    length = f"/{experiment.length_s:g}" if experiment.length_s else ""

    def show(step: Step) -> None:
        if step.run_timestep == COMPLAINTS_TIMESTEP:
            for complaint in session.swarm.complaints():
                console.say(f"vsense: {complaint}")
        robots = session.runner.robots.values()
        connected = sum(robot.connected for robot in robots)
        lit = sum(robot.lit for robot in robots if robot.connected)
        latency_ms = (step.sent_ns - step.ready_ns) / 1e6
        console.progress(
            f"{step.run_timestep * experiment.timestep_s:5.1f}{length} s"
            f"  timestep {step.run_timestep}  robots {connected}/{len(robots)}"
            f"{_measured(session)}  lit {lit}  picture to sent {latency_ms:.0f} ms"
        )

    return show


def _measured(session: Session) -> str:
    """The host's measure of success: robots in the cone, or the experiment's measures."""
    world, source = session.environment.world, session.experiment.source
    if source is None:
        return "".join(f"  {spoken(name)} {value:.3g}" for name, value in world.results.items())
    cone, robots = world.cone(source), world.robots
    places = np.stack((robots["x_m"], robots["y_m"]), axis=-1)
    return f"  in the cone {0 if cone is None else int(cone.contains(places).sum())}"


def _report_all(
    options: argparse.Namespace,
    session: Session,
    series: Series,
    rows: RunRows,
    console: Console,
) -> None:
    """Measures, writes and prints the figures of all runs."""
    summaries = []
    try:
        for number, recording in enumerate(session.recordings, 1):
            if len(recording.figures.steps):
                on_stdout = options.json and not series.several
                summaries.append(_report(session, number, on_stdout, console))
                if lacks := rows.add(summaries[-1], recording.ended, recording.experiment):
                    console.say(lacks, "trouble")
            else:
                console.say("vsense: the run ended before its first timestep: nothing was measured")
    finally:
        series.write_summary(session.experiment.name, summaries, options.json)


def _report(session: Session, number: int, on_stdout: bool, console: Console) -> dict[str, Any]:
    """Measures, writes, prints, and draws last."""
    recording = session.recordings[number - 1]
    measured = report.gather(session, recording)
    summary = report.summarise(session, number, measured)
    console.say(report.table(summary))
    run_directory.write_summary(recording.directory, summary, on_stdout)
    if summary["unlogged_timesteps"]:
        console.say("no picture: the logs end before the run")
        return summary
    path = recording.directory / f"{session.experiment.name}.png"
    report.draw(session, recording, measured, path)
    console.say(f"picture: {path}")
    return summary
