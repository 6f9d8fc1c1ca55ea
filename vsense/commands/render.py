"""`vsense camera render`: the lab's pictures as files for `vsense camera track`."""

from __future__ import annotations

import argparse
from pathlib import Path

from vsense.base.terminal import Console
from vsense.commands import _arguments
from vsense.config.experiment import load
from vsense.config.specs import Stage
from vsense.modes.lab.recorder import record

DESCRIPTION = (
    "Draws what the lab's cameras see of an experiment's robots wandering about, and writes what"
    " real cameras would leave: pictures with timestamps, camera files, the two configuration files"
    " of `vsense camera track`, and truth.csv, where every robot truly was. No robot's program"
    " runs, and nothing is recorded: `vsense lab --record` does that."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    _arguments.add_experiment_name(parser)
    parser.add_argument("directory", type=Path, help="folder for all of it, made if need be")
    _arguments.option(
        parser, "--frames", _arguments.positive, "N", "timesteps to draw (default: 100)", 100
    )
    _arguments.option(
        parser, "--seed", _arguments.natural, "N", "seed of poses, ways and noise (default: 1)", 1
    )
    text = "pictures' format: png (default), jpg (small, not exact), pgm (fast, large)"
    _arguments.choice(parser, "--format", ("png", "jpg", "pgm"), text, "png")


def run(options: argparse.Namespace) -> int:
    """Draws; see `vsense.modes.lab.recorder.record`."""
    console = Console()
    if options.command == "record":
        console.say("vsense: 'record' is called 'render' now: it records nothing")
    console.progress("building the scene")
    record(
        load(options.experiment, stage=Stage.LAB),
        options.directory,
        options.frames,
        options.seed,
        options.format,
        lambda done: console.progress(f"{done} of {options.frames} timesteps drawn"),
    )
    console.end_progress()
    console.say(
        f"vsense: drawn into {options.directory}; now:"
        f" vsense camera track {options.directory}/resources.xml {options.directory}/experiment.xml"
        " --offline"
    )
    return 0
