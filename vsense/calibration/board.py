"""Boards: flat printed patterns whose inner corners are known to a tenth of a millimetre.

The board's frame lies on its printed face: origin in the lower left corner of the lower left
square, x to the right, y up, z towards the viewer. A board that lies on the floor thus has its z
where the arena has it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.errors import UsageError

Floats = NDArray[np.float64]

CHESSBOARD = "chessboard"
CHARUCO = "charuco"

MARKER_SHARE = 0.75
"""Side of a ChArUco marker over that of its square, if nothing else is said."""

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
        columns: Squares along x.
        rows: Squares along y.
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
            UsageError: It is no such text.
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
            board.charuco  # noqa: B018  built here to refuse here
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
        """Whether the board turned by half a turn looks the same."""
        return self.kind == CHESSBOARD and (self.columns + self.rows) % 2 == 0

    @cached_property
    def charuco(self) -> Any:
        """OpenCV's board. Its y points down; corner numbers are the same as ours.

        Raises:
            UsageError: The dictionary has too few markers.
        """
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
    found = _SIZE.match(part)
    columns, rows = (int(n) for n in found.groups()) if found else (0, 0)
    if not (_LEAST <= columns <= _MOST and _LEAST <= rows <= _MOST):
        raise UsageError(f"board '{text}': size '{part}': expected e.g. 7x5, {_LEAST} to {_MOST}")
    return columns, rows


def _length_m(text: str, part: str) -> float:
    found = _LENGTH.match(part)
    length_m = float(found[1]) * _UNIT_M[found[2]] if found else 0.0
    if not 1e-3 <= length_m <= 2.0:
        raise UsageError(f"board '{text}': square '{part}': expected e.g. 30mm, 1 mm to 2 m")
    return length_m


def dictionary_name(text: str) -> str:
    """Returns OpenCV's name of a dictionary, without "DICT_".

    Raises:
        UsageError: There is no such dictionary.
    """
    for name in (text, text.removeprefix("DICT_"), f"APRILTAG_{text}"):
        if isinstance(getattr(cv2.aruco, f"DICT_{name}", None), int):
            return name
    raise UsageError(f"dictionary '{text}': expected e.g. 4X4_50 or 36h11")


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
