"""Tells whether pictures say enough about a lens, and what else to shoot."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vsense.calibration.start import Pose
from vsense.calibration.views import View

Floats = NDArray[np.float64]

LEAST_VIEWS = 5
"""Different poses of the board below which a lens is not calibrated."""
GOOD_VIEWS = "10 to 20"

_SAME_SHARE = 0.02
"""Two views whose corners are on average nearer than this share of the picture's diagonal
are the same pose."""
_LEAST_TILT_DEG = 12.0
LEAST_SPAN, GOOD_SPAN = 0.4, 0.7
"""The share of width and height that the corners of all views have to, and ought to, span."""
_WORST_FOCAL = 0.01
_WORST_CENTRE = 0.02


def distinct(size: tuple[int, int], views: Sequence[View]) -> list[View]:
    """Returns the views that show different poses of the board, one of each."""
    limit = _SAME_SHARE * float(np.hypot(*size))
    kept: list[View] = []
    for view in views:
        if all(_apart_px(view, other) > limit for other in kept):
            kept.append(view)
    return kept


def _apart_px(one: View, other: View) -> float:
    """Mean distance between the corners that two views have in common."""
    common, first, second = np.intersect1d(one.ids, other.ids, return_indices=True)
    if len(common) < 3:
        return float("inf")
    return float(np.linalg.norm(one.pixels[first] - other.pixels[second], axis=1).mean())


def too_few(size: tuple[int, int], views: Sequence[View], pictures: int) -> str | None:
    """What is missing if there are too few poses of the board, else None."""
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
    size: tuple[int, int], views: Sequence[View], least: float = LEAST_SPAN
) -> str | None:
    """What is missing if the board never came near the picture's border, else None.

    Args:
        size: Width and height [px].
        views: Where the board was seen.
        least: The share of width and height that its corners should span.
    """
    pixels = np.concatenate([view.pixels for view in views])
    span = np.ptp(pixels, axis=0) / size
    if np.all(span >= least):
        return None
    return (
        f"the board covers only {span[0]:.0%} of the picture's width and {span[1]:.0%} of its "
        "height; bring it into the corners too, where the lens bends most"
    )


def too_flat(poses: Sequence[Pose]) -> str | None:
    """What is missing if the board always had the same tilt, else None.

    Args:
        poses: The board's in the camera frame.
    """
    normals = np.array([pose.turn[:, 2] for pose in poses])
    cosine = np.clip(normals @ normals.T, -1.0, 1.0)
    spread = float(np.degrees(np.arccos(cosine.min())))
    if spread >= _LEAST_TILT_DEG:
        return None
    return (
        f"all views of the board have the same tilt within {spread:.0f} degrees, so focal length "
        "and distance cannot be told apart; tilt it by 20 to 45 degrees to each side"
    )


def too_vague(size: tuple[int, int], lens: Floats, sigma: Floats) -> str | None:
    """What is missing if the pictures leave the lens open, else None.

    Args:
        size: Width and height [px].
        lens: (9,).
        sigma: (9,) its standard deviation.
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
