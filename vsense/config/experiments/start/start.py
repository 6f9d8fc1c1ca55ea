"""Loop functions of start.argos: count the robots on the spot.

Measures:
    robots_on_spot       now, in every timestep
    robots_on_spot_mean  its mean over the run, at the end
"""

from __future__ import annotations

import numpy as np

from vsense import World, Zone


class LoopFunctions:
    """One run."""

    def reset(self, world: World) -> None:
        """Begins to count."""
        self._counts: list[int] = []

    def post_step(self, world: World) -> None:
        """Counts; where robots are is what the cameras saw."""
        spot = world.entities[world.params["spot"]]
        if not isinstance(spot, Zone):
            raise TypeError(f"{spot.id!r} is no <vs:zone>")
        places_m = np.stack((world.robots["x_m"], world.robots["y_m"]), axis=-1)
        self._counts.append(int(spot.contains(places_m).sum()))
        world.results["robots_on_spot"] = self._counts[-1]

    def end(self, world: World) -> dict[str, float]:
        """Gives the mean over the run."""
        return {"robots_on_spot_mean": float(np.mean(self._counts or [0]))}
