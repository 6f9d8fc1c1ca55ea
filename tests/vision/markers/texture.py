"""Markers drawn from above, from what their family says is white."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsense.vision.markers.families import Family

_SUPERSAMPLING = 4


@dataclass(frozen=True, slots=True)
class MarkerTexture:
    """A marker drawn from above, +x to the right and +y up, the disc's centre in the middle.

    Attributes:
        ink: (n, n) uint8, 0 black to 255 white, 255 outside of the disc.
        coverage: (n, n) uint8, 255 where the disc covers the pixel entirely, 0 outside.
        px_per_mm: Resolution.
        centre_px: Column and row of the disc's centre: pixel centres are whole numbers.
    """

    ink: NDArray[np.uint8]
    coverage: NDArray[np.uint8]
    px_per_mm: float
    centre_px: float


def draw_texture(family: Family, tag: int, px_per_mm: float) -> MarkerTexture:
    """Draws a marker with smooth edges, see `MarkerTexture`.

    Raises:
        FamilyError: The family has no such tag.
    """
    size = int(np.ceil(family.disc_diameter_mm * px_per_mm)) + 2
    centre = (size - 1) / 2.0
    fine = size * _SUPERSAMPLING
    steps = ((np.arange(fine) + 0.5) / _SUPERSAMPLING - 0.5 - centre) / px_per_mm
    offset = np.stack(np.meshgrid(steps, -steps, indexing="xy"), axis=-1)
    on_disc = np.hypot(offset[..., 0], offset[..., 1]) <= family.disc_diameter_mm / 2.0
    white = family.is_white(tag, offset + family.disc_centre_mm) | ~on_disc
    return MarkerTexture(
        ink=_shrink(white, _SUPERSAMPLING),
        coverage=_shrink(on_disc, _SUPERSAMPLING),
        px_per_mm=px_per_mm,
        centre_px=centre,
    )


def _shrink(fine: NDArray[np.bool_], factor: int) -> NDArray[np.uint8]:
    size = fine.shape[0] // factor
    blocks = fine.reshape(size, factor, size, factor).mean(axis=(1, 3))
    return np.asarray(np.rint(255.0 * blocks), dtype=np.uint8)
