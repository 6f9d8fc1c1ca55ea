"""The lab's cameras as people have real ones: hung by hand, and known from pictures of a board.

`vsense lab --calibrate` draws how each camera hangs and what its lens is like, renders a board for
those cameras, does on the pictures what `vsense camera calibrate rig` does, and tracks with what
that has found. The robots are rendered through the true cameras all the while.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats, wrap_angle
from vsense.base.shared import file_errors
from vsense.modes.lab.board_studio import HELD_UP, ON_FLOOR, BoardStudio, board_plan
from vsense.vision.calibration.board import Board
from vsense.vision.calibration.frame import FrameShift, turn
from vsense.vision.calibration.session import PictureCalibration
from vsense.vision.cameras.camera import Camera
from vsense.world.entities import Arena

_Say = Callable[[str], None]
Origin = tuple[float, float, float]

BOARD = "charuco:7x5:80mm:4X4_50"
CAMERAS_FOLDER = "cameras"
"""In the runs' folder: files as of `vsense camera calibrate rig`, and the true cameras in
`truth`."""

HUNG_M = 0.015
"""A camera hangs up to so far from its place, along each axis."""
TILT_RAD = float(np.radians(1.5))
"""About each horizontal axis, up to; twice that about the vertical."""
FOCAL_SHARE = 0.01
MIDDLE_PX = 8.0
"""Of the principal point, from the picture's middle, up to."""
DISTORTION_SHARE = 0.1
TANGENTIAL = 3e-4
"""p1 and p2, up to."""
LAID_M, LAID_RAD = 0.001, float(np.radians(0.1))
"""The first board lies up to so far from where its measures say, along x and y, and turned."""
PRINTED_SHARE = 5e-4
"""Its squares are up to so much larger or smaller than they were measured: 0.3 mm in 560."""

_SHARES = (1.0, 0.5, 0.25, 0.0)
_MARGIN_M = 0.04
_STEP_M = 0.05
_AHEAD_M = 0.02
_USUAL = 4
"""Cameras for which the pictures of `vsense camera calibrate example` are enough."""


@dataclass(frozen=True, slots=True)
class CalibratedRig:
    """The lab's cameras as they are and as they are known, both in one order.

    `figures` say how good that is; see `errors`.
    """

    true: tuple[Camera, ...]
    solved: tuple[Camera, ...]
    figures: dict[str, Any]

    @property
    def checked(self) -> dict[str, Any]:
        """The figures as `vision/calibration/checked.py` gives those of real cameras."""
        names = ("points", "rms_mm", "worst_mm", "shape_rms_mm")
        ours = ("points", "position_rms_mm", "position_worst_mm", "shape_rms_mm")
        check = {name: self.figures[our] for name, our in zip(names, ours)}
        when = "against the truth"
        return {"checked": True, "unchecked": [], "stale": [], "checks": [{"when": when, **check}]}

    def in_words(self) -> str:
        """The figures as a line for people."""
        f = self.figures
        apart = f["overlap_rms_mm"]
        between = "" if apart is None else f", {apart} mm between two cameras"
        return (
            f"calibrated from {f['views']} pictures, {f['rms_px']} px rms: places are right to"
            f" {f['position_rms_mm']} mm rms ({f['position_worst_mm']} mm at worst), headings to"
            f" {f['heading_rms_deg']} deg rms{between}; {f['shape_rms_mm']} mm but for where the"
            " first board lay"
        )


def calibrate(
    ideal: Sequence[Camera], arena: Arena, height_m: float, seed: int, folder: Path, say: _Say
) -> CalibratedRig:
    """Hangs cameras, calibrates them, and writes `CAMERAS_FOLDER` in a folder.

    Args:
        ideal: where the cameras are to be.
        arena: what they have to see.
        height_m: of the markers above the floor, for which the figures are.
        seed: of the errors, the board's poses and the noise.
        say: takes a line for people; does not wait.

    Raises:
        CalibrationError: the pictures do not link the cameras.
        VsenseError: a file cannot be written.
    """
    true = as_hung(ideal, arena, height_m, seed)
    output = folder / CAMERAS_FOLDER
    with file_errors(f"calibration {output}"):
        (output / "truth").mkdir(parents=True, exist_ok=True)
        for camera in true:
            (output / "truth" / f"{camera.id}.json").write_text(camera.to_json() + "\n")
    with PictureCalibration(Board.parse(BOARD), true) as calibration:
        origin = _take_pictures(calibration, true, seed, say)
        views = calibration.views()
    say("calibrating the cameras: solving")
    solution = calibration.solve(views, "floor_*", origin)
    calibration.save(output, f"The lab's {len(true)} cameras", views, solution)
    by_name = {camera.id: camera for camera in solution.cameras}
    solved = tuple(by_name[camera.id] for camera in true)
    figures = {
        "seed": seed,
        "views": len([view for view in solution.views if view.used]),
        "rms_px": round(solution.rms_px, 4),
        "points": len(_places(arena, height_m)),
        **errors(true, solved, arena, height_m),
    }
    with file_errors(f"calibration {output}"):
        (output / "truth" / "errors.json").write_text(json.dumps(figures, indent=2) + "\n")
    return CalibratedRig(true, solved, figures)


def as_hung(
    ideal: Sequence[Camera], arena: Arena, height_m: float, seed: int
) -> tuple[Camera, ...]:
    """Draws how cameras hang, and their lenses; together they see all that they are to see.

    Whoever hangs cameras looks at their pictures: where some place would be out of all of them, the
    errors are half as large, and so on.
    """
    rng = np.random.default_rng([seed, 11])
    drawn = rng.uniform(-1.0, 1.0, (len(ideal), 14))
    places = _places(arena, height_m)
    seen = _sees(ideal, places, 0.0)
    for share in _SHARES[:-1]:
        hung = tuple(_hang(camera, share * row) for camera, row in zip(ideal, drawn))
        if _sees(hung, places, _MARGIN_M)[seen].all():
            return hung
    return tuple(ideal)


def _hang(camera: Camera, drawn: Floats) -> Camera:
    """One camera with (14,) errors from -1 to 1, times their greatest sizes."""
    about = turn(drawn[np.newaxis, :3] * (TILT_RAD, TILT_RAD, 2.0 * TILT_RAD))[0]
    rotation = about @ np.reshape(camera.rotation, (3, 3))
    k1, k2, _, _, k3 = camera.distortion
    distortion = (
        k1 * (1.0 + DISTORTION_SHARE * drawn[8]),
        k2 * (1.0 + DISTORTION_SHARE * drawn[9]),
        *(TANGENTIAL * drawn[10:12]).tolist(),
        k3,
    )
    focal = 1.0 + FOCAL_SHARE * drawn[6]
    return replace(
        camera,
        fx_px=camera.fx_px * float(focal),
        fy_px=camera.fy_px * float(focal * (1.0 + 0.1 * FOCAL_SHARE * drawn[12])),
        cx_px=camera.cx_px + MIDDLE_PX * float(drawn[7]),
        cy_px=camera.cy_px + MIDDLE_PX * float(drawn[13]),
        distortion=tuple(map(float, distortion)),
        rotation=tuple(rotation.ravel().tolist()),
        position_m=tuple((np.array(camera.position_m) + HUNG_M * drawn[3:6]).tolist()),
    )


def _take_pictures(
    calibration: PictureCalibration, true: Sequence[Camera], seed: int, say: _Say
) -> Origin:
    """Renders a board for the cameras; gives where its first pose is, as people measure that."""
    board, many = calibration.board, max(1.0, len(true) / _USUAL)
    drawn = np.random.default_rng([seed, 12]).uniform(-1.0, 1.0, 4)
    printed = replace(board, square_m=board.square_m * (1.0 + PRINTED_SHARE * float(drawn[3])))
    plan = board_plan(true, printed, round(ON_FLOOR * many), round(HELD_UP * many), seed)
    studio = BoardStudio(true, printed, seed)
    cv2.setNumThreads(1)
    for number, (moment, pose) in enumerate(plan, 1):
        for camera, image in studio.take(pose):
            calibration.look(camera, moment, image)
        say(f"calibrating the cameras: the board in {number} of {len(plan)} places")
    x, y, _ = plan[0][1].shift.tolist()
    x, y = x + LAID_M * float(drawn[0]), y + LAID_M * float(drawn[1])
    return x, y, LAID_RAD * float(drawn[2])


def errors(
    true: Sequence[Camera], solved: Sequence[Camera], arena: Arena, height_m: float
) -> dict[str, float | None]:
    """How far off a robot is for cameras that are known as `solved`, all over an arena.

    Returns `position_rms_mm`, `position_worst_mm`, `heading_rms_deg` and `heading_worst_deg`, of
    every camera by itself; `shape_rms_mm`, `shape_worst_mm`: of the places when the frame as a
    whole is where it fits best; and where two see one place, how far apart they see it:
    `overlap_rms_mm`, `overlap_worst_mm`, None where none do.
    """
    points = _places(arena, height_m)
    place = np.full((len(true), len(points), 2), np.nan)
    heading = np.full((len(true), len(points)), np.nan)
    for number, (camera, calibrated) in enumerate(zip(true, solved)):
        pixels = camera.project(points)
        seen = camera.contains(pixels)
        ahead = camera.project(points[seen] + (_AHEAD_M, 0.0, 0.0))
        place[number, seen] = here = calibrated.to_plane(pixels[seen], height_m)
        there = calibrated.to_plane(ahead, height_m) - here
        heading[number, seen] = wrap_angle(np.arctan2(there[:, 1], there[:, 0]))
    off = np.linalg.norm(place - points[:, :2], axis=-1)
    seen = np.isfinite(off)
    wanted = np.broadcast_to(points[:, :2], place.shape)[seen]
    best = FrameShift.between(place[seen], wanted)
    bent = np.linalg.norm(best.apply(place[seen]) - wanted, axis=-1)
    first, second = np.triu_indices(len(true), 1)
    apart = np.linalg.norm(place[first] - place[second], axis=-1)
    sizes = {
        "position_{}_mm": 1e3 * off,
        "heading_{}_deg": np.degrees(np.abs(heading)),
        "shape_{}_mm": 1e3 * bent,
        "overlap_{}_mm": 1e3 * apart,
    }
    return {
        name.format(how): of(values[np.isfinite(values)])
        for name, values in sizes.items()
        for how, of in (("rms", _rms), ("worst", _worst))
    }


def _rms(values: Floats) -> float | None:
    return round(float(np.sqrt((values**2).mean())), 3) if values.size else None


def _worst(values: Floats) -> float | None:
    return round(float(values.max()), 3) if values.size else None


def _places(arena: Arena, height_m: float) -> Floats:
    """(n, 3) places of markers, 5 cm apart."""
    axes = [
        np.linspace(c - s / 2.0, c + s / 2.0, max(2, round(s / _STEP_M) + 1))
        for c, s in zip(arena.centre_m[:2], arena.size_m[:2])
    ]
    flat = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    return np.column_stack((flat, np.full(len(flat), height_m)))


def _sees(cameras: Sequence[Camera], places: Floats, margin_m: float) -> NDArray[np.bool_]:
    """(n,) whether some camera sees each place, so far inside its picture."""
    seen = np.zeros(len(places), dtype=bool)
    for camera in cameras:
        margin_px = margin_m * camera.px_per_m(float(places[0, 2]))
        seen |= camera.contains(camera.project(places), margin_px)
    return seen
