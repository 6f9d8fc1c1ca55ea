"""`vsense export`: a recording as tables, or as a video."""

from __future__ import annotations

import argparse
import json
import re
from pathlib import Path

from vsense.base.errors import UsageError
from vsense.base.interruption import interruption
from vsense.base.terminal import Console, print_data
from vsense.commands import _arguments
from vsense.monitor import recording

DESCRIPTION = (
    "Writes the tables trajectories.csv, readings.csv, heard.csv (who heard whom, and who was not"
    " heard), robots.csv, shown.csv, measures.csv and events.csv of a recording. Every table has a"
    " header; lengths are in m, angles in rad, times in s since the recording's beginning. With"
    " --video it writes a video instead: the arena, the virtual world over the cameras' pictures,"
    " the clock and the measures. Nothing is overwritten."
)

_VIDEO_OPTIONS = ("view", "from_s", "to_s", "fps", "speed", "size", "robot")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    parser.add_argument("file", type=Path, help="the recording (.mcap), or the folder of its run")
    # Scripts say it; there is no other format.
    _arguments.flag(parser, "--csv", argparse.SUPPRESS)
    text = "folder for the tables, made if need be (default: FILE without .mcap)"
    _arguments.option(parser, "-o --output", Path, "FOLDER", text)
    text = "write the tables as Parquet, not CSV (extra tables)"
    _arguments.flag(parser, "--parquet", text)
    text = (
        "write the recording once more for Foxglove, with its own channels beside ours, and"
        " NAME-layout.json with a layout that fits it, instead of tables; new recordings have these"
        " channels already"
    )
    _arguments.option(parser, "--foxglove", Path, "NAME.mcap", text)
    text = (
        "write a bag for ROS 2 (MCAP) instead of tables: tf, poses, readings, batteries, cameras"
        " and pictures in standard messages, in the frames map, robot_23/base_link and"
        " cam1_optical"
    )
    _arguments.option(parser, "--rosbag", Path, "FOLDER", text)
    _arguments.flag(parser, "--json", "print the files, and how much is in them, as JSON")
    _add_film(parser.add_argument_group("a video"))


def _add_film(film: argparse._ArgumentGroup) -> None:
    text = (
        "write this file: NAME.webm, a video (VP8) for every browser; NAME.webp, an animated"
        " picture; NAME.mp4 (H.264) where this machine's OpenCV writes it"
    )
    _arguments.option(film, "--video", Path, "NAME", text)
    text = (
        "arena (from above), a camera's id, cameras (all as they hang), or both: arena and"
        " cameras (default: both, or arena where no pictures were recorded)"
    )
    _arguments.option(film, "--view", str, "VIEW", text)
    since = "seconds since the recording's beginning, such as 12.5"
    moment = _arguments.number(0.0, 1e9, since)
    film.add_argument(
        "--from", dest="from_s", type=moment, metavar="S",
        help="begin so many seconds after the recording's beginning (default: with the first run)",
    )  # fmt: skip
    film.add_argument(
        "--to", dest="to_s", type=moment, metavar="S",
        help="end there (default: with the first run)",
    )  # fmt: skip
    text = "frames per second (default: as many as timesteps pass in one, at most 30)"
    rate = _arguments.number(1.0, 60.0, "frames per second, 1 to 60")
    _arguments.option(film, "--fps", rate, "N", text)
    speed = _arguments.number(0.1, 100.0, "a speed from 0.1 to 100")
    _arguments.option(film, "--speed", speed, "X", "times the real speed, 0.1 to 100 (default: 1)")
    _arguments.option(film, "--size", _size, "WxH", "of the frames in pixels (default: 1280x720)")
    _arguments.option(film, "--robot", _arguments.natural, "TAG", "draw what this robot senses")


def run(options: argparse.Namespace) -> int:
    """Exports; 0, or 130 (143 by SIGTERM) where it was interrupted."""
    recording.require()
    from vsense.monitor.recording.export import ExportOptions, export

    film = {name: getattr(options, name) for name in _VIDEO_OPTIONS}
    film = {name: value for name, value in film.items() if value is not None}
    if options.csv and options.video is not None:
        raise UsageError("--output and --csv are for tables, --video says its own file: give one")
    wanted = ExportOptions(
        options.output, options.video, options.foxglove, options.rosbag, options.parquet, film
    )
    with interruption() as interrupted:
        written = export(options.file, wanted, Console(), interrupted)
        if written is None:
            return interrupted.code
    print_data(json.dumps(written.facts, indent=2) if options.json else "\n".join(written.lines))
    return 0


def _size(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d{1,5})[xX](\d{1,5})", text)
    width, height = (int(match[1]), int(match[2])) if match else (0, 0)
    if not (320 <= width <= 3840 and 240 <= height <= 2160) or width % 2 or height % 2:
        raise argparse.ArgumentTypeError(
            f"{text!r}: expected even numbers from 320x240 to 3840x2160, such as 1280x720"
        )
    return width, height
