"""`vsense camera markers`: sheets of markers to print, and markers in pictures."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from vsense.base.errors import UsageError
from vsense.base.terminal import Console, drop_output, print_data
from vsense.commands import _arguments
from vsense.config import roster
from vsense.tools.camera_setup import photographs
from vsense.vision.markers import sheet
from vsense.vision.markers.families import confusion, load_family
from vsense.vision.markers.sheet import SheetOptions
from vsense.vision.tracking.squares import LEAST_SIDE_PX

DESCRIPTION = (
    "Writes sheets of markers, true to scale, as PDF or PNG. Print them at 100 %: the bar at the"
    " foot of each page must measure 100 mm. 'find' looks for ArUco and AprilTag markers in any"
    " pictures instead."
)

_FAMILY = "arrow4x4"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    text = (
        "marker family: a shipped one's name, or a definition file (default: arrow4x4, or the"
        " experiment's)"
    )
    _arguments.option(parser, "--family", str, "NAME", text)
    _add_which(parser.add_mutually_exclusive_group())
    text = "diameter of the white disc, such as 70mm (default: the family's)"
    _arguments.option(parser, "--size", _arguments.length_mm, "SIZE", text)
    _arguments.choice(parser, "--paper", ("a4", "letter"), "paper (default: a4)", "a4")
    _arguments.option(parser, "--dpi", _dpi, "N", "resolution of PNGs (default: 300)", 300)
    text = "file.pdf, or file.png; several pages become file-1.png, file-2.png, ..."
    _arguments.option(parser, "-o --output", Path, "FILE", text)
    _arguments.flag(parser, "--json", "print the sheets' files and the tags as one JSON object")
    actions = parser.add_subparsers(title="actions", metavar="ACTION", dest="action")
    _add_find(_arguments.add_action(actions, "find", "find ArUco and AprilTag markers in pictures"))


def _add_which(which: Any) -> None:
    text = (
        "1-20, or 3,7,20-22, or auto:20 for 20 numbers that stay apart under blur; robots of"
        " an experiment without tags wear the same ones"
    )
    _arguments.option(which, "--ids", str, "IDS", text)
    text = "the markers of a lab's robots, spares included, with their names: robots.toml"
    _arguments.option(which, "--roster", Path, "FILE", text)
    which.add_argument(
        "--for",
        dest="wearer",
        metavar="EXPERIMENT",
        help="the markers of an experiment's robots and tagged objects, with their names",
    )


def _add_find(parser: argparse.ArgumentParser) -> None:
    text = "picture files, and folders of pictures; of any camera, calibrated or not"
    _arguments.many(parser, "pictures", Path, "PICTURE", text)
    text = (
        "markers to look for: one of OpenCV's dictionaries, such as DICT_4X4_50 or"
        " DICT_APRILTAG_36h11, a dictionary file (.yml), or a family of vsense that is no arrow"
    )
    _arguments.option(parser, "--family", str, "NAME", text, required=True)
    text = "jsonl: one object per picture (default); csv: one row per marker"
    _arguments.choice(parser, "--format", ("jsonl", "csv"), text, "jsonl")
    text = "write each picture there as PNG, with what was found drawn in"
    _arguments.option(parser, "--draw", Path, "DIR", text)
    text = f"shortest side of a marker (default: {LEAST_SIDE_PX:g}); 20 and more is faster"
    side = _arguments.number(5.0, 10_000.0, "5 to 10000 pixels")
    _arguments.option(parser, "--least-side", side, "PX", text, LEAST_SIDE_PX)


def run(options: argparse.Namespace) -> int:
    """Writes the sheets; their names go to standard output. Or runs the action."""
    if options.action is None:
        return _print(options)
    try:
        return photographs.run(_arguments.fill(photographs.FindOptions, options))
    except BrokenPipeError:
        drop_output()
        return 0


def _print(options: argparse.Namespace) -> int:
    output: Path | None = options.output
    if output is None or (options.ids is options.wearer is options.roster is None):
        raise UsageError(
            "expected -o and --ids, --roster or --for for sheets, or the action find; see --help"
        )
    wanted = SheetOptions(output, _FAMILY, options.ids or "", paper=options.paper, dpi=options.dpi)
    if options.wearer is not None:
        wanted = _worn(options.wearer, wanted)
    elif options.roster is not None:
        wanted = _owned(options.roster, wanted)
    family = options.family or wanted.family
    sheets = sheet.write(replace(wanted, family=family, size_mm=options.size))
    if options.json:
        facts = {"files": [str(name) for name in sheets.files], "tags": sheets.tags}
        print_data(json.dumps(facts))
    else:
        print_data("\n".join(str(name) for name in sheets.files))
    Console().say(f"vsense: tags {' '.join(map(str, sheets.tags))}")
    for words in (confusion(load_family(family), sheets.tags), sheets.too_large):
        if words:
            Console().say(f"vsense: {words}", "warning")
    if sheets.scale:
        Console().say(f"vsense: {sheets.scale}")
    return 0


def _worn(experiment: str, wanted: SheetOptions) -> SheetOptions:
    """Sheets of an experiment's marker family, for its robots and tagged objects."""
    from vsense.config.experiment import load  # nobody else here needs it

    worn = load(experiment)
    names = {body.tag: body.id for body in worn.bodies}
    bodies_mm = {body.tag: 2000.0 * body.model.radius_m for body in worn.bodies}
    return replace(wanted, family=worn.marker.family, names=names, bodies_mm=bodies_mm)


def _owned(path: Path, wanted: SheetOptions) -> SheetOptions:
    """Sheets for a lab's robots; bodies are known of those whose models the roster says."""
    lab = roster.read(path)
    names = {robot.tag: robot.name or robot.host for robot in lab.robots}
    models = {robot.tag: lab.model_of(robot) for robot in lab.robots}
    bodies_mm = {tag: 2000.0 * model.radius_m for tag, model in models.items() if model}
    return replace(wanted, names=names, bodies_mm=bodies_mm)


def _dpi(text: str) -> int:
    if not text.isdecimal() or not 72 <= int(text) <= 600:
        raise argparse.ArgumentTypeError(f"{text!r}: expected 72 to 600 pixels per inch")
    return int(text)
