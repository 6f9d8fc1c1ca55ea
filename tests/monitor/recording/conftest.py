"""Recordings made by hand."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.monitor.recording.scene import CAMERAS, FAMILY, HEIGHTS_M, OFFSETS
from vsense.base.arena import Frame
from vsense.base.message_bus import Message, MessageBus
from vsense.monitor.recording._recorder import Recorder
from vsense.vision.markers.families import load_family
from vsense.vision.tracking.arena_tracker import ArenaTracker

BEGIN_NS = 5_000_000_000


def record(path: Path, messages: Iterable[Message], pictures: Iterable[Frame] = ()) -> Path:
    """Records messages, and pictures one by one, at BEGIN_NS."""
    bus = MessageBus()
    recorder = Recorder(bus, path, pictures=True, clock=lambda: BEGIN_NS)
    for message in messages:
        bus.publish(message)
    for frame in pictures:
        recorder.pictures([frame])
    recorder.close()
    return path


def picture(number: int, camera: str = "left") -> Frame:
    """A small picture, full of noise."""
    image = np.random.default_rng(number).integers(0, 255, (6, 8), dtype=np.uint8)
    return Frame(camera, image, number, BEGIN_NS + number, BEGIN_NS + number + 1)


@pytest.fixture
def lab() -> Iterator[ArenaTracker]:
    """A tracker as the lab makes it."""
    tracker = ArenaTracker.for_family(CAMERAS, load_family(FAMILY), HEIGHTS_M, offsets=OFFSETS)
    yield tracker
    tracker.close()
