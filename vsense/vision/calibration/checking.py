"""`vsense camera calibrate check`, from files and pictures on the disk to `report/check.json`."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from vsense.base.arena import Floats, Image
from vsense.base.errors import UsageError, VsenseError
from vsense.base.terminal import Console, aligned, print_data
from vsense.vision.calibration import _references, checked
from vsense.vision.calibration._pictures import PictureFile, gather, inspect
from vsense.vision.calibration._placement import FloorReference, TagFinder
from vsense.vision.calibration._report import PANEL, draw_legibility
from vsense.vision.calibration._views import View
from vsense.vision.calibration.board import Board, CornerFinder
from vsense.vision.calibration.checked import (
    CAMERA_CHECK_FILE,
    PointCheck,
    PointSight,
    read_seen,
    rms,
    steps_m,
)
from vsense.vision.calibration.frame import FrameShift
from vsense.vision.calibration.session import REPORT_FOLDER, cameras_of
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import load_family
from vsense.vision.tracking._detector import make_detector
from vsense.vision.tracking._legibility import legibility
from vsense.vision.tracking.mask import Mask
from vsense.vision.tracking.specs import TrackingSession

Find = Callable[[Camera, Image], dict[str, Floats]]
"""What finds known points in a picture: name -> (2,) pixel."""

_MOST_ROWS = 40
_FRAME_SHARE = 0.7
"""Where the frame as a whole is at fault, less than this remains of the errors without it."""


@dataclass(frozen=True, slots=True)
class CheckOptions:
    """What a calibration is checked with; see `vsense camera calibrate check -h`.

    `limit` and `thickness` are in m. `tracking`: which markers the cameras have to read; `arena_m`
    are the corners of where they can be. `keep`: the pictures become the cameras' references.
    """

    cameras: Path
    points: Path | None
    seen: Path | None
    tags: str | None
    markers: str | None
    distances: Path | None
    board: str | None
    floor: list[str] | None
    thickness: float
    pictures: list[Path] | None
    camera: str | None
    every: int
    limit: float | None
    tracking: TrackingSession | None
    arena_m: Sequence[tuple[float, float]] | None
    keep: bool
    json: bool


class PoorCalibration(VsenseError):
    """A point is farther off than the caller allows."""


def run(options: CheckOptions) -> int:
    """Checks a calibration, says how true it is, and keeps that beside the camera files; returns 0.

    Raises:
        UsageError, ConfigError: options or files are wrong.
        PoorCalibration: a point is farther off than `limit`, a camera was moved, or none of them
            could be compared with its reference picture.
        VsenseError: the pictures show nothing of what was measured.
    """
    _check_options(options)
    if options.tracking is not None:
        path = paint_legible(options.tracking, options.arena_m)
        if not (options.points or options.board):
            print_data(str(path))
            return 0
    cameras = cameras_of("--cameras", options.cameras)
    if not (options.points or options.board):
        return _with_references(options, cameras)
    result = _with_board(options, cameras) if options.board else _with_points(options, cameras)
    now = datetime.now(timezone.utc).isoformat(timespec="seconds")
    data = checked.as_json(result, now, "board" if options.board else "points")
    path = options.cameras / CAMERA_CHECK_FILE
    text = json.dumps(data, indent=2) + "\n"
    try:
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror}") from None
    for line in as_text(result, data):
        _say(line)
    _say("runs with these cameras report it from now on, until their files change")
    print_data(text.rstrip("\n") if options.json else str(path))
    if options.limit is not None and data["worst_mm"] > 1e3 * options.limit:
        raise PoorCalibration(
            f"{data['worst_mm']} mm at worst, expected {1e3 * options.limit:g} mm at most (--limit)"
        )
    return 0


def _with_references(options: CheckOptions, cameras: Mapping[str, Camera]) -> int:
    """Compares pictures with those of the calibration, or makes them its references; returns 0.

    Raises as `run`.
    """
    pictures = _references.backgrounds(_pictures_of(options, cameras))
    for name, image in pictures.items():
        if not _fits(image, cameras[name]):
            (rows, columns), camera = image.shape, cameras[name]
            raise UsageError(
                f"--pictures: {name}: {columns} x {rows} px, expected {camera.width_px} x"
                f" {camera.height_px} as in its camera file"
            )
    if options.keep:
        paths = _references.keep(options.cameras, pictures, pictures)
        print_data("\n".join(map(str, paths)))
        return 0
    found = _references.compared(options.cameras, pictures)
    for name, seen in found.items():
        if isinstance(seen, str):
            _say(f"camera {name}: cannot be compared: {seen}")
        else:
            place = f"in its place: {seen.px:.1f} px"
            _say(f"camera {name}: {f'has moved {seen.in_words()}' if seen.moved else place}")
    if options.json:
        facts = {n: None if isinstance(s, str) else s.facts() for n, s in found.items()}
        print_data(json.dumps({"cameras": facts}, indent=2))
    moved = [name for name, seen in found.items() if not isinstance(seen, str) and seen.moved]
    if without := sorted(set(cameras) - set(found)):
        _say(f"no picture of {', '.join(without)}: not compared")
    if moved:
        raise PoorCalibration(f"moved since the calibration: {', '.join(moved)}")
    if all(isinstance(seen, str) for seen in found.values()):
        raise PoorCalibration("no camera could be compared with its reference picture")
    return 0


def paint_legible(session: TrackingSession, arena_m: Sequence[tuple[float, float]] | None) -> Path:
    """Paints where each camera can read the session's markers, and says it; returns the picture.

    Raises:
        UsageError: the picture can not be written.
    """
    masked = session.masked is not None and session.masked.outline_m is not None
    mask = Mask(tuple(arena_m)) if arena_m else session.mask if masked else None
    seen = []
    for view in session.views:
        height_m = min(view.tracker.heights_m.values(), default=0.0)
        family = load_family(view.tracker.family)
        seen.append(legibility(family, view.camera, height_m, mask, PANEL))
        words = seen[-1].in_words() or f"{family.name} can be read wherever it may be"
        _say(f"camera {view.camera.id}: {words}")
    where = "in the arena" if mask is not None else "in all that they see"
    image = draw_legibility("What cameras can read", f"markers of {session.file}, {where}", seen)
    folder = session.resources.cameras[session.views[0].camera.id].calibration.parent
    path = folder / REPORT_FOLDER / "legible.png"
    try:
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(cv2.imencode(".png", image)[1].tobytes())
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror}") from None
    return path


def _check_options(options: CheckOptions) -> None:
    measured = bool(options.points) + bool(options.board)
    if measured > 1 or not (measured or options.tracking or options.pictures):
        raise UsageError("expected one of --points and --board, or --tracking, or --pictures alone")
    if options.keep and (measured or options.tracking or not options.pictures):
        raise UsageError("--keep: expected --pictures, and neither points, board nor --tracking")
    if options.arena_m and not options.tracking:
        raise UsageError("--experiment: expected --tracking")
    if options.board and not options.floor:
        raise UsageError("--board: expected --floor, the moments when it lay on the floor")
    if (options.board or options.tags or options.markers) and not options.pictures:
        raise UsageError("expected --pictures to look at")
    ways = [options.seen, options.tags, options.markers]
    if options.points and sum(map(bool, ways)) != 1:
        raise UsageError("--points: expected one of --seen, --tags and --markers")
    if options.distances and not options.points:
        raise UsageError("--distances: expected --points")


def _with_points(options: CheckOptions, cameras: Mapping[str, Camera]) -> PointCheck:
    assert options.points is not None
    points = checked.read_places(options.points)
    tapes = checked.read_distances(options.distances, points) if options.distances else []
    if options.seen:
        sights = read_seen(options.seen, points, cameras)
    else:
        sights = _looked(options, cameras, points)
    seen = {sight.point for sight in sights}
    for name in points:
        if name not in seen:
            _say(f"point {name}: no camera shows it")
    if not sights:
        raise VsenseError(f"{options.points}: none of its points was seen")
    tapes = [tape for tape in tapes if tape.first in seen and tape.second in seen]
    return checked.check(cameras, points, sights, tapes)


def _looked(
    options: CheckOptions, cameras: Mapping[str, Camera], points: Mapping[str, Floats]
) -> list[PointSight]:
    """Looks for tags or markers at measured places; of several pictures the median counts."""
    if options.tags:
        finder = TagFinder(options.tags, list(points))
        make = lambda: lambda camera, image: finder.find(image)  # noqa: E731
    else:
        assert options.markers is not None
        make = _marker_finder(options.markers, points)
    seen: dict[tuple[str, str], list[Floats]] = {}
    for camera, places in _inspected(options, cameras, make):
        for id, pixel in places.items():
            seen.setdefault((camera, id), []).append(pixel)
    return [
        PointSight(camera, id, np.median(pixels, axis=0))
        for (camera, id), pixels in sorted(seen.items())
    ]


def _marker_finder(family_name: str, points: Mapping[str, Floats]) -> Callable[[], Find]:
    family = load_family(family_name)
    tags: dict[float, list[int]] = {}
    for name, place in points.items():
        if not name.isdecimal() or len(name) > 9:
            raise UsageError(f"--markers: point '{name}': expected the number of a tag")
        tags.setdefault(float(place[2]), []).append(int(name))
    for height_m, numbers in tags.items():
        make_detector(family, numbers, height_m)

    def make() -> Find:
        detectors = [make_detector(family, numbers, height_m) for height_m, numbers in tags.items()]

        def find(camera: Camera, image: Image) -> dict[str, Floats]:
            rows = [row for detector in detectors for row in detector.detect(image, camera)]
            named = [row for row in rows if row["tag"] >= 0]
            return {
                str(row["tag"]): np.array((row["x_px"], row["y_px"]))
                for row in named
                if sum(other["tag"] == row["tag"] for other in named) == 1
            }

        return find

    return make


def _inspected(
    options: CheckOptions, cameras: Mapping[str, Camera], make: Callable[[], Find]
) -> list[tuple[str, dict[str, Floats]]]:
    """What is found in all pictures, each with its camera."""
    return [(camera, places) for camera, _, places in _views(options, cameras, make)]


def _views(
    options: CheckOptions, cameras: Mapping[str, Camera], make: Callable[[], Any]
) -> list[tuple[str, str, Any]]:
    """What is found in all pictures, each with its camera and moment."""
    pictures = _pictures_of(options, cameras)
    views = []
    for name in sorted({picture.camera for picture in pictures}):
        camera = cameras[name]
        mine = [picture for picture in pictures if picture.camera == name]

        def bound(camera: Camera = camera) -> Callable[[Image], Any]:
            find = make()
            return lambda image: find(camera, image) if _fits(image, camera) else None

        for picture, size, seen in inspect(mine, bound, lambda done, total: None):
            if size != (camera.width_px, camera.height_px):
                raise UsageError(
                    f"{picture.path}: {size[0]} x {size[1]} px, expected {camera.width_px} x"
                    f" {camera.height_px} as in the file of {name}"
                )
            views.append((name, picture.moment, seen))
    return views


def _pictures_of(options: CheckOptions, cameras: Mapping[str, Camera]) -> list[PictureFile]:
    """The pictures to look at, each of a camera that has a file."""
    assert options.pictures is not None
    pictures = gather(options.pictures, options.every)
    pictures = [replace(p, camera=options.camera or p.camera) for p in pictures]
    for name in sorted({picture.camera for picture in pictures} - set(cameras)):
        raise UsageError(
            f"--pictures: camera {name}: {options.cameras} has no file of it; expected"
            f" {', '.join(cameras)}, as folder of the pictures or with --camera"
        )
    return pictures


def _fits(image: Image, camera: Camera) -> bool:
    return image.shape == (camera.height_px, camera.width_px)


def _with_board(options: CheckOptions, cameras: Mapping[str, Camera]) -> PointCheck:
    """Takes the board's corners for points, each time where the board fits best."""
    assert options.board is not None
    board, floor = Board.parse(options.board), FloorReference(flat=tuple(options.floor or ()))

    def make() -> Callable[[Camera, Image], Any]:
        finder = CornerFinder(board)
        return lambda camera, image: finder.find(image)

    views = [
        View(camera, moment, *corners)
        for camera, moment, corners in _views(options, cameras, make)
        if corners is not None
    ]
    _say(f"the board was found in {len(views)} pictures")
    points: dict[str, Floats] = {}
    sights = []
    for moment in floor.moments(views):
        mine = [view for view in views if view.moment == moment]
        ids = np.concatenate([view.ids for view in mine])
        places = np.concatenate(
            [cameras[view.camera].to_plane(view.pixels, options.thickness) for view in mine]
        )
        plan = board.points_m[:, :2]
        lying = FrameShift.between(plan[ids], places).apply(plan)
        points |= {
            f"{moment}/{id}": np.array((*lying[id], options.thickness))
            for id in np.unique(ids).tolist()
        }
        sights += [
            PointSight(view.camera, f"{moment}/{id}", pixel)
            for view in mine
            for id, pixel in zip(view.ids.tolist(), view.pixels)
        ]
    if not sights:
        raise VsenseError("the board was found in no picture; check --board")
    return checked.check(cameras, points, sights)


def as_text(result: PointCheck, data: Mapping[str, Any]) -> list[str]:
    """The check as lines: points, cameras, distances, and what is at fault."""
    lines = []
    if len(result.sights) <= _MOST_ROWS:
        rows: list[tuple[str, ...]] = [("point", "camera", "x mm", "y mm", "off mm")]
        for sight, (x, y) in zip(result.sights, (1e3 * result.off_m).tolist()):
            off = float(np.hypot(x, y))
            rows.append((sight.point, sight.camera, f"{x:+.1f}", f"{y:+.1f}", f"{off:.1f}"))
        lines += aligned(rows, left=2)
    rows = [("camera", "points", "rms mm", "worst mm")]
    for name, of in data["of_cameras"].items():
        rows.append((name, str(of["points"]), f"{of['rms_mm']:.2f}", f"{of['worst_mm']:.2f}"))
    lines += aligned(rows, left=1)
    steps = steps_m(result)
    if steps:
        (first, other), most = max(steps.items(), key=lambda pair: pair[1])
        lines.append(f"between two cameras {1e3 * most:.2f} mm at worst, {first} and {other}")
    for tape, off_m in zip(result.distances, result.apart_m.tolist()):
        lines.append(
            f"from {tape.first} to {tape.second}: {1e3 * off_m:+.1f} mm of"
            f" {1e3 * tape.distance_m:.0f} mm"
        )
    if result.distances:
        lines.append(f"distances {1e3 * rms(result.apart_m):.2f} mm rms")
    lines.append(
        f"all together {data['rms_mm']:.2f} mm rms, {data['worst_mm']:.2f} mm at worst, at"
        f" {data['points']} points"
    )
    return [*lines, *_blame(result, data)]


def _blame(result: PointCheck, data: Mapping[str, Any]) -> list[str]:
    """Says whether the frame as a whole is at fault."""
    if result.shift is None or data["how"] == "board":
        return []
    text = f"{data['shape_rms_mm']:.2f} mm rms where the frame as a whole fits best"
    if data["shape_rms_mm"] < _FRAME_SHARE * data["rms_mm"]:
        return [f"{text}: {result.shift.in_words()}; vsense camera arena align moves it there"]
    return [text]


def _say(text: str) -> None:
    Console().say(text)
