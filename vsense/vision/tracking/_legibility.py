"""Where in a camera's picture markers can be read: by how wide it shows their cells.

An inclined camera shows a cell wide in one direction and narrow in another, and the narrow one
counts. Of 4 x 480 rendered markers below cameras inclined by 35 to 68 degrees were named, by that
width [px]:

|                 | 0.6 | 0.8  | 1.0  | 1.2   | 1.5   | 1.8   | 2.2   | 3.0   |
| arrow4x4        | 0 % | 10 % | 56 % | 91 %  | 89 %  | 100 % | 100 % | 100 % |
| arrow4x4-thesis | 28  | 66   | 92   | 100   | 100   | 100   | 100   |       |
| DICT_4X4_50     | 0   | 0    | 19   | 49    | 79    | 87    | 88    | 100   |
| 36h11           | 0   | 10   | 47   | 55    | 75    | 93    | 100   | 100   |
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import MarkerFamily, SquareFamily
from vsense.vision.tracking._kernel import sizes_at
from vsense.vision.tracking.marker_detector import CellWidth, cell_width
from vsense.vision.tracking.mask import Mask

COLUMNS = 80
"""Places along a picture's width that are enough for shares of it."""
_TOLD = 0.005
"""A smaller share of a picture is none."""


class Legibility(NamedTuple):
    """How well one family's markers can be read in each part of a camera's picture.

    Attributes:
        cell: Its widths' limits; `px` is the width where it is narrowest.
        widths_px: (h, w) of a cell in its narrowest direction; 0 where markers cannot be.
        places_m: (h, w, 2) where a marker is that is seen there; no number where none can be.
    """

    camera: Camera
    cell: CellWidth
    widths_px: Floats
    places_m: Floats

    @property
    def can_be(self) -> NDArray[np.bool_]:
        """(h, w) where markers can be."""
        return self.widths_px > 0.0

    @property
    def unread(self) -> NDArray[np.bool_]:
        """(h, w) where hardly any can be read."""
        return self.can_be & (self.widths_px < self.cell.least_px)

    @property
    def seldom(self) -> NDArray[np.bool_]:
        """(h, w) where they are read, but not in every picture."""
        return self.can_be & ~self.unread & (self.widths_px < self.cell.good_px)

    @property
    def shares(self) -> tuple[float, float]:
        """`unread` and `seldom` as shares of `can_be`."""
        total = max(int(self.can_be.sum()), 1)
        return float(self.unread.sum()) / total, float(self.seldom.sum()) / total

    def in_words(self) -> str:
        """Says where hardly any is read; nothing where all are."""
        unread, seldom = self.shares
        rest = f"{100 * seldom:.0f} % show them too small to be read in every picture, below"
        rest += f" {self.cell.good_px:.2g} px"
        if unread < _TOLD:
            return rest if seldom >= _TOLD else ""
        away_m = self.places_m[self.unread] - self.camera.position_m[:2]
        return (
            f"in {100 * unread:.0f} % of where its picture may show markers they are too far or too"
            f" oblique, and hardly any {self.cell.family} is read: from"
            f" {np.hypot(*away_m.T).min():.2f} m beside the camera on, cells of"
            f" {self.cell.cell_mm:g} mm are narrower than {self.cell.least_px:.2g} px"
            + (f"; another {rest}" if seldom >= _TOLD else "")
        )


def legibility(
    family: MarkerFamily | SquareFamily,
    camera: Camera,
    height_m: float,
    mask: Mask | None = None,
    columns: int = COLUMNS,
) -> Legibility:
    """Returns how well markers at a height can be read; a mask says where they can be."""
    step = camera.width_px / columns
    rows = max(round(camera.height_px / step), 1)
    across, down = (np.arange(columns) + 0.5) * step - 0.5, (np.arange(rows) + 0.5) * step - 0.5
    pixels = np.stack(np.meshgrid(across, down), axis=-1)
    with np.errstate(all="ignore"):
        places = camera.to_plane(pixels, height_m)
        arms = np.concatenate((places, np.full((*places.shape[:2], 1), height_m)), axis=-1)
        ahead = (arms - camera.position_m) @ np.reshape(camera.rotation, (3, 3))[2]
        shortest = sizes_at(camera, height_m, pixels.reshape(-1, 2))[:, -1].reshape(rows, columns)
    # What a picture shows above the horizon is where the plane would be behind the camera.
    can_be = (ahead > 0.0) & np.isfinite(shortest)
    if mask is not None:
        can_be &= mask.keeps(places.reshape(-1, 2)).reshape(rows, columns)
    cell = cell_width(family, float(shortest[can_be].min()) if can_be.any() else 0.0)
    widths = np.where(can_be, 1e-3 * cell.cell_mm * shortest, 0.0)
    return Legibility(camera, cell, widths, np.where(can_be[..., np.newaxis], places, np.nan))
