"""Markers that are damaged or covered for long: robots that are seen and not read.

A robot whose cells say too little is followed by its outline: under its name as long as they
suggest it, and without one otherwise. Whoever looks at the arena has to know that, because the next
time that this robot is out of sight its name is lost.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import median

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import UNNAMED, Frame
from vsense.vision.cameras._camera_array import CameraArray
from vsense.vision.cameras.camera import Camera

UNREAD_S = 5.0
"""So long a marker has to be seen without being read: nothing drives under a cable for so long."""
_GAP_S = 1.0
"""Out of sight for so long, it may be another one that is seen after it."""
_PER_S = 2.0
"""So often it has to be seen meanwhile, at least."""
_READINGS = 5
"""So many readings end it."""
_REACH_M, _SPEED_M_S = 0.03, 0.25
_LEFT_UNREAD = 0.5
"""Where more than this share of a picture's markers cannot be read, the picture is bad."""


@dataclass(slots=True)
class _Seen:
    """A robot where it was seen last, and since when it has not been read.

    Attributes:
        place: (2,) in the arena [m], at `capture_ns`.
        unread_ns: When it was seen without being read first; `unread` counts since then.
        readings: Since it was not.
        reported: Whether people know that it is not read.
    """

    place: NDArray[np.float64]
    capture_ns: int
    unread_ns: int = 0
    unread: int = 0
    readings: int = 0
    reported: bool = False

    def is_within_reach(self, place: NDArray[np.float64], now_ns: int) -> bool:
        """Whether it can have come to a place."""
        elapsed_s = 1e-9 * (now_ns - self.capture_ns)
        return bool(np.hypot(*(place - self.place)) <= _REACH_M + _SPEED_M_S * elapsed_s)

    def is_unread_for_long(self, place: NDArray[np.float64], now_ns: int, is_legible: bool) -> bool:
        """Takes that it was seen and not read; tells whether that is to be reported now."""
        if self.unread == 0 or not is_legible or now_ns - self.capture_ns > 1e9 * _GAP_S:
            self.unread_ns, self.unread = now_ns, 0
        self.place, self.capture_ns = place, now_ns
        self.unread += is_legible
        if self.unread > 1:  # by this camera, and by no other meanwhile
            self.readings = 0
        elapsed_s = 1e-9 * (now_ns - self.unread_ns)
        if self.reported or elapsed_s < UNREAD_S or self.unread < _PER_S * elapsed_s:
            return False
        self.reported = True
        return True


class MarkerWatch:
    """Watches all robots' markers; to be given each picture's detections."""

    def __init__(self, cameras: Sequence[Camera], heights_m: Mapping[int, float]) -> None:
        """Takes the arena's cameras, and the heights of the tags' markers above the floor."""
        self._cameras = CameraArray(cameras)
        self._heights_m = heights_m
        self._seen: dict[int, _Seen] = {}
        self._nameless: list[_Seen] = []

    def update(self, frames: Sequence[Frame], seen: Mapping[str, NDArray[np.void]]) -> list[str]:
        """Takes pictures' DETECTION arrays, by their cameras; returns lines for people."""
        ordered = sorted(frames, key=lambda frame: frame.capture_ns)
        pictures = {f.camera: seen[f.camera] for f in ordered if f.camera in seen}
        ends = np.cumsum([len(rows) for rows in pictures.values()])
        places = dict(zip(pictures, np.split(self._places(pictures), ends)))
        lines: list[str] = []
        for frame in ordered:
            if frame.camera in pictures:
                camera = frame.camera
                lines += self._look(pictures[camera], places[camera], frame.capture_ns)
        return [line for line in lines if line]

    def _look(self, rows: NDArray[np.void], places: NDArray[np.float64], now_ns: int) -> list[str]:
        lines = [
            self._read(int(rows["tag"][row]), places[row], now_ns)
            for row in np.flatnonzero(rows["read"]).tolist()
        ]
        unread = np.flatnonzero(~rows["read"])
        if len(unread) == 0 or len(unread) > max(1.0, _LEFT_UNREAD * len(rows)):
            return lines
        for row, tag in zip(unread.tolist(), self._whose(rows, places, unread, now_ns)):
            is_legible = bool(rows["legible"][row])
            if tag in self._seen:
                lines.append(self._unread(tag, places[row], now_ns, is_legible))
            elif tag == UNNAMED:
                lines.append(self._unnamed(places[row], now_ns, is_legible))
        return lines

    def _places(self, pictures: Mapping[str, NDArray[np.void]]) -> NDArray[np.float64]:
        """Returns (n, 2) where markers are [m]; one without a name is as high as most are."""
        usual_m = median([*self._heights_m.values()] or [0.0])
        tags = [tag for rows in pictures.values() for tag in rows["tag"].tolist()]
        return self._cameras.places(pictures, [self._heights_m.get(tag, usual_m) for tag in tags])

    def _read(self, tag: int, place: NDArray[np.float64], now_ns: int) -> str:
        """Takes that a robot was read; returns what is to be told, or nothing."""
        seen = self._seen.setdefault(tag, _Seen(place, now_ns))
        seen.place, seen.capture_ns, seen.unread = place, now_ns, 0
        seen.readings += 1
        if not seen.reported or seen.readings < _READINGS:
            return ""
        seen.reported = False
        return f"robot {tag}'s marker can be read again"

    def _unread(self, tag: int, place: NDArray[np.float64], now_ns: int, is_legible: bool) -> str:
        """Takes that a robot was seen and not read; returns what is to be told, or nothing."""
        if self._seen[tag].is_unread_for_long(place, now_ns, is_legible):
            return f"robot {tag}'s marker is damaged or covered: it is seen, but can not be read"
        return ""

    def _unnamed(self, place: NDArray[np.float64], now_ns: int, is_legible: bool) -> str:
        """Takes a marker that never had a name; returns what is to be told, or nothing."""
        self._nameless = [s for s in self._nameless if now_ns - s.capture_ns <= 1e9 * _GAP_S]
        near = [seen for seen in self._nameless if seen.is_within_reach(place, now_ns)]
        if not near:
            near = [_Seen(place, now_ns)]
            self._nameless += near
        if len(near) > 1 or not near[0].is_unread_for_long(place, now_ns, is_legible):
            return ""
        return (
            f"a marker at ({place[0]:.2f}, {place[1]:.2f}) m has no name: it is seen, but can not"
            " be read, or its tag is not on the roster"
        )

    def _whose(
        self,
        rows: NDArray[np.void],
        places: NDArray[np.float64],
        unread: NDArray[np.intp],
        now_ns: int,
    ) -> list[int]:
        """Returns whose the markers are that were not read: the only robot that can be there."""
        here = set(rows["tag"].tolist())
        missing = [
            (tag, seen)
            for tag, seen in self._seen.items()
            if tag not in here and now_ns - seen.capture_ns <= 1e9 * _GAP_S
        ]
        owners = []
        for row in unread.tolist():
            near = [tag for tag, seen in missing if seen.is_within_reach(places[row], now_ns)]
            named = int(rows["tag"][row])
            owners.append(named if named != UNNAMED else near[0] if len(near) == 1 else UNNAMED)
        return [tag if owners.count(tag) == 1 else UNNAMED for tag in owners]
