"""The arena tracker: all cameras' pictures of a timestep in, one arena state out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import POSE, SIGHTING, ArenaState, Frame
from vsense.base.errors import VsenseError
from vsense.vision.cameras._camera_array import CameraArray
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import MarkerFamily, SquareFamily
from vsense.vision.tracking._detector import CameraDetectors, Detector, DetectorMaker
from vsense.vision.tracking._joining import Joining, JoinLimits
from vsense.vision.tracking._prediction import MarkerSearch, Prediction, SearchPlan
from vsense.vision.tracking._tracks import Limits, RobotTracks
from vsense.vision.tracking._views import (
    MarkerOffsets,
    count_unnamed,
    image_poses,
    make_views,
    merge_views,
    place_markers,
)
from vsense.vision.tracking._workers import Picture, Workers
from vsense.vision.tracking.specs import PlacedMarker


@dataclass(slots=True)
class TrackerCounters:
    """What the tracker has noticed since it began.

    Attributes:
        old_frames: Frames dropped because they were not newer than the newest timestep already
            done, or beaten by a newer one in the same call.
        repeated_frames: Second and further frames of one camera in one timestep, dropped.
        untimely_frames: Frames dated `APART_NS` and more beside most of their timestep, dropped.
        out_of_reach: Sightings at places where their robot cannot have come.
        duplicates: Tags seen at two places at once, counted each timestep.
        overflows: Pictures with more in them than a detector's tables hold.
    """

    old_frames: int = 0
    repeated_frames: int = 0
    untimely_frames: int = 0
    out_of_reach: int = 0
    duplicates: int = 0
    overflows: int = 0

    def add(self, other: TrackerCounters) -> None:
        """Adds what another tracker has noticed."""
        for counter in fields(self):
            total = getattr(self, counter.name) + getattr(other, counter.name)
            setattr(self, counter.name, total)

    def notes(self) -> list[str]:
        """Returns a line for everything that is not zero."""
        facts = (
            (self.old_frames, "pictures older than the newest were dropped"),
            (self.repeated_frames, "pictures of a camera that had delivered already were dropped"),
            (self.untimely_frames, "pictures dated far beside the others' were dropped"),
            (self.overflows, "pictures held more than the detector's tables"),
            (self.out_of_reach, "sightings were out of their robot's reach"),
            (self.duplicates, "times a tag was at two places at once"),
        )
        return [f"{count} {what}" for count, what in facts if count]


class TrackingError(VsenseError):
    """Cameras and pictures that do not belong together."""


APART_NS = 5_000_000_000
"""Pictures of one timestep are never taken so far apart: one of the clocks is wrong."""
_ALONE = 10
"""Timesteps without any other camera after which one that was left out is believed."""


class FrameGate:
    """Passes on one timestep's pictures, whatever the order they came in.

    Attributes:
        cameras: The arena's cameras by their ids, sorted.
        counters: The tracker's; dropped frames are counted here.
        untimely_ns: By camera, how far beside the others the newest timestep's frame was dated,
            where it was dropped for that.
    """

    def __init__(self, cameras: Sequence[Camera]) -> None:
        self.cameras = {camera.id: camera for camera in sorted(cameras, key=lambda c: c.id)}
        if not cameras or len(self.cameras) != len(cameras):
            raise TrackingError("the arena needs cameras, each with an id of its own")
        self.counters = TrackerCounters()
        self.untimely_ns: dict[str, int] = {}
        self._newest, self._capture_ns, self._alone = -1, 0, 0

    def choose(self, frames: Sequence[Frame]) -> list[Frame]:
        """Returns the newest timestep's frames, one per camera, sorted; none if already done.

        Raises:
            TrackingError: A frame is of an unknown camera, or not of that camera's size.
        """
        for frame in frames:
            self._check(frame)
        newest = max((frame.timestep for frame in frames), default=-1)
        if newest <= self._newest:
            self.counters.old_frames += len(frames)
            return []
        self._newest = newest
        now = [frame for frame in frames if frame.timestep == newest]
        self.counters.old_frames += len(frames) - len(now)
        now.sort(key=lambda frame: (frame.capture_ns, frame.ready_ns))
        single = {frame.camera: frame for frame in now}
        self.counters.repeated_frames += len(now) - len(single)
        return self._timely([single[camera] for camera in sorted(single)])

    def _timely(self, frames: list[Frame]) -> list[Frame]:
        """Leaves out frames of wrong clocks: dated beside most, or, of two, beside those before."""
        stamps = [frame.capture_ns for frame in frames]
        is_right = any(frame.camera not in self.untimely_ns for frame in frames)
        self._alone = 0 if is_right else self._alone + 1
        if 0 < self._alone < _ALONE:
            self.counters.untimely_frames += len(frames)
            return []

        def rank(stamp_ns: int) -> tuple[int, int]:
            near = sum(abs(other - stamp_ns) < APART_NS for other in stamps)
            return near, -abs(stamp_ns - (self._capture_ns or min(stamps)))

        middle_ns = self._capture_ns = max(stamps, key=rank)
        off = {frame.camera: frame.capture_ns - middle_ns for frame in frames}
        self.untimely_ns = {c: off_ns for c, off_ns in off.items() if abs(off_ns) >= APART_NS}
        self.counters.untimely_frames += len(self.untimely_ns)
        return [frame for frame in frames if frame.camera not in self.untimely_ns]

    def _check(self, frame: Frame) -> None:
        camera = self.cameras.get(frame.camera)
        if camera is None:
            ids = ", ".join(self.cameras)
            raise TrackingError(f"a frame of camera {frame.camera!r}; known are {ids}")
        if frame.image.shape != (camera.height_px, camera.width_px):
            height, width = frame.image.shape[:2]
            raise TrackingError(
                f"a frame of camera {camera.id} is {width} x {height} px, "
                f"not {camera.width_px} x {camera.height_px}"
            )


class ArenaTracker:
    """Finds and follows every robot of the roster; to be called from one thread.

    The pictures of a timestep are shared out to worker threads; neither their order nor the
    threads' speed changes the result. A robot that is not on the roster joins it when its tag has
    been read beyond doubt for long enough, see `joining`.

    Attributes:
        heights_m: The roster: the height of each tag's marker above the floor. It grows.
        offsets: By tag, where markers sit on their robots; those of other tags sit in the middle.
        markers: By the camera's id, the DETECTION array of its newest picture.
        overflowed: Ids of the cameras whose newest picture held more than the detector's tables.
        untimely_ns: See `FrameGate`.
        state: The newest arena state; its timestep is -1 before the first.
    """

    def __init__(
        self,
        cameras: Sequence[Camera],
        detector: Detector,
        heights_m: Mapping[int, float],
        limits: Limits | None = None,
        prediction: Prediction | None = None,
        workers: Workers | None = None,
        offsets: Mapping[int, PlacedMarker] | None = None,
    ) -> None:
        """Switches OpenCV's own threads off, for the whole process.

        Args:
            heights_m: The roster.
            prediction: The detector's; gets the expected poses before each timestep.
            workers: The detector's, to be ended with the tracker.
            offsets: By tag, where markers sit on their robots.

        Raises:
            TrackingError: There is no camera, two have the same id, or one is no higher than a
                marker.
        """
        self.markers: dict[str, NDArray[np.void]] = {}
        self.overflowed: tuple[str, ...] = ()
        self._gate = FrameGate(cameras)
        self.heights_m, self.offsets = dict(heights_m), dict(offsets or {})
        self._offsets = MarkerOffsets(self.offsets)
        self._check_heights()
        self._limits, self._prediction = limits or Limits(), prediction or Prediction()
        self._prediction.heights_m = self.heights_m
        self._detector, self._workers = detector, workers or Workers()
        self._joining = Joining(JoinLimits(max_speed_m_s=self._limits.max_speed_m_s))
        self._joined = set[int]()
        self._unlearned: NDArray[np.void] | None = None
        self._array = CameraArray(self.cameras)
        self._places = {camera.id: place for place, camera in enumerate(self.cameras)}
        self._tracks = RobotTracks(self._limits)
        self.state = ArenaState(-1, 0, np.zeros(0, dtype=POSE), 0)
        self.counters = self._gate.counters
        cv2.setNumThreads(1)

    @classmethod
    def for_family(
        cls,
        cameras: Sequence[Camera],
        family: MarkerFamily | SquareFamily,
        heights_m: Mapping[int, float],
        limits: Limits | None = None,
        plan: SearchPlan | None = None,
        open_roster: bool = True,
        offsets: Mapping[int, PlacedMarker] | None = None,
    ) -> ArenaTracker:
        """Returns a tracker of one family's markers; `heights_m` is also the roster."""
        search = MarkerSearch(family, dict(heights_m), open_roster)
        return cls.of_searches(cameras, [search] * len(cameras), limits, plan, offsets=offsets)

    @classmethod
    def of_searches(
        cls,
        cameras: Sequence[Camera],
        searches: Sequence[MarkerSearch],
        limits: Limits | None = None,
        plan: SearchPlan | None = None,
        workers: int = 2,
        pin: bool = False,
        offsets: Mapping[int, PlacedMarker] | None = None,
        elsewhere: DetectorMaker | None = None,
    ) -> ArenaTracker:
        """Returns a tracker; `searches` says for each of `cameras` what is looked for.

        Args:
            workers: Threads that search the pictures.
            pin: Keep each on a processor of its own, for a host that does nothing else.
            offsets: By tag, where markers sit on their robots.
            elsewhere: Makes the detector of cameras whose pictures are on other computers.

        Raises:
            FamilyError: A family does not have a tag of its roster.
            TrackingError: No cameras, or two with one id.
        """
        sees = {camera.id: search for camera, search in zip(cameras, searches, strict=True)}
        prediction = Prediction(plan or SearchPlan())
        threads = Workers(max(1, workers), pin)
        others = {} if elsewhere is None else elsewhere.detectors(prediction)
        detector = CameraDetectors(sees, prediction, threads, others)
        heights_m = {tag: height for search in searches for tag, height in search.heights_m.items()}
        return cls(cameras, detector, heights_m, limits, prediction, threads, offsets)

    def close(self) -> None:
        """Ends the workers; can be called again."""
        self._workers.close()

    @property
    def untimely_ns(self) -> Mapping[str, int]:
        return self._gate.untimely_ns

    @property
    def cameras(self) -> list[Camera]:
        """The arena's cameras, sorted by their ids."""
        return list(self._gate.cameras.values())

    def update(self, frames: Sequence[Frame]) -> ArenaState:
        """Takes the pictures of a timestep, in any order; some may be missing.

        Returns:
            The new arena state, or the last one where no frame was newer than the newest timestep.

        Raises:
            TrackingError: A frame is of an unknown camera, or not of that camera's size.
        """
        self.learn()
        if not (fresh := self._gate.choose(frames)):
            return self.state
        now_ns = max(frame.capture_ns for frame in fresh)
        self._prediction.expect(now_ns, [frame.camera for frame in fresh])
        detections = self._detect(fresh)
        taken_by = [self._places[frame.camera] for frame in fresh]
        placed = place_markers(self._array, taken_by, detections, self.heights_m)
        capture_ns = [frame.capture_ns for frame in fresh]
        views = make_views(self._array, capture_ns, placed, self._limits.height_doubt_m)
        sightings = merge_views(views, placed.picture)
        self.counters.out_of_reach += self._tracks.update(self._offsets.to_robots(sightings))
        self._tracks.forget(now_ns)
        again = sightings["tag"][1:][sightings["tag"][1:] == sightings["tag"][:-1]]
        self.state = ArenaState(
            timestep=fresh[0].timestep,
            capture_ns=now_ns,
            robots=self._tracks.poses(now_ns),
            detected=len(sightings) - len(again),
            unnamed=count_unnamed(detections),
            duplicates=tuple(sorted(set(again.tolist()))),
            sightings=_sighting_rows(sightings),
            joined=tuple(sorted(self._joined)),
            cameras=tuple(frame.camera for frame in fresh),
            images=image_poses(self._array, placed),
        )
        self.counters.duplicates += len(self.state.duplicates)
        self._unlearned = sightings
        return self.state

    def learn(self) -> None:
        """Takes what the last timestep has shown for the next one, and lets nodes know.

        `update` begins with it. Who calls it before has the next timestep's state sooner.
        """
        sightings, self._unlearned = self._unlearned, None
        if sightings is None:
            return
        markers = self._offsets.to_markers(self.state.robots)
        self._prediction.learn(replace(self.state, robots=markers))
        self._admit(self.state.capture_ns, sightings)
        self._prediction.learned()

    def _admit(self, now_ns: int, sightings: NDArray[np.void]) -> None:
        """Lets robots join the roster, from the next timestep on."""
        joined = self._prediction.joined
        unlisted = self._prediction.unlisted
        for new in self._joining.update(now_ns, unlisted, sightings, self.heights_m):
            self.heights_m[new.tag] = new.height_m
            joined[new.family] = (*joined.get(new.family, ()), new.tag)
            self._joined.add(new.tag)

    def _check_heights(self) -> None:
        height_m, tag = max(
            ((height, tag) for tag, height in self.heights_m.items()), default=(0, 0)
        )
        for camera in self._gate.cameras.values():
            if camera.position_m[2] <= height_m:
                raise TrackingError(
                    f"camera {camera.id} hangs {camera.position_m[2]:g} m above the floor,"
                    f" expected more than the {height_m:g} m of tag {tag}'s marker"
                )

    def _detect(self, frames: list[Frame]) -> list[NDArray[np.void]]:
        """Returns each frame's DETECTION array; sets `markers` and `overflowed`."""
        cameras = self._gate.cameras
        pictures = self._detector.detect_all(
            [Picture(f.image, cameras[f.camera], f.place, f.found) for f in frames]
        )
        self.markers = {frame.camera: seen.rows for frame, seen in zip(frames, pictures)}
        self.overflowed = tuple(f.camera for f, seen in zip(frames, pictures) if seen.full)
        self.counters.overflows += len(self.overflowed)
        return [seen.rows for seen in pictures]


def _sighting_rows(sightings: NDArray[np.void]) -> NDArray[np.void]:
    rows = np.zeros(len(sightings), dtype=SIGHTING)
    for name in SIGHTING.names or ():
        rows[name] = sightings[name]
    return rows
