"""The detector for square markers that robots carry: from the picture to places in the arena."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vsense.arena import DETECTION, UNNAMED
from vsense.cameras.camera import Camera
from vsense.markers.dictionary import FamilyError, Floats, SquareFamily
from vsense.tracking.covariance import OutlineCovariance
from vsense.tracking.joining import UnlistedTags
from vsense.tracking.kernel import MARKER, Image, LayeredKernel, are_near, join, places_of
from vsense.tracking.naming import carry_read_names
from vsense.tracking.outlines import nearest_blur
from vsense.tracking.prediction import Anonymous, MarkerSearch, Prediction


class SquareDetector:
    """Finds the square markers of one family and names those of a roster."""

    def __init__(
        self, family: SquareFamily, search: MarkerSearch, prediction: Prediction | None
    ) -> None:
        """See `detector.detector_of`; `family` is that of `search`."""
        unknown = [tag for tag in sorted(search.heights_m) if not 0 <= tag < family.tags]
        if unknown:
            raise FamilyError(
                f"tag {unknown[0]}: the family {family.name} has 0 to {family.tags - 1}"
            )
        self._family = family
        self._height_m = search.height_m
        self._kernel = LayeredKernel(family, search.height_m, search.heights_m.values())
        self._covariance = OutlineCovariance(family)
        self._listed = np.zeros(family.tags + 1, dtype=bool)
        self._roster: list[int] = []
        self._grow(sorted(search.heights_m))
        self._joined = 0
        self._prediction = prediction
        self._open_roster = search.open_roster

    @property
    def overflows(self) -> int:
        """See `Detector.overflows`."""
        return self._kernel.overflows

    def detect(self, image: Image, camera: Camera) -> NDArray[np.void]:
        """Returns the markers of a (height, width) uint8 picture, see DETECTION.

        Only whole markers of the family's size at the detector's heights are reported. A black
        square without a word is a marker only where a robot is expected.
        """
        known = self._prediction
        if known is None:
            markers = self._kernel.search(image, camera)
            markers = markers[markers["tag"] != UNNAMED]
            return self._report(markers, _tags_of(markers))
        joined = known.joined.get(self._family.name, ())
        self._grow(joined[self._joined :])
        self._joined = len(joined)
        expected = known.in_view(camera, self._height_m)
        expected = expected[np.isin(expected["tag"], self._roster)]
        markers = self._search(image, camera, known, expected)
        places = places_of(markers)
        tags = carry_read_names(_tags_of(markers), places, expected)
        self._note(known, camera, tags, places)
        return self._report(markers, tags)

    def _grow(self, tags: Sequence[int]) -> None:
        """Adds tags to the roster; where `UNNAMED` is looked up, the last place, is none."""
        self._roster += tags
        self._listed[list(tags)] = True

    def _search(
        self, image: Image, camera: Camera, known: Prediction, expected: NDArray[np.void]
    ) -> NDArray[np.void]:
        """Searches what the plan says; robots that it does not find are fitted where they must be.

        Returns (n,) MARKER.
        """
        markers = np.zeros(0, dtype=MARKER)
        if known.is_key_frame:
            markers = self._believed(self._kernel.search(image, camera), expected)
        if known.is_key_frame or known.plan.warm:
            missing = expected[~are_near(expected, markers)]
            markers = join(markers, self._kernel.follow(image, camera, missing))
        if not known.is_key_frame:
            places = places_of(expected[~are_near(expected, markers)])
            if camera.id in known.anonymous:
                places = np.concatenate((places, known.anonymous[camera.id].places))
            windows = known.windows(camera, self._height_m, places)
            more = self._kernel.search(image, camera, windows)
            markers = join(markers, self._believed(more, expected))
        return markers

    def _believed(self, markers: NDArray[np.void], expected: NDArray[np.void]) -> NDArray[np.void]:
        """Keeps what has a word, or is where a robot is expected."""
        believed = (markers["tag"] != UNNAMED) | are_near(markers, expected)
        return np.asarray(markers[believed])

    def _note(
        self, known: Prediction, camera: Camera, tags: NDArray[np.int32], places: Floats
    ) -> None:
        """Keeps where markers without a name are, and the tags that are not on the roster."""
        nameless = np.flatnonzero(~self._listed[tags])
        cells, once = np.zeros((len(nameless), 0)), np.ones(len(nameless), dtype=np.int64)
        known.anonymous[camera.id] = Anonymous(
            nameless, places[nameless], cells, once, known.capture_ns
        )
        if self._open_roster:
            rows = nameless[tags[nameless] != UNNAMED]
            known.unlisted[camera.id] = UnlistedTags(
                self._family, list(self._roster), self._height_m, tags[rows], places[rows]
            )

    def _report(self, markers: NDArray[np.void], tags: NDArray[np.int32]) -> NDArray[np.void]:
        rows = np.zeros(len(markers), dtype=DETECTION)
        if len(rows) == 0:
            return rows
        rows["tag"] = np.where(self._listed[tags], tags, UNNAMED)
        for name in ("x_px", "y_px", "error", "margin"):
            rows[name] = markers[name]
        rows["yaw_rad"] = np.arctan2(markers["ahead_y"], markers["ahead_x"])
        blur = (nearest_blur(markers[name]) for name in ("sharp_ahead", "sharp_left"))
        rows["covariance"] = self._covariance.covariance(markers, *blur)
        return rows


def _tags_of(markers: NDArray[np.void]) -> NDArray[np.int32]:
    return np.asarray(markers["tag"], dtype=np.int32)
