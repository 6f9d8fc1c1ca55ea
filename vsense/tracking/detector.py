"""Detectors: from a picture to the markers in it.

`ArrowDetector` reads the project's arrows: the kernel finds and fits them, the decoder names them,
and where a tracker says what to expect, known robots are fitted where they must be and keep their
names. `CameraDetectors` searches each camera's pictures for what is looked for there.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import count
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from vsense.arena import DETECTION, Frame
from vsense.cameras.camera import Camera
from vsense.markers.families import MarkerFamily, SquareFamily
from vsense.tracking.covariance import OutlineCovariance
from vsense.tracking.decoder import DecodedTag, Decoder, Tags
from vsense.tracking.joining import UnlistedTags
from vsense.tracking.kernel import MARKER, Image, LayeredKernel, are_near, join, places_of
from vsense.tracking.naming import carry_names, find_unlisted_tags, gather_evidence
from vsense.tracking.prediction import MarkerSearch, Prediction
from vsense.tracking.square_detector import SquareDetector


class Detector(Protocol):
    """Finds markers in one picture; called by one thread at a time."""

    @property
    def overflows(self) -> int:
        """Pictures with more in them than the detector's tables hold; markers may be missed."""

    def detect(self, image: NDArray[np.uint8], camera: Camera) -> NDArray[np.void]:
        """Returns the DETECTION array of a (height, width) uint8 picture of `camera`."""


class ArrowDetector:
    """Finds the arrows of one family and names those of a roster."""

    def __init__(
        self, family: MarkerFamily, search: MarkerSearch, prediction: Prediction | None
    ) -> None:
        """See `detector_of`; `family` is that of `search`."""
        self._family = family
        self._height_m = search.height_m
        self._cells = family.grid**2
        self._kernel = LayeredKernel(family, search.height_m, search.heights_m.values())
        self._covariance = OutlineCovariance(family)
        self._roster = sorted(search.heights_m)
        self._decoder = Decoder(family, self._roster)
        self._joined: tuple[int, ...] = ()
        self._prediction = prediction
        self._open_roster = search.open_roster

    @property
    def overflows(self) -> int:
        """See `Detector.overflows`."""
        return self._kernel.overflows

    def detect(self, image: Image, camera: Camera) -> NDArray[np.void]:
        """See `Detector.detect`; markers that are not wholly in the picture are not reported."""
        known = self._prediction
        if known is None:
            return self._report(self._kernel.search(image, camera), camera, None)
        self._grow(known)
        expected = known.in_view(camera, self._height_m)
        if known.is_key_frame:
            markers = self._kernel.search(image, camera)
            missing = expected[~are_near(expected, markers)]
            markers = join(markers, self._kernel.follow(image, camera, missing))
        else:
            markers = np.zeros(0, dtype=MARKER)
            if known.plan.warm:
                markers = self._kernel.follow(image, camera, expected)
            missing = expected[~are_near(expected, markers)]
            markers = join(markers, self._search_squares(image, camera, known, missing))
        return self._report(markers, camera, expected)

    def _grow(self, known: Prediction) -> None:
        joined = known.joined.get(self._family.name, ())
        if joined != self._joined:
            self._joined = joined
            self._decoder = Decoder(self._family, [*self._roster, *joined])

    def _search_squares(
        self, image: Image, camera: Camera, known: Prediction, robots: NDArray[np.void]
    ) -> NDArray[np.void]:
        """Searches around where robots are expected, and markers without a name were."""
        places = places_of(robots)
        if camera.id in known.anonymous:
            places = np.concatenate((places, known.anonymous[camera.id].places))
        if len(places) == 0:
            return np.zeros(0, dtype=MARKER)
        squares = known.windows(camera, self._height_m, places)
        return self._kernel.search(image, camera, squares)

    def _report(
        self, markers: NDArray[np.void], camera: Camera, expected: NDArray[np.void] | None
    ) -> NDArray[np.void]:
        found = np.zeros(len(markers), dtype=DETECTION)
        if len(found) == 0:
            return found
        cells = markers["cell"][:, : self._cells]
        sharpness = markers["sharp_ahead"], markers["sharp_left"]
        reading = self._decoder.decode(cells, *sharpness)
        tags = reading.tags
        if expected is not None and self._prediction is not None:
            tags = self._name(self._prediction, camera, markers, reading, expected)
        found["tag"], found["error"], found["margin"] = tags, reading.error, reading.margin
        found["x_px"], found["y_px"] = markers["x_px"], markers["y_px"]
        found["yaw_rad"] = np.arctan2(markers["ahead_y"], markers["ahead_x"])
        blur = (self._decoder.blur(sharp) for sharp in sharpness)
        found["covariance"] = self._covariance.covariance(markers, *blur)
        return found

    def _name(
        self,
        known: Prediction,
        camera: Camera,
        markers: NDArray[np.void],
        reading: DecodedTag,
        expected: NDArray[np.void],
    ) -> Tags:
        """Names markers by where they are, and by what was gathered of them."""
        cells = markers["cell"][:, : self._cells]
        sharpness = markers["sharp_ahead"], markers["sharp_left"]
        places = places_of(markers)
        decoder, id = self._decoder, camera.id
        tags = carry_names(reading.tags, reading, decoder.tags, places, expected)
        tags = gather_evidence(tags, cells, sharpness, places, id, known, decoder)
        if self._open_roster:
            unlisted = find_unlisted_tags(tags, sharpness, known.anonymous[id], decoder)
            roster = decoder.tags.tolist()
            known.unlisted[id] = UnlistedTags(self._family, roster, self._height_m, *unlisted)
        return tags


def make_detector(
    family: MarkerFamily | SquareFamily,
    roster: Iterable[int],
    height_m: float,
    prediction: Prediction | None = None,
) -> Detector:
    """Returns a new detector of markers at one height above the floor; see `detector_of`."""
    heights_m = dict.fromkeys(roster, height_m)
    return detector_of(MarkerSearch(family, heights_m, at_m=height_m), prediction)


def detector_of(search: MarkerSearch, prediction: Prediction | None) -> Detector:
    """Returns a new detector; each thread needs one of its own.

    Args:
        prediction: What the arena tracker expects, the same for all of its detectors; without it
            every picture is searched and read for itself.

    Raises:
        FamilyError: The family does not have a tag of the roster.
    """
    if isinstance(search.family, SquareFamily):
        return SquareDetector(search.family, search, prediction)
    return ArrowDetector(search.family, search, prediction)


class CameraDetectors:
    """A detector that finds in each camera's pictures what is looked for there.

    `sees` has each camera's search by its id; cameras with the same search share a detector.
    """

    def __init__(self, sees: Mapping[str, MarkerSearch], prediction: Prediction) -> None:
        searches = {id(search): search for search in sees.values()}
        made = {key: detector_of(search, prediction) for key, search in searches.items()}
        self._detectors = {camera: made[id(search)] for camera, search in sees.items()}
        self._each = list(made.values())

    @property
    def overflows(self) -> int:
        """See `Detector.overflows`."""
        return sum(detector.overflows for detector in self._each)

    def detect(self, image: NDArray[np.uint8], camera: Camera) -> NDArray[np.void]:
        """See `Detector.detect`."""
        return self._detectors[camera.id].detect(image, camera)


class Detected(NamedTuple):
    """DETECTION `rows` of one picture, and whether it held more than the detector's tables."""

    rows: NDArray[np.void]
    full: bool


class Workers:
    """Shares pictures out to threads; the same pictures to the same ones, whichever is faster."""

    def __init__(self, make_detector: Callable[[], Detector], number: int, pin: bool) -> None:
        """Starts the threads.

        Args:
            make_detector: Makes one detector per thread.
            number: How many threads, 1 or more.
            pin: Keep each on a processor of its own, where there are as many.
        """
        self._detectors = [make_detector() for _ in range(number)]
        turns = count()
        begin = (lambda: _pin(next(turns))) if pin else None
        self._pool = ThreadPoolExecutor(number, "tracking", begin)

    def detect(self, frames: Sequence[Frame], cameras: Mapping[str, Camera]) -> list[Detected]:
        """Returns what is in each picture, in the order of the pictures."""
        number = len(self._detectors)

        def work(worker: int) -> list[Detected]:
            detector = self._detectors[worker]
            return [_detect(detector, f, cameras[f.camera]) for f in frames[worker::number]]

        shares = list(self._pool.map(work, range(number)))
        return [shares[place % number][place // number] for place in range(len(frames))]

    def close(self) -> None:
        """Ends the threads; can be called again."""
        self._pool.shutdown()


def _detect(detector: Detector, frame: Frame, camera: Camera) -> Detected:
    before = detector.overflows
    rows = detector.detect(frame.image, camera)
    return Detected(rows, detector.overflows != before)


def _pin(turn: int) -> None:
    """Keeps the calling thread on the processor of its turn, where the system can do that."""
    if hasattr(os, "sched_setaffinity"):
        allowed = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {allowed[turn % len(allowed)]})
