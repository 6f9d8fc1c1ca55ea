"""`vsense robot calibrate`: wheels, markers and sensors, measured with the overhead cameras."""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from vsense.base import clock
from vsense.base.errors import UsageError, VsenseError
from vsense.base.terminal import Console, interruption, print_data
from vsense.commands import arguments, experiments, hardware, robot_sensors, rosters
from vsense.config import roster
from vsense.config.casting import Casting
from vsense.config.experiment import first_robots, load
from vsense.config.placement import settle
from vsense.config.roster import Roster
from vsense.config.specs import Experiment, Stage
from vsense.modes.lab.hardware import LabRobots
from vsense.modes.lab.links import BASES
from vsense.modes.lab.session import Session
from vsense.modes.live.session import ExperimentSession, RunSession, RunSetup
from vsense.modes.live.sources import require_source
from vsense.monitor.ui.room import ControlRoom, RoomOptions
from vsense.robots.link import keys
from vsense.robots.link.keys import LinkTrust
from vsense.run import directory as run_directory
from vsense.tools.robot_calibration import driving, results
from vsense.tools.robot_calibration.commanding import CONTROLLER, SENSORS, WheelsWanted, commanded
from vsense.tools.robot_calibration.results import RobotResult
from vsense.tools.robot_calibration.sensing import Sensing

FILE = "calibration.json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the action's arguments."""
    arguments.add_experiment_name(parser)
    add_tracking(parser)
    rosters.add_roster(
        parser,
        "the lab's robots: what is found is written into it (default: it is only shown)",
        default="",
    )
    arguments.option(
        parser, "--robots", arguments.positive, "N", "take only the first N robots of the file"
    )
    arguments.option(
        *(parser, "--wait", arguments.seconds, "S"),
        "begin after S s at the latest, without robots that are missing (default: 20)",
        driving.PATIENCE_S,
    )
    arguments.option(
        *(parser, "-o --output", Path, "DIR"),
        f"folder for {FILE}: all numbers, with covariances (default: runs/...)",
    )
    arguments.flag(parser, "--json", "print the results as JSON")
    parser.add_argument(
        "--seed", type=arguments.natural, metavar="N", help="seed of the lab's places and light"
    )
    add_link(parser)
    robot_sensors.add_arguments(parser)
    lab = add_lab(parser, "calibrate a lab's robots, of which all is known")
    hardware.add_errors(lab, usual=True)


def add_tracking(parser: argparse.ArgumentParser) -> None:
    """Declares the cameras."""
    parser.add_argument(
        "--tracking",
        nargs=2,
        metavar=("RESOURCES", "SESSION"),
        help="the overhead cameras: these two files of `vsense track`",
    )


def add_lab(parser: argparse.ArgumentParser, text: str) -> Any:
    """Declares `--lab`, what it does, and of what the lab is made; gives the group of options."""
    lab = parser.add_argument_group("in the lab")
    arguments.flag(lab, "--lab", text)
    arguments.add_bases(parser, BASES)
    arguments.option(
        *(lab, "--pace", hardware.pace, "P"),
        "all clocks of the lab go at this share of real time, as in vsense lab (default: 1)",
        1.0,
    )
    return lab


def add_link(parser: argparse.ArgumentParser) -> None:
    """Declares where robots connect to, which are believed, and the page."""
    arguments.option(
        *(parser, "--host", str, "ADDRESS"),
        "interface that robots connect to, 0.0.0.0: all (default: the file's vss_host)",
    )
    arguments.option(
        parser, "--port", arguments.port, "P", "TCP and UDP port (default: the file's vss_port)"
    )
    experiments.add_key(parser)
    arguments.add_web(parser, insecure=False)
    experiments.add_insecure(
        parser, "take robots that have no key, too: whoever reaches the port can drive robots"
    )


def run(options: argparse.Namespace) -> int:
    """Calibrates all robots that can be.

    Returns:
        0; 1 where a robot was left out; 130 after Ctrl-C, 143 after SIGTERM.
    """
    known = rosters.roster_of(options, found=False)
    stage = Stage.LAB if options.lab else Stage.RUN
    casting = Casting.of(known, limit=options.robots)
    original = first_robots(load(options.experiment, stage=stage, casting=casting), options.robots)
    host = check_ends(options, original)
    if options.lab:
        return _run_leased(options, original, host, known)
    with experiments.lease_robots(options, original, host):
        return _run_leased(options, original, host, known)


def _run_leased(
    options: argparse.Namespace, original: Experiment, host: str, known: Roster | None
) -> int:
    """As `run`, with the robots that nobody else has."""
    seed = experiments.choose_seed(options, original)
    original = settle(original, seed, options.lab)
    wheels, sensing = WheelsWanted(), robot_sensors.sensing_of(options, original)
    experiment = commanded(original, wheels, None if sensing is None else sensing.readings)
    trust = LinkTrust(keys.make()) if options.lab else experiments.trust_of(options)
    directory = run_directory.make(options.output, experiment.name, seed)
    console = Console()
    if options.lab:
        clock.slow(round(options.pace * 1000))
    room_options = RoomOptions(web=arguments.web_of(options))
    with interruption() as interrupted, ControlRoom(room_options, console) as room:
        address = address_of(options, experiment, host)
        setup = RunSetup(experiment, seed, False, address, trust, console, interrupted, room, {})
        robots = hardware.robots_of(options, original) if options.lab else LabRobots()
        # Where markers sit is what is to be found.
        robots = robot_sensors.with_floor(replace(robots, markers={}), sensing)
        session = open_session(options, setup, directory, robots)
        found = _calibrate(options, session, wheels, sensing, directory, console, known, robots)
        if interrupted.is_set():
            console.say("vsense: interrupted; what was found until then is kept")
        _report(options, experiment, found, directory, console, known)
        if interrupted.is_set():
            return interrupted.code
    return 0 if all(one.is_whole for one in found) else 1


def check_ends(options: argparse.Namespace, experiment: Experiment) -> str:
    """The interface that robots connect to; UsageError where no tracker is named, or two are."""
    if not options.lab:
        require_source(experiment, options.tracking)
    elif options.tracking is not None:
        raise UsageError("--lab has cameras of its own: expected no --tracking")
    return experiment.host if options.host is None else str(options.host)


def address_of(options: argparse.Namespace, experiment: Experiment, host: str) -> tuple[str, int]:
    """Where robots connect to."""
    port = 0 if options.lab else experiment.port
    return host, port if options.port is None else options.port


def open_session(
    options: argparse.Namespace, setup: RunSetup, directory: Path, robots: LabRobots
) -> ExperimentSession:
    """Makes the lab, or what drives real robots."""
    if options.lab:
        return Session(setup, directory, options.base, options.firmware_watchdog, robots=robots)
    return RunSession(setup, options.tracking, None)


def _wait(session: ExperimentSession, limit_s: float) -> None:
    """Waits for robots; VsenseError where none is there."""
    there = session.wait_patiently(limit_s)
    if session.setup.interrupted.is_set():
        raise VsenseError("interrupted before anything was measured")
    if {robot.id for robot in session.experiment.robots} <= set(there.missing):
        # Without a tracker no timestep would ever come to leave them out.
        raise VsenseError(f"nobody can be calibrated: {there.missing_text()}")


def _calibrate(
    options: argparse.Namespace,
    session: ExperimentSession,
    wheels: WheelsWanted,
    sensing: Sensing | None,
    directory: Path,
    console: Console,
    known: Roster | None,
    robots: LabRobots,
) -> list[RobotResult]:
    """Drives all robots; one result for each."""
    experiment = session.experiment
    console.say(
        f"{len(experiment.robots)} robots with the controller '{CONTROLLER}', one after the other"
        f" where there is no room for all; files in {directory}"
    )
    with session:
        _wait(session, options.wait)
        swarm = driving.drive(session, wheels, directory, console.progress, sensing)
    console.end_progress()
    ended = session.runner.ended
    cut = "it was interrupted"
    if ended not in ("time", "interrupted"):
        cut = f"the calibration ended before its time: {ended}"
        console.say(cut, "warning")
    return [
        RobotResult(
            robot.tag,
            robot.id,
            swarm.found.get(robot.tag),
            swarm.failed.get(robot.tag, cut),
            robots.hardware.get(robot.tag),
            None if known is None else known.get(robot.tag),
            *swarm.sensors_of(robot.tag, cut),
        )
        for robot in experiment.robots
    ]


def _report(
    options: argparse.Namespace,
    experiment: Experiment,
    found: list[RobotResult],
    directory: Path,
    console: Console,
    known: Roster | None,
) -> None:
    """Shows what was found and keeps it."""
    worst = results.worst(found)
    told: dict[str, Any] = {
        "experiment": experiment.name,
        "robots": [one.as_json() for one in found],
        **({"worst_errors": worst} if worst else {}),
    }
    run_directory.write_summary(directory, told, options.json, FILE)
    if not options.json:
        print_data(results.table(found))
    if worst:
        console.say(_errors(worst))
    done = [one for one in found if one.fit is not None]
    if known is None or not done:
        return
    today = time.strftime("%Y-%m-%d")
    listed = [one for one in done if known.get(one.tag) is not None]
    roster.update(known.path, {one.tag: one.for_roster(today) for one in listed})
    for one in done:
        if one not in listed:
            console.say(f"{known.path} has no robot with tag {one.tag}: not written", "warning")
    console.say(
        f"written to {known.path}: {len(listed)} robots. Their markers count from the next run on;"
        f" 'vsense robot deploy' brings the wheels' factors and scales to the robots"
    )


def _errors(worst: Mapping[str, float]) -> str:
    """The largest errors in a line."""
    return (
        f"largest errors: marker {worst['marker_mm']:.2f} mm, {worst['marker_deg']:.2f}"
        f" degrees; distance {100 * worst['distance']:.2f} %, turn {100 * worst['turn']:.2f} %"
    ) + "".join(
        f"; {name} {worst[f'{name}_low']:.1f} raw and {100 * worst[f'{name}_width']:.1f} %"
        for name in SENSORS
        if f"{name}_low" in worst
    )
