"""`vsense cameras show`: one picture into a file, or live pictures in the page."""

from __future__ import annotations

import argparse
import sys
import threading
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from vsense.arena import POSE, ArenaState
from vsense.cameras import saving
from vsense.cameras.opening import choose, make, wanted_of
from vsense.config.live_cameras import live_grabber
from vsense.config.tracking_specs import (
    CameraTrackerSpec,
    GrabberSpec,
    RecordSpec,
    Resources,
    TrackerSpec,
    TrackingSession,
)
from vsense.console import Console
from vsense.interruption import INTERRUPTED, interruption
from vsense.room.track_room import TrackRoom
from vsense.tracking.camera import Camera as Calibration
from vsense.tracking.grabbers import GrabberError
from vsense.tracking.health import Health
from vsense.tracking.troubles import Troubles

AWAY_M, FOCAL = 2.5, 1.0
"""Where nobody has calibrated a camera: that it hangs so high, and sees as far as it is high."""
SILENCE_S = 0.5


def run(options: argparse.Namespace) -> int:
    """Shows a camera until it is interrupted, or saves a picture.

    Raises:
        UsageError: there is no such camera, or a file of this kind cannot be written.
        VsenseError: the camera does not open, or the page cannot be served.
    """
    if options.save is not None:
        saving.check(options.save)
    with ExitStack() as stack:
        interrupted = stack.enter_context(interruption())
        spec = choose(options.id, wanted_of(options), options.resources)
        size_px = _look(spec, options.save)
        if options.save is None:
            console, troubles = Console(), Troubles()
            session = _session(spec, size_px)
            room = stack.enter_context(TrackRoom(options, session, troubles, console))
            _live(session, room, console, troubles, interrupted)
        return INTERRUPTED if interrupted.is_set() else 0


def _look(spec: GrabberSpec, save: Path | None) -> tuple[int, int]:
    """Takes a first picture, and keeps it if that is wanted; gives width and height.

    Raises:
        VsenseError: the camera gives none, or the file cannot be written.
    """
    camera = make(spec)
    try:
        for text in camera.source.open():
            print(f"vsense: {spec.id}: {text}", file=sys.stderr)
        image = camera.picture().image if save is None else saving.settled(camera)
    except GrabberError as error:
        raise GrabberError(f"{spec.id}: {error}") from None
    finally:
        camera.source.close()
    height, width = image.shape
    if save is not None:
        saving.save(image, save)
        print(save)
        print(f"vsense: {width} x {height} px, mean grey {image.mean():.0f}", file=sys.stderr)
    return width, height


def _session(spec: GrabberSpec, size_px: tuple[int, int]) -> TrackingSession:
    """Makes a tracking session that looks through one camera and tracks nobody."""
    focal_px = FOCAL * max(size_px)
    calibration = Calibration.looking_down(spec.id, 0.0, 0.0, AWAY_M, focal_px, size_px)
    tracker = TrackerSpec("no tracker", "arrow4x4", 0.0, {}, 1.0, True, 0)
    view = CameraTrackerSpec(spec, calibration, tracker, 0)
    record = RecordSpec(False, False, Path(), "png", 0)
    resources = Resources(spec.id, {spec.id: spec}, {}, {})
    return TrackingSession(spec.id, resources, 0, 1, 0.3, (view,), record)


def _live(
    session: TrackingSession,
    room: TrackRoom,
    console: Console,
    troubles: Troubles,
    interrupted: threading.Event,
) -> None:
    """Shows pictures until it is interrupted; a camera that goes is told and taken back."""
    calibration = session.views[0].camera
    sizes_px = {calibration.id: (calibration.width_px, calibration.height_px)}
    health = Health([calibration], {})
    nobody = np.zeros(0, dtype=POSE)
    begun_ns, pictures = time.monotonic_ns(), 0
    grabber = live_grabber(session, sizes_px, time.monotonic_ns)
    console.say("Ctrl-C ends")
    try:
        while not interrupted.is_set():
            try:
                frames = grabber.next(SILENCE_S)
            except GrabberError:
                frames = []
            events = [*grabber.events(), *(health.look(frames, {}) if frames else [])]
            for line in troubles.lines(events):
                console.say(f"vsense: {line}")
            if not frames:
                continue
            pictures += 1
            capture_ns = frames[0].capture_ns
            room.look(ArenaState(frames[0].timestep, capture_ns, nobody, 0), frames)
            rate_hz = 1e9 * pictures / max(time.monotonic_ns() - begun_ns, 1)
            mean = f"mean grey {frames[0].image.mean():.0f}"
            console.progress(f"{session.file}: {pictures} pictures, {rate_hz:.1f}/s, {mean}")
    finally:
        console.end_progress()
        grabber.close()
