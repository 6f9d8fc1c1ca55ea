"""`vsense bench tracking`: detectors side by side on the same floors, in one run.

Contestants take turns, so that other load of the machine affects all of them; the median of all
pictures of all rounds counts.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from vsense.bench.contestants import (
    MAX_THREADS,
    AprilTag,
    Contestant,
    FoundTags,
    SharedOut,
    Single,
    Tracked,
    is_installed,
    opencv,
    ours,
)
from vsense.bench.frames import MARKER_M, FrameSet, Image, Painter, cameras
from vsense.markers.codes import choose_tags
from vsense.markers.families import MarkerFamily, load_family
from vsense.tracking.detector import make_detector
from vsense.tracking.prediction import SearchPlan

ROBOTS = 20
TABLE_2_1 = ((1, 0.30), (5, 0.30), (5, 0.11), (5, 0.10), (9, 0.11))
"""Key frame period and side of the square [m] of each row of the thesis's Table 2.1."""

OURS = "vsense arrow, full search"
ARUCO_SUBPIX = "cv2.aruco, sub-pixel corners"
ARUCO_TUNED = "cv2.aruco, sub-pixel corners, tuned"
APRILTAG = "AprilTag 3, decimate 2"

_TUNED_WINDOW_PX = 23
_MATCH_PX = 5.0
_BLUR_MM = 2.2
_COLD_FRAMES = 60
_SETS = 5
"""Passes over the set of 16 cameras in each round: it is short, and the others' load is not."""


@dataclass(frozen=True, slots=True)
class TrackingRow:
    """One contestant's result.

    Attributes:
        frames: name of the pictures.
        ms_per_frame: median time per picture.
        detected_share: share of the markers that it found and named.
        wrong_ids: wrong names, in all pictures together.
        position_rms_px: root mean square distance to the truth, in x and y together.
    """

    detector: str
    frames: str
    threads: int
    ms_per_frame: float
    detected_share: float
    wrong_ids: int
    position_rms_px: float


Say = Callable[[str], None]


def run(rounds: int, pictures: int, walk: int, say: Say) -> dict[str, Any]:
    """Runs the benchmark: in each round each contestant does a pass.

    Each set has `pictures` pictures, the motion sequence `walk`.

    Returns:
        The report: `rows`, `floor_ms`, `memcpy_ms`, `set16`, `ratio_to_aruco`,
        `ratio_to_aruco_tuned` and `ratio_to_apriltag` (None where it is not installed).
    """
    with ExitStack() as stack:
        contestants, sixteen = _invite(pictures, walk, say)
        for contestant in [*contestants, sixteen]:
            stack.callback(contestant.close)
        times: list[list[float]] = [[] for _ in contestants]
        found: list[list[FoundTags]] = [[] for _ in contestants]
        floor, copy, sets = [], [], []
        for turn in range(rounds + 1):
            say(f"round {turn} of {rounds}" if turn else "warming up")
            for place, contestant in enumerate(contestants):
                spent, found[place] = contestant.run()
                times[place] += spent if turn else []
            for _ in range(_SETS):
                spent = sixteen.run()[0]
                sets += spent if turn else []
            floor += _floor(sixteen.frames, np.bitwise_xor.reduce)
            copy += _floor(sixteen.frames, np.copy)
    rows = [
        judge(contestant, spent, seen)
        for contestant, spent, seen in zip(contestants, times, found, strict=True)
        if spent
    ]
    return _report(rows, float(np.median(floor)), float(np.median(copy)), sets)


def _invite(pictures: int, walk: int, say: Say) -> tuple[list[Contestant], Contestant]:
    """Renders the pictures and makes the contestants, and the one for the set of 16 cameras."""
    say("rendering")
    rig = cameras(4, 4)
    arrow = load_family("arrow4x4")
    assert isinstance(arrow, MarkerFamily), "the shipped family is of arrows"
    tags = tuple(choose_tags(arrow, ROBOTS, _BLUR_MM, seed=14))
    plain = tuple(range(ROBOTS))
    painter = Painter("arrow4x4", "arrow4x4", tags, rig)
    arrows, spread = painter.crowds(pictures), painter.spread()
    squares = Painter("DICT_4X4_50, same disc", "aruco_4x4_50", plain, rig).crowds(pictures)
    moving = Painter("arrow4x4, driving", "arrow4x4", tags, rig[:1]).walk(walk)
    contestants: list[Contestant] = [
        _single(OURS, arrows),
        _shared(OURS, arrows),
        _single("vsense squares", squares),
        _shared("vsense squares", squares),
    ]
    for threads in (1, MAX_THREADS):
        contestants += [
            Single("cv2.aruco, default", squares, opencv(False), threads),
            Single(ARUCO_SUBPIX, squares, opencv(True), threads),
            Single(ARUCO_TUNED, squares, opencv(True, _TUNED_WINDOW_PX), threads),
        ]
    contestants += _plans(moving)
    if is_installed():
        tagged = Painter("tag36h11, same disc", "apriltag_36h11", plain, rig).crowds(pictures)
        contestants += [AprilTag(APRILTAG, tagged, 2.0, threads) for threads in (1, MAX_THREADS)]
    return contestants, _shared(OURS, spread)


def _single(name: str, frames: FrameSet) -> Contestant:
    return Single(name, frames, ours(_detector(frames)))


def _shared(name: str, frames: FrameSet) -> Contestant:
    return SharedOut(name, frames, [ours(_detector(frames)) for _ in range(MAX_THREADS)])


def _detector(frames: FrameSet) -> Any:
    return make_detector(load_family(frames.family), frames.tags, MARKER_M)


def _plans(moving: FrameSet) -> Iterator[Contestant]:
    """The tracker with each row of Table 2.1, and with the warm fit."""
    for period, side_m in TABLE_2_1:
        square = f", {100.0 * side_m:.0f} cm" if period > 1 else ""
        name = f"vsense tracker, key frame {period}{square}"
        yield Tracked(name, moving, SearchPlan(period, side_m))
    yield Tracked("vsense tracker, warm fit, key frame 15", moving, SearchPlan(15, 0.11, True))


def judge(contestant: Contestant, times: list[float], found: list[FoundTags]) -> TrackingRow:
    """Compares what was found with the truth."""
    present = named = wrong = 0
    squares: list[float] = []
    for truth, seen in zip(contestant.frames.truth, found, strict=True):
        present += len(truth.tags)
        places = dict(zip(truth.tags.tolist(), truth.centres_px, strict=True))
        for tag, centre in zip(seen.tags.tolist(), seen.centres_px, strict=True):
            gap = np.hypot(*(centre - places[tag])) if tag in places else np.inf
            if gap < _MATCH_PX:
                named += 1
                squares.append(float(gap) ** 2)
            else:
                wrong += 1
    return TrackingRow(
        detector=contestant.name,
        frames=contestant.frames.name,
        threads=contestant.threads,
        ms_per_frame=float(np.median(times)),
        detected_share=named / present if present else 1.0,
        wrong_ids=wrong,
        position_rms_px=float(np.sqrt(np.mean(squares))) if squares else float("nan"),
    )


def _floor(frames: FrameSet, touch: Callable[[Any], Any]) -> list[float]:
    """Times to touch pictures once [ms]; there are more than caches hold."""
    images: list[Image] = list(frames.images)
    while len(images) < _COLD_FRAMES:
        images += [image.copy() for image in frames.images]
    times = []
    for image in images:
        words = image.reshape(-1)[: image.size // 8 * 8].view(np.uint64)
        begin = time.perf_counter()
        touch(words)
        times.append(1e3 * (time.perf_counter() - begin))
    return times


def _report(
    rows: list[TrackingRow], floor_ms: float, copy_ms: float, sets: list[float]
) -> dict[str, Any]:
    by_name = {row.detector: row.ms_per_frame for row in rows if row.threads == 1}
    mine = by_name[OURS]
    set_ms = 16.0 * float(np.median(sets))

    def against(name: str) -> float | None:
        return by_name[name] / mine if name in by_name else None

    return {
        "rows": [asdict(row) for row in rows],
        "floor_ms": floor_ms,
        "memcpy_ms": copy_ms,
        "set16": {"threads": MAX_THREADS, "ms": set_ms, "times_floor": set_ms / (16.0 * floor_ms)},
        "ratio_to_aruco": against(ARUCO_SUBPIX),
        "ratio_to_aruco_tuned": against(ARUCO_TUNED),
        "ratio_to_apriltag": against(APRILTAG),
    }
