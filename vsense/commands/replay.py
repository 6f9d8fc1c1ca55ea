"""`vsense replay`: a recording again, in the page or through the tracker."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path

from vsense.base.errors import UsageError
from vsense.base.interruption import interruption
from vsense.base.terminal import Console, print_data
from vsense.commands import _arguments, _experiments
from vsense.monitor import recording

DESCRIPTION = (
    "Plays a recording in the page, with pause, speed and a time line. With --retrack it runs the"
    " tracker again on the recorded pictures instead, and prints what differs: nothing with the"
    " recorded settings, in every bit. With --resense it makes the virtual world again, from the"
    " recorded arena states, the robots' deeds and what people changed, and compares the readings."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    parser.add_argument("file", type=Path, help="the recording (.mcap), or its run's folder")
    _experiments.add_doors(parser, _arguments.WEB)
    _arguments.option(parser, "--speed", float, "X", "times the real speed (default: 1)", 1.0)
    group = parser.add_argument_group("tracking again")
    _arguments.flag(group, "--retrack", "run the tracker again and compare")
    text = (
        "another setting of the tracker: limits.max_speed_m_s=0.3, plan.key_frame_period=5,"
        " tracker.height_m=0.05, ...; may be given again"
    )
    _arguments.repeated(group, "--set", _arguments.setting, "GROUP.NAME=VALUE", text)
    text = "the settings of a tracking session's two files instead of the recorded ones"
    _arguments.session_files(group, "--session", text, "EXPERIMENT")
    world = parser.add_argument_group("sensing again")
    text = "make the virtual world again, with what people changed in it, and compare the readings"
    _arguments.flag(world, "--resense", text)
    _arguments.option(
        world, "--experiment", Path, "FILE", "the experiment's file, where it is no longer there"
    )
    _arguments.flag(parser, "--json", "print the comparison as JSON")


def run(options: argparse.Namespace) -> int:
    """Plays a recording, tracks or senses again; 0, 1 where readings differ, or 130 (143 by
    SIGTERM) where it was interrupted, as playing ends.
    """
    recording.require()
    from vsense.monitor.replay import ReplayOptions, replay

    if options.json and not (options.retrack or options.resense):
        raise UsageError("--json belongs to --retrack and --resense")
    doors = _experiments.doors_of(options)
    wanted = _arguments.fill(ReplayOptions, options, **doors, settings=dict(options.set))
    with interruption() as interrupted:
        comparison = replay(options.file, wanted, Console(), interrupted)
        if comparison is None:
            return interrupted.code
    print_data(json.dumps(asdict(comparison)) if options.json else "\n".join(comparison.lines()))
    return comparison.exit_code
