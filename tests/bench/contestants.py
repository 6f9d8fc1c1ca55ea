"""The detectors that are compared, vsense's, OpenCV's and others where installed, behind one seam.

A contestant does passes over its pictures. The time of each pass counts; what it found in the last
one is compared with the truth.

AprilTag 3 (pupil-apriltags) may crash its process when it ends, so libraries that are installed
beside vsense have one each. This module is both ends: the parent sends a line for each pass and
gets one JSON line back. napa-vision's licence allows no more than this: to compare.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from tests.bench.frames import FRAMES_PER_S, MARKER_M, FrameSet
from tests.rigs.places import ROOT
from vsense.base.arena import Frame, Image
from vsense.base.processes import start_module
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import load_family
from vsense.vision.tracking._prediction import SearchPlan
from vsense.vision.tracking.arena_tracker import ArenaTracker
from vsense.vision.tracking.marker_detector import MarkerDetector

MAX_THREADS = 2


class FoundTags(NamedTuple):
    """Markers that were named in a picture, and their centres [px]."""

    tags: NDArray[np.int64]
    centres_px: NDArray[np.float64]


Look = Callable[[Image, Camera], FoundTags]


class Contestant(Protocol):
    """A detector with its pictures and its number of threads; the report has its name."""

    name: str
    frames: FrameSet
    threads: int

    def run(self) -> tuple[list[float], list[FoundTags]]:
        """Does one pass over the pictures.

        Returns:
            The time of each picture [ms], or the mean where they are done in parallel; what was
            found in each.
        """

    def close(self) -> None: ...


class Single:
    """One picture after the other. OpenCV's own functions may use several threads."""

    def __init__(self, name: str, frames: FrameSet, look: Look, threads: int = 1) -> None:
        self.name, self.frames, self.threads, self._look = name, frames, threads, look

    def run(self) -> tuple[list[float], list[FoundTags]]:
        cv2.setNumThreads(self.threads)
        times, found = [], []
        for image, camera in zip(self.frames.images, self.frames.cameras, strict=True):
            begin = time.perf_counter()
            found.append(self._look(image, camera))
            times.append(1e3 * (time.perf_counter() - begin))
        cv2.setNumThreads(1)
        return times, found

    def close(self) -> None:
        """Nothing was started."""


class SharedOut:
    """The pictures shared out to threads, one per function, each on a processor of its own."""

    def __init__(self, name: str, frames: FrameSet, looks: Sequence[Look]) -> None:
        self.name, self.frames, self.threads, self._looks = name, frames, len(looks), looks
        turns = count()
        self._pool = ThreadPoolExecutor(len(looks), initializer=lambda: _pin(next(turns)))

    def run(self) -> tuple[list[float], list[FoundTags]]:
        total = len(self.frames.images)
        found: dict[int, FoundTags] = {}
        turns = iter(range(total))

        def work(look: Look) -> None:
            for turn in turns:
                found[turn] = look(self.frames.images[turn], self.frames.cameras[turn])

        begin = time.perf_counter()
        list(self._pool.map(work, self._looks))
        spent = 1e3 * (time.perf_counter() - begin)
        return [spent / total], [found[turn] for turn in range(total)]

    def close(self) -> None:
        self._pool.shutdown()


class Tracked:
    """Our arena tracker, new in each pass, on one camera's sequence with a plan of the thesis."""

    def __init__(self, name: str, frames: FrameSet, plan: SearchPlan) -> None:
        self.name, self.frames, self.threads, self._plan = name, frames, 1, plan
        self._family = load_family(frames.family)

    def run(self) -> tuple[list[float], list[FoundTags]]:
        camera = self.frames.cameras[0]
        heights = dict.fromkeys(self.frames.tags, MARKER_M)
        tracker = ArenaTracker.for_family([camera], self._family, heights, plan=self._plan)
        times, found = [], []
        for number, image in enumerate(self.frames.images):
            capture_ns = round(1e9 * number / FRAMES_PER_S)
            frame = Frame(camera.id, image, number, capture_ns, capture_ns)
            begin = time.perf_counter()
            state = tracker.update([frame])
            times.append(1e3 * (time.perf_counter() - begin))
            seen = state.robots[state.robots["seen"]]
            points = np.column_stack((seen["x_m"], seen["y_m"], np.full(len(seen), MARKER_M)))
            found.append(FoundTags(seen["tag"].astype(np.int64), camera.project(points)))
        tracker.close()
        return times, found

    def close(self) -> None:
        """Each pass has closed its tracker."""


def ours(detector: MarkerDetector) -> Look:
    """Wraps one of vsense's detectors."""

    def look(image: Image, camera: Camera) -> FoundTags:
        found = detector.detect(image, camera)
        named = found[found["tag"] >= 0]
        return FoundTags(
            named["tag"].astype(np.int64), np.stack((named["x_px"], named["y_px"]), axis=1)
        )

    return look


def opencv(dictionary: str, refine: bool, window_px: int | None = None) -> Look:
    """Wraps OpenCV's detector of a dictionary; with `refine` it refines corners to sub-pixels.

    `window_px` is the one window of the threshold (its best tuning); None: OpenCV's three.
    """
    settings = cv2.aruco.DetectorParameters()
    if refine:
        settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    if window_px is not None:
        settings.adaptiveThreshWinSizeMin = settings.adaptiveThreshWinSizeMax = window_px
    words = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    detector = cv2.aruco.ArucoDetector(words, settings)

    def look(image: Image, camera: Camera) -> FoundTags:
        corners, ids, _ = detector.detectMarkers(image)
        if len(corners) == 0:
            return FoundTags(np.zeros(0, dtype=np.int64), np.zeros((0, 2)))
        points = np.array(corners, dtype=np.float64).reshape(-1, 4, 2)
        return FoundTags(np.asarray(ids, dtype=np.int64).ravel(), crossing(points))

    return look


def crossing(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Crossings (n, 2) of the diagonals of quadrilaterals (n, 4, 2)."""
    a, b, c, d = (corners[:, k] for k in range(4))
    along, other, apart = c - a, d - b, b - a
    share = (apart[:, 0] * other[:, 1] - apart[:, 1] * other[:, 0]) / (
        along[:, 0] * other[:, 1] - along[:, 1] * other[:, 0]
    )
    return np.asarray(a + share[:, np.newaxis] * along)


def _pin(turn: int) -> None:
    """Keeps the calling thread on the processor of its turn, where the system can do that."""
    if hasattr(os, "sched_setaffinity"):
        allowed = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {allowed[turn % len(allowed)]})


LIBRARIES = {"pupil_apriltags": 0.5, "napa_vision": 0.0, "locus": 0.5}
"""What others read tag36h11 with, and by how much [px] their pixels are counted from an upper left
corner instead of the middle."""


def is_installed(library: str) -> bool:
    """Whether a library of `LIBRARIES` is there."""
    return importlib.util.find_spec(library) is not None


class Apart:
    """Somebody else's library on pictures of tag36h11, in a process of its own."""

    def __init__(self, name: str, frames: FrameSet, library: str, threads: int) -> None:
        self.name, self.frames, self.threads = name, frames, threads
        self._offset_px = LIBRARIES[library]
        self._folder = tempfile.TemporaryDirectory(prefix="vsense-bench-")
        pictures = Path(self._folder.name) / "pictures.npy"
        np.save(pictures, np.array(frames.images))
        words = str(pictures), library, str(threads)
        self._process, self._stdin, self._stdout = start_module(
            "tests.bench.contestants",
            *words,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": str(ROOT), "RAYON_NUM_THREADS": str(threads)},
        )

    def run(self) -> tuple[list[float], list[FoundTags]]:
        """Does one pass over the pictures; nothing is found where the process has crashed."""
        try:
            self._stdin.write(b"\n")
            self._stdin.flush()
            answer: dict[str, Any] = json.loads(self._stdout.readline())
        except (BrokenPipeError, json.JSONDecodeError):
            return [], []
        found = [
            FoundTags(
                np.array(tags, dtype=np.int64),
                np.array(centres, dtype=np.float64).reshape(-1, 2) - self._offset_px,
            )
            for tags, centres in answer["found"]
        ]
        return answer["ms"], found

    def close(self) -> None:
        # In the middle of a pass it would wait for a reader of its answer.
        self._process.kill()
        self._process.wait()
        self._stdin.close()
        self._stdout.close()
        self._folder.cleanup()


Corners = list[tuple[int, Any]]


def _reader(library: str, threads: int) -> Callable[[Image], Corners]:
    """Returns what gives a picture's tags, each with its (4, 2) corners."""
    module = importlib.import_module(library)
    if library == "napa_vision":
        napa = module.NapaDetector(min_tag_px=20)
        return lambda picture: [(tag.tag_id, tag.corners) for tag in napa.detect(picture)]
    if library == "locus":
        locus = module.Detector(families=[module.TagFamily.AprilTag36h11])

        def read(picture: Image) -> Corners:
            batch = locus.detect(picture)
            return list(zip(batch.ids.tolist(), batch.corners, strict=True))

        return read
    tags = module.Detector(families="tag36h11", nthreads=threads, quad_decimate=2.0)
    return lambda picture: [(tag.tag_id, tag.corners) for tag in tags.detect(picture)]


def _serve(pictures: NDArray[np.uint8], library: str, threads: int) -> None:
    """Answers each line on standard input with one pass over the pictures."""
    read = _reader(library, threads)
    for _ in sys.stdin:
        times, found = [], []
        for picture in pictures:
            begin = time.perf_counter()
            seen = read(picture)
            times.append(1e3 * (time.perf_counter() - begin))
            corners = np.array([four for _, four in seen], dtype=np.float64).reshape(-1, 4, 2)
            found.append(([int(tag) for tag, _ in seen], crossing(corners).tolist()))
        print(json.dumps({"ms": times, "found": found}), flush=True)


if __name__ == "__main__":
    _serve(np.load(sys.argv[1]), sys.argv[2], int(sys.argv[3]))
