"""A short scene before two cameras: robots that drive, hide, are there twice, and come anew."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

from tests.vision.tracking.synthetic import HEIGHT_M, Robot, render
from vsense.base.arena import Frame
from vsense.base.message_bus import Message, MessageBus
from vsense.config.roster_fields import MarkerOffset
from vsense.monitor.recording._recorder import Recorder
from vsense.monitor.recording.pictures import PictureRecorder, one_tracker, write_session_files
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import MarkerFamily, load_family
from vsense.vision.tracking import recorded_tracker
from vsense.vision.tracking.arena_tracker import ArenaTracker
from vsense.vision.tracking.mask import Mask

FAMILY = "arrow4x4"
STEP_NS = 100_000_000
TIMESTEPS = 24
CAMERAS = [
    Camera.looking_down(name, x_m, 0.0, 2.43, 1200.0, (360, 280), (-0.1, 0.01, 1e-4, -1e-4, 0.0))
    for name, x_m in (("right", 0.15), ("left", -0.15))
]
STRANGER = 1234
HEIGHTS_M = {3: HEIGHT_M, 14: HEIGHT_M, 77: HEIGHT_M}

OFFSETS = dict.fromkeys((*HEIGHTS_M, STRANGER), MarkerOffset(0.003, -0.004, 0.07))
"""Markers that sit beside the middle: recordings hold where."""
MADE = recorded_tracker.of_family(CAMERAS, FAMILY, HEIGHTS_M, offsets=OFFSETS)


def robots(timestep: int) -> list[Robot]:
    """Where everybody is."""
    gone = 0.008 * timestep
    turned = 0.05 * timestep
    found = [
        Robot(3, -0.2 + gone, 0.05, turned),
        Robot(STRANGER, 0.2, -0.06 + 0.2 * gone, 1.0 - turned),
    ]
    if not 8 <= timestep < 12:
        found.append(Robot(14, 0.1 - gone, -0.05, 2.0 + turned))
    if timestep in (15, 16):
        found.append(Robot(3, 0.2, 0.07, 0.0))
    if timestep > 6:
        found.append(Robot(77, -0.25, 0.07, math.pi - turned))
    return found


@cache
def frames(timestep: int, cameras: int = 2) -> Sequence[Frame]:
    """The pictures of a timestep."""
    family = load_family(FAMILY)
    assert isinstance(family, MarkerFamily)
    at_ns = (timestep + 100) * STEP_NS
    return [
        Frame(
            camera.id,
            render(camera, family, robots(timestep), seed=2 * timestep + place),
            timestep,
            at_ns + 1_000_000 * place,
            at_ns + 20_000_000,
        )
        for place, camera in enumerate(CAMERAS[:cameras])
    ]


def session_files(folder: Path, mask: Mask | None = None) -> tuple[Path, Path]:
    """The scene as a recording of `vsense camera track`."""
    pictures = PictureRecorder(folder, CAMERAS)
    pictures.write(frames(0))
    pictures.close()
    trackers = one_tracker(CAMERAS, FAMILY, HEIGHTS_M)
    write_session_files(folder, CAMERAS, trackers, mask)
    return folder / "resources.xml", folder / "experiment.xml"


def track(
    path: Path, tracker: ArenaTracker, made: dict[str, Any], begin: int = 0, off: range = range(0)
) -> Path:
    """Tracks the scene and records it from a timestep on, without those in `off`."""
    bus, recorder = MessageBus(), None
    for timestep in range(TIMESTEPS):
        if timestep == begin:
            recorder = Recorder(bus, path, pictures=True)
            recorder.describe_tracker(made)
        if recorder is not None and off:
            if timestep == off.start:
                recorder.pause()
            if timestep == off.stop:
                recorder.resume()
        if recorder is not None:
            recorder.pictures(frames(timestep), tracker)
        state = tracker.update(frames(timestep))
        bus.publish(Message("/arena", state.capture_ns, state.data()))
    assert recorder is not None
    recorder.close()
    return path
