"""The arena tracker: all cameras' pictures of a timestep in, one arena state out."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import count
from statistics import median

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.arena import POSE, SIGHTING, ArenaState, Frame
from vsense.errors import VsenseError
from vsense.tracking.camera import Camera
from vsense.tracking.detector import Detector
from vsense.tracking.detectors import make_detector
from vsense.tracking.families import MarkerFamily, SquareFamily
from vsense.tracking.tracks import Limits, Track
from vsense.tracking.views import Sighting, count_unnamed, merge_views, place_views
from vsense.tracking.whereabouts import SearchPlan, Whereabouts


class TrackingError(VsenseError):
    """Cameras and pictures that do not belong together."""


@dataclass(slots=True)
class TrackerCounters:
    """What the tracker has dropped since it began.

    Attributes:
        old_frames: Frames not newer than the newest timestep already done, or beaten by a
            newer one in the same call.
        repeated_frames: Second and further frames of one camera in one timestep.
        out_of_reach: Sightings at places where their robot cannot have come.
        duplicates: Tags seen at two places at once, counted each timestep.
    """

    old_frames: int = 0
    repeated_frames: int = 0
    out_of_reach: int = 0
    duplicates: int = 0


class ArenaTracker:
    """Finds and follows every robot of the roster; to be called from one thread.

    The pictures of a timestep are shared out to worker threads. Neither their order nor the
    threads' speed changes the result.
    """

    def __init__(
        self,
        cameras: Sequence[Camera],
        make_detector: Callable[[], Detector],
        heights_m: Mapping[int, float],
        limits: Limits | None = None,
        workers: int = 2,
        pin: bool = False,
        whereabouts: Whereabouts | None = None,
    ) -> None:
        """Starts the workers; OpenCV's own threads are switched off for the whole process.

        Args:
            cameras: The arena's cameras.
            make_detector: Makes one detector per worker.
            heights_m: The roster: the height of each tag's marker above the floor.
            limits: What tracks believe.
            workers: Threads that look at pictures.
            pin: Keep each worker on a processor of its own, for a host that does nothing else.
            whereabouts: Told before each timestep where the robots should be; the detectors'.

        Raises:
            TrackingError: There is no camera, or two have the same id.
        """
        self._cameras = {camera.id: camera for camera in cameras}
        if not cameras or len(self._cameras) != len(cameras):
            raise TrackingError("the arena needs cameras, each with an id of its own")
        self._heights_m = dict(heights_m)
        self._limits = limits or Limits()
        self._detectors = [make_detector() for _ in range(max(1, workers))]
        self._whereabouts = whereabouts or Whereabouts()
        self._tracks: dict[int, Track] = {}
        self._state = ArenaState(-1, 0, np.zeros(0, dtype=POSE), 0)
        self.counters = TrackerCounters()
        cv2.setNumThreads(1)
        turns = count()
        self._pool = ThreadPoolExecutor(
            len(self._detectors), "tracking", (lambda: _pin(next(turns))) if pin else None
        )

    @classmethod
    def for_family(
        cls,
        cameras: Sequence[Camera],
        family: MarkerFamily | SquareFamily,
        heights_m: Mapping[int, float],
        limits: Limits | None = None,
        plan: SearchPlan | None = None,
    ) -> ArenaTracker:
        """Returns a tracker of one family's markers; `heights_m` is also the roster."""
        height_m = median(heights_m.values()) if heights_m else 0.0
        roster = sorted(heights_m)
        whereabouts = Whereabouts(plan or SearchPlan())
        make = lambda: make_detector(family, roster, height_m, whereabouts)  # noqa: E731
        return cls(cameras, make, heights_m, limits, whereabouts=whereabouts)

    def close(self) -> None:
        """Ends the workers; can be called again."""
        self._pool.shutdown()

    @property
    def state(self) -> ArenaState:
        """The newest arena state; its timestep is -1 before the first."""
        return self._state

    def update(self, frames: Sequence[Frame]) -> ArenaState:
        """Takes the pictures of a timestep, in any order; some may be missing.

        Frames of an older timestep than the newest, here or in an earlier call, are dropped
        and counted.

        Returns:
            The new arena state, or the last one where no frame was new.

        Raises:
            TrackingError: A frame is of an unknown camera, or not of that camera's size.
        """
        fresh = self._fresh(frames)
        if not fresh:
            return self._state
        now_ns = max(frame.capture_ns for frame in fresh)
        self._whereabouts.expect(now_ns)
        found = self._detect(fresh)
        sightings = self._take(fresh, found)
        self._forget(now_ns)
        duplicates = tuple(tag for tag, places in sightings.items() if len(places) > 1)
        self.counters.duplicates += len(duplicates)
        self._state = ArenaState(
            timestep=fresh[0].timestep,
            capture_ns=now_ns,
            robots=self._poses(now_ns),
            detected=len(sightings),
            unnamed=count_unnamed(found),
            duplicates=duplicates,
            sightings=np.array(
                [(s.tag, s.x_m, s.y_m, s.yaw_rad) for places in sightings.values() for s in places],
                dtype=SIGHTING,
            ),
        )
        self._whereabouts.learn(self._state)
        return self._state

    def _take(
        self, frames: list[Frame], found: list[NDArray[np.void]]
    ) -> dict[int, list[Sighting]]:
        """Brings the tracks up to date; returns the sightings of each tag."""
        views = [
            view
            for frame, rows in zip(frames, found, strict=True)
            for view in place_views(frame, self._cameras[frame.camera], rows, self._heights_m)
        ]
        sightings = merge_views(views)
        for tag, places in sightings.items():
            self._follow(tag, places)
        for tag, track in self._tracks.items():
            track.seen = track.seen and tag in sightings
        return sightings

    def _fresh(self, frames: Sequence[Frame]) -> list[Frame]:
        """Returns one frame per camera of the newest timestep, in the order of the cameras."""
        for frame in frames:
            self._check(frame)
        newest = max((frame.timestep for frame in frames), default=-1)
        if newest <= self._state.timestep:
            self.counters.old_frames += len(frames)
            return []
        now = [frame for frame in frames if frame.timestep == newest]
        self.counters.old_frames += len(frames) - len(now)
        now.sort(key=lambda frame: (frame.capture_ns, frame.ready_ns))
        single = {frame.camera: frame for frame in now}
        self.counters.repeated_frames += len(now) - len(single)
        return [single[camera] for camera in sorted(single)]

    def _check(self, frame: Frame) -> None:
        camera = self._cameras.get(frame.camera)
        if camera is None:
            known = ", ".join(sorted(self._cameras))
            raise TrackingError(f"a frame of camera {frame.camera!r}; known are {known}")
        if frame.image.shape != (camera.height_px, camera.width_px):
            height, width = frame.image.shape[:2]
            raise TrackingError(
                f"a frame of camera {camera.id} is {width} x {height} px, "
                f"not {camera.width_px} x {camera.height_px}"
            )

    def _detect(self, frames: list[Frame]) -> list[NDArray[np.void]]:
        """Returns each frame's DETECTION array."""
        workers = len(self._detectors)

        def look(worker: int) -> list[NDArray[np.void]]:
            detector = self._detectors[worker]
            mine = frames[worker::workers]
            return [detector.detect(frame.image, self._cameras[frame.camera]) for frame in mine]

        shares = list(self._pool.map(look, range(workers)))
        return [shares[place % workers][place // workers] for place in range(len(frames))]

    def _follow(self, tag: int, places: list[Sighting]) -> None:
        track = self._tracks.get(tag)
        if track is not None:
            self.counters.out_of_reach += track.update(places, self._limits)
        elif len(places) == 1:
            self._tracks[tag] = Track(places[0])

    def _forget(self, now_ns: int) -> None:
        oldest_ns = now_ns - round(1e9 * self._limits.forget_s)
        self._tracks = {
            tag: track for tag, track in self._tracks.items() if track.last.capture_ns >= oldest_ns
        }

    def _poses(self, now_ns: int) -> NDArray[np.void]:
        poses = np.zeros(len(self._tracks), dtype=POSE)
        for row, tag in zip(poses, sorted(self._tracks), strict=True):
            track = self._tracks[tag]
            row["tag"] = tag
            row["x_m"], row["y_m"] = track.position_m(now_ns, self._limits)
            row["yaw_rad"] = track.last.yaw_rad
            row["speed_m_s"] = track.speed_m_s
            row["capture_ns"] = track.last.capture_ns
            row["age_ns"] = max(now_ns - track.last.capture_ns, 0)
            row["confidence"] = track.confidence(now_ns, self._limits)
            row["cameras"] = len(track.last.cameras) if track.seen else 0
            row["seen"] = track.seen
        return poses


def _pin(turn: int) -> None:
    """Keeps the calling thread on the processor of its turn, where the system can do that."""
    if hasattr(os, "sched_setaffinity"):
        allowed = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {allowed[turn % len(allowed)]})
