"""Detectors: from a picture to the markers in it.

A detector is anything with the one method of `Detector`. `ArrowDetector` reads the project's
arrows: the kernel finds and fits them, the decoder names them, and where a tracker says what to
expect, known robots are fitted where they must be and keep their names.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vsense.arena import DETECTION
from vsense.tracking.camera import Camera
from vsense.tracking.decoder import Decoder
from vsense.tracking.families import MarkerFamily
from vsense.tracking.kernel import MARKER, Image, Kernel
from vsense.tracking.naming import carry_names, gather_evidence
from vsense.tracking.whereabouts import NEAR_M, Whereabouts

_FLOOR_M = 1e-4
"""What of the position's error no residual tells of [m]."""


class Detector(Protocol):
    """Finds markers in one picture; called by one thread at a time."""

    def detect(self, image: NDArray[np.uint8], camera: Camera) -> NDArray[np.void]:
        """Returns the DETECTION array of a (height, width) uint8 picture of `camera`."""


class ArrowDetector:
    """Finds the arrows of one family and names those of a roster."""

    def __init__(
        self,
        family: MarkerFamily,
        roster: Sequence[int],
        height_m: float,
        whereabouts: Whereabouts | None = None,
    ) -> None:
        """Prepares the detector.

        Args:
            family: The marker family.
            roster: The tags in the arena; a marker with any other is reported without a name.
            height_m: Height of the markers above the floor, about: the scale of what is found
                may differ by a tenth.
            whereabouts: What the arena tracker expects, the same for all of its detectors;
                without it every picture is searched and read for itself.

        Raises:
            FamilyError: The family does not have a tag of the roster.
        """
        self._height_m = height_m
        self._cells = family.grid**2
        self._kernel = Kernel(family)
        self._decoder = Decoder(family, roster)
        self._whereabouts = whereabouts

    @property
    def overflows(self) -> int:
        """Pictures with more in them than the kernel's tables hold; markers may be missed."""
        return self._kernel.overflows

    def detect(self, image: Image, camera: Camera) -> NDArray[np.void]:
        """Returns the markers of a (height, width) uint8 picture, see DETECTION.

        Markers that are not wholly in the picture are not reported.
        """
        known = self._whereabouts
        if known is None:
            return self._name(self._kernel.search(image, camera, self._height_m), camera, None)
        expected = known.in_view(camera, self._height_m)
        if known.is_key_frame:
            markers = self._kernel.search(image, camera, self._height_m)
            missing = expected[~_has_near(expected, markers)]
            markers = _join(markers, self._fit(image, camera, missing))
        else:
            markers = np.zeros(0, dtype=MARKER)
            if known.plan.warm:
                markers = self._fit(image, camera, expected)
            missing = expected[~_has_near(expected, markers)]
            markers = _join(markers, self._search_squares(image, camera, known, missing))
        return self._name(markers, camera, expected)

    def _fit(self, image: Image, camera: Camera, robots: NDArray[np.void]) -> NDArray[np.void]:
        """Fits robots where they are expected."""
        if len(robots) == 0:
            return np.zeros(0, dtype=MARKER)
        poses = np.stack((robots["x_m"], robots["y_m"], robots["yaw_rad"]), axis=1)
        return self._kernel.follow(image, camera, self._height_m, poses)[0]

    def _search_squares(
        self, image: Image, camera: Camera, known: Whereabouts, robots: NDArray[np.void]
    ) -> NDArray[np.void]:
        """Searches around where robots are expected, and markers without a name were."""
        places = np.stack((robots["x_m"], robots["y_m"]), axis=1)
        if camera.id in known.anonymous:
            places = np.concatenate((places, known.anonymous[camera.id].places))
        if len(places) == 0:
            return np.zeros(0, dtype=MARKER)
        squares = known.windows(camera, self._height_m, places)
        return self._kernel.search(image, camera, self._height_m, squares)

    def _name(
        self, markers: NDArray[np.void], camera: Camera, expected: NDArray[np.void] | None
    ) -> NDArray[np.void]:
        """Makes DETECTION rows of fitted markers."""
        found = np.zeros(len(markers), dtype=DETECTION)
        if len(found) == 0:
            return found
        cells = markers["cell"][:, : self._cells]
        sharpness = markers["sharp_ahead"], markers["sharp_left"]
        reading = self._decoder.decode(cells, *sharpness)
        tags = reading.tags
        if expected is not None and self._whereabouts is not None:
            places = np.stack((markers["x_m"], markers["y_m"]), axis=1)
            tags = carry_names(tags, reading, self._decoder.tags, places, expected)
            tags = gather_evidence(
                tags, cells, sharpness, places, camera.id, self._whereabouts, self._decoder
            )
        found["tag"], found["error"], found["margin"] = tags, reading.error, reading.margin
        found["x_px"], found["y_px"] = markers["x_px"], markers["y_px"]
        found["yaw_rad"] = np.arctan2(markers["ahead_y"], markers["ahead_x"])
        found["weight"] = 1.0 / (_FLOOR_M + markers["residual_m"]) ** 2
        return found


def _has_near(expected: NDArray[np.void], markers: NDArray[np.void]) -> NDArray[np.bool_]:
    """Tells which expected robots have a marker where they should be."""
    x = expected["x_m"][:, np.newaxis] - markers["x_m"]
    y = expected["y_m"][:, np.newaxis] - markers["y_m"]
    return np.asarray((np.hypot(x, y) < NEAR_M).any(axis=1))


def _join(markers: NDArray[np.void], more: NDArray[np.void]) -> NDArray[np.void]:
    """Adds markers that are at none of the places found already."""
    if len(markers) == 0:
        return more
    apart = np.hypot(
        more["x_m"][:, np.newaxis] - markers["x_m"], more["y_m"][:, np.newaxis] - markers["y_m"]
    )
    return np.concatenate((markers, more[(apart > NEAR_M).all(axis=1)]))
