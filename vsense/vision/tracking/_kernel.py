"""The picture kernel: from a picture to fitted markers, in C and without Python's lock.

This is the seam to `c_src/host/vs_markers.h`: it turns a family into an outline and a camera into
a view, owns the working memory, and reports what did not fit the kernel's tables.

"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats, Image
from vsense.base.native import check, kernel_ffi, kernels, pointer
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import MarkerFamily, SquareFamily
from vsense.vision.tracking._outlines import EDGE_REACH_U, Pass, make_outline, shape_of
from vsense.vision.tracking._squares_words import words_of
from vsense.vision.tracking.mask import Blocks, Mask, blocks_of

_CELLS = (kernels.VS_OUTLINE_CELLS,)
MARKER = np.dtype(
    [
        (name, "f8", _CELLS if name == "cell" else ())
        for name, _ in kernel_ffi.typeof("struct vs_marker").fields
    ]
)
"""One fitted marker: `struct vs_marker`, see `c_src/host/vs_markers.h`."""

_CAPACITY = 1024
_KEPT = 1024
"""Cameras and heights whose scales are not computed anew."""
_SCALE_DOUBT = 0.12
_LEAST_AREA, _MOST_AREA = 0.36, 1.76
"""Accepted shares of an outline's area."""
_LEAST_LENGTH, _MOST_LENGTH = 0.35, 1.45
"""Accepted sides of the box around an outline, as shares of its length: an arrow is 0.58 as wide as
long, and blur makes things longer."""
_BEYOND = 1e9
"""Metres that a pixel takes at the horizon."""
_LEAST_DISC_PX = 10.0
"""Of a disc that is smaller in some direction nothing can be read."""


Rescan = tuple[int, int]
"""Where the threshold of another scan lies [1/256], and beside what light alone it looks [grey]."""

GLARE = 240
"""Of what shines; marker's white is darker in most pictures."""


class KernelLimits(NamedTuple):
    """What a kind of markers must show.

    Attributes:
        passes: Of the fit of a candidate.
        warm: Of the fit of a robot that is expected, where it does not fit as a candidate does: it
            may be half covered.
        fine_px: Where a unit is longer than this, they take more steps.
        fit_contrast: White over black in the fit [grey].
        contrast: What white must have over dark for a closer look [grey].
        pale: That contrast, and the fit's, in a picture that has little anywhere; 0: as in others.
        level: Where the threshold lies between the darkest and the lightest [1/256].
        again: Of the scans that follow.
        thin_again: The same for markers whose black is thin between the cells and the ground.
        thin_px: Narrower than this is thin.
        print: Share of the light ground that ink is darker by [1/256].
        has_veil: Whether the picture's darkest counts as 0 in that.
        roundest, slimmest: Variance along over variance across.
        taper: How much it must come to a point.
        square: How much it must have the corners of a square; 0: it is none.
    """

    passes: tuple[Pass, ...]
    warm: tuple[Pass, ...]
    fine_px: float
    fit_contrast: float
    contrast: int
    pale: tuple[int, float]
    level: int
    again: tuple[Rescan, ...]
    thin_again: tuple[Rescan, ...]
    thin_px: float
    print: int
    has_veil: bool
    roundest: float
    slimmest: float
    taper: float
    square: float


_ARROW = KernelLimits(
    passes=((1.0, 9, 3, 0.6, 0.25), (0.6, 9, 3, 0.8, 0.14), (EDGE_REACH_U, 11, 1, 0.8, 0.1)),
    warm=(
        (1.0, 9, 1, 0.5, 0.25),
        (0.6, 9, 2, 0.5, 0.14),
        (EDGE_REACH_U, 11, 1, 0.55, 0.1),
        (EDGE_REACH_U, 11, 1, 0.55, 0.1),
    ),
    fine_px=math.inf,
    fit_contrast=25.0,
    contrast=36,
    pale=(16, 8.0),
    level=100,
    again=((144, GLARE),),
    thin_again=((144, 0), (176, GLARE)),
    thin_px=3.0,
    print=102,
    has_veil=False,
    roundest=1.2,
    slimmest=2.9,
    taper=0.12,
    square=0.0,
)
"""In a good picture markers have a residual of 0.02 u, look-alikes 0.2 u."""

_SQUARE = KernelLimits(
    passes=((1.0, 9, 3, 0.5, 0.3), (EDGE_REACH_U, 9, 1, 0.6, 0.15)),
    warm=_ARROW.warm,
    fine_px=5.0,
    fit_contrast=8.0,
    contrast=16,
    pale=(0, 0.0),
    level=100,
    again=(),
    thin_again=((128, 0),),
    thin_px=4.5,
    print=102,
    has_veil=True,
    roundest=1.0,
    slimmest=1.7,
    taper=0.0,
    square=0.2,
)
"""What is no marker has no word, so less is asked of the outline. A high threshold keeps a thin
frame whole where white cells shine through it, a low one keeps it apart from dark ground, and
whole in a glare."""


class _View(NamedTuple):
    """What C is told of a camera and a height: `struct vs_view`, `vs_search`, `vs_outline`."""

    view: Any
    search: Any
    quick: Any
    outline: Any
    warm: Any
    blocks: Blocks | None


class Kernel:
    """Finds and follows one family's markers; one thread at a time.

    Attributes:
        overflows: Pictures in which a table of the kernel was full, so that markers may be missed.
        inside_m: So far inside what the picture shows, at least, is the disc's centre of a robot
            that can be followed: it is expected no farther off than the first pass looks.
    """

    def __init__(self, family: MarkerFamily | SquareFamily, mask: Mask | None = None) -> None:
        """Finds markers where a mask lets them be; None: everywhere.

        Raises FamilyError where the kernel's tables are too small for the family.
        """
        self._mask = mask
        self._shape, self._apart_m = shape_of(family), 5e-4 * family.disc_diameter_mm
        limits = self._limits = _SQUARE if isinstance(family, SquareFamily) else _ARROW
        looks_m = 1e-3 * self._shape.unit_mm * limits.warm[0][0]
        self.inside_m = max(_reach_m(family) - looks_m, 0.0)
        self.overflows = 0
        self._words = words_of(family) if isinstance(family, SquareFamily) else None
        self._codes = kernel_ffi.NULL
        self._outline(limits.passes, 0.0)
        self._reserve(0, 0)
        self._markers: NDArray[np.void] = np.zeros(_CAPACITY, dtype=MARKER)
        self._buffer = pointer("struct vs_marker", self._markers)
        self._origin = np.zeros(_CAPACITY, dtype=np.uint32)
        self._count = kernel_ffi.new("size_t *")
        self._views: dict[tuple[Camera, float], _View] = {}
        self._disc_m = 5e-4 * family.disc_diameter_mm

    def read_codes(self, codes: Any) -> None:
        """Has arrows named by a `struct vs_codes` from now on; it must outlive the kernel."""
        self._codes = codes
        for view in self._views.values():
            view.outline.codes = view.warm.codes = codes

    def search(
        self,
        image: Image,
        camera: Camera,
        height_m: float,
        windows: NDArray[np.int32] | None = None,
        thorough: bool = True,
        wanted: int = 0,
    ) -> NDArray[np.void]:
        """Looks for markers in a whole picture, or in windows of it.

        Args:
            image: (height, width) uint8 picture of `camera`.
            height_m: Height of the markers above the floor.
            windows: (n, 4) left, top, right, bottom [px]; they may reach over the border.
            thorough: Look a second time, where the cells are small enough to ask for it, and
            wanted: for markers under something else, where fewer than so many were read.

        Returns:
            (n,) MARKER, those that lie wholly in the picture.
        """
        view = self._prepare(image, camera, height_m)
        search = view.search if thorough else view.quick
        search.wanted, self._count[0], full = wanted, 0, 0
        if windows is None:
            windows = np.array([(0, 0, image.shape[1], image.shape[0])], dtype=np.int32)
        window = kernel_ffi.new("struct vs_window *")
        for window.left, window.top, window.right, window.bottom in windows.tolist():
            place = search, view.outline, view.view, window, self._buffer
            code = kernels.vs_markers_search(self._work, *place, _CAPACITY, self._count)
            full |= check(code, f"camera {camera.id}")
        self.overflows += full != 0
        markers = np.array(self._markers[: self._count[0]])
        return markers if view.blocks is None else markers[self._keeps(markers, view.blocks)]

    def follow(
        self, image: Image, camera: Camera, height_m: float, poses: Floats
    ) -> tuple[NDArray[np.void], NDArray[np.uint32]]:
        """Fits markers from where they are expected; the arguments are those of `search`.

        `poses` are (n, 3) x, y of the disc's centre and yaw; at most 1024 are looked at. Returns
        (k,) MARKER of those that fit and lie wholly in the picture, and (k,) their rows of
        `poses`.
        """
        view = self._prepare(image, camera, height_m)
        count = min(len(poses), _CAPACITY)
        start = self._markers[:count]
        start["x_m"], start["y_m"] = poses[:count, 0], poses[:count, 1]
        start["ahead_x"], start["ahead_y"] = np.cos(poses[:count, 2]), np.sin(poses[:count, 2])
        start["scale"] = 1.0
        self._count[0] = count
        origin = pointer("uint32_t", self._origin)
        code = kernels.vs_markers_follow(
            view.outline, view.warm, view.view, self._buffer, origin, self._count
        )
        check(code, f"camera {camera.id}")
        count = self._count[0]
        markers, rows = np.array(self._markers[:count]), np.array(self._origin[:count])
        if view.blocks is None:
            return markers, rows
        inside = self._keeps(markers, view.blocks)
        return markers[inside], rows[inside]

    def _keeps(self, markers: NDArray[np.void], blocks: Blocks) -> NDArray[np.bool_]:
        """Tells which MARKER are where the mask, which there is, lets them be."""
        assert self._mask is not None
        line, column = (
            ((markers[name] + 0.5) // kernels.VS_MARKERS_BLOCK).astype(np.intp)
            for name in ("y_px", "x_px")
        )
        inside: NDArray[np.bool_] = blocks.inside[line, column] != 0
        if not inside.all():
            doubtful = markers[~inside]
            places = np.stack((doubtful["x_m"], doubtful["y_m"]), axis=1)
            inside[~inside] = self._mask.keeps(places)
        return inside

    def _prepare(self, image: Image, camera: Camera, height_m: float) -> _View:
        key = (camera, height_m)
        if key not in self._views:
            scales = scales_of(camera, height_m)
            passes = self._limits.passes, self._limits.warm
            outline, warm = (self._outline(limits, scales.least) for limits in passes)
            search = self._search(scales)
            blocks = None
            if self._mask is not None:
                blocks = blocks_of(self._mask, camera, height_m, self._disc_m)
                search.outside = pointer("uint8_t", blocks.outside)
            quick = kernel_ffi.new("struct vs_search *", search[0])
            quick.corners = 0
            for scan in quick.again:
                scan.level_256 = 0
            self._views[key] = _View(_view(camera, height_m), search, quick, outline, warm, blocks)
        view = self._views[key]
        if image.strides[1] != 1 or image.strides[0] < image.shape[1]:
            image = np.ascontiguousarray(image)
        picture = view.view.picture
        picture.pixels = kernel_ffi.cast("uint8_t *", image.ctypes.data)
        picture.stride = image.strides[0]
        picture.height_px, picture.width_px = image.shape
        if kernels.vs_markers_size(picture.width_px, picture.height_px) > self._memory.size:
            self._reserve(picture.width_px, picture.height_px)
        # The pixels must outlive the call, also where they were copied.
        self._image = image
        return view

    def _reserve(self, width_px: int, height_px: int) -> None:
        """Makes the working memory for pictures up to a size; what is not used takes no room."""
        size = kernels.vs_markers_size(width_px, height_px)
        self._memory = np.empty(size, dtype=np.uint8)
        self._work = kernel_ffi.cast("struct vs_markers *", self._memory.ctypes.data)

    def _outline(self, passes: tuple[Pass, ...], px_per_m: float) -> Any:
        limits, shape = self._limits, self._shape
        finer = max(1e-3 * shape.unit_mm * px_per_m / limits.fine_px, 1.0)
        outline = make_outline(shape, passes, _SCALE_DOUBT, limits.fit_contrast, finer)
        if self._words is not None:
            outline.words = self._words.struct
        outline.codes = self._codes
        return outline

    def _search(self, scales: Scales) -> Any:
        """Describes what to search for, from the scales in the picture."""
        limits, shape = self._limits, self._shape
        # Of a camera with the horizon in its picture the least scale is 0.
        readable = min(0.5 * _LEAST_DISC_PX / self._disc_m, scales.greatest)
        low, short = max(scales.least, readable), max(scales.shortest, readable)
        lead_mm = (shape.origin_mm - shape.centroid_mm)[0]
        search = kernel_ffi.new("struct vs_search *")
        is_thin = 1e-3 * shape.frame_mm * scales.least < limits.thin_px
        search.least_contrast, search.level_256 = limits.contrast, limits.level
        search.pale_contrast, search.pale_fit = limits.pale
        again = limits.thin_again if is_thin else limits.again
        for row, scan in zip(search.again, again):
            row.level_256, row.least_light = scan
        search.print_256, search.has_veil = limits.print, limits.has_veil
        search.lead_m, search.least_apart_m = 1e-3 * float(lead_mm), self._apart_m
        angles, side_m = shape.right_angles()
        count = min(len(angles), kernels.VS_MARKERS_CORNERS)
        search.corners, search.corner_side_m = count, side_m
        search.corner = angles[:count].tolist()
        gate = search.gate
        length_m, area_m2 = 1e-3 * shape.length_mm, 1e-6 * shape.area_mm2
        gate.least_px = _LEAST_LENGTH * length_m * short
        gate.most_px = _MOST_LENGTH * length_m * scales.longest
        gate.least_m2, gate.most_m2 = _LEAST_AREA * area_m2, _MOST_AREA * area_m2
        gate.least_px2 = gate.least_m2 * low**2
        gate.most_px2 = gate.most_m2 * scales.greatest**2
        gate.least_aspect, gate.most_aspect = limits.roundest, limits.slimmest
        gate.least_taper, gate.least_square = limits.taper, limits.square
        return search


def _reach_m(family: MarkerFamily | SquareFamily) -> float:
    """Returns how far what must be in the picture reaches from the disc's centre to all sides."""
    if isinstance(family, SquareFamily):
        return 1e-3 * float(0.5 * family.size_mm - np.hypot(*family.disc_centre_mm))
    return 5e-4 * family.disc_diameter_mm


def _view(camera: Camera, height_m: float) -> Any:
    view = kernel_ffi.new("struct vs_view *")
    lens = view.lens
    lens.fx_px, lens.fy_px = camera.fx_px, camera.fy_px
    lens.cx_px, lens.cy_px = camera.cx_px, camera.cy_px
    lens.distortion, lens.rotation = list(camera.distortion), list(camera.rotation)
    lens.position_m = list(camera.position_m)
    view.height_m = height_m
    return view


class Scales(NamedTuple):
    """Scales in a picture [px/m]: the least and the greatest by area, and in any direction."""

    least: float
    greatest: float
    shortest: float
    longest: float


@lru_cache(maxsize=_KEPT)
def scales_of(camera: Camera, height_m: float) -> Scales:
    """Returns the scales of a plane in a camera's picture."""
    columns = np.linspace(0.0, camera.width_px - 1.0, 5)
    rows = np.linspace(0.0, camera.height_px - 1.0, 5)
    sizes = sizes_at(camera, height_m, np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2))
    by_area = np.sqrt(sizes.prod(axis=1))
    extremes = by_area.min(), by_area.max(), sizes.min(), sizes.max()
    return Scales(*map(float, extremes))


def sizes_at(camera: Camera, height_m: float, pixels: Floats) -> Floats:
    """Returns the greatest and the least scale of a plane at (n, 2) pixels, (n, 2) [px/m]."""
    steps = np.array([(-0.5, 0.0), (0.5, 0.0), (0.0, -0.5), (0.0, 0.5)])
    near = camera.to_plane(pixels[:, np.newaxis] + steps, height_m)
    slopes = np.stack((near[:, 1] - near[:, 0], near[:, 3] - near[:, 2]), axis=1)
    slopes = np.nan_to_num(slopes, nan=_BEYOND, posinf=_BEYOND, neginf=-_BEYOND)
    return np.asarray(1.0 / np.linalg.svd(slopes, compute_uv=False)[:, ::-1])
