"""`vsense export`: a recording as tables."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from vsense import recording
from vsense.commands import arguments
from vsense.errors import UsageError
from vsense.terminal import Console, interruption, print_data

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
    parser.add_argument(
        "--foxglove",
        type=Path,
        metavar="NAME.mcap",
        help="write the recording once more for Foxglove, with its own channels beside ours, and"
        " NAME-layout.json with a layout that fits it, instead of tables; new recordings have these"
        " channels already",
    )
    arguments.flag(parser, "--json", "print the tables' files and numbers of rows as JSON")


def run(options: argparse.Namespace) -> int:
    """Exports; see `vsense.recording.export`."""
    recording.require()
    from vsense.recording.export import export_csv
    from vsense.recording.reader import open_recording

    file = recording.file_of(options.file)
    if options.foxglove is not None:
        return _to_foxglove(file, options)
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


def _to_foxglove(file: Path, options: argparse.Namespace) -> int:
    """Writes a recording for Foxglove; see `vsense.recording.foxglove_export`."""
    from vsense.recording.foxglove_export import export_foxglove
    from vsense.recording.reader import open_recording

    if options.output is not None:
        raise UsageError("--output is the folder of tables: --foxglove names its own file")
    with interruption() as interrupted, interrupted.at_once(), open_recording(file) as opened:
        console = Console()
        tell = lambda share: console.progress(f"for Foxglove: {share:.0%}")  # noqa: E731
        sizes = export_foxglove(opened, options.foxglove, tell)
        console.end_progress()
        if opened.damaged:
            console.say(f"vsense: {len(opened.damaged)} parts of {file} are damaged")
    if options.json:
        print_data(json.dumps({"files": sizes}, indent=2))
    else:
        print_data("\n".join(f"{name}: {size / 1e6:.1f} MB" for name, size in sizes.items()))
    return 0
