"""`scripts/bench tracking`: detectors side by side on the same floors, in one run.

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

from tests.bench import whole_tracker
from tests.bench.contestants import (
    LIBRARIES,
    MAX_THREADS,
    Apart,
    Contestant,
    FoundTags,
    SharedOut,
    Single,
    Tracked,
    is_installed,
    opencv,
    ours,
)
from tests.bench.frames import MARKER_M, FrameSet, Painter, cameras
from tests.bench.whole_tracker import PER_CAMERA, WholeTracker
from vsense.base.arena import Image
from vsense.base.terminal import aligned
from vsense.vision.markers.families import MarkerFamily, choose_tags, load_family
from vsense.vision.tracking._detector import make_detector
from vsense.vision.tracking._prediction import SearchPlan

ROBOTS = 20
TABLE_2_1 = ((1, 0.30), (5, 0.30), (5, 0.11), (5, 0.10), (9, 0.11))
"""Key frame period and side of the square [m] of each row of the thesis's Table 2.1."""

OURS = "vsense arrow, full search"
ARUCO_SUBPIX = "cv2.aruco, sub-pixel corners"
ARUCO_TUNED = "cv2.aruco, sub-pixel corners, tuned"
ARUCO_FASTEST = "cv2.aruco, whole pixels, tuned"
APRILTAG = "AprilTag 3, decimate 2"
OTHERS = dict(zip(LIBRARIES, (APRILTAG, "napa-vision", "locus-tag"), strict=True))
OUR_SQUARES = "vsense squares, full search"
SQUARES = {"DICT_4X4_50": "aruco_4x4_50", "DICT_APRILTAG_36h11": "apriltag_36h11"}
"""OpenCV's dictionaries, and the marker families that are made of them."""

_TUNED_WINDOW_PX = 23
_MATCH_PX = 5.0
_BLUR_MM = 2.2
_COLD_FRAMES = 60
_WHOLE_TIMESTEPS = 8
RIG = (4, 4)
"""Columns and rows of the set of 16 cameras."""
_MOST_STEPS = 4
"""Different pictures of 16 cameras: four are 130 MB."""
_SETS = 5
"""Passes over the set of 16 cameras in each round: it is short, and the others' load is not."""


@dataclass(frozen=True, slots=True)
class TrackingRow:
    """One contestant's result.

    Attributes:
        frames: name of the pictures.
        ms_per_frame: median time per picture.
        detected_share: share of the markers that it found and named.
        wrong_ids: markers with another's name, in all pictures together.
        false_ids: names where no marker is.
        position_rms_px: root mean square distance to the truth, in x and y together.
    """

    detector: str
    frames: str
    threads: int
    ms_per_frame: float
    detected_share: float
    wrong_ids: int
    false_ids: int
    position_rms_px: float


Say = Callable[[str], None]


def run(rounds: int, pictures: int, walk: int, say: Say) -> dict[str, Any]:
    """Runs the benchmark: in each round each contestant does a pass.

    Each set has `pictures` pictures, the motion sequence `walk`.

    Returns:
        The report: `rows`, `floor_ms`, `memcpy_ms`, `set16`, of the arrows `ratio_to_aruco`,
        `ratio_to_aruco_tuned` and `ratio_to_apriltag` (None where it is not installed), and
        `squares`, by dictionary: `ms_per_frame`, `ratio_to_aruco`, `ratio_to_aruco_fastest` and
        `ratio_to_apriltag` of one thread. AprilTag reads its own family, on the same floors.
        `whole_tracker` is that of `whole_tracker.report`.
    """
    with ExitStack() as stack:
        contestants, sixteen = _invite(pictures, walk, say)
        whole = _whole_trackers(min(pictures, _MOST_STEPS))
        for each in whole:
            stack.callback(each.close)
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
            for spent in (sixteen.run()[0] for _ in range(_SETS)):
                sets += spent if turn else []
            for each in whole:
                each.run(_WHOLE_TIMESTEPS, counts=turn > 0)
            floor += _floor(sixteen.frames, np.bitwise_xor.reduce)
            copy += _floor(sixteen.frames, np.copy)
    rows = [
        judge(contestant, spent, seen)
        for contestant, spent, seen in zip(contestants, times, found, strict=True)
        if spent
    ]
    report = _report(rows, float(np.median(floor)), float(np.median(copy)), sets)
    return report | {"whole_tracker": whole_tracker.report(*whole)}


def _invite(pictures: int, walk: int, say: Say) -> tuple[list[Contestant], Contestant]:
    """Renders the pictures and makes the contestants, and the one for the set of 16 cameras."""
    say("rendering")
    rig = cameras(*RIG)
    arrow = load_family("arrow4x4")
    assert isinstance(arrow, MarkerFamily), "the shipped family is of arrows"
    tags = tuple(choose_tags(arrow, ROBOTS, _BLUR_MM, seed=14))
    plain = tuple(range(ROBOTS))
    painter = Painter("arrow4x4", "arrow4x4", tags, rig)
    arrows, spread = painter.crowds(pictures), painter.spread()
    moving = Painter("arrow4x4, driving", "arrow4x4", tags, rig[:1]).walk(walk)
    contestants: list[Contestant] = [_single(OURS, arrows), _shared(OURS, arrows)]
    for dictionary, family in SQUARES.items():
        squares = Painter(_same_disc(dictionary), family, plain, rig).crowds(pictures)
        contestants += [_single(OUR_SQUARES, squares), _shared(OUR_SQUARES, squares)]
        for threads in (1, MAX_THREADS):
            contestants += [
                Single("cv2.aruco, default", squares, opencv(dictionary, False), threads),
                Single(ARUCO_SUBPIX, squares, opencv(dictionary, True), threads),
                Single(ARUCO_TUNED, squares, opencv(dictionary, True, _TUNED_WINDOW_PX), threads),
                Single(
                    ARUCO_FASTEST, squares, opencv(dictionary, False, _TUNED_WINDOW_PX), threads
                ),
            ]
        if dictionary.startswith("DICT_APRILTAG"):
            contestants += [
                Apart(name, squares, library, threads)
                for library, name in OTHERS.items()
                for threads in ((1, MAX_THREADS) if name == APRILTAG else (1,))
                if is_installed(library)
            ]
    contestants += _plans(moving)
    return contestants, _shared(OURS, spread)


def _whole_trackers(steps: int) -> tuple[WholeTracker, WholeTracker]:
    """Those of arrows and of the squares that have tags enough."""
    arrow = load_family("arrow4x4")
    assert isinstance(arrow, MarkerFamily), "the shipped family is of arrows"
    columns, rows = whole_tracker.CAMERAS
    robots = columns * rows * PER_CAMERA
    tags = choose_tags(arrow, robots, _BLUR_MM, seed=14)
    squares = SQUARES["DICT_APRILTAG_36h11"]
    return WholeTracker(arrow.name, tags, steps), WholeTracker(squares, range(robots), steps)


def _same_disc(dictionary: str) -> str:
    return f"{dictionary}, same disc"


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
    present = named = wrong = false = 0
    squares: list[float] = []
    for truth, seen in zip(contestant.frames.truth, found, strict=True):
        present += len(truth.tags)
        places = dict(zip(truth.tags.tolist(), truth.centres_px, strict=True))
        for tag, centre in zip(seen.tags.tolist(), seen.centres_px, strict=True):
            gap = np.hypot(*(centre - places[tag])) if tag in places else np.inf
            if gap < _MATCH_PX:
                named += 1
                squares.append(float(gap) ** 2)
            elif np.hypot(*(truth.centres_px - centre).T).min(initial=np.inf) < _MATCH_PX:
                wrong += 1
            else:
                false += 1
    return TrackingRow(
        detector=contestant.name,
        frames=contestant.frames.name,
        threads=contestant.threads,
        ms_per_frame=float(np.median(times)),
        detected_share=named / present if present else 1.0,
        wrong_ids=wrong,
        false_ids=false,
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
    by_name = {(row.detector, row.frames): row.ms_per_frame for row in rows if row.threads == 1}
    plain, tagged = map(_same_disc, SQUARES)
    mine = by_name[OURS, "arrow4x4"]
    set_ms = 16.0 * float(np.median(sets))

    def against(name: str, frames: str, ours_ms: float) -> float | None:
        return by_name[name, frames] / ours_ms if (name, frames) in by_name else None

    def squares(frames: str) -> dict[str, float | None]:
        ours_ms = by_name[OUR_SQUARES, frames]
        return {
            "ms_per_frame": ours_ms,
            "ratio_to_aruco": against(ARUCO_SUBPIX, frames, ours_ms),
            "ratio_to_aruco_fastest": against(ARUCO_FASTEST, frames, ours_ms),
            "ratio_to_apriltag": against(APRILTAG, tagged, ours_ms),
        }

    return {
        "rows": [asdict(row) for row in rows],
        "floor_ms": floor_ms,
        "memcpy_ms": copy_ms,
        "set16": {"threads": MAX_THREADS, "ms": set_ms, "times_floor": set_ms / (16.0 * floor_ms)},
        "ratio_to_aruco": against(ARUCO_SUBPIX, plain, mine),
        "ratio_to_aruco_tuned": against(ARUCO_TUNED, plain, mine),
        "ratio_to_apriltag": against(APRILTAG, tagged, mine),
        "squares": {dictionary: squares(_same_disc(dictionary)) for dictionary in SQUARES},
    }


def table(report: dict[str, Any]) -> str:
    """Returns the detectors' report for a person."""
    titles = ("detector", "frames", "threads", "ms/frame", "found", "wrong", "false", "rms px")
    lines = [titles]
    for row in report["rows"]:
        lines.append(
            (
                row["detector"],
                row["frames"],
                str(row["threads"]),
                f"{row['ms_per_frame']:.2f}",
                f"{100.0 * row['detected_share']:.2f} %",
                str(row["wrong_ids"]),
                str(row["false_ids"]),
                f"{row['position_rms_px']:.3f}",
            )
        )
    text = aligned(lines, left=2)
    sixteen = report["set16"]
    text += [
        "",
        f"floor: one read of a picture {report['floor_ms']:.3f} ms,"
        f" one copy {report['memcpy_ms']:.3f} ms",
        f"16 cameras, 20 robots in total, {sixteen['threads']} threads:"
        f" {sixteen['ms']:.1f} ms, {sixteen['times_floor']:.1f} times the floor",
        f"faster than cv2.aruco with sub-pixel corners: {_times(report['ratio_to_aruco'])},"
        f" than its best tuning: {_times(report['ratio_to_aruco_tuned'])}",
        f"faster than AprilTag 3 (decimate 2): {_times(report['ratio_to_apriltag'])}",
    ]
    for dictionary, squares in report["squares"].items():
        text += [
            f"{dictionary}: {squares['ms_per_frame']:.2f} ms; faster than cv2.aruco with sub-pixel"
            f" corners: {_times(squares['ratio_to_aruco'])}, than its fastest setting:"
            f" {_times(squares['ratio_to_aruco_fastest'])}, than AprilTag 3:"
            f" {_times(squares['ratio_to_apriltag'])}"
        ]
    return "\n".join([*text, _whole(report["whole_tracker"])])


def _whole(whole: dict[str, float]) -> str:
    return (
        "whole tracker, 16 cameras x 20 robots, every picture searched:"
        f" arrows {whole['arrows_ms']:.1f} ms (of processor time {whole['arrows_cpu_ms']:.1f},"
        f" {100.0 * whole['c_share']:.0f} % in C), 36h11 {whole['squares_ms']:.1f} ms"
        f" ({whole['squares_cpu_ms']:.1f})"
    )


def _times(ratio: float | None) -> str:
    if ratio is None:
        return "not measured, install it with: pip install pupil-apriltags"
    return f"{ratio:.1f} times"
