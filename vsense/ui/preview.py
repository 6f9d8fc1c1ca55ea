"""Small JPEG pictures of the cameras, a few per second, made beside the run."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import replace

import cv2

from vsense.arena import Frame
from vsense.message_bus import Message, MessageBus

PERIOD_NS = 250_000_000
"""A camera is shown so often."""

WIDTH_PX = 640
"""Pictures are shown at most so wide."""

QUALITY = 70
TOPIC = "/picture/"


class PreviewEncoder:
    """Makes JPEG pictures on a thread of its own; of each camera the newest picture only."""

    def __init__(self, bus: MessageBus) -> None:
        self._bus = bus
        self._due_ns: dict[str, int] = {}
        self._waiting: dict[str, Frame] = {}
        self._lock = threading.Lock()
        self._news = threading.Event()
        self._ending = False
        self._thread = threading.Thread(target=self._run, name="vsense-preview", daemon=True)
        self._thread.start()

    def offer(self, frames: Sequence[Frame]) -> None:
        """Takes pictures, copying those that somebody wants to see; does not wait."""
        for frame in frames:
            due_ns = self._due_ns.get(frame.camera, 0)
            if frame.capture_ns < due_ns or not self._bus.wants(TOPIC + frame.camera):
                continue
            self._due_ns[frame.camera] = max(due_ns + PERIOD_NS, frame.capture_ns)
            copy = replace(frame, image=frame.image.copy())
            with self._lock:
                self._waiting[frame.camera] = copy
            self._news.set()

    def close(self) -> None:
        """Ends the thread."""
        self._ending = True
        self._news.set()
        self._thread.join()

    def _run(self) -> None:
        while self._news.wait() and not self._ending:
            self._news.clear()
            with self._lock:
                waiting, self._waiting = self._waiting, {}
            for frame in waiting.values():
                self._bus.publish(picture(frame))


def picture(frame: Frame) -> Message:
    """Makes the message with a small picture."""
    height, width = frame.image.shape
    scale = min(1.0, WIDTH_PX / width)
    size = (round(width * scale), round(height * scale))
    small = cv2.resize(frame.image, size, interpolation=cv2.INTER_AREA)
    blob = cv2.imencode(".jpg", small, (cv2.IMWRITE_JPEG_QUALITY, QUALITY))[1].tobytes()
    data = {
        "camera": frame.camera,
        "timestep": frame.timestep,
        "capture_ns": frame.capture_ns,
        "format": "jpeg",
        "width_px": width,
        "height_px": height,
        "scale": scale,
    }
    return Message(TOPIC + frame.camera, frame.capture_ns, data, blob)
