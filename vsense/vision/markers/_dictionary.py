"""Square marker families: OpenCV's ArUco and AprilTag dictionaries, read from data files.

A square marker is a black frame one cell wide around a matrix of cells, on white. The heading of
its robot is a setting, because a square has no direction of its own.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats
from vsense.base.errors import UsageError, VsenseError, instead

if TYPE_CHECKING:
    import cv2


class FamilyError(VsenseError):
    """An unknown marker family, a broken definition, or a tag that it does not have."""


@dataclass(frozen=True, slots=True)
class Codes:
    """The code words of a dictionary.

    Attributes:
        name: Its name in OpenCV, or the file that it comes from.
        cells: Cells per side, without the frame.
        words: One number per tag: bit k is the cell at row k // cells, column k % cells of the
            marker seen upright, 1 where white.
        correction: How many wrong cells of a marker can be corrected.
    """

    name: str
    cells: int
    words: tuple[int, ...]
    correction: int

    def bits(self) -> NDArray[np.bool_]:
        """Returns all tags' cells, (tags, cells, cells), True where white."""
        count = self.cells**2
        flat = [[word >> k & 1 for k in range(count)] for word in self.words]
        return np.array(flat, dtype=bool).reshape(-1, self.cells, self.cells)


@dataclass(frozen=True, slots=True)
class SquareFamily:
    """Square markers on a white disc.

    Attributes:
        size_mm: Side of the black square.
        heading_deg: From the marker's upright direction counter-clockwise to the robot's driving
            direction, seen from above.
        centre_mm: The disc's centre, seen from the square's: forwards and to the left.
    """

    name: str
    codes: Codes
    size_mm: float
    heading_deg: float
    disc_diameter_mm: float
    centre_mm: tuple[float, float]

    @property
    def tags(self) -> int:
        """See `Family.tags`."""
        return len(self.codes.words)

    @property
    def cell_mm(self) -> float:
        """Side of one cell."""
        return self.size_mm / (self.codes.cells + 2)

    @property
    def disc_centre_mm(self) -> Floats:
        """The disc's centre in the family frame, (2,)."""
        return np.array(self.centre_mm, dtype=np.float64)

    def bits(self, tag: int) -> NDArray[np.bool_]:
        """Returns the (cells, cells) upright cells of a tag, True: white; raises FamilyError."""
        if not 0 <= tag < self.tags:
            raise FamilyError(f"tag {tag}: the family {self.name} has 0 to {self.tags - 1}")
        cells = self.codes.cells
        flat = [self.codes.words[tag] >> k & 1 for k in range(cells * cells)]
        return np.array(flat, dtype=bool).reshape(cells, cells)

    def is_white(self, tag: int, points_mm: Floats) -> NDArray[np.bool_]:
        """See `Family.is_white`."""
        points = np.asarray(points_mm, dtype=np.float64)
        turn = math.radians(self.heading_deg)
        c, s = math.cos(turn), math.sin(turn)
        up = c * points[..., 0] - s * points[..., 1]
        left = s * points[..., 0] + c * points[..., 1]
        side = self.codes.cells + 2
        row = np.floor(side / 2.0 - up / self.cell_mm).astype(np.int64)
        column = np.floor(side / 2.0 - left / self.cell_mm).astype(np.int64)
        framed = np.ones((side + 2, side + 2), dtype=bool)
        framed[1:-1, 1:-1] = False
        framed[2:-2, 2:-2] = self.bits(tag)
        return framed[np.clip(row + 1, 0, side + 1), np.clip(column + 1, 0, side + 1)]


def parse_square(file: str, values: dict[str, Any]) -> SquareFamily:
    """Makes a family from the values of a definition file.

    The file is named in errors, and a user's own dictionary lies beside it.

    Raises:
        FamilyError: There is no such dictionary, or a value is out of its range.
        KeyError: A value is missing.
        TypeError, ValueError: A value has the wrong type.
    """
    centre = values.get("centre_mm", (0.0, 0.0))
    family = SquareFamily(
        name=str(values["name"]),
        codes=load_codes(str(values["dictionary"]), Path(file).parent),
        size_mm=float(values["size_mm"]),
        heading_deg=float(values["heading_deg"]),
        disc_diameter_mm=float(values["disc_diameter_mm"]),
        centre_mm=(float(centre[0]), float(centre[1])),
    )
    if not all(0.0 < length < math.inf for length in (family.size_mm, family.disc_diameter_mm)):
        raise FamilyError(f"{file}: size_mm and disc_diameter_mm must be positive")
    if not math.isfinite(family.heading_deg):
        raise FamilyError(f"{file}: heading_deg: {family.heading_deg} is not an angle")
    turn = math.radians(family.heading_deg + 45.0)
    corner = math.sqrt(0.5) * family.size_mm * np.array((math.cos(turn), math.sin(turn)))
    corners = np.array((corner, -corner, (-corner[1], corner[0]), (corner[1], -corner[0])))
    if np.hypot(*(corners - family.disc_centre_mm).T).max() >= family.disc_diameter_mm / 2.0:
        raise FamilyError(f"{file}: a square of size_mm reaches over the disc's rim")
    return family


def load_codes(name: str, folder: Path = Path()) -> Codes:
    """Reads OpenCV's dictionary of a name, or a dictionary file (.yml); raises FamilyError."""
    import cv2  # no arrow needs it

    if name.endswith((".yml", ".yaml", ".xml", ".json")):
        return _codes(name, _read_dictionary(folder / name))
    number = getattr(cv2.aruco, name, None) if name.startswith("DICT_") else None
    if not isinstance(number, int):
        names = (word for word in dir(cv2.aruco) if word.startswith("DICT_"))
        hint = instead(name, names, "known are")
        raise FamilyError(f"dictionary {name!r} is not known; {hint}")
    return _codes(name, cv2.aruco.getPredefinedDictionary(number))


def _read_dictionary(path: Path) -> cv2.aruco.Dictionary:
    """Reads the format of OpenCV's tools: nmarkers, markersize, marker_0 ..."""
    import cv2

    if not os.path.isfile(path):
        raise FamilyError(f"{path}: there is no such dictionary file")
    dictionary = cv2.aruco.Dictionary()
    try:
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        complete = storage.isOpened() and dictionary.readDictionary(storage.root())
    except (cv2.error, SystemError) as error:
        raise FamilyError(f"{path}: no dictionary of OpenCV's: {error}") from None
    if not complete or len(dictionary.bytesList) == 0:
        raise FamilyError(f"{path}: nmarkers, markersize or marker_0 is missing")
    return dictionary


def _codes(name: str, dictionary: cv2.aruco.Dictionary) -> Codes:
    import cv2

    cells = dictionary.markerSize
    rows = [row[np.newaxis] for row in dictionary.bytesList]
    bits = np.array([cv2.aruco.Dictionary.getBitsFromByteList(row, cells) for row in rows])
    words = (sum(int(bit) << k for k, bit in enumerate(np.ravel(word))) for word in bits)
    return Codes(name, cells, tuple(words), (_distance(bits) - 1) // 2)


def _distance(bits: NDArray[np.uint8]) -> int:
    """Returns the least number of cells in which two (n, cells, cells) markers differ, any turn.

    The correction that OpenCV states depends on its version.
    """
    signs = 1.0 - 2.0 * bits.astype(np.float32)
    flat = signs.reshape(len(bits), -1)
    least = flat.shape[1]
    for turn in range(4):
        turned = np.rot90(signs, turn, (1, 2)).reshape(len(bits), -1)
        apart = (flat.shape[1] - flat @ turned.T) / 2.0
        np.fill_diagonal(apart, least)
        least = min(least, round(float(apart.min())))
    return max(least, 1)


def dictionary_name(text: str) -> str:
    """Returns OpenCV's name of a dictionary, without "DICT_"; raises UsageError without one."""
    import cv2

    for name in (text, text.removeprefix("DICT_"), f"APRILTAG_{text}"):
        if isinstance(getattr(cv2.aruco, f"DICT_{name}", None), int):
            return name
    raise UsageError(f"dictionary '{text}': expected e.g. 4X4_50 or 36h11")
