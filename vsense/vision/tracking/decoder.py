"""Which tag an arrow carries: its cells compared with the roster's code words.

A cell's brightness is compared with what the picture's blur makes of each tag in the roster; how
blurred a marker is, along its heading and across it, is measured at its own edges. This is the seam
to `c_src/host/vs_codes.h`, which compares; the words under every blur are prepared here.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import UNNAMED
from vsense.base.native import kernel_ffi, kernels
from vsense.vision.markers.codes import BLURS_U, cell_blur, normal_share, outer_light
from vsense.vision.markers.families import MarkerFamily
from vsense.vision.tracking.joining import unlisted_tag_reader
from vsense.vision.tracking.kernel import MARKER
from vsense.vision.tracking.outlines import EDGE_REACH_U, SHARPNESS, nearest_blur

Floats = NDArray[np.float64]
Tags = NDArray[np.int32]

_MOST_UNEXPLAINED, _LEAST_VARIED = 0.6, 0.1
"""The error may be this share of how much the word's own cells differ: a word that explains less is
not what is there, however much worse the others are. Nearly blank words differ by the second."""


class DecodedTag(NamedTuple):
    """What n markers' cells say.

    Attributes:
        tags: (n,) the tag, or -1 where it is not sure.
        error: (n,) root mean square difference to the nearest tag's code word.
        margin: (n,) how many times farther the next tag is.
    """

    tags: Tags
    error: Floats
    margin: Floats


class Decoder:
    """Names markers from a roster of tags.

    Attributes:
        tags: The roster, ascending.
        struct: `struct vs_codes`, for the kernel; it lives as long as the decoder.
    """

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
                [
                    cell_blur(family, a, b) @ bits.T + outer_light(family, a, b)[:, None]
                    for b in sigmas
                ]
                for a in sigmas
            ],
            dtype=np.float32,
        )
        varied = np.maximum(self._words.std(axis=-2), _LEAST_VARIED)
        self._most_error = np.asarray(_MOST_UNEXPLAINED * varied, dtype=np.float32)
        self._per_length = _per_length(self._words, family.grid)
        self._lost = normal_share(-EDGE_REACH_U / BLURS_U)
        self._unlisted = unlisted_tag_reader(family)
        self.struct = kernel_ffi.new("struct vs_codes *")
        self.struct.cells, self.struct.side = family.grid**2, family.grid
        self.struct.tags = len(self.tags)
        self.struct.tag = kernel_ffi.cast("int32_t *", self.tags.ctypes.data)
        self.struct.word = kernel_ffi.cast("float *", self._words.ctypes.data)
        self.struct.most_error = kernel_ffi.cast("float *", self._most_error.ctypes.data)
        self.struct.per_length = kernel_ffi.cast("float *", self._per_length.ctypes.data)
        self.struct.lost, self.struct.sharp = self._lost.tolist(), SHARPNESS.tolist()

    def brightness(self, cells: Floats, ahead: NDArray[np.intp], left: NDArray[np.intp]) -> Floats:
        """Returns (n, cells) brightness between true black and white.

        `cells` is between what was measured as black and white near to blurred edges, where black
        is not quite black; `ahead` and `left` are (n,) blurs along and across the heading, see
        `nearest_blur`.
        """
        lost = 0.5 * (self._lost[ahead] + self._lost[left])[:, np.newaxis]
        return np.asarray((1.0 - 2.0 * lost) * cells + lost)

    def read_unlisted(self, cells: Floats, sharp_ahead: Floats, sharp_left: Floats) -> Tags:
        """Reads markers whose tags are not on the roster; the arguments are those of `decode`.

        Returns (n,) tags; -1 where the cells are not sure, and where the tag is on the roster.
        """
        ahead, left = nearest_blur(sharp_ahead), nearest_blur(sharp_left)
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
        markers = np.zeros(len(cells), dtype=MARKER)
        markers["cell"][:, : cells.shape[1]] = cells
        markers["sharp_ahead"], markers["sharp_left"] = sharp_ahead, sharp_left
        rows = kernel_ffi.cast("struct vs_marker *", markers.ctypes.data)
        kernels.vs_codes_name(self.struct, rows, len(markers))
        return DecodedTag(markers["tag"].astype(np.int32), markers["error"], markers["margin"])


def _per_length(words: NDArray[np.float32], grid: int) -> NDArray[np.float32]:
    """Returns 1 over the lengths of (..., cells, n) words without mean and slopes, (..., n)."""
    along = np.arange(grid) - 0.5 * (grid - 1)
    slopes = [np.ones(grid**2), np.tile(along, grid), np.repeat(along, grid)]
    even = np.linalg.qr(np.stack(slopes, axis=1))[0].astype(np.float32)
    left = (words**2).sum(axis=-2) - ((even.T @ words) ** 2).sum(axis=-2)
    return np.asarray(1.0 / np.sqrt(np.maximum(left, 1e-6)), dtype=np.float32)
