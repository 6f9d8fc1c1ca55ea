"""Robots of different heights: one picture kernel on several planes.

The kernel accepts markers whose size is a little off, so one search serves heights that are not
far apart; robots of very different heights need a search each. Wherever a marker was found, its
place is given on one plane of reference, on which its picture lies.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import MarkerFamily, SquareFamily
from vsense.vision.tracking.kernel import Image, Kernel, least_and_most_scale
from vsense.vision.tracking.mask import Mask
from vsense.vision.tracking.rows import each_once, gather, stack_rows

_OFF = 0.09
"""A marker may be so much nearer or farther than the plane that is searched, as a share."""
_LENGTHS = ("x_m", "y_m", "residual_m", "scale")


class LayeredKernel:
    """Finds and follows one family's markers at all heights; one thread at a time.

    `height_m` is the plane of reference, `heights_m` those of the markers, above the floor; `mask`
    says where they are.
    """

    def __init__(
        self,
        family: MarkerFamily | SquareFamily,
        height_m: float,
        heights_m: Iterable[float],
        mask: Mask | None = None,
    ) -> None:
        self._kernel = Kernel(family, mask)
        self._height_m = height_m
        self._heights_m = sorted({height_m, *heights_m})
        self._layers: dict[Camera, list[float]] = {}

    @property
    def overflows(self) -> int:
        """See `Kernel.overflows`."""
        return self._kernel.overflows

    def read_codes(self, codes: Any) -> None:
        """See `Kernel.read_codes`."""
        self._kernel.read_codes(codes)

    def least_inside_px(self, camera: Camera) -> float:
        """Returns how far inside a picture the centre of a marker's disc is at least [px].

        See `Kernel.inside_m`.
        """
        layers = self._layers_of(camera)
        least = min(least_and_most_scale(camera, height_m)[0] for height_m in layers)
        return self._kernel.inside_m * least

    def search(
        self,
        image: Image,
        camera: Camera,
        windows: NDArray[np.int32] | None = None,
        thorough: bool = True,
    ) -> NDArray[np.void]:
        """See `Kernel.search`; places and sizes are given on the plane of reference."""
        found = []
        for height_m in self._layers_of(camera):
            markers = self._kernel.search(image, camera, height_m, windows, thorough)
            found.append(self._refer(markers, camera, height_m))
        return _joined(found)

    def follow(self, image: Image, camera: Camera, robots: NDArray[np.void]) -> NDArray[np.void]:
        """Fits (n,) EXPECTED robots, given on the plane of reference; see `Kernel.follow`.

        Returns (k,) MARKER of those that fit, with places and sizes on the plane of reference.
        """
        layers = np.array(self._layers_of(camera))
        layer = np.abs(robots["height_m"][:, np.newaxis] - layers).argmin(axis=1)
        centre = np.array(camera.position_m[:2])
        found = []
        for number in np.unique(layer):
            mine = robots[layer == number]
            share = self._nearer(camera, layers[number])
            places = np.stack((mine["x_m"], mine["y_m"]), axis=1)
            poses = np.column_stack((centre + share * (places - centre), mine["yaw_rad"]))
            markers = self._kernel.follow(image, camera, layers[number], poses)[0]
            found.append(self._refer(markers, camera, layers[number]))
        return _joined(found)

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


def _joined(layers: Sequence[NDArray[np.void]]) -> NDArray[np.void]:
    """Returns one picture's MARKER rows of all layers; what two of them show counts once.

    A layer that is not the marker's can show it, too, but hardly read it: of one place, what was
    read is kept, and of that what is most like its word.
    """
    if len(layers) == 1:
        return layers[0]
    markers = stack_rows(layers)
    order = np.lexsort((markers["error"], markers["tag"] < 0.0))
    return each_once(gather([markers[order]])).values
