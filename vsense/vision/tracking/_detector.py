"""Detectors: from the pictures of a timestep to the markers in them.

What to believe, and how to name it, depends on the family: `ArrowDetector` is for the project's
arrows, `SquareDetector` for ArUco and AprilTag markers; what they share is `MarkerDetector`. A new
kind of marker gets a class here, and a line in `detector_of`. `CameraDetectors` searches each
camera's pictures for what is looked for there.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Protocol

import numpy as np

from vsense.base.arena import UNNAMED
from vsense.vision.markers.families import MarkerFamily, SquareFamily
from vsense.vision.tracking._joining import Tags
from vsense.vision.tracking._naming import (
    Decoder,
    carry_names,
    find_unlisted_tags,
    gather_evidence,
    note_nameless,
    were_nameless,
)
from vsense.vision.tracking._prediction import MarkerSearch, Prediction
from vsense.vision.tracking._rows import Rows, are_near, is_in
from vsense.vision.tracking._workers import Picture, Workers
from vsense.vision.tracking.marker_detector import Detected, MarkerDetector


class Detector(Protocol):
    """Finds markers in pictures; called by one thread at a time."""

    def detect_all(self, pictures: Sequence[Picture]) -> list[Detected]:
        """Returns what is in each of a timestep's pictures."""


class DetectorMaker(Protocol):
    """What has pictures that are not here."""

    def detectors(self, prediction: Prediction) -> Mapping[str, Detector]:
        """Returns the detectors of its cameras, by their ids."""


class ArrowDetector(MarkerDetector):
    """Finds the arrows of one family and names those of a roster.

    Where an arrow's cells do not say enough, its name follows from where it is, or from what they
    have said over several pictures.
    """

    def __init__(
        self,
        family: MarkerFamily,
        search: MarkerSearch,
        prediction: Prediction | None,
        workers: Workers,
    ) -> None:
        """See `detector_of`; `family` is that of `search`."""
        self._arrows = family
        super().__init__(family, search, prediction, workers)

    def _grow(self, tags: Iterable[int]) -> None:
        """Prepares the code words of the whole roster anew."""
        super()._grow(tags)
        self._decoder = Decoder(self._arrows, self._roster.tolist())
        self._kernels.read_codes(self._decoder.struct)

    def _believed(self, markers: Rows, expected: Rows) -> Rows:
        """All of them: nothing else has an arrow's outline."""
        return markers

    def _name(self, prediction: Prediction, markers: Rows, expected: Rows) -> Tags:
        """Names what is read, then what is where a robot must be, then what says enough by now."""
        cells = markers.values["cell"][:, : self._arrows.grid**2]
        tags = markers.values["tag"].astype(np.int32)
        decoder = self._decoder
        tags = carry_names(tags, markers, expected)
        ids = [camera.id for camera in self._cameras.cameras]
        tags = gather_evidence(tags, markers, cells, ids, prediction, decoder)
        if self._open_roster:
            for number, camera in enumerate(ids):
                if camera in prediction.anonymous:
                    gathered = prediction.anonymous[camera]
                    unlisted = find_unlisted_tags(tags, markers, gathered, decoder)
                    self._add_tags(prediction, number, *unlisted)
        return tags


class SquareDetector(MarkerDetector):
    """Finds the square markers of one family and names those of a roster.

    A black square without a word is a marker only where a robot is expected, and as long as it can
    be followed from there.
    """

    def _believed(self, markers: Rows, expected: Rows) -> Rows:
        believed = (markers.values["tag"] != UNNAMED) | are_near(markers, expected)
        if (prediction := self._prediction) is not None and not believed.all():
            cameras = [camera.id for camera in self._cameras.cameras]
            believed |= were_nameless(markers, cameras, prediction)
        return markers.where(believed)

    def _name(self, prediction: Prediction, markers: Rows, expected: Rows) -> Tags:
        """A word that is read is believed: those of a family differ in many cells."""
        tags = carry_names(markers.values["tag"].astype(np.int32), markers, expected)
        nameless = ~is_in(tags, self._roster)
        cameras = [camera.id for camera in self._cameras.cameras]
        note_nameless(nameless, markers, np.zeros((len(tags), 0)), cameras, prediction)
        if self._open_roster:
            for number, camera in enumerate(cameras):
                if camera in prediction.anonymous:
                    rows = prediction.anonymous[camera].rows
                    rows = rows[tags[rows] != UNNAMED]
                    self._add_tags(prediction, number, tags[rows], markers.where(rows).places())
        return tags


def make_detector(
    family: MarkerFamily | SquareFamily,
    roster: Iterable[int],
    height_m: float,
    prediction: Prediction | None = None,
    workers: Workers | None = None,
) -> MarkerDetector:
    """Returns a new detector of markers at one height above the floor; see `detector_of`."""
    heights_m = dict.fromkeys(roster, height_m)
    return detector_of(MarkerSearch(family, heights_m, at_m=height_m), prediction, workers)


def detector_of(
    search: MarkerSearch, prediction: Prediction | None, workers: Workers | None = None
) -> MarkerDetector:
    """Returns a new detector.

    Args:
        prediction: What the arena tracker expects; without it every picture is searched and read
            for itself.
        workers: Share the pictures; without them the caller's thread does all.

    Raises:
        FamilyError: The family does not have a tag of the roster.
    """
    workers = workers or Workers()
    if isinstance(search.family, SquareFamily):
        return SquareDetector(search.family, search, prediction, workers)
    return ArrowDetector(search.family, search, prediction, workers)


class CameraDetectors:
    """A detector that finds in each camera's pictures what is looked for there.

    `sees` has each camera's search by its id; cameras with the same search share a detector.
    `others` has the detectors of those that are not to be searched here.
    """

    def __init__(
        self,
        sees: Mapping[str, MarkerSearch],
        prediction: Prediction,
        workers: Workers,
        others: Mapping[str, Detector] | None = None,
    ) -> None:
        others = others or {}
        searches = {id(search): search for camera, search in sees.items() if camera not in others}
        built = {key: detector_of(search, prediction, workers) for key, search in searches.items()}
        self._detectors: dict[str, Detector] = {
            camera: others[camera] if camera in others else built[id(search)]
            for camera, search in sees.items()
        }
        self._distinct = list({id(d): d for d in self._detectors.values()}.values())

    def detect_all(self, pictures: Sequence[Picture]) -> list[Detected]:
        """See `Detector.detect_all`."""
        detections: dict[str, Detected] = {}
        for detector in self._distinct:
            mine = [p for p in pictures if self._detectors[p.camera.id] is detector]
            if mine:
                ids = (picture.camera.id for picture in mine)
                detections.update(zip(ids, detector.detect_all(mine), strict=True))
        return [detections[picture.camera.id] for picture in pictures]
