"""The picture kernel: from a picture to fitted markers, in C and without Python's lock.

This is the seam to `c_src/host/vs_markers.h`: it turns a family into an outline and a camera into
a view, owns the working memory, and reports what did not fit the kernel's tables.

The kernel accepts markers whose size is a little off, so one search serves heights that are not
far apart; robots of very different heights need a search each (`LayeredKernel`). Wherever a marker
was found, its place is given on one plane of reference, on which its picture lies.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.cameras.camera import Camera
from vsense.markers.codes import SPOTS
from vsense.markers.dictionary import FamilyError
from vsense.markers.families import MarkerFamily
from vsense.native import check, kernel_ffi, kernels
from vsense.tracking.prediction import NEAR_M

Floats = NDArray[np.float64]
Image = NDArray[np.uint8]
Pass = tuple[float, int, int, float, float]

_CELLS = (kernels.VS_OUTLINE_CELLS,)
MARKER = np.dtype(
    [
        (name, "f8", _CELLS if name == "cell" else ())
        for name, _ in kernel_ffi.typeof("struct vs_marker").fields
    ]
)
"""One fitted marker: `struct vs_marker`, see `c_src/host/vs_markers.h`."""

_CAPACITY = 1024
_SPACING_U = 0.4
_CORNER_U = 0.6
_SAMPLES_MIN = 8
_PASSES = ((1.0, 9, 3, 0.6, 0.25), (0.6, 9, 3, 0.8, 0.14), (0.6, 11, 1, 0.8, 0.1))
_WARM_PASSES = (
    (1.0, 9, 1, 0.5, 0.25),
    (0.6, 9, 2, 0.5, 0.14),
    (0.6, 11, 1, 0.55, 0.1),
    (0.6, 11, 1, 0.55, 0.1),
)
"""Each pass of the fit, of a candidate and of a robot that is expected: how far to look [u], in
how many steps, every how many samples, the least coverage and the greatest residual [u]. In a good
picture markers have 0.02 u, look-alikes 0.2 u. What is expected may be half covered, and may be
farther from where the fit begins."""

_SCALE_DOUBT = 0.12
_LEAST_CONTRAST = 25.0
_LEAST_AREA, _MOST_AREA = 0.4, 1.6
_ROUNDEST, _SLIMMEST = 1.2, 2.9
_LEAST_TAPER = 0.12


class Kernel:
    """Finds and follows one family's markers; one thread at a time.

    Attributes:
        overflows: Pictures in which a table of the kernel was full, so that markers may be missed.
        contrast: What white must have over dark for a closer look [grey] (36).
        level: Where the threshold lies between the darkest and the lightest [1/256] (100).
    """

    def __init__(self, family: MarkerFamily, contrast: int = 36, level: int = 100) -> None:
        self._family = family
        self.contrast, self.level = contrast, level
        self.overflows = 0
        self._outline = _outline(family, _PASSES)
        self._warm = _outline(family, _WARM_PASSES)
        self._memory = np.empty(kernels.vs_markers_size(), dtype=np.uint8)
        self._work = kernel_ffi.cast("struct vs_markers *", self._memory.ctypes.data)
        self._markers: NDArray[np.void] = np.zeros(_CAPACITY, dtype=MARKER)
        self._found = kernel_ffi.cast("struct vs_marker *", self._markers.ctypes.data)
        self._origin = np.zeros(_CAPACITY, dtype=np.uint32)
        self._count = kernel_ffi.new("size_t *")
        self._views: dict[tuple[Camera, float], tuple[Any, Any]] = {}

    def search(
        self,
        image: Image,
        camera: Camera,
        height_m: float,
        windows: NDArray[np.int32] | None = None,
    ) -> NDArray[np.void]:
        """Looks for markers in a whole picture, or in windows of it.

        Args:
            image: (height, width) uint8 picture of `camera`.
            height_m: Height of the markers above the floor.
            windows: (n, 4) left, top, right, bottom [px]; they may reach over the border.

        Returns:
            (n,) MARKER, those that lie wholly in the picture.
        """
        view, search = self._prepare(image, camera, height_m)
        if windows is None:
            windows = np.array([(0, 0, image.shape[1], image.shape[0])], dtype=np.int32)
        self._count[0] = full = 0
        window = kernel_ffi.new("struct vs_window *")
        for window.left, window.top, window.right, window.bottom in windows.tolist():
            code = kernels.vs_markers_search(
                self._work, search, self._outline, view, window, self._found, _CAPACITY, self._count
            )
            full |= check(code, f"camera {camera.id}")
        self.overflows += full != 0
        return np.array(self._markers[: self._count[0]])

    def follow(
        self, image: Image, camera: Camera, height_m: float, poses: Floats
    ) -> tuple[NDArray[np.void], NDArray[np.uint32]]:
        """Fits markers from where they are expected; the arguments are those of `search`.

        `poses` are (n, 3) x, y of the disc's centre and yaw; at most 1024 are looked at. Returns
        (k,) MARKER of those that fit and lie wholly in the picture, and (k,) their rows of
        `poses`.
        """
        view, _ = self._prepare(image, camera, height_m)
        count = min(len(poses), _CAPACITY)
        known = self._markers[:count]
        known["x_m"], known["y_m"] = poses[:count, 0], poses[:count, 1]
        known["ahead_x"], known["ahead_y"] = np.cos(poses[:count, 2]), np.sin(poses[:count, 2])
        known["scale"] = 1.0
        self._count[0] = count
        origin = kernel_ffi.cast("uint32_t *", self._origin.ctypes.data)
        code = kernels.vs_markers_follow(self._warm, view, self._found, origin, self._count)
        check(code, f"camera {camera.id}")
        found = self._count[0]
        return np.array(self._markers[:found]), np.array(self._origin[:found])

    def _prepare(self, image: Image, camera: Camera, height_m: float) -> tuple[Any, Any]:
        key = (camera, height_m)
        if key not in self._views:
            self._views[key] = (_view(camera, height_m), self._search(camera, height_m))
        view, search = self._views[key]
        if image.strides[1] != 1 or image.strides[0] < image.shape[1]:
            image = np.ascontiguousarray(image)
        view.picture.pixels = kernel_ffi.cast("uint8_t *", image.ctypes.data)
        view.picture.stride = image.strides[0]
        view.picture.height_px, view.picture.width_px = image.shape
        # The pixels must outlive the call, also where they were copied.
        self._image = image
        return view, search

    def _search(self, camera: Camera, height_m: float) -> Any:
        """Describes what to search for, from how large a marker can be in the picture."""
        family = self._family
        low, high = _scales(camera, height_m)
        corners = 1e-3 * family.polygon_mm
        length_m = max(float(np.hypot(*(a - b))) for a in corners for b in corners)
        lead_mm = (family.disc_centre_mm - family.outline_centroid_mm)[0]
        search = kernel_ffi.new("struct vs_search *")
        search.least_contrast, search.level_256 = self.contrast, self.level
        search.lead_m = 1e-3 * float(lead_mm)
        search.least_apart_m = 5e-4 * family.disc_diameter_mm
        gate = search.gate
        gate.length_px = length_m * high
        gate.area_px2 = 1e-6 * family.outline_area_mm2 * low * high
        gate.least_area, gate.most_area = _LEAST_AREA * low / high, _MOST_AREA * high / low
        gate.least_aspect, gate.most_aspect = _ROUNDEST, _SLIMMEST
        gate.least_taper = _LEAST_TAPER
        return search


def _outline(family: MarkerFamily, passes: Sequence[Pass]) -> Any:
    points, normals = sample_outline(family.polygon_mm, family.unit_mm)
    if not _SAMPLES_MIN <= len(points) <= kernels.VS_OUTLINE_SAMPLES:
        raise FamilyError(
            f"marker family {family.name!r:.40}: the outline is {len(points)} samples of"
            f" {_SPACING_U} units long, expected {_SAMPLES_MIN} to {kernels.VS_OUTLINE_SAMPLES}"
        )
    points = 1e-3 * (points - family.disc_centre_mm)
    inner = np.array(SPOTS) * family.cell_mm
    spots = np.stack(np.meshgrid(inner, inner), axis=-1).reshape(-1, 2)
    cells = 1e-3 * (family.cells_mm[:, np.newaxis] + spots - family.disc_centre_mm).reshape(-1, 2)
    outline = kernel_ffi.new("struct vs_outline *")
    outline.samples, outline.cells, outline.passes = len(points), family.grid**2, len(passes)
    outline.unit_m = 1e-3 * family.unit_mm
    outline.scale_doubt, outline.least_contrast = _SCALE_DOUBT, _LEAST_CONTRAST
    outline.radius_m = 0.5e-3 * family.disc_diameter_mm
    outline.x_m[0 : len(points)], outline.y_m[0 : len(points)] = points.T.tolist()
    outline.normal_x[0 : len(points)], outline.normal_y[0 : len(points)] = normals.T.tolist()
    outline.spot_x_m[0 : len(cells)], outline.spot_y_m[0 : len(cells)] = cells.T.tolist()
    for row, (reach_u, steps, stride, coverage, residual_u) in zip(outline.stage, passes):
        row.reach_m, row.steps, row.stride = reach_u * outline.unit_m, steps, stride
        row.least_coverage, row.most_residual_m = coverage, residual_u * outline.unit_m
    return outline


def _view(camera: Camera, height_m: float) -> Any:
    view = kernel_ffi.new("struct vs_view *")
    lens = view.lens
    lens.fx_px, lens.fy_px = camera.fx_px, camera.fy_px
    lens.cx_px, lens.cy_px = camera.cx_px, camera.cy_px
    lens.distortion, lens.rotation = list(camera.distortion), list(camera.rotation)
    lens.position_m = list(camera.position_m)
    view.height_m = height_m
    return view


def _scales(camera: Camera, height_m: float) -> tuple[float, float]:
    """Returns the least and the greatest scale [px/m] in a picture, by area."""
    columns = np.linspace(0.0, camera.width_px - 1.0, 5)
    rows = np.linspace(0.0, camera.height_px - 1.0, 5)
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 1, 2)
    steps = np.array([(-0.5, 0.0), (0.5, 0.0), (0.0, -0.5), (0.0, 0.5)])
    near = camera.to_plane(pixels + steps, height_m)
    slopes = np.stack((near[:, 1] - near[:, 0], near[:, 3] - near[:, 2]), axis=1)
    scale = 1.0 / np.sqrt(np.abs(np.linalg.det(slopes)))
    return float(scale.min()), float(scale.max())


def sample_outline(corners: Floats, unit: float) -> tuple[Floats, Floats]:
    """Returns points along a counter-clockwise polygon, away from its corners, and normals."""
    points, normals = [], []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        length = float(np.hypot(*(end - start)))
        ahead = (end - start) / length
        count = max(2, round((length - 2.0 * _CORNER_U * unit) / (_SPACING_U * unit)) + 1)
        along = np.linspace(_CORNER_U * unit, length - _CORNER_U * unit, count)
        points.append(start + along[:, np.newaxis] * ahead)
        normals.append(np.tile((ahead[1], -ahead[0]), (count, 1)))
    return np.concatenate(points), np.concatenate(normals)


_OFF = 0.09
"""A marker may be so much nearer or farther than the plane that is searched, as a share."""
_LENGTHS = ("x_m", "y_m", "residual_m", "scale")


class LayeredKernel:
    """Finds and follows one family's markers at all heights; one thread at a time.

    `height_m` is the plane of reference, `heights_m` those of the markers, above the floor.
    """

    def __init__(self, family: MarkerFamily, height_m: float, heights_m: Iterable[float]) -> None:
        self._kernel = Kernel(family)
        self._height_m = height_m
        self._heights_m = sorted({height_m, *heights_m})
        self._layers: dict[Camera, list[float]] = {}

    @property
    def overflows(self) -> int:
        """See `Kernel.overflows`."""
        return self._kernel.overflows

    def search(
        self, image: Image, camera: Camera, windows: NDArray[np.int32] | None = None
    ) -> NDArray[np.void]:
        """See `Kernel.search`; places and sizes are given on the plane of reference."""
        found = np.zeros(0, dtype=MARKER)
        for height_m in self._layers_of(camera):
            markers = self._kernel.search(image, camera, height_m, windows)
            found = join(found, self._refer(markers, camera, height_m))
        return found

    def follow(self, image: Image, camera: Camera, robots: NDArray[np.void]) -> NDArray[np.void]:
        """Fits (n,) EXPECTED robots, given on the plane of reference; see `Kernel.follow`.

        Returns (k,) MARKER of those that fit, with places and sizes on the plane of reference.
        """
        found = np.zeros(0, dtype=MARKER)
        if len(robots) == 0:
            return found
        layers = np.array(self._layers_of(camera))
        layer = np.abs(robots["height_m"][:, np.newaxis] - layers).argmin(axis=1)
        centre = np.array(camera.position_m[:2])
        for number in np.unique(layer):
            mine = robots[layer == number]
            share = self._nearer(camera, layers[number])
            places = np.stack((mine["x_m"], mine["y_m"]), axis=1)
            poses = np.column_stack((centre + share * (places - centre), mine["yaw_rad"]))
            markers = self._kernel.follow(image, camera, layers[number], poses)[0]
            found = join(found, self._refer(markers, camera, layers[number]))
        return found

    def _nearer(self, camera: Camera, height_m: float) -> float:
        """Returns how far a plane is from the camera, as a share of the reference's distance."""
        top_m = camera.position_m[2]
        return float((top_m - height_m) / (top_m - self._height_m))

    def _refer(
        self, markers: NDArray[np.void], camera: Camera, height_m: float
    ) -> NDArray[np.void]:
        """Carries markers from a plane over to that of reference, seen from the camera."""
        share = self._nearer(camera, height_m)
        if share == 1.0:
            return markers
        for name, centre in zip(_LENGTHS, (*camera.position_m[:2], 0.0, 0.0)):
            markers[name] = centre + (markers[name] - centre) / share
        return markers

    def _layers_of(self, camera: Camera) -> list[float]:
        if camera not in self._layers:
            self._layers[camera] = list(self._divide(camera.position_m[2]))
        return self._layers[camera]

    def _divide(self, top_m: float) -> Iterable[float]:
        """Yields one height per layer; that of reference, where one layer does for all."""
        # As distances from the camera, the farthest first.
        away = [top_m - height for height in self._heights_m]
        reference = top_m - self._height_m
        if max(abs(distance / reference - 1.0) for distance in away) <= _OFF:
            yield self._height_m
            return
        while away:
            layer = [d for d in away if d >= away[0] * (1.0 - _OFF) / (1.0 + _OFF)]
            yield top_m - 0.5 * (layer[0] + layer[-1])
            away = away[len(layer) :]


def join(markers: NDArray[np.void], more: NDArray[np.void]) -> NDArray[np.void]:
    """Adds markers that are at none of the places found already."""
    if len(markers) == 0 or len(more) == 0:
        return markers if len(more) == 0 else more
    apart = np.hypot(
        more["x_m"][:, np.newaxis] - markers["x_m"], more["y_m"][:, np.newaxis] - markers["y_m"]
    )
    return np.concatenate((markers, more[(apart > NEAR_M).all(axis=1)]))
