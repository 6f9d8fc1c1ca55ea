"""Marker families: what the markers on the robots look like, read from data files.

A definition's kind is arrow (this module) or square (`dictionary`). The family frame has its
origin in the middle of the marker's cells, +x in the driving direction and +y to the left, seen
from above; lengths are in millimetres. The robot's centre is the disc's.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from vsense.base.errors import instead
from vsense.base.files import parse_json, read_text
from vsense.vision.markers.dictionary import FamilyError, Floats, SquareFamily, parse_square

__all__ = ["Family", "FamilyError", "MarkerFamily", "SquareFamily", "known_families", "load_family"]


class Family(Protocol):
    """Numbered markers, each printed on a white disc that a robot carries."""

    @property
    def name(self) -> str:
        """Name of the family."""

    @property
    def tags(self) -> int:
        """How many tags there are: 0 .. tags - 1."""

    @property
    def disc_diameter_mm(self) -> float:
        """Diameter of the white disc."""

    @property
    def disc_centre_mm(self) -> Floats:
        """The disc's centre, which is the robot's, (2,)."""

    def is_white(self, tag: int, points_mm: Floats) -> NDArray[np.bool_]:
        """Whether (..., 2) points on the disc, in the family frame, are white."""

    def __hash__(self) -> int:
        """Families are values, so that what is drawn of one can be cached."""


@dataclass(frozen=True, slots=True)
class MarkerFamily:
    """A black convex arrow with a matrix of cells on a white disc.

    Attributes:
        unit_mm: The length u.
        cell_mm: Side of one cell.
        grid: Cells per side.
        polygon_u: The arrow's corners (x, y) in units u, counter-clockwise.
        disc_centre_u: The disc's centre in units u.
    """

    name: str
    unit_mm: float
    cell_mm: float
    grid: int
    polygon_u: tuple[tuple[float, float], ...]
    disc_diameter_mm: float
    disc_centre_u: tuple[float, float]

    @property
    def tags(self) -> int:
        """See `Family.tags`."""
        return 1 << (self.grid * self.grid)

    @property
    def polygon_mm(self) -> Floats:
        """The arrow's corners, (n, 2), counter-clockwise."""
        return np.array(self.polygon_u, dtype=np.float64) * self.unit_mm

    @property
    def disc_centre_mm(self) -> Floats:
        """See `Family.disc_centre_mm`."""
        return np.array(self.disc_centre_u, dtype=np.float64) * self.unit_mm

    @property
    def cells_mm(self) -> Floats:
        """The middle of each cell, (grid * grid, 2), in the order of the bits.

        Bit k is at row k // grid and column k % grid with the arrow pointing up: rows go from the
        tip backwards, columns from the robot's left to its right.
        """
        along = ((self.grid - 1) / 2.0 - np.arange(self.grid)) * self.cell_mm
        rows, columns = np.meshgrid(along, along, indexing="ij")
        return np.stack((rows.ravel(), columns.ravel()), axis=-1)

    def bits(self, tag: int) -> NDArray[np.bool_]:
        """Returns the (grid, grid) cells of a tag, True where white; raises FamilyError."""
        if not 0 <= tag < self.tags:
            raise FamilyError(f"tag {tag}: the family {self.name} has 0 to {self.tags - 1}")
        count = self.grid * self.grid
        flat = (tag >> np.arange(count)) & 1
        return np.asarray(flat.reshape(self.grid, self.grid) == 1)

    def is_white(self, tag: int, points_mm: Floats) -> NDArray[np.bool_]:
        """See `Family.is_white`."""
        points = np.asarray(points_mm, dtype=np.float64)
        corners = self.polygon_mm
        edges = np.roll(corners, -1, axis=0) - corners
        black = np.ones(points.shape[:-1], dtype=bool)
        for (x, y), (dx, dy) in zip(corners, edges, strict=True):
            black &= dx * (points[..., 1] - y) - dy * (points[..., 0] - x) >= 0.0
        place = np.floor(self.grid / 2.0 - points / self.cell_mm).astype(np.int64)
        inside = np.all((place >= 0) & (place < self.grid), axis=-1)
        row, column = np.moveaxis(np.clip(place, 0, self.grid - 1), -1, 0)
        return np.asarray(~black | (inside & self.bits(tag)[row, column]))


def known_families() -> tuple[str, ...]:
    """Returns the names of the shipped families, sorted."""
    folder = resources.files(__package__) / "families"
    return tuple(sorted(f.name[:-5] for f in folder.iterdir() if f.name.endswith(".json")))


def load_family(name: str) -> MarkerFamily | SquareFamily:
    """Reads a shipped family by its name, or a .json definition by its path; raises FamilyError."""
    if name.endswith(".json"):
        try:
            text = read_text(Path(name))
        except OSError as error:
            raise FamilyError(f"{name}: {error.strerror}") from None
        except UnicodeDecodeError:
            raise FamilyError(f"{name}: is no text") from None
        return _parse(name, text)
    if name not in known_families():
        hint = instead(name, known_families(), "known are")
        raise FamilyError(f"marker family {name!r} is not known; {hint}")
    file = resources.files(__package__) / "families" / f"{name}.json"
    return _parse(file.name, file.read_text(encoding="utf-8"))


def _parse(file: str, text: str) -> MarkerFamily | SquareFamily:
    try:
        values: dict[str, Any] = parse_json(text)
        kind = values.get("kind", "arrow")
        if kind == "square":
            return parse_square(file, values)
        if kind != "arrow":
            raise FamilyError(f"{file}: kind: {kind!r} is not arrow or square")
        family = _parse_arrow(values)
    except json.JSONDecodeError as error:
        raise FamilyError(f"{file}:{error.lineno}: {error.msg}") from None
    except KeyError as error:
        raise FamilyError(f"{file}: {error.args[0]} is missing") from None
    except (AttributeError, TypeError, ValueError, IndexError, RecursionError) as error:
        raise FamilyError(f"{file}: {error}") from None
    _check(file, family)
    return family


def _parse_arrow(values: dict[str, Any]) -> MarkerFamily:
    return MarkerFamily(
        name=str(values["name"]),
        unit_mm=float(values["unit_mm"]),
        cell_mm=float(values["cell_mm"]),
        grid=int(values["grid"]),
        polygon_u=tuple((float(x), float(y)) for x, y in values["polygon_u"]),
        disc_diameter_mm=float(values["disc_diameter_mm"]),
        disc_centre_u=(float(values["disc_centre_u"][0]), float(values["disc_centre_u"][1])),
    )


def _check(file: str, family: MarkerFamily) -> None:
    if not min(family.unit_mm, family.cell_mm, family.disc_diameter_mm) > 0.0:
        raise FamilyError(f"{file}: unit_mm, cell_mm and disc_diameter_mm must be positive")
    if not 1 <= family.grid <= 5:
        raise FamilyError(f"{file}: grid: {family.grid} is not 1 to 5")
    with np.errstate(over="ignore"):
        corners, centre = family.polygon_mm, family.disc_centre_mm
    if not (np.isfinite(corners).all() and np.isfinite(centre).all()):
        raise FamilyError(f"{file}: polygon_u and disc_centre_u are too large")
    edges = np.roll(corners, -1, axis=0) - corners
    after = np.roll(edges, -1, axis=0)
    if len(corners) < 3 or np.any(edges[:, 0] * after[:, 1] - edges[:, 1] * after[:, 0] <= 0.0):
        raise FamilyError(f"{file}: polygon_u is not convex and counter-clockwise")
    reach = np.hypot(*(corners - centre).T).max()
    if reach >= family.disc_diameter_mm / 2.0:
        raise FamilyError(f"{file}: polygon_u reaches over the disc's rim")
