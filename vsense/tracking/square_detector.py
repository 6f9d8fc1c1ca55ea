"""The detector for square markers that robots carry: from the picture to places in the arena."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vsense.arena import DETECTION, UNNAMED, wrap_angle
from vsense.cameras.camera import Camera
from vsense.markers.dictionary import FamilyError, Floats, SquareFamily
from vsense.tracking.covariance import square_covariance
from vsense.tracking.joining import UnlistedTags
from vsense.tracking.naming import carry_read_names
from vsense.tracking.prediction import NEAR_M, Anonymous, MarkerSearch, Prediction
from vsense.tracking.squares import SQUARE, SquareFinder, lengths
from vsense.tracking.squares_words import project_squares

_SCALE_DOUBT = 0.25
_TILTED = 1.5
"""A marker may look so much longer than face to face in the middle of the picture."""


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
        self._heights_m = np.array(sorted({search.height_m, *search.heights_m.values()}))
        self._finder = SquareFinder(family)
        self._roster = sorted(search.heights_m)
        self._prediction = prediction
        self._open_roster = search.open_roster

    @property
    def overflows(self) -> int:
        """None: the search for squares has no tables."""
        return 0

    def detect(self, image: NDArray[np.uint8], camera: Camera) -> NDArray[np.void]:
        """Returns the markers of a (height, width) uint8 picture, see DETECTION.

        Only whole markers of the family's size at the detector's heights are reported.
        """
        known = self._prediction
        if known is None:
            found, corners_m = self._keep(self._finder.find(image, *self._sides(camera)), camera)
            return self._place(found, found["tag"], corners_m, camera, self._roster)
        roster = [*self._roster, *known.joined.get(self._family.name, ())]
        expected = known.in_view(camera, self._height_m)
        expected = expected[np.isin(expected["tag"], roster)]
        found, corners_m = self._search(image, camera, known, expected)
        tags = carry_read_names(found["tag"], corners_m.mean(axis=1), expected)
        self._note(known, camera, tags, corners_m.mean(axis=1), roster)
        return self._place(found, tags, corners_m, camera, roster)

    def _note(
        self,
        known: Prediction,
        camera: Camera,
        tags: NDArray[np.int32],
        places: Floats,
        roster: Sequence[int],
    ) -> None:
        """Keeps where markers without a name are, and the tags that are not on the roster."""
        nameless = np.flatnonzero(~np.isin(tags, roster))
        cells, once = np.zeros((len(nameless), 0)), np.ones(len(nameless), dtype=np.int64)
        known.anonymous[camera.id] = Anonymous(
            nameless, places[nameless], cells, once, known.capture_ns
        )
        if self._open_roster:
            rows = nameless[tags[nameless] != UNNAMED]
            known.unlisted[camera.id] = UnlistedTags(
                self._family, roster, self._height_m, tags[rows], places[rows]
            )

    def _search(
        self,
        image: NDArray[np.uint8],
        camera: Camera,
        known: Prediction,
        expected: NDArray[np.void],
    ) -> tuple[NDArray[np.void], Floats]:
        """Searches what the plan says; robots that it does not find are fitted where they must be.

        Returns (n,) SQUARE, and (n, 4, 2) their corners on the plane of reference.
        """
        if known.is_key_frame:
            found, corners_m = self._keep(self._finder.find(image, *self._sides(camera)), camera)
        else:
            found, corners_m = np.zeros(0, dtype=SQUARE), np.zeros((0, 4, 2))
        if known.is_key_frame or known.plan.warm:
            missing = expected[~_near_any(_places(expected), corners_m)]
            fitted = self._finder.follow(image, self._corners_px(camera, missing))
            found, corners_m = self._add(camera, found, corners_m, fitted)
        if not known.is_key_frame:
            places = _places(expected[~_near_any(_places(expected), corners_m)])
            if camera.id in known.anonymous:
                places = np.concatenate((places, known.anonymous[camera.id].places))
            squares = known.windows(camera, self._height_m, places)
            near = self._finder.find_near(image, squares, *self._sides(camera))
            found, corners_m = self._add(camera, found, corners_m, near)
        return found, corners_m

    def _add(
        self, camera: Camera, found: NDArray[np.void], corners_m: Floats, more: NDArray[np.void]
    ) -> tuple[NDArray[np.void], Floats]:
        """Adds what is of the family's size and at none of the places found already."""
        more, more_m = self._keep(more, camera)
        new = ~_near_any(more_m.mean(axis=1), corners_m)
        return np.concatenate((found, more[new])), np.concatenate((corners_m, more_m[new]))

    def _sides(self, camera: Camera) -> tuple[float, float]:
        """Returns the shortest and the longest side of a marker in the picture [px]."""
        away_m = camera.position_m[2] - self._heights_m
        side_px = 1e-3 * self._family.size_mm * camera.fx_px / away_m
        return float((1.0 - _SCALE_DOUBT) * side_px.min()), float(_TILTED * side_px.max())

    def _keep(self, found: NDArray[np.void], camera: Camera) -> tuple[NDArray[np.void], Floats]:
        """Keeps squares of the family's size; gives their corners on the plane, too."""
        corners = camera.to_plane(found["corners_px"], self._height_m)
        top_m = camera.position_m[2]
        scale = (top_m - self._height_m) / (top_m - self._heights_m)
        length = 1e3 * lengths(corners) / self._family.size_mm
        fits = (length > (1.0 - _SCALE_DOUBT) * scale.min()) & (
            length < (1.0 + _SCALE_DOUBT) * scale.max()
        )
        whole = fits.all(axis=1)
        return found[whole], corners[whole]

    def _corners_px(self, camera: Camera, robots: NDArray[np.void]) -> Floats:
        """Returns where the corners of expected robots should be, (n, 4, 2)."""
        top_m = camera.position_m[2]
        scale = (top_m - self._height_m) / (top_m - robots["height_m"])
        half = 0.5 * self._family.size_mm
        turn = np.radians(self._family.heading_deg)
        c, s = np.cos(turn), np.sin(turn)
        upright = half * np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)])
        ahead = c * upright[:, 0] + s * upright[:, 1]
        left = -s * upright[:, 0] + c * upright[:, 1]
        marker = 1e-3 * (np.stack((ahead, left), axis=-1) - self._family.disc_centre_mm)
        c, s = np.cos(robots["yaw_rad"]), np.sin(robots["yaw_rad"])
        x, y = scale[:, np.newaxis] * marker[:, 0], scale[:, np.newaxis] * marker[:, 1]
        points = np.full((len(robots), 4, 3), self._height_m)
        points[..., 0] = robots["x_m"][:, np.newaxis] + c[:, np.newaxis] * x - s[:, np.newaxis] * y
        points[..., 1] = robots["y_m"][:, np.newaxis] + s[:, np.newaxis] * x + c[:, np.newaxis] * y
        return camera.project(points)

    def _place(
        self,
        found: NDArray[np.void],
        tags: NDArray[np.int32],
        corners_m: Floats,
        camera: Camera,
        roster: Sequence[int],
    ) -> NDArray[np.void]:
        rows = np.zeros(len(found), dtype=DETECTION)
        if len(rows) == 0:
            return rows
        a, b, c, d = np.moveaxis(corners_m, 1, 0)
        up, right = (a + b) - (c + d), (b + c) - (a + d)
        ahead = up + np.stack((-right[:, 1], right[:, 0]), axis=-1)
        yaw = np.arctan2(ahead[:, 1], ahead[:, 0]) + np.radians(self._family.heading_deg)
        middle = project_squares(corners_m, np.array([[0.5, 0.5]]))[:, 0]
        cos, sin = np.cos(yaw), np.sin(yaw)
        scale = lengths(corners_m).mean(axis=1) / self._family.size_mm
        x, y = (scale * offset for offset in self._family.disc_centre_mm)
        centre = middle + np.stack((cos * x - sin * y, sin * x + cos * y), axis=-1)
        pixels = camera.project(np.column_stack((centre, np.full(len(rows), self._height_m))))
        rows["tag"] = np.where(np.isin(tags, roster), tags, UNNAMED)
        rows["x_px"], rows["y_px"] = pixels[:, 0], pixels[:, 1]
        rows["yaw_rad"] = wrap_angle(yaw)
        m_per_px = (camera.position_m[2] - self._height_m) / camera.fx_px
        errors_m = m_per_px * found["residual_px"], m_per_px * found["blur_px"]
        rows["covariance"] = square_covariance(self._family, *errors_m, cos, sin)
        rows["error"], rows["margin"] = found["error"], found["margin"]
        return rows


def _places(robots: NDArray[np.void]) -> Floats:
    """Returns where EXPECTED robots are, (n, 2)."""
    return np.stack((robots["x_m"], robots["y_m"]), axis=1)


def _near_any(places: Floats, corners_m: Floats) -> NDArray[np.bool_]:
    """Tells which (n, 2) places are those of markers whose (k, 4, 2) corners are known."""
    offset = places[:, np.newaxis] - corners_m.mean(axis=1)
    return np.asarray((np.hypot(offset[..., 0], offset[..., 1]) < NEAR_M).any(axis=1))
