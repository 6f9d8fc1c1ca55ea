"""A sensor of your own: how many other robots are near. In an experiment's <sensors>:

    <vs:sensor file="crowd.py" reach="0.3" />

Sensor "crowd", one number.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense import Element, Robots, Scope, World


@dataclass
class Crowd:
    """Counts the others within `reach_m`."""

    reach_m: float
    name: str = "crowd"  # what controllers ask for
    layout: str = "u1"  # what travels: one byte

    def read(self, world: World, robots: Robots) -> NDArray[Any]:
        """One row of numbers for each of `robots`."""
        seen = world.robots[world.robots["seen"]]
        east_m = seen["x_m"] - robots["x_m"][:, None]
        north_m = seen["y_m"] - robots["y_m"][:, None]
        near = np.hypot(east_m, north_m) < self.reach_m
        return np.asarray(near.sum(axis=1, keepdims=True) - 1)  # without oneself


def from_xml(element: Element, scope: Scope) -> Crowd:
    """Makes it from its element's attributes; one that nobody reads is an error."""
    return Crowd(element.number("reach", 0.01, 10.0, "m", default=0.3))
