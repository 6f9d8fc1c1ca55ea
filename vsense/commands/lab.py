"""`vsense lab`: an experiment on this machine."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import Any

from vsense.commands import _arguments, _experiments, _hardware
from vsense.config.specs import Stage
from vsense.modes.lab import experiment
from vsense.modes.lab.hardware import BASES, EmulatedLab

DESCRIPTION = (
    "Runs an experiment in real time on this machine. Everything between the camera's pixels and"
    " the motor command is the real thing: the tracker, the world, the network and one vsensed per"
    " robot; only photons and wheels are simulated."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    _experiments.add_experiment(parser, Stage.LAB)
    _experiments.add_settings(parser)
    _arguments.add_bases(parser, BASES)
    text = "TCP and UDP port (default: any that is free)"
    _arguments.option(parser, "--port", _arguments.port, "P", text)
    _experiments.add_insecure(
        parser, "give the lab's robots no keys (default: keys that are made for this lab alone)"
    )
    _experiments.add_legacy_port(parser)
    _arguments.option(
        parser, "-o --output", Path, "DIR", "folder for picture and logs (default: runs/...)"
    )
    add_cameras(parser)
    add_pace(parser)
    _hardware.add_robots(parser)
    _experiments.add_room(parser)


def add_pace(group: Any) -> None:
    """Declares how fast the lab's clocks go."""
    text = (
        "all clocks of the lab go at this share of real time, 0.01 to 1, where this machine"
        " cannot keep up with more (default: 1)"
    )
    _arguments.option(group, "--pace", _hardware.pace, "P", text, 1.0)


def add_cameras(group: Any) -> None:
    """Declares how many cameras the lab has, and how well they are known."""
    text = (
        "so many columns and rows of cameras, up to 8x8; they hang so high, and have so many"
        " pixels, that they see the whole arena (default: as many as it takes, 2x2 at least)"
    )
    _arguments.option(group, "--cameras", _grid, "CxR", text)
    text = (
        "hang the cameras as people do, a little off, and know them only from rendered pictures of"
        " a board, as `vsense camera calibrate rig` would (default: the cameras are known exactly)"
    )
    _arguments.flag(group, "--calibrate", text)


def _grid(text: str) -> tuple[int, int]:
    pattern, expected = r"([1-9][0-9]?)x([1-9][0-9]?)", "columns and rows, such as 4x4"
    match = _arguments.matched(pattern, text, expected)
    return int(match[1]), int(match[2])


def run(options: argparse.Namespace) -> int:
    """Runs an experiment in the lab; see `vsense.modes.lab.experiment.run`."""
    asked = _experiments.options_of(options, Stage.LAB)
    if _experiments.is_dry(options, asked):
        return 0
    # The lab has robots, keys and cameras of its own.
    absent = ("host", "key", "tracking", "tracker", "other_programs", "link_check")
    staged = _experiments.staged_of(options, *absent)
    given = {"experiment": asked, "lab": lab_of(options), **staged}
    return experiment.run(_arguments.fill(experiment.LabOptions, options, **given))


def lab_of(options: argparse.Namespace) -> EmulatedLab:
    """Returns what the lab's options declare."""
    robots = partial(_hardware.robots_of, options)
    return _arguments.fill(EmulatedLab, options, robots=robots)
