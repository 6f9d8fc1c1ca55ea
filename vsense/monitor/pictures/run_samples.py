"""Samples of a run for its picture: the virtual world at a few moments, and the measures.

The world at a moment is as it is drawn: outlines with heights, colours, rasters.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import compress
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vsense.config.specs import Experiment
from vsense.world.entities import Arena, Box, Cylinder, Entity, Light, VirtualRobot, Zone
from vsense.world.fields import Floor
from vsense.world.world import World

if TYPE_CHECKING:
    from vsense.base.arena import Floats, Image

Rgb = tuple[int, int, int]

FLOOR_PX_PER_M = 100
"""Resolution at which floor and fields are drawn, unless the arena has more than `_MOST_PX`."""
_MOST_PX = 1_000_000

_CORNERS = 0.5 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
_ROUND = np.linspace(0.0, 2.0 * np.pi, 36, endpoint=False)


@dataclass(frozen=True, slots=True)
class Lamp:
    """A light: its place (2,), its height above the floor, and its colour."""

    place_m: Floats
    height_m: float
    colour: Rgb


@dataclass(frozen=True, slots=True)
class Solid:
    """A box or cylinder: its outline (k, 2), and the heights of its base and its top."""

    outline_m: Floats
    base_m: float
    top_m: float


@dataclass(frozen=True, slots=True)
class Patch:
    """A zone of the floor: its name, its outline (k, 2), its colour or None."""

    name: str
    outline_m: Floats
    colour: Rgb | None


@dataclass(frozen=True, slots=True)
class WorldSnapshot:
    """The visible virtual world; places are relative to the arena's middle.

    Attributes:
        floor: (h, w, 4) red, green, blue, alpha of the floor, first row at the highest y; None
            where it is white everywhere.
        fields: (h, w) concentrations of each field, likewise, as shares of its largest.
        virtual: Boxes and cylinders that are sensed only.
        physical: Those that stand in the real arena.
        zones: Regions of the floor; those with a colour are in `floor`, too.
        cones: (3, 2) polluted triangles, the source first.
        virtual_robots: (n, 5) x, y in m and yaw in rad of the virtual robots, radius and height in
            m of their bodies.
        leds: (n, 3) red, green, blue of the real robots' virtual LEDs; 0: off.
    """

    arena: Arena
    floor: Image | None
    fields: tuple[Floats, ...]
    virtual: tuple[Solid, ...]
    physical: tuple[Solid, ...]
    zones: tuple[Patch, ...]
    lamps: tuple[Lamp, ...]
    cones: tuple[Floats, ...]
    virtual_robots: Floats
    leds: NDArray[np.uint8]

    def within(self, part: Arena) -> WorldSnapshot:
        """The same of a part of the arena."""
        moved = np.array(part.centre_m[:2]) - np.array(self.arena.centre_m[:2])
        cut = partial(_cut, self.arena, part)
        return replace(
            self,
            arena=part,
            floor=None if self.floor is None else cut(self.floor),
            fields=tuple(cut(field) for field in self.fields),
            virtual=tuple(replace(s, outline_m=s.outline_m - moved) for s in self.virtual),
            physical=tuple(replace(s, outline_m=s.outline_m - moved) for s in self.physical),
            zones=tuple(replace(z, outline_m=z.outline_m - moved) for z in self.zones),
            lamps=tuple(replace(lamp, place_m=lamp.place_m - moved) for lamp in self.lamps),
            cones=tuple(cone - moved for cone in self.cones),
            virtual_robots=self.virtual_robots - np.array([*moved, 0.0, 0.0, 0.0]),
        )


def take_snapshot(world: World, experiment: Experiment) -> WorldSnapshot:
    """Copies the present state of the world of an experiment."""
    arena = experiment.arena
    cones = [world.cone(source) for source in experiment.sources]
    return make_snapshot(
        arena,
        list(world.entities.values()),
        floor_raster(world.floor, arena),
        [_field(world, name, arena) for name in world.fields],
        [cone.vertices() for cone in cones if cone is not None],
        world.leds[: world.real_robots].copy(),
    )


def make_snapshot(
    arena: Arena,
    entities: Sequence[Entity],
    floor: Image | None,
    fields: Iterable[Floats],
    cones: Iterable[Floats],
    leds: NDArray[np.uint8],
) -> WorldSnapshot:
    """Makes a snapshot of what is told in the arena frame.

    `floor` and `fields` are rasters over the arena, `cones` (3, 2), `leds` (n, 3); see
    `WorldSnapshot`.
    """
    centre = np.array(arena.centre_m[:2])
    solids = [(e.physical, _solid(e, centre)) for e in entities if isinstance(e, (Box, Cylinder))]
    robots = [
        (e.x_m, e.y_m, e.yaw_rad, e.model.radius_m, e.model.height_m)
        for e in entities
        if isinstance(e, VirtualRobot)
    ]
    lights = [e for e in entities if isinstance(e, Light)]
    return WorldSnapshot(
        arena=arena,
        floor=floor,
        fields=tuple(fields),
        virtual=tuple(solid for physical, solid in solids if not physical),
        physical=tuple(solid for physical, solid in solids if physical),
        zones=tuple(
            Patch(e.id, _outline(e) - centre, e.color) for e in entities if isinstance(e, Zone)
        ),
        lamps=tuple(
            Lamp(np.array(e.position_m[:2]) - centre, e.position_m[2], e.color) for e in lights
        ),
        cones=tuple(cone - centre for cone in cones),
        virtual_robots=np.array(robots).reshape(-1, 5) - np.array([*centre, 0.0, 0.0, 0.0]),
        leds=leds,
    )


def grid(arena: Arena) -> tuple[Floats, tuple[int, int]]:
    """Middles of the drawing's pixels on the floor (n, 2), and its rows and columns."""
    size_x_m, size_y_m, _ = arena.size_m
    # Files of ARGoS have arenas of hundreds of metres.
    px_per_m = min(FLOOR_PX_PER_M, math.sqrt(_MOST_PX / (size_x_m * size_y_m)))
    columns, rows = (max(round(size * px_per_m), 1) for size in (size_x_m, size_y_m))
    x = (np.arange(columns) + 0.5) / columns - 0.5
    y = 0.5 - (np.arange(rows) + 0.5) / rows
    across, down = np.meshgrid(x * arena.size_m[0], y * arena.size_m[1])
    points = np.stack((across.ravel(), down.ravel()), axis=-1) + np.array(arena.centre_m[:2])
    return points, (rows, columns)


def floor_raster(floor: Floor, arena: Arena) -> Image | None:
    """The floor's colours over an arena; see `WorldSnapshot`."""
    points, shape = grid(arena)
    colours = floor.sample(points)
    if (colours[:, :3] == 255.0).all():
        return None
    return np.asarray(np.rint(colours).reshape(*shape, 4), np.uint8)


def _cut(arena: Arena, part: Arena, picture: NDArray[Any]) -> NDArray[Any]:
    """The pixels of a part of the arena, at least one."""
    rows, columns = picture.shape[:2]
    px_per_m = np.array((columns, rows)) / np.array(arena.size_m[:2])
    middle = np.array((columns, rows)) / 2.0
    apart_px = (np.array(part.centre_m[:2]) - np.array(arena.centre_m[:2])) * px_per_m
    half_px = np.array(part.size_m[:2]) * px_per_m / 2.0
    low = np.rint(middle + apart_px * (1.0, -1.0) - half_px).astype(int).clip(0)
    high = np.maximum(np.rint(middle + apart_px * (1.0, -1.0) + half_px).astype(int), low + 1)
    return picture[low[1] : high[1], low[0] : high[0]]


def _field(world: World, name: str, arena: Arena) -> Floats:
    points, shape = grid(arena)
    values = world.fields[name].value(points)
    return np.asarray(values / max(float(values.max()), 1e-12)).reshape(shape)


def _solid(body: Box | Cylinder, centre: Floats) -> Solid:
    base_m = body.position_m[2]
    height_m = body.height_m if isinstance(body, Cylinder) else body.size_m[2]
    return Solid(_outline(body) - centre, base_m, base_m + height_m)


def _outline(thing: Box | Cylinder | Zone) -> Floats:
    """The outline of a body or zone on the floor, (k, 2), arena frame."""
    place = (thing.x_m, thing.y_m) if isinstance(thing, Zone) else thing.position_m[:2]
    if isinstance(thing, Cylinder) or (isinstance(thing, Zone) and thing.shape == "circle"):
        rim = np.stack((np.cos(_ROUND), np.sin(_ROUND)), axis=-1)
        return np.asarray(rim * thing.radius_m + place)
    cosine, sine = np.cos(thing.yaw_rad), np.sin(thing.yaw_rad)
    turn = np.array([[cosine, sine], [-sine, cosine]])
    corners = _CORNERS * np.array(thing.size_m[:2])
    return np.asarray(corners @ turn + place)


SPARE_TIMESTEPS = 3
"""Timesteps kept before a moment, where the host may miss the very last one."""


class RunSamples:
    """Filled timestep by timestep during a run.

    Attributes:
        moment: The run's timestep at whose end the first view is taken: the wind's turn, or
            half-time; None for a run without length.
        timesteps: Those of the run whose pictures are kept for that view.
        snapshots: The world at some timesteps of the run.
        shares: What was left of the first pollutant source, at every sampled timestep.
    """

    def __init__(self, experiment: Experiment, spare: int = SPARE_TIMESTEPS) -> None:
        self._experiment = experiment
        self.moment = experiment.turn_timestep or experiment.timesteps // 2 or None
        self.timesteps = range(
            0 if self.moment is None else max(self.moment - spare, 0), self.moment or 0
        )
        self.snapshots: dict[int, WorldSnapshot] = {}
        self.shares = array("d")
        self._last: int | None = None
        self._series: dict[str, array[float]] = {}

    def add(self, run_timestep: int, world: World) -> None:
        """Samples a timestep of the run, after the world has been updated."""
        self._last = run_timestep
        for name in world.results:
            # A result is 0 before its first value.
            self._series.setdefault(name, array("d", bytes(8 * len(self.shares))))
        for name, series in self._series.items():
            series.append(world.results.get(name, 0.0))
        source = self._experiment.source
        self.shares.append(1.0 if source is None else world.stock.share(source))
        if run_timestep in self.timesteps:
            self.snapshots[run_timestep] = take_snapshot(world, self._experiment)

    def thin(self, stay: Sequence[bool]) -> None:
        """Forgets the sampled timesteps that shall not stay."""
        self.shares = array("d", compress(self.shares, stay))
        for name, series in self._series.items():
            self._series[name] = array("d", compress(series, stay))

    def end(self, world: World) -> None:
        """Samples the world after the last timestep."""
        if self._last is not None:
            self.snapshots[self._last] = take_snapshot(world, self._experiment)

    def measures(self) -> dict[str, NDArray[np.float64]]:
        """The results over time, (n,) each, for every sampled timestep.

        A result is 0 before its first value; constant ones are left out.
        """
        series = {name: np.array(values) for name, values in self._series.items()}
        return {name: values for name, values in series.items() if np.ptp(values) > 0.0}
