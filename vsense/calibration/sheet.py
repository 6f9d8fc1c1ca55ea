"""The printed board: what is dark on it, as a page to print and as a picture of it."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.calibration.board import CHESSBOARD, Board
from vsense.sheets.page import Fill, Page, Text, line

Floats = NDArray[np.float64]
Image8 = NDArray[np.uint8]

_MARGIN_MM = 12.0
"""White around the board: detectors need some, and printers leave the paper's edge white."""
_ISO_M = ((0.210, 0.297), (0.297, 0.420), (0.420, 0.594), (0.594, 0.841), (0.841, 1.189))
_RULER_MM = 100.0


def dark_cells(board: Board) -> Floats:
    """Returns what is dark on a board that is not inverted.

    Returns:
        (n, 4) rectangles: left, bottom, width, height in the board's frame [m].
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


def raster(board: Board, px_per_m: float, margin_m: float) -> Image8:
    """Returns a picture of the board, 0 ink and 255 paper, edges smooth to a part of a pixel.

    Args:
        board: The board.
        px_per_m: Resolution.
        margin_m: Empty border around the board.

    Returns:
        (h, w) uint8, rows running along -y.
    """
    width, height = (round((size + 2.0 * margin_m) * px_per_m) for size in board.size_m)
    ink = np.zeros((height, width))
    for left, bottom, across, up in dark_cells(board):
        x = _cover((left + margin_m) * px_per_m, across * px_per_m, width)
        y = _cover((bottom + margin_m) * px_per_m, up * px_per_m, height)
        (first_x, x_share), (first_y, y_share) = x, y
        part = ink[first_y : first_y + len(y_share), first_x : first_x + len(x_share)]
        part += np.outer(y_share, x_share)
    grey = np.clip(ink if board.inverted else 1.0 - ink, 0.0, 1.0)
    return np.asarray(np.rint(255.0 * grey[::-1]), dtype=np.uint8)


def _cover(start: float, length: float, size: int) -> tuple[int, Floats]:
    """The first pixel that an interval touches, and how much of each pixel it covers."""
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
