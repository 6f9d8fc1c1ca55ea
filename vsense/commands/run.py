"""`vsense run`: an experiment with real robots."""

from __future__ import annotations

import argparse
from pathlib import Path

from vsense.commands import _arguments, _experiments, _hardware
from vsense.config.specs import LINES_PORT, Stage
from vsense.modes.live import experiment

DESCRIPTION = (
    "Runs an experiment with real robots. The arena state comes from cameras of your own"
    " (--tracking), or from the tracker that the experiment's <framework> names: one that speaks"
    " the original protocol (ats_host, ats_port) or any other one (<vs:tracker format='lines' />)."
    " All robots that are connected and seen start on one signal. Where arena states stay out the"
    " robots stand still until they are back; a robot that drops out may come back at any time. The"
    " run ends after its length, or with Ctrl-C."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    _experiments.add_experiment(parser, Stage.RUN)
    _experiments.add_settings(parser)
    add_ends(parser)
    _experiments.add_legacy_port(parser)
    text = (
        "wait for robots for S s at the longest, then start without those that are missing"
        " (default: wait for all)"
    )
    _arguments.option(parser, "--start-after", _arguments.seconds, "S", text)
    text = (
        "serve the devices of ARGoS's elements, such as <epuck_ground>, from the virtual world, as"
        " in the lab; the ring of proximity sensors stays the robots' own"
    )
    _arguments.flag(parser, "--virtual-devices", text)
    _arguments.option(
        parser, "-o --output", Path, "DIR", "folder for notes and figures (default: runs/...)"
    )
    _experiments.add_room(parser)


LINK_CHECK_S = 20.0


def add_ends(parser: argparse.ArgumentParser, link_check: float = 0.0) -> None:
    """Declares where the arena state comes from, and where the robots connect to.

    `link_check`: their links are measured for so long [s] unless something else is said.
    """
    eyes = parser.add_mutually_exclusive_group()
    text = "track with these two files of `vsense camera track`: cameras, or recordings instead"
    _arguments.session_files(eyes, "--tracking", text)
    text = (
        "use this tracker, whatever the file names: ADDRESS:PORT speaks the original protocol;"
        f" lines (port {LINES_PORT}) or lines:PORT is one that connects to this machine and writes"
        " lines, such as that of `vsense robot emulate`"
    )
    _arguments.option(eyes, "--tracker", _arguments.tracker, "WHERE", text)
    _arguments.add_link(parser, "; 0 takes a free one")
    _experiments.add_trust(parser)
    text = (
        "take robots that run another program than the file's, and note which (default: they are"
        " refused, and a run without them is invalid)"
    )
    _arguments.flag(parser, "--other-programs", text)
    parser.add_argument(
        "--link-check",
        type=_span,
        nargs="?",
        const=LINK_CHECK_S,
        default=link_check,
        metavar="S",
        help="before the first run measure the robots' links for so long under the run's own"
        " packets, while wheels stand; weak ones are named with what helps, and noted in runs.csv;"
        f" 0: do not (S without a number: {LINK_CHECK_S:g}; default: {link_check:g})",
    )


def _span(text: str) -> float:
    return 0.0 if text == "0" else _arguments.seconds(text)


def run(options: argparse.Namespace) -> int:
    """Runs an experiment with real robots; see `vsense.modes.live.experiment.run`."""
    asked = _experiments.options_of(options, Stage.RUN)
    if _experiments.is_dry(options, asked):
        return 0
    given = {"experiment": asked} | _experiments.staged_of(options)
    markers = _hardware.markers_of(options)
    return experiment.run(
        _arguments.fill(experiment.RealOptions, options, **given, markers=markers)
    )
