"""Camera health: dark, saturated, frozen, moved, crowded, late, or contradicting neighbours.

Light and standstill are checked in every picture, movement in a few cameras per timestep in turns,
so that the cost does not grow with the cameras. Begin and end are reported once each.

Corners of the floor are chosen in a first picture, away from the robots. Later the small patches
around them are compared, laid side by side in one picture and with the light normalised. Some get
covered; most of them decide.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import chain, combinations, compress
from math import hypot
from statistics import median

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import UNNAMED, Floats, Frame
from vsense.vision.cameras._camera_array import CameraArray
from vsense.vision.cameras._lateness import CameraDelays
from vsense.vision.cameras.camera import Camera
from vsense.vision.cameras.grabber import CameraEvent

_STEP = 16
_FULL_SCALE = 250
"""Grey from which a pixel is at full scale: noise and compression take a few levels."""

_Gap = tuple[int, float, float]
"""A tag, and its place by one camera minus its place by another [m]."""


DARK_LEVEL = 12.0
"""Mean grey below which a picture is dark."""
CONTRAST = 3.0
"""Standard deviation of grey below which a picture shows nothing."""
FULL_SHARE = 0.8
"""Share of a picture at full scale from which it is saturated. Measured on rendered arenas whose
exposure rises: on a white floor all markers are read up to 0.9 and one in six loses its name at
0.95, on a grey floor two in five do at 0.85. Paper and reflections of lamps stay far below."""
REPORT_PICTURES = 3
"""Pictures in a row after which something is reported."""
MOVED_PX = 1.0
"""Shift of the background from which a camera has moved."""
APART_M = 0.008
"""Distance between two cameras' views of the same markers from which one camera has moved."""
APART_VIEWS = 60
"""Common views over which that distance is averaged."""
APART_TAGS = 3
"""Different markers that must be among them: a single one may be there twice, or drive while the
cameras take their pictures one after the other."""
CHECKS = 2
"""Cameras whose background is compared in each timestep."""


class _Alarm:
    """Reports a state of a camera after `REPORT_PICTURES` pictures, and its end after as many."""

    def __init__(self, camera: str, kind: str, end: str, end_text: str) -> None:
        self._camera = camera
        self._kind = kind
        self._end = end, end_text
        self._count = 0
        self.on = False

    def update(self, now: bool, text: str) -> list[CameraEvent]:
        """Takes one picture's state, and the text for the case that it begins."""
        self._count = self._count + 1 if now != self.on else 0
        if self._count < REPORT_PICTURES:
            return []
        self.on, self._count = now, 0
        kind, text = (self._kind, text) if now else self._end
        return [CameraEvent(self._camera, kind, text)]


class CameraHealth:
    """Watches one camera, on one thread; the reference background is the first picture's."""

    def __init__(self, camera: Camera) -> None:
        self._last: NDArray[np.uint8] | None = None
        self._dark = _Alarm(camera.id, "dark", "light", "sees light again")
        self._saturated = _Alarm(camera.id, "saturated", "exposed", "is no longer overexposed")
        self._frozen = _Alarm(camera.id, "frozen", "running", "runs again")
        self._moved = _Alarm(camera.id, "moved", "steady", "is back in its place")
        self._crowded = _Alarm(camera.id, "crowded", "clear", "shows less again")
        self._untimely = _Alarm(camera.id, "untimely", "dated", "has the other cameras' time again")
        self._steadiness = Steadiness((camera.width_px, camera.height_px))

    def update(self, image: NDArray[np.uint8]) -> list[CameraEvent]:
        """Looks at a picture (h, w); returns what has begun or ended."""
        sample = image[::_STEP, ::_STEP].copy()
        return self._check_light(sample) + self._check_standstill(sample)

    def _check_light(self, sample: NDArray[np.uint8]) -> list[CameraEvent]:
        """Reports pictures that show nothing, with too little light or too much."""
        full = float((sample >= _FULL_SCALE).mean())
        saturated = full >= FULL_SHARE
        dark = sample.mean() < DARK_LEVEL or sample.std() < CONTRAST
        text = f"went dark, or is covered (mean grey {sample.mean():.0f})"
        events = self._dark.update(bool(dark) and not saturated, text)
        text = f"is overexposed: {100 * full:.0f} % of its picture is at full scale"
        return events + self._saturated.update(saturated, text)

    def _check_standstill(self, sample: NDArray[np.uint8]) -> list[CameraEvent]:
        """Reports a picture that comes again and again."""
        # A sensor's noise never repeats, so the same bytes are the same picture. A picture that
        # is all black or all white has no noise.
        same = self._last is not None and bool(np.array_equal(sample, self._last))
        self._last = sample
        text = f"froze: the same picture {REPORT_PICTURES + 1} times"
        return self._frozen.update(same and bool(sample.min() != sample.max()), text)

    def count(self, overflowed: bool) -> list[CameraEvent]:
        """Takes whether a picture held more than the detector's tables; returns changes."""
        text = "shows more dark things than the detector can hold: markers may be missed"
        return self._crowded.update(overflowed, text)

    def date(self, off_ns: int) -> list[CameraEvent]:
        """Takes how far beside the others' a picture's time was, which was left out for it."""
        how = f"{abs(off_ns) / 1e9:.2f} s {'ahead of' if off_ns > 0 else 'behind'}"
        text = f"its clock is {how} the other cameras': its pictures are left out"
        return self._untimely.update(off_ns != 0, text)

    def check_place(
        self, image: NDArray[np.uint8], rows: NDArray[np.void] | None = None
    ) -> list[CameraEvent]:
        """Compares a picture's background with the first one's; returns what has begun or ended.

        `rows` is the DETECTION array of the (h, w) picture: robots are not background.
        """
        if self._dark.on or self._saturated.on:
            return []
        markers_px = None if rows is None else np.stack((rows["x_px"], rows["y_px"]), axis=-1)
        shift_px = self._steadiness.shift_px(image, markers_px)
        if shift_px is None:
            return []
        how = "far" if shift_px == LOST_SHIFT_PX else f"by {shift_px:.1f} px"
        text = f"has moved {how}: its places are wrong until it is calibrated again"
        return self._moved.update(shift_px > MOVED_PX, text)


class Agreement:
    """Compares two cameras' places of the same markers, which differ where one has moved."""

    def __init__(self, delays: CameraDelays | None = None) -> None:
        """`delays` knows what is no disagreement: robots have driven on meanwhile."""
        self._delays = delays or CameraDelays()
        self._gaps: dict[tuple[str, str], deque[_Gap]] = {}
        self._alarms: dict[tuple[str, str], _Alarm] = {}

    def compare(self, places: Mapping[str, MarkerPlaces]) -> list[CameraEvent]:
        """Compares what cameras show in one timestep; returns what has begun or ended."""
        events = []
        for first, second in combinations(sorted(places), 2):
            common = places[first].keys() & places[second].keys()
            here, there = places[first], places[second]
            gaps = [
                (tag, here[tag][0] - there[tag][0], here[tag][1] - there[tag][1])
                for tag in sorted(common)
            ]
            if gaps:
                events += self._weigh((first, second), gaps)
        return events

    def _weigh(self, pair: tuple[str, str], gaps: Iterable[_Gap]) -> list[CameraEvent]:
        """Averages the gaps of a pair: a moved camera errs always, a marker only sometimes."""
        recent = self._gaps.setdefault(pair, deque(maxlen=APART_VIEWS))
        recent.extend(gaps)
        by_tag: dict[int, list[tuple[float, float]]] = {}
        for tag, x_m, y_m in recent:
            by_tag.setdefault(tag, []).append((x_m, y_m))
        if len(recent) < APART_VIEWS or len(by_tag) < APART_TAGS:
            return []
        # So few numbers are sorted sooner than an array of them is made.
        middles = [tuple(map(median, zip(*mine))) for mine in by_tag.values()]
        apart_m = hypot(*map(median, zip(*middles)))
        lag = self._delays.lag(*pair)
        if lag.is_open and apart_m > APART_M:
            return []
        apart_m = lag.apart_m if lag.is_lag else apart_m
        if pair not in self._alarms:
            end_text = f"agrees with camera {pair[1]} again"
            self._alarms[pair] = _Alarm(pair[0], "apart", "steady", end_text)
        text = f"and camera {pair[1]} disagree by {1e3 * apart_m:.0f} mm: one of them has moved"
        return self._alarms[pair].update(apart_m > APART_M, text)


MarkerPlaces = dict[int, list[float]]
"""Where a picture shows each tag that it shows once: x and y in the arena [m]."""


def marker_places(
    cameras: CameraArray, pictures: Mapping[str, NDArray[np.void]], heights_m: Mapping[int, float]
) -> dict[str, MarkerPlaces]:
    """Returns by camera where a DETECTION array of its shows each tag that it shows once."""
    once, tags = {}, {}
    for camera, rows in pictures.items():
        counts = Counter(all_tags := rows["tag"].tolist())
        known = [tag != UNNAMED and counts[tag] == 1 and tag in heights_m for tag in all_tags]
        once[camera], tags[camera] = rows[known], list(compress(all_tags, known))
    heights = [heights_m[tag] for tag in chain.from_iterable(tags.values())]
    places = iter(cameras.places(once, heights).tolist())
    # The tags are first: where they end no place is taken.
    return {camera: dict(zip(mine, places)) for camera, mine in tags.items()}


class Health:
    """Watches all cameras of an arena."""

    def __init__(
        self,
        cameras: Sequence[Camera],
        heights_m: Mapping[int, float],
        elsewhere: Collection[str] = (),
    ) -> None:
        """Watches cameras; at pictures of those `elsewhere` another computer looks."""
        self._heights_m = heights_m
        self._elsewhere = elsewhere
        self._rig = CameraArray(cameras)
        self._cameras = {c.id: CameraHealth(c) for c in cameras}
        self._delays = CameraDelays()
        self._agreement = Agreement(self._delays)
        self._turn = 0

    def update(
        self,
        frames: Sequence[Frame],
        detections: Mapping[str, NDArray[np.void]],
        overflowed: Sequence[str] = (),
        together: Mapping[str, NDArray[np.void]] | None = None,
        off_ns: Mapping[str, int] | None = None,
    ) -> list[CameraEvent]:
        """Checks one picture of some cameras; returns what has begun or ended.

        Args:
            frames: The pictures.
            detections: The DETECTION array of each picture, by its camera.
            overflowed: The cameras whose pictures held more than the detector's tables.
            together: The DETECTION arrays of one timestep, for the cameras' agreement; None:
                `detections` is of one timestep.
            off_ns: How far beside the others' a camera's picture was dated, which was left out.
        """
        events: list[CameraEvent] = []
        for frame in frames:
            camera = self._cameras[frame.camera]
            if frame.camera not in self._elsewhere:
                events += camera.update(frame.image)
            events += camera.count(frame.camera in overflowed)
            events += camera.date((off_ns or {}).get(frame.camera, 0))
        here = [frame for frame in frames if frame.camera not in self._elsewhere]
        for _ in range(min(CHECKS, len(here))):
            frame = here[self._turn % len(here)]
            self._turn += 1
            rows = detections.get(frame.camera)
            events += self._cameras[frame.camera].check_place(frame.image, rows)
        places = marker_places(self._rig, detections, self._heights_m)
        events += self._check_times(frames, places)
        together = detections if together is None else together
        # Mostly all pictures of a timestep are checked at once: their places are known.
        others = {c: rows for c, rows in together.items() if rows is not detections.get(c)}
        known = {c: places[c] for c in together if c not in others}
        seen = known | marker_places(self._rig, others, self._heights_m)
        return events + self._agreement.compare(seen)

    def _check_times(
        self, frames: Sequence[Frame], places: Mapping[str, MarkerPlaces]
    ) -> list[CameraEvent]:
        """Reports cameras whose pictures are older than their stamps."""
        timely = [frame for frame in frames if frame.camera in places]
        for frame in timely:
            self._delays.see(frame.camera, frame.capture_ns, places[frame.camera])
        now_ns = max((frame.capture_ns for frame in timely), default=0)
        return [_timed(*change) for change in self._delays.compare(now_ns)]


def _timed(camera: str, late_s: float | None) -> CameraEvent:
    """Tells that a camera has begun to be late, or no longer is."""
    if late_s is None:
        return CameraEvent(camera, "timely", "is no longer late")
    text = f"is late by about {1e2 * late_s:.0f}0 ms: its pictures are older than their stamps say"
    return CameraEvent(camera, "late", f"{text}, and what drives is not where it shows it")


LOST_SHIFT_PX = float("inf")
"""The shift of a camera whose background is not found any more."""


_WIDTH_PX = 400
_PATCHES = 32
_COLUMNS = 8
_LEAST_PATCHES = 10
_HALF_PX = 24
_ROBOT_PX = 60
_QUALITY = 0.02
_BLUR_PX = 1.6
_GAIN = 40.0
_LEAST_DEVIATION = 3.0
_WINDOW = 31
_LEVELS = 2
_AGREE_PX = 0.6
_LEAST_SHARE = 0.35
_WORN_SHARE = 0.6
_WORN_PX = 0.5


class Steadiness:
    """The background of one camera; the first picture is the reference."""

    def __init__(self, size_px: tuple[int, int]) -> None:
        """Takes width and height of the camera's pictures."""
        self._size_px = size_px
        self._places: NDArray[np.int64] = np.zeros((0, 2), dtype=np.int64)
        self._reference = np.zeros((0, 0), dtype=np.uint8)
        self._origin = np.zeros(2)

    def shift_px(self, image: NDArray[np.uint8], markers_px: Floats | None = None) -> float | None:
        """Returns the shift of an (h, w) uint8 picture's background since the first picture.

        `markers_px` (n, 2) are places of robots, which are not background. The shift is that of
        most patches; `LOST_SHIFT_PX`: they disagree; None: unknown.
        """
        if len(self._places) < _LEAST_PATCHES:
            self._learn(image, markers_px)
            return None
        ways, matched = self._ways(self._mosaic(image))
        middle = np.median(ways[matched], axis=0) if matched.any() else np.zeros(2)
        agree = matched & (np.hypot(*(ways - middle).T) < _AGREE_PX)
        if agree.mean() < _LEAST_SHARE:
            return LOST_SHIFT_PX
        way = np.median(ways[agree], axis=0)
        shift = self._origin + way
        if agree.mean() < _WORN_SHARE and np.hypot(*way) < _WORN_PX:
            # The floor has changed in places, or robots stand on it: new patches.
            self._origin = shift
            self._learn(image, markers_px)
        return float(np.hypot(*shift))

    def _learn(self, image: NDArray[np.uint8], markers_px: Floats | None) -> None:
        """Chooses corners of the background and keeps their patches."""
        reduction = max(1, round(self._size_px[0] / _WIDTH_PX))
        width, height = (side // reduction for side in self._size_px)
        part = image[: height * reduction, : width * reduction]
        small = cv2.resize(part, (width, height), interpolation=cv2.INTER_AREA)
        border = -(-_HALF_PX // reduction) + 1
        usable = np.zeros_like(small)
        usable[border:-border, border:-border] = 255
        for marker in [] if markers_px is None else markers_px:
            middle = np.rint(marker / reduction).astype(int).tolist()
            cv2.circle(usable, middle, _ROBOT_PX // reduction, 0, -1)
        apart = max(4.0, min(width, height) / 20)
        points = cv2.goodFeaturesToTrack(small, _PATCHES, _QUALITY, apart, mask=usable)
        if points is None or len(points) < _LEAST_PATCHES:
            return
        places = (points[:, 0] + 0.5) * reduction - 0.5
        self._places = np.rint(places).astype(np.int64)
        self._reference = self._mosaic(image)

    def _mosaic(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Lays the patches side by side, each with its light normalised."""
        side = 2 * _HALF_PX
        tiles = np.full((-(-len(self._places) // _COLUMNS) * _COLUMNS, side, side), 128.0, "f4")
        patches = tiles[: len(self._places)]
        for patch, (left, top) in zip(patches, (self._places - _HALF_PX).tolist()):
            patch[:] = image[top : top + side, left : left + side]
        patches -= patches.mean(axis=(1, 2), keepdims=True)
        deviation = np.sqrt((patches * patches).mean(axis=(1, 2), keepdims=True))
        patches *= _GAIN / np.maximum(deviation, _LEAST_DEVIATION)
        patches += 128.0
        np.clip(patches, 0.0, 255.0, out=patches)
        lines = tiles.reshape(-1, _COLUMNS, side, side).swapaxes(1, 2)
        mosaic = lines.reshape(-1, _COLUMNS * side).astype(np.uint8)
        return np.asarray(cv2.GaussianBlur(mosaic, (0, 0), _BLUR_PX), dtype=np.uint8)

    def _ways(self, mosaic: NDArray[np.uint8]) -> tuple[Floats, NDArray[np.bool_]]:
        """Returns each patch's shift, (n, 2) px, and whether it was found."""
        number = np.arange(len(self._places))
        middles = np.stack((number % _COLUMNS, number // _COLUMNS), axis=-1) * 2 * _HALF_PX
        start = (middles + _HALF_PX).astype(np.float32)[:, np.newaxis]
        end, status, _ = cv2.calcOpticalFlowPyrLK(
            self._reference,
            mosaic,
            start,
            start.copy(),
            winSize=(_WINDOW, _WINDOW),
            maxLevel=_LEVELS,
        )
        ways = (end - start)[:, 0].astype(np.float64)
        inside = np.abs(ways).max(axis=1) < _HALF_PX - 4
        return ways, (status.ravel() > 0) & inside
