"""Which tag a marker carries: its cells compared with the roster's code words.

A cell's brightness is compared with what the picture's blur makes of each tag in the roster; how
blurred a marker is, along its heading and across it, is measured at its own edges. A marker is
named only when one tag fits every cell and no other comes near: a wrong name is worse than none.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsense.arena import UNNAMED
from vsense.markers.codes import BLURS_U, cell_blur, normal_share, outer_light
from vsense.markers.families import MarkerFamily
from vsense.tracking.joining import unlisted_tag_reader
from vsense.tracking.outlines import EDGE_REACH_U, nearest_blur

Floats = NDArray[np.float64]
Tags = NDArray[np.int32]

_WORST_CELL = 0.40
_LEAST_MARGIN = 1.6
_GREATEST_ERROR = 1.0
_MOST_UNEXPLAINED, _LEAST_VARIED = 0.6, 0.1
"""The error may be this share of how much the word's own cells differ: a word that explains less is
not what is there, however much worse the others are. Nearly blank words differ by the second."""


class DecodedTag(NamedTuple):
    """What n markers' cells say.

    Attributes:
        tags: (n,) the tag, or -1 where it is not sure.
        error: (n,) root mean square difference to the nearest tag's code word.
        margin: (n,) how many times farther the next tag is.
        distance: (n, roster) root mean square difference to each tag's code word.
    """

    tags: Tags
    error: Floats
    margin: Floats
    distance: Floats


class Decoder:
    """Names markers from a roster of tags; `tags` is the roster, ascending."""

    def __init__(self, family: MarkerFamily, roster: Sequence[int]) -> None:
        """Prepares the code words of `roster`, at all strengths of blur.

        Raises:
            FamilyError: The family does not have a tag of the roster.
        """
        self.tags = np.array(sorted(set(roster)), dtype=np.int32)
        bits = np.array([family.bits(int(tag)).ravel() for tag in self.tags], dtype=np.float64)
        bits = bits.reshape(-1, family.grid**2)
        sigmas = (family.unit_mm * BLURS_U).tolist()
        self._words = np.array(
            [
                [bits @ cell_blur(family, a, b).T + outer_light(family, a, b) for b in sigmas]
                for a in sigmas
            ],
            dtype=np.float32,
        )
        varied = np.maximum(self._words.std(axis=-1), _LEAST_VARIED)
        self._most_error = _MOST_UNEXPLAINED * varied
        self._lost = normal_share(-EDGE_REACH_U / BLURS_U)
        self._unlisted = unlisted_tag_reader(family)

    def blur(self, sharpness: Floats) -> NDArray[np.intp]:
        """Returns the nearest kept blur of edges as sharp as this, elementwise."""
        return nearest_blur(sharpness)

    def brightness(self, cells: Floats, ahead: NDArray[np.intp], left: NDArray[np.intp]) -> Floats:
        """Returns (n, cells) brightness between true black and white.

        `cells` is between what was measured as black and white near to blurred edges, where black
        is not quite black; `ahead` and `left` are (n,) blurs along and across the heading, see
        `blur`.
        """
        lost = 0.5 * (self._lost[ahead] + self._lost[left])[:, np.newaxis]
        return np.asarray((1.0 - 2.0 * lost) * cells + lost)

    def read_unlisted(self, cells: Floats, sharp_ahead: Floats, sharp_left: Floats) -> Tags:
        """Reads markers whose tags are not on the roster; the arguments are those of `decode`.

        Returns (n,) tags; -1 where the cells are not sure, and where the tag is on the roster.
        """
        ahead, left = self.blur(sharp_ahead), self.blur(sharp_left)
        tags = self._unlisted.read(self.brightness(cells, ahead, left), ahead, left)
        return np.where(np.isin(tags, self.tags), np.int32(UNNAMED), tags)

    def decode(self, cells: Floats, sharp_ahead: Floats, sharp_left: Floats) -> DecodedTag:
        """Names markers.

        Args:
            cells: (n, cells) brightness, 0 the arrow's black, 1 the disc's white.
            sharp_ahead: (n,) share of its contrast that an edge across the heading gains within a
                quarter of a unit to both sides.
            sharp_left: (n,) the same for an edge along the heading.
        """
        count, roster = len(cells), len(self.tags)
        if count == 0 or roster == 0:
            far = np.full((count, roster), _GREATEST_ERROR)
            error = np.full(count, _GREATEST_ERROR)
            return DecodedTag(np.full(count, UNNAMED, np.int32), error, error, far)
        ahead, left = self.blur(sharp_ahead), self.blur(sharp_left)
        true = self.brightness(cells, ahead, left)
        difference = true.astype(np.float32)[:, np.newaxis] - self._words[ahead, left]
        squares = np.einsum("ntc,ntc->nt", difference, difference)
        distance = np.sqrt(squares.astype(np.float64) / cells.shape[1])
        rows = np.arange(count)
        best = distance.argmin(axis=1)
        error = distance[rows, best]
        others = distance.copy()
        others[rows, best] = _GREATEST_ERROR
        margin = np.minimum(others.min(axis=1), _GREATEST_ERROR) / np.maximum(error, 1e-3)
        worst = np.abs(difference[rows, best]).max(axis=1)
        alike = error < self._most_error[ahead, left, best]
        sure = (worst < _WORST_CELL) & (margin > _LEAST_MARGIN) & alike
        tags = np.where(sure, self.tags[best], np.int32(UNNAMED))
        return DecodedTag(tags, error, margin, distance)
