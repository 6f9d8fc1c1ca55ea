"""Code words: the cells of a tag as a camera sees them, and the tags that differ most.

Blur mixes the light of neighbouring cells. A tag's code word is its cells' brightness after that
blur, in [0, 1] between the arrow's black and the disc's white.
"""

from __future__ import annotations

import math
import re
from functools import cache

import numpy as np
from numpy.typing import NDArray

from vsense.base.errors import UsageError
from vsense.vision.markers.dictionary import Floats
from vsense.vision.markers.families import FamilyError, MarkerFamily, SquareFamily

BLURS_U = np.arange(0.10, 0.86, 0.04)
"""Standard deviations of the blur for which code words are kept, in units u."""

SPOTS = (-0.18, 0.0, 0.18)
"""The nine spots where a cell is read, along and across, in sides from its middle."""

AUTO_BLUR = 0.4
"""Blur for the choice of tags, in cells: a point spread of 1.2 px at 0.57 px/mm."""

MOST = 1000
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
        if len(tags) > MOST:
            raise UsageError(f"--ids {text}: more than {MOST} tags")
    twice = {tag for tag in tags if tags.count(tag) > 1}
    if twice:
        raise UsageError(f"--ids {text}: tag {min(twice)} is there twice")
    return tags


def _auto(text: str, family: MarkerFamily | SquareFamily) -> list[int]:
    number = text.removeprefix("auto:")
    if not number.isdecimal() or not 1 <= int(number) <= MOST:
        raise UsageError(f"--ids {text}: expected auto:N with N from 1 to {MOST}")
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
