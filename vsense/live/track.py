"""`vsense track`: the loop over a session's timesteps, its recording, and the live line."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import cv2

from vsense import arena
from vsense.arena import ArenaState, Frame
from vsense.cameras.grabber import GrabberError, NoMorePictures, Troubles
from vsense.clock import host_ns
from vsense.config import tracking_session
from vsense.errors import UsageError, VsenseError, failing_as
from vsense.live.track_room import TrackRoom
from vsense.pictures import snapshot
from vsense.recording.pictures import (
    BackgroundRecorder,
    PictureRecorder,
    PictureRecordingError,
    write_session_files,
)
from vsense.terminal import Console, drop_output, interruption
from vsense.tracking.arena_tracker import TrackerCounters
from vsense.tracking.camera_tracking import CameraTracking
from vsense.tracking.opening import OFFLINE, PACED, open_tracking
from vsense.tracking.specs import TrackingSession
from vsense.ui.access import WebAddress

BAR_WIDTH = 24

_WINDOW_NS = 2_000_000_000
_DRAW_NS = 100_000_000


class Talk:
    """Keeps the live line up to date; says once which robots have joined."""

    def __init__(self, console: Console, clock: Callable[[], int], timesteps: int | None) -> None:
        """`clock` is monotonic [ns]; `timesteps` None: it is not known how many there will be."""
        self._console = console
        self._clock = clock
        self._timesteps = timesteps
        self._begun_ns = clock()
        self._drawn_ns = 0
        self._done = 0
        self._pictures = 0
        self._detected = 0
        self._recent: deque[int] = deque()
        self._joined: set[int] = set()

    def say(self, text: str) -> None:
        """Says something of its own."""
        self._console.say(f"vsense: {text}")

    def timestep(self, state: ArenaState, pictures: int) -> None:
        """Counts a timestep and draws the live line now and then."""
        now_ns = self._clock()
        self._done += 1
        self._pictures += pictures
        self._detected += state.detected
        for tag in sorted(set(state.joined) - self._joined):
            self.say(f"robot {tag} was not on the roster and has joined")
        self._joined.update(state.joined)
        self._recent.append(now_ns)
        while now_ns - self._recent[0] > _WINDOW_NS:
            self._recent.popleft()
        if now_ns - self._drawn_ns >= _DRAW_NS or self._done == self._timesteps:
            self._drawn_ns = now_ns
            self._console.progress(self._line(state, pictures, now_ns))

    def recorded(self, dropped: int) -> None:
        """Says how complete a recording is."""
        if dropped:
            self.say(f"the disk was too slow: {dropped} timesteps were not recorded")

    def summary(self, missed: int, counters: TrackerCounters, troubles: Troubles) -> None:
        """Says what was done in all; `missed` timesteps were left out."""
        self._console.end_progress()
        elapsed_s = max((self._clock() - self._begun_ns) / 1e9, 1e-9)
        per_timestep = self._detected / max(self._done, 1)
        self.say(
            f"{self._done} timesteps, {self._pictures} pictures in {elapsed_s:.1f} s:"
            f" {self._done / elapsed_s:.1f} timesteps/s, {self._pictures / elapsed_s:.1f}"
            f" pictures/s; {per_timestep:.2f} robots detected per timestep"
        )
        if missed:
            self.say(f"{missed} timesteps were left out to keep pace; --offline takes them all")
        for note in [*counters.notes(), *troubles.summary()]:
            self.say(note)

    def _line(self, state: ArenaState, pictures: int, now_ns: int) -> str:
        rate = self._rate(now_ns)
        robots = state.robots
        facts = f"{rate:.1f} timesteps/s, {pictures} cameras, {int(robots['seen'].sum())} robots"
        lost = [str(tag) for tag in robots["tag"][~robots["seen"]]]
        if lost:
            facts += f", lost: {', '.join(lost[:6])}{' ...' if len(lost) > 6 else ''}"
        if self._timesteps is None:
            return f"timestep {state.timestep}: {facts}"
        share = self._done / max(self._timesteps, 1)
        bar = ("#" * round(share * BAR_WIDTH)).ljust(BAR_WIDTH, "-")
        left_s = (self._timesteps - self._done) / rate
        return f"[{bar}] {self._done}/{self._timesteps}: {facts}, {left_s:.0f} s left"

    def _rate(self, now_ns: int) -> float:
        """Timesteps per second over the last two seconds."""
        earlier = self._done > len(self._recent)
        since_ns = self._recent[0] if earlier else self._begun_ns
        counted = len(self._recent) - earlier
        if not counted:  # slower than that: since the beginning
            counted, since_ns = self._done, self._begun_ns
        return counted / max((now_ns - since_ns) / 1e9, 1e-6)


FIRST_PICTURE_NS = 15_000_000_000
"""Cameras that give nothing for this long at the beginning do not work at all."""
SILENCE_S = 0.5
"""A run without pictures checks this often whether it shall end."""

Timesteps = Iterator[tuple[ArenaState, Sequence[Frame]]]
"""Arena states, each with the pictures that it was made from."""


@dataclass(frozen=True, slots=True)
class TrackOptions:
    """What `vsense track` is asked for.

    Attributes:
        resources, experiment: paths of the two files.
        offline: as fast as possible, not at the pace of a recording's pictures.
        format: of the states on standard output: "jsonl" or "csv".
        snapshot: picture file of the last state, None: none is drawn.
        frames: timesteps after which it ends, None: never.
        web: where the page is served, None: nowhere.
    """

    resources: str
    experiment: str
    offline: bool = False
    format: str = "jsonl"
    snapshot: Path | None = None
    frames: int | None = None
    web: WebAddress | None = None


def run(options: TrackOptions) -> int:
    """Tracks until the recording ends or `frames` are done: 0; 130 after Ctrl-C,
    143 after SIGTERM.
    """
    session = tracking_session.load(options.resources, options.experiment)
    if options.offline and session.is_live:
        raise UsageError(f"--offline: {options.experiment} uses cameras, expected recordings")
    with ExitStack() as stack:
        interrupted = stack.enter_context(interruption())
        console = Console()
        pace = OFFLINE if options.offline else PACED
        tell = lambda line: console.say(f"vsense: {line}")  # noqa: E731
        with interrupted.at_once():
            tracking = open_tracking(session, host_ns, tell, pace)
        stack.callback(tracking.close)
        room = stack.enter_context(TrackRoom(options.web, session, tracking.troubles, console))
        talk = Talk(console, host_ns, known_timesteps(options.frames, tracking))
        TrackingRun(options, session, tracking, interrupted, talk, room).run()
        return interrupted.code if interrupted.is_set() else 0


@dataclass(slots=True)
class TrackingRun:
    """One run of the command, from the first picture to the summary."""

    options: TrackOptions
    session: TrackingSession
    tracking: CameraTracking
    interrupted: threading.Event
    talk: Talk
    room: TrackRoom
    _last: tuple[ArenaState, Sequence[Frame]] | None = None

    def run(self) -> None:
        """Tracks to the end, and leaves picture, recording and summary."""
        recorder = begin_recording(self.session, self.talk)
        try:
            self._track(recorder)
        except BrokenPipeError:
            drop_output()
        finally:
            if recorder is not None:
                recorder.close()
                self.talk.recorded(recorder.dropped)
        tracking = self.tracking
        self.talk.summary(tracking.grabber.missed, tracking.tracker.counters, tracking.troubles)
        if self.options.snapshot is not None:
            self._draw(self.options.snapshot)

    def _track(self, recorder: BackgroundRecorder | None) -> None:
        csv = self.options.format == "csv"
        if csv:
            print(arena.CSV_HEADER, flush=True)
        for state, frames in timesteps(self.tracking, self.interrupted, self.options.frames):
            self._last = state, frames
            text = arena.to_csv(state) if csv else arena.to_json(state)
            if text:
                # A reader at the other end of a pipe wants a state when it is new.
                print(text, flush=not self.options.offline)
            if recorder is not None:
                recorder.write(frames)
            self.talk.timestep(state, len(frames))
            self.room.update(state, frames)

    def _draw(self, path: Path) -> None:
        """Draws the last state into a file."""
        if self._last is None:
            raise VsenseError(f"{path}: not drawn, because there was no picture")
        state, frames = self._last
        tracker = self.tracking.tracker
        picture = snapshot.draw(state, frames, tracker.cameras, tracker.found, tracker.heights_m)
        suffix = path.suffix.lower() if path.suffix.lower() in (".png", ".jpg") else ".png"
        with failing_as(VsenseError, f"{path}: cannot be written"):
            path.write_bytes(cv2.imencode(suffix, picture)[1].tobytes())


def timesteps(
    tracking: CameraTracking, interrupted: threading.Event, most: int | None = None
) -> Timesteps:
    """Tracks until `interrupted` (within `SILENCE_S`), a recording ends or `most` are done.

    Yields each state with its pictures; the cameras are checked when each was handed on.

    Raises:
        GrabberError: cameras gave nothing at the beginning.
        VsenseError: the tracker has failed.
    """
    begun_ns, done = host_ns(), 0
    while not interrupted.is_set() and done != most:
        try:
            state, frames = tracking.next(SILENCE_S)
        except NoMorePictures:
            return
        except GrabberError:
            if not done and host_ns() - begun_ns > FIRST_PICTURE_NS:
                raise
            continue
        done += 1
        yield state, frames
        tracking.check_cameras()


def known_timesteps(wanted: int | None, tracking: CameraTracking) -> int | None:
    """Gives how many there will be, where that is known; `wanted` is the most."""
    return min((n for n in (wanted, tracking.grabber.timesteps) if n is not None), default=None)


def begin_recording(session: TrackingSession, talk: Talk) -> BackgroundRecorder | None:
    """Begins the recording that the experiment file asks for."""
    record = session.record
    if not record.record_image:
        return None
    directory = record.root_directory
    if record.change_root_directory_on_start:
        directory /= time.strftime("%Y-%m-%d-%H%M%S")
    cameras = [view.camera for view in session.views]
    recorder = PictureRecorder(directory, cameras, record.image_format)
    trackers = {view.camera.id: view.tracker for view in session.views}
    with failing_as(PictureRecordingError, f"{directory}: cannot be written"):
        write_session_files(directory, cameras, trackers)
    talk.say(f"recording into {directory}")
    return BackgroundRecorder(recorder)
