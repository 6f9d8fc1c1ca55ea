"""The part of an arena that robots can get to: walls often enclose little of a large one.

ARGoS's missions have arenas of 10 x 10 m with a ring of walls around two of them. Only there the
lab's cameras have to see, and people to look.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.config.specs import Experiment
from vsense.modes.lab._backdrop import Block
from vsense.world.entities import Arena, Box, Cylinder
from vsense.world.robot_models import EPUCK
from vsense.world.world import World

_CELL_M = 0.01
_MOST_CELLS = 4096
"""Cells along a side; larger arenas have larger cells."""
_PASSAGE_M = 0.01
"""A robot is taken to be so much narrower than it is: cells are no exact outlines."""
_BORDER_M = 0.1
"""Of pictures around what can be reached: they show the walls, too."""


def reachable(experiment: Experiment) -> Arena:
    """Gives the smallest arena, within the experiment's, that holds all that its bodies can reach.

    Robots and objects stand where the experiment says; one whose pose is not known yet may stand
    anywhere, and so may all where nothing encloses them. Boxes and cylinders of the real arena are
    in their way if they stand on the floor.
    """
    arena = experiment.arena
    poses = [robot.pose for robot in experiment.robots]
    poses += [thing.pose for thing in experiment.objects]
    starts = [(pose.x_m, pose.y_m) for pose in poses if pose is not None]
    if len(starts) < len(poses):
        return arena
    return _reached(arena, experiment.solids, starts)


def drawn(world: World, arena: Arena, poses: NDArray[np.float64]) -> Arena:
    """Gives the part of the arena that the picture of a run shows: what its bodies can reach from
    where they were at its beginning, and wherever they have been, with a border.

    Args:
        world: at the run's end.
        poses: (timesteps, bodies, 3) x, y in m and yaw in rad.
    """
    if not poses.size:
        return arena
    standing: list[Box | Cylinder] = [*world.boxes(), *world.cylinders()]
    solids = [thing for thing in standing if thing.physical]
    part = _reached(arena, solids, poses[0, :, :2].tolist())
    virtual = world.robots[world.real_robots :]
    beside = np.stack((virtual["x_m"], virtual["y_m"]), axis=-1)
    places = np.concatenate((poses[..., :2].reshape(-1, 2), beside))
    half = np.array(part.size_m[:2]) / 2.0
    low = np.minimum(_corner(part), places.min(axis=0) - EPUCK.radius_m)
    high = np.maximum(_corner(part) + 2.0 * half, places.max(axis=0) + EPUCK.radius_m)
    return _within(arena, low - _BORDER_M, high + _BORDER_M)


def _reached(
    arena: Arena, solids: Sequence[Box | Cylinder], starts: Sequence[Sequence[float]]
) -> Arena:
    """The smallest part of an arena with all that can be reached from some places in it."""
    if not starts:
        return arena
    cell_m = max(_CELL_M, max(arena.size_m[:2]) / _MOST_CELLS)
    free = _free(arena, solids, cell_m)
    _, regions = cv2.connectedComponents(free, connectivity=4)
    here = {int(regions[cell]) for start in starts for cell in _cells(arena, start, cell_m, free)}
    rows, columns = np.nonzero(np.isin(regions, list(here - {0})))
    if not len(rows):
        return arena
    low = _corner(arena) + np.array((columns.min(), rows.min())) * cell_m - EPUCK.radius_m
    high = _corner(arena) + np.array((columns.max() + 1, rows.max() + 1)) * cell_m
    return _within(arena, low, high + EPUCK.radius_m)


def _corner(arena: Arena) -> NDArray[np.float64]:
    """The arena's place of lowest x and y."""
    return np.array(arena.centre_m[:2]) - np.array(arena.size_m[:2]) / 2.0


def _within(arena: Arena, low: NDArray[np.float64], high: NDArray[np.float64]) -> Arena:
    """The arena between two corners, no larger than `arena`."""
    low = np.maximum(low, _corner(arena))
    high = np.minimum(high, _corner(arena) + np.array(arena.size_m[:2]))
    (size_x, size_y), (x_m, y_m) = (high - low).tolist(), ((low + high) / 2.0).tolist()
    return Arena((size_x, size_y, arena.size_m[2]), (x_m, y_m, arena.centre_m[2]))


def _free(arena: Arena, solids: Sequence[Box | Cylinder], cell_m: float) -> NDArray[np.uint8]:
    """Where the middle of a robot may be: 1 in a free cell, rows along y, columns along x."""
    columns, rows = (max(1, math.ceil(size_m / cell_m)) for size_m in arena.size_m[:2])
    solid = np.zeros((rows, columns), dtype=np.uint8)
    for thing in solids:
        if thing.position_m[2] < EPUCK.height_m:
            outline = Block.of(thing).outline()
            cells = np.rint((outline - _corner(arena)) / cell_m - 0.5).astype(np.int32)
            cv2.fillPoly(solid, [cells], 1)
    reach = max(0, round((EPUCK.radius_m - _PASSAGE_M) / cell_m))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    return np.asarray(1 - cv2.dilate(solid, disc), dtype=np.uint8)


def _cells(
    arena: Arena, start: Sequence[float], cell_m: float, free: NDArray[np.uint8]
) -> Iterator[tuple[int, int]]:
    """The free cells around a start: a robot that touches a wall stands in none itself."""
    column, row = ((np.array(start) - _corner(arena)) / cell_m).astype(int).tolist()
    around = math.ceil(EPUCK.radius_m / cell_m)
    rows, columns = free.shape
    for y in range(max(0, row - around), min(rows, row + around + 1)):
        for x in range(max(0, column - around), min(columns, column + around + 1)):
            if free[y, x] and math.hypot(y - row, x - column) * cell_m <= _PASSAGE_M + cell_m:
                yield y, x
