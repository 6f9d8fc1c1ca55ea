"""What a picture says about exposure and gain: its brightness, and its noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsense.tracking.grabbers_picture import Image

WHITE, BLACK = 254, 1
"""From the one on a pixel is saturated, up to the other it is black: a level beside the very end
is all that a rounding lens correction or a JPEG leaves of it."""
_BLOCK_PX = 16
_FLAT = (6.0, 249.0)
"""Blocks whose mean is outside are clipped, and show less noise than there is."""


@dataclass(frozen=True, slots=True)
class Brightness:
    """The brightness of one picture, in grey levels from 0 to 255.

    Attributes:
        counts: (256,) how many pixels have each level.
        mean: over all pixels.
        dark: 1st percentile.
        light: 99th percentile.
        saturated: share of the pixels that are white, 0 to 1.
        black: share of those that are black.
    """

    counts: NDArray[np.int64]
    mean: float
    dark: float
    light: float
    saturated: float
    black: float


def brightness(image: Image) -> Brightness:
    """Measures an (h, w) uint8 picture."""
    counts = np.bincount(image.ravel(), minlength=256)
    below = np.cumsum(counts) / image.size
    return Brightness(
        counts=counts,
        mean=float(counts @ np.arange(256)) / image.size,
        dark=float(np.searchsorted(below, 0.01)),
        light=float(np.searchsorted(below, 0.99)),
        saturated=float(counts[WHITE:].sum()) / image.size,
        black=float(counts[: BLACK + 1].sum()) / image.size,
    )


def noise(first: Image, second: Image) -> float | None:
    """Measures the noise of a camera that hangs still, from two pictures in a row.

    The difference of two pictures has the noise of both: sigma of the difference / sqrt 2. It is
    taken in blocks, each freed from its own mean, so that a lamp's flicker is no noise; and the
    median block counts, so that robots that drive through the picture are none, either.

    Args:
        first: (h, w) uint8.
        second: the next picture, of the same size.

    Returns:
        Standard deviation of a pixel [grey levels]; None where the picture is clipped all over,
        or too small.
    """
    rows, columns = (side // _BLOCK_PX for side in first.shape)
    if first.shape != second.shape or rows * columns == 0:
        return None
    whole = slice(rows * _BLOCK_PX), slice(columns * _BLOCK_PX)
    shape = (rows, _BLOCK_PX, columns, _BLOCK_PX)
    now = second[whole].reshape(shape).astype(np.float32)
    change = now - first[whole].reshape(shape)
    level = now.mean(axis=(1, 3))
    useful = (level > _FLAT[0]) & (level < _FLAT[1])
    if not useful.any():
        return None
    return float(np.median(change.std(axis=(1, 3))[useful])) / float(np.sqrt(2.0))
