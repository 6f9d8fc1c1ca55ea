"""Detects a moved camera by the shift of the background behind the robots.

Corners of the floor are chosen in a first picture, away from the robots. Later the small patches
around them are compared, laid side by side in one picture and with the light normalised. Some get
covered; most of them decide.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

FAR = float("inf")
"""The shift of a camera whose background is not found any more."""

Floats = NDArray[np.float64]

_WIDTH_PX = 400
_PATCHES = 32
_COLUMNS = 8
_LEAST_PATCHES = 10
_HALF_PX = 24
_ROBOT_PX = 60
_QUALITY = 0.02
_BLUR_PX = 1.6
_GAIN = 40.0
_LEAST_DEVIATION = 3.0
_WINDOW = 31
_LEVELS = 2
_AGREE_PX = 0.6
_LEAST_SHARE = 0.35
_WORN_SHARE = 0.6
_WORN_PX = 0.5


class Steadiness:
    """The background of one camera; the first picture is the reference."""

    def __init__(self, size_px: tuple[int, int]) -> None:
        """Takes width and height of the camera's pictures."""
        self._size_px = size_px
        self._places: NDArray[np.int64] = np.zeros((0, 2), dtype=np.int64)
        self._reference = np.zeros((0, 0), dtype=np.uint8)
        self._origin = np.zeros(2)

    def shift_px(self, image: NDArray[np.uint8], markers_px: Floats | None = None) -> float | None:
        """Returns the shift of an (h, w) uint8 picture's background since the first picture.

        `markers_px` (n, 2) are places of robots, which are not background. The shift is that of
        most patches; `FAR`: they disagree; None: unknown.
        """
        if len(self._places) < _LEAST_PATCHES:
            self._learn(image, markers_px)
            return None
        ways, found = self._ways(self._mosaic(image))
        middle = np.median(ways[found], axis=0) if found.any() else np.zeros(2)
        agree = found & (np.hypot(*(ways - middle).T) < _AGREE_PX)
        if agree.mean() < _LEAST_SHARE:
            return FAR
        way = np.median(ways[agree], axis=0)
        shift = self._origin + way
        if agree.mean() < _WORN_SHARE and np.hypot(*way) < _WORN_PX:
            # The floor has changed in places, or robots stand on it: new patches.
            self._origin = shift
            self._learn(image, markers_px)
        return float(np.hypot(*shift))

    def _learn(self, image: NDArray[np.uint8], markers_px: Floats | None) -> None:
        """Chooses corners of the background and keeps their patches."""
        reduction = max(1, round(self._size_px[0] / _WIDTH_PX))
        width, height = (side // reduction for side in self._size_px)
        part = image[: height * reduction, : width * reduction]
        small = cv2.resize(part, (width, height), interpolation=cv2.INTER_AREA)
        border = -(-_HALF_PX // reduction) + 1
        usable = np.zeros_like(small)
        usable[border:-border, border:-border] = 255
        for marker in [] if markers_px is None else markers_px:
            middle = np.rint(marker / reduction).astype(int).tolist()
            cv2.circle(usable, middle, _ROBOT_PX // reduction, 0, -1)
        apart = max(4.0, min(width, height) / 20)
        points = cv2.goodFeaturesToTrack(small, _PATCHES, _QUALITY, apart, mask=usable)
        if points is None or len(points) < _LEAST_PATCHES:
            return
        places = (points[:, 0] + 0.5) * reduction - 0.5
        self._places = np.rint(places).astype(np.int64)
        self._reference = self._mosaic(image)

    def _mosaic(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Lays the patches side by side, each with its light normalised."""
        span = np.arange(-_HALF_PX, _HALF_PX)
        rows = self._places[:, 1, np.newaxis, np.newaxis] + span[:, np.newaxis]
        columns = self._places[:, 0, np.newaxis, np.newaxis] + span
        patches = image[rows, columns].astype(np.float32)
        mean = patches.mean(axis=(1, 2), keepdims=True)
        deviation = np.maximum(patches.std(axis=(1, 2), keepdims=True), _LEAST_DEVIATION)
        even = np.clip((patches - mean) * (_GAIN / deviation) + 128.0, 0.0, 255.0)
        count = -(-len(even) // _COLUMNS) * _COLUMNS
        side = 2 * _HALF_PX
        tiles = np.full((count, side, side), 128.0, dtype=np.float32)
        tiles[: len(even)] = even
        lines = tiles.reshape(-1, _COLUMNS, side, side).swapaxes(1, 2)
        mosaic = lines.reshape(-1, _COLUMNS * side).astype(np.uint8)
        return np.asarray(cv2.GaussianBlur(mosaic, (0, 0), _BLUR_PX), dtype=np.uint8)

    def _ways(self, mosaic: NDArray[np.uint8]) -> tuple[Floats, NDArray[np.bool_]]:
        """Returns each patch's shift, (n, 2) px, and whether it was found."""
        number = np.arange(len(self._places))
        middles = np.stack((number % _COLUMNS, number // _COLUMNS), axis=-1) * 2 * _HALF_PX
        start = (middles + _HALF_PX).astype(np.float32)[:, np.newaxis]
        end, status, _ = cv2.calcOpticalFlowPyrLK(
            self._reference,
            mosaic,
            start,
            start.copy(),
            winSize=(_WINDOW, _WINDOW),
            maxLevel=_LEVELS,
        )
        ways = (end - start)[:, 0].astype(np.float64)
        inside = np.abs(ways).max(axis=1) < _HALF_PX - 4
        return ways, (status.ravel() > 0) & inside
