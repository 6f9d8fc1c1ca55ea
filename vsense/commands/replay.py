"""`vsense replay`: a recording again, in the page or through the tracker."""

from __future__ import annotations

import argparse
from pathlib import Path

from vsense.commands import arguments
from vsense.errors import UsageError

HELP = "play a recording in the page, or run the tracker on its pictures again"

DESCRIPTION = (
    "Plays a recording in the page, with pause, speed and a time line. With --retrack it runs the"
    " tracker again on the recorded pictures instead, and prints what differs: nothing with the"
    " recorded settings, in every bit."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    parser.add_argument("file", type=Path, help="the recording (.mcap)")
    arguments.add_web(parser, ("127.0.0.1", 8080))
    parser.add_argument(
        "--speed", type=float, default=1.0, metavar="X", help="times the real speed (default: 1)"
    )
    again = parser.add_argument_group("tracking again")
    again.add_argument("--retrack", action="store_true", help="run the tracker again and compare")
    again.add_argument(
        "--set",
        type=arguments.setting,
        action="append",
        default=[],
        metavar="GROUP.NAME=VALUE",
        help="another setting of the tracker: limits.max_speed_m_s=0.3, plan.key_frame_period=5,"
        " tracker.height_m=0.05, ...; may be given again",
    )
    again.add_argument(
        "--session",
        nargs=2,
        metavar=("RESOURCES", "EXPERIMENT"),
        help="the settings of a tracking session's two files instead of the recorded ones",
    )
    again.add_argument("--json", action="store_true", help="print the comparison as JSON")


def run(options: argparse.Namespace) -> int:
    """Plays or tracks again; see `vsense.recording.replaying`."""
    # Imported here: `vsense --help` must not wait for OpenCV.
    from vsense import recording

    recording.require()
    from vsense.recording import replaying
    from vsense.room.web import make_server

    if options.retrack:
        return replaying.retrack(options)
    if options.set or options.session or options.json:
        raise UsageError("--set, --session and --json belong to --retrack")
    return replaying.play(options, make_server)
