"""Where the robots are expected: what the arena tracker tells the detectors beforehand.

The tracker writes between timesteps, on its own thread; the detectors read meanwhile, on theirs.
What a detector keeps here of a camera's pictures is touched by that camera's thread alone, so the
order of the threads changes nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vsense.arena import ArenaState
from vsense.tracking.camera import Camera

Floats = NDArray[np.float64]

EXPECTED = np.dtype([("tag", "i4"), ("x_m", "f8"), ("y_m", "f8"), ("yaw_rad", "f8"), ("sure", "?")])
"""A robot where it should be now. `sure`: seen so lately that it can be nowhere else, and often
enough to believe its name."""

NEAR_M = 0.03
"""What is farther than this from where a robot is expected is another one: a robot is 0.07 wide."""

_SURE_S = 0.25
_LOST_S = 1.0
_SURE_SIGHTINGS = 2


@dataclass(frozen=True, slots=True)
class SearchPlan:
    """How much of the pictures is searched (thesis, 2.2.1).

    Attributes:
        key_frame_period: Every so many timesteps whole pictures are searched (1: always).
        square_size_m: Side of the square searched around each robot in between, centred where
            it is expected (0.11).
        warm: Fit known robots directly where they are expected, and search only the squares of
            those that do not fit.
    """

    key_frame_period: int = 1
    square_size_m: float = 0.11
    warm: bool = False


@dataclass(slots=True)
class _Known:
    x_m: float
    y_m: float
    yaw_rad: float
    capture_ns: int
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    sightings: int = 1


@dataclass(slots=True)
class Anonymous:
    """Markers of one camera that have no name yet, with what their cells have said so far.

    Attributes:
        places: (n, 2) where they were seen last [m].
        cells: (n, cells) sum of their brightness over the pictures.
        pictures: (n,) how many pictures that were.
        capture_ns: When they were seen last.
    """

    places: Floats
    cells: Floats
    pictures: NDArray[np.int64]
    capture_ns: int


@dataclass(slots=True)
class Whereabouts:
    """The robots' expected poses, and each camera's nameless markers.

    Attributes:
        capture_ns: The timestep's capture time.
        is_key_frame: Whether whole pictures are searched in this timestep.
        expected: EXPECTED, sorted by tag.
        anonymous: By the camera's id.
    """

    plan: SearchPlan = field(default_factory=SearchPlan)
    capture_ns: int = 0
    is_key_frame: bool = True
    expected: NDArray[np.void] = field(default_factory=lambda: np.zeros(0, dtype=EXPECTED))
    anonymous: dict[str, Anonymous] = field(default_factory=dict)
    _known: dict[int, _Known] = field(default_factory=dict)
    _timesteps: int = 0

    def expect(self, capture_ns: int) -> None:
        """Prepares a timestep: robots go on as they moved."""
        self.is_key_frame = self._timesteps % self.plan.key_frame_period == 0
        self._timesteps += 1
        self.capture_ns = capture_ns
        rows = []
        for tag, known in sorted(self._known.items()):
            elapsed = max(1e-9 * (capture_ns - known.capture_ns), 0.0)
            if elapsed < _LOST_S:
                ahead = min(elapsed, _SURE_S)
                vx, vy, turn = (ahead * rate for rate in known.velocity)
                yaw = math.remainder(known.yaw_rad + turn, math.tau)
                sure = elapsed <= _SURE_S and known.sightings >= _SURE_SIGHTINGS
                rows.append((tag, known.x_m + vx, known.y_m + vy, yaw, sure))
        self.expected = np.array(rows, dtype=EXPECTED)

    def learn(self, state: ArenaState) -> None:
        """Takes what the timestep has shown."""
        seen = state.robots[state.robots["seen"]]
        fields = ("tag", "x_m", "y_m", "yaw_rad", "capture_ns")
        for tag, x, y, yaw, capture_ns in zip(*(seen[f].tolist() for f in fields), strict=True):
            now = _Known(x, y, yaw, capture_ns)
            last = self._known.get(tag)
            elapsed = 1e-9 * (capture_ns - last.capture_ns) if last else 0.0
            if last and 0.0 < elapsed < _LOST_S:
                turn = math.remainder(yaw - last.yaw_rad, math.tau)
                now.velocity = (
                    (x - last.x_m) / elapsed,
                    (y - last.y_m) / elapsed,
                    turn / elapsed,
                )
                now.sightings = last.sightings + 1
            self._known[tag] = now

    def in_view(self, camera: Camera, height_m: float) -> NDArray[np.void]:
        """Returns those of `expected` whose middle is in a camera's picture."""
        if len(self.expected) == 0:
            return self.expected
        points = np.empty((len(self.expected), 3))
        points[:, 0], points[:, 1] = self.expected["x_m"], self.expected["y_m"]
        points[:, 2] = height_m
        return self.expected[camera.contains(camera.project(points))]

    def windows(self, camera: Camera, height_m: float, places: Floats) -> NDArray[np.int32]:
        """Returns the squares of a camera's picture around (n, 2) places of the arena.

        Args:
            camera: The camera.
            height_m: Height of the markers above the floor.
            places: x and y [m].

        Returns:
            (n, 4) left, top, right, bottom [px].
        """
        half = 0.5 * self.plan.square_size_m
        corners = np.array([(-half, -half), (half, -half), (half, half), (-half, half)])
        points = np.full((len(places), 4, 3), height_m)
        points[..., :2] = places[:, np.newaxis] + corners
        pixels = camera.project(points)
        low, high = np.floor(pixels.min(axis=1)), np.ceil(pixels.max(axis=1)) + 1.0
        return np.concatenate((low, high), axis=1).astype(np.int32)
