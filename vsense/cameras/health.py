"""Camera health: dark, saturated, frozen, moved, crowded, or contradicting neighbours.

Light and standstill are looked for in every picture, movement in a few cameras per timestep by
turns, so that many cameras cost no more than few. All of it is reported once when it begins and
once when it ends.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsense.arena import UNNAMED, Frame
from vsense.cameras.camera import Camera
from vsense.cameras.grabber import CameraEvent
from vsense.cameras.steadiness import FAR, Steadiness

_STEP = 16
_FULL_SCALE = 250
"""Grey from which a pixel holds all that it can: noise and a picture's compression cost a few."""

_Gap = tuple[int, NDArray[np.float64]]
"""A tag, and its place in one camera less its place in another [m]."""


@dataclass(frozen=True, slots=True)
class HealthLimits:
    """When something is reported.

    Attributes:
        dark_level: Mean grey below which a picture is dark (12).
        contrast: Standard deviation of grey below which a picture shows nothing (3).
        full_share: Share of a picture at full scale from which it is saturated (0.8). Measured on
            rendered arenas whose exposure rises: on a white floor all markers are read up to 0.74
            and a third lose their names at 0.94, on a grey floor three in four at 0.85. Paper and
            the reflections of lamps stay far below.
        frames: Pictures in a row after which it is reported (3).
        moved_px: Shift of the background that is a moved camera (1.0).
        apart_m: Distance between two cameras' views of the same markers that is too much (0.008).
        apart_views: Common views over which that distance is averaged (60).
        apart_tags: Different markers that must be among them (3): one alone may be there twice,
            or drive while the cameras take their pictures one after the other.
        checks: Cameras looked at for movement in each timestep (2).
    """

    dark_level: float = 12.0
    contrast: float = 3.0
    full_share: float = 0.8
    frames: int = 3
    moved_px: float = 1.0
    apart_m: float = 0.008
    apart_views: int = 60
    apart_tags: int = 3
    checks: int = 2


class _Alarm:
    """Tells when a state has lasted for some pictures, and when it has ended for as many."""

    def __init__(self, frames: int) -> None:
        self._frames = frames
        self._count = 0
        self.on = False

    def update(self, now: bool) -> bool:
        """Takes one picture's state; whether that turned the alarm on or off."""
        self._count = self._count + 1 if now != self.on else 0
        if self._count < self._frames:
            return False
        self.on, self._count = now, 0
        return True


class CameraHealth:
    """Watches one camera, on one thread; the background is that of the first pictures."""

    def __init__(self, camera: Camera, limits: HealthLimits) -> None:
        self._id = camera.id
        self._limits = limits
        self._last: NDArray[np.uint8] | None = None
        self._dark = _Alarm(limits.frames)
        self._saturated = _Alarm(limits.frames)
        self._frozen = _Alarm(limits.frames)
        self._moved = _Alarm(limits.frames)
        self._crowded = _Alarm(limits.frames)
        self._steadiness = Steadiness((camera.width_px, camera.height_px))

    def update(self, image: NDArray[np.uint8]) -> list[CameraEvent]:
        """Looks at a picture (h, w); gives what has begun or ended."""
        sample = image[::_STEP, ::_STEP].copy()
        return self._check_light(sample) + self._check_standstill(sample)

    def _check_light(self, sample: NDArray[np.uint8]) -> list[CameraEvent]:
        """Tells pictures that show nothing, for want of light or for too much of it."""
        full = float((sample >= _FULL_SCALE).mean())
        saturated = full >= self._limits.full_share
        dark = sample.mean() < self._limits.dark_level or sample.std() < self._limits.contrast
        events = []
        if self._dark.update(bool(dark) and not saturated):
            text = f"went dark, or is covered (mean grey {sample.mean():.0f})"
            events.append(self._event(self._dark.on, "dark", text, "light", "sees light again"))
        if self._saturated.update(saturated):
            on = self._saturated.on
            text = f"is overexposed: {100 * full:.0f} % of its picture is at full scale"
            after = "is no longer overexposed"
            events.append(self._event(on, "saturated", text, "exposed", after))
        return events

    def _check_standstill(self, sample: NDArray[np.uint8]) -> list[CameraEvent]:
        """Tells a picture that comes again and again."""
        # A sensor's noise never repeats: the same bytes are the same picture once more. Only
        # where all is black or all is white there is no noise to tell by.
        same = self._last is not None and bool(np.array_equal(sample, self._last))
        self._last = sample
        if not self._frozen.update(same and sample.min() != sample.max()):
            return []
        text = f"froze: the same picture {self._limits.frames + 1} times"
        return [self._event(self._frozen.on, "frozen", text, "running", "runs again")]

    def count(self, overflowed: bool) -> list[CameraEvent]:
        """Takes whether a picture held more than the detector's tables; gives what has changed."""
        if not self._crowded.update(overflowed):
            return []
        text = "shows more dark things than the detector can hold: markers may be missed"
        return [self._event(self._crowded.on, "crowded", text, "clear", "shows less again")]

    def check_place(
        self, image: NDArray[np.uint8], rows: NDArray[np.void] | None = None
    ) -> list[CameraEvent]:
        """Compares a picture's background with the first one's; gives what has begun or ended.

        Args:
            image: (h, w) uint8.
            rows: The picture's DETECTION array: robots are no background.
        """
        if self._dark.on or self._saturated.on:
            return []
        markers_px = None if rows is None else np.stack((rows["x_px"], rows["y_px"]), axis=-1)
        shift_px = self._steadiness.shift_px(image, markers_px)
        if shift_px is None:
            return []
        if not self._moved.update(shift_px > self._limits.moved_px):
            return []
        how = "far" if shift_px == FAR else f"by {shift_px:.1f} px"
        text = f"has moved {how}: its places are wrong until it is calibrated again"
        return [self._event(self._moved.on, "moved", text, "steady", "is back in its place")]

    def _event(self, on: bool, kind: str, text: str, after: str, after_text: str) -> CameraEvent:
        return CameraEvent(self._id, kind if on else after, text if on else after_text)


class Agreement:
    """Compares what two cameras say about the same marker: they differ where one has moved."""

    def __init__(self, cameras: Mapping[str, Camera], limits: HealthLimits) -> None:
        self._cameras = cameras
        self._limits = limits
        self._gaps: dict[tuple[str, str], deque[_Gap]] = {}
        self._alarms: dict[tuple[str, str], _Alarm] = {}

    def compare(
        self, found: Mapping[str, NDArray[np.void]], heights_m: Mapping[int, float]
    ) -> list[CameraEvent]:
        """Compares one timestep's detections; gives what has begun or ended.

        Args:
            found: The DETECTION array of each camera.
            heights_m: The height of each tag's marker above the floor.
        """
        places = {c: self._places(c, rows, heights_m) for c, rows in sorted(found.items())}
        events = []
        ids = list(places)
        for number, first in enumerate(ids):
            for second in ids[number + 1 :]:
                common = places[first].keys() & places[second].keys()
                gaps = [(tag, places[first][tag] - places[second][tag]) for tag in sorted(common)]
                if gaps:
                    events += self._weigh((first, second), gaps)
        return events

    def _weigh(self, pair: tuple[str, str], gaps: Iterable[_Gap]) -> list[CameraEvent]:
        """Averages the gaps of a pair: single markers err, a moved camera errs always."""
        recent = self._gaps.setdefault(pair, deque(maxlen=self._limits.apart_views))
        recent.extend(gaps)
        by_tag: dict[int, list[NDArray[np.float64]]] = {}
        for tag, gap in recent:
            by_tag.setdefault(tag, []).append(gap)
        if len(recent) < self._limits.apart_views or len(by_tag) < self._limits.apart_tags:
            return []
        middles = [np.median(mine, axis=0) for mine in by_tag.values()]
        apart_m = float(np.hypot(*np.median(middles, axis=0)))
        alarm = self._alarms.setdefault(pair, _Alarm(self._limits.frames))
        if not alarm.update(apart_m > self._limits.apart_m):
            return []
        if not alarm.on:
            return [CameraEvent(pair[0], "steady", f"agrees with camera {pair[1]} again")]
        text = f"and camera {pair[1]} disagree by {1e3 * apart_m:.0f} mm: one of them has moved"
        return [CameraEvent(pair[0], "apart", text)]

    def _places(
        self, camera: str, rows: NDArray[np.void], heights_m: Mapping[int, float]
    ) -> dict[int, NDArray[np.float64]]:
        """Where a camera saw each tag that it saw once, in the arena [m]."""
        tags, counts = np.unique(rows["tag"], return_counts=True)
        once = {int(tag) for tag in tags[counts == 1] if tag != UNNAMED and int(tag) in heights_m}
        rows = rows[[int(tag) in once for tag in rows["tag"]]] if len(rows) else rows
        if len(rows) == 0:
            return {}
        heights = np.array([heights_m[int(tag)] for tag in rows["tag"]])
        pixels = np.stack((rows["x_px"], rows["y_px"]), axis=-1)
        ground = self._cameras[camera].to_plane(pixels, heights)
        return {int(tag): place for tag, place in zip(rows["tag"], ground)}


class Health:
    """Watches all cameras of an arena."""

    def __init__(
        self,
        cameras: Sequence[Camera],
        heights_m: Mapping[int, float],
        limits: HealthLimits | None = None,
    ) -> None:
        self._limits = limits or HealthLimits()
        self._heights_m = heights_m
        self._cameras = {c.id: CameraHealth(c, self._limits) for c in cameras}
        self._agreement = Agreement({c.id: c for c in cameras}, self._limits)
        self._turn = 0

    def update(
        self,
        frames: Sequence[Frame],
        found: Mapping[str, NDArray[np.void]],
        overflowed: Sequence[str] = (),
        together: Mapping[str, NDArray[np.void]] | None = None,
    ) -> list[CameraEvent]:
        """Looks at one picture of some cameras.

        Args:
            frames: The pictures.
            found: The DETECTION array of each picture, by its camera.
            overflowed: The cameras whose pictures held more than the detector's tables.
            together: The DETECTION arrays of one timestep, for the cameras' agreement; None:
                `found` is of one timestep.

        Returns:
            What has begun or ended.
        """
        events: list[CameraEvent] = []
        for frame in frames:
            camera = self._cameras[frame.camera]
            events += camera.update(frame.image) + camera.count(frame.camera in overflowed)
        for _ in range(min(self._limits.checks, len(frames))):
            frame = frames[self._turn % len(frames)]
            self._turn += 1
            rows = found.get(frame.camera)
            events += self._cameras[frame.camera].check_place(frame.image, rows)
        seen = found if together is None else together
        return events + self._agreement.compare(seen, self._heights_m)
