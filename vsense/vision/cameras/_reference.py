"""Whether a camera still looks where it looked when it was calibrated: two pictures compared.

The reference picture lies beside the camera file, `reference/cam1.png` beside `cam1.json`.

The reference is a picture of the calibration. Corners of what stands still in it are looked for in
the newer picture; one turn, zoom and shift is fitted to most of them, so that robots, things and
people that are elsewhere count for nothing. Light is normalised around every pixel.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats, Frame, Image
from vsense.base.errors import VsenseError
from vsense.vision.cameras.grabber import CameraEvent
from vsense.vision.cameras.picture import PictureError, read_picture

MOVED_SINCE_PX = 1.5
"""From this displacement on a camera has moved since its calibration. Pictures of cameras that
have not moved are found within 0.4 px in all that was tried; 2 px are always beyond."""

BACKGROUND_PICTURES = 15
"""More of them do not make a better background."""

_CORNERS, _GRID = 20, 4
"""Corners in each field of a grid of so many fields each way."""
_LEAST_CORNERS = 12
_LEAST_STRENGTH, _QUALITY = 3e-4, 0.01
"""Of a corner: above what noise makes of a plain floor, and a share of the strongest ones'."""
_APART_SHARE = 0.012
_LIGHT_SHARE = 0.025
_LEAST_LEVELS, _NOISE_TIMES = 4.0, 4.0
_LAPLACIAN = np.array([(1, -2, 1), (-2, 4, -2), (1, -2, 1)], dtype=np.float32)
"""What noise makes of it has 6 times its standard deviation, a smooth picture nothing.
Source: Immerkaer, Fast Noise Variance Estimation, 1996."""
_MEDIAN_OF_NORMAL = 0.6745
_GAIN = 40.0
_WINDOW, _LEVELS = 21, 4
_BACK_PX = 0.3
_FIT_PX = 0.7
_LEAST_SHARE, _LEAST_FITTED, _LEAST_FIELDS = 0.4, 10, 5
"""Of what was found again, so much has to fit together, in so many fields of the grid: a clock or a
maker's name that a camera writes into its pictures never moves, and fills fewer."""
_ITERATIONS, _CONFIDENCE = 5000, 0.999


_TRIES, _AGAIN_NS = 5, 300_000_000
"""A picture that does not say it may be one of a person, or of a camera that still sets its
exposure."""


class IncomparableError(VsenseError):
    """Two pictures from which nothing follows; the text says why, without a camera's name."""


@dataclass(frozen=True, slots=True)
class Displacement:
    """How far a camera's picture lies beside its reference.

    Attributes:
        px: the largest displacement at the picture's corners; infinite: what the reference shows
            is not found any more.
        turn_deg: clockwise in the picture.
        zoom: 1: none.
    """

    px: float
    turn_deg: float = 0.0
    zoom: float = 1.0

    @property
    def moved(self) -> bool:
        """Whether the camera has to be calibrated again, or put back."""
        return self.px >= MOVED_SINCE_PX

    def facts(self) -> dict[str, float | None]:
        """The figures for programs; `moved_px` is None where nothing was found again."""
        px = round(self.px, 2) if np.isfinite(self.px) else None
        return {"moved_px": px, "turn_deg": round(self.turn_deg, 3), "zoom": round(self.zoom, 5)}

    def in_words(self) -> str:
        """What has moved, for people; without the camera's name."""
        if not np.isfinite(self.px):
            return "far, is covered, or what it sees has changed"
        return (
            f"by {self.px:.1f} px at most (turned {self.turn_deg:+.2f} deg, zoom {self.zoom:.4f})"
        )


def background(images: Sequence[Image]) -> Image:
    """Returns what stands still in (h, w) uint8 pictures of one size: their median."""
    return np.asarray(np.median(np.stack(images), axis=0), dtype=np.uint8)


def compare(reference: Image, image: Image) -> Displacement:
    """Returns how far an (h, w) picture lies beside the reference picture of its camera.

    Raises:
        IncomparableError: sizes differ, or one of them shows too little.
    """
    if reference.shape != image.shape:
        (height, width), (rows, columns) = reference.shape, image.shape
        raise IncomparableError(
            f"its reference picture has {width} x {height} px, its pictures {columns} x {rows}"
        )
    before, now = _even(reference), _even(image)
    corners = _corners(before)
    for corners, which in ((_corners(now), "picture"), (_corners(before), "reference picture")):
        if len(corners) < _LEAST_CORNERS or _fields(corners, now.shape) < _LEAST_FIELDS:
            raise IncomparableError(f"its {which} shows too little that could be compared")
    fitted = _fit(before, now, corners)
    return Displacement(np.inf) if fitted is None else _displacement(fitted, reference.shape)


def _even(image: Image) -> Image:
    """The picture with the light around every pixel normalised."""
    grey = image.astype(np.float32)
    sigma = max(4.0, _LIGHT_SHARE * max(image.shape))
    size = int(3 * sigma) | 1
    mean = cv2.boxFilter(grey, -1, (size, size))
    power = cv2.sqrBoxFilter(grey, -1, (size, size))
    deviation = np.sqrt(np.maximum(power - mean * mean, 0.0))
    rough = np.abs(cv2.filter2D(grey, -1, _LAPLACIAN)[::2, ::2])
    noise = float(np.median(rough)) / (6.0 * _MEDIAN_OF_NORMAL)
    least = max(_LEAST_LEVELS, _NOISE_TIMES * noise)
    even = (grey - mean) * (_GAIN / np.maximum(deviation, least)) + 128.0
    return np.clip(cv2.GaussianBlur(even, (0, 0), 1.2), 0.0, 255.0).astype(np.uint8)


def _corners(even: Image) -> NDArray[np.float32]:
    """(n, 2) corners, some in each field of a grid, so that one corner of the room is not all."""
    height, width = even.shape
    apart = max(5.0, _APART_SHARE * width)
    strength = cv2.cornerMinEigenVal(even, 5)
    least = max(_LEAST_STRENGTH, _QUALITY * float(np.quantile(strength, 0.999)))
    found = []
    border = _WINDOW // 2 + 2
    for row in range(_GRID):
        for column in range(_GRID):
            top, left = row * height // _GRID, column * width // _GRID
            field = even[top : (row + 1) * height // _GRID, left : (column + 1) * width // _GRID]
            points = cv2.goodFeaturesToTrack(field, _CORNERS, 0.05, apart, blockSize=5)
            if points is not None:
                found.append(points[:, 0] + np.array((left, top), dtype=np.float32))
    if not found:
        return np.zeros((0, 2), dtype=np.float32)
    places = np.concatenate(found)
    x, y = np.rint(places).astype(int).T
    inside = (x >= border) & (x < width - border) & (y >= border) & (y < height - border)
    return np.asarray(places[inside & (strength[y, x] >= least)], dtype=np.float32)


def _fit(before: Image, now: Image, corners: NDArray[np.float32]) -> Floats | None:
    """The (2, 3) turn, zoom and shift of most corners; None: none."""
    there, is_there = _flow(before, now, corners)
    again, is_again = _flow(now, before, there)
    same = is_there & is_again & (np.hypot(*(again - corners).T) < _BACK_PX)
    if same.sum() < _LEAST_FITTED:
        return None
    found, fits = cv2.estimateAffinePartial2D(
        corners[same],
        there[same],
        method=cv2.RANSAC,
        ransacReprojThreshold=_FIT_PX,
        maxIters=_ITERATIONS,
        confidence=_CONFIDENCE,
    )
    if found is None:
        return None
    fitting = corners[same][fits.ravel() > 0]
    if len(fitting) < max(_LEAST_FITTED, _LEAST_SHARE * same.sum()):
        return None
    if _fields(fitting, before.shape) < _LEAST_FIELDS:
        return None
    return np.asarray(found)


def _fields(points: NDArray[np.float32], shape: tuple[int, ...]) -> int:
    """In how many fields of the grid (n, 2) points lie."""
    height, width = shape
    places = np.floor(points * _GRID / (width, height)).astype(int)
    return len(np.unique(places[:, 0] * _GRID + places[:, 1]))


def _flow(
    first: Image, second: Image, points: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Where (n, 2) points of one picture are in another, and whether they were found."""
    start = points[:, np.newaxis]
    end, status, _ = cv2.calcOpticalFlowPyrLK(
        first, second, start, start.copy(), winSize=(_WINDOW, _WINDOW), maxLevel=_LEVELS
    )
    return end[:, 0].astype(np.float32), status.ravel() > 0


def _displacement(fitted: Floats, shape: tuple[int, ...]) -> Displacement:
    height, width = shape
    ends = np.array([(0, 0), (width - 1, 0), (0, height - 1), (width - 1, height - 1)], dtype=float)
    ways = ends @ fitted[:, :2].T + fitted[:, 2] - ends
    turn = float(np.degrees(np.arctan2(fitted[1, 0], fitted[0, 0])))
    zoom = float(np.hypot(fitted[0, 0], fitted[1, 0]))
    return Displacement(float(np.hypot(*ways.T).max()), turn, zoom)


def reference_path(calibration: Path) -> Path:
    """Where the reference picture of a camera file lies."""
    return calibration.parent / "reference" / f"{calibration.stem}.png"


def read_reference(calibration: Path) -> Image | None:
    """Reads the reference picture of a camera file, (h, w) uint8; None: there is none.

    Raises:
        PictureError: it cannot be used.
    """
    path = reference_path(calibration)
    return read_picture(path, str(path)) if os.path.exists(path) else None


class ReferenceWatch:
    """Compares each camera's first picture with its reference, and one after `again`.

    Attributes:
        notes: lines for people about cameras that cannot be compared.
    """

    def __init__(self, calibrations: Mapping[str, Path], missed: bool = True) -> None:
        """Reads the reference pictures of cameras, by their names their camera files.

        `missed`: cameras without one are noted.
        """
        self._references: dict[str, Image] = {}
        self.notes: list[str] = []
        without = []
        for camera, path in calibrations.items():
            try:
                reference = read_reference(path)
            except PictureError as error:
                self.notes.append(f"camera {camera}: cannot be compared: {error}")
                continue
            if reference is None:
                without.append(camera)
            else:
                self._references[camera] = reference
        if without and missed:
            self.notes.append(
                f"no reference picture of {', '.join(without)}: whether a camera was moved since"
                " its calibration is not known (vsense camera calibrate check --keep takes one)"
            )
        self._displaced: set[str] = set()
        self._at_once = True
        self._due = dict.fromkeys(self._references, 0)
        self._again_ns = dict.fromkeys(self._references, -_AGAIN_NS)

    def again(self) -> None:
        """Has all cameras be compared once more, one for each timestep; any thread."""
        self._at_once = False
        self._due = dict.fromkeys(self._references, 0)

    def look(self, frames: Sequence[Frame]) -> list[CameraEvent]:
        """Compares pictures whose turn it is; returns what has begun or ended."""
        due = self._due
        mine = [f for f in frames if due.get(f.camera, _TRIES) < _TRIES and self._is_time(f)]
        return [e for f in (mine if self._at_once else mine[:1]) for e in self._compare(f, due)]

    def _is_time(self, frame: Frame) -> bool:
        return frame.capture_ns - self._again_ns[frame.camera] >= _AGAIN_NS

    def _compare(self, frame: Frame, due: dict[str, int]) -> list[CameraEvent]:
        camera = frame.camera
        self._again_ns[camera] = frame.capture_ns
        due[camera] += 1
        try:
            displacement = compare(self._references[camera], frame.image)
        except IncomparableError as error:
            return [CameraEvent(camera, "uncompared", str(error))] if due[camera] == _TRIES else []
        if not np.isfinite(displacement.px) and due[camera] < _TRIES:
            return []
        due[camera] = _TRIES
        if displacement.moved:
            self._displaced.add(camera)
            text = f"has moved {displacement.in_words()} since its calibration: its places are"
            return [CameraEvent(camera, "displaced", f"{text} wrong until it is calibrated again")]
        if camera not in self._displaced:
            return []
        self._displaced.remove(camera)
        return [CameraEvent(camera, "placed", "is where it was when it was calibrated")]
