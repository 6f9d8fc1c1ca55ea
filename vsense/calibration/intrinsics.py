"""The lens of one camera, from pictures of a board in many poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

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
from vsense.calibration.lens import LENS_SIZE, camera_of
from vsense.calibration.solution import (
    CalibrationError,
    Solution,
    ViewResult,
    assemble,
    bad_views,
    huber_limit_px,
    rms,
)
from vsense.calibration.start import first_lens, poses_in_camera
from vsense.calibration.views import Shoot, View

Floats = NDArray[np.float64]

CENTRE_SHARE = 0.1
DISTORTION_SIGMA = (1.0, 1.0, 0.02, 0.02, 1.0)
"""How far lenses are from no distortion at all: too weak to move what pictures do tell, strong
enough to keep k3 finite where no corner came near the picture's border."""
NOISE_PX = 0.1
"""Of a corner, for weighing that against pictures."""

_WIDE_PX = 20.0
_ROUNDS = 3


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


def lens_knowledge(sizes: Sequence[tuple[int, int]]) -> tuple[Floats, Floats]:
    """Returns what is known of any lens: mean and weight (c, 9), see `bundle.Knowledge`."""
    mean, weight = np.zeros((2, len(sizes), LENS_SIZE))
    for number, (width, height) in enumerate(sizes):
        mean[number, 2:4] = (width - 1) / 2.0, (height - 1) / 2.0
        weight[number, 2:4] = (NOISE_PX / (CENTRE_SHARE * width)) ** 2
        weight[number, 4:] = (NOISE_PX / np.array(DISTORTION_SIGMA)) ** 2
    return mean, weight


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
    sights = [(board.points_m[view.ids], view.pixels) for view in views]
    lens = first_lens(size, sights)
    used = np.ones(len(views), dtype=bool)
    estimate = None
    for _ in range(_ROUNDS):
        chosen = [view for view, use in zip(views, used) if use]
        seen = assemble(chosen, board, [camera], [view.moment for view in chosen])
        estimate, bundle, limit = _fit(size, seen, lens)
        lens = estimate.lenses[0]
        residuals = np.split(bundle.residuals(estimate), seen.start[1:-1])
        bad = bad_views(np.array([rms(r) for r in residuals]))
        if not bad.any() or used.sum() - bad.sum() < advice.LEAST_VIEWS:
            break
        used[np.flatnonzero(used)[bad]] = False
    assert estimate is not None
    variance = np.diag(bundle.covariance(estimate)[0])[POSE_SIZE:]
    noise = rms(np.concatenate(residuals)) / np.sqrt(2.0)
    sigma = noise * np.sqrt(np.maximum(variance, 0.0))
    moments = [view.moment for view in chosen]
    complaint = _complaint(size, estimate, lens, sigma)
    if complaint:
        raise CalibrationError(f"{camera}: {complaint}")
    found = dict(zip(moments, residuals))
    everything = [found.get(v.moment, _alone(lens, board, v)) for v in views]
    return LensFit(lens, sigma, views, everything, used.tolist())


def _complaint(
    size: tuple[int, int], estimate: Estimate, lens: Floats, sigma: Floats
) -> str | None:
    from vsense.calibration.start import Pose

    poses = [Pose(t, s) for t, s in zip(estimate.body_turn, estimate.body_shift)]
    return advice.too_flat(poses) or advice.too_vague(size, lens, sigma)
