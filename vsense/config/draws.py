"""How a `<distribute>` draws the places of what it holds.

The draws depend on the seed alone (ARGoS's do not): Python's own generator gives the same
numbers for a seed in every version.
"""

from __future__ import annotations

import random
from dataclasses import dataclass

from vsense.world.entities import Entity, Vector


@dataclass(frozen=True, slots=True)
class Draw:
    """How a `<distribute>` draws three numbers.

    Attributes:
        method: "uniform" (between two corners), "gaussian" (mean and standard deviation),
            "constant" (the first of the two, always) or "grid" (around a centre).
        first: lower corner, mean, the values, or the grid's centre.
        second: upper corner, standard deviation, or the distances in the grid.
        layout: columns, rows and layers of a grid.
    """

    method: str
    first: Vector
    second: Vector
    layout: tuple[int, int, int] = (1, 1, 1)

    @property
    def is_random(self) -> bool:
        """Tells whether another trial may give other numbers."""
        return self.method in ("uniform", "gaussian")

    def sample(self, index: int, draws: random.Random) -> Vector:
        """Draws three numbers.

        Args:
            index: place among what is drawn together, from 0; decides the place in a grid.
            draws: gives the random ones.
        """
        if self.method == "constant":
            return self.first
        if self.method == "grid":
            return self._in_grid(index)
        sample = draws.uniform if self.method == "uniform" else draws.gauss
        x, y, z = (sample(a, b) for a, b in zip(self.first, self.second, strict=True))
        return x, y, z

    def _in_grid(self, index: int) -> Vector:
        """Counts from the corner with the largest x and y, x first. Source: ARGoS, space.cpp."""
        columns, rows, _ = self.layout
        steps = (index % columns, index // columns % rows, index // (columns * rows))
        x, y, z = (
            centre + ((count - 1) / 2.0 - step) * distance
            for centre, distance, count, step in zip(
                self.first, self.second, self.layout, steps, strict=True
            )
        )
        return x, y, z


@dataclass(frozen=True, slots=True)
class Distribution:
    """Where the bodies of one `<distribute>` may start.

    Attributes:
        position_m: x, y, z; of what stands on the floor z does not count.
        orientation_rad: turns about z, y, x; only the first counts.
        max_trials: draws per body before giving up.
        number: place of the `<distribute>` among those of the arena, from 0: in this order they
            are drawn.
        line: line of its `<entity>`.
    """

    position_m: Draw
    orientation_rad: Draw
    max_trials: int
    number: int
    line: int


@dataclass(frozen=True, slots=True)
class DistributedSpec:
    """One entity of a `<distribute>` whose place follows from the seed.

    Attributes:
        entity: the entity, at the arena frame's origin until it is placed.
        distribution: how its place is drawn.
        line: line of its element.
    """

    entity: Entity
    distribution: Distribution
    line: int
