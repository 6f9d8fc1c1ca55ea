"""Samples of a run for its picture: the virtual world at a few moments, and the measures."""

from __future__ import annotations

import math
from array import array
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import compress
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vsense.config.specs import Experiment
from vsense.world.entities import Arena, Box, Cylinder
from vsense.world.world import World

if TYPE_CHECKING:
    from vsense.pictures.canvas import Floats, Image

Rgb = tuple[int, int, int]

FLOOR_PX_PER_M = 100
"""Resolution at which floor and fields are drawn, unless the arena has more than `_MOST_PX`."""
_MOST_PX = 1_000_000

SPARE = 3
"""Timesteps kept before a moment, because the host may miss the very last one."""

_CORNERS = 0.5 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
_ROUND = np.linspace(0.0, 2.0 * np.pi, 36, endpoint=False)


@dataclass(frozen=True, slots=True)
class Lamp:
    """A light: its place and its colour."""

    place_m: Floats
    colour: Rgb


@dataclass(frozen=True, slots=True)
class WorldSnapshot:
    """The visible virtual world; places are relative to the arena's middle.

    Attributes:
        floor: (h, w, 4) red, green, blue, alpha of the floor, first row at the highest y; None
            where it is white everywhere.
        fields: (h, w) concentrations of each field, likewise, as shares of its largest.
        virtual: Outlines (k, 2) of boxes and cylinders that are sensed only.
        physical: Outlines of those that stand in the real arena.
        cones: (3, 2) polluted triangles, the source first.
        virtual_robots: (n, 3) x, y in m and yaw in rad of the virtual robots.
        leds: (n, 3) red, green, blue of the real robots' virtual LEDs; 0: off.
    """

    arena: Arena
    floor: Image | None
    fields: tuple[Floats, ...]
    virtual: tuple[Floats, ...]
    physical: tuple[Floats, ...]
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
            virtual=tuple(outline - moved for outline in self.virtual),
            physical=tuple(outline - moved for outline in self.physical),
            lamps=tuple(Lamp(lamp.place_m - moved, lamp.colour) for lamp in self.lamps),
            cones=tuple(cone - moved for cone in self.cones),
            virtual_robots=self.virtual_robots - np.array([*moved, 0.0]),
        )


def take_snapshot(world: World, experiment: Experiment) -> WorldSnapshot:
    """Copies the present state of the world of an experiment."""
    arena = experiment.arena
    centre = np.array(arena.centre_m[:2])
    solids: list[Box | Cylinder] = [*world.boxes(), *world.cylinders()]
    cones = [world.cone(source) for source in experiment.sources]
    robots = world.robots[world.real_robots :]
    virtual_robots = np.stack((robots["x_m"], robots["y_m"], robots["yaw_rad"]), axis=-1)
    return WorldSnapshot(
        arena=arena,
        floor=_floor(world, arena),
        fields=tuple(_field(world, name, arena) for name in world.fields),
        virtual=tuple(_outline(s) - centre for s in solids if not s.physical),
        physical=tuple(_outline(s) - centre for s in solids if s.physical),
        lamps=tuple(Lamp(np.array(v.position_m[:2]) - centre, v.color) for v in world.lights()),
        cones=tuple(cone.vertices() - centre for cone in cones if cone is not None),
        virtual_robots=virtual_robots - np.array([*centre, 0.0]),
        leds=world.leds[: world.real_robots].copy(),
    )


class RunSamples:
    """Filled timestep by timestep during a run.

    Attributes:
        moment: The run's timestep at whose end the first view is taken: the wind's turn, or
            half-time; None for a run without length.
        kept: Timesteps of the run whose pictures are kept for that view.
        snapshots: The world at some timesteps of the run.
        shares: What was left of the first pollutant source, at every sampled timestep.
    """

    def __init__(self, experiment: Experiment) -> None:
        self._experiment = experiment
        self.moment = experiment.turn_timestep or experiment.timesteps // 2 or None
        self.kept = range(
            0 if self.moment is None else max(self.moment - SPARE, 0), self.moment or 0
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
        if run_timestep in self.kept:
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


def _grid(arena: Arena) -> tuple[Floats, tuple[int, int]]:
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


def _floor(world: World, arena: Arena) -> Image | None:
    points, shape = _grid(arena)
    colours = world.floor.sample(points)
    if (colours[:, :3] == 255.0).all():
        return None
    return np.asarray(np.rint(colours).reshape(*shape, 4), np.uint8)


def _field(world: World, name: str, arena: Arena) -> Floats:
    points, shape = _grid(arena)
    values = world.fields[name].value(points)
    return np.asarray(values / max(float(values.max()), 1e-12)).reshape(shape)


def _outline(solid: Box | Cylinder) -> Floats:
    """The outline of a body on the floor, (k, 2), arena frame."""
    if isinstance(solid, Cylinder):
        rim = np.stack((np.cos(_ROUND), np.sin(_ROUND)), axis=-1)
        return np.asarray(rim * solid.radius_m + solid.position_m[:2])
    cosine, sine = np.cos(solid.yaw_rad), np.sin(solid.yaw_rad)
    turn = np.array([[cosine, sine], [-sine, cosine]])
    corners = _CORNERS * np.array(solid.size_m[:2])
    return np.asarray(corners @ turn + solid.position_m[:2])
