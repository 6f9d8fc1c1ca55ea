"""What detectors of all families have in common: where is searched, and what is reported.

Known robots are fitted where they must be and keep their names, as far as a tracker says what to
expect; without one every picture is searched and read for itself.

Whether markers are large enough to be named depends on the width of their cells in the picture.
Measured with 48 rendered markers of each kind and width: the share that is named in pictures with a
point spread of 0.6 px and a noise of 2.5 (and of 1.0 px and 4.0), by the width of a cell [px]:

| px   | arrow4x4     | arrow4x4-thesis | DICT_4X4_50  | 36h11        |
| 0.5  | -            | 8 % (0 %)       | -            | -            |
| 0.6  | -            | 35 % (0 %)      | -            | -            |
| 0.7  | 0 % (0 %)    | 88 % (25 %)     | 0 % (0 %)    | 0 % (0 %)    |
| 1.0  | 54 % (0 %)   | 100 % (81 %)    | 0 % (0 %)    | 25 % (0 %)   |
| 1.2  | 79 % (25 %)  | 100 % (100 %)   | 23 % (0 %)   | 52 % (10 %)  |
| 1.6  | 100 % (98 %) | 100 % (100 %)   | 81 % (10 %)  | 83 % (71 %)  |
| 2.0  | 100 % (100 %)| 100 % (100 %)   | 90 % (94 %)  | 94 % (96 %)  |
| 2.5  | 100 % (100 %)| 100 % (100 %)   | 100 % (100 %)| 100 % (100 %)|

None was misread. The thesis's cells are half as large as the unit that its outline is made of, so
they may be smaller: it is the outline that is lost first.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import DETECTION, UNNAMED, Floats, Image
from vsense.vision.cameras._camera_array import CameraArray, Index
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import BLURS_U, FamilyError, MarkerFamily, SquareFamily
from vsense.vision.tracking._joining import Tags, UnlistedTags
from vsense.vision.tracking._kernel import MARKER
from vsense.vision.tracking._outlines import OutlineCovariance, nearest_blur, shape_of
from vsense.vision.tracking._prediction import EXPECTED, MarkerSearch, Prediction, at_height
from vsense.vision.tracking._rows import Rows, are_near, each_once, gather, is_in, join
from vsense.vision.tracking._workers import Kernels, Picture, Workers

_THOROUGH = 4
"""Of a camera, every so many key frames get a second look (see `_is_quick`): small newcomers wait
that long, 0.07 s where every picture of 60 a second is one."""

_COVERED = 20
"""Where robots of the roster are nowhere to be seen, those of which something covers a part are
looked for in every so many, too: a multiple of `_THOROUGH`."""


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
        if (prediction := self._prediction) is None:
            wanted = np.full(len(pictures), len(self._roster))
            markers = self._kernels.search(wanted=wanted)
            markers = self._believed(markers, gather([np.zeros(0, dtype=EXPECTED)]))
            tags = markers.values["tag"].astype(np.int32)
        else:
            self._look_through(tuple(picture.camera for picture in pictures))
            self._admit(prediction)
            expected = prediction.in_view(self._cameras, self._height_m)
            expected = expected.where(is_in(expected.values["tag"], self._roster))
            markers = self._search(prediction, expected)
            tags = self._name(prediction, markers, expected)
        tags = np.where(is_in(tags, self._roster), tags, np.int32(UNNAMED))
        rows = self._report(markers, tags)
        full = self._kernels.full.tolist()
        return [Detected(rows[markers.picture == n], full[n]) for n in range(len(pictures))]

    def _grow(self, tags: Iterable[int]) -> None:
        self._roster = np.append(self._roster, np.array(list(tags), dtype=np.int32))

    def _believed(self, markers: Rows, expected: Rows) -> Rows:
        """Keeps of (n,) MARKER that a search has found what is one."""
        raise NotImplementedError

    def _name(self, prediction: Prediction, markers: Rows, expected: Rows) -> Tags:
        """Names (n,) MARKER by what was read, by where they are, and by what was gathered."""
        raise NotImplementedError

    def _look_through(self, cameras: tuple[Camera, ...]) -> None:
        if cameras != self._cameras.cameras:
            self._cameras = CameraArray(cameras)
            self._inside_px = np.array([self._kernels.least_inside_px(c) for c in cameras])

    def _admit(self, prediction: Prediction) -> None:
        joined = prediction.joined.get(self._family.name, ())
        if len(joined) > len(self._joined):
            self._grow(joined[len(self._joined) :])
            self._joined = joined

    def _search(self, prediction: Prediction, expected: Rows) -> Rows:
        """Searches what the plan says, and fits robots where they must be; returns (n,) MARKER."""
        markers = gather([np.zeros(0, dtype=MARKER)])
        if prediction.is_key_frame:
            ids = [camera.id for camera in self._cameras.cameras]
            turns = np.array([prediction.turns.get(id, 1) for id in ids], dtype=np.intp)
            is_gone = prediction.gone
            if is_gone is None:
                is_gone = not is_in(self._roster, prediction.expected["tag"]).all()
            wanted = np.where((turns % _COVERED == 0) & is_gone, len(self._roster), 0)
            quick = self._is_quick(prediction, expected, turns)
            markers = self._kernels.search(quick=quick, wanted=wanted)
            markers = self._believed(markers, expected)
        if prediction.is_key_frame or prediction.plan.warm:
            missing = self._contained(expected.where(~are_near(expected, markers)))
            # Where one robot was exchanged for another, both are expected: the marker is one.
            followed = each_once(self._kernels.follow(missing))
            lost = missing.picture[~are_near(missing, followed)]
            markers = join(markers, followed)
            # What a picture has shown holds until its camera's next one.
            self._unsettled.difference_update(c.id for c in self._cameras.cameras)
            self._unsettled |= {self._cameras.cameras[n].id for n in np.unique(lost).tolist()}
        if not prediction.is_key_frame:
            missing = expected.where(~are_near(expected, markers))
            more = self._kernels.search(*self._windows(prediction, missing))
            markers = join(markers, self._believed(more, expected))
        return markers

    def _is_quick(self, prediction: Prediction, expected: Rows, turns: Index) -> NDArray[np.bool_]:
        """Tells which pictures need no second look, (n,): what it shows besides is a newcomer.

        Robots that the first look does not show are followed to where they must be. So pictures
        take turns, but for those in which a robot was lost or something has no name, and those
        in which nobody is expected.
        """
        quick = np.bincount(expected.picture, minlength=len(self._cameras.cameras)) > 0
        for number, camera in enumerate(self._cameras.cameras):
            is_settled = camera.id not in self._unsettled and camera.id not in prediction.anonymous
            quick[number] &= turns[number] % _THOROUGH != 0 and is_settled
        return np.asarray(quick)

    def _contained(self, expected: Rows) -> Rows:
        """Leaves out those that cannot be wholly in their picture."""
        at_px = self._cameras.project(at_height(expected, self._height_m), expected.picture)
        margin_px = self._inside_px[expected.picture]
        return expected.where(self._cameras.contain(at_px, expected.picture, margin_px))

    def _windows(self, prediction: Prediction, missing: Rows) -> tuple[NDArray[np.int32], Index]:
        """Returns the squares where robots are missing, or markers without a name were."""
        places, pictures = [missing.places()], [missing.picture]
        for number, camera in enumerate(self._cameras.cameras):
            if camera.id in prediction.anonymous:
                places.append(prediction.anonymous[camera.id].places)
                pictures.append(np.full(len(places[-1]), number, dtype=np.intp))
        at, of = np.concatenate(places), np.concatenate(pictures)
        return prediction.windows(self._cameras, self._height_m, at, of), of

    def _add_tags(self, prediction: Prediction, number: int, tags: Tags, places: Floats) -> None:
        """Tells of tags in a picture that are not on the roster, and (n, 2) where they are."""
        prediction.unlisted[self._cameras.cameras[number].id] = UnlistedTags(
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


LEAST_UNIT_PX, GOOD_UNIT_PX = 1.0, 2.0
"""Of the outline's unit: none is named in a soft picture, at least nine of ten in a good one."""
LEAST_CELL_PX = 0.7
"""Of smaller cells, too."""
LEGIBLE_BLUR = 0.65
"""Standard deviation of the blur, in cells, in which markers are read in nearly every picture."""


@dataclass(frozen=True, slots=True)
class CellWidth:
    """How wide a family's cells are in a picture, and how wide they have to be [px].

    `px` is the width; below `least_px` hardly any marker can be named, from `good_px` on most.
    """

    family: str
    cell_mm: float
    px: float
    least_px: float
    good_px: float

    @property
    def is_illegible(self) -> bool:
        """Whether hardly any marker can be named."""
        return self.px < self.least_px

    @property
    def is_small(self) -> bool:
        """Whether many markers go without a name."""
        return self.px < self.good_px

    def in_words(self, seen: str = "") -> str:
        """Says how wide they are and what to do; `seen` is ", seen from where"."""
        larger = self.good_px / max(self.px, 1e-3)
        return (
            f"the cells of {self.family}, {self.cell_mm:g} mm, are {self.px:.2g} px wide{seen}:"
            f" expected at least {self.least_px:.2g} px, and {self.good_px:.2g} px for all robots"
            f" to be named; hang it lower, take a longer lens or more pixels, or print the markers"
            f" {larger:.1f} times as large"
        )


def cell_width(family: MarkerFamily | SquareFamily, px_per_m: float) -> CellWidth:
    """Returns how wide a family's cells are at a scale."""
    shape = shape_of(family)
    share = family.cell_mm / shape.unit_mm
    least_px = max(share * LEAST_UNIT_PX, LEAST_CELL_PX)
    good_px = max(share * GOOD_UNIT_PX, least_px)
    return CellWidth(
        family.name, family.cell_mm, 1e-3 * family.cell_mm * px_per_m, least_px, good_px
    )


def legible_blur_u(family: MarkerFamily | SquareFamily) -> float:
    """Returns the blur in which a family's markers are read, in units of their outline."""
    shape = shape_of(family)
    return LEGIBLE_BLUR * shape.cell_mm / shape.unit_mm


def cell_width_seen(
    family: MarkerFamily | SquareFamily, camera: Camera, height_m: float
) -> tuple[CellWidth, str]:
    """Returns how wide cells are in the middle of a camera's picture, and that in words.

    `height_m` is the markers' above the floor.
    """
    width = cell_width(family, camera.px_per_m(height_m))
    focal_px = (camera.fx_px * camera.fy_px) ** 0.5
    away_m = camera.position_m[2] - height_m
    seen = f", seen from {away_m:.2f} m above with a focal length of {focal_px:.0f} px"
    return width, width.in_words(seen)
