"""Loop functions of foraging.argos: count what is brought home.

A robot has an item as soon as it stands on the food, and has brought it home as soon as it stands
in the nest, whether its controller knows it or not: a blind swarm brings some home by chance.

Measures, in every timestep:
    items_home       brought home so far
    robots_carrying  robots with an item now
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsense.world.entities import Zone
from vsense.world.world import World


class LoopFunctions:
    """One run."""

    robots_may_change = True  # people may add virtual robots, and take them away

    def __init__(self) -> None:
        self._home = 0

    def reset(self, world: World) -> None:
        """Begins without items."""
        self._carrying = np.zeros(len(world.robots), dtype=bool)

    def post_step(self, world: World) -> None:
        """Hands out items, and takes them in."""
        # Whom people put into the world while it runs carries nothing.
        count = len(self._carrying)
        self._carrying |= _inside(world, "food")[:count]
        arrived = self._carrying & _inside(world, "nest")[:count]
        self._carrying &= ~arrived
        self._home += int(arrived.sum())
        world.results["items_home"] = self._home
        world.results["robots_carrying"] = int(self._carrying.sum())


def _inside(world: World, param: str) -> NDArray[np.bool_]:
    """Tells which robots stand in the zone that a parameter names, (n,)."""
    zone = world.entities[world.params[param]]
    if not isinstance(zone, Zone):
        raise TypeError(f"{zone.id!r} is no <vs:zone>")
    return zone.contains(np.stack((world.robots["x_m"], world.robots["y_m"]), axis=-1))
