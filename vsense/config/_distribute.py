"""Reads `<distribute>`: how the places of what it holds are drawn.

The draws depend on the seed alone (ARGoS's do not): Python's own generator gives the same numbers
for a seed in every version.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

from vsense.base.xml.element import Element, shown
from vsense.config import argos
from vsense.config._things import MAX_SIZE_M, THINGS
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
        """Whether another trial may give other numbers."""
        return self.method in ("uniform", "gaussian")

    def sample(self, index: int, draws: random.Random) -> Vector:
        """Draws three numbers; in a grid `index` decides, from 0 among what is drawn together."""
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
        number: place of the `<distribute>` in the arena, from 0: they are drawn in this order.
        line: line of its `<entity>`.
    """

    position_m: Draw
    orientation_rad: Draw
    max_trials: int
    number: int
    line: int


@dataclass(frozen=True, slots=True)
class DistributedSpec:
    """An `entity` of a `<distribute>`, at the arena frame's origin until the seed places it."""

    entity: Entity
    distribution: Distribution
    line: int


MAX_QUANTITY = 10_000
MAX_BASE_NUMBER = 65_535
OBJECT_ELEMENT = "vs:object"

_MAX_TRIALS = 1_000_000
_MAX_LAYOUT = 1000
_KEYS = {
    "uniform": ("min", "max"),
    "gaussian": ("mean", "std_dev"),
    "constant": ("values", None),
    "grid": ("center", "distances"),
}


@dataclass(frozen=True, slots=True)
class DistributedCrowd:
    """Several of a kind whose places are drawn.

    `entity` is the `<entity>` around them, `element` what there are several of, `first` the number
    of the first one; `untagged`: the entity's tags are not theirs.
    """

    entity: Element
    element: Element
    quantity: int
    first: int
    distribution: Distribution
    untagged: bool = False

    @property
    def numbers(self) -> range:
        return range(self.first, self.first + self.quantity)


def read_distribute(element: Element, number: int) -> DistributedCrowd | None:
    """Reads a `<distribute>`, the arena's `number`th; None where there is nothing to place."""
    entity = element.child("entity")
    others = argos.others_in(entity)
    inner = entity.children(*argos.ROBOTS, OBJECT_ELEMENT, *THINGS, *others)
    if len(inner) != 1:
        raise entity.error(f"holds {len(inner)} known elements, expected one, such as <e-puck>")
    if inner[0].name in others:
        element.leave_out(f"of its <{inner[0].name}>: {others[inner[0].name]}")
        return None
    least = 0 if entity.document.lenient else 1
    quantity = entity.integer("quantity", least, MAX_QUANTITY)
    if quantity == 0:
        element.leave_out("quantity is 0: nothing is placed")
        return None
    position = _read_draw(element.child("position"), MAX_SIZE_M, "m", 1.0, quantity)
    turn = _read_draw(element.child("orientation"), 3600.0, "deg", math.radians(1.0), quantity)
    trials = entity.integer("max_trials", 1, _MAX_TRIALS)
    if any((*turn.first[1:], *turn.second[1:])) and inner[0].name != "light":
        element.child("orientation").warn("turns about y and x do not count: things stand upright")
    return DistributedCrowd(
        entity,
        inner[0],
        quantity,
        entity.integer("base_num", 0, MAX_BASE_NUMBER - MAX_QUANTITY, 0),
        Distribution(position, turn, trials, number, entity.line),
    )


def warn_of_height(element: Element, draw: Draw) -> None:
    """Warns where a draw may lift what stands on the floor."""
    if draw.first[2] != 0.0 or (draw.method != "constant" and draw.second[2] != 0.0):
        element.child("position").warn("z does not count: these stand on the floor")


def _read_draw(element: Element, bound: float, unit: str, scale: float, quantity: int) -> Draw:
    method = element.choice("method", tuple(_KEYS))
    first_key, second_key = _KEYS[method]
    first = element.vector(first_key, -bound, bound, unit)
    second = first
    if second_key is not None:
        second = element.vector(second_key, -bound, bound, unit)
        least = first if method == "uniform" else (0.0, 0.0, 0.0)
        if any(b < a for a, b in zip(least, second, strict=True)):
            floor = "'min'" if method == "uniform" else "0"
            raise element.error(f"has a number below {floor}", second_key)
    layout = _read_layout(element, quantity) if method == "grid" else (1, 1, 1)
    return Draw(method, _scaled(first, scale), _scaled(second, scale), layout)


def _read_layout(element: Element, quantity: int) -> tuple[int, int, int]:
    text = element.text("layout", None, "three whole numbers 'x,y,z'")
    counts = element.integers("layout", 1, _MAX_LAYOUT)
    if len(counts) != 3:
        raise element.error(f"{shown(text)} is not three whole numbers with commas", "layout")
    columns, rows, layers = counts
    places = columns * rows * layers
    if places < quantity:
        message = f"has {places} places, expected at least quantity, {quantity}"
        raise element.error(message, "layout")
    return columns, rows, layers


def _scaled(vector: Vector, scale: float) -> Vector:
    x, y, z = (scale * number for number in vector)
    return x, y, z
