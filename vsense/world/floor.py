"""The floor's colours: a picture mapped on it or one colour, with coloured zones painted over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsense.base.native import kernel_ffi, kernels
from vsense.world.entities import Color, WorldError, Zone

Floats = NDArray[np.float64]
Image = NDArray[np.uint8]

WHITE: Color = (255, 255, 255)
OPAQUE = 255.0


@dataclass(frozen=True)
class Floor:
    """The floor's colours.

    Attributes:
        image: (h, w, 3 or 4) uint8 red, green, blue and perhaps alpha, its first row at the highest
            y; None: the floor is plain.
        size_m: extent along x and y that the picture covers.
        centre_m: middle of the picture. ARGoS lays it round the origin whatever the arena's centre.
        color: of a plain floor.
        zones: regions painted over it, later ones over earlier ones; those without colour are not
            seen.
    """

    image: Image | None = None
    size_m: tuple[float, float] = (1.0, 1.0)
    centre_m: tuple[float, float] = (0.0, 0.0)
    color: Color = WHITE
    zones: Sequence[Zone] = field(default=())

    def __post_init__(self) -> None:
        """Raises WorldError for a picture of a wrong shape, type, or extent."""
        image = self.image
        if image is None:
            return
        fits = image.ndim == 3 and image.shape[2] in (3, 4) and image.size > 0
        if image.dtype != np.uint8 or not fits:
            raise WorldError(
                f"the floor's picture has shape {image.shape} of {image.dtype},"
                " expected (height, width, 3 or 4) of uint8"
            )
        if not all(0.0 < size < np.inf for size in self.size_m):
            raise WorldError(f"the floor's picture covers {self.size_m} m, expected lengths")

    def with_zones(self, zones: Sequence[Zone]) -> Floor:
        """The same floor with other zones painted over it."""
        return replace(self, zones=tuple(zones))

    def sample(self, points_m: ArrayLike) -> Floats:
        """Colours (n, 4) at points (n, 2): red, green, blue, alpha, each 0..255.

        A point is as the pixel that it lies in, not interpolated, as in ARGoS; one outside of the
        picture as the nearest pixel inside. Source: ARGoS's image floor, iridia.md section 2.
        """
        points = np.ascontiguousarray(points_m, dtype=np.float64).reshape(-1, 2)
        colors = np.empty((len(points), 4))
        given, target = (kernel_ffi.from_buffer("double[]", some) for some in (points, colors))
        kernels.vs_floor_sample(self.cdata, given, len(points), target)
        return colors

    @property
    def is_painted(self) -> bool:
        """Whether `cdata` says all: nobody has to be asked for a colour."""
        return True

    @cached_property
    def cdata(self) -> Any:
        """The `struct vs_floor *`."""
        made: Any = kernel_ffi.new("struct vs_floor *")
        made.color = (*self.color, int(OPAQUE))
        made.centre_m, made.size_m = self.centre_m, self.size_m
        if self.image is not None:
            made.rows, made.columns, made.channels = self.image.shape
            made.image = kernel_ffi.from_buffer("uint8_t[]", self._pixels)
        made.zones, made.zones_count = self._zones, len(self._zones)
        return made

    @cached_property
    def _zones(self) -> Any:
        """Those that are seen, as `struct vs_zone[]`."""
        seen = [zone for zone in self.zones if zone.color is not None]
        return kernel_ffi.new("struct vs_zone[]", [zone.as_c()[0] for zone in seen])

    @cached_property
    def _pixels(self) -> Image:
        """The picture in one piece."""
        return np.ascontiguousarray(self.image)
