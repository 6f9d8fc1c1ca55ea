"""Options that say what robots of the lab differ in."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from vsense.base.errors import UsageError
from vsense.commands import _arguments, _rosters
from vsense.config.roster_fields import MarkerOffset
from vsense.config.specs import Experiment
from vsense.run.cast import spares_for

if TYPE_CHECKING:
    from vsense.modes.lab.hardware import EmulatedRadio, HardwareErrors, LabRobots

_NUMBER = r"\d+(?:\.\d+)?"


def add_errors(parser: Any, usual: bool = False) -> None:
    """Declares what is drawn; nothing by default, or `usual` errors."""
    marker, wheel, sensor = ("4,5", "5", "20") if usual else ("0,0", "0", "0")
    option = _arguments.option
    text = "each robot's marker sits up to so many mm and degrees off its middle"
    text = f"{text} (default: {marker})"
    option(parser, "--marker-errors", _marker, "MM,DEG", text, _marker(marker))
    text = f"each wheel and axle is up to so much larger or smaller, 0 to 9 (default: {wheel})"
    option(parser, "--wheel-errors", _percent(9), "PERCENT", text, _percent(9)(wheel))
    text = (
        "each proximity and ground sensor is up to so much more or less sensitive, 0 to 50, and"
        f" reads something else of nothing (default: {sensor})"
    )
    option(parser, "--sensor-errors", _percent(50), "PERCENT", text, _percent(50)(sensor))
    text = "seed of what robots differ in: with another one they are other robots (default: 0)"
    option(parser, "--robots-seed", _arguments.natural, "N", text, 0)


def add_robots(parser: argparse.ArgumentParser) -> None:
    """Declares what robots of `vsense lab` differ in; its `--roster` says what is known of it."""
    add_errors(parser)
    add_radios(parser)


def add_radios(parser: Any) -> None:
    """Declares which emulated robots have a Wi-Fi radio, and what it tells."""
    text = (
        "robot TAG reports a Wi-Fi with this signal and bit rate, whose power saving is on"
        " with saves: 23=-84,5.5,saves; no packet is lost for it; may be given again (default: no"
        " robot has one)"
    )
    _arguments.repeated(parser, "--radio", _radio, "TAG=DBM[,MBIT_S][,saves]", text)


def radios_of(options: argparse.Namespace, experiment: Experiment) -> dict[int, EmulatedRadio]:
    """Returns what `add_radios` declares, by tag; UsageError: the experiment has no such robot."""
    radios = dict(options.radio)
    tags = [robot.tag for robot in experiment.robots]
    for tag in radios:
        if tag not in tags:
            there = ", ".join(map(str, tags))
            raise UsageError(f"--radio {tag}: {experiment.file} has {there}")
    return radios


def add_faults(parser: Any) -> None:
    """Declares faults that a lab's robots have."""
    text = "these two robots wear each other's markers; may be given again"
    _arguments.repeated(parser, "--swap-markers", _rosters.tag_pair, "TAG=TAG", text)
    text = "the wheels of these robots do not turn, such as 23,30"
    _arguments.option(parser, "--dead-motors", _arguments.numbers, "TAGS", text, ())


def errors_of(options: argparse.Namespace) -> HardwareErrors:
    """Returns what `add_errors` declares."""
    from vsense.modes.lab.hardware import HardwareErrors

    marker_m, marker_rad = options.marker_errors
    wheel, sensor = options.wheel_errors, options.sensor_errors
    return HardwareErrors(marker_m, marker_rad, wheel, options.robots_seed, sensor)


def robots_of(options: argparse.Namespace, experiment: Experiment) -> LabRobots:
    """The lab's robots: what is drawn of them, and what `--roster` knows of them.

    Raises:
        UsageError: the roster cannot be read, or no robot has the tag of a fault.
        ConfigError: something in it is wrong.
    """
    from vsense.modes.lab.hardware import LabRobots, draw_all

    tags = [robot.tag for robot in experiment.robots]
    dead, worn = getattr(options, "dead_motors", ()), dict[int, int]()
    for tag, other in getattr(options, "swap_markers", ()):
        worn |= {tag: worn.get(other, other), other: worn.get(tag, tag)}
    if unknown := (set(dead) | worn.keys()) - set(tags):
        there = ", ".join(map(str, tags))
        raise UsageError(f"no robot has tag {min(unknown)}; expected some of {there}")
    everybody = [*tags, *spares_for(experiment)]
    drawn = draw_all(everybody, errors_of(options), dead, experiment.models)
    radios = radios_of(options, experiment) if "radio" in options else {}
    roster = _rosters.roster_of(options, here=False)
    if roster is None:
        return LabRobots(drawn, worn=worn, radios=radios)
    settings = {robot.tag: roster.settings_of(robot) for robot in roster.robots}
    return LabRobots(drawn, roster.markers, settings, worn, radios)


def markers_of(options: argparse.Namespace) -> dict[int, MarkerOffset]:
    """Where markers sit on their robots, as the roster has it; raises as `rosters.roster_of`."""
    roster = _rosters.roster_of(options)
    return {} if roster is None else roster.markers


def _marker(text: str) -> tuple[float, float]:
    match = re.fullmatch(rf"({_NUMBER}),({_NUMBER})", text)
    if match is None or float(match[1]) > 20.0 or float(match[2]) > 180.0:
        raise argparse.ArgumentTypeError(f"'{text}': expected mm and degrees, such as 4,5")
    return float(match[1]) / 1000.0, math.radians(float(match[2]))


def _radio(text: str) -> tuple[int, EmulatedRadio]:
    from vsense.modes.lab.hardware import read_radio

    return _arguments.parsed(read_radio)(text)


def _percent(most: int) -> Callable[[str], float]:
    def read(text: str) -> float:
        if not re.fullmatch(_NUMBER, text) or float(text) > most:
            raise argparse.ArgumentTypeError(
                f"'{text}': expected a percentage from 0 to {most}, such as 5"
            )
        return float(text) / 100.0

    return read


def pace(text: str) -> float:
    """Reads the pace of a lab's clocks."""
    return round(_arguments.number(0.01, 1.0, "0.01 to 1, such as 0.5")(text), 3)
