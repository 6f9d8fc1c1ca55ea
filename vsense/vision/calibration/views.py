"""Views: the corners of a board, or known points, that one camera saw at one moment.

Corners are found in a picture to a few hundredths of a pixel.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.base.errors import ConfigError, UsageError
from vsense.base.files import MOST_TABLE_BYTES, read_text
from vsense.vision.calibration.board import CHARUCO, Board
from vsense.vision.cameras.camera import Floats
from vsense.vision.cameras.picture import Image

_DIGITS_MAX = 9

Ints = NDArray[np.int64]

COLUMNS = ("camera", "moment", "corner", "x_px", "y_px")
"""Of a corners file."""


@dataclass(frozen=True, slots=True)
class View:
    """One camera's sight of the board.

    Attributes:
        moment: Its name; views of the same moment show the same pose of the board.
        ids: (n,) numbers of the corners, row by row from the printed board's upper left one.
        pixels: (n, 2).
    """

    camera: str
    moment: str
    ids: Ints
    pixels: Floats


@dataclass(frozen=True, slots=True)
class BoardViews:
    """Views of the board by camera and moment; per camera, size [px] and number of pictures."""

    sizes: dict[str, tuple[int, int]]
    views: Sequence[View]
    pictures: dict[str, int]

    def of(self, camera: str) -> list[View]:
        """The views of one camera."""
        return [view for view in self.views if view.camera == camera]


def read_table(path: Path, columns: Sequence[str]) -> list[tuple[int, list[str]]]:
    """Reads columns of a CSV file with a header; returns them per line, with its number.

    Raises UsageError for an unreadable file, ConfigError for a missing column or value.
    """
    try:
        text = read_text(path, "utf-8-sig", MOST_TABLE_BYTES)
        lines = list(csv.reader(io.StringIO(text, newline="")))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or error
        raise UsageError(f"{path}: cannot be read: {reason}") from None
    header = [name.strip() for name in lines[0]] if lines else []
    missing = [name for name in columns if name not in header]
    if missing:
        expected = ",".join(columns)
        raise ConfigError(str(path), 1, f"no column '{missing[0]}': expected {expected}")
    places = [header.index(name) for name in columns]
    table = []
    for number, line in enumerate(lines[1:], start=2):
        if not line:
            continue
        if len(line) < len(header):
            raise ConfigError(
                str(path), number, f"{len(line)} values: the header has {len(header)}"
            )
        table.append((number, [line[place].strip() for place in places]))
    return table


def number_at(path: Path, line: int, name: str, text: str) -> float:
    """Returns a finite number of a file; raises ConfigError where it is none."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ConfigError(str(path), line, f"{name}: '{text}' is not a number")
    return value


def _is_number(text: str) -> bool:
    """Of a size that Python makes a number of."""
    return text.isdecimal() and len(text) <= _DIGITS_MAX


def read_corners(path: Path, corners: int) -> list[View]:
    """Reads a file of `write_corners`, for so many corners; raises as `read_table` does."""
    views: dict[tuple[str, str], dict[int, tuple[float, float]]] = {}
    for line, (camera, moment, corner, *place) in read_table(path, COLUMNS):
        if not _is_number(corner) or int(corner) >= corners:
            raise ConfigError(
                str(path),
                line,
                f"corner: '{corner[:40]}': expected 0 to {corners - 1} on this board",
            )
        view = views.setdefault((camera, moment), {})
        if int(corner) in view:
            raise ConfigError(
                str(path), line, f"corner {corner} of {camera} {moment} is there twice"
            )
        x, y = (number_at(path, line, name, text) for name, text in zip(COLUMNS[3:], place))
        view[int(corner)] = (x, y)
    return [
        View(camera, moment, np.array(list(seen), np.int64), np.array(list(seen.values())))
        for (camera, moment), seen in sorted(views.items())
    ]


def write_corners(path: Path, views: Iterable[View]) -> None:
    """Writes a corners file: one line per corner that a camera saw."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for view in views:
            for corner, (x, y) in zip(view.ids.tolist(), view.pixels.tolist()):
                writer.writerow((view.camera, view.moment, corner, f"{x:.4f}", f"{y:.4f}"))


LEAST_CORNERS = 6
"""ChArUco corners that determine the board's pose well enough."""

_CHESSBOARD_SHARE = 0.35
"""The refinement's half window over the smallest extent of a square."""
_CHARUCO_GAPS = 1.0
"""The same over the white gap around a marker, which must stay outside of the window."""
_WINDOW_PX = (2, 11)
_STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-3)
_CHESSBOARD_FLAGS = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE


class CornerFinder:
    """Finds one kind of board; one per thread."""

    def __init__(self, board: Board) -> None:
        """Prepares OpenCV's detector."""
        self._board = board
        self._charuco = cv2.aruco.CharucoDetector(board.charuco) if board.kind == CHARUCO else None
        gap = (1.0 - board.marker_share) / 2.0
        self._share = _CHARUCO_GAPS * gap if self._charuco else _CHESSBOARD_SHARE

    def find(self, image: Image) -> tuple[Ints, Floats] | None:
        """Looks for the board in an (h, w) uint8 picture.

        Returns:
            (n,) numbers of the corners and (n, 2) pixels; None: no board was found.
        """
        if self._board.inverted:
            image = np.asarray(cv2.bitwise_not(image), dtype=np.uint8)
        found = self._find_charuco(image) if self._charuco else self._find_chessboard(image)
        if found is None:
            return None
        ids, pixels = found
        return ids, _refined(image, pixels, self._share * self._square_px(ids, pixels))

    def _find_charuco(self, image: Image) -> tuple[Ints, Floats] | None:
        assert self._charuco is not None
        pixels, ids, _, _ = self._charuco.detectBoard(image)
        if ids is None or len(ids) < LEAST_CORNERS:
            return None
        numbers = np.asarray(ids, dtype=np.int64).ravel()
        # Corners of a single row do not fix the turn about it.
        per_row = self._board.columns - 1
        if len(set(numbers // per_row)) < 2 or len(set(numbers % per_row)) < 2:
            return None
        return numbers, np.asarray(pixels, dtype=np.float64).reshape(-1, 2)

    def _find_chessboard(self, image: Image) -> tuple[Ints, Floats] | None:
        size = (self._board.columns - 1, self._board.rows - 1)
        flags = _CHESSBOARD_FLAGS | cv2.CALIB_CB_FAST_CHECK
        found, corners = cv2.findChessboardCorners(image, size, flags=flags)
        if not found:
            found, corners = cv2.findChessboardCornersSB(image, size)
        if not found:
            return None
        grid = corners.reshape(size[1], size[0], 2).astype(np.float64)
        grid = self._upright(image, grid)
        return np.arange(size[0] * size[1]), grid.reshape(-1, 2)

    def _upright(self, image: Image, grid: Floats) -> Floats:
        """The (rows, columns, 2) corners with the printed board's upper left one first."""
        right, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
        if right[0] * down[1] - right[1] * down[0] < 0.0:
            grid = grid[:, ::-1]
        middles = (grid[1:, 1:] + grid[:-1, 1:] + grid[1:, :-1] + grid[:-1, :-1]) / 4.0
        rows, columns = middles.shape[:2]
        column, row = np.meshgrid(np.arange(1, columns + 1), np.arange(rows, 0, -1))
        grey = _grey(image, middles)
        dark = (column + row) % 2 == 0
        turned = grey[dark].mean() > grey[~dark].mean()
        return grid[::-1, ::-1] if turned else grid

    def _square_px(self, ids: Ints, pixels: Floats) -> Floats:
        """(n,) the smallest extent of a square near each corner, with its foreshortening."""
        per_row = self._board.columns - 1
        place = np.column_stack((ids % per_row, ids // per_row)).astype(np.float64)
        # The distortion of a lens is negligible over one square.
        matrix = np.asarray(cv2.findHomography(place, pixels)[0], dtype=np.float64)
        if matrix.shape != (3, 3):
            return np.zeros(len(ids))
        sides = [
            _mapped(matrix, place + half) - _mapped(matrix, place - half)
            for half in np.array(((0.5, 0.0), (0.0, 0.5)))
        ]
        return np.asarray(np.linalg.svd(np.stack(sides, axis=-1), compute_uv=False)[:, 1])


def _mapped(matrix: Floats, points: Floats) -> Floats:
    """(n, 2) points through a (3, 3) projective map."""
    mapped = np.column_stack((points, np.ones(len(points)))) @ matrix.T
    return np.asarray(mapped[:, :2] / mapped[:, 2:])


def _grey(image: Image, points_px: Floats) -> Floats:
    column = np.clip(np.rint(points_px[..., 0]).astype(int), 0, image.shape[1] - 1)
    row = np.clip(np.rint(points_px[..., 1]).astype(int), 0, image.shape[0] - 1)
    return np.asarray(image[row, column], dtype=np.float64)


def _refined(image: Image, pixels: Floats, window_px: Floats) -> Floats:
    """The saddles of the grey levels near the corners, each in a window of its own size."""
    half = np.clip(window_px.astype(int), *_WINDOW_PX)
    refined: Floats = pixels.copy()
    for size in np.unique(half):
        chosen = half == size
        start = pixels[chosen].astype(np.float32).reshape(-1, 1, 2)
        end = cv2.cornerSubPix(image, start.copy(), (int(size), int(size)), (-1, -1), _STOP)
        moved = end.reshape(-1, 2).astype(np.float64)
        # A corner that moves out of its window has found something else.
        near = np.linalg.norm(moved - pixels[chosen], axis=1) <= size
        refined[chosen] = np.where(near[:, np.newaxis], moved, pixels[chosen])
    return refined
