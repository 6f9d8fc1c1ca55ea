"""Loop functions of predator_prey.argos: count the catches.

Prey is caught as soon as a predator is near, and cannot be caught again while it rests, whether its
controller knows it or not: among the blind, predators come upon prey by chance.

Measures, in every timestep:
    prey_caught   catches so far
    prey_resting  prey that rests now
"""

from __future__ import annotations

import numpy as np

from vsense.world.world import NEVER_NS, World


class LoopFunctions:
    """One run."""

    def __init__(self) -> None:
        self._caught = 0

    def reset(self, world: World) -> None:
        """Begins with all prey free."""
        self._free_s = np.zeros(int(world.driven_by(world.params["prey"]).sum()))

    def post_step(self, world: World) -> None:
        """Counts the prey that predators have come near to."""
        near_m = float(world.params["caught_cm"]) / 100.0
        robots = world.robots
        places_m = np.stack((robots["x_m"], robots["y_m"]), axis=-1)
        places_m[robots["capture_ns"] == NEVER_NS] = np.nan  # nobody knows where they are
        predators, prey = (
            places_m[world.driven_by(world.params[name])] for name in ("predators", "prey")
        )
        apart_m = np.nan_to_num(np.linalg.norm(prey[:, None] - predators, axis=-1), nan=np.inf)
        caught = (apart_m.min(axis=1, initial=np.inf) < near_m) & (self._free_s <= world.time_s)
        self._free_s[caught] = world.time_s + float(world.params["rest_s"])
        self._caught += int(caught.sum())
        world.results["prey_caught"] = self._caught
        world.results["prey_resting"] = int((self._free_s > world.time_s).sum())
