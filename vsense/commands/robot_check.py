"""`vsense robot check`: who is there, and whether everybody wears its own marker."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from vsense.base import clock
from vsense.base.terminal import Console, aligned, interruption, print_data
from vsense.commands import arguments, experiments, hardware, robot_calibrate, rosters
from vsense.config.casting import Casting
from vsense.config.experiment import first_robots, load
from vsense.config.placement import settle
from vsense.config.roster import Roster
from vsense.config.specs import Experiment, Stage
from vsense.modes.lab.hardware import LabRobots
from vsense.modes.live.session import ExperimentSession, RunSetup
from vsense.monitor.ui.room import ControlRoom, RoomOptions
from vsense.robots.link import keys
from vsense.robots.link.keys import LinkTrust
from vsense.run import directory as run_directory
from vsense.run.control import State
from vsense.tools.robot_calibration import driving
from vsense.tools.robot_calibration.wiggle import Verdict, WiggleCheck, WiggledRobot, exchanged

FILE = "check.json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the action's arguments."""
    arguments.add_experiment_name(parser)
    arguments.flag(
        parser,
        "--wiggle",
        "each robot turns 20 degrees and back in its turn, all others stand: the marker that turns"
        " must be its own (default: nobody moves, it is only looked who is connected and seen)",
    )
    robot_calibrate.add_tracking(parser)
    rosters.add_roster(parser, "the lab's robots: who plays, and what of it has to be changed")
    arguments.option(
        parser, "--robots", arguments.positive, "N", "take only the first N robots of the file"
    )
    arguments.option(
        *(parser, "--wait", arguments.seconds, "S"),
        "begin after S s at the latest, without robots that are missing (default: 20)",
        driving.PATIENCE_S,
    )
    arguments.option(
        *(parser, "-o --output", Path, "DIR"), f"folder for {FILE} (default: runs/...)"
    )
    arguments.flag(parser, "--json", "print what was found as JSON")
    parser.add_argument(
        "--seed", type=arguments.natural, metavar="N", help="seed of the lab's places and light"
    )
    robot_calibrate.add_link(parser)
    lab = robot_calibrate.add_lab(parser, "check a lab's robots, of which some may have a fault")
    hardware.add_errors(lab)
    hardware.add_faults(lab)


def run(options: argparse.Namespace) -> int:
    """Checks all robots.

    Returns:
        0; 1 where one is not as it should be; 130 after Ctrl-C, 143 after SIGTERM.
    """
    known = rosters.roster_of(options, found=not options.lab)
    stage = Stage.LAB if options.lab else Stage.RUN
    casting = Casting.of(known, limit=options.robots)
    experiment = first_robots(
        load(options.experiment, stage=stage, casting=casting), options.robots
    )
    host = robot_calibrate.check_ends(options, experiment)
    if options.lab:
        return _run_leased(options, experiment, host, known)
    with experiments.lease_robots(options, experiment, host):
        return _run_leased(options, experiment, host, known)


def _run_leased(
    options: argparse.Namespace, experiment: Experiment, host: str, known: Roster | None
) -> int:
    """As `run`, with the robots that nobody else has."""
    seed = experiments.choose_seed(options, experiment)
    experiment = settle(experiment, seed, options.lab)
    robots = hardware.robots_of(options, experiment) if options.lab else LabRobots()
    directory = run_directory.make(options.output, f"{experiment.name}-check", seed)
    console = Console()
    if options.lab:
        clock.slow(round(options.pace * 1000))
    trust = LinkTrust(keys.make()) if options.lab else experiments.trust_of(options)
    room_options = RoomOptions(web=arguments.web_of(options))
    with interruption() as interrupted, ControlRoom(room_options, console) as room:
        address = robot_calibrate.address_of(options, experiment, host)
        setup = RunSetup(experiment, seed, False, address, trust, console, interrupted, room, {})
        session = robot_calibrate.open_session(options, setup, directory, robots)
        found = _check(options, session, directory)
        console.end_progress()
        _report(options, experiment, found, directory, known, console)
        if interrupted.is_set():
            console.say("vsense: interrupted; what was found until then is kept")
            return interrupted.code
    return 0 if all(robot.verdict is Verdict.OK for robot in found) else 1


def _check(
    options: argparse.Namespace, session: ExperimentSession, directory: Path
) -> Sequence[WiggledRobot]:
    """Looks who is there, and has everybody turn if that is wanted."""
    console, names = session.setup.console, {r.tag: r.id for r in session.experiment.robots}
    check = WiggleCheck(names)
    with session:
        session.setup.room.begin_run(session.environment, directory)
        try:
            readiness = session.wait_patiently(options.wait)
            if not readiness.complete:
                console.say(readiness.missing_text(), "warning")
            if not options.wiggle:
                away = dict.fromkeys(readiness.unseen, "is not seen")
                away |= dict.fromkeys(readiness.absent, "is not connected") | dict(readiness.away)
                return [
                    WiggledRobot(tag, name, why=away.get(name, ""), commanded=False)
                    for tag, name in names.items()
                ]
            console.say(f"{len(names)} robots turn one after the other: keep hands off")
            session.runner.home(check)
        finally:
            session.stop()
            session.setup.room.recorders.end_run()
    control = session.runner.control
    stopped = control.why if control.state in (State.ENDED, State.EMERGENCY) else ""
    return check.ended(stopped if stopped.startswith(("stop", "emerg")) else "was not reached")


def _report(
    options: argparse.Namespace,
    experiment: Experiment,
    found: Sequence[WiggledRobot],
    directory: Path,
    known: Roster | None,
    console: Console,
) -> None:
    """Shows what was found, and what is to be changed."""
    advice = [line for pair in exchanged(found) for line in swapped(pair, known)]
    told: dict[str, Any] = {
        "experiment": experiment.name,
        "wiggled": options.wiggle,
        "robots": [as_json(robot) for robot in found],
        "exchanged": [list(pair) for pair in exchanged(found)],
    }
    run_directory.write_summary(directory, told, options.json, FILE)
    if not options.json:
        rows = [(str(r.tag), r.name, r.verdict.value, r.words) for r in found]
        print_data("\n".join(aligned([("tag", "robot", "", ""), *rows])))
    for line in advice:
        console.say(line, "warning")
    good = sum(robot.verdict is Verdict.OK for robot in found)
    console.say(f"{good} of {len(found)} robots are as they should be; {directory / FILE}")


def as_json(robot: WiggledRobot) -> dict[str, Any]:
    """A robot for programs."""
    moved_m = robot.moved_m
    return {
        "tag": robot.tag,
        "name": robot.name,
        "verdict": robot.verdict.value,
        "turned_deg": {
            str(marker): round(math.degrees(rad), 1) for marker, rad in robot.turned_rad.items()
        },
        "moved_mm": None if moved_m is None else round(1000.0 * moved_m, 1),
        "text": robot.words,
    }


def swapped(pair: tuple[int, int], known: Roster | None) -> list[str]:
    """What is to be done about two robots that wear each other's markers."""
    one, other = pair
    line = f"robots {one} and {other} wear each other's markers: exchange these"
    entries = [None if known is None else known.get(tag) for tag in pair]
    if known is None or None in entries:
        return [f"{line}, or their tags in the roster, and bring them there: vsense robot deploy"]
    lines = [0 if entry is None else entry.line for entry in entries]
    return [
        f"{line}, or their tags in {known.path}: tag = {other} for the robot of line {lines[0]},"
        f" tag = {one} for that of line {lines[1]}, and then"
        f" vsense robot deploy --tags {one},{other}"
    ]
