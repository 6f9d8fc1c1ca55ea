"""The lens of one camera, from pictures of a board in many poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vsense.calibration import advice
from vsense.calibration.board import Board
from vsense.calibration.bundle import (
    CAMERA_SIZE,
    POSE_SIZE,
    Bundle,
    Estimate,
    Knowledge,
    Sightings,
)
from vsense.calibration.lens import LENS_SIZE, camera_of, project
from vsense.calibration.solution import (
    CalibrationError,
    Solution,
    ViewResult,
    assemble,
    bad_views,
    by_view,
    huber_limit_px,
    rms,
)
from vsense.calibration.start import Pose, first_lens, poses_in_camera
from vsense.calibration.views import Shoot, View

Floats = NDArray[np.float64]

CENTRE_SHARE = 0.1
DISTORTION_SIGMA = (1.0, 1.0, 0.02, 0.02, 1.0)
"""How far lenses are from no distortion at all: too weak to move what pictures do tell, strong
enough to keep k3 finite where no corner came near the picture's border."""
NOISE_PX = 0.1
"""Of a corner, for weighing that against pictures, until it is known better."""

_WIDE_PX = 20.0
_ROUNDS = 3
_FIRST = [0, 1, 4]
"""Focal lengths and k1."""


@dataclass(frozen=True, slots=True)
class LensFit:
    """A lens and the views it explains.

    Attributes:
        lens: (9,).
        sigma: (9,) its standard deviation.
        views: The same views as were given.
        residuals: (n, 2) per view, seen minus model [px].
        used: Per view, whether it took part.
    """

    lens: Floats
    sigma: Floats
    views: Sequence[View]
    residuals: Sequence[Floats]
    used: Sequence[bool]

    def results(self) -> list[ViewResult]:
        """The same view by view."""
        return [
            ViewResult(view.camera, view.moment, view.pixels, residuals, use)
            for view, residuals, use in zip(self.views, self.residuals, self.used)
        ]


def any_lens(size: tuple[int, int]) -> tuple[Floats, Floats]:
    """Returns (9,) mean and (9,) standard deviation of the lenses there are; focal length open."""
    width, height = size
    mean = np.array([0.0, 0.0, (width - 1) / 2.0, (height - 1) / 2.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    centre = CENTRE_SHARE * width
    return mean, np.array([np.inf, np.inf, centre, centre, *DISTORTION_SIGMA])


def calibrate_lens(
    camera: str, size: tuple[int, int], board: Board, views: Sequence[View], pictures: int
) -> LensFit:
    """Calibrates one lens.

    Args:
        camera: Name, for messages.
        size: Width and height of the pictures [px].
        board: The board.
        views: Where it was seen; bad ones are found and left out.
        pictures: How many pictures were taken.

    Raises:
        CalibrationError: The pictures do not tell the lens.
    """
    complaint = advice.too_few(size, views, pictures) or advice.too_central(size, views)
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
        if not bad.any() or len(bad) - bad.sum() < advice.LEAST_VIEWS:
            break
        used[np.flatnonzero(used)[bad]] = False
    variance = np.diag(bundle.covariance(estimate)[0])[POSE_SIZE:]
    sigma = rms(residuals) / np.sqrt(2.0) * np.sqrt(np.maximum(variance, 0.0))
    poses = [Pose(turn, shift) for turn, shift in zip(estimate.body_turn, estimate.body_shift)]
    complaint = advice.too_flat(poses) or advice.too_vague(size, lens, sigma)
    if complaint:
        raise CalibrationError(f"{camera}: {complaint}")
    split = iter(by_view(residuals, seen))
    each = [next(split) if use else _alone(lens, board, v) for v, use in zip(views, used)]
    return LensFit(lens, sigma, views, each, used.tolist())


def calibrate_lenses(shoot: Shoot, board: Board) -> Solution:
    """Calibrates the lens of every camera by itself.

    The cameras' poses mean nothing: each stands one metre above the floor and looks down.

    Raises:
        CalibrationError: The pictures of some cameras do not tell their lenses.
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
    sparse = [
        (camera, advice.too_central(shoot.sizes[camera], fit.views, advice.GOOD_SPAN))
        for camera, fit in fits.items()
    ]
    down, above = np.diag((1.0, -1.0, -1.0)), np.array((0.0, 0.0, 1.0))
    return Solution(
        cameras=tuple(camera_of(c, shoot.sizes[c], fits[c].lens, down, above) for c in fits),
        views=tuple(result for fit in fits.values() for result in fit.results()),
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
    # The picture's middle and the finer bends would run away from a bad first guess.
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
    """The residuals of a view that took no part, at the pose that suits it best."""
    points = board.points_m[view.ids]
    poses = poses_in_camera(lens, points, view.pixels)
    if not poses:
        return np.full((len(points), 2), np.nan)
    lenses = np.broadcast_to(lens, (len(points), LENS_SIZE))
    return np.asarray(view.pixels - project(lenses, poses[0].apply(points))[0])
