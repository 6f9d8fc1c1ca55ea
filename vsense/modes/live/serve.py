"""`vsense camera serve`: arena states for other programs, and the pictures of their runs.

Thesis, 2.2.2 and 2.3.1: with `change_root_directory_on_start` each run is a recording of its own,
without it all runs are one, which goes on with the next run.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace

from vsense.base.arena import ArenaState, Frame
from vsense.base.clock import host_ns
from vsense.base.interruption import interruption
from vsense.base.terminal import Console
from vsense.config import tracking_session
from vsense.modes.live._runs import RunPictures, begin_recording
from vsense.modes.live._talk import Talk
from vsense.modes.live.track import PICTURE_POLL_S, Timesteps, timesteps
from vsense.monitor.ui.access import is_loopback
from vsense.robots.link.trackers.server import ArenaServer
from vsense.vision.cameras.grabber import Troubles
from vsense.vision.tracking.camera_tracking import CameraTracking, ImagePoses
from vsense.vision.tracking.opening import OFFLINE, open_tracking
from vsense.vision.tracking.specs import PlacedMarker, TrackingSession

_NO_MARKERS: Mapping[int, PlacedMarker] = {}

REPEAT_S = 0.1
"""Between two states that repeat the last one: the original's timestep."""
STOP_WAIT_NS = 1_000_000_000
"""A server that ends waits this long for its client to end the run."""


def run(
    resources: str,
    experiment: str,
    host: str,
    port: int | None,
    markers: Mapping[int, PlacedMarker] = _NO_MARKERS,
) -> int:
    """Serves until Ctrl-C or SIGTERM; returns 130 or 143.

    `resources` and `experiment` are paths, `host` is the address of the interface to listen on;
    `port` 0 is any free one, None the experiment file's; `markers` are where these sit on their
    robots, by tag.
    """
    session = replace(tracking_session.load(resources, experiment), offsets=markers)
    console = Console()
    talk = Talk(console, host_ns, None)
    cameras = [view.camera for view in session.views]
    port = session.server_port if port is None else port
    with ExitStack() as stack:
        interrupted = stack.enter_context(interruption())
        locate = ImagePoses(cameras, session.heights_m)
        server = ArenaServer(host, port, locate, talk.say)
        stack.callback(server.close)
        server.start()
        talk.say(f"serving arena states on {host}, port {server.port}; Ctrl-C ends it")
        if is_loopback(host):
            talk.say("only programs on this machine reach that address; for others: --host 0.0.0.0")
        else:
            talk.say(f"not authenticated: port {server.port} on {host} serves every machine")
        pictures = RunPictures(
            lambda: begin_recording(session, talk),
            session.record.change_root_directory_on_start,
            talk.say,
        )
        stack.callback(pictures.close)
        Serving(session, server, locate, pictures, talk, interrupted).run()
        console.end_progress()
    return interrupted.code


@dataclass(frozen=True, slots=True)
class Serving:
    """The tracker's thread of the server; `locate` is the server's and learns of new robots."""

    session: TrackingSession
    server: ArenaServer
    locate: ImagePoses
    pictures: RunPictures
    talk: Talk
    interrupted: threading.Event

    def run(self) -> None:
        """Tracks and publishes until it is interrupted."""
        session, troubles = self.session, Troubles()
        while not self.interrupted.is_set():
            self.server.forget()
            # Recordings are paced here: their first timestep lasts until a client starts a run.
            tracking = open_tracking(session, host_ns, self.talk.say, OFFLINE, troubles)
            with closing(tracking):
                steps = timesteps(tracking, self.interrupted)
                if session.is_live:
                    for state, frames in steps:
                        self._publish(tracking, state, frames)
                else:
                    self._play(tracking, steps)
        until_ns = host_ns() + STOP_WAIT_NS
        while host_ns() < until_ns and self.server.repeat(REPEAT_S):
            pass

    def _play(self, tracking: CameraTracking, steps: Timesteps) -> None:
        """Plays a recording once, from the start of a client's run to its end.

        A run that lasts longer than the recording goes on with its last state.
        """
        first, frames = next(steps, (None, ()))
        if first is None:
            self.server.end_run()
            return
        self._publish(tracking, first, frames)
        while not self.server.wait_for_run(PICTURE_POLL_S):
            if self.interrupted.is_set():
                return
        shift_ns = host_ns() - first.capture_ns
        self.server.publish(first)
        for state, frames in steps:
            wait_ns = state.capture_ns + shift_ns - host_ns()
            self.interrupted.wait(max(wait_ns, 0) / 1e9)
            self._publish(tracking, state, frames)
            if not self.server.running:
                return
        while not self.interrupted.is_set() and self.server.repeat(REPEAT_S):
            pass

    def _publish(
        self, tracking: CameraTracking, state: ArenaState, frames: Sequence[Frame]
    ) -> None:
        """Hands one timestep on to server, recording and live line."""
        self.locate.learn(tracking.tracker.heights_m)
        self.server.publish(state)
        self.pictures.timestep(self.server.running, frames)
        self.talk.timestep(state, len(frames))
