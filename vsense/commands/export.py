"""`vsense export`: a recording as tables."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from vsense import recording
from vsense.commands import arguments
from vsense.terminal import Console, print_data

DESCRIPTION = (
    "Writes the tables trajectories.csv, readings.csv, robots.csv, measures.csv and events.csv of a"
    " recording. Every table has a header; lengths are in m, angles in rad, times in s since the"
    " recording's beginning. Nothing is written over."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    parser.add_argument("file", type=Path, help="the recording (.mcap), or the folder of its run")
    # Scripts say it; there is no other format.
    parser.add_argument("--csv", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FOLDER",
        help="folder for the tables, made if need be (default: FILE without .mcap)",
    )
    arguments.flag(parser, "--json", "print the tables' files and numbers of rows as JSON")


def run(options: argparse.Namespace) -> int:
    """Exports; see `vsense.recording.export`."""
    recording.require()
    from vsense.recording.export import export_csv
    from vsense.recording.reader import open_recording

    file = recording.file_of(options.file)
    folder = options.output or file.with_suffix("")
    with open_recording(file) as opened:
        rows = export_csv(opened, folder)
        console = Console()
        if not opened.complete:
            console.say(f"vsense: {file} was cut off: its last second may be missing")
        if opened.damaged:
            console.say(f"vsense: {len(opened.damaged)} parts of {file} are damaged")
    tables = {f"{folder / name}.csv": count for name, count in rows.items()}
    if options.json:
        print_data(json.dumps({"tables": tables}, indent=2))
    else:
        print_data("\n".join(f"{name}: {count} rows" for name, count in tables.items()))
    return 0
