"""The command `vsense track`: arena states out, and word of how the cameras are."""

from __future__ import annotations

import argparse
import os
import sys
import threading
import time
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from pathlib import Path

import cv2

from vsense import arena_lines
from vsense.arena import ArenaState, Frame
from vsense.config import tracking_session
from vsense.config.recording_files import write_session_files
from vsense.config.tracking_build import Tracking, build
from vsense.config.tracking_specs import TrackingSession
from vsense.console import Console
from vsense.errors import UsageError, VsenseError
from vsense.interruption import INTERRUPTED, interruption
from vsense.room.track_room import TrackRoom
from vsense.tracking import snapshot
from vsense.tracking.grabbers import CameraEvent, GrabberError, NoMorePictures
from vsense.tracking.opencv_manners import teach_opencv
from vsense.tracking.picture_recorder import BackgroundRecorder, PictureRecorder, RecordingError
from vsense.tracking.troubles import Troubles
from vsense.tracking_talk import Talk

FIRST_PICTURE_NS = 15_000_000_000
"""Cameras that give nothing for this long at the beginning do not work at all."""
SILENCE_S = 0.5
"""So often a run without pictures looks whether it shall end."""


def run(options: argparse.Namespace) -> int:
    """Tracks until the recording ends, `--frames` are done, or somebody interrupts.

    Returns:
        0, or 130 after Ctrl-C or SIGTERM.

    Raises:
        VsenseError: it cannot go on; one clear line.
    """
    session = tracking_session.load(options.resources, options.experiment)
    if options.offline and session.is_live:
        raise UsageError(f"--offline: {options.experiment} uses cameras, expected recordings")
    teach_opencv()
    with ExitStack() as stack:
        interrupted = stack.enter_context(interruption())
        tracking = build(session, time.monotonic_ns, options.offline)
        stack.callback(tracking.close)
        console, troubles = Console(), Troubles()
        room = stack.enter_context(TrackRoom(options, session, troubles, console))
        talk = Talk(console, time.monotonic_ns, timesteps(options, tracking), troubles)
        TrackingRun(options, session, tracking, interrupted, talk, room).live()
        return INTERRUPTED if interrupted.is_set() else 0


class TrackingRun:
    """One run of the command, from the first picture to the last word."""

    def __init__(
        self,
        options: argparse.Namespace,
        session: TrackingSession,
        tracking: Tracking,
        interrupted: threading.Event,
        talk: Talk,
        room: TrackRoom,
    ) -> None:
        """Prepares a run.

        Args:
            options: the command line.
            session: what the two files say.
            tracking: the session at work.
            interrupted: set by whoever wants the run to end.
            talk: tells people how it goes.
            room: where it can be looked at.
        """
        self._options = options
        self._session = session
        self._tracking = tracking
        self._interrupted = interrupted
        self._talk = talk
        self._room = room
        self._recorder = begin_recording(session, self._talk)
        self._last: tuple[ArenaState, Sequence[Frame]] | None = None

    def live(self) -> None:
        """Tracks to the end, and leaves picture, recording and summary.

        Raises:
            VsenseError: it cannot go on.
        """
        try:
            self._track()
        except BrokenPipeError:
            # Whoever read the states has seen enough, and nothing more can be written there.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        finally:
            if self._recorder is not None:
                self._recorder.close()
                self._talk.recorded(self._recorder.dropped)
        self._talk.summary(self._tracking.grabber.missed, self._tracking.tracker.counters)
        if self._options.snapshot is not None:
            self._draw(self._options.snapshot)

    def _track(self) -> None:
        begun_ns = time.monotonic_ns()
        if self._options.format == "csv":
            print(arena_lines.CSV_HEADER, flush=True)
        done = 0
        while not self._interrupted.is_set() and done != self._options.frames:
            try:
                state, frames, events = self._tracking.step(SILENCE_S)
            except NoMorePictures:
                self._talk.events(self._tracking.grabber.events())
                return
            except GrabberError as silence:
                self._talk.events(self._tracking.grabber.events())
                if not done and time.monotonic_ns() - begun_ns > FIRST_PICTURE_NS:
                    raise silence
                continue
            done += 1
            self._take(state, frames, events)

    def _take(
        self, state: ArenaState, frames: Sequence[Frame], events: Iterable[CameraEvent]
    ) -> None:
        """Hands one timestep on to everybody."""
        self._last = state, frames
        csv = self._options.format == "csv"
        text = arena_lines.to_csv(state) if csv else arena_lines.to_json(state)
        if text:
            # A reader at the other end of a pipe wants a state when it is new.
            print(text, flush=not self._options.offline)
        if self._recorder is not None:
            self._recorder.write(frames)
        self._talk.events(events)
        self._talk.timestep(state, len(frames))
        self._room.look(state, frames)

    def _draw(self, path: Path) -> None:
        """Draws the last state into a file."""
        if self._last is None:
            raise VsenseError(f"{path}: not drawn, because there was no picture")
        state, frames = self._last
        tracker, cameras = self._tracking.tracker, self._tracking.cameras
        picture = snapshot.draw(state, frames, cameras, tracker.found, tracker.heights_m)
        suffix = path.suffix.lower() if path.suffix.lower() in (".png", ".jpg") else ".png"
        try:
            path.write_bytes(cv2.imencode(suffix, picture)[1].tobytes())
        except OSError as error:
            raise VsenseError(f"{path}: cannot be written: {error.strerror}") from None


def timesteps(options: argparse.Namespace, tracking: Tracking) -> int | None:
    """Gives how many there will be, where that is known."""
    known = tracking.grabber.timesteps
    wanted: int | None = options.frames
    return wanted if known is None else min(known, known if wanted is None else wanted)


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
    try:
        trackers = {view.camera.id: view.tracker for view in session.views}
        write_session_files(directory, cameras, trackers)
    except OSError as error:
        raise RecordingError(f"{directory}: cannot be written: {error.strerror}") from None
    talk.say(f"recording into {directory}")
    return BackgroundRecorder(recorder)
