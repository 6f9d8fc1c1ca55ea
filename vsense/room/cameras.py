"""How each camera is: how fast its pictures come, and what is wrong with it in words."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from vsense.arena import Frame
from vsense.room.messages import Data
from vsense.tracking.camera import Camera
from vsense.tracking.troubles import Troubles

SILENT_NS = 1_000_000_000
"""A camera without a picture for so long is missed, whatever else is known of it."""


class CameraBoard:
    """Counts the cameras' pictures; one thread."""

    def __init__(self, cameras: Sequence[Camera], troubles: Troubles) -> None:
        """Begins without pictures."""
        self._cameras = [camera.id for camera in cameras]
        self._troubles = troubles
        self._pictures: Counter[str] = Counter()
        self._newest_ns: dict[str, int] = {}
        self._told_ns: int | None = None

    def see(self, frames: Sequence[Frame]) -> None:
        """Takes the pictures of a timestep."""
        for frame in frames:
            self._pictures[frame.camera] += 1
            self._newest_ns[frame.camera] = frame.capture_ns

    def data(self, now_ns: int) -> Data:
        """Gives /cameras; rates count from the last call."""
        told_ns, self._told_ns = self._told_ns, now_ns
        span_s = None if told_ns is None else (now_ns - told_ns) / 1e9
        pictures, self._pictures = self._pictures, Counter()
        return {"cameras": [self._camera(id, pictures[id], span_s, now_ns) for id in self._cameras]}

    def _camera(self, id: str, pictures: int, span_s: float | None, now_ns: int) -> Data:
        present = [event for (camera, _), event in self._troubles.present.items() if camera == id]
        silent_ns = now_ns - self._newest_ns.get(id, now_ns)
        state, text = "ok", ""
        if silent_ns > SILENT_NS:
            state, text = "lost", f"no picture for {silent_ns / 1e9:.1f} s"
        elif present:
            state, text = present[-1].kind, present[-1].text
        return {
            "id": id,
            "rate_hz": None if not span_s else round(pictures / span_s, 2),
            "dropped": self._troubles.counts[id, "damaged"],
            "state": state,
            "text": text,
        }
