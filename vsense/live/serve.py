"""The pictures of an arena tracking server's runs, kept where the experiment file asks for it.

Thesis, 2.2.2 and 2.3.1: with `change_root_directory_on_start` each run is a recording of its own,
without it all runs are one, which goes on with the next run.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing

from vsense.arena import Frame
from vsense.cameras.grabber import GrabberError, NoMorePictures
from vsense.cameras.opencv_source import teach_opencv
from vsense.config import tracking_session
from vsense.config.tracking_build import Tracking, build
from vsense.config.tracking_specs import TrackingSession
from vsense.link.trackers.server import ArenaServer
from vsense.live.track import Talk, begin_recording
from vsense.recording.pictures import BackgroundRecorder, PictureRecordingError
from vsense.terminal import INTERRUPTED, Console, interruption
from vsense.tracking.views import ImagePoses


class RunPictures:
    """Keeps pictures while a run is on. A disk that fails ends the recording, not the server."""

    def __init__(
        self,
        begin: Callable[[], BackgroundRecorder | None],
        each_run: bool,
        say: Callable[[str], None],
    ) -> None:
        """Begins nothing yet.

        Args:
            begin: begins a recording; None where none is wanted.
            each_run: every run is a recording of its own.
            say: takes a line for a person.
        """
        self._begin = begin
        self._each_run = each_run
        self._say = say
        self._recorder: BackgroundRecorder | None = None
        self._running = False

    def timestep(self, running: bool, frames: Sequence[Frame]) -> None:
        """Takes the pictures of a timestep; they are kept where it belongs to a run."""
        try:
            if running and not self._running and self._recorder is None:
                self._recorder = self._begin()
            self._running = running
            if running and self._recorder is not None:
                self._recorder.write(frames)
            elif not running and self._each_run:
                self.close()
        except PictureRecordingError as error:
            self._say(f"{error}; this run is not recorded")
            self.close()

    def close(self) -> None:
        """Ends the recording; can be called again."""
        recorder, self._recorder = self._recorder, None
        if recorder is None:
            return
        try:
            recorder.close()
        except PictureRecordingError as error:
            self._say(str(error))
        if recorder.dropped:
            self._say(f"the disk was too slow: {recorder.dropped} timesteps were not recorded")


FIRST_PICTURE_NS = 15_000_000_000
"""Cameras that give nothing for this long at the beginning do not work at all."""
SILENCE_S = 0.5
"""So often a server without pictures or client looks whether it shall end."""


def run(resources: str, experiment: str, host: str, port: int | None) -> int:
    """Serves until somebody interrupts.

    Args:
        resources: path of the resources file.
        experiment: path of the experiment file.
        host: address of the interface to listen on.
        port: TCP port, 0: any free one, None: the experiment file's.

    Returns:
        130, after Ctrl-C or SIGTERM.

    Raises:
        VsenseError: it cannot go on; one clear line.
    """
    session = tracking_session.load(resources, experiment)
    teach_opencv()
    console = Console()
    talk = Talk(console, time.monotonic_ns, None)
    cameras = [view.camera for view in session.views]
    port = session.server_port if port is None else port
    with ExitStack() as stack:
        interrupted = stack.enter_context(interruption())
        locate = ImagePoses(cameras, session.heights_m)
        server = ArenaServer(host, port, locate, talk.say)
        stack.callback(server.close)
        server.start()
        talk.say(f"serving arena states on {host}, port {server.port}; Ctrl-C ends it")
        pictures = RunPictures(
            lambda: begin_recording(session, talk),
            session.record.change_root_directory_on_start,
            talk.say,
        )
        stack.callback(pictures.close)
        Serving(session, server, locate, pictures, talk, interrupted).live()
        console.end_progress()
    return INTERRUPTED


class Serving:
    """The tracker's thread of the server."""

    def __init__(
        self,
        session: TrackingSession,
        server: ArenaServer,
        locate: ImagePoses,
        pictures: RunPictures,
        talk: Talk,
        interrupted: threading.Event,
    ) -> None:
        """Prepares it.

        Args:
            session: what to track.
            server: where the states go.
            locate: the server's; it learns of robots that join.
            pictures: where the pictures of runs go.
            talk: what a person is told.
            interrupted: set by whoever wants it to end.
        """
        self._session = session
        self._server = server
        self._locate = locate
        self._pictures = pictures
        self._talk = talk
        self._interrupted = interrupted

    def live(self) -> None:
        """Tracks and publishes until it is interrupted.

        Raises:
            VsenseError: it cannot go on.
        """
        while not self._interrupted.is_set():
            self._server.forget()
            # Recordings are paced here: their first timestep lasts until a client starts a run.
            with closing(build(self._session, time.monotonic_ns, offline=True)) as tracking:
                if self._session.is_live:
                    self._watch(tracking)
                else:
                    self._play(tracking)

    def _watch(self, tracking: Tracking) -> None:
        """Tracks what cameras see."""
        begun_ns, done = time.monotonic_ns(), 0
        while not self._interrupted.is_set():
            try:
                self._step(tracking)
                done += 1
            except GrabberError:
                self._talk.events(tracking.grabber.events())
                if not done and time.monotonic_ns() - begun_ns > FIRST_PICTURE_NS:
                    raise

    def _play(self, tracking: Tracking) -> None:
        """Plays a recording once, from the start of a client's run to its end."""
        try:
            self._step(tracking)
            while not self._server.wait_for_run(SILENCE_S):
                if self._interrupted.is_set():
                    return
            first = tracking.tracker.state
            begun_ns = time.monotonic_ns()
            self._server.publish(first)
            while self._server.running and not self._interrupted.is_set():
                self._step(tracking, begun_ns - first.capture_ns)
        except NoMorePictures:
            self._talk.events(tracking.grabber.events())
            self._server.end_run()

    def _step(self, tracking: Tracking, shift_ns: int | None = None) -> None:
        """Lives one timestep.

        Args:
            tracking: the session at work.
            shift_ns: from the capture time to when the state is due; None: at once.
        """
        state, frames, events = tracking.step(SILENCE_S)
        self._locate.learn(tracking.tracker.heights_m)
        if shift_ns is not None:
            wait_ns = state.capture_ns + shift_ns - time.monotonic_ns()
            self._interrupted.wait(max(wait_ns, 0) / 1e9)
        self._server.publish(state)
        self._pictures.timestep(self._server.running, frames)
        self._talk.events(events)
        self._talk.timestep(state, len(frames))
