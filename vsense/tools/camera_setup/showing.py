"""`vsense camera show`: one picture into a file, or live pictures in the page."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from vsense.base.arena import POSE, ArenaState, Frame, Image
from vsense.base.clock import host_ns
from vsense.base.errors import GrabberError, UsageError, VsenseError, failing_as
from vsense.base.interruption import interruption
from vsense.base.terminal import Console, print_data
from vsense.modes.live.track_room import TrackRoom
from vsense.monitor.ui.access import WebAddress
from vsense.monitor.ui.room import ControlRoom, RoomOptions
from vsense.tools.camera_setup.files import choose
from vsense.vision.cameras.grabber import CameraEvent, Troubles
from vsense.vision.cameras.health import Health
from vsense.vision.cameras.source import Controls
from vsense.vision.markers.families import load_family
from vsense.vision.tracking.marker_finder import MarkerFinder
from vsense.vision.tracking.opening import live_grabber
from vsense.vision.tracking.single_camera import OpenCamera, make, session_of
from vsense.vision.tracking.specs import GrabberSpec, TrackingSession

SAVED_SUFFIXES = (".png", ".jpg", ".jpeg", ".pgm")
WARM_UP = 3
"""Pictures to skip, which may still have the earlier exposure."""


def settled(camera: OpenCamera) -> Image:
    """Takes a picture once exposure and gain have settled; raises as `OpenCamera.picture`."""
    for _ in range(WARM_UP):
        camera.picture()
    return camera.picture().image


def save_picture(image: Image, path: Path) -> None:
    """Writes an (h, w) uint8 picture; raises VsenseError where it cannot be written."""
    data = cv2.imencode(path.suffix.lower(), image)[1].tobytes()
    with failing_as(VsenseError, f"{path}: cannot be written"):
        path.write_bytes(data)


RATE_WINDOW = 20
"""Pictures for the rate."""
SHOW_TIMEOUT_S = 0.5


@dataclass(frozen=True, slots=True)
class ShowOptions:
    """Which camera is shown; see `vsense camera show -h`.

    `id`, `wanted` and `resources` are as in `choose`. `save`: one picture goes into this file; else
    `web` says where the page is.
    """

    id: str
    wanted: Controls
    resources: str | None
    family: str
    save: Path | None
    web: WebAddress | None


def run(options: ShowOptions) -> int:
    """Shows a camera in the page until it is interrupted, or saves a picture.

    Raises:
        UsageError: There is no such camera, or a file of this kind cannot be written.
        VsenseError: The camera does not open, or the page cannot be served.
    """
    save = options.save
    if save is not None and save.suffix.lower() not in SAVED_SUFFIXES:
        raise UsageError(f"{save}: expected a name that ends in {', '.join(SAVED_SUFFIXES)}")
    room_options = RoomOptions(None if save else options.web)
    room_options.check()
    with ExitStack() as stack:
        interrupted = stack.enter_context(interruption())
        spec = choose(options.id, options.wanted, options.resources)
        finder = MarkerFinder(load_family(options.family))
        image = _look(spec, save)
        if save is None and not interrupted.is_set():
            finder.find(image)
            console, troubles = Console(), Troubles()
            width = finder.cell_width(finder.px_per_m) if finder.px_per_m else None
            if width is not None and width.is_small:
                console.say(f"vsense: {spec.id}: {width.in_words()}")
            sizes_px = {spec.id: (image.shape[1], image.shape[0])}
            session = session_of(spec.id, [spec], sizes_px, finder.px_per_m)
            control_room = stack.enter_context(ControlRoom(room_options, console))
            room = TrackRoom(control_room, session, troubles)
            room.open()
            ShowSession(session, finder, room, console, troubles).run(interrupted)
        return interrupted.code if interrupted.is_set() else 0


def _look(spec: GrabberSpec, save: Path | None) -> Image:
    """Takes a first picture, and saves it if wanted."""
    camera = make(spec, host_ns)
    try:
        messages = camera.open()
        image = camera.picture().image if save is None else settled(camera)
    finally:
        camera.source.close()
    if save is not None:
        height, width = image.shape
        for text in messages:
            Console().say(f"vsense: {spec.id}: {text}")
        save_picture(image, save)
        print_data(str(save))
        Console().say(f"vsense: {width} x {height} px, mean grey {image.mean():.0f}")
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
        """Takes a session of one camera; `troubles` are also those of the room."""
        self._session = session
        self._finder = finder
        self._room = room
        self._console = console
        self._troubles = troubles
        self._camera = session.views[0].camera
        self._health = Health([self._camera], {})
        self._times_ns: deque[int] = deque(maxlen=RATE_WINDOW)

    def run(self, interrupted: threading.Event) -> None:
        """Shows the camera until it is interrupted; a lost camera is reopened."""
        size_px = self._camera.width_px, self._camera.height_px
        sizes_px = {self._camera.id: size_px}
        grabber = live_grabber(self._session.resources, self._session.grabbers, sizes_px, host_ns)
        self._console.say("Ctrl-C ends")
        try:
            while not interrupted.is_set():
                try:
                    frames = grabber.next(SHOW_TIMEOUT_S)
                except GrabberError:
                    frames = []
                self._report(grabber.events())
                if frames:
                    self._report(self._health.update(frames, {}))
                    self._show(frames)
        finally:
            self._console.end_progress()
            grabber.close()

    def _show(self, frames: Sequence[Frame]) -> None:
        (frame,) = frames
        markers = self._finder.find(frame.image)
        state = ArenaState(
            frame.timestep,
            frame.capture_ns,
            np.zeros(0, dtype=POSE),
            len(markers.tags),
            cameras=(frame.camera,),
            images=markers.poses(),
        )
        self._room.update(state, frames)
        self._times_ns.append(frame.capture_ns)
        since_ns = max(self._times_ns[-1] - self._times_ns[0], 1)
        self._console.progress(
            f"{frame.camera}: {1e9 * (len(self._times_ns) - 1) / since_ns:.1f} pictures/s,"
            f" mean grey {frame.image.mean():.0f}, {markers.count} markers"
        )

    def _report(self, events: Iterable[CameraEvent]) -> None:
        for line in self._troubles.lines(events):
            self._console.say(f"vsense: {line}")
