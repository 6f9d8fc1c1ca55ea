"""`vsense replay`: a recording again, in the page or through the tracker."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import Any, Protocol

from vsense.commands import arguments
from vsense.config import tracking_session
from vsense.errors import UsageError
from vsense.message_bus import MessageBus
from vsense.recording import tracker_made
from vsense.recording.player import Player
from vsense.recording.reader import Recording, open_recording
from vsense.recording.retrack import Retracking
from vsense.recording.tracker_made import change_settings
from vsense.run.control import Give, Order, OrderKind
from vsense.terminal import INTERRUPTED, Console, interruption

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
    """Plays or tracks again; see `vsense.commands.replay`."""
    # Imported here: `vsense --help` must not wait for OpenCV.
    from vsense import recording

    recording.require()
    from vsense.ui.room import make_server

    if options.retrack:
        return retrack(options)
    if options.set or options.session or options.json:
        raise UsageError("--set, --session and --json belong to --retrack")
    return play(options, make_server)


class Addresses(Protocol):
    """What to type into a browser."""

    @property
    def look(self) -> str:
        """For those who only look."""

    @property
    def control(self) -> str:
        """For those who press buttons."""


class Server(Protocol):
    """The page's server; `vsense.ui.server.WebServer`."""

    def start(self) -> Addresses:
        """Serves."""

    def close(self) -> None:
        """Ends it."""


MakeServer = Callable[[argparse.Namespace, MessageBus, Give], Server]


def play(options: argparse.Namespace, make_server: MakeServer) -> int:
    """Plays a recording in the page until somebody interrupts.

    Args:
        options: the command line.
        make_server: makes the page's server.

    Raises:
        VsenseError: the recording or the page cannot be opened.
    """
    console = Console()
    with ExitStack() as stack:
        interrupted = stack.enter_context(interruption())
        recording = stack.enter_context(open_recording(options.file))
        _say_state(console, recording)
        bus = MessageBus()
        player = Player(recording, bus)
        player.give(Order(OrderKind.SPEED, "terminal", options.speed))
        server = make_server(options, bus, player.give)
        stack.callback(server.close)
        addresses = server.start()
        console.say(f"vsense: plays {recording.duration_s:.1f} s in {addresses.control}")
        if addresses.look != addresses.control:
            console.say(f"vsense: only to look: {addresses.look}")
        player.start()
        stack.callback(player.close)
        player.give(Order(OrderKind.PLAY, "terminal", 1.0))
        interrupted.wait()
    return INTERRUPTED


def retrack(options: argparse.Namespace) -> int:
    """Runs the tracker on recorded pictures and prints what differs.

    Returns:
        0, or 130 where it was interrupted.

    Raises:
        VsenseError: there is nothing to track, or the settings make no tracker.
    """
    console = Console()
    session = None if options.session is None else tracking_session.load(*options.session)

    def change(made: dict[str, Any]) -> dict[str, Any]:
        if session is not None:
            made = {**tracker_made.of_session(session), "versions": made["versions"]}
        return change_settings(made, dict(options.set))

    with interruption() as interrupted, open_recording(options.file) as recording:
        _say_state(console, recording)
        tracking = Retracking(recording, change)
        for number, _ in enumerate(tracking.states(), 1):
            console.progress(f"{number} timesteps tracked again")
            if interrupted.is_set():
                return INTERRUPTED
        console.end_progress()
        if recording.damaged:
            console.say(f"vsense: {len(recording.damaged)} parts of {options.file} are damaged")
        if options.json:
            print(json.dumps(asdict(tracking.comparison)))
        else:
            print("\n".join(tracking.comparison.lines()))
    return 0


def _say_state(console: Console, recording: Recording) -> None:
    """Says what people should know before they believe a recording."""
    if not recording.complete:
        console.say(f"vsense: {recording.path} was cut off: its last second may be missing")
    if recording.gaps:
        console.say(f"vsense: {recording.path} has {len(recording.gaps)} gaps")
