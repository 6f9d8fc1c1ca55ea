"""What detectors of all families have in common: where is searched, and what is reported.

Known robots are fitted where they must be and keep their names, as far as a tracker says what to
expect; without one every picture is searched and read for itself.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import DETECTION, UNNAMED
from vsense.vision.cameras.camera import Camera
from vsense.vision.cameras.camera_array import CameraArray, Places
from vsense.vision.markers.families import BLURS_U, FamilyError, MarkerFamily, SquareFamily
from vsense.vision.tracking.joining import UnlistedTags
from vsense.vision.tracking.kernel import MARKER, Image
from vsense.vision.tracking.legibility import legible_blur_u
from vsense.vision.tracking.outlines import OutlineCovariance, nearest_blur
from vsense.vision.tracking.prediction import EXPECTED, MarkerSearch, Prediction, at_height
from vsense.vision.tracking.rows import Rows, are_near, each_once, gather, is_in, join
from vsense.vision.tracking.workers import Kernels, Picture, Workers

Floats = NDArray[np.float64]
Tags = NDArray[np.int32]

_THOROUGH = 4
"""Of a camera, every so many key frames get a second look (see `_is_quick`): small newcomers wait
that long, 0.07 s where every picture of 60 a second is one."""


class Detected(NamedTuple):
    """DETECTION `rows` of one picture, and whether it held more than the detector's tables."""

    rows: NDArray[np.void]
    full: bool


class MarkerDetector:
    """Finds the markers of one family and names those of a roster."""

    def __init__(
        self,
        family: MarkerFamily | SquareFamily,
        search: MarkerSearch,
        prediction: Prediction | None,
        workers: Workers,
    ) -> None:
        """See `detector_of`; `family` is that of `search`."""
        unknown = [tag for tag in sorted(search.heights_m) if not 0 <= tag < family.tags]
        if unknown:
            raise FamilyError(
                f"tag {unknown[0]}: the family {family.name} has 0 to {family.tags - 1}"
            )
        self._kernels = Kernels(search, workers)
        self._height_m = search.height_m
        self._open_roster = search.open_roster
        self._prediction = prediction
        self._family = family
        self._covariance = OutlineCovariance(family)
        self._legible_u = legible_blur_u(family)
        self._roster = np.zeros(0, dtype=np.int32)
        self._joined: tuple[int, ...] = ()
        self._turns: dict[str, int] = {}
        self._unsettled: set[str] = set()
        self._cameras = CameraArray([])
        self._inside_px: Floats = np.zeros(0)
        self._grow(sorted(search.heights_m))

    def detect(self, image: Image, camera: Camera) -> NDArray[np.void]:
        """Returns the DETECTION array of one picture, see `detect_all`."""
        return self.detect_all([Picture(image, camera)])[0].rows

    def detect_all(self, pictures: Sequence[Picture]) -> list[Detected]:
        """Returns what is in each picture; what is not wholly in one is not reported."""
        self._kernels.begin(pictures)
        if (known := self._prediction) is None:
            markers = self._believed(self._kernels.search(), gather([np.zeros(0, dtype=EXPECTED)]))
            tags = markers.values["tag"].astype(np.int32)
        else:
            self._look_through(tuple(picture.camera for picture in pictures))
            self._admit(known)
            expected = known.in_view(self._cameras, self._height_m)
            expected = expected.where(is_in(expected.values["tag"], self._roster))
            markers = self._search(known, expected)
            tags = self._name(known, markers, expected)
        tags = np.where(is_in(tags, self._roster), tags, np.int32(UNNAMED))
        rows = self._report(markers, tags)
        full = self._kernels.full.tolist()
        return [Detected(rows[markers.picture == n], full[n]) for n in range(len(pictures))]

    def _grow(self, tags: Iterable[int]) -> None:
        """Adds tags to the roster."""
        self._roster = np.append(self._roster, np.array(list(tags), dtype=np.int32))

    def _believed(self, markers: Rows, expected: Rows) -> Rows:
        """Keeps of (n,) MARKER that a search has found what is one."""
        raise NotImplementedError

    def _name(self, known: Prediction, markers: Rows, expected: Rows) -> Tags:
        """Names (n,) MARKER by what was read, by where they are, and by what was gathered."""
        raise NotImplementedError

    def _look_through(self, cameras: tuple[Camera, ...]) -> None:
        if cameras != self._cameras.cameras:
            self._cameras = CameraArray(cameras)
            self._inside_px = np.array([self._kernels.least_inside_px(one) for one in cameras])

    def _admit(self, known: Prediction) -> None:
        joined = known.joined.get(self._family.name, ())
        if len(joined) > len(self._joined):
            self._grow(joined[len(self._joined) :])
            self._joined = joined

    def _search(self, known: Prediction, expected: Rows) -> Rows:
        """Searches what the plan says, and fits robots where they must be; returns (n,) MARKER."""
        markers = gather([np.zeros(0, dtype=MARKER)])
        if known.is_key_frame:
            markers = self._kernels.search(quick=self._is_quick(known, expected))
            markers = self._believed(markers, expected)
        if known.is_key_frame or known.plan.warm:
            missing = self._whole(expected.where(~are_near(expected, markers)))
            # Where one robot was exchanged for another, both are expected: the marker is one.
            followed = each_once(self._kernels.follow(missing))
            lost = missing.picture[~are_near(missing, followed)]
            markers = join(markers, followed)
            self._unsettled = {self._cameras.cameras[n].id for n in np.unique(lost).tolist()}
        if not known.is_key_frame:
            missing = expected.where(~are_near(expected, markers))
            more = self._kernels.search(*self._windows(known, missing))
            markers = join(markers, self._believed(more, expected))
        return markers

    def _is_quick(self, known: Prediction, expected: Rows) -> NDArray[np.bool_]:
        """Tells which pictures need no second look, (n,): what it shows besides is a newcomer.

        Robots that the first look does not show are followed to where they must be. So pictures
        take turns, but for those in which a robot was lost or something has no name, and those
        in which nobody is expected. Each camera counts its own pictures: one with a slower clock
        would else miss its turn each time.
        """
        quick = np.bincount(expected.picture, minlength=len(self._cameras.cameras)) > 0
        for number, camera in enumerate(self._cameras.cameras):
            turn = self._turns[camera.id] = self._turns.get(camera.id, len(self._turns)) + 1
            is_settled = camera.id not in self._unsettled and camera.id not in known.anonymous
            quick[number] &= turn % _THOROUGH != 0 and is_settled
        return np.asarray(quick)

    def _whole(self, expected: Rows) -> Rows:
        """Leaves out those that cannot be wholly in their picture."""
        at_px = self._cameras.project(at_height(expected, self._height_m), expected.picture)
        margin_px = self._inside_px[expected.picture]
        return expected.where(self._cameras.contain(at_px, expected.picture, margin_px))

    def _windows(self, known: Prediction, missing: Rows) -> tuple[NDArray[np.int32], Places]:
        """Returns the squares where robots are missing, or markers without a name were."""
        places, pictures = [missing.places()], [missing.picture]
        for number, camera in enumerate(self._cameras.cameras):
            if camera.id in known.anonymous:
                places.append(known.anonymous[camera.id].places)
                pictures.append(np.full(len(places[-1]), number, dtype=np.intp))
        at, of = np.concatenate(places), np.concatenate(pictures)
        return known.windows(self._cameras, self._height_m, at, of), of

    def _tell_unlisted(self, known: Prediction, number: int, tags: Tags, places: Floats) -> None:
        """Tells of tags in a picture that are not on the roster, and (n, 2) where they are."""
        known.unlisted[self._cameras.cameras[number].id] = UnlistedTags(
            self._family, self._roster.tolist(), self._height_m, tags, places
        )

    def _report(self, markers: Rows, tags: Tags) -> NDArray[np.void]:
        """Returns (n,) MARKER as DETECTION."""
        values = markers.values
        rows = np.zeros(len(values), dtype=DETECTION)
        if len(rows) == 0:
            return rows
        rows["tag"] = tags
        for name in ("x_px", "y_px", "error", "margin"):
            rows[name] = values[name]
        rows["yaw_rad"] = np.arctan2(values["ahead_y"], values["ahead_x"])
        rows["read"] = (tags != UNNAMED) & (values["tag"] == tags)
        blur = [nearest_blur(values[name]) for name in ("sharp_ahead", "sharp_left")]
        rows["legible"] = BLURS_U[np.maximum(*blur)] < self._legible_u
        rows["covariance"] = self._covariance.covariance(values, *blur)
        return rows
