"""The precise corners of square markers: a line through each side's edge, intersected.

All quadrilaterals of a picture are fitted together. Each side is sampled along its length; each
sample looks along the side's normal for the step from black to white.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats

_CORNER = 0.08
_GLANCES = np.linspace(0.15, 0.85, 6)
"""Places along a side, as shares of it."""
_FOUND = 0.3
_ENDS = 3
_ROBUST_PASSES = 3
_LONG_PX = 80.0
_CORNER_REACH_PX = 5
_CORNER_MOVE_PX = 2.0
_BENT_REACH_PX, _BENT_SAMPLES, _BENT_STEPS, _BENT_PASSES = 3.0, 24, 13, 2
_BENT_SHARE = 0.7
_MOST_ROWS = 16384
"""OpenCV counts the rows of what it samples in 16 bits."""
_CORNER_STEPS = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 30, 1e-3)


class Sides(NamedTuple):
    """Fitted quadrilaterals, n of them; side k leads from corner k to the next, clockwise.

    Attributes:
        corners_px: (n, 4, 2).
        contrast: (n, 4) height of the edge between the black of each side and the white around it.
        step: (n, 4) mean difference between outside and inside; in mere noise this is zero.
        coverage: (n, 4) share of the side's samples that found their edge.
        residual_px: (n, 4) root mean square distance of the edges found to the line.
        blur_px: (n, 4) standard deviation of the point spread across each side.
    """

    corners_px: Floats
    contrast: Floats
    step: Floats
    coverage: Floats
    residual_px: Floats
    blur_px: Floats

    def keep(self, where: NDArray[np.bool_] | NDArray[np.intp] | slice) -> Sides:
        return Sides(*(values[where] for values in self))


def glance(image: NDArray[np.uint8], quads: Floats, reach_px: Floats) -> Floats:
    """Returns how much lighter it is outside of each side than inside, (n, 4); see `fit_sides`."""
    side, normal, _ = _frames(quads)
    points = quads[:, :, np.newaxis] + _GLANCES[:, np.newaxis] * side[:, :, np.newaxis]
    profiles = _profiles(image, points, normal, reach_px[..., np.newaxis], 2)
    return np.asarray((profiles[..., 1] - profiles[..., 0]).mean(axis=2))


def fit_sides(
    image: NDArray[np.uint8], quads: Floats, reach_px: Floats, samples: int, steps: int
) -> Sides:
    """Moves each quadrilateral's sides once to where its edges are.

    Args:
        image: (height, width) uint8.
        quads: (n, 4, 2) pixels, clockwise in the picture, n > 0.
        reach_px: (n, 4) how far to look inwards and outwards.
        samples: How many normals per side.
        steps: Grey values along each normal.
    """
    side, normal, middle = _frames(quads)
    along = np.linspace(2.0 * _CORNER - 1.0, 1.0 - 2.0 * _CORNER, samples)
    points = middle[:, :, np.newaxis] + 0.5 * along[:, np.newaxis] * side[:, :, np.newaxis]
    reach = reach_px[..., np.newaxis]
    profiles = _profiles(image, points, normal, reach, steps)
    rise = np.maximum(np.diff(profiles, axis=-1), 0.0)
    offset, height, where = _edges(rise, steps)
    offset = offset * reach
    contrast = np.median(height, axis=-1)
    share = height / np.maximum(contrast, 1e-3)[..., np.newaxis]
    weight = np.where(share > _FOUND, np.minimum(share, 1.5), 0.0)
    line, residual = _fit_powers(along, offset, weight, 2)
    return Sides(
        corners_px=_intersect(middle, side, normal, line),
        contrast=contrast,
        step=(profiles[..., -_ENDS:] - profiles[..., :_ENDS]).mean(axis=(2, 3)),
        coverage=(share > _FOUND).mean(axis=-1),
        residual_px=residual,
        blur_px=_edge_deviation(rise, where) * reach_px,
    )


def fit_local_corners(image: NDArray[np.uint8], quads: Floats) -> Floats:
    """Moves the corners of (n, 4, 2) quadrilaterals with bent sides by the picture near them.

    Large quadrilaterals have enough of a picture around each corner; small ones need their whole
    sides, as parabolas where they are no lines.
    """
    side = np.roll(quads, -1, axis=1) - quads
    long = np.hypot(side[..., 0], side[..., 1]).min(axis=1) > _LONG_PX
    result: Floats = quads.copy()
    if long.any():
        start = quads[long].reshape(-1, 1, 2).astype(np.float32)
        window = (_CORNER_REACH_PX, _CORNER_REACH_PX)
        fitted = np.asarray(cv2.cornerSubPix(image, start.copy(), window, (-1, -1), _CORNER_STEPS))
        near = np.abs(fitted - start).max(axis=2, keepdims=True) < _CORNER_MOVE_PX
        result[long] = np.where(near, fitted, start).reshape(-1, 4, 2)
    if not long.all():
        small = quads[~long]
        for _ in range(_BENT_PASSES):
            bent = _fit_bent(image, small)
            near = np.abs(bent - quads[~long]).max(axis=2, keepdims=True) < _CORNER_MOVE_PX
            small = np.where(near, bent, quads[~long])
        result[~long] = small
    return result


def _fit_bent(image: NDArray[np.uint8], quads: Floats) -> Floats:
    """Moves corners to where the sides' tangents meet at their ends."""
    side, normal, middle = _frames(quads)
    along = np.linspace(2.0 * _CORNER - 1.0, 1.0 - 2.0 * _CORNER, _BENT_SAMPLES)
    points = middle[:, :, np.newaxis] + 0.5 * along[:, np.newaxis] * side[:, :, np.newaxis]
    reach = np.full((*quads.shape[:2], 1), _BENT_REACH_PX)
    profiles = _profiles(image, points, normal, reach, _BENT_STEPS)
    offset, height, _ = _edges(np.maximum(np.diff(profiles, axis=-1), 0.0), _BENT_STEPS)
    contrast = np.median(height, axis=-1, keepdims=True)
    share = height / np.maximum(contrast, 1e-3)
    weight = np.where(share > _FOUND, np.minimum(share, 1.5), 0.0)
    line, straight_px = _fit_powers(along, offset * reach, weight, 2)
    arc, bent_px = _fit_powers(along, offset * reach, weight, 3)
    # A parabola always fits a little better than a line; a bend does so by far.
    is_bent = bent_px < _BENT_SHARE * straight_px
    flat = np.concatenate((line, np.zeros_like(line[..., :1])), axis=-1)
    shape = np.where(is_bent[..., np.newaxis], arc, flat)
    ends = []
    for end in (-1.0, 1.0):
        rise = shape[..., 0] + end * shape[..., 1] + shape[..., 2]
        slope = shape[..., 1] + 2.0 * end * shape[..., 2]
        at = middle + 0.5 * end * side + rise[..., np.newaxis] * normal
        ends.append((at, 0.5 * side + slope[..., np.newaxis] * normal))
    (here, ahead), (there, before) = ends
    return _meet(here, ahead, np.roll(there, 1, axis=1), np.roll(before, 1, axis=1))


def _frames(quads: Floats) -> tuple[Floats, Floats, Floats]:
    """Returns each side, its outward normal, and its middle, (n, 4, 2) each."""
    side = np.roll(quads, -1, axis=1) - quads
    length = np.maximum(np.hypot(side[..., 0], side[..., 1]), 1e-6)
    ahead = side / length[..., np.newaxis]
    normal = np.stack((ahead[..., 1], -ahead[..., 0]), axis=-1)
    return side, normal, quads + 0.5 * side


def _profiles(
    image: NDArray[np.uint8], points: Floats, normal: Floats, reach: Floats, steps: int
) -> NDArray[np.float32]:
    """Returns (n, 4, samples, steps) grey values from inside to outside."""
    across = (np.linspace(-1.0, 1.0, steps) * reach)[..., np.newaxis] * normal[:, :, np.newaxis]
    # Single numbers, as OpenCV takes them: half the memory.
    start, steps_px = points.astype(np.float32), across.astype(np.float32)
    return sample_grey(image, start[:, :, :, np.newaxis] + steps_px[:, :, np.newaxis])


def sample_grey(
    image: NDArray[np.uint8], points_px: Floats | NDArray[np.float32]
) -> NDArray[np.float32]:
    """Returns the interpolated grey values at (n, ..., 2) pixels, n > 0, as float32.

    A point outside of the picture gets its nearest pixel's.
    """
    shape = points_px.shape[:-1]
    x, y = np.moveaxis(points_px.reshape(shape[0], -1, 2).astype(np.float32, copy=False), -1, 0)
    grey = np.empty(x.shape, dtype=np.float32)
    for first in range(0, shape[0], _MOST_ROWS):
        rows = slice(first, first + _MOST_ROWS)
        maps = np.ascontiguousarray(x[rows]), np.ascontiguousarray(y[rows])
        grey[rows] = cv2.remap(image, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return grey.reshape(shape)


def _edges(rise: NDArray[np.float32], steps: int) -> tuple[Floats, Floats, Floats]:
    """Finds the steepest rise of each profile, and its centroid.

    Returns the place in [-1, 1] and the height of each edge, and the places of the differences.
    """
    where = np.linspace(-1.0, 1.0, 2 * steps - 1)[1::2]
    steep = rise**2
    rough = np.einsum("nksp,p->nks", steep, where) / np.maximum(steep.sum(axis=-1), 1e-6)
    near = np.where(np.abs(where - rough[..., np.newaxis]) < 0.5, rise, 0.0)
    height = near.sum(axis=-1)
    return np.einsum("nksp,p->nks", near, where) / np.maximum(height, 1e-6), height, where


def _edge_deviation(rise: NDArray[np.float32], where: Floats) -> Floats:
    """Returns (n, 4) standard deviations of each side's median edge, in units of the reach."""
    shape = np.median(rise, axis=2).astype(np.float64)
    total = np.maximum(shape.sum(axis=-1), 1e-6)
    mean = (shape @ where) / total
    variance = (shape * (where - mean[..., np.newaxis]) ** 2).sum(axis=-1) / total
    return np.asarray(np.sqrt(variance))


def _fit_powers(
    along: Floats, offset: Floats, weight: Floats, powers: int
) -> tuple[Floats, Floats]:
    """Fits offset = a + b s + ... to each side by robust least squares, s in [-1, 1].

    Returns (n, 4, powers) coefficients, and (n, 4) root mean square residuals.
    """
    terms = along[:, np.newaxis] ** np.arange(powers)
    products = terms[:, :, np.newaxis] * terms[:, np.newaxis, :]
    trust = weight
    for _ in range(_ROBUST_PASSES):
        left = np.einsum("nks,sij->nkij", trust, products) + 1e-9 * np.eye(powers)
        right = np.einsum("nks,si->nki", trust * offset, terms)
        line = np.linalg.solve(left, right[..., np.newaxis])[..., 0]
        miss = np.abs(offset - np.einsum("nki,si->nks", line, terms))
        scale = 1.5 * np.median(miss, axis=-1, keepdims=True) + 0.03
        trust = weight / (1.0 + (miss / (2.0 * scale)) ** 2)
    count = np.maximum((weight > 0.0).sum(axis=-1), 1)
    residual = np.sqrt(((weight > 0.0) * miss**2).sum(axis=-1) / count)
    return np.asarray(line), np.asarray(residual)


def _intersect(middle: Floats, side: Floats, normal: Floats, line: Floats) -> Floats:
    """Returns where each side's line meets the previous side's."""
    here = middle + line[..., :1] * normal
    forwards = 0.5 * side + line[..., 1:] * normal
    return _meet(here, forwards, np.roll(here, 1, axis=1), np.roll(forwards, 1, axis=1))


def _meet(here: Floats, forwards: Floats, there: Floats, back: Floats) -> Floats:
    """Returns where lines through `here` meet those through `there`, (n, 4, 2) each."""
    cross = forwards[..., 0] * back[..., 1] - forwards[..., 1] * back[..., 0]
    gap = there - here
    share = gap[..., 0] * back[..., 1] - gap[..., 1] * back[..., 0]
    share = share / np.where(np.abs(cross) < 1e-6, np.inf, cross)
    return np.asarray(here + share[..., np.newaxis] * forwards)
