"""`vsense export`: a recording as tables."""

from __future__ import annotations

import argparse
from pathlib import Path

from vsense import recording
from vsense.terminal import Console

DESCRIPTION = (
    "Writes the tables trajectories.csv, readings.csv, robots.csv, measures.csv and events.csv of a"
    " recording. Every table has a header; lengths are in m, angles in rad, times in s since the"
    " recording's beginning. Nothing is written over."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    parser.add_argument("file", type=Path, help="the recording (.mcap)")
    parser.add_argument("--csv", action="store_true", help="as CSV, the only format (default)")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FOLDER",
        help="folder for the tables, made if need be (default: FILE without .mcap)",
    )


def run(options: argparse.Namespace) -> int:
    """Exports; see `vsense.recording.export`."""
    recording.require()
    from vsense.recording.export import export_csv
    from vsense.recording.reader import open_recording

    folder = options.output or options.file.with_suffix("")
    with open_recording(options.file) as opened:
        rows = export_csv(opened, folder)
        console = Console()
        if not opened.complete:
            console.say(f"vsense: {options.file} was cut off: its last second may be missing")
        if opened.damaged:
            console.say(f"vsense: {len(opened.damaged)} parts of {options.file} are damaged")
    for name, count in rows.items():
        print(f"{folder / name}.csv: {count} rows")
    return 0
