"""Loop functions of aggregation.argos: move the spots, swap their colours, count who is on them.

Measures:
    robots_on_green, robots_on_red            now, in every timestep
    robots_on_green_mean, robots_on_red_mean  their means over the run, at the end
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vsense.world.entities import Zone
from vsense.world.world import World

COLORS = {"robots_on_green": (0, 255, 0), "robots_on_red": (255, 0, 0)}


class LoopFunctions:
    """One run. Each spot stays in its half of the arena: so they never cover each other."""

    robots_may_change = True  # people may add virtual robots, and take them away

    def __init__(self) -> None:
        self._goals_m: dict[str, NDArray[np.float64]] = {}
        self._counts: dict[str, list[int]] = {name: [] for name in COLORS}
        self._swapped = False

    def pre_step(self, world: World) -> None:
        """Moves the spots on, and swaps their colours when it is time."""
        step_m = float(world.params["speed_cm_s"]) / 100.0 * world.timestep_s
        for spot in world.zones():
            self._move(world, spot, step_m)
        if not self._swapped and world.time_s >= float(world.params["swap_s"]):
            self._swapped = True
            first, second = world.zones()
            world.put(replace(first, color=second.color))
            world.put(replace(second, color=first.color))

    def post_step(self, world: World) -> None:
        """Counts who is on which colour."""
        places_m = np.stack((world.robots["x_m"], world.robots["y_m"]), axis=-1)
        for name, color in COLORS.items():
            spots = [spot.contains(places_m) for spot in world.zones() if spot.color == color]
            self._counts[name].append(int(np.any(spots, axis=0).sum()))
            world.results[name] = self._counts[name][-1]

    def end(self, world: World) -> dict[str, float]:
        """Gives the means over the run."""
        return {
            f"{name}_mean": float(np.mean(counts or [0])) for name, counts in self._counts.items()
        }

    def _move(self, world: World, spot: Zone, step_m: float) -> None:
        """Moves a spot towards its goal, or gives it the next one."""
        goal_m = self._goals_m.get(spot.id)
        way_m = np.zeros(2) if goal_m is None else goal_m - (spot.x_m, spot.y_m)
        away_m = float(np.hypot(*way_m))
        if away_m <= step_m:
            self._goals_m[spot.id] = self._somewhere(world, spot)
            return
        x_m, y_m = (spot.x_m, spot.y_m) + way_m * (step_m / away_m)
        world.move(spot.id, float(x_m), float(y_m))

    def _somewhere(self, world: World, spot: Zone) -> NDArray[np.float64]:
        """Draws a place where the whole spot lies in its half of the arena."""
        assert world.arena is not None
        length_m, width_m, _ = world.arena.size_m
        side = 1.0 if spot.x_m > 0.0 else -1.0
        x_m = side * world.random.uniform(spot.radius_m, length_m / 2.0 - spot.radius_m)
        reach_m = width_m / 2.0 - spot.radius_m
        return np.array([x_m, world.random.uniform(-reach_m, reach_m)])
