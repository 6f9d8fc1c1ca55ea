"""The command `vsense replay`."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict
from typing import Any, Protocol

from vsense.config import tracking_session
from vsense.console import Console
from vsense.hub import Hub
from vsense.interruption import INTERRUPTED, interruption
from vsense.orders import Give, Kind, Order
from vsense.recording import tracker_made
from vsense.recording.player import Player
from vsense.recording.reader import Recording, open_recording
from vsense.recording.retrack import Retracking
from vsense.recording.tracker_settings import change_settings


class Addresses(Protocol):
    """What to type into a browser."""

    @property
    def look(self) -> str:
        """For those who only look."""

    @property
    def control(self) -> str:
        """For those who press buttons."""


class Server(Protocol):
    """The page's server; `vsense.web.server.WebServer`."""

    def start(self) -> Addresses:
        """Serves."""

    def close(self) -> None:
        """Ends it."""


MakeServer = Callable[[argparse.Namespace, Hub, Give], Server]


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
        hub = Hub()
        player = Player(recording, hub)
        player.give(Order(Kind.SPEED, "terminal", options.speed))
        server = make_server(options, hub, player.give)
        stack.callback(server.close)
        addresses = server.start()
        console.say(f"vsense: plays {recording.duration_s:.1f} s in {addresses.control}")
        if addresses.look != addresses.control:
            console.say(f"vsense: only to look: {addresses.look}")
        player.start()
        stack.callback(player.close)
        player.give(Order(Kind.PLAY, "terminal", 1.0))
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
