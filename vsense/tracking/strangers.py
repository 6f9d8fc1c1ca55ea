"""Strangers: markers of the family whose tag is not on the roster, read without any list of tags.

With a roster a marker is the one tag that fits. Without one each cell has to be sure by itself:
the blur is taken back, and the marker is read only where no cell is anywhere near to the middle
between black and white, for what the picture's errors become when the blur is taken back.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from vsense.arena import UNNAMED
from vsense.tracking.codes import BLURS_U, cell_blur, outer_light, usable
from vsense.tracking.families import MarkerFamily

Floats = NDArray[np.float64]
Tags = NDArray[np.int32]

_LEAST_ERROR = 0.015
"""Root mean square error of a cell's brightness in the best picture."""
_DEVIATIONS = 4.0
"""So many standard deviations each cell must be away from the middle."""
_ALIKE = 2


class StrangerReader:
    """Reads one family's markers, whatever their tags are."""

    def __init__(self, family: MarkerFamily) -> None:
        """Prepares what takes the blur back, at all strengths."""
        sigmas = (family.unit_mm * BLURS_U).tolist()
        count = len(sigmas)
        cells = family.grid**2
        self._values = 1 << np.arange(cells, dtype=np.int64)
        blurs = np.array([[cell_blur(family, a, b) for b in sigmas] for a in sigmas])
        self._blurs = blurs.reshape(count, count, cells, cells)
        self._inverse = np.linalg.inv(self._blurs)
        self._gain = np.sqrt((self._inverse**2).sum(axis=3))
        self._outer = np.array([[outer_light(family, a, b) for b in sigmas] for a in sigmas])

    def read(self, cells: Floats, ahead: NDArray[np.intp], left: NDArray[np.intp]) -> Tags:
        """Reads markers.

        Args:
            cells: (n, cells) brightness, 0 true black, 1 true white.
            ahead: (n,) the blur along the heading, a place in `codes.BLURS_U`.
            left: (n,) the same across the heading.

        Returns:
            (n,) tags; -1 where one cell is not sure, or where nearly all are black or white.
        """
        seen = cells - self._outer[ahead, left]
        sharp = np.einsum("nij,nj->ni", self._inverse[ahead, left], seen)
        bits = sharp > 0.5
        again = np.einsum("nij,nj->ni", self._blurs[ahead, left], bits.astype(np.float64))
        error = np.sqrt(((seen - again) ** 2).mean(axis=1, keepdims=True))
        doubt = np.maximum(error, _LEAST_ERROR) * self._gain[ahead, left]
        sure = (np.abs(sharp - 0.5) > _DEVIATIONS * doubt).all(axis=1)
        sure &= usable(bits.sum(axis=1), bits.shape[1])
        return np.where(sure, bits @ self._values, UNNAMED).astype(np.int32)


@cache
def stranger_reader(family: MarkerFamily) -> StrangerReader:
    """Returns a family's reader, which all its decoders share."""
    return StrangerReader(family)


def could_be(family: MarkerFamily, tag: int, read: int) -> bool:
    """Tells whether a marker that was read as `read` may be `tag`, and something lies on it.

    What lies on a marker is dark and blackens cells, or is light and whitens them; a few cells may
    be anything.
    """
    true, seen = family.bits(tag), family.bits(read)
    darkened, lightened = (true & ~seen).sum(), (seen & ~true).sum()
    return bool(min(darkened, lightened) == 0 or darkened + lightened <= _ALIKE)
