"""`vsense camera calibrate`, from paths on the disk to camera files on the disk."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats, Image
from vsense.base.errors import UsageError
from vsense.base.files import read_text
from vsense.base.terminal import Console, counted, print_data
from vsense.vision.calibration import _report
from vsense.vision.calibration._bundle import lens_of
from vsense.vision.calibration._intrinsics import calibrate_lenses
from vsense.vision.calibration._pictures import PictureFile, gather, inspect
from vsense.vision.calibration._placement import (
    FloorReference,
    TagFinder,
    read_points,
    read_seen,
    tag_views,
)
from vsense.vision.calibration._references import backgrounds, keep
from vsense.vision.calibration._rig import Rig, RigSolver, Trust
from vsense.vision.calibration._solution import Solution, check_board
from vsense.vision.calibration._views import BoardViews, View, read_corners, write_corners
from vsense.vision.calibration.board import Board, CornerFinder, page
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers import _paper

Corners = tuple[NDArray[np.int64], Floats]

REPORT_FOLDER = "report"
"""Folder beside the camera files; it holds report.json, report.png and corners.csv."""
_MOST_VIEWS = 80
_DPI = 300


@dataclass(frozen=True, slots=True)
class LensOptions:
    """What lenses are calibrated from, and where the files go; see `vsense camera calibrate -h`.

    `board` is None where only known points are seen; `size` is of the corners' pictures [px].
    """

    board: str | None
    pictures: list[Path] | None
    camera: str | None
    every: int
    corners: Path | None
    size: tuple[int, int] | None
    output: Path
    json: bool


@dataclass(frozen=True, slots=True)
class RigOptions(LensOptions):
    """What a rig is calibrated from; see `vsense camera calibrate rig -h`.

    `origin` is x, y [m] and yaw [degrees]; `thickness` and `accuracy` are in m.
    """

    intrinsics: Path | None
    refine: bool
    floor: list[str] | None
    origin: tuple[float, float, float]
    thickness: float
    points: Path | None
    seen: Path | None
    tags: str | None
    accuracy: float


def print_board(text: str, output: Path) -> int:
    """Writes a board, as `Board.parse` reads it, to a .pdf or .png; raises UsageError."""
    board = Board.parse(text)
    sheet = page(board)
    if output.suffix.lower() == ".pdf":
        data = _paper.document([sheet])
    elif output.suffix.lower() == ".png":
        data = _paper.png(_paper.draw(sheet, _DPI), _DPI)
    else:
        raise UsageError(f"{output}: expected a name that ends in .pdf or .png")
    _write(output, data)
    print_data(str(output))
    _say(
        f"{board} on paper of {sheet.width_mm:.0f} x {sheet.height_mm:.0f} mm: print at 100 %, "
        "measure a row of squares, glue it on something flat"
    )
    return 0


def intrinsics(options: LensOptions) -> int:
    """Calibrates the lens of each camera by itself; returns 0.

    Raises UsageError or ConfigError for wrong options or files, CalibrationError for poor
    pictures.
    """
    _check_sources(options)
    assert options.board is not None, "the option is required"
    board = Board.parse(options.board)
    shoot, _ = _shoot(options, board, {}, None)
    solution = calibrate_lenses(_thinned(shoot), board)
    title = f"Lens of {counted(len(solution.cameras), 'camera')}"
    return _deliver(options, title, solution, board, shoot.views)


def rig(options: RigOptions) -> int:
    """Calibrates all cameras of a rig together; returns 0, and raises as `intrinsics` does."""
    _check_sources(options, options.seen)
    _check_rig(options)
    board = Board.parse(options.board) if options.board else None
    given = cameras_of("--intrinsics", options.intrinsics) if options.intrinsics else {}
    points = read_points(options.points) if options.points else {}
    tags = TagFinder(options.tags, list(points)) if options.tags else None
    shoot, tagged = _shoot(options, board, given, tags)
    sightings = list(tagged)
    if options.seen:
        sightings += read_seen(options.seen, points, sorted(shoot.sizes))
    x, y, degrees = options.origin
    floor = FloorReference(
        flat=tuple(options.floor or ()),
        origin=(x, y, float(np.radians(degrees))),
        thickness_m=options.thickness,
        points_m=points,
        sightings=tuple(sightings),
        sigma_m=options.accuracy,
    )
    if board is not None and board.symmetric and len(shoot.sizes) > 1:
        raise UsageError(
            f"{board}: looks the same after half a turn, so cameras may take one corner for "
            "another; take a ChArUco board, or a chessboard with one odd and one even number"
        )
    lenses, trust = {c: lens_of(given[c]) for c in shoot.sizes if c in given}, Trust.HOLD
    if given and options.refine:
        trust = Trust.REFINE
    elif not given:
        assert board is not None
        _say("lenses first, each camera by itself")
        lens_solution = calibrate_lenses(shoot, board)
        lenses, trust = {c.id: lens_of(c) for c in lens_solution.cameras}, Trust.FREE
    solution = RigSolver(Rig(shoot, board, floor, lenses, trust)).solve()
    _keep_references(options, [camera.id for camera in solution.cameras])
    title = f"Rig of {counted(len(solution.cameras), 'camera')}"
    return _deliver(options, title, solution, board, shoot.views)


def _check_sources(options: LensOptions, seen: Path | None = None) -> None:
    """Refuses options that say twice, or nowhere, where corners come from."""
    sources = [bool(options.pictures), bool(options.corners)]
    if all(sources) or not any([*sources, seen]):
        raise UsageError("expected one of --pictures and --corners")
    if options.corners and not options.board:
        raise UsageError("--corners: expected --board, the board that they are on")


def _check_rig(options: RigOptions) -> None:
    """Refuses options of a rig that do not go together."""
    if not options.board and not options.points:
        raise UsageError("expected --board or --points")
    if bool(options.points) != bool(options.seen or options.tags):
        raise UsageError("expected --points together with --seen or --tags")
    if not options.board and not options.intrinsics:
        raise UsageError("known points alone do not give the lenses: expected --intrinsics")
    if options.refine and not options.intrinsics:
        raise UsageError("--refine: expected --intrinsics, the lenses to refine")
    if options.tags and not options.pictures:
        raise UsageError("--tags: expected --pictures to look for them")
    if options.floor and not options.board:
        raise UsageError("--floor: expected --board")


def _shoot(
    options: LensOptions, board: Board | None, given: dict[str, Camera], tags: TagFinder | None
) -> tuple[BoardViews, list[View]]:
    """Reads the views of the board, and of tags at known places."""
    sizes = {c.id: (c.width_px, c.height_px) for c in given.values()}
    if options.corners:
        assert board is not None
        views = read_corners(options.corners, len(board.points_m))
        cameras = sorted({view.camera for view in views})
        for camera in cameras:
            size = sizes.get(camera, options.size)
            if size is None:
                raise UsageError(f"--corners: camera {camera}: give its --size, such as 1280x720")
            sizes[camera] = size
        counts = {c: sum(view.camera == c for view in views) for c in cameras}
        return BoardViews({c: sizes[c] for c in cameras}, views, counts), []
    if not options.pictures:
        return BoardViews(sizes, [], dict.fromkeys(sizes, 0)), []
    pictures = gather(options.pictures, options.every)
    if options.camera:
        pictures = [replace(picture, camera=options.camera) for picture in pictures]
    seen = {picture.camera for picture in pictures}
    for camera in sorted(seen if given else ()):
        if camera not in given:
            raise UsageError(f"--intrinsics: no camera file for {camera}, whose pictures are there")
    return _looked(pictures, board, sizes, tags)


def _looked(
    pictures: Sequence[PictureFile],
    board: Board | None,
    expected: dict[str, tuple[int, int]],
    tags: TagFinder | None,
) -> tuple[BoardViews, list[View]]:
    sizes: dict[str, tuple[int, int]] = {}
    counts: dict[str, int] = {}
    views: list[View] = []
    tagged = []

    def make() -> Callable[[Image], tuple[Corners | None, dict[str, Floats]]]:
        finder = CornerFinder(board) if board else None
        return lambda image: (
            finder.find(image) if finder else None,
            tags.find(image) if tags else {},
        )

    for file, size, (corners, middles) in inspect(pictures, make, _progress):
        wanted = expected.get(file.camera, sizes.setdefault(file.camera, size))
        sizes[file.camera] = wanted
        if size != wanted:
            raise UsageError(
                f"{file.path}: {size[0]} x {size[1]} px, expected {wanted[0]} x {wanted[1]} as in "
                f"the other pictures of {file.camera}"
            )
        counts[file.camera] = counts.get(file.camera, 0) + 1
        tagged.append((file.camera, middles))
        if corners is not None:
            views.append(View(file.camera, file.moment, *corners))
    _say(f"the board was found in {len(views)} of {counted(len(pictures), 'picture')}")
    return BoardViews(dict(sorted(sizes.items())), views, counts), tag_views(tagged)


def _keep_references(options: RigOptions, cameras: Sequence[str]) -> None:
    """Keeps what the cameras see beside their files: whether one was moved is seen by it."""
    pictures = gather(options.pictures, options.every) if options.pictures else []
    pictures = [replace(p, camera=options.camera or p.camera) for p in pictures]
    mine = [picture for picture in pictures if picture.camera in cameras]
    keep(options.output, cameras, backgrounds(mine))


def _thinned(shoot: BoardViews) -> BoardViews:
    """Spreads a limited number of views evenly: more are slower, not better."""
    views: list[View] = []
    for camera in shoot.sizes:
        mine = shoot.of(camera)
        step = max(1.0, len(mine) / _MOST_VIEWS)
        views += [mine[int(k * step)] for k in range(min(len(mine), _MOST_VIEWS))]
    return BoardViews(shoot.sizes, views, shoot.pictures)


def _deliver(
    options: LensOptions, title: str, solution: Solution, board: Board | None, views: Sequence[View]
) -> int:
    """Writes camera files and report, and tells of them."""
    folder = options.output
    lines, text = save(folder, title, solution, board, views)
    for line in lines:
        _say(line)
    _say(f"report: {folder / REPORT_FOLDER / 'report.png'}")
    files = [folder / f"{camera.id}.json" for camera in solution.cameras]
    print_data(text.rstrip("\n") if options.json else "\n".join(map(str, files)))
    return 0


def save(
    folder: Path, title: str, solution: Solution, board: Board | None, views: Sequence[View]
) -> tuple[list[str], str]:
    """Writes camera files into a folder and the report into its `REPORT_FOLDER`.

    Returns the report as lines for people, and as the text of its JSON file. Raises UsageError
    where something cannot be written.
    """
    used = {(view.camera, view.moment) for view in solution.views if view.used}
    check = None
    if board is not None and solution.bodies:
        seen = [view for view in views if (view.camera, view.moment) in used]
        check = check_board(solution.cameras, seen, board)
    text = json.dumps(_report.as_json(solution, board, check), indent=2) + "\n"
    subtitle = f"{board or 'known points'}: {solution.rms_px:.3f} px rms"
    image = _report.draw(title, subtitle, solution, board)
    try:
        (folder / REPORT_FOLDER).mkdir(parents=True, exist_ok=True)
        if views:
            write_corners(folder / REPORT_FOLDER / "corners.csv", views)
    except OSError as error:
        raise UsageError(f"{folder}: cannot be written: {error.strerror}") from None
    _write(folder / REPORT_FOLDER / "report.json", text.encode())
    _write(folder / REPORT_FOLDER / "report.png", cv2.imencode(".png", image)[1].tobytes())
    for camera in solution.cameras:
        _write(folder / f"{camera.id}.json", (camera.to_json() + "\n").encode())
    return _report.as_text(solution, check), text


class PictureCalibration:
    """Calibrates cameras from a board's pictures as they come, as `rig` does from files; a context
    that forgets the pictures that wait. `board` is as it was measured."""

    def __init__(self, board: Board, cameras: Iterable[Camera]) -> None:
        """Takes the board as it was measured, and the cameras, of which only the size counts."""
        self.board = board
        self._sizes = dict(sorted((c.id, (c.width_px, c.height_px)) for c in cameras))
        self._counts = dict.fromkeys(self._sizes, 0)
        self._looks: list[tuple[str, str, Future[Corners | None]]] = []
        self._finder = CornerFinder(board)
        # What is drawn next waits for nobody: corners are looked for beside it.
        self._looker = ThreadPoolExecutor(1)

    def __enter__(self) -> PictureCalibration:
        return self

    def __exit__(self, *exception: object) -> None:
        self._looker.shutdown(cancel_futures=True)

    def look(self, camera: str, moment: str, image: Image) -> None:
        """Takes an (h, w) uint8 picture; the caller does not change it any more."""
        self._counts[camera] += 1
        self._looks.append((camera, moment, self._looker.submit(self._finder.find, image)))

    def views(self) -> list[View]:
        """Waits for all pictures that were taken; gives where the board's corners are in them."""
        seen = ((camera, moment, look.result()) for camera, moment, look in self._looks)
        views = [View(camera, moment, *corners) for camera, moment, corners in seen if corners]
        return sorted(views, key=lambda view: (view.camera, view.moment))

    def solve(
        self, views: Sequence[View], flat: str, origin: tuple[float, float, float]
    ) -> Solution:
        """Finds all cameras; in the moments `flat` the board lies on the floor, first at `origin`.

        Raises CalibrationError where the pictures do not link the cameras.
        """
        shoot = BoardViews(self._sizes, views, self._counts)
        lenses = {c.id: lens_of(c) for c in calibrate_lenses(shoot, self.board).cameras}
        floor = FloorReference(flat=(flat,), origin=origin)
        return RigSolver(Rig(shoot, self.board, floor, lenses, Trust.FREE)).solve()

    def save(self, folder: Path, title: str, views: Sequence[View], solution: Solution) -> None:
        """Writes camera files and report; raises UsageError."""
        save(folder, title, solution, self.board, views)


def cameras_of(option: str, folder: Path) -> dict[str, Camera]:
    """Reads the camera files of a folder that an option names; raises UsageError."""
    if not os.path.isdir(folder):
        raise UsageError(f"{option} {folder}: no such folder")
    cameras: dict[str, Camera] = {}
    for path in sorted(folder.glob("*.json")):
        try:
            camera = Camera.from_json(read_text(path))
        except (OSError, ValueError) as error:
            raise UsageError(f"{path}: cannot be read: {error}") from None
        cameras[camera.id] = camera
    if not cameras:
        raise UsageError(f"{option} {folder}: no camera files (*.json)")
    return cameras


def _write(path: Path, data: bytes) -> None:
    try:
        path.write_bytes(data)
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror}") from None


def _progress(done: int, total: int) -> None:
    if sys.stderr.isatty():
        end = "\n" if done == total else ""
        print(f"\rlooking at pictures: {done} of {total}", end=end, file=sys.stderr, flush=True)


def _say(text: str) -> None:
    Console().say(text)
