"""The floor that robots drive home over: how far points are from what stands there, and ways.

Walls are boxes and posts of the experiment, the arena's border and the fence; robots that cannot
move are discs that come and go. Ways are found on a grid and pulled straight.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsense.base.arena import Floats, Point
from vsense.config.geofence import Geofence
from vsense.config.specs import Experiment
from vsense.world.entities import Arena, Box, Cylinder
from vsense.world.physics.motion import obstacles
from vsense.world.robot_models import EPUCK

GRID_CELL_M = 0.04
"""Side of a cell of the grid; larger where an arena would have more than `MAX_GRID_CELLS`."""
MAX_GRID_CELLS = 20_000
SAMPLE_M = 0.01
"""Distance of the points at which a straight path is checked."""
WALL_CLEARANCE_M = 0.06
"""Additional clearance from walls that paths have where there is room."""
NO_DISCS: Floats = np.zeros((0, 3))


class DrivingFloor:
    """Where the middle of a robot may be.

    Args:
        arena: its border is a wall.
        boxes: (b, 5) x_m, y_m, yaw_rad, size_x_m, size_y_m.
        posts: (c, 3) x_m, y_m, radius_m.
        fence: robots keep inside of it; None: the arena's border is all.
        radii_m: of the smallest and the largest robot.
    """

    def __init__(
        self,
        arena: Arena,
        boxes: ArrayLike = (),
        posts: ArrayLike = (),
        fence: Geofence | None = None,
        radii_m: tuple[float, float] = (EPUCK.radius_m, EPUCK.radius_m),
    ) -> None:
        self._smallest_m, self._largest_m = radii_m
        self._fence = fence
        self._boxes = np.asarray(boxes, dtype=np.float64).reshape(-1, 5)
        self._posts = np.asarray(posts, dtype=np.float64).reshape(-1, 3)
        self._centre = np.array(arena.centre_m[:2])
        self._half = np.array(arena.size_m[:2]) / 2.0
        area_m2 = float(np.prod(self._half)) * 4.0
        self._cell_m = max(GRID_CELL_M, math.sqrt(area_m2 / MAX_GRID_CELLS))

    @classmethod
    def of(cls, experiment: Experiment, virtual_walls: bool = False) -> DrivingFloor:
        """The floor of an experiment, on which virtual boxes and posts may count as real ones."""
        real = (experiment.boxes, experiment.cylinders)
        boxes: Iterable[Box] = real[0]
        posts: Iterable[Cylinder] = real[1]
        if virtual_walls:
            boxes = [e for e in experiment.entities if isinstance(e, Box)]
            posts = [e for e in experiment.entities if isinstance(e, Cylinder)]
        radii = sorted(robot.model.radius_m for robot in experiment.robots)
        extremes = radii[0], radii[-1]
        walls = obstacles(boxes, posts, experiment.tallest_m)
        return cls(experiment.arena, *walls, fence=experiment.geofence, radii_m=extremes)

    @property
    def is_open(self) -> bool:
        """Whether nothing stands between any two places but robots."""
        return not self._inner().any() and not len(self._posts) and self._fence is None

    def _inner(self) -> NDArray[np.bool_]:
        """Which boxes are no walls along the arena's border."""
        away = np.abs(self._boxes[:, :2] - self._centre) - self._half
        return np.asarray((away < -2.0 * self._smallest_m).all(axis=1))

    def clearance_m(self, points: Floats, discs: Floats = NO_DISCS) -> Floats:
        """How far points are from the nearest wall or disc.

        Args:
            points: (..., 2) x_m, y_m, arena frame.
            discs: (k, 3) x_m, y_m, radius_m of what stands there beside the walls.

        Returns:
            (...) in m, negative inside of something and outside of arena or fence.
        """
        free = (self._half - np.abs(points - self._centre)).min(axis=-1)
        if self._fence is not None:
            free = np.minimum(free, self._fence.depth_m(points))
        for x_m, y_m, yaw_rad, size_x_m, size_y_m in self._boxes:
            x, y = points[..., 0] - x_m, points[..., 1] - y_m
            cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
            over_x = np.abs(x * cosine + y * sine) - size_x_m / 2.0
            over_y = np.abs(y * cosine - x * sine) - size_y_m / 2.0
            outside = np.hypot(np.maximum(over_x, 0.0), np.maximum(over_y, 0.0))
            free = np.minimum(free, outside + np.minimum(np.maximum(over_x, over_y), 0.0))
        for x_m, y_m, radius_m in (*self._posts, *discs):
            free = np.minimum(free, np.hypot(points[..., 0] - x_m, points[..., 1] - y_m) - radius_m)
        return np.asarray(free)

    def is_clear(self, start: Point, end: Point, room_m: float, discs: Floats = NO_DISCS) -> bool:
        """Whether the straight way keeps so far from everything.

        Near its two ends it may be as close as these are.
        """
        length_m = math.dist(start, end)
        count = max(2, int(length_m / SAMPLE_M) + 1)
        share = np.linspace(0.0, 1.0, count)[:, np.newaxis]
        line = np.array(start) + share * (np.array(end) - np.array(start))
        free = self.clearance_m(line, discs)
        needed = np.full(count, room_m)
        for index in (0, -1):
            near = np.abs(share[:, 0] - share[index, 0]) * length_m < 2.0 * self._largest_m
            needed[near] = np.minimum(needed[near], free[index])
        return bool((free >= needed - 1e-9).all())

    def way(
        self, start: Point, end: Point, room_m: float, discs: Floats = NO_DISCS
    ) -> list[Point] | None:
        """A short way that keeps so far from everything: corners, then its end; None: none does.

        From a start or to an end that is nearer to something it begins or ends at the nearest
        free place.
        """
        if self.is_clear(start, end, room_m, discs):
            return [end]
        cells = self._search(start, end, room_m, discs)
        return None if cells is None else self._pulled([start, *cells, end], room_m, discs)

    def _pulled(self, points: list[Point], room_m: float, discs: Floats) -> list[Point]:
        """Leaves out corners that nobody needs; the first point is left out, too."""
        way, at = list[Point](), 0
        while at < len(points) - 1:
            ahead = len(points) - 1
            while ahead > at + 1 and not self.is_clear(points[at], points[ahead], room_m, discs):
                ahead -= max(1, (ahead - at) // 8)
            at = max(ahead, at + 1)
            way.append(points[at])
        return way

    def _search(self, start: Point, end: Point, room_m: float, discs: Floats) -> list[Point] | None:
        """A* over the cells that are free; gives their middles."""
        origin = self._centre - self._half
        columns, rows = (max(1, int(n)) for n in np.ceil(2.0 * self._half / self._cell_m))
        middles = np.stack(np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij"), axis=-1)
        places = origin + (middles + 0.5) * self._cell_m
        free = self.clearance_m(places, discs)
        if not (free >= room_m).any():
            return None
        toll = 1.0 + np.clip((room_m + WALL_CLEARANCE_M - free) / WALL_CLEARANCE_M, 0.0, 1.0)
        toll[free < room_m] = math.inf
        ends = [
            np.unravel_index(
                int(np.argmin(np.where(np.isfinite(toll), np.hypot(*(places - p).T).T, math.inf))),
                toll.shape,
            )
            for p in (np.array(start), np.array(end))
        ]
        first, last = ((int(cell[0]), int(cell[1])) for cell in ends)
        cells = _a_star(toll.tolist(), first, last)
        return None if cells is None else [(places[c][0], places[c][1]) for c in cells]


_STEPS = tuple((i, j, math.hypot(i, j)) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0))


def _a_star(
    toll: list[list[float]], first: tuple[int, int], last: tuple[int, int]
) -> list[tuple[int, int]] | None:
    """The cheapest cells from one to another; None: they are not connected.

    Source: P. Hart, N. Nilsson, B. Raphael, A formal basis for the heuristic determination of
    minimum cost paths (1968).
    """
    columns, rows = len(toll), len(toll[0])
    cost, before = {first: 0.0}, {first: first}
    waiting, done = [(math.dist(first, last), first)], set[tuple[int, int]]()
    while waiting:
        _, cell = heapq.heappop(waiting)
        if cell == last:
            break
        if cell in done:
            continue
        done.add(cell)
        for i, j, length in _STEPS:
            other = (cell[0] + i, cell[1] + j)
            if not (0 <= other[0] < columns and 0 <= other[1] < rows):
                continue
            sum_ = cost[cell] + length * toll[other[0]][other[1]]
            if sum_ < cost.get(other, math.inf):
                cost[other], before[other] = sum_, cell
                heapq.heappush(waiting, (sum_ + math.dist(other, last), other))
    if last not in before:
        return None
    way = [last]
    while way[-1] != first:
        way.append(before[way[-1]])
    return way[::-1]
