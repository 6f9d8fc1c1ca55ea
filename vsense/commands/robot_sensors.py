"""What `vsense robot calibrate --sensors` takes: which ones, before which wall, on which places."""

from __future__ import annotations

import argparse
import re
from dataclasses import replace
from typing import Any

from vsense.base.errors import UsageError
from vsense.commands import arguments
from vsense.config.specs import Experiment
from vsense.modes.lab.hardware import LabRobots
from vsense.run.homing.floor import DrivingFloor
from vsense.tools.robot_calibration.commanding import GROUND, PROXIMITY, SENSORS, OwnReadings
from vsense.tools.robot_calibration.places import Point, ground_places, spots
from vsense.tools.robot_calibration.sensing import Sensing

_NUMBER = r"\d+(?:\.\d+)?"
_PAIR = rf"(-?{_NUMBER}),(-?{_NUMBER})"

BLACK_M = 0.05
"""Radius of the black disc that lies on the lab's floor."""
GROUND_BASES = ("gctronic", "york")
"""Bases of the lab whose robots have a ground board."""


def add_arguments(parser: Any) -> None:
    """Declares which sensors are measured, and where."""
    # Or argparse would take "-0.5,-0.8" for an option.
    parser._negative_number_matcher = re.compile(rf"^{_PAIR}$|^-{_NUMBER}$")
    group = parser.add_argument_group("sensors, measured when wheels and marker are known")
    arguments.option(
        *(group, "--sensors", _sensors, "NAMES"),
        f"of the robots' own sensors: {','.join(SENSORS)}, or one of them (default: none)",
    )
    arguments.option(
        *(group, "--wall", str, "ID"),
        "proximity is measured before this white wall, a <box> of the experiment (default: before"
        " any that is near)",
    )
    for name in ("white", "black"):
        arguments.option(
            *(group, f"--{name}", _point, "X,Y"),
            f"where the floor is {name}, in m, for 4 cm around (default: the roomiest such place in"
            " the picture on the experiment's floor)",
        )


def sensing_of(options: argparse.Namespace, experiment: Experiment) -> Sensing | None:
    """What is measured and where; None: no sensors.

    Raises:
        UsageError: there is no such wall or place, or these options do not go together.
        ConfigError: the picture on the floor cannot be read.
    """
    wanted = options.sensors or ()
    for name, needed in (("wall", PROXIMITY), ("white", GROUND), ("black", GROUND)):
        if getattr(options, name) is not None and needed not in wanted:
            raise UsageError(f"--{name} is for {needed} sensors: expected --sensors {needed}")
    if not wanted:
        return None
    if GROUND in wanted and options.lab and options.base not in GROUND_BASES:
        raise UsageError(
            f"--lab with --base {options.base}: its robots have no ground sensors; expected --base"
            f" {' or '.join(GROUND_BASES)}"
        )
    ground = None
    if GROUND in wanted:
        ground = ground_places(experiment, options.white, options.black)
    before = spots(experiment, options.wall) if PROXIMITY in wanted else ()
    return Sensing(DrivingFloor.of(experiment), before, ground, OwnReadings(wanted))


def with_floor(robots: LabRobots, sensing: Sensing | None) -> LabRobots:
    """The lab's robots on a floor that is black where it shall be."""
    if sensing is None or sensing.ground is None:
        return robots
    return replace(robots, black=((*sensing.ground.black, BLACK_M),))


def _sensors(text: str) -> tuple[str, ...]:
    names = tuple(dict.fromkeys(text.split(",")))
    if not set(names) <= set(SENSORS):
        raise argparse.ArgumentTypeError(
            f"'{text}': expected {' or '.join(SENSORS)}, or both with a comma between"
        )
    return names


def _point(text: str) -> Point:
    found = re.fullmatch(_PAIR, text)
    if found is None:
        raise argparse.ArgumentTypeError(f"'{text}': expected x and y in m, such as 0.5,-0.8")
    return float(found[1]), float(found[2])
