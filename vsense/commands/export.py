"""`vsense export`: a recording as tables, or as a video."""

from __future__ import annotations

import argparse
import json
import re
import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vsense.base.errors import UsageError
from vsense.base.terminal import Console, interruption, print_data
from vsense.commands import arguments
from vsense.monitor import recording

if TYPE_CHECKING:
    from vsense.monitor.recording.reader import Recording
    from vsense.monitor.recording.video import VideoPlan

DESCRIPTION = (
    "Writes the tables trajectories.csv, readings.csv, robots.csv, shown.csv, measures.csv and"
    " events.csv of a recording. Every table has a header; lengths are in m, angles in rad, times"
    " in s since the recording's beginning. With --video it writes a video instead: the arena, the"
    " virtual world over the cameras' pictures, the clock and the measures. Nothing is overwritten."
)

_VIDEO_OPTIONS = ("view", "start_s", "end_s", "fps", "speed", "size", "robot")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    parser.add_argument("file", type=Path, help="the recording (.mcap), or the folder of its run")
    # Scripts say it; there is no other format.
    parser.add_argument("--csv", action="store_true", help=argparse.SUPPRESS)
    text = "folder for the tables, made if need be (default: FILE without .mcap)"
    arguments.option(parser, "-o --output", Path, "FOLDER", text)
    text = (
        "write the recording once more for Foxglove, with its own channels beside ours, and"
        " NAME-layout.json with a layout that fits it, instead of tables; new recordings have these"
        " channels already"
    )
    arguments.option(parser, "--foxglove", Path, "NAME.mcap", text)
    arguments.flag(parser, "--json", "print the files, and how much is in them, as JSON")
    _add_film(parser.add_argument_group("a video"))


def _add_film(film: argparse._ArgumentGroup) -> None:
    text = (
        "write this file: NAME.webm, a video (VP8) for every browser; NAME.webp, an animated"
        " picture; NAME.mp4 (H.264) where this machine's OpenCV writes it"
    )
    arguments.option(film, "--video", Path, "NAME", text)
    text = (
        "arena (from above), a camera's id, cameras (all as they hang), or both: arena and"
        " cameras (default: both, or arena where no pictures were recorded)"
    )
    arguments.option(film, "--view", str, "VIEW", text)
    film.add_argument(
        "--from", dest="start_s", type=_seconds, metavar="S",
        help="begin so many seconds after the recording's beginning (default: with the first run)",
    )  # fmt: skip
    film.add_argument(
        "--to", dest="end_s", type=_seconds, metavar="S",
        help="end there (default: with the first run)",
    )  # fmt: skip
    film.add_argument(
        "--fps", type=_rate, metavar="N",
        help="frames per second (default: as many as timesteps pass in one, at most 30)",
    )  # fmt: skip
    arguments.option(film, "--speed", _speed, "X", "times the real speed, 0.1 to 100 (default: 1)")
    arguments.option(film, "--size", _size, "WxH", "of the frames in pixels (default: 1280x720)")
    arguments.option(film, "--robot", arguments.natural, "TAG", "draw what this robot senses")


def run(options: argparse.Namespace) -> int:
    """Exports; see `vsense.monitor.recording.export` and `vsense.monitor.recording.video`.

    0, or 130 (143 by SIGTERM) where a video was interrupted.
    """
    recording.require()
    from vsense.monitor.recording.reader import open_recording

    if options.video is None:
        given = [name for name in _VIDEO_OPTIONS if getattr(options, name) is not None]
        if given:
            words = {"start_s": "from", "end_s": "to"}
            raise UsageError(f"--{words.get(given[0], given[0])} belongs to --video NAME.webm")
    elif options.output is not None or options.csv:
        raise UsageError("--output and --csv are for tables, --video says its own file: give one")
    file = recording.file_of(options.file)
    if options.foxglove is not None:
        if options.video is not None:
            raise UsageError("--video and --foxglove write different files: give one")
        return _to_foxglove(file, options)
    with open_recording(file) as opened:
        console = Console()
        if options.video is not None:
            return _video(options, opened, console)
        return _tables(options, opened, console)


def _tables(options: argparse.Namespace, opened: Recording, console: Console) -> int:
    from vsense.monitor.recording.export import export_csv

    folder = options.output or opened.path.with_suffix("")
    rows = export_csv(opened, folder)
    _say_state(opened, console)
    tables = {f"{folder / name}.csv": count for name, count in rows.items()}
    if options.json:
        print_data(json.dumps({"tables": tables}, indent=2))
    else:
        print_data("\n".join(f"{name}: {count} rows" for name, count in tables.items()))
    return 0


def _video(options: argparse.Namespace, opened: Recording, console: Console) -> int:
    from vsense.monitor.recording.video import Video

    with ExitStack() as stack:
        interrupted = stack.enter_context(interruption())
        with interrupted.at_once():
            film = Video(opened, _plan(options))
        begun_s = time.monotonic()

        def tell(done: int) -> None:
            left_s = (time.monotonic() - begun_s) / done * (film.frames - done)
            left = f"{int(left_s) // 60}:{int(left_s) % 60:02}"
            console.progress(f"video: {100 * done // film.frames} %, {left} left")

        whole = film.write(options.video, tell, interrupted.is_set)
        console.end_progress()
        _say_state(opened, console)
        if not whole:
            console.say(f"vsense: interrupted; nothing is left of {options.video}")
            return interrupted.code
    told = {
        "video": str(options.video),
        "frames": film.frames,
        "seconds": round(film.frames / film.fps, 3),
        "bytes": options.video.stat().st_size,
    }
    if options.json:
        print_data(json.dumps(told, indent=2))
    else:
        size = f"{told['bytes'] / 1e6:.1f} MB"
        print_data(f"{told['video']}: {told['seconds']:.1f} s, {told['frames']} frames, {size}")
    return 0


def _plan(options: argparse.Namespace) -> VideoPlan:
    from vsense.monitor.recording.video import VideoPlan

    given: dict[str, Any] = {
        "view": options.view,
        "from_s": options.start_s,
        "to_s": options.end_s,
        "fps": options.fps,
        "speed": options.speed,
        "size": options.size,
        "robot": options.robot,
    }
    return VideoPlan(**{name: value for name, value in given.items() if value is not None})


def _say_state(opened: Recording, console: Console) -> None:
    if not opened.complete:
        console.say(f"vsense: {opened.path} was cut off: its last second may be missing")
    if opened.damaged:
        console.say(f"vsense: {len(opened.damaged)} parts of {opened.path} are damaged")


def _number(text: str, low: float, high: float, what: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not low <= value <= high:
        raise argparse.ArgumentTypeError(f"{text!r}: expected {what}")
    return value


def _seconds(text: str) -> float:
    return _number(text, 0.0, 1e9, "seconds since the recording's beginning, such as 12.5")


def _rate(text: str) -> float:
    return _number(text, 1.0, 60.0, "frames per second, 1 to 60")


def _speed(text: str) -> float:
    return _number(text, 0.1, 100.0, "a speed from 0.1 to 100")


def _size(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"(\d{1,5})[xX](\d{1,5})", text)
    width, height = (int(found[1]), int(found[2])) if found else (0, 0)
    if not (320 <= width <= 3840 and 240 <= height <= 2160) or width % 2 or height % 2:
        raise argparse.ArgumentTypeError(
            f"{text!r}: expected even numbers from 320x240 to 3840x2160, such as 1280x720"
        )
    return width, height


def _to_foxglove(file: Path, options: argparse.Namespace) -> int:
    """Writes a recording for Foxglove; see `vsense.monitor.recording.foxglove_export`."""
    from vsense.monitor.recording.foxglove_export import export_foxglove
    from vsense.monitor.recording.reader import open_recording

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
