"""Code words: what a camera makes of a tag's cells, and which tags it can tell apart best.

A blurred cell carries some of its neighbours. A tag's code word is its cells' brightness
after that blur, in [0, 1] between the arrow's black and the disc's white.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from vsense.tracking.families import FamilyError, MarkerFamily

Floats = NDArray[np.float64]

_LIGHTEST = 12
_DARKEST = 4
_FINE = 8


@cache
def cell_blur(family: MarkerFamily, sigma_mm: float) -> Floats:
    """Returns how much of each cell's white the middle of each other cell sees.

    Args:
        family: The marker family.
        sigma_mm: Standard deviation of the blur on the marker, a Gaussian.

    Returns:
        (cells, cells): the mean over the inner half of cell i of the light from cell j.
    """
    fine = _FINE * family.grid
    step = np.arange(-fine, 2 * fine) + 0.5
    kernel = np.subtract.outer(step, step) * (family.cell_mm / _FINE)
    weight = np.exp(-0.5 * (kernel / max(sigma_mm, 1e-3)) ** 2)
    weight /= weight.sum(axis=1, keepdims=True)
    inner = weight[fine : 2 * fine, fine : 2 * fine].reshape(family.grid, _FINE, -1)
    inner = inner[:, _FINE // 4 : -_FINE // 4].mean(axis=1)
    line = inner.reshape(family.grid, family.grid, _FINE).sum(axis=2)
    return np.asarray(np.kron(line, line))


def code_words(family: MarkerFamily, tags: Iterable[int], sigma_mm: float) -> Floats:
    """Returns the blurred cells of tags, (tags, cells), see `cell_blur`."""
    bits = np.array([family.bits(tag).ravel() for tag in tags], dtype=np.float64)
    return np.asarray(bits.reshape(-1, family.grid**2) @ cell_blur(family, sigma_mm).T)


def separation(family: MarkerFamily, tags: Iterable[int], sigma_mm: float) -> float:
    """Returns the least squared distance between two of the tags' code words."""
    words = code_words(family, tags, sigma_mm)
    apart = ((words[:, np.newaxis] - words[np.newaxis]) ** 2).sum(axis=2)
    apart[np.diag_indices(len(words))] = np.inf
    return float(apart.min())


def choose_tags(family: MarkerFamily, count: int, sigma_mm: float, seed: int = 0) -> list[int]:
    """Chooses tags that stay far apart under blur, by a farthest-first greedy search.

    Words that are nearly all black or nearly all white are left out, because blank things
    look like them. A tag also keeps away from the others turned by half a turn.

    Args:
        family: The marker family.
        count: How many tags.
        sigma_mm: The blur to stand, see `cell_blur`.
        seed: Chooses the first tag; the rest follows from it.

    Returns:
        The tags in ascending order.

    Raises:
        FamilyError: The family does not have that many usable tags.
    """
    cells = family.grid**2
    tags = np.arange(family.tags)
    bits = ((tags[:, np.newaxis] >> np.arange(cells)) & 1).astype(np.float32)
    weight = bits.sum(axis=1)
    usable = np.flatnonzero((weight >= _DARKEST) & (weight <= _LIGHTEST))
    if count > len(usable):
        raise FamilyError(f"{count} tags: the family {family.name} has {len(usable)} usable ones")
    words = bits[usable] @ cell_blur(family, sigma_mm).T.astype(np.float32)
    nearest = ((words - words[:, ::-1]) ** 2).sum(axis=1)
    chosen: list[int] = []
    place = int(np.random.default_rng(seed).integers(len(usable)))
    while len(chosen) < count:
        chosen.append(int(usable[place]))
        for word in (words[place], words[place, ::-1]):
            nearest = np.minimum(nearest, ((words - word) ** 2).sum(axis=1))
        nearest[place] = -1.0
        place = int(nearest.argmax())
    return sorted(chosen)
