"""Detectors: from a picture to the markers in it.

A detector is anything with the one method of `Detector`. `ArrowDetector` reads the project's
arrows: candidates, outline, cells, tag. Its search for candidates is handed in, so that a
faster one takes its place without any other change.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vsense.arena import DETECTION, wrap_angle
from vsense.tracking.camera import Camera
from vsense.tracking.candidates import CandidateSearch
from vsense.tracking.decoder import Decoder
from vsense.tracking.families import MarkerFamily
from vsense.tracking.outline import Fits, OutlineFit, look, place

Floats = NDArray[np.float64]

_PASSES = ((1.0, 13, 0.6, 0.25), (0.6, 11, 0.8, 0.1))
"""Each pass of the fit: how far to look [u], in how many steps, the least coverage and the
greatest residual [u] to go on with. In a good picture markers have 0.02 u, look-alikes 0.2 u."""

_SCALE_DOUBT = 0.12
_LEAST_CONTRAST = 25.0
_BORDER_PX = 2.0


class Detector(Protocol):
    """Finds markers in one picture; called by one thread at a time."""

    def detect(self, image: NDArray[np.uint8], camera: Camera) -> NDArray[np.void]:
        """Returns the DETECTION array of a (height, width) uint8 picture of `camera`."""


class Search(Protocol):
    """Proposes where markers may be."""

    def find(self, image: NDArray[np.uint8], px_per_mm: float) -> NDArray[np.void]:
        """Returns a CANDIDATE array; see `CandidateSearch.find`."""


class ArrowDetector:
    """Finds the arrows of one family and names those of a roster."""

    def __init__(
        self,
        family: MarkerFamily,
        roster: Sequence[int],
        height_m: float,
        search: Search | None = None,
    ) -> None:
        """Prepares the detector.

        Args:
            family: The marker family.
            roster: The tags in the arena; a marker with any other is reported without a name.
            height_m: Height of the markers above the floor, about: the scale of what is found
                may differ by a tenth.
            search: What proposes candidates.

        Raises:
            FamilyError: The family does not have a tag of the roster.
        """
        self._family = family
        self._height_m = height_m
        self._search = search or CandidateSearch(family)
        self._outline = OutlineFit(family)
        self._decoder = Decoder(family, roster)
        self._lead_m = 1e-3 * float((family.disc_centre_mm - family.outline_centroid_mm)[0])
        inner = np.array([-0.25, 0.0, 0.25]) * family.cell_mm
        spots = np.stack(np.meshgrid(inner, inner), axis=-1).reshape(-1, 2)
        cells = family.cells_mm[:, np.newaxis] + spots - family.disc_centre_mm
        self._spots_m = 1e-3 * cells.reshape(-1, 2)
        turn = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
        self._rim_m = 0.5e-3 * family.disc_diameter_mm * np.stack((np.cos(turn), np.sin(turn)), 1)

    def detect(self, image: NDArray[np.uint8], camera: Camera) -> NDArray[np.void]:
        """Returns the markers of a (height, width) uint8 picture, see DETECTION.

        Markers that are not wholly in the picture are not reported.
        """
        px_per_mm = 1e-3 * camera.fx_px / (camera.position_m[2] - self._height_m)
        fits = self._begin(self._search.find(image, px_per_mm), camera)
        for reach_u, steps, coverage, residual_u in _PASSES:
            if len(fits.scale) == 0:
                return np.zeros(0, dtype=DETECTION)
            fits = self._outline.fit(image, camera, self._height_m, fits, reach_u, steps)
            fits = fits.keep(
                (fits.coverage >= coverage)
                & (fits.residual_mm < residual_u * self._family.unit_mm)
                & (np.abs(fits.scale - 1.0) < _SCALE_DOUBT)
                & (fits.white - fits.black > _LEAST_CONTRAST)
            )
        fits = _distinct(fits, 5e-4 * self._family.disc_diameter_mm)
        return self._name(image, camera, fits.keep(self._whole(fits, camera)))

    def _begin(self, candidates: NDArray[np.void], camera: Camera) -> Fits:
        """Returns the poses that the candidates' centroids and directions suggest."""
        pixels = np.stack((candidates["x_px"], candidates["y_px"]), axis=-1)
        ahead = np.stack((candidates["ahead_x"], candidates["ahead_y"]), axis=-1)
        centroid, tip = camera.to_plane(np.stack((pixels, pixels + ahead)), self._height_m)
        direction = tip - centroid
        yaw = np.arctan2(direction[:, 1], direction[:, 0])
        shift = self._lead_m * np.stack((np.cos(yaw), np.sin(yaw)), axis=1)
        unknown = np.zeros(len(yaw))
        return Fits(centroid + shift, yaw, unknown + 1.0, unknown, unknown, unknown, unknown)

    def _whole(self, fits: Fits, camera: Camera) -> NDArray[np.bool_]:
        """Tells whose disc is wholly in the picture."""
        rim = camera.project(place(self._rim_m[np.newaxis], fits, self._height_m))
        return np.asarray(camera.contains(rim, _BORDER_PX).all(axis=1))

    def _name(self, image: NDArray[np.uint8], camera: Camera, fits: Fits) -> NDArray[np.void]:
        """Reads the cells of fitted outlines and makes DETECTION rows of them."""
        found = np.zeros(len(fits.scale), dtype=DETECTION)
        if len(found) == 0:
            return found
        spots = place(fits.scale[:, np.newaxis, np.newaxis] * self._spots_m, fits, self._height_m)
        seen = camera.project(spots).astype(np.float32)
        grey = look(image, seen[..., 0], seen[..., 1])
        cells = grey.reshape(len(found), self._family.grid**2, -1).mean(axis=2)
        bright = (cells - fits.black[:, np.newaxis]) / (fits.white - fits.black)[:, np.newaxis]
        centre = np.column_stack((fits.centre_m, np.full(len(found), self._height_m)))
        pixels = camera.project(centre)
        found["tag"], found["error"], found["margin"] = self._decoder.decode(bright)
        found["x_px"], found["y_px"] = pixels[:, 0], pixels[:, 1]
        found["yaw_rad"] = wrap_angle(fits.yaw_rad)
        found["weight"] = 1.0 / (1e-3 * (0.1 + fits.residual_mm)) ** 2
        return found


def _distinct(fits: Fits, least_m: float) -> Fits:
    """Keeps the best fit of those that lie closer together than two markers can."""
    order = np.argsort(fits.residual_mm, kind="stable")
    kept: list[int] = []
    for place_ in order:
        gap = fits.centre_m[kept] - fits.centre_m[place_]
        if not kept or np.hypot(gap[:, 0], gap[:, 1]).min() >= least_m:
            kept.append(int(place_))
    return Fits(*(values[kept] for values in fits))
