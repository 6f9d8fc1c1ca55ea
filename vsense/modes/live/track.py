"""`vsense camera track`: the loop over a session's timesteps, its recording, and the live line."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import CSV_HEADER, ArenaState, Frame
from vsense.base.clock import host_ns
from vsense.base.errors import GrabberError, NoMorePictures, UsageError, VsenseError, failing_as
from vsense.base.interruption import Interruption, interruption
from vsense.base.terminal import Console, drop_output
from vsense.config import tracking_session
from vsense.modes.live._runs import RunPictures, Runs, begin_recording
from vsense.modes.live._talk import Talk, told_of
from vsense.modes.live.track_room import TrackRoom, name_of
from vsense.monitor.pictures import snapshot
from vsense.monitor.ui.room import ControlRoom, RoomOptions
from vsense.run.control import BEFORE_RUN, State
from vsense.vision.cameras.grabber import Troubles
from vsense.vision.tracking.arena_tracker import TrackerCounters
from vsense.vision.tracking.camera_tracking import CameraTracking
from vsense.vision.tracking.opening import OFFLINE, PACED, open_tracking
from vsense.vision.tracking.specs import PlacedMarker, TrackingSession

FIRST_PICTURE_NS = 15_000_000_000
"""Cameras that give nothing for this long at the beginning do not work at all."""
PICTURE_POLL_S = 0.5
"""A run without pictures checks this often whether it shall end."""
HELD_S = 0.1
"""A recording that waits, or whose run is suspended, shows its pictures this often."""

Timesteps = Iterator[tuple[ArenaState, Sequence[Frame]]]
"""Arena states, each with the pictures that it was made from."""
FoundByCamera = Mapping[str, NDArray[np.void]]
"""By the camera's id the DETECTION array of its picture."""


@dataclass(frozen=True, slots=True)
class TrackOptions:
    """What `vsense camera track` is asked for.

    Attributes:
        resources, experiment: paths of the two files; without an experiment file all that the
            resources, or their folder, name.
        offline: as fast as possible, not at the pace of a recording's pictures.
        format: of the states on standard output: "jsonl" or "csv".
        json: figures at the end instead of states.
        snapshot: picture file of the last state, None: none is drawn.
        frames: timesteps of runs after which it ends, None: never.
        room: how its runs are seen, steered and kept; checked (`RoomOptions.check`).
        output: folder for what runs leave, None: one in `runs/` if they leave something.
        markers: by tag, where markers sit on their robots.
    """

    resources: str
    experiment: str | None
    offline: bool = False
    format: str = "jsonl"
    json: bool = False
    snapshot: Path | None = None
    frames: int | None = None
    room: RoomOptions = field(default_factory=RoomOptions)
    output: Path | None = None
    markers: Mapping[int, PlacedMarker] = field(default_factory=dict)

    @property
    def is_watched(self) -> bool:
        """Whether somebody looks on, or it is kept as it happens: pictures are dated by now."""
        room = self.room
        served = any(door is not None for door in (room.web, room.foxglove, room.ros2))
        return room.hold or served or self.is_recorded

    @property
    def is_recorded(self) -> bool:
        """Whether every run is recorded."""
        return self.room.record or self.room.record_images


def run(options: TrackOptions) -> int:
    """Tracks until the recording ends, `frames` are done or a run was stopped: 0; 130 after Ctrl-C,
    143 after SIGTERM. With `room.hold`, or cameras in the page, it goes on after a run.
    """
    if options.experiment is None:
        session = tracking_session.load_whole(options.resources)
    else:
        session = tracking_session.load(options.resources, options.experiment)
    session = replace(session, offsets=options.markers)
    _check(options, session)
    with ExitStack() as stack:
        interrupted = stack.enter_context(interruption())
        console = Console()
        talk = Talk(console, host_ns, options.frames)
        making = Making(options, session, console, talk, Troubles())
        with interrupted.at_once():
            tracking = making.tracking()
        stack.callback(tracking.close)
        runs = TrackingRun(making, tracking, interrupted)
        # Each run of a recording has opened it anew.
        stack.callback(lambda: runs.tracking.close())
        runs.open(stack)
        runs.run()
        return interrupted.code if interrupted.is_set() else 0


def _check(options: TrackOptions, session: TrackingSession) -> None:
    """Refuses what does not go together, before anything is opened."""
    if options.offline and session.is_live:
        raise UsageError(f"--offline: {session.file} uses cameras, expected recordings")
    if options.offline and options.is_watched:
        raise UsageError(
            "--offline tracks as fast as it can; leave it out where --web, --foxglove, --ros2,"
            " --hold or --record need the pictures' own pace"
        )


@dataclass(frozen=True, slots=True)
class Making:
    """What a command's tracking is made from, again and again where each run plays a recording."""

    options: TrackOptions
    session: TrackingSession
    console: Console
    talk: Talk
    troubles: Troubles

    def tracking(self) -> CameraTracking:
        """Opens cameras or recordings; raises as `open_tracking`."""
        options, session = self.options, self.session
        pace: str | float = OFFLINE if options.offline else PACED
        if options.is_watched and not session.is_live:
            pace = HELD_S
        tracking = open_tracking(session, host_ns, self.talk.say, pace, self.troubles)
        if not options.room.hold:
            self.talk.expect(known_timesteps(options.frames, tracking))
        return tracking


class TrackingRun:
    """The command's runs, from the first picture to the summary; `tracking` is what is open."""

    def __init__(self, making: Making, tracking: CameraTracking, interrupted: Interruption) -> None:
        options, session = making.options, making.session
        console, talk = making.console, making.talk
        self.tracking = tracking
        self._making, self._options, self._talk = making, options, talk
        self._interrupted = interrupted
        self._live = session.is_live
        self._control_room = room = ControlRoom(options.room, console)
        each_run = session.record.change_root_directory_on_start
        say = lambda text: console.say(text, "trouble")  # noqa: E731
        self._runs = Runs(
            name_of(session),
            room.recorders,
            RunPictures(lambda: begin_recording(session, talk), each_run, say),
            console,
            interrupted,
            stays=options.room.hold or (options.room.web is not None and session.is_live),
            folders=session.record.record_image,
            holds=options.room.hold,
            suspends=not each_run,
        )
        self._room = TrackRoom(
            room,
            session,
            making.troubles,
            self._runs,
            has_keys=options.room.hold or options.room.web is not None,
            dated=self._live or options.is_watched,
        )
        self._begun_ns, self._came, self._done = host_ns(), False, 0
        self._stands = False
        self._missed, self._counters = 0, TrackerCounters()
        self._last: tuple[ArenaState, Sequence[Frame], FoundByCamera] | None = None

    def open(self, stack: ExitStack) -> None:
        """Opens folder, page and control socket; what is opened ends with `stack`."""
        options, runs = self._options, self._runs
        if options.output is not None or options.is_recorded:
            runs.keep_in(options.output)
        runs.recorders.watch_session(self._making.session, self.tracking, by_file=False)
        if text := told_of(self._making.session):
            self._talk.say(text)
        stack.enter_context(self._control_room)
        self._room.open()

    def run(self) -> None:
        """Tracks to the end, and leaves picture, recordings and summary."""
        runs, options = self._runs, self._options
        try:
            self._track()
        except BrokenPipeError:
            drop_output()
        finally:
            self._end_run()
            runs.pictures.close()
        self._count()
        self._talk.summary(self._missed, self._counters, self._making.troubles)
        runs.report(options.json)
        if options.snapshot is not None:
            self._draw(options.snapshot)
        if runs.failure is not None:
            raise runs.failure

    def _track(self) -> None:
        csv = self._options.format == "csv"
        if csv and not self._options.json:
            print(CSV_HEADER, flush=True)
        while self._goes_on():
            if (moment := self._next()) is not None:
                self._take(*moment, csv)
            else:
                self._room.rest()

    def _goes_on(self) -> bool:
        """Carries out what orders want; gives whether there is more to come."""
        control = self._runs.control
        if self._done == self._options.frames:
            control.end("all timesteps are done")
            return False
        if self._interrupted.is_set():
            return False
        if control.state in BEFORE_RUN:
            control.ready()
            if (control.asked or not control.holds) and control.begin(self.tracking.start):
                self._runs.begin(self.tracking)
        elif control.state == State.PAUSED:
            if control.asked and control.begin(self.tracking.go_on):
                self._stands = False
                self._runs.recorders.go_on()
            elif not self._stands:
                self._stands = True
                self.tracking.pause()
                self._runs.suspend()
        elif control.state == State.ENDED:
            ended = self._end_run()
            if not (self._runs.stays or control.next_asked):
                return False
            if ended and not self._live:
                self._play_anew()
            if control.next_asked:
                self._runs.next_run()
        return True

    def _end_run(self) -> bool:
        """Completes what the run has kept; False where there was none, or it is done."""
        control, self._stands = self._runs.control, False
        control.end("interrupted")
        if not control.begun or self._runs.ended == control.run:
            return False
        self.tracking.check_cameras()  # the run's last picture, too
        self.tracking.stop()
        self._runs.end(self.tracking)
        return True

    def _play_anew(self) -> None:
        """Opens the recording for another run, which is looked at until then."""
        self._count()
        self.tracking.close()
        self.tracking = self._making.tracking()
        self._runs.recorders.watch_session(self._making.session, self.tracking, by_file=False)

    def _count(self) -> None:
        """Adds what the present tracking has noticed, before it is closed, to that of all."""
        self._missed += self.tracking.grabber.missed
        self._counters.add(self.tracking.tracker.counters)

    def _next(self) -> tuple[ArenaState, Sequence[Frame]] | None:
        """Tracks the next pictures; None where none came, or there are no more.

        Raises:
            GrabberError: cameras gave nothing at the beginning.
            VsenseError: the tracker has failed.
        """
        try:
            moment = next_timestep(self.tracking)
        except NoMorePictures:
            self._runs.control.end("the recording has ended")
            return None
        except GrabberError:
            if not self._came and host_ns() - self._begun_ns > FIRST_PICTURE_NS:
                raise
            return None
        self._came = True
        return moment

    def _take(self, state: ArenaState, frames: Sequence[Frame], csv: bool) -> None:
        """Hands a timestep on; what belongs to no run is only looked at."""
        runs, running = self._runs, self._runs.running
        if running:
            self._last = state, frames, self.tracking.tracker.markers
            self._done += 1
            runs.counts.add(state, len(frames))
            self._print(state, csv)
            runs.pictures.timestep(True, frames)
            self._talk.timestep(state, len(frames))
        else:
            self._talk.rest(runs.control, state)
        self._room.update(state, frames)

    def _print(self, state: ArenaState, csv: bool) -> None:
        if self._options.json:
            return
        text = state.to_csv() if csv else state.to_json()
        if text:
            # A reader at the other end of a pipe wants a state when it is new.
            print(text, flush=not self._options.offline)

    def _draw(self, path: Path) -> None:
        """Draws the last state into a file."""
        if self._last is None:
            raise VsenseError(f"{path}: not drawn, because there was no picture")
        # The recording may have been opened anew since.
        state, frames, detections = self._last
        tracker = self.tracking.tracker
        picture = snapshot.draw(state, frames, tracker.cameras, detections, tracker.heights_m)
        suffix = path.suffix.lower() if path.suffix.lower() in (".png", ".jpg") else ".png"
        with failing_as(VsenseError, f"{path}: cannot be written"):
            path.write_bytes(cv2.imencode(suffix, picture)[1].tobytes())


def next_timestep(tracking: CameraTracking) -> tuple[ArenaState, Sequence[Frame]]:
    """Waits for the next state and its pictures; raises as `CameraTracking.next`.

    The cameras are checked first: the state before has been handed on.
    """
    tracking.check_cameras()
    return tracking.next(PICTURE_POLL_S)


def timesteps(tracking: CameraTracking, interrupted: threading.Event) -> Timesteps:
    """Tracks until `interrupted` (within `PICTURE_POLL_S`) or a recording ends.

    Yields each state with its pictures.

    Raises:
        GrabberError: cameras gave nothing at the beginning.
        VsenseError: the tracker has failed.
    """
    begun_ns, came = host_ns(), False
    while not interrupted.is_set():
        try:
            state, frames = next_timestep(tracking)
        except NoMorePictures:
            return
        except GrabberError:
            if not came and host_ns() - begun_ns > FIRST_PICTURE_NS:
                raise
            continue
        came = True
        yield state, frames


def known_timesteps(wanted: int | None, tracking: CameraTracking) -> int | None:
    """Gives how many there will be, where that is known; `wanted` is the most."""
    return min((n for n in (wanted, tracking.grabber.timesteps) if n is not None), default=None)
