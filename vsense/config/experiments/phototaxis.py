"""Loop functions of phototaxis.argos: carry the light round, and measure how far it is.

Measures:
    light_distance_m       mean distance of the robots to the light along the floor now [m]
    light_distance_mean_m  its mean over the run, at the end [m]
"""

from __future__ import annotations

import math

import numpy as np

from vsense.world.entities import Light, Vector
from vsense.world.world import World

FLATNESS = 0.6
"""Height of the ellipse over its width: the arena is not square."""


class LoopFunctions:
    """One run. The light's course is an ellipse around the arena's origin."""

    robots_may_change = True  # people may add virtual robots, and take them away

    def __init__(self) -> None:
        self._distances_m: list[float] = []
        self._put_m: tuple[float, float] | None = None
        self._reach_m = self._start_rad = 0.0

    def reset(self, world: World) -> None:
        """Reads how the light moves."""
        self._turn_s = float(world.params["turn_s"])
        self._orbit(self._lamp(world).position_m)

    def pre_step(self, world: World) -> None:
        """Moves the light on."""
        turned_rad = 2.0 * math.pi * world.time_s / self._turn_s
        position_m = self._lamp(world).position_m
        if self._put_m != position_m[:2]:  # somebody has dragged it: it goes on from there
            self._orbit(position_m, turned_rad)
        angle_rad = self._start_rad + turned_rad
        x_m = self._reach_m * math.cos(angle_rad)
        y_m = self._reach_m * FLATNESS * math.sin(angle_rad)
        world.move(world.params["light"], x_m, y_m)
        self._put_m = self._lamp(world).position_m[:2]

    def _orbit(self, position_m: Vector, turned_rad: float = 0.0) -> None:
        """Has the light circle through a place, where it is after so much of a turn."""
        self._put_m = position_m[:2]
        self._reach_m = math.hypot(position_m[0], position_m[1] / FLATNESS)
        self._start_rad = math.atan2(position_m[1] / FLATNESS, position_m[0]) - turned_rad

    def post_step(self, world: World) -> None:
        """Measures the distance."""
        x_m, y_m, _ = self._lamp(world).position_m
        away_m = np.hypot(world.robots["x_m"] - x_m, world.robots["y_m"] - y_m)
        self._distances_m.append(float(away_m.mean()))
        world.results["light_distance_m"] = self._distances_m[-1]

    def end(self, world: World) -> dict[str, float]:
        """Gives the mean over the run."""
        return {"light_distance_mean_m": float(np.mean(self._distances_m or [0.0]))}

    def _lamp(self, world: World) -> Light:
        lamp = world.entities[world.params["light"]]
        if not isinstance(lamp, Light):
            raise TypeError(f"{lamp.id!r} is no <light>")
        return lamp
