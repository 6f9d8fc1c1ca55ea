"""Boards: flat printed patterns whose inner corners are known to a tenth of a millimetre.

A board's frame lies on its printed face: origin in the lower left corner of the lower left square,
x to the right, y up, z towards the viewer. The z of a board on the floor is the arena's.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np

from vsense.base.arena import Floats, Image, Ints
from vsense.base.errors import UsageError
from vsense.vision.markers._dictionary import dictionary_name
from vsense.vision.markers._paper import Fill, Page, Text, line

CHESSBOARD = "chessboard"
CHARUCO = "charuco"

MARKER_SHARE = 0.75
"""Default side of a ChArUco marker over that of its square."""

_EXPECTED = "expected chessboard:7x5:30mm (inner corners) or charuco:4x5:54mm:4X4_1000 (squares)"
_SIZE = re.compile(r"(\d+)x(\d+)$")
_LENGTH = re.compile(r"(\d+(?:\.\d*)?|\.\d+)(mm|cm|m|in)$")
_UNIT_M = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254}
_LEAST, _MOST = 3, 64


@dataclass(frozen=True)
class Board:
    """One kind of board.

    Attributes:
        kind: CHESSBOARD or CHARUCO.
        columns, rows: Squares along x and y.
        square_m: Side of a square.
        dictionary: ChArUco only: OpenCV's name of the markers' dictionary without "DICT_".
        marker_share: ChArUco only: a marker's side over the square's.
        inverted: Printed white on black.
        legacy: ChArUco of OpenCV before 4.6, which differs where the number of rows is even.
    """

    kind: str
    columns: int
    rows: int
    square_m: float
    dictionary: str = ""
    marker_share: float = MARKER_SHARE
    inverted: bool = False
    legacy: bool = False

    @classmethod
    def parse(cls, text: str) -> Board:
        """Reads `chessboard:7x5:30mm` or `charuco:4x5:54mm:4X4_1000[:inverted][:legacy]...`.

        A chessboard is counted in inner corners, a ChArUco board in squares, as OpenCV does.
        `marker=0.8` is the share of a square that a ChArUco marker takes.

        Raises:
            UsageError: The text is no board.
        """
        kind, *rest = text.split(":")
        least = {CHESSBOARD: 2, CHARUCO: 3}.get(kind)
        if least is None or len(rest) < least:
            raise UsageError(f"board '{text}': {_EXPECTED}")
        columns, rows = _size(text, rest[0])
        inner = kind == CHESSBOARD
        options = _options(text, rest[least:])
        board = cls(
            kind,
            columns + inner,
            rows + inner,
            _length_m(text, rest[1]),
            "" if inner else dictionary_name(rest[2]),
            **options,
        )
        if not inner:
            board.charuco  # noqa: B018  raises here
        return board

    @cached_property
    def points_m(self) -> Floats:
        """(n, 3) inner corners in the board's frame, row by row from the upper left one."""
        column, row = np.meshgrid(np.arange(1, self.columns), np.arange(self.rows - 1, 0, -1))
        flat = np.column_stack((column.ravel(), row.ravel(), np.zeros(column.size)))
        return np.asarray(flat * self.square_m, dtype=np.float64)

    @property
    def size_m(self) -> tuple[float, float]:
        """Extent along x and y."""
        return self.columns * self.square_m, self.rows * self.square_m

    @property
    def symmetric(self) -> bool:
        """Whether the board looks the same after half a turn."""
        return self.kind == CHESSBOARD and (self.columns + self.rows) % 2 == 0

    @cached_property
    def charuco(self) -> Any:
        """OpenCV's board, y down, same corner numbers; raises UsageError for too few markers."""
        name = f"DICT_{self.dictionary}"
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
        if len(dictionary.bytesList) < self.columns * self.rows // 2:
            raise UsageError(
                f"board {self}: {self.dictionary} has {len(dictionary.bytesList)} markers, "
                f"the board needs {self.columns * self.rows // 2}"
            )
        marker_m = self.marker_share * self.square_m
        size = (self.columns, self.rows)
        board = cv2.aruco.CharucoBoard(size, self.square_m, marker_m, dictionary)
        board.setLegacyPattern(self.legacy)
        return board

    def __str__(self) -> str:
        """The text that `parse` reads."""
        if self.kind == CHESSBOARD:
            parts = [f"{self.columns - 1}x{self.rows - 1}", f"{self.square_m * 1e3:g}mm"]
        else:
            parts = [f"{self.columns}x{self.rows}", f"{self.square_m * 1e3:g}mm", self.dictionary]
        if self.marker_share != MARKER_SHARE:
            parts.append(f"marker={self.marker_share:g}")
        flags = [name for name in ("inverted", "legacy") if getattr(self, name)]
        return ":".join([self.kind, *parts, *flags])


def _size(text: str, part: str) -> tuple[int, int]:
    match = _SIZE.match(part)
    columns, rows = (int(n) for n in match.groups()) if match else (0, 0)
    if not (_LEAST <= columns <= _MOST and _LEAST <= rows <= _MOST):
        raise UsageError(f"board '{text}': size '{part}': expected e.g. 7x5, {_LEAST} to {_MOST}")
    return columns, rows


def _length_m(text: str, part: str) -> float:
    match = _LENGTH.match(part)
    length_m = float(match[1]) * _UNIT_M[match[2]] if match else 0.0
    if not 1e-3 <= length_m <= 2.0:
        raise UsageError(f"board '{text}': square '{part}': expected e.g. 30mm, 1 mm to 2 m")
    return length_m


def _options(text: str, parts: list[str]) -> dict[str, Any]:
    options: dict[str, Any] = {}
    for part in parts:
        name, _, value = part.partition("=")
        if part in ("inverted", "legacy"):
            options[part] = True
        elif name == "marker" and re.fullmatch(r"0?\.\d+", value) and 0.3 <= float(value) < 1.0:
            options["marker_share"] = float(value)
        else:
            raise UsageError(
                f"board '{text}': '{part}': expected inverted, legacy or marker=0.75 (0.3 to 1)"
            )
    return options


_MARGIN_MM = 12.0
"""White border, for detectors and for the edge that printers cannot reach."""
_ISO_M = ((0.210, 0.297), (0.297, 0.420), (0.420, 0.594), (0.594, 0.841), (0.841, 1.189))
_RULER_MM = 100.0


def dark_cells(board: Board) -> Floats:
    """Returns what is dark on a board that is not inverted, as (n, 4) rectangles.

    A rectangle is left, bottom, width, height in the board's frame [m].
    """
    squares = [
        (column, row)
        for row in range(board.rows)
        for column in range(board.columns)
        if (column + row) % 2 == 0
    ]
    if board.kind == CHESSBOARD:
        return np.array([(c, r, 1.0, 1.0) for c, r in squares]) * board.square_m
    markers = np.array(board.charuco.getObjPoints(), dtype=np.float64) / board.square_m
    taken = {(int(x), int(y)) for x, y, _ in markers.mean(axis=1)}
    cells = [
        (column, board.rows - 1 - row, 1.0, 1.0)
        for row in range(board.rows)
        for column in range(board.columns)
        if (column, row) not in taken
    ]
    dictionary = board.charuco.getDictionary()
    across = dictionary.markerSize + 2
    for corners, id in zip(markers, board.charuco.getIds().ravel()):
        bits = cv2.aruco.generateImageMarker(dictionary, int(id), across)
        left, top = corners.min(axis=0)[:2]
        side = board.marker_share / across
        cells += [
            (left + column * side, board.rows - top - (row + 1) * side, side, side)
            for row, column in zip(*np.nonzero(bits == 0))
        ]
    return np.array(cells) * board.square_m


def raster(board: Board, px_per_m: float, margin_m: float) -> Image:
    """Returns an (h, w) uint8 picture of the board, 0 ink and 255 paper, with smooth edges.

    Rows run along -y; `margin_m` is an empty border.
    """
    width, height = (round((size + 2.0 * margin_m) * px_per_m) for size in board.size_m)
    ink = np.zeros((height, width))
    for left, bottom, across, up in dark_cells(board):
        first_x, x_share = _cover((left + margin_m) * px_per_m, across * px_per_m, width)
        first_y, y_share = _cover((bottom + margin_m) * px_per_m, up * px_per_m, height)
        part = ink[first_y : first_y + len(y_share), first_x : first_x + len(x_share)]
        part += np.outer(y_share, x_share)
    grey = np.clip(ink if board.inverted else 1.0 - ink, 0.0, 1.0)
    return np.asarray(np.rint(255.0 * grey[::-1]), dtype=np.uint8)


def _cover(start: float, length: float, size: int) -> tuple[int, Floats]:
    """The first pixel that an interval touches, and the covered share of each pixel."""
    first, last = max(int(start), 0), min(int(np.ceil(start + length)), size)
    edges = np.clip(np.arange(first, last + 1), start, start + length)
    return first, np.diff(edges)


def page(board: Board) -> Page:
    """Returns a sheet with the board in its true size, its name, its axes and a ruler.

    The paper is the smallest of A4 to A0 that holds it, else as large as needed.
    """
    width, height = (1e3 * side for side in _paper_m(board))
    across, up = (1e3 * side for side in board.size_m)
    left, bottom = (width - across) / 2.0, (height - up) / 2.0
    place = np.array((left, bottom))
    sheet = Page(width, height)
    ink, paper = (1.0, 0.0) if board.inverted else (0.0, 1.0)
    if board.inverted:
        rim = _MARGIN_MM / 2.0
        around = np.array((-rim, -rim, across + 2.0 * rim, up + 2.0 * rim))
        sheet.items.append(Fill([_corners(around) + place], paper))
    cells = 1e3 * dark_cells(board)
    sheet.items.append(Fill([_corners(cell) + place for cell in cells], ink))
    foot = bottom - 0.7 * _MARGIN_MM
    ruler = min(_RULER_MM, across / 2.0)
    for start, end in (((0, 0), (ruler, 0)), ((0, -1), (0, 1)), ((ruler, -1), (ruler, 1))):
        x0, y0, x1, y1 = left + start[0], foot + start[1], left + end[0], foot + end[1]
        sheet.items.append(line(x0, y0, x1, y1, 0.3))
    label = f"{board}    origin: lower left corner, x to the right, y up    bar: {ruler:g} mm"
    sheet.items.append(Text(left, foot - 4.0, 2.6, label))
    return sheet


def _corners(cell: Floats) -> Floats:
    """The (4, 2) corners of left, bottom, width, height."""
    left, bottom, width, height = cell
    x, y = (left, left + width), (bottom, bottom + height)
    return np.array(((x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])))


def _paper_m(board: Board) -> tuple[float, float]:
    margin = _MARGIN_MM / 1e3
    needed = (board.size_m[0] + 2.0 * margin, board.size_m[1] + 2.0 * margin)
    for short, long in _ISO_M:
        for paper in ((short, long), (long, short)):
            if paper[0] >= needed[0] and paper[1] >= needed[1]:
                return paper
    return needed


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
        corners = self._find_charuco(image) if self._charuco else self._find_chessboard(image)
        if corners is None:
            return None
        ids, pixels = corners
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
        ok, corners = cv2.findChessboardCorners(image, size, flags=flags)
        if not ok:
            ok, corners = cv2.findChessboardCornersSB(image, size)
        if not ok:
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
