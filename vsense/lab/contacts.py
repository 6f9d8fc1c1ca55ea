"""Who is near whom in the lab, who touches, and how far everybody must give way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsense.config.specs import BODY_RADIUS_M as BODY_RADIUS_M

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

_REACH_M = 0.11
"""Farthest thing a robot can feel from its centre: 36 mm sensor ring and 70 mm of infrared."""
_SKIN_M = 0.02
"""Extra reach of the cached pairs, so that they hold until somebody has moved half of it."""
_MARGIN_M = 0.004
"""Gaps up to here take part in the solution: more than two robots can close in one tick."""
_TOLERANCE_M = 1e-5
"""Overlap, or needless gap, that a solution may leave."""
_MAX_ITERATIONS = 100


@dataclass(frozen=True, slots=True)
class Boxes:
    """Rectangular obstacles that stand on the floor and never move.

    Attributes:
        centre_m: (b, 2) centres, arena frame.
        axis: (b, 2) cosine and sine of each box's yaw.
        half_m: (b, 2) half of each box's extent along its own axes.
    """

    centre_m: Floats
    axis: Floats
    half_m: Floats

    @classmethod
    def from_rows(cls, rows: ArrayLike) -> Boxes:
        """Boxes of rows (b, 5): x_m, y_m, yaw_rad, size_x_m, size_y_m, arena frame."""
        table = np.asarray(rows, dtype=np.float64).reshape(-1, 5)
        axis = np.stack([np.cos(table[:, 2]), np.sin(table[:, 2])], axis=1)
        return cls(table[:, :2].copy(), axis, table[:, 3:] / 2)

    def gaps(self, points_m: Floats, box: Indices) -> tuple[Floats, Floats]:
        """Signed distance of each point to the surface of its box, and the way out.

        Args:
            points_m: (q, 2) points, arena frame.
            box: (q,) which box each point is measured against.

        Returns:
            (q,) distances in m, negative inside; (q, 2) outward unit normals, arena frame.
        """
        local = to_box_frame(points_m - self.centre_m[box], self.axis[box])
        side = np.where(local < 0, -1.0, 1.0)
        beyond = np.abs(local) - self.half_m[box]
        outside = np.maximum(beyond, 0.0)
        distance = np.hypot(outside[:, 0], outside[:, 1])
        inside = distance == 0.0
        x_is_nearer = beyond[:, 0] > beyond[:, 1]
        shortest = np.stack([x_is_nearer, ~x_is_nearer], axis=1)
        way = np.where(inside[:, None], shortest, outside) * side
        length = np.where(inside, 1.0, distance)
        normal = from_box_frame(way / length[:, None], self.axis[box])
        return np.where(inside, beyond.max(axis=1, initial=-np.inf), distance), normal


def to_box_frame(vectors: Floats, axis: Floats) -> Floats:
    """Vectors (q, 2) of the arena frame as seen along box axes (q, 2) of cosines and sines."""
    x, y, c, s = vectors[:, 0], vectors[:, 1], axis[:, 0], axis[:, 1]
    return np.stack([x * c + y * s, y * c - x * s], axis=1)


def from_box_frame(vectors: Floats, axis: Floats) -> Floats:
    """Vectors (q, 2) along box axes (q, 2) of cosines and sines, back in the arena frame."""
    x, y, c, s = vectors[:, 0], vectors[:, 1], axis[:, 0], axis[:, 1]
    return np.stack([x * c - y * s, x * s + y * c], axis=1)


class Neighbourhood:
    """The pairs that are near enough to touch or to be felt.

    They are searched for again only when somebody has moved far enough to matter, so most
    ticks pay nothing for them.

    Attributes:
        robots: how many of the bodies can feel and give way: the first ones.
        boxes: what stands around.
        robot, body: (p,) every robot with every other body near it, sorted by robot.
        box_robot, box: (q,) every robot with every box near it, sorted by robot.
    """

    def __init__(self, robots: int, boxes: Boxes) -> None:
        """A neighbourhood without pairs yet, of the first `robots` bodies and `boxes`."""
        self.boxes = boxes
        self.robots = robots
        self._searched_at: Floats | None = None
        self.robot = self.body = self.box_robot = self.box = np.zeros(0, dtype=np.intp)

    def update(self, positions_m: Floats) -> None:
        """Makes the pairs hold for `positions_m` (n, 2), robots first, arena frame."""
        last = self._searched_at
        if last is not None and np.abs(positions_m - last).max() < _SKIN_M / 2 / np.sqrt(2):
            return
        self._searched_at = positions_m.copy()
        robots = positions_m[: self.robots]
        apart = np.hypot(*(robots[:, None] - positions_m[None]).transpose(2, 0, 1))
        near = apart < _REACH_M + BODY_RADIUS_M + _SKIN_M
        np.fill_diagonal(near, False)
        self.robot, self.body = np.nonzero(near)
        count = len(self.boxes.half_m)
        robot = np.repeat(np.arange(self.robots), count)
        box = np.tile(np.arange(count), self.robots)
        close = self.boxes.gaps(robots[robot], box)[0] < _REACH_M + _SKIN_M / 2
        self.box_robot, self.box = robot[close], box[close]


class Contacts:
    """Moves overlapping bodies apart by the least possible displacement.

    Of all displacements that leave no overlap, the one with the smallest sum of squares, each
    weighted by 1 / mobility, is taken: contacts push and never pull, a chain of robots carries
    a push on, and who is hard to move gives way less. This is a linear complementarity problem
    in the pushes of the contacts; it starts from the pushes of the tick before, because bodies
    that lean on each other keep doing so.
    """

    def __init__(self, mobility: Floats, near: Neighbourhood) -> None:
        """Contacts of the bodies in `near`.

        Args:
            mobility: (n,) how readily each body gives way, 0 for what cannot move; the caller
                may change it between ticks.
            near: who is near whom.
        """
        self._mobility = mobility
        self._near = near
        self._pushes_m = np.zeros((len(mobility), len(mobility) + len(near.boxes.half_m)))

    def separate(self, positions_m: Floats) -> None:
        """Moves the bodies (n, 2) apart, in place, arena frame."""
        self._near.update(positions_m)
        gap, first, other, normal = self._touching(positions_m)
        bodies = len(positions_m)
        before = self._pushes_m[first, other]
        self._pushes_m[:] = 0.0
        if not len(gap) or gap.min() >= 0.0:
            return
        rows = np.arange(len(gap))
        ways = np.zeros((len(gap), bodies + 1, 2))
        ways[rows, first] = normal
        ways[rows, np.minimum(other, bodies)] = -normal
        jacobian = ways[:, :bodies].reshape(len(gap), -1)
        yielding = jacobian * np.repeat(self._mobility, 2)
        push = _least_push(yielding @ jacobian.T, gap, before)
        self._pushes_m[first, other] = push
        positions_m += (push @ yielding).reshape(-1, 2)

    def _touching(self, positions_m: Floats) -> tuple[Floats, Indices, Indices, Floats]:
        """What may touch in this tick.

        Returns:
            (c,) gaps in m; (c,) the robots; (c,) the other bodies, or n + the box; (c, 2) unit
            normals towards the robot.
        """
        near = self._near
        once = near.robot < near.body
        robot, body = near.robot[once], near.body[once]
        between = positions_m[robot] - positions_m[body]
        apart = np.hypot(between[:, 0], between[:, 1])
        on_top = apart == 0.0
        between[on_top] = (1.0, 0.0)
        normal = between / np.where(on_top, 1.0, apart)[:, None]
        to_box, from_box = near.boxes.gaps(positions_m[near.box_robot], near.box)
        gap = np.concatenate([apart - 2 * BODY_RADIUS_M, to_box - BODY_RADIUS_M])
        close = gap < _MARGIN_M
        return (
            gap[close],
            np.concatenate([robot, near.box_robot])[close],
            np.concatenate([body, near.box + len(positions_m)])[close],
            np.concatenate([normal, from_box])[close],
        )


def _least_push(coupling: Floats, gap: Floats, guess: Floats) -> Floats:
    """The smallest pushes (c,) >= 0 with gap + coupling @ push >= 0, and 0 where that is > 0.

    Accelerated projected gradient with restarts. Source: Y. Nesterov, "A method for solving
    the convex programming problem with convergence rate O(1/k^2)", 1983; restarts: B.
    O'Donoghue and E. Candes, "Adaptive restart for accelerated gradient schemes", 2015.

    Args:
        coupling: (c, c) how far a push on one contact opens another, symmetric, semidefinite.
        gap: (c,) gaps before any push in m, negative where bodies overlap.
        guess: (c,) pushes to start from, >= 0.
    """
    step = 1.0 / np.abs(coupling).sum(axis=1).max()
    coupling, gap = coupling * step, gap * step
    push = ahead = guess
    momentum = 1.0
    for _ in range(_MAX_ITERATIONS):
        better = np.maximum(ahead - (coupling @ ahead + gap), 0.0)
        correction = better - ahead
        if np.abs(correction).max() < _TOLERANCE_M * step:
            return better
        change = better - push
        if correction @ change < 0.0:
            momentum = 1.0
        faster = 0.5 + (0.25 + momentum * momentum) ** 0.5
        ahead = better + ((momentum - 1.0) / faster) * change
        push, momentum = better, faster
    return push
