"""Which tag a marker carries: its cells compared with the roster's code words.

A cell's brightness is compared with what the camera's blur makes of each tag in the roster.
A marker is named only when one tag fits every cell and no other comes near: without a name is
acceptable, a wrong name is not.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vsense.arena import UNNAMED
from vsense.tracking.codes import code_words
from vsense.tracking.families import MarkerFamily

Floats = NDArray[np.float64]

_BLURS_MM = (0.6, 1.1, 1.6, 2.2)
_WORST_CELL = 0.40
_LEAST_MARGIN = 1.6


class Decoder:
    """Names markers from a roster of tags."""

    def __init__(self, family: MarkerFamily, roster: Sequence[int]) -> None:
        """Prepares the code words of `roster`, at several strengths of blur.

        Raises:
            FamilyError: The family does not have a tag of the roster.
        """
        self._tags = np.array(sorted(set(roster)), dtype=np.int32)
        words = [code_words(family, self._tags.tolist(), sigma) for sigma in _BLURS_MM]
        self._words = np.concatenate(words)

    def decode(self, cells: Floats) -> tuple[NDArray[np.int32], Floats, Floats]:
        """Names markers.

        Args:
            cells: (n, cells) brightness, 0 the arrow's black, 1 the disc's white.

        Returns:
            (n,) tags, or -1; (n,) root mean square difference to the nearest tag's code word;
            (n,) how many times farther the next tag is.
        """
        count, tags = len(cells), len(self._tags)
        if count == 0 or tags == 0:
            return np.full(count, UNNAMED, np.int32), np.full(count, np.inf), np.ones(count)
        difference = np.abs(cells[:, np.newaxis] - self._words)
        distance = np.sqrt((difference**2).mean(axis=2)).reshape(count, len(_BLURS_MM), tags)
        rows = np.arange(count)
        by_tag = distance.min(axis=1)
        best = by_tag.argmin(axis=1)
        error = by_tag[rows, best]
        word = distance[rows, :, best].argmin(axis=1) * tags + best
        worst = difference[rows, word].max(axis=1)
        by_tag[rows, best] = np.inf
        margin = np.minimum(by_tag.min(axis=1), 1.0) / np.maximum(error, 1e-3)
        sure = (worst < _WORST_CELL) & (margin > _LEAST_MARGIN)
        return np.where(sure, self._tags[best], np.int32(UNNAMED)), error, margin
