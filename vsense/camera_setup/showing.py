"""One picture of a camera, into a file.

`vsense cameras show`: one picture into a file, or live pictures in the page.
"""

from __future__ import annotations

import argparse
import sys
import threading
import time
from collections import deque
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from pathlib import Path

import cv2
import numpy as np

from vsense.arena import POSE, ArenaState, Frame
from vsense.camera_setup.markers import MarkerFinder
from vsense.camera_setup.opening import OpenCamera, choose, make, session_of, sizes_of, wanted_of
from vsense.cameras.grabber import CameraEvent, GrabberError, Troubles
from vsense.cameras.health import Health
from vsense.cameras.picture import Image
from vsense.errors import UsageError, VsenseError
from vsense.live.track_room import TrackRoom
from vsense.markers.families import load_family
from vsense.terminal import INTERRUPTED, Console, interruption
from vsense.tracking.opening import live_grabber
from vsense.tracking.specs import GrabberSpec, TrackingSession

SUFFIXES = (".png", ".jpg", ".jpeg", ".pgm")
WARM_UP = 3
"""So many pictures go by first: the first ones may still have the exposure of before."""


def check(path: Path) -> None:
    """Refuses a file of another kind.

    Raises:
        UsageError: its name has another ending.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise UsageError(f"{path}: expected a name that ends in {', '.join(SUFFIXES)}")


def settled(camera: OpenCamera) -> Image:
    """Takes a picture once exposure and gain have settled.

    Raises:
        GrabberError: the camera is gone.
    """
    for _ in range(WARM_UP):
        camera.picture()
    return camera.picture().image


def save_picture(image: Image, path: Path) -> None:
    """Writes an (h, w) uint8 picture.

    Raises:
        VsenseError: it cannot be written.
    """
    data = cv2.imencode(path.suffix.lower(), image)[1].tobytes()
    try:
        path.write_bytes(data)
    except OSError as error:
        raise VsenseError(f"{path}: cannot be written: {error.strerror}") from None


WINDOW = 20
"""The rate is that of so many pictures."""
SILENCE_S = 0.5


def run(options: argparse.Namespace) -> int:
    """Shows a camera until it is interrupted, or saves a picture.

    Raises:
        UsageError: there is no such camera, or a file of this kind cannot be written.
        VsenseError: the camera does not open, or the page cannot be served.
    """
    if options.save is not None:
        check(options.save)
    with ExitStack() as stack:
        interrupted = stack.enter_context(interruption())
        spec = choose(options.id, wanted_of(options), options.resources)
        finder = MarkerFinder(load_family(options.family))
        image = _look(spec, options.save)
        if options.save is None and not interrupted.is_set():
            finder.look(image)
            console, troubles = Console(), Troubles()
            sizes_px = {spec.id: (image.shape[1], image.shape[0])}
            session = session_of(spec.id, [spec], sizes_px, finder.px_per_m)
            room = stack.enter_context(TrackRoom(options, session, troubles, console))
            ShowSession(session, finder, room, console, troubles).live(interrupted)
        return INTERRUPTED if interrupted.is_set() else 0


def _look(spec: GrabberSpec, save: Path | None) -> Image:
    """Takes a first picture, and keeps it if that is wanted.

    Raises:
        VsenseError: the camera gives none, or the file cannot be written.
    """
    camera = make(spec)
    try:
        told = camera.open()
        image = camera.picture().image if save is None else settled(camera)
    finally:
        camera.source.close()
    if save is not None:
        height, width = image.shape
        for text in told:
            print(f"vsense: {spec.id}: {text}", file=sys.stderr)
        save_picture(image, save)
        print(save)
        print(f"vsense: {width} x {height} px, mean grey {image.mean():.0f}", file=sys.stderr)
    return image


class ShowSession:
    """Pictures in the page, with the markers that can be read in them."""

    def __init__(
        self,
        session: TrackingSession,
        finder: MarkerFinder,
        room: TrackRoom,
        console: Console,
        troubles: Troubles,
    ) -> None:
        """Prepares to show the session's one camera.

        Args:
            session: looks through the camera.
            finder: looks for markers.
            room: where it can be looked at.
            console: what a person is told.
            troubles: what the camera suffers from.
        """
        self._session = session
        self._finder = finder
        self._room = room
        self._console = console
        self._troubles = troubles
        self._health = Health([session.views[0].camera], {})
        self._times_ns: deque[int] = deque(maxlen=WINDOW)

    def live(self, interrupted: threading.Event) -> None:
        """Shows until it is interrupted; a camera that goes is told, and taken back."""
        grabber = live_grabber(self._session, sizes_of(self._session), time.monotonic_ns)
        self._console.say("Ctrl-C ends")
        try:
            while not interrupted.is_set():
                try:
                    frames = grabber.next(SILENCE_S)
                except GrabberError:
                    frames = []
                self._tell(grabber.events())
                if frames:
                    self._tell(self._health.look(frames, {}))
                    self._show(frames)
        finally:
            self._console.end_progress()
            grabber.close()

    def _show(self, frames: Sequence[Frame]) -> None:
        """Shows the camera's picture."""
        (frame,) = frames
        found = self._finder.look(frame.image)
        state = ArenaState(
            frame.timestep,
            frame.capture_ns,
            np.zeros(0, dtype=POSE),
            len(found.tags),
            cameras=(frame.camera,),
            images=found.poses(),
        )
        self._room.update(state, frames)
        self._times_ns.append(frame.capture_ns)
        since_ns = max(self._times_ns[-1] - self._times_ns[0], 1)
        self._console.progress(
            f"{frame.camera}: {1e9 * (len(self._times_ns) - 1) / since_ns:.1f} pictures/s,"
            f" mean grey {frame.image.mean():.0f}, {found.count} markers"
        )

    def _tell(self, events: Iterable[CameraEvent]) -> None:
        for line in self._troubles.lines(events):
            self._console.say(f"vsense: {line}")
