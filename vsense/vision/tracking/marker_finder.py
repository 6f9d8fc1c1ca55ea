"""Finds markers in the pictures of an uncalibrated camera.

The detectors derive a marker's size in the picture from the camera's calibration. Without one, the
picture is searched for markers of one size after the other; the size with the most markers is the
picture's scale.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import count

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import DETECTION, IMAGE_POSE, UNNAMED, Image
from vsense.vision.cameras._camera_array import CameraArray
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import MarkerFamily, SquareFamily
from vsense.vision.tracking._detector import make_detector
from vsense.vision.tracking._prediction import Prediction
from vsense.vision.tracking._views import image_poses, place_markers
from vsense.vision.tracking.marker_detector import CellWidth, cell_width

_LEAST_CELL_PX, _MOST_CELL_PX = 1.5, 20.0
"""Smaller cells cannot be read; larger ones are no picture of an arena."""
_RATIO = 1.1
"""Of a step of the search: markers up to 12 % off the expected size are found."""
_REST = 8
"""Pictures to skip after a search without result."""
_AWAY_M = 2.0
_STEP_NS = 100_000_000
_NAME = "camera"


@dataclass(frozen=True, slots=True)
class FoundMarkers:
    """The markers in one picture, (n,) DETECTION, with the tag wherever it could be read.

    `camera` is calibrated or guessed; `height_m` is the markers' height above its floor.
    """

    rows: NDArray[np.void]
    camera: Camera | None
    height_m: float = 0.0

    @property
    def count(self) -> int:
        """How many there are."""
        return len(self.rows)

    @property
    def tags(self) -> tuple[int, ...]:
        """The numbers that could be read, sorted."""
        return tuple(sorted({int(tag) for tag in self.rows["tag"] if tag != UNNAMED}))

    def poses(self) -> NDArray[np.void]:
        """Returns the numbered ones as IMAGE_POSE of the first of an arena's cameras."""
        if self.camera is None:
            return np.zeros(0, dtype=IMAGE_POSE)
        cameras, heights_m = CameraArray([self.camera]), dict.fromkeys(self.tags, self.height_m)
        return image_poses(cameras, place_markers(cameras, [0], [self.rows], heights_m))


NO_MARKERS = FoundMarkers(np.zeros(0, dtype=DETECTION), None)


class MarkerFinder:
    """Finds and reads all markers of one family.

    `px_per_m` is the picture's scale once markers have been found.
    """

    def __init__(
        self,
        family: MarkerFamily | SquareFamily,
        calibration: Camera | None = None,
        height_m: float = 0.0,
    ) -> None:
        """Takes the family, and for a calibrated camera the height of its markers."""
        self._family = family
        self._calibration = calibration
        self._height_m = height_m
        self._times = count(_STEP_NS, _STEP_NS)
        self._rest = 0
        self.px_per_m: float | None = None

    def find(self, image: Image) -> FoundMarkers:
        """Looks for markers in an (h, w) uint8 picture."""
        calibration = self._calibration
        if calibration is not None and image.shape == (calibration.height_px, calibration.width_px):
            return self._through(image, calibration, self._height_m)
        if self.px_per_m is not None:
            markers = self._at(image, self.px_per_m)
            if markers.count:
                return markers
        if self._rest > 0:
            self._rest -= 1
            return NO_MARKERS
        scale = self._search(image)
        if scale is None:
            self._rest = _REST
            return NO_MARKERS
        self.px_per_m = scale
        return self._at(image, scale)

    def cell_width(self, px_per_m: float) -> CellWidth:
        """Whether markers of the family can be named in a picture of this scale."""
        return cell_width(self._family, px_per_m)

    def _search(self, image: Image) -> float | None:
        """Returns the middle of the scales with the most markers; None: no markers."""
        cell_m = 1e-3 * self._family.cell_mm
        steps = int(np.log(_MOST_CELL_PX / _LEAST_CELL_PX) / np.log(_RATIO)) + 1
        scales = _LEAST_CELL_PX / cell_m * _RATIO ** np.arange(steps)
        fits = 1e-3 * self._family.disc_diameter_mm * scales < min(image.shape)
        results = [self._at(image, float(scale)) for scale in scales[fits]]
        # Readable markers count first, unreadable ones only without them.
        worth = [(len(result.tags), result.count) for result in results]
        most = max(worth, default=(0, 0))
        if most == (0, 0):
            return None
        best = [number for number, value in enumerate(worth) if value == most]
        return float(np.exp(np.log(scales[fits][best]).mean()))

    def _at(self, image: Image, px_per_m: float) -> FoundMarkers:
        height, width = image.shape
        camera = Camera.looking_down(_NAME, 0.0, 0.0, _AWAY_M, _AWAY_M * px_per_m, (width, height))
        return self._through(image, camera, 0.0)

    def _through(self, image: Image, camera: Camera, height_m: float) -> FoundMarkers:
        """Looks for markers as a calibrated camera sees them."""
        seen = Prediction()
        seen.expect(next(self._times))
        rows = make_detector(self._family, (), height_m, seen).detect(image, camera)
        unlisted = seen.unlisted.get(camera.id)
        if unlisted is not None and len(rows):
            # The roster is empty, so all tags that can be read are unlisted.
            places = np.column_stack((unlisted.places, np.full(len(unlisted.tags), height_m)))
            at_px = np.stack((rows["x_px"], rows["y_px"]), axis=-1)
            for tag, place_px in zip(unlisted.tags, camera.project(places)):
                rows["tag"][np.hypot(*(at_px - place_px).T).argmin()] = tag
        return FoundMarkers(rows, camera, height_m)
