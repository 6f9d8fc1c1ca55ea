"""Loop functions of pollutant-moving.argos: lead the polluter about, and count whom it pollutes.

Measures:
    robots_in_cone       cleaners in the cone now, in every timestep
    robots_in_cone_mean  its mean over the run, at the end
"""

from __future__ import annotations

import numpy as np

from vsense.world.entities import Zone
from vsense.world.world import World

ARRIVED_M = 0.10
"""So near to its destination the polluter is given the next one."""


class LoopFunctions:
    """One run. The polluter is the robot whose marker is that of the pollutant's source."""

    robots_may_change = True  # people may add virtual robots, and take them away

    def __init__(self) -> None:
        self._counts: list[int] = []

    def reset(self, world: World) -> None:
        """Gives the polluter its first destination."""
        self._lead(world)

    def pre_step(self, world: World) -> None:
        """Gives it the next one where it has arrived."""
        pose = world.pose(world.sources[0].tag)
        goal = world.entities[self._goal(world)]
        if pose is not None and isinstance(goal, Zone):
            away_m = np.hypot(goal.x_m - pose["x_m"], goal.y_m - pose["y_m"])
            if away_m < ARRIVED_M:
                self._lead(world)

    def post_step(self, world: World) -> None:
        """Counts the cleaners in the cone."""
        source, robots = world.sources[0], world.robots
        cleaners = robots[robots["tag"] != source.tag]
        cone = world.cone(source)
        inside = 0
        if cone is not None:
            places_m = np.stack((cleaners["x_m"], cleaners["y_m"]), axis=-1)
            inside = int(cone.contains(places_m).sum())
        world.results["robots_in_cone"] = inside
        self._counts.append(inside)

    def end(self, world: World) -> dict[str, float]:
        """Gives the mean over the run."""
        return {"robots_in_cone_mean": float(np.mean(self._counts or [0]))}

    def _goal(self, world: World) -> str:
        """What the destination sensor takes for the polluter's destination."""
        return f"destination_{world.sources[0].tag}"

    def _lead(self, world: World) -> None:
        """Draws a destination from the part of the arena that the experiment names."""
        corners = [float(world.params[name]) for name in ("west", "east", "south", "north")]
        x_m, y_m = world.random.uniform(corners[::2], corners[1::2])
        world.put(Zone(self._goal(world), "circle", x_m, y_m, radius_m=ARRIVED_M))
