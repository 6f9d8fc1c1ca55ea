"""A recording again: played to watchers, tracked again, or sensed again."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vsense.base.errors import UsageError
from vsense.base.interruption import Interruption
from vsense.base.message_bus import MessageBus
from vsense.base.terminal import Console
from vsense.config import tracking_session
from vsense.monitor import recording
from vsense.monitor.recording._player import Player
from vsense.monitor.recording.reader import Recording, open_recording
from vsense.monitor.recording.resense import ResenseComparison, Resensing
from vsense.monitor.recording.retrack import RetrackComparison, Retracking
from vsense.monitor.ui._watchers import WatchedBus, WatchOptions, start_watchers, wanted_watchers
from vsense.monitor.ui.access import FoxgloveAddress, WebAddress
from vsense.monitor.ui.room import RoomOptions
from vsense.run.orders import Order, OrderKind
from vsense.vision.tracking.recorded_tracker import change_settings, of_session
from vsense.vision.tracking.specs import TrackingSession


@dataclass(frozen=True, slots=True)
class ReplayOptions:
    """What is done with a recording: it is played, unless one of two comparisons is wanted.

    Attributes:
        web: where the page is served that plays it.
        foxglove: where Foxglove is served, too; None: nowhere.
        ros2: domain of DDS in which ROS 2 hears it, too; None: none.
        speed: times real time.
        retrack: the tracker runs again on its pictures.
        settings: of the tracker, by `GROUP.NAME`, in place of the recorded ones.
        session: the two files of a tracking session, whose settings take their place.
        resense: the virtual world is made again.
        experiment: the experiment's file; None: it is where it was.
    """

    web: WebAddress | None = None
    foxglove: FoxgloveAddress | None = None
    ros2: int | None = None
    speed: float = 1.0
    retrack: bool = False
    settings: Mapping[str, str] = field(default_factory=dict)
    session: tuple[str, str] | None = None
    resense: bool = False
    experiment: Path | None = None


def replay(
    path: Path, options: ReplayOptions, console: Console, interrupted: Interruption
) -> RetrackComparison | ResenseComparison | None:
    """Plays a recording, or the only one in a folder; or tracks, or senses again.

    Returns:
        What differs; None: it was interrupted, as playing always ends.

    Raises:
        UsageError: options do not go together, or there is no recording.
        VsenseError: the recording cannot be read, played, tracked or sensed again.
        CutShort: it was interrupted while the recording was opened.
    """
    path = recording.file_of(path)
    _check(options)
    session = None if options.session is None else tracking_session.load(*options.session)
    with ExitStack() as stack:
        with interrupted.at_once():
            opened = stack.enter_context(open_recording(path))
        for line in opened.lacks():
            console.say(f"vsense: {line}", "warning")
        if options.retrack:
            return _retrack(opened, session, options.settings, console, interrupted)
        if options.resense:
            return _resense(opened, options.experiment, console, interrupted)
        _play(opened, options, console, stack)
        interrupted.wait()
    return None


def _check(options: ReplayOptions) -> None:
    """Refuses what does not go together, and an address that cannot be had."""
    if options.retrack and options.resense:
        raise UsageError("--retrack and --resense are two comparisons: one after the other")
    if (options.settings or options.session) and not options.retrack:
        raise UsageError("--set and --session belong to --retrack")
    if options.experiment and not options.resense:
        raise UsageError("--experiment belongs to --resense")
    if not (options.retrack or options.resense):
        assert options.web is not None, "who plays it"
        RoomOptions(options.web, options.foxglove, ros2=options.ros2).check()


def _play(opened: Recording, options: ReplayOptions, console: Console, stack: ExitStack) -> None:
    watchers = wanted_watchers(WatchOptions(options.web, options.foxglove, ros2=options.ros2))
    bus = MessageBus()
    player = Player(opened, bus)
    player.give(Order(OrderKind.SPEED, "terminal", options.speed))
    title = f"vsense: plays {opened.duration_s:.1f} s"
    runs = WatchedBus(bus, player.give, console, recording=opened, title=title)
    start_watchers(stack, watchers, runs)
    player.start()
    stack.callback(player.close)


def _retrack(
    opened: Recording,
    session: TrackingSession | None,
    settings: Mapping[str, str],
    console: Console,
    interrupted: Interruption,
) -> RetrackComparison | None:
    def change(setup: dict[str, Any]) -> dict[str, Any]:
        if session is not None:
            setup = {**of_session(session), "versions": setup["versions"]}
        return change_settings(setup, settings)

    tracking = Retracking(opened, change)
    for number, _ in enumerate(tracking.states(), 1):
        console.progress(f"tracked again: timestep {number}")
        if interrupted.is_set():
            return None
    console.end_progress()
    if opened.damaged:
        console.say(f"vsense: {len(opened.damaged)} parts of {opened.path} are damaged")
    return tracking.comparison


def _resense(
    opened: Recording, experiment: Path | None, console: Console, interrupted: Interruption
) -> ResenseComparison | None:
    sensing = Resensing(opened, experiment)
    for run_timestep in sensing.timesteps():
        console.progress(f"sensed again: timestep {run_timestep}")
        if interrupted.is_set():
            return None
    console.end_progress()
    return sensing.comparison
