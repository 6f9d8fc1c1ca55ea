"""Markers at several heights: one plane of reference, searched in as many layers as they need.

The kernel accepts markers whose size is a little off, so one search serves heights that are not
far apart. Robots of very different heights need a search each. Wherever a marker was found, its
place is given on the plane of reference, on which its picture lies.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from vsense.tracking.camera import Camera
from vsense.tracking.families import MarkerFamily
from vsense.tracking.kernel import MARKER, Image, Kernel
from vsense.tracking.whereabouts import NEAR_M

_OFF = 0.09
"""A marker may be so much nearer or farther than the plane that is searched, as a share."""

_LENGTHS = ("x_m", "y_m", "residual_m", "scale")


class LayeredKernel:
    """Finds and follows one family's markers at all heights; one thread at a time."""

    def __init__(self, family: MarkerFamily, height_m: float, heights_m: Iterable[float]) -> None:
        """Takes the heights above the floor.

        Args:
            family: The marker family.
            height_m: Of the plane of reference.
            heights_m: Of the markers.
        """
        self._kernel = Kernel(family)
        self._height_m = height_m
        self._heights_m = sorted({height_m, *heights_m})
        self._layers: dict[Camera, list[float]] = {}

    @property
    def overflows(self) -> int:
        """Pictures with more in them than the kernel's tables hold; markers may be missed."""
        return self._kernel.overflows

    def search(
        self, image: Image, camera: Camera, windows: NDArray[np.int32] | None = None
    ) -> NDArray[np.void]:
        """Looks for markers in a whole picture or in windows of it, see `Kernel.search`.

        Returns:
            (n,) MARKER, with places and sizes on the plane of reference.
        """
        found = np.zeros(0, dtype=MARKER)
        for height_m in self._layers_of(camera):
            markers = self._kernel.search(image, camera, height_m, windows)
            found = join(found, self._refer(markers, camera, height_m))
        return found

    def follow(self, image: Image, camera: Camera, robots: NDArray[np.void]) -> NDArray[np.void]:
        """Fits robots where they are expected, see `Kernel.follow`.

        Args:
            image: (height, width) uint8 picture of `camera`.
            camera: The camera.
            robots: (n,) EXPECTED, on the plane of reference.

        Returns:
            (k,) MARKER of those that fit, with places and sizes on the plane of reference.
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
        """Returns the heights to search at, from low to high."""
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
