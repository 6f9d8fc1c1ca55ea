"""`vsense report`: recordings as charts, one page, and numbers."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from vsense import recording
from vsense.commands import arguments
from vsense.terminal import Console

DESCRIPTION = (
    "Makes report.html, one page that holds everything it shows, and its charts as PNG, SVG or PDF:"
    " trajectories, occupancy, the experiment's measures, robots seen and connected, latency, loss"
    " and gaps. Several recordings are compared as well, each experiment's sighted runs with its"
    " blind ones, and simulated runs with those of the lab and of real robots; the runs of a"
    " campaign (vsense sim --runs) by its table. Nothing is written over."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    parser.add_argument(
        *("files",),
        type=Path,
        nargs="+",
        metavar="FILE",
        help="the recordings (.mcap), or folders of runs that hold some; a campaign's table (.csv),"
        " or the folder that it is in",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FOLDER",
        help="folder for the report, made if need be, else empty (default: FILE without .mcap and"
        " with -report; of several: report)",
    )
    arguments.add_charts(parser)
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")


def run(options: argparse.Namespace) -> int:
    """Makes the report; see `vsense.report.report`."""
    recording.require()
    from vsense.report.report import make_report

    files = [file for path in options.files for file in _files_of(path)]
    alone = files[0].with_name(f"{files[0].stem}-report")
    folder = options.output or (alone if len(files) == 1 else Path("report"))
    console = Console()
    made = make_report(
        files,
        folder,
        lambda path, share: console.progress(f"reading {path}: {100 * share:.0f} %"),
        options.format or "png",
        options.style,
    )
    console.end_progress()
    if made.lacking:
        console.say(f"vsense: {made.lacking}")
    for one in made.findings:
        if not one.complete:
            console.say(f"vsense: {one.path} was cut off: its last second may be missing")
        if one.damaged:
            console.say(f"vsense: {one.damaged} parts of {one.path} are damaged")
        if one.only_tracked:
            console.say(f"vsense: {one.path}: {one.only_tracked}")
        if not one.found.ran:
            console.say(f"vsense: {one.path} holds no run: all of it is shown")
    if options.json:
        print(json.dumps(made.as_json(), indent=1))
    else:
        print(f"{made.files[0]}: {len(made.files) - 1} charts beside it")
    return 0


def _files_of(path: Path) -> list[Path]:
    """The recordings, or the campaigns' tables, that a path means; raises as `files_of`."""
    from vsense.report.campaigns import tables_in

    if path.is_dir() and (tables := tables_in(path)):
        return tables
    return recording.files_of(path)
