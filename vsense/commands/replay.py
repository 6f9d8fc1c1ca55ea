"""`vsense replay`: a recording again, in the page or through the tracker."""

from __future__ import annotations

import argparse
import json
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vsense.base.errors import UsageError
from vsense.base.message_bus import MessageBus
from vsense.base.terminal import Console, interruption
from vsense.commands import arguments
from vsense.config import tracking_session
from vsense.monitor import recording
from vsense.monitor.ui.access import FoxgloveAddress, WebAddress
from vsense.monitor.ui.foxglove_server import check_foxglove
from vsense.monitor.ui.watchers import (
    WatchedBus,
    WatchOptions,
    start_watchers,
    wanted_watchers,
)
from vsense.run.orders import Order, OrderKind

if TYPE_CHECKING:
    from vsense.monitor.recording.reader import Recording

DESCRIPTION = (
    "Plays a recording in the page, with pause, speed and a time line. With --retrack it runs the"
    " tracker again on the recorded pictures instead, and prints what differs: nothing with the"
    " recorded settings, in every bit. With --resense it makes the virtual world again, from the"
    " recorded arena states, the robots' deeds and what people changed, and compares the readings."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    parser.add_argument("file", type=Path, help="the recording (.mcap), or its run's folder")
    arguments.add_web(parser, ("127.0.0.1", 8080))
    arguments.add_foxglove(parser)
    arguments.option(parser, "--speed", float, "X", "times the real speed (default: 1)", 1.0)
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
    world = parser.add_argument_group("sensing again")
    text = "make the virtual world again, with what people changed in it, and compare the readings"
    arguments.flag(world, "--resense", text)
    arguments.option(
        world, "--experiment", Path, "FILE", "the experiment's file, where it is no longer there"
    )
    arguments.flag(parser, "--json", "print the comparison as JSON")


def run(options: argparse.Namespace) -> int:
    """Plays a recording, tracks or senses again; 0, 1 where readings differ, or 130 (143 by
    SIGTERM) where it was interrupted, as playing ends.
    """
    recording.require()
    options.file = recording.file_of(options.file)
    _check(options)
    if options.retrack:
        return _retrack(options)
    if options.resense:
        return _resense(options)
    web = arguments.web_of(options)
    assert web is not None, "--web has a default"
    foxglove = arguments.foxglove_of(options)
    check_foxglove(foxglove, (web.port,))
    return play(options.file, options.speed, web, foxglove)


def _check(options: argparse.Namespace) -> None:
    """Refuses what does not go together."""
    if options.retrack and options.resense:
        raise UsageError("--retrack and --resense are two comparisons: one after the other")
    if (options.set or options.session) and not options.retrack:
        raise UsageError("--set and --session belong to --retrack")
    if options.experiment and not options.resense:
        raise UsageError("--experiment belongs to --resense")
    if options.json and not (options.retrack or options.resense):
        raise UsageError("--json belongs to --retrack and --resense")


def play(file: Path, speed: float, web: WebAddress, foxglove: FoxgloveAddress | None = None) -> int:
    """Plays a recording in the page, and to Foxglove where that is not None, until it is
    interrupted, `speed` times as fast as real time.
    """
    # These need the extra `record`.
    from vsense.monitor.recording.player import Player
    from vsense.monitor.recording.reader import open_recording

    console, watchers = Console(), wanted_watchers(WatchOptions(web, foxglove))
    with ExitStack() as stack:
        interrupted = stack.enter_context(interruption())
        with interrupted.at_once():
            opened = stack.enter_context(open_recording(file))
        _say_state(console, opened)
        bus = MessageBus()
        player = Player(opened, bus)
        player.give(Order(OrderKind.SPEED, "terminal", speed))
        title = f"vsense: plays {opened.duration_s:.1f} s"
        runs = WatchedBus(bus, player.give, console, recording=opened, title=title)
        start_watchers(stack, watchers, runs)
        player.start()
        stack.callback(player.close)
        player.give(Order(OrderKind.PLAY, "terminal", 1.0))
        interrupted.wait()
    return interrupted.code


def _retrack(options: argparse.Namespace) -> int:
    """Runs the tracker on recorded pictures and prints what differs; see `run`."""
    from vsense.monitor.recording.reader import open_recording
    from vsense.monitor.recording.retrack import Retracking
    from vsense.vision.tracking import recorded_tracker

    console = Console()
    session = None if options.session is None else tracking_session.load(*options.session)

    def change(made: dict[str, Any]) -> dict[str, Any]:
        if session is not None:
            made = {**recorded_tracker.of_session(session), "versions": made["versions"]}
        return recorded_tracker.change_settings(made, dict(options.set))

    with ExitStack() as stack:
        interrupted = stack.enter_context(interruption())
        with interrupted.at_once():
            opened = stack.enter_context(open_recording(options.file))
        _say_state(console, opened)
        tracking = Retracking(opened, change)
        for number, _ in enumerate(tracking.states(), 1):
            console.progress(f"tracked again: timestep {number}")
            if interrupted.is_set():
                return interrupted.code
        console.end_progress()
        if opened.damaged:
            console.say(f"vsense: {len(opened.damaged)} parts of {options.file} are damaged")
        if options.json:
            print(json.dumps(asdict(tracking.comparison)))
        else:
            print("\n".join(tracking.comparison.lines()))
    return 0


def _resense(options: argparse.Namespace) -> int:
    """Makes the world of a recording again and prints what differs; see `run`."""
    from vsense.monitor.recording.reader import open_recording
    from vsense.monitor.recording.resense import Resensing

    console = Console()
    with ExitStack() as stack:
        interrupted = stack.enter_context(interruption())
        with interrupted.at_once():
            opened = stack.enter_context(open_recording(options.file))
        _say_state(console, opened)
        sensing = Resensing(opened, options.experiment)
        for run_timestep in sensing.timesteps():
            console.progress(f"sensed again: timestep {run_timestep}")
            if interrupted.is_set():
                return interrupted.code
        console.end_progress()
        found = sensing.comparison
        print(json.dumps(asdict(found)) if options.json else "\n".join(found.lines()))
    return 1 if found.different else 0


def _say_state(console: Console, opened: Recording) -> None:
    """Says what people should know before they believe a recording."""
    if not opened.complete:
        console.say(f"vsense: {opened.path} was cut off: its last second may be missing")
    if opened.gaps:
        console.say(f"vsense: {opened.path} has {len(opened.gaps)} gaps")
