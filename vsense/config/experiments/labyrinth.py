"""Loop functions of labyrinth.argos: open the doors, count who has come through and who cheated.

Measures, in every timestep:
    robots_in_east  robots behind the last wall now
    walls_crossed   how often a robot has driven through a wall or a closed door so far
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsense.world.entities import Box
from vsense.world.world import World

DOORS = ("first", "second")


class LoopFunctions:
    """One run."""

    def __init__(self) -> None:
        self._before_m: NDArray[np.float64] | None = None
        self._crossed = 0

    def pre_step(self, world: World) -> None:
        """Opens what is due."""
        for name in DOORS:
            door, lamp = world.params[f"{name}.door"], world.params.get(f"{name}.lamp")
            if door in world.entities and world.time_s >= float(world.params[f"{name}.time_s"]):
                world.remove(door)
                if lamp is not None:
                    world.remove(lamp)

    def post_step(self, world: World) -> None:
        """Counts."""
        places_m = np.stack((world.robots["x_m"], world.robots["y_m"]), axis=-1)
        walls = [box for box in world.boxes() if not box.physical]
        if self._before_m is not None:
            self._crossed += sum(_crossings(wall, self._before_m, places_m) for wall in walls)
        self._before_m = places_m
        last_m = max(wall.position_m[0] for wall in walls)
        world.results["robots_in_east"] = int((places_m[:, 0] > last_m).sum())
        world.results["walls_crossed"] = self._crossed


def _crossings(wall: Box, before_m: NDArray[np.float64], after_m: NDArray[np.float64]) -> int:
    """Counts the ways (n, 2) to (n, 2) across the middle of a wall that runs along y."""
    x_m, y_m, _ = wall.position_m
    across = (before_m[:, 0] > x_m) != (after_m[:, 0] > x_m)
    beside = np.abs(after_m[:, 1] - y_m) <= wall.size_m[1] / 2.0
    return int((across & beside).sum())
