"""`vsense robot calibrate` and `robot check`: robots below the overhead cameras, hands off."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from functools import partial
from pathlib import Path
from typing import Any

from vsense.base.errors import UsageError
from vsense.commands import _arguments, _experiments, _hardware, _rosters
from vsense.config.casting import Casting
from vsense.config.experiment import first_robots, load
from vsense.config.placement import settle
from vsense.config.roster import Roster
from vsense.config.specs import Stage
from vsense.modes.lab.hardware import BASES, EmulatedLab
from vsense.modes.live import opening
from vsense.modes.live.opening import LinkOptions
from vsense.modes.options import choose_seed
from vsense.monitor.ui.room import RoomOptions
from vsense.robots.link.key_process import KeyProcess
from vsense.robots.link.keys import LinkTrust
from vsense.tools.robot_calibration import measuring
from vsense.tools.robot_calibration.measuring import MeasuringOptions, SensorOptions

_NUMBER = r"\d+(?:\.\d+)?"
_PAIR = rf"(-?{_NUMBER}),(-?{_NUMBER})"


def add_calibrate(parser: argparse.ArgumentParser) -> None:
    """Declares the arguments of `robot calibrate`."""
    _arguments.add_experiment_name(parser)
    _add_tracking(parser)
    _rosters.add_roster(
        parser,
        "the lab's robots: what is found is written into it (default: it is only shown)",
        default="",
    )
    folder = f"folder for {measuring.CALIBRATION_FILE}: all numbers, with covariances"
    _add_session(parser, folder, "print the results as JSON")
    _add_sensors(parser)
    lab = _add_lab(parser, "calibrate a lab's robots, of which all is known")
    _hardware.add_errors(lab, usual=True)


def add_check(parser: argparse.ArgumentParser) -> None:
    """Declares the arguments of `robot check`."""
    _arguments.add_experiment_name(parser)
    text = (
        "each robot turns 20 degrees and back in its turn, all others stand: the marker that turns"
        " must be its own (default: no robot moves, only those connected and seen are listed)"
    )
    _arguments.flag(parser, "--wiggle", text)
    _add_tracking(parser)
    _rosters.add_roster(parser, "the lab's robots: which take part, and what is to be changed")
    _add_session(parser, f"folder for {measuring.CHECK_FILE}", "print what was found as JSON")
    lab = _add_lab(parser, "check a lab's robots, of which some may have a fault")
    _hardware.add_errors(lab)
    _hardware.add_faults(lab)


def _add_tracking(parser: argparse.ArgumentParser) -> None:
    text = "the overhead cameras: these two files of `vsense camera track`"
    _arguments.session_files(parser, "--tracking", text)


def _add_session(parser: argparse.ArgumentParser, folder: str, json_text: str) -> None:
    """Declares who takes part, where files go, how robots connect, and the page."""
    option = _arguments.option
    option(parser, "--robots", _arguments.positive, "N", _experiments.ROBOTS)
    text = "begin after S s at the latest, without robots that are missing (default: 20)"
    _arguments.option(parser, "--wait", _arguments.seconds, "S", text, measuring.ROBOTS_WAIT_S)
    option(parser, "-o --output", Path, "DIR", f"{folder} (default: runs/...)")
    _arguments.flag(parser, "--json", json_text)
    option(parser, "--seed", _arguments.natural, "N", "seed of the lab's places and light")
    _arguments.add_link(parser)
    _experiments.add_key(parser)
    _arguments.add_web(parser, insecure=False)
    _experiments.add_insecure(
        parser, "take robots that have no key, too: anyone on the network can drive robots"
    )


def _add_lab(parser: argparse.ArgumentParser, text: str) -> Any:
    """Declares `--lab`, what it does, and of what the lab is made; gives the group of options."""
    lab = parser.add_argument_group("in the lab")
    _arguments.flag(lab, "--lab", text)
    _arguments.add_bases(parser, BASES)
    text = "all clocks of the lab go at this share of real time, as in vsense lab (default: 1)"
    _arguments.option(lab, "--pace", _hardware.pace, "P", text, 1.0)
    return lab


def _add_sensors(parser: Any) -> None:
    # Or argparse would take "-0.5,-0.8" for an option.
    parser._negative_number_matcher = re.compile(rf"^{_PAIR}$|^-{_NUMBER}$")
    group = parser.add_argument_group("sensors, measured when wheels and marker are known")
    names = ",".join(SensorOptions.KNOWN)
    text = f"of the robots' own sensors: {names}, or one of them (default: none)"
    _arguments.option(group, "--sensors", _sensors, "NAMES", text, ())
    text = "proximity is measured before this white wall, a <box> of the experiment (default:"
    _arguments.option(group, "--wall", str, "ID", f"{text} before any that is near)")
    for name in ("white", "black"):
        text = (
            f"where the floor is {name}, in m, for 4 cm around (default: the roomiest such place in"
            " the picture on the experiment's floor)"
        )
        _arguments.option(group, f"--{name}", _point, "X,Y", text)


def calibrate(options: argparse.Namespace) -> int:
    """Calibrates all robots that can be; see `measuring.calibrate`."""
    with _measuring(options, _rosters.roster_of(options, here=False)) as wanted:
        return measuring.calibrate(wanted, _arguments.fill(SensorOptions, options))


def check(options: argparse.Namespace) -> int:
    """Checks all robots; see `measuring.check`."""
    with _measuring(options, _rosters.roster_of(options, here=not options.lab)) as wanted:
        return measuring.check(wanted, options.wiggle)


@contextmanager
def _measuring(options: argparse.Namespace, roster: Roster | None) -> Iterator[MeasuringOptions]:
    """Reads what the options name, and takes the robots.

    Raises:
        UsageError: no tracker is named, or two are; the robots have no keys; the page lacks
            something.
        LeasedError: another run has some of the robots.
    """
    stage = Stage.LAB if options.lab else Stage.RUN
    casting = Casting.of(roster, limit=options.robots)
    experiment = first_robots(
        load(options.experiment, stage=stage, casting=casting), options.robots
    )
    if not options.lab:
        opening.require_source(experiment, options.tracking)
    elif options.tracking is not None:
        raise UsageError("--lab has cameras of its own: expected no --tracking")
    host, port = LinkOptions(options.host, options.port).address(experiment)
    port = 0 if options.lab and options.port is None else port
    tags = [robot.tag for robot in experiment.robots]
    lease = partial(opening.lease_robots, tags, options.command, experiment.name, host)
    web = _arguments.web_of(options)
    with nullcontext() if options.lab else lease():
        opening.check_ports(RoomOptions(web), LinkOptions(host, port), experiment)
        seed = choose_seed(options.seed, experiment)
        experiment = settle(experiment, seed, options.lab)
        yield MeasuringOptions(
            experiment=experiment,
            seed=seed,
            address=(host, port),
            trust=LinkTrust(KeyProcess()) if options.lab else _experiments.trust_of(options),
            tracking=options.tracking,
            lab=_lab_of(options) if options.lab else None,
            roster=roster,
            web=web,
            wait_s=options.wait,
            output=options.output,
            as_json=options.json,
        )


def _lab_of(options: argparse.Namespace) -> EmulatedLab:
    robots = partial(_hardware.robots_of, options)
    return _arguments.fill(EmulatedLab, options, "cameras", "calibrate", robots=robots)


def _sensors(text: str) -> tuple[str, ...]:
    names = tuple(dict.fromkeys(text.split(",")))
    if not set(names) <= set(SensorOptions.KNOWN):
        raise argparse.ArgumentTypeError(
            f"'{text}': expected {' or '.join(SensorOptions.KNOWN)}, or both with a comma between"
        )
    return names


def _point(text: str) -> tuple[float, float]:
    match = _arguments.matched(_PAIR, text, "x and y in m, such as 0.5,-0.8")
    return float(match[1]), float(match[2])
