"""Pollution that a source in the arena gives off: the cone of the thesis, as plane geometry.

All functions take and give the arena frame: metres, angles counter-clockwise from +x.
Source: thesis 4.2.3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsense.base.arena import Floats, from_sides_m, wrap_angle

DEFAULT_MEMORY_NS = 5_000_000_000
"""How long the cone of a source that is not seen stays where the source was seen last."""


@dataclass(frozen=True, slots=True)
class Cone:
    """The polluted triangle: apex at the source, opening towards the wind's direction.

    The thesis calls it a cone and tests for a triangle: both far corners lie `max_distance_m`
    from the apex, so along its axis it ends at max_distance_m * cos(wide_rad / 2).

    Attributes:
        x_m, y_m: the apex.
        direction_rad: direction of the axis, in (-pi, pi].
        wide_rad: opening angle, in (0, pi).
    """

    x_m: float
    y_m: float
    direction_rad: float
    wide_rad: float
    max_distance_m: float

    def vertices(self) -> Floats:
        """The corners, (3, 2), counter-clockwise from the apex."""
        angles = self.direction_rad + self.wide_rad / 2.0 * np.array([-1.0, 1.0])
        far = self.max_distance_m * np.stack((np.cos(angles), np.sin(angles)), axis=-1)
        apex = np.array([[self.x_m, self.y_m]])
        return np.concatenate((apex, apex + far))

    def contains(self, points_m: ArrayLike) -> NDArray[np.bool_]:
        """Which points (..., 2) are polluted; apex and edges are.

        The thesis asks for barycentric coordinates within [0, 1]. Each of the three is the distance
        to one side up to a positive factor. These distances are compared here: in the cone's own
        frame they need no determinant and are exactly 0 at the apex.
        """
        along, across = self._local(points_m)
        cosine, sine = math.cos(self.wide_rad / 2.0), math.sin(self.wide_rad / 2.0)
        beside = np.abs(across) * cosine - along * sine
        return np.asarray((beside <= 0.0) & (along <= self.max_distance_m * cosine))

    def edge_distance(self, points_m: ArrayLike) -> Floats:
        """Distances (...) of points (..., 2) to the triangle's edge [m], negative inside."""
        distance, _ = from_sides_m(self.vertices(), points_m)
        return np.asarray(np.where(self.contains(points_m), -distance, distance))

    def _local(self, points_m: ArrayLike) -> tuple[Floats, Floats]:
        """Points along the axis and across it (left positive), seen from the apex."""
        points = np.asarray(points_m, dtype=np.float64)
        x, y = points[..., 0] - self.x_m, points[..., 1] - self.y_m
        cosine, sine = math.cos(self.direction_rad), math.sin(self.direction_rad)
        return x * cosine + y * sine, y * cosine - x * sine


@dataclass(frozen=True, slots=True)
class PollutantSource:
    """A tagged thing that pollutes downwind of where the cameras see it; see `Cone`.

    Attributes:
        direction_rad: where the wind blows to at the start.
        turn_timestep: first timestep of the run with the turned wind; None: it never turns.
        turn_rad: by how much it turns, counter-clockwise.
        memory_ns: how old the source's last sighting may be; then its cone ends.
        amount: how much it pollutes in all, before it is cleaned; inf: it cannot be cleaned.
    """

    tag: int
    direction_rad: float
    wide_rad: float
    max_distance_m: float
    turn_timestep: int | None = None
    turn_rad: float = 0.0
    memory_ns: int = DEFAULT_MEMORY_NS
    amount: float = math.inf

    def cone_at(self, x_m: float, y_m: float, run_timestep: int, share: float = 1.0) -> Cone:
        """The cone of a source that stands at (x_m, y_m) in a timestep of the run.

        `share`, above 0, is how much of its amount is left: the polluted area shrinks with it, so
        the reach with its root.
        """
        turned = self.turn_timestep is not None and run_timestep >= self.turn_timestep
        direction = float(wrap_angle(self.direction_rad + (self.turn_rad if turned else 0.0)))
        reach_m = self.max_distance_m * math.sqrt(share)
        return Cone(x_m, y_m, direction, self.wide_rad, reach_m)


class Stock:
    """What is left of every source's pollution in a run."""

    def __init__(self) -> None:
        self._cleaned: dict[PollutantSource, float] = {}

    def share(self, source: PollutantSource) -> float:
        """Which share of a source is left, 0..1; 1 for one that cannot be cleaned."""
        return 1.0 - self._cleaned.get(source, 0.0) / source.amount

    def clean(self, source: PollutantSource, amount: float) -> float:
        """Takes an amount, 0 or more, as far as there is one; returns how much was taken."""
        before = self._cleaned.get(source, 0.0)
        self._cleaned[source] = min(before + amount, source.amount)
        return self._cleaned[source] - before
