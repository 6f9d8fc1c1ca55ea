"""The floor's colours, and what is spread over it.

Colours are a picture or one colour, with coloured zones painted over. What is spread, such as a
pheromone, is a grid that evaporates and diffuses.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsense.base.arena import Floats, Image
from vsense.base.native import check, kernel_ffi, kernels, pointer
from vsense.world.entities import Arena, Color, WorldError, Zone

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
        given, target = (pointer("double", array) for array in (points, colors))
        code = kernels.vs_floor_sample(self.cdata, given, len(points), target)
        self.check()
        check(code, "the floor")
        return colors

    def picture(self, most_px: int) -> Image | None:
        """Its picture with so many rows and columns at most; None: it is plain."""
        if self.image is None:
            return None
        step = -(-max(self.image.shape[:2]) // most_px)
        return self.image[::step, ::step]

    def check(self) -> None:
        """Raises the error with which whoever was asked for colours has failed."""

    @cached_property
    def cdata(self) -> Any:
        """The `struct vs_floor *`."""
        members: dict[str, Any] = {
            "color": (*self.color, int(OPAQUE)),
            "centre_m": self.centre_m,
            "size_m": self.size_m,
            "zones": self._zones,
            "zones_count": len(self._zones),
            **self._known_by,
        }
        if self.image is not None:
            members["image"] = pointer("uint8_t", self._pixels)
            members["rows"], members["columns"], members["channels"] = self.image.shape
        return kernel_ffi.new("struct vs_floor *", members)

    @property
    def _known_by(self) -> Mapping[str, Any]:
        """Who is asked for the colours, as members of `cdata`."""
        return {}

    @cached_property
    def _zones(self) -> Any:
        """Those that are seen, as `struct vs_zone[]`."""
        seen = [zone for zone in self.zones if zone.color is not None]
        return kernel_ffi.new("struct vs_zone[]", [zone.as_c()[0] for zone in seen])

    @cached_property
    def _pixels(self) -> Image:
        return np.ascontiguousarray(self.image)


MAX_CELLS = 4_000_000
MAX_SUBSTEPS = 50
MAX_CONCENTRATION = 1e9
"""Concentrations saturate here [1/m^2]."""

_STABLE = 0.2
"""Share of a cell's difference to each neighbour that one substep may level out; explicit
diffusion overshoots from 0.25 on."""


class Field:
    """One kind of substance: concentrations at the middles of square cells.

    A concentration is an amount per square metre, so that what robots release and sense does
    not depend on the size of the cells. Nothing leaves the field over the arena's border.

    Attributes:
        cell_m: side of a cell.
        corner_m: (2,) the lowest x and y of all cells.
        evaporation_per_s: the amount falls by exp(-evaporation_per_s * t).
        diffusion_m2_s: the variance of a drop grows by twice this per second, along x and y.
        concentration: (rows, columns) amounts per m^2; row 0 has the lowest y.
        spread: the `struct vs_spread *` of a timestep, as `prepare` has left it.
    """

    def __init__(
        self,
        id: str,
        arena: Arena,
        cell_m: float,
        evaporation_per_s: float = 0.0,
        diffusion_m2_s: float = 0.0,
        initial: float = 0.0,
    ) -> None:
        """Makes a field over the whole arena, with the concentration `initial` everywhere.

        The last column and row may reach beyond the arena's border.

        Raises:
            WorldError: a number is out of range, or there would be too many cells.
        """
        self.id = id
        self.cell_m = self._number("cell_m", cell_m, 1e-4)
        self.evaporation_per_s = self._number("evaporation_per_s", evaporation_per_s, 0.0)
        self.diffusion_m2_s = self._number("diffusion_m2_s", diffusion_m2_s, 0.0)
        self._initial = self._number("initial", initial, 0.0)
        columns, rows = (max(math.ceil(s / cell_m - 1e-9), 1) for s in arena.size_m[:2])
        if columns * rows > MAX_CELLS:
            raise WorldError(
                f"field {id!r}: cells of {cell_m:g} m are {columns} x {rows} in this arena,"
                f" expected at most {MAX_CELLS}: make them larger"
            )
        self.corner_m = np.array(arena.centre_m[:2]) - 0.5 * cell_m * np.array([columns, rows])
        self.concentration = np.full((rows, columns), self._initial)
        self._cdata: Any = None
        self.spread: Any = kernel_ffi.new("struct vs_spread *")
        self._before = np.empty(0)

    def check(self, timestep_s: float) -> None:
        """Raises WorldError where the field spreads over too many cells in one timestep."""
        if self._substeps(timestep_s) > MAX_SUBSTEPS:
            most = MAX_SUBSTEPS * _STABLE * self.cell_m**2 / timestep_s
            raise WorldError(
                f"field {self.id!r}: a diffusion of {self.diffusion_m2_s:g} m^2/s is too fast for"
                f" cells of {self.cell_m:g} m, expected at most {most:.3g} or larger cells"
            )

    def reset(self) -> None:
        """Goes back to the start."""
        self.fill(self._initial)

    def fill(self, concentration: float) -> None:
        """Makes the concentration the same everywhere [1/m^2]."""
        self.concentration[:] = self._number("concentration", concentration, 0.0)

    def total(self) -> float:
        """The amount of the substance in the arena."""
        return float(self.concentration.sum()) * self.cell_m**2

    def value(self, points_m: ArrayLike) -> Floats:
        """Concentration at points (n, 2), interpolated between the cells [1/m^2].

        A point outside reads what the nearest one inside reads.
        """
        return self.read(points_m)[:, 0]

    def gradient(self, points_m: ArrayLike) -> Floats:
        """Gradient of the concentration at points (n, 2): d/dx and d/dy, (n, 2) [1/m^3].

        It is taken over two cells, and 0 across the border.
        """
        return self.read(points_m)[:, 1:]

    def read(self, points_m: ArrayLike) -> Floats:
        """`value` and `gradient` at points (n, 2): (n, 3)."""
        points = np.ascontiguousarray(points_m, dtype=np.float64).reshape(-1, 2)
        readings = np.empty((len(points), 3))
        given, target = (pointer("double", array) for array in (points, readings))
        kernels.vs_field_read(self.as_c(), given, len(points), target)
        return readings

    def deposit(self, points_m: ArrayLike, amounts: ArrayLike) -> None:
        """Adds amounts at points (n, 2), shared out between the four nearest cells.

        A point outside of the arena is the nearest one inside. Amounts are (n,) or one for all.

        Raises:
            WorldError: an amount is negative or not finite.
        """
        points = np.ascontiguousarray(points_m, dtype=np.float64).reshape(-1, 2)
        added = np.ascontiguousarray(self._amounts(amounts, len(points)))
        given, what = (pointer("double", array) for array in (points, added))
        kernels.vs_field_deposit(self.as_c(), given, what, len(points), MAX_CONCENTRATION)

    def take(self, points_m: ArrayLike, amounts: ArrayLike) -> Floats:
        """Takes amounts away at points, as far as there is something; arguments as of `deposit`.

        Where a cell has too little for all, each point gets the same share of what it wanted: so
        the order does not matter.

        Returns:
            (n,) what each point got.
        """
        cells, shares = self._around(self._grid(points_m))
        wanted = self._amounts(amounts, len(cells))[:, None] * shares / self.cell_m**2
        flat = self.concentration.reshape(-1)
        demand = np.zeros_like(flat)
        np.add.at(demand, cells, wanted)
        met = np.divide(flat, demand, out=np.ones_like(flat), where=demand > flat)
        got = wanted * met[cells]
        flat -= np.minimum(demand, flat)
        taken: Floats = got.sum(axis=1) * self.cell_m**2
        return taken

    def step(self, dt_s: float) -> None:
        """Steps the field: the substance diffuses, then evaporates; raises as `check`."""
        self.prepare(dt_s)
        kernels.vs_spread_step(self.spread)

    def prepare(self, dt_s: float) -> None:
        """Sets `spread` to the field as it is now; raises as `check`."""
        self.check(dt_s)
        spread, substeps = self.spread, self._substeps(dt_s)
        if len(self._before) != self.concentration.size:
            self._before = np.empty(self.concentration.size)
            spread.before = pointer("double", self._before)
        spread.field, spread.substeps = self.as_c(), substeps
        spread.share = self.diffusion_m2_s * dt_s / max(substeps, 1) / self.cell_m**2
        spread.left = math.exp(-self.evaporation_per_s * dt_s)

    @property
    def rates(self) -> tuple[float, float]:
        """How fast it evaporates and diffuses: what else `spread` depends on."""
        return self.evaporation_per_s, self.diffusion_m2_s

    def set_rate(self, name: str, value: float, timestep_s: float) -> None:
        """Sets one of the `rates` by the name of its attribute.

        Raises:
            WorldError: it is out of range, or too fast for a timestep; the rate is as before.
        """
        before = getattr(self, name)
        try:
            setattr(self, name, self._number(name, value, 0.0))
            self.check(timestep_s)
        except WorldError:
            setattr(self, name, before)
            raise

    def _substeps(self, dt_s: float) -> int:
        return math.ceil(self.diffusion_m2_s * dt_s / (_STABLE * self.cell_m**2))

    def as_c(self) -> Any:
        """The `struct vs_field *`, which holds until `concentration` is another array."""
        cells = pointer("double", self.concentration)
        if self._cdata is None or self._cdata.cells != cells:
            rows, columns = self.concentration.shape
            corner_m = self.corner_m.tolist()
            members = (columns, rows, corner_m, self.cell_m, cells)
            self._cdata = kernel_ffi.new("struct vs_field *", members)
        return self._cdata

    def _grid(self, points_m: ArrayLike) -> Floats:
        """Places in cells; (0, 0) is the middle of the first one."""
        points = np.asarray(points_m, dtype=np.float64).reshape(-1, 2)
        return (points - self.corner_m) / self.cell_m - 0.5

    def _around(self, grid: Floats) -> tuple[NDArray[np.intp], Floats]:
        """The four cells around each place, (n, 4) flat, and their shares of it."""
        rows, columns = self.concentration.shape
        last = np.array([columns - 1, rows - 1])
        inside = np.clip(grid, 0.0, last)
        low = np.minimum(inside.astype(np.intp), np.maximum(last - 1, 0))
        (x, y), (u, v) = low.T, (inside - low).T
        right, up = np.minimum(x + 1, last[0]), np.minimum(y + 1, last[1])
        cells = np.stack(
            (y * columns + x, y * columns + right, up * columns + x, up * columns + right)
        )
        shares = np.stack(((1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v))
        return cells.T, shares.T

    def _amounts(self, amounts: ArrayLike, count: int) -> Floats:
        values = np.broadcast_to(np.asarray(amounts, dtype=np.float64), (count,))
        fine = (values >= 0.0) & (values <= MAX_CONCENTRATION)
        if not fine.all():
            raise WorldError(
                f"field {self.id!r}: an amount is {values[~fine][0]:g},"
                f" expected 0 to {MAX_CONCENTRATION:g}"
            )
        return values

    def _number(self, name: str, value: float, low: float) -> float:
        if not isinstance(value, (int, float)) or not low <= value <= MAX_CONCENTRATION:
            raise WorldError(
                f"field {self.id!r}: {name} is {value!r:.60},"
                f" expected a number from {low:g} to {MAX_CONCENTRATION:g}"
            )
        return float(value)


def by_id(fields: Iterable[Field], timestep_s: float) -> dict[str, Field]:
    """Fields by their ids.

    Raises:
        WorldError: two have the same, or one changes too fast for a timestep.
    """
    layers: dict[str, Field] = {}
    for layer in fields:
        layer.check(timestep_s)
        if layer.id in layers:
            raise WorldError(f"two fields are called {layer.id!r}")
        layers[layer.id] = layer
    return layers
