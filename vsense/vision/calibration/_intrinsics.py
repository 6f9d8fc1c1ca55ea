"""The lens of one camera, from pictures of a board in many poses.

Where the pictures do not determine the lens, the message says what else to shoot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from vsense.base.arena import Floats
from vsense.vision.calibration._bundle import (
    CAMERA_SIZE,
    LENS_SIZE,
    POSE_SIZE,
    Bundle,
    Estimate,
    Knowledge,
    Sightings,
    camera_of,
    project,
)
from vsense.vision.calibration._placement import first_lens, poses_in_camera
from vsense.vision.calibration._solution import (
    CalibrationError,
    Solution,
    ViewResult,
    assemble,
    bad_views,
    by_view,
    huber_limit_px,
    rms,
)
from vsense.vision.calibration._views import BoardViews, View
from vsense.vision.calibration.board import Board
from vsense.vision.calibration.frame import BoardPose

LEAST_VIEWS = 5
"""Different poses of the board that a lens needs."""
GOOD_VIEWS = "10 to 20"

_SAME_SHARE = 0.02
"""Views are of the same pose if their corners differ by less than this share of the diagonal."""
_LEAST_TILT_DEG = 12.0
LEAST_SPAN, GOOD_SPAN = 0.4, 0.7
"""The share of width and height that the corners of all views must span, and should span."""
_WORST_FOCAL = 0.01
_WORST_CENTRE = 0.02


def distinct(size: tuple[int, int], views: Sequence[View]) -> list[View]:
    """Returns one view of each different pose of the board."""
    limit = _SAME_SHARE * float(np.hypot(*size))
    chosen: list[View] = []
    for view in views:
        if all(_apart_px(view, other) > limit for other in chosen):
            chosen.append(view)
    return chosen


def _apart_px(view: View, other: View) -> float:
    """Mean distance between the corners that two views have in common."""
    common, first, second = np.intersect1d(view.ids, other.ids, return_indices=True)
    if len(common) < 3:
        return float("inf")
    return float(np.linalg.norm(view.pixels[first] - other.pixels[second], axis=1).mean())


def too_few(size: tuple[int, int], views: Sequence[View], pictures: int) -> str | None:
    """Returns what to do if there are too few poses of the board, else None."""
    if not views:
        return f"the board was found in none of {pictures} pictures; check --board, light and focus"
    poses = len(distinct(size, views))
    if poses >= LEAST_VIEWS:
        return None
    if len(views) >= LEAST_VIEWS:
        return (
            f"{len(views)} pictures show only {poses} different places of the board; "
            f"move it, shoot {GOOD_VIEWS} different ones"
        )
    return (
        f"the board was found in {len(views)} of {pictures} pictures; shoot {GOOD_VIEWS}, "
        "all over the picture and tilted"
    )


def too_central(
    size: tuple[int, int], views: Sequence[View | ViewResult], least: float = LEAST_SPAN
) -> str | None:
    """Returns what to do if the board never came near the picture's border, else None.

    `least` is the share of width and height that its corners should span.
    """
    pixels = np.concatenate([view.pixels for view in views])
    span = np.ptp(pixels, axis=0) / size
    if np.all(span >= least):
        return None
    return (
        f"the board covers only {span[0]:.0%} of the picture's width and {span[1]:.0%} of its "
        "height; bring it into the corners too, where the lens bends most"
    )


def too_flat(poses: Sequence[BoardPose]) -> str | None:
    """Returns what to do if the board's poses in the camera frame have one tilt, else None."""
    normals = np.array([pose.turn[:, 2] for pose in poses])
    cosine = np.clip(normals @ normals.T, -1.0, 1.0)
    spread = float(np.degrees(np.arccos(cosine.min())))
    if spread >= _LEAST_TILT_DEG:
        return None
    return (
        f"all views of the board have the same tilt within {spread:.0f} degrees, so focal length "
        "and distance cannot be separated; tilt it by 20 to 45 degrees to each side"
    )


def too_vague(size: tuple[int, int], lens: Floats, sigma: Floats) -> str | None:
    """Returns what to do if the pictures leave the (9,) lens open, else None.

    `size` is in px, `sigma` is the (9,) standard deviation.
    """
    focal = float(np.max(sigma[:2] / lens[:2]))
    centre = float(np.max(sigma[2:4]) / size[0])
    if focal <= _WORST_FOCAL and centre <= _WORST_CENTRE:
        return None
    return (
        f"the pictures leave the focal length open by {focal:.1%} and the picture's middle by "
        f"{centre * size[0]:.0f} px; shoot {GOOD_VIEWS}, near, all over the picture, and tilted "
        "by 20 to 45 degrees to each side"
    )


CENTRE_SHARE = 0.1
DISTORTION_SIGMA = (1.0, 1.0, 0.02, 0.02, 1.0)
"""Weak prior of no distortion, which keeps k3 finite where no corner is near the border."""
NOISE_PX = 0.1
"""First guess of a corner's noise, for the weights of prior knowledge."""

_WIDE_PX = 20.0
_ROUNDS = 3
_FIRST = [0, 1, 4]
"""Focal lengths and k1."""


@dataclass(frozen=True, slots=True)
class LensFit:
    """A (9,) lens, its (9,) standard deviation, and the views that it explains."""

    lens: Floats
    sigma: Floats
    views: Sequence[ViewResult]


def any_lens(size: tuple[int, int]) -> tuple[Floats, Floats]:
    """Returns (9,) mean and (9,) standard deviation of all lenses there are; focal length open."""
    width, height = size
    mean = np.array([0.0, 0.0, (width - 1) / 2.0, (height - 1) / 2.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    centre = CENTRE_SHARE * width
    return mean, np.array([np.inf, np.inf, centre, centre, *DISTORTION_SIGMA])


def calibrate_lens(
    camera: str, size: tuple[int, int], board: Board, views: Sequence[View], pictures: int
) -> LensFit:
    """Calibrates the lens of a camera whose pictures have a size [px].

    `pictures` were taken, `views` are those with a board; bad views are found and left out.

    Raises:
        CalibrationError: The pictures do not determine the lens.
    """
    complaint = too_few(size, views, pictures) or too_central(size, views)
    if complaint:
        raise CalibrationError(f"{camera}: {complaint}")
    lens = first_lens(size, [(board.points_m[view.ids], view.pixels) for view in views])
    used = np.ones(len(views), dtype=bool)
    for _ in range(_ROUNDS):
        chosen = [view for view, use in zip(views, used) if use]
        points = [board.points_m[view.ids] for view in chosen]
        seen = assemble(chosen, points, [camera], [view.moment for view in chosen])
        estimate, bundle = _fit(size, seen, lens)
        lens = estimate.lenses[0]
        residuals = bundle.residuals(estimate)
        bad = bad_views(np.array([rms(r) for r in by_view(residuals, seen)]))
        if not bad.any() or len(bad) - bad.sum() < LEAST_VIEWS:
            break
        used[np.flatnonzero(used)[bad]] = False
    variance = np.diag(bundle.covariance(estimate)[0])[POSE_SIZE:]
    sigma = rms(residuals) / np.sqrt(2.0) * np.sqrt(np.maximum(variance, 0.0))
    poses = [BoardPose(turn, shift) for turn, shift in zip(estimate.body_turn, estimate.body_shift)]
    complaint = too_flat(poses) or too_vague(size, lens, sigma)
    if complaint:
        raise CalibrationError(f"{camera}: {complaint}")
    split = iter(by_view(residuals, seen))
    results = [
        ViewResult(
            v.camera, v.moment, v.pixels, next(split) if use else _alone(lens, board, v), use
        )
        for v, use in zip(views, used.tolist())
    ]
    return LensFit(lens, sigma, results)


def calibrate_lenses(shoot: BoardViews, board: Board) -> Solution:
    """Calibrates the lens of every camera by itself.

    The cameras' poses mean nothing: each stands one metre above the floor and looks down.

    Raises:
        CalibrationError: The pictures of some cameras do not determine their lenses.
    """
    fits: dict[str, LensFit] = {}
    complaints = []
    for camera, size in shoot.sizes.items():
        try:
            views = shoot.of(camera)
            fits[camera] = calibrate_lens(camera, size, board, views, shoot.pictures[camera])
        except CalibrationError as error:
            complaints.append(str(error))
    if complaints:
        raise CalibrationError("; ".join(complaints))
    sparse = [(c, too_central(shoot.sizes[c], fit.views, GOOD_SPAN)) for c, fit in fits.items()]
    down, above = np.diag((1.0, -1.0, -1.0)), np.array((0.0, 0.0, 1.0))
    return Solution(
        cameras=tuple(camera_of(c, shoot.sizes[c], fits[c].lens, down, above) for c in fits),
        views=tuple(view for fit in fits.values() for view in fit.views),
        lens_sigma={camera: fit.sigma for camera, fit in fits.items()},
        floor_sigma_m={},
        bodies={},
        notes=tuple(f"{camera}: {note}" for camera, note in sparse if note),
    )


def _fit(size: tuple[int, int], seen: Sightings, lens: Floats) -> tuple[Estimate, Bundle]:
    """Adjusts one lens and all poses of the board in front of it."""
    estimate = Estimate(
        lens[np.newaxis], np.eye(3)[np.newaxis], np.zeros((1, 3)), *_board_poses(lens, seen)
    )
    bodies = len(seen.camera)
    mean, sigma = any_lens(size)
    free = np.zeros((1, CAMERA_SIZE), dtype=bool)
    everything = Knowledge(
        free,
        np.ones((bodies, POSE_SIZE), dtype=bool),
        mean[np.newaxis],
        ((NOISE_PX / sigma) ** 2)[np.newaxis],
        *np.zeros((2, bodies, 3)),
    )
    # The principal point and the higher terms would diverge from a bad first guess.
    for numbers in (_FIRST, slice(0, LENS_SIZE)):
        free = free.copy()
        free[:, POSE_SIZE:][:, numbers] = True
        knowledge = replace(everything, camera_free=free)
        estimate = Bundle(seen, knowledge, _WIDE_PX).solve(estimate)
    limit = huber_limit_px(Bundle(seen, knowledge, _WIDE_PX).residuals(estimate))
    bundle = Bundle(seen, knowledge, limit)
    return bundle.solve(estimate), bundle


def _board_poses(lens: Floats, seen: Sightings) -> tuple[Floats, Floats]:
    """Turns and shifts of the board in the camera frame, one per view."""
    turns = np.tile(np.diag((1.0, -1.0, -1.0)), (len(seen.camera), 1, 1))
    shifts = np.tile((0.0, 0.0, 1.0), (len(seen.camera), 1))
    for number, (first, last) in enumerate(pairwise(seen.start)):
        poses = poses_in_camera(lens, seen.points[first:last], seen.pixels[first:last])
        if poses:
            turns[number], shifts[number] = poses[0].turn, poses[0].shift
    return turns, shifts


def _alone(lens: Floats, board: Board, view: View) -> Floats:
    """The residuals of a view that took no part, at its best pose."""
    points = board.points_m[view.ids]
    poses = poses_in_camera(lens, points, view.pixels)
    if not poses:
        return np.full((len(points), 2), np.nan)
    lenses = np.broadcast_to(lens, (len(points), LENS_SIZE))
    return np.asarray(view.pixels - project(lenses, poses[0].apply(points))[0])
