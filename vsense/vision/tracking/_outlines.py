"""Outlines: what the picture kernel fits to the picture, made from a marker family.

An arrow's pose is that of its disc, a square's that of its middle and of its upright direction;
`struct vs_words` has the way from there to the disc.

The residuals of an outline's samples give the error of each of them; the outline's shape gives the
resulting error of place and heading. Blur adds an error of its own where white cells or the disc's
rim shine through to the edge.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats
from vsense.base.native import kernel_ffi, kernels
from vsense.vision.markers._dictionary import FamilyError
from vsense.vision.markers.families import BLURS_U, SPOTS, MarkerFamily, SquareFamily, normal_share

Pass = tuple[float, int, int, float, float]
"""How far to look [u], in how many steps, every how many samples, the least coverage and the
greatest residual [u]."""

EDGE_REACH_U = 0.6
"""How far an edge is looked at to both sides in the last pass."""
_NEAR_U = 0.25
_SPACING_U = 0.4
_CORNER_U = 0.6
_SIDE_SAMPLES = 21
"""Along each side of a square. Every third from the second on is as near to the one end as to the
other, so that what blur does to all of them does not turn the square."""
_SAMPLES_MIN = 8


_RIGHT = 1e-6


class OutlineShape(NamedTuple):
    """A convex black outline on white; lengths are in its own frame.

    Attributes:
        name: The family's.
        polygon_mm: (n, 2) its corners, counter-clockwise.
        unit_mm: The length in which passes are given.
        spacing_mm: Between samples.
        first: Which sample of a side is its first; the others follow, and those before it at last.
        origin_mm: (2,) the point whose place is fitted.
        rim_mm: (k, 2) what must lie in the picture.
        cells_mm: (cells, 2) the middles of the cells that are read with it.
        cell_mm: Their side.
        frame_mm: Least width of the black around the cells.
    """

    name: str
    polygon_mm: Floats
    unit_mm: float
    spacing_mm: float
    first: int
    origin_mm: Floats
    rim_mm: Floats
    cells_mm: Floats
    cell_mm: float
    frame_mm: float

    @property
    def area_mm2(self) -> float:
        """Area of the outline, its cells included."""
        x, y = self.polygon_mm.T
        return float(0.5 * (x * np.roll(y, -1) - np.roll(x, -1) * y).sum())

    @property
    def centroid_mm(self) -> Floats:
        """Centroid of the outline, its cells included, (2,)."""
        corners = self.polygon_mm
        after = np.roll(corners, -1, axis=0)
        cross = corners[:, 0] * after[:, 1] - after[:, 0] * corners[:, 1]
        total = ((corners + after) * cross[:, np.newaxis]).sum(axis=0)
        return np.asarray(total / (6.0 * self.area_mm2))

    @property
    def length_mm(self) -> float:
        """Distance of the two corners that are farthest apart."""
        return max(float(np.hypot(*(a - b))) for a in self.polygon_mm for b in self.polygon_mm)

    def right_angles(self) -> tuple[Floats, float]:
        """Returns its right angles, and the length of the shortest side at one of them [m].

        (n, 4): the corner from `origin_mm` [m], and the unit vector from it between the two sides.
        Where a quarter turn maps them on each other the first is enough.
        """
        corners = self.polygon_mm
        sides = np.roll(corners, -1, axis=0) - corners
        lengths = np.hypot(*sides.T)
        out = sides / lengths[:, np.newaxis]
        back = -np.roll(out, 1, axis=0)
        is_right = np.abs((out * back).sum(axis=1)) < _RIGHT
        shortest = np.minimum(lengths, np.roll(lengths, 1))[is_right].min(initial=np.inf)
        places_m = 1e-3 * (corners - self.origin_mm)
        angles = np.column_stack((places_m, (out + back) / np.sqrt(2.0)))
        return angles[is_right][: 1 if is_right.all() else None], 1e-3 * float(shortest)


def shape_of(family: MarkerFamily | SquareFamily) -> OutlineShape:
    """Returns the outline of a family's markers."""
    if isinstance(family, SquareFamily):
        corners = 0.5 * family.size_mm * np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])
        none = np.zeros((0, 2))
        cell = family.cell_mm
        spacing = (family.size_mm - 2.0 * _CORNER_U * cell) / (_SIDE_SAMPLES - 1)
        return OutlineShape(
            family.name, corners, cell, spacing, 1, np.zeros(2), corners, none, cell, cell
        )
    turn = 2.0 * np.pi / kernels.VS_OUTLINE_RIM * np.arange(kernels.VS_OUTLINE_RIM)
    rim = 0.5 * family.disc_diameter_mm * np.stack((np.cos(turn), np.sin(turn)), axis=1)
    return OutlineShape(
        family.name,
        family.polygon_mm,
        family.unit_mm,
        _SPACING_U * family.unit_mm,
        0,
        family.disc_centre_mm,
        family.disc_centre_mm + rim,
        family.cells_mm,
        family.cell_mm,
        _frame_mm(family),
    )


def _frame_mm(family: MarkerFamily) -> float:
    """Returns how near an arrow's cells come to its outline."""
    half = 0.5 * family.grid * family.cell_mm
    cells = np.array([(-half, -half), (half, -half), (half, half), (-half, half)])
    corners = family.polygon_mm
    edges = np.roll(corners, -1, axis=0) - corners
    offsets = cells[:, np.newaxis] - corners
    inwards = edges[:, 0] * offsets[..., 1] - edges[:, 1] * offsets[..., 0]
    return float((inwards / np.hypot(*edges.T)).min())


def make_outline(
    shape: OutlineShape,
    passes: Sequence[Pass],
    scale_doubt: float,
    least_contrast: float,
    finer: float = 1.0,
) -> Any:
    """Returns the `struct vs_outline` of a shape, see `c_src/host/vs_markers.h`.

    Passes look in so many more steps, as far as the kernel's tables reach.

    Raises:
        FamilyError: The outline is too long for the kernel's tables.
    """
    points, normals = sample_outline(shape)
    if not _SAMPLES_MIN <= len(points) <= kernels.VS_OUTLINE_SAMPLES:
        raise FamilyError(
            f"marker family {shape.name!r:.40}: the outline is {len(points)} samples of"
            f" {_SPACING_U} units long, expected {_SAMPLES_MIN} to {kernels.VS_OUTLINE_SAMPLES}"
        )
    inner = np.array(SPOTS) * shape.cell_mm
    spots = np.stack(np.meshgrid(inner, inner), axis=-1).reshape(-1, 2)
    cells = (shape.cells_mm[:, np.newaxis] + spots).reshape(-1, 2)
    outline = kernel_ffi.new("struct vs_outline *")
    outline.samples, outline.cells = len(points), len(shape.cells_mm)
    outline.passes, outline.rims = len(passes), len(shape.rim_mm)
    outline.unit_m = 1e-3 * shape.unit_mm
    outline.scale_doubt, outline.least_contrast = scale_doubt, least_contrast
    _fill(outline.x_m, outline.y_m, 1e-3 * (points - shape.origin_mm))
    _fill(outline.normal_x, outline.normal_y, normals)
    _fill(outline.rim_x_m, outline.rim_y_m, 1e-3 * (shape.rim_mm - shape.origin_mm))
    _fill(outline.spot_x_m, outline.spot_y_m, 1e-3 * (cells - shape.origin_mm))
    for row, (reach_u, steps, stride, coverage, residual_u) in zip(outline.stage, passes):
        row.reach_m, row.stride = reach_u * outline.unit_m, stride
        row.steps = min(round(finer * steps), kernels.VS_OUTLINE_STEPS)
        row.least_coverage, row.most_residual_m = coverage, residual_u * outline.unit_m
    return outline


def _fill(x: Any, y: Any, points: Floats) -> None:
    """Writes (n, 2) points to two arrays of C."""
    x[0 : len(points)], y[0 : len(points)] = points.T.tolist()


def sample_outline(shape: OutlineShape) -> tuple[Floats, Floats]:
    """Returns (n, 2) points along an outline, away from its corners, and their normals [mm].

    Of a side that alone needs more than the kernel takes there are too many, but not all.
    """
    points, normals = [], []
    margin = _CORNER_U * shape.unit_mm
    for start, end in zip(shape.polygon_mm, np.roll(shape.polygon_mm, -1, axis=0), strict=True):
        length = float(np.hypot(*(end - start)))
        ahead = (end - start) / length
        wanted = (length - 2.0 * margin) / shape.spacing_mm
        count = max(2, round(min(wanted, kernels.VS_OUTLINE_SAMPLES)) + 1)
        along = np.roll(np.linspace(margin, length - margin, count), -shape.first)
        points.append(start + along[:, np.newaxis] * ahead)
        normals.append(np.tile((ahead[1], -ahead[0]), (count, 1)))
    return np.concatenate(points), np.concatenate(normals)


def edge_sharpness(blurs_u: Floats) -> Floats:
    """Returns what an edge gains near its place under each blur, see `sharp_ahead` of `vs_marker`.

    It is a share of what is seen as the contrast: of what the edge gains within `EDGE_REACH_U`.
    """
    near = 2.0 * normal_share(_NEAR_U / blurs_u) - 1.0
    return np.asarray(near / (1.0 - 2.0 * normal_share(-EDGE_REACH_U / blurs_u)))


SHARPNESS = edge_sharpness(BLURS_U)
"""Of an edge under each of `BLURS_U`."""


def nearest_blur(sharpness: Floats) -> NDArray[np.intp]:
    """Returns the place in `BLURS_U` of the blur of edges as sharp as this, elementwise."""
    # Sharpness falls with the blur; the middles between two kept ones divide them.
    middles = 0.5 * (SHARPNESS[1:] + SHARPNESS[:-1])
    return np.searchsorted(-middles, -sharpness)


LEAST_SIGMA_M = 1e-5
"""No fit is believed to be more precise than this [m]."""

_CORRELATION = 1.1
_BLURRED, _PER_BLUR = 0.30, 5.0
_LEAK_U = 0.9
_LEAST_COVERAGE = 0.3
"""Fitted to the errors of rendered markers of the shipped families, from sharp to hard pictures;
see `tests/vision/tracking/test_covariance.py`."""


class OutlineCovariance:
    """The precision of one family's outline."""

    def __init__(self, family: MarkerFamily | SquareFamily) -> None:
        shape = shape_of(family)
        points, normals = sample_outline(shape)
        points_m = 1e-3 * (points - shape.origin_mm)
        turn = normals[:, 1] * points_m[:, 0] - normals[:, 0] * points_m[:, 1]
        growth = (normals * points_m).sum(axis=1)
        design = np.column_stack((normals, turn, growth))
        self._shape = np.linalg.inv(design.T @ design)[:3, :3]
        self._unit_m = 1e-3 * shape.unit_mm
        gap_u = _gap_u(family, shape, points) - EDGE_REACH_U
        self._leak_m = self._unit_m * _LEAK_U * normal_share(-gap_u / BLURS_U) ** 2
        self._lever = np.eye(3)
        if isinstance(family, SquareFamily):
            # What turns about the square's middle shifts a disc's centre that lies elsewhere.
            x, y = 1e-3 * family.disc_centre_mm
            self._lever[0, 2], self._lever[1, 2] = -y, x

    def covariance(
        self, markers: NDArray[np.void], ahead: NDArray[np.intp], left: NDArray[np.intp]
    ) -> Floats:
        """Returns the covariance of x, y [m] and yaw [rad] in the arena frame, (n, 3, 3).

        `markers` are (n,) MARKER; `ahead` and `left` their blurs along and across the heading,
        (n,) indices of `codes.BLURS_U`.
        """
        blur = 0.5 * (BLURS_U[ahead] + BLURS_U[left])
        factor = _CORRELATION + _PER_BLUR * np.maximum(blur - _BLURRED, 0.0)
        sample = (factor * markers["residual_m"]) ** 2
        sample /= np.maximum(markers["coverage"], _LEAST_COVERAGE)
        covariance = sample[:, np.newaxis, np.newaxis] * self._shape
        for axis, place in enumerate((ahead, left)):
            covariance[:, axis, axis] += self._leak_m[place] ** 2 + LEAST_SIGMA_M**2
        covariance = self._lever @ covariance @ self._lever.T
        return turn_into_arena(covariance, markers["ahead_x"], markers["ahead_y"])


def turn_into_arena(covariance: Floats, ahead_x: Floats, ahead_y: Floats) -> Floats:
    """Turns (n, 3, 3) covariances of shifts ahead and to the left, and yaw, into the arena frame.

    `ahead_x` and `ahead_y` are the headings' unit vectors, (n,) each.
    """
    turn = np.zeros_like(covariance)
    turn[:, 0, 0], turn[:, 0, 1] = ahead_x, -ahead_y
    turn[:, 1, 0], turn[:, 1, 1] = ahead_y, ahead_x
    turn[:, 2, 2] = 1.0
    return np.asarray(turn @ covariance @ turn.transpose(0, 2, 1))


def _gap_u(family: MarkerFamily | SquareFamily, shape: OutlineShape, points_mm: Floats) -> float:
    """Returns how near to the outline white cells or the disc's rim come, in units u.

    A square's frame is one cell wide, and the rim comes near to its corners alone.
    """
    if isinstance(family, SquareFamily):
        return 1.0
    rim = 0.5 * family.disc_diameter_mm - np.hypot(*(points_mm - shape.origin_mm).T).max()
    return float(min(rim, shape.frame_mm) / family.unit_mm)
