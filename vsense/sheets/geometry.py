"""Markers as polygons, for printing at any size."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from vsense.sheets.page import Fill, Floats
from vsense.tracking.dictionary import SquareFamily
from vsense.tracking.families import MarkerFamily

AnyFamily = MarkerFamily | SquareFamily


def shapes(family: AnyFamily, tag: int) -> list[Fill]:
    """Returns a marker's black and white parts, seen from above.

    The corners are in mm in the family frame moved to the disc's centre: +x is the driving
    direction, +y the left.

    Raises:
        FamilyError: The family has no such tag.
    """
    if isinstance(family, MarkerFamily):
        black = family.polygon_mm
        turn = 0.0
    else:
        half = family.size_mm / 2.0
        black = np.array(((-half, -half), (half, -half), (half, half), (-half, half)))
        turn = -math.radians(family.heading_deg)
    cells = list(_white_cells(family.bits(tag), family.cell_mm))
    fills = [Fill([black], 0.0), *([Fill(cells, 1.0)] if cells else [])]
    return [_moved(fill, turn, -family.disc_centre_mm) for fill in fills]


def _white_cells(bits: NDArray[np.bool_], cell_mm: float) -> Iterator[Floats]:
    """Returns rectangles around the runs of white cells of each row."""
    half = len(bits) / 2.0
    for row, cells in enumerate(bits):
        steps = np.diff(np.concatenate(((0,), cells.astype(np.int8), (0,))))
        front, back = (half - row) * cell_mm, (half - row - 1) * cell_mm
        for first, end in zip(np.flatnonzero(steps == 1), np.flatnonzero(steps == -1)):
            left, right = (half - first) * cell_mm, (half - end) * cell_mm
            yield np.array(((back, right), (front, right), (front, left), (back, left)))


def _moved(fill: Fill, turn_rad: float, shift_mm: Floats) -> Fill:
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    rotation = np.array(((c, s), (-s, c)))
    return Fill([polygon @ rotation + shift_mm for polygon in fill.polygons], fill.grey)
