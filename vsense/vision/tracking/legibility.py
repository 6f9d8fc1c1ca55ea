"""Whether a camera sees markers large enough to name them: the width of their cells in its picture.

Measured with 48 rendered markers of each kind and width: the share that is named in pictures with a
point spread of 0.6 px and a noise of 2.5 (and of 1.0 px and 4.0), by the width of a cell [px]:

| px   | arrow4x4     | arrow4x4-thesis | DICT_4X4_50  | 36h11        |
| 0.5  | -            | 8 % (0 %)       | -            | -            |
| 0.6  | -            | 35 % (0 %)      | -            | -            |
| 0.7  | 0 % (0 %)    | 88 % (25 %)     | 0 % (0 %)    | 0 % (0 %)    |
| 1.0  | 54 % (0 %)   | 100 % (81 %)    | 0 % (0 %)    | 25 % (0 %)   |
| 1.2  | 79 % (25 %)  | 100 % (100 %)   | 23 % (0 %)   | 52 % (10 %)  |
| 1.6  | 100 % (98 %) | 100 % (100 %)   | 81 % (10 %)  | 83 % (71 %)  |
| 2.0  | 100 % (100 %)| 100 % (100 %)   | 90 % (94 %)  | 94 % (96 %)  |
| 2.5  | 100 % (100 %)| 100 % (100 %)   | 100 % (100 %)| 100 % (100 %)|

None was misread. The thesis's cells are half as large as the unit that its outline is made of, so
they may be smaller: it is the outline that is lost first.
"""

from __future__ import annotations

from dataclasses import dataclass

from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import MarkerFamily, SquareFamily
from vsense.vision.tracking.outlines import shape_of

LEAST_UNIT_PX, GOOD_UNIT_PX = 1.0, 2.0
"""Of the outline's unit: none is named in a soft picture, at least nine of ten in a good one."""
LEAST_CELL_PX = 0.7
"""Of smaller cells, too."""
LEGIBLE_BLUR = 0.65
"""Standard deviation of the blur, in cells, in which markers are read in nearly every picture."""


@dataclass(frozen=True, slots=True)
class CellWidth:
    """How wide a family's cells are in a picture, and how wide they have to be [px].

    `px` is the width; below `least_px` hardly any marker can be named, from `good_px` on most.
    """

    family: str
    cell_mm: float
    px: float
    least_px: float
    good_px: float

    @property
    def is_illegible(self) -> bool:
        """Whether hardly any marker can be named."""
        return self.px < self.least_px

    @property
    def is_small(self) -> bool:
        """Whether many markers go without a name."""
        return self.px < self.good_px

    def in_words(self, seen: str = "") -> str:
        """Says how wide they are and what to do; `seen` is ", seen from where"."""
        larger = self.good_px / max(self.px, 1e-3)
        return (
            f"the cells of {self.family}, {self.cell_mm:g} mm, are {self.px:.2g} px wide{seen}:"
            f" expected at least {self.least_px:.2g} px, and {self.good_px:.2g} px for all robots"
            f" to be named; hang it lower, take a longer lens or more pixels, or print the markers"
            f" {larger:.1f} times as large"
        )


def cell_width(family: MarkerFamily | SquareFamily, px_per_m: float) -> CellWidth:
    """Returns how wide a family's cells are at a scale."""
    shape = shape_of(family)
    share = family.cell_mm / shape.unit_mm
    least_px = max(share * LEAST_UNIT_PX, LEAST_CELL_PX)
    good_px = max(share * GOOD_UNIT_PX, least_px)
    return CellWidth(
        family.name, family.cell_mm, 1e-3 * family.cell_mm * px_per_m, least_px, good_px
    )


def legible_blur_u(family: MarkerFamily | SquareFamily) -> float:
    """Returns the blur in which a family's markers are read, in units of their outline."""
    shape = shape_of(family)
    return LEGIBLE_BLUR * shape.cell_mm / shape.unit_mm


def cell_width_seen(
    family: MarkerFamily | SquareFamily, camera: Camera, height_m: float
) -> tuple[CellWidth, str]:
    """Returns how wide cells are in the middle of a camera's picture, and that in words.

    `height_m` is the markers' above the floor.
    """
    width = cell_width(family, camera.px_per_m(height_m))
    focal_px = (camera.fx_px * camera.fy_px) ** 0.5
    away_m = camera.position_m[2] - height_m
    seen = f", seen from {away_m:.2f} m above with a focal length of {focal_px:.0f} px"
    return width, width.in_words(seen)
