"""Marker families: what the markers on the robots look like, read from data files.

A definition's kind is arrow (this module) or square (`dictionary`). The family frame has its
origin in the middle of the marker's cells, +x in the driving direction and +y to the left, seen
from above; lengths are in millimetres. The robot's centre is the disc's.

Blur mixes the light of neighbouring cells. A tag's code word is its cells' brightness after that
blur, in [0, 1] between the arrow's black and the disc's white.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats
from vsense.base.errors import UsageError, instead
from vsense.base.files import parse_json, read_text
from vsense.vision.markers._dictionary import FamilyError, SquareFamily, parse_square

BLURS_U = np.arange(0.10, 0.86, 0.04)
"""Standard deviations of the blur for which code words are kept, in units u."""

SPOTS = (-0.18, 0.0, 0.18)
"""The nine spots where a cell is read, along and across, in sides from its middle."""

AUTO_BLUR = 0.4
"""Blur for the choice of tags, in cells: a point spread of 1.2 px at 0.57 px/mm."""

SHEET_TAGS_MAX = 1000
"""Most tags on a sheet."""

_RANGE = re.compile(r"(\d{1,6})(?:-(\d{1,6}))?")
_FINE = 4


@cache
def cell_blur(family: MarkerFamily, along_mm: float, across_mm: float | None = None) -> Floats:
    """Returns (cells, cells): the share of cell j's light that the spots of cell i see on average.

    `along_mm` and `across_mm` (default: the same) are standard deviations of a Gaussian blur on
    the marker, along the heading and across it.
    """
    across_mm = along_mm if across_mm is None else across_mm
    return np.asarray(np.kron(_line_blur(family, along_mm), _line_blur(family, across_mm)))


@cache
def outer_light(family: MarkerFamily, along_mm: float, across_mm: float) -> Floats:
    """Returns how much of the disc's white around the arrow each cell sees, (cells,).

    The arrow counts as the rectangle around its rear, because its tip is far from the cells.
    """
    corners = family.polygon_mm
    rear, side = corners[:, 0].min(), corners[:, 1].max()
    ahead, left = family.cells_mm[:, 0], family.cells_mm[:, 1]
    black = normal_share((ahead - rear) / along_mm)
    black *= normal_share((side - left) / across_mm) - normal_share((-side - left) / across_mm)
    return np.asarray(1.0 - black)


def normal_share(deviations: Floats) -> Floats:
    """Returns the share of a normal distribution below so many standard deviations."""
    flat = [0.5 * (1.0 + math.erf(d / math.sqrt(2.0))) for d in deviations.ravel()]
    return np.reshape(flat, deviations.shape)


@cache
def _line_blur(family: MarkerFamily, sigma_mm: float) -> Floats:
    """Returns (grid, grid): the blur of one row or column of cells."""
    places = np.arange(family.grid)[:, np.newaxis] + np.array(SPOTS)
    borders = np.arange(family.grid + 1) - 0.5
    apart = (borders - places[..., np.newaxis]) * (family.cell_mm / max(sigma_mm, 1e-3))
    return np.asarray(np.diff(normal_share(apart), axis=2).mean(axis=1))


def usable(white: NDArray[np.intp], cells: int) -> NDArray[np.bool_]:
    """Whether white cells are a quarter to three quarters of all: others resemble blank things."""
    return np.asarray((4 * white >= cells) & (4 * white <= 3 * cells))


def ranked_tags(family: MarkerFamily | SquareFamily, count: int) -> list[int]:
    """Chooses tags that cameras do not take for each other, those that differ most first.

    The first ones of a longer list are those of a shorter one.

    Raises:
        FamilyError: The family does not have that many usable tags.
    """
    if isinstance(family, MarkerFamily):
        return _ranked_arrows(family, count, AUTO_BLUR * family.cell_mm, 0)
    return _ranked_squares(family, count)


def choose_tags(family: MarkerFamily, count: int, sigma_mm: float, seed: int = 0) -> list[int]:
    """Chooses tags that stay far apart under blur, by a farthest-first greedy search.

    Only `usable` words are taken. A tag also keeps away from the others turned by half a turn.
    `sigma_mm` is the blur to stand, see `cell_blur`; `seed` determines the first tag.

    Returns:
        The tags in ascending order.

    Raises:
        FamilyError: The family does not have that many usable tags.
    """
    return sorted(_ranked_arrows(family, count, sigma_mm, seed))


def _ranked_arrows(family: MarkerFamily, count: int, sigma_mm: float, seed: int) -> list[int]:
    """The same in the order of their choice."""
    cells = family.grid**2
    tags = np.arange(family.tags)
    bits = ((tags[:, np.newaxis] >> np.arange(cells)) & 1).astype(np.float32)
    good = np.flatnonzero(usable(bits.sum(axis=1, dtype=np.intp), cells))
    if count > len(good):
        raise FamilyError(f"{count} tags: the family {family.name} has {len(good)} usable ones")
    words = bits[good] @ cell_blur(family, sigma_mm).T.astype(np.float32)
    nearest = ((words - words[:, ::-1]) ** 2).sum(axis=1)
    chosen: list[int] = []
    place = int(np.random.default_rng(seed).integers(len(good)))
    while len(chosen) < count:
        chosen.append(int(good[place]))
        for word in (words[place], words[place, ::-1]):
            nearest = np.minimum(nearest, ((words - word) ** 2).sum(axis=1))
        nearest[place] = -1.0
        place = int(nearest.argmax())
    return chosen


def confusion(family: Family, tags: Iterable[int]) -> str:
    """Says which tags differ in one cell, also turned by half a turn; "": none do.

    Arrows only: tags of dictionaries differ in several.
    """
    if not isinstance(family, MarkerFamily):
        return ""
    worn, cells = set(tags), family.grid**2
    pairs = set[tuple[int, int]]()
    for tag in worn:
        turned = int(f"{tag:0{cells}b}"[::-1], 2)
        near = {turned} | {form ^ (1 << cell) for form in (tag, turned) for cell in range(cells)}
        pairs |= {(min(tag, other), max(tag, other)) for other in near & worn if other != tag}
    if not pairs:
        return ""
    words = f"tags {min(pairs)[0]} and {min(pairs)[1]} differ in one cell"
    words += f" ({len(pairs)} such pairs)" if len(pairs) > 1 else ""
    return f"{words}: cameras may confuse them; vsense camera markers --ids auto:N has better ones"


def parse_tags(text: str, family: MarkerFamily | SquareFamily) -> list[int]:
    """Returns the tags of a text such as `1-20`, `3,7,20-22` or `auto:20`; raises UsageError."""
    if text.startswith("auto:"):
        return _auto(text, family)
    tags: list[int] = []
    for part in text.split(","):
        match = _RANGE.fullmatch(part.strip())
        if match is None:
            raise UsageError(
                f"--ids {text}: {part.strip()!r} is no number or range;"
                " expected for example 1-20, 3,7,20-22 or auto:20"
            )
        first, last = int(match[1]), int(match[2] or match[1])
        if last < first:
            raise UsageError(f"--ids {text}: the range {part.strip()} goes backwards")
        if last >= family.tags:
            raise UsageError(
                f"--ids {text}: there is no tag {last}: the family {family.name} has"
                f" 0 to {family.tags - 1}"
            )
        tags += range(first, last + 1)
        if len(tags) > SHEET_TAGS_MAX:
            raise UsageError(f"--ids {text}: more than {SHEET_TAGS_MAX} tags")
    twice = {tag for tag in tags if tags.count(tag) > 1}
    if twice:
        raise UsageError(f"--ids {text}: tag {min(twice)} is there twice")
    return tags


def _auto(text: str, family: MarkerFamily | SquareFamily) -> list[int]:
    number = text.removeprefix("auto:")
    if not number.isdecimal() or not 1 <= int(number) <= SHEET_TAGS_MAX:
        raise UsageError(f"--ids {text}: expected auto:N with N from 1 to {SHEET_TAGS_MAX}")
    try:
        return sorted(ranked_tags(family, int(number)))
    except FamilyError as error:
        raise UsageError(f"--ids {text}: {error}") from None


def _ranked_squares(family: SquareFamily, count: int) -> list[int]:
    """Chooses tags that stay far apart under blur in all four positions; raises FamilyError."""
    if count > family.tags:
        raise FamilyError(f"{count} tags: the family {family.name} has {family.tags}")
    import cv2  # no arrow needs it

    cells = family.codes.bits().astype(np.float32)
    fine = np.pad(
        cells.repeat(_FINE, axis=1).repeat(_FINE, axis=2), ((0, 0), (_FINE,) * 2, (_FINE,) * 2)
    )
    words = np.stack([cv2.GaussianBlur(tag, (0, 0), AUTO_BLUR * _FINE) for tag in fine])
    chosen = [0]
    nearest = np.full(family.tags, np.inf, dtype=np.float32)
    while len(chosen) < count:
        for turns in range(4):
            turned = np.rot90(words[chosen[-1]], turns)
            nearest = np.minimum(nearest, ((words - turned) ** 2).sum(axis=(1, 2)))
        nearest[chosen] = -1.0
        chosen.append(int(nearest.argmax()))
    return chosen


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
        ahead, left = np.ascontiguousarray(points[..., 0]), np.ascontiguousarray(points[..., 1])
        corners = self.polygon_mm
        edges = np.roll(corners, -1, axis=0) - corners
        black = np.ones(ahead.shape, dtype=bool)
        for (x, y), (dx, dy) in zip(corners, edges, strict=True):
            black &= dx * (left - y) - dy * (ahead - x) >= 0.0
        # Beside the cells the arrow is black.
        framed = np.zeros((self.grid + 2, self.grid + 2), dtype=bool)
        framed[1:-1, 1:-1] = self.bits(tag)
        row, column = (
            np.clip(np.floor(self.grid / 2.0 - along / self.cell_mm), -1, self.grid).astype(np.intp)
            for along in (ahead, left)
        )
        return np.asarray(~black | framed[row + 1, column + 1])


def known_families() -> tuple[str, ...]:
    """Returns the names of the shipped families, sorted."""
    folder = resources.files(__package__) / "families"
    return tuple(sorted(f.name[:-5] for f in folder.iterdir() if f.name.endswith(".json")))


def load_family(name: str) -> MarkerFamily | SquareFamily:
    """Reads a shipped family by its name, or a .json definition by its path; raises FamilyError."""
    return parse_family(name if name.endswith(".json") else f"{name}.json", definition_of(name))


def definition_of(name: str) -> str:
    """Reads the text of a shipped family's definition, or of a .json file; raises FamilyError."""
    if name.endswith(".json"):
        try:
            return read_text(Path(name))
        except OSError as error:
            raise FamilyError(f"{name}: {error.strerror}") from None
        except UnicodeDecodeError:
            raise FamilyError(f"{name}: is no text") from None
    if name not in known_families():
        hint = instead(name, known_families(), "known are")
        raise FamilyError(f"marker family {name!r} is not known; {hint}")
    file = resources.files(__package__) / "families" / f"{name}.json"
    return file.read_text(encoding="utf-8")


def parse_family(file: str, text: str) -> MarkerFamily | SquareFamily:
    """Makes a family of a definition, which `file` names in errors; raises FamilyError."""
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
    except (AttributeError, TypeError, ValueError, IndexError) as error:
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
    lengths = family.unit_mm, family.cell_mm, family.disc_diameter_mm
    if not all(0.0 < length < math.inf for length in lengths):
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
