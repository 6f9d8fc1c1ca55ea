"""What the lab's robots differ in: wheels, markers put on by hand, infrared and ground sensors.

Each is drawn by its tag and a seed of its own: the robot with a marker is the same one in every
experiment and run, as in a real lab, until another seed buys new robots.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.config.roster_fields import MarkerOffset
from vsense.lab.links import GROUND_RAW
from vsense.physics.motion import AXLE_M, STEP_M
from vsense.physics.proximity_ring import MAX_RAW
from vsense.sensors.ground import AHEAD_M as GROUND_AHEAD_M
from vsense.sensors.ground import LEFT_M as GROUND_LEFT_M

Floats = NDArray[np.float64]

DIAMETER_MM = 1000.0 * STEP_M * 1000.0 / math.pi
"""Of the nominal wheel: 41."""

GROUND_BLACK, GROUND_WHITE = 150.0, 950.0
"""Raw readings of a nominal ground sensor, here: black ink and white paper of the lab."""

MOST_GROUND_RAW = 1023
"""Of the ground sensors' converter."""

_MOST_RATIO = 1.095
"""Of two wheels: what `vsensed` can be told ends at 1.1."""


@dataclass(frozen=True, slots=True)
class HardwareErrors:
    """How far robots may be off, each up to so much both ways; all 0: none is.

    Attributes:
        marker_m, marker_rad: a marker's centre, in any direction, and its heading.
        wheel: each wheel's diameter, and the axle's length, as a share.
        sensor: the gain of each infrared and ground sensor, as a share.
        seed: of the draw.
    """

    marker_m: float = 0.0
    marker_rad: float = 0.0
    wheel: float = 0.0
    sensor: float = 0.0
    seed: int = 0

    @property
    def any(self) -> bool:
        """Whether anything is drawn."""
        return max(self.marker_m, self.marker_rad, self.wheel, self.sensor) > 0.0


@dataclass(frozen=True, slots=True)
class RobotHardware:
    """How one robot is built.

    Attributes:
        left, right: way of a wheel over that of the nominal one.
        axle_m: distance of the wheels.
        infrared: (8,) gain of ps0..ps7.
        ground: (3,) gain of the ground sensors.
    """

    marker: MarkerOffset
    left: float
    right: float
    axle_m: float
    infrared: tuple[float, ...]
    ground: tuple[float, ...]

    @property
    def wheel_diameter_mm(self) -> float:
        """The mean of both wheels."""
        return DIAMETER_MM * (self.left + self.right) / 2.0

    @property
    def wheel_ratio(self) -> float:
        """The right wheel over the left one."""
        return self.right / self.left

    def told(self) -> dict[str, Any]:
        """What reports and recordings say of it, by the roster's names."""
        return {
            "wheel_diameter_mm": round(self.wheel_diameter_mm, 4),
            "wheel_ratio": round(self.wheel_ratio, 6),
            "axle_length_mm": round(1000.0 * self.axle_m, 4),
            "marker": self.marker.values,
            "infrared_gain": [round(gain, 5) for gain in self.infrared],
            "ground_gain": [round(gain, 5) for gain in self.ground],
        }

    def for_physics(self) -> dict[str, Any]:
        """What the lab's physics process is told."""
        told = asdict(self)
        del told["marker"]
        return told


def draw(tag: int, errors: HardwareErrors) -> RobotHardware:
    """Draws the robot with a tag."""
    random = np.random.default_rng([errors.seed, tag, 11])
    # A disc's even distribution; all numbers are always drawn, so that each depends on itself only.
    away_m = errors.marker_m * math.sqrt(random.random())
    bearing_rad = random.uniform(-math.pi, math.pi)
    yaw_rad = errors.marker_rad * random.uniform(-1.0, 1.0)
    left, right, axle = 1.0 + errors.wheel * random.uniform(-1.0, 1.0, 3)
    right = float(np.clip(right, left / _MOST_RATIO, left * _MOST_RATIO))
    gains = 1.0 + errors.sensor * random.uniform(-1.0, 1.0, 11)
    x_m, y_m = away_m * math.cos(bearing_rad), away_m * math.sin(bearing_rad)
    return RobotHardware(
        MarkerOffset(x_m, y_m, float(yaw_rad)),
        float(left),
        right,
        float(AXLE_M * axle),
        tuple(gains[:8].tolist()),
        tuple(gains[8:].tolist()),
    )


def draw_all(tags: Sequence[int], errors: HardwareErrors) -> dict[int, RobotHardware]:
    """Draws the robots with these tags; none where nothing is off."""
    return {tag: draw(tag, errors) for tag in tags} if errors.any else {}


def told_all(robots: Mapping[int, RobotHardware]) -> dict[str, Any]:
    """The truth about all drawn robots, by tag, as JSON holds it."""
    return {str(tag): robot.told() for tag, robot in robots.items()}


@dataclass(frozen=True, slots=True)
class LabRobots:
    """What a lab has beside nominal robots and a plain floor, and what is known of it.

    Attributes:
        hardware: how robots are built, by tag; empty: as they should be.
        patches: squares on the floor, see `vsense.lab.physics_process`.
        markers: by tag, where the tracker takes markers to sit on their robots.
        settings: by tag, what `vsensed` is told that was measured of its robot.
        boards: what follows a base's device in `--base`, such as ",ground".
    """

    hardware: Mapping[int, RobotHardware] = field(default_factory=dict)
    patches: Sequence[Mapping[str, float]] = ()
    markers: Mapping[int, MarkerOffset] = field(default_factory=dict)
    settings: Mapping[int, Mapping[str, str]] = field(default_factory=dict)
    boards: str = ""


NOMINAL = LabRobots()


@dataclass(frozen=True, slots=True)
class BuiltRobots:
    """What the physics process is told of all robots.

    Attributes:
        wheels: (n, 3) as `Physics` takes them.
        infrared: (n, 8) gains of the rings.
        ground: (n, 3) gains of the ground sensors.
    """

    wheels: Floats
    infrared: Floats
    ground: Floats

    @classmethod
    def of(cls, told: Sequence[Mapping[str, Any]]) -> BuiltRobots:
        """Reads `RobotHardware.for_physics` of each; KeyError, TypeError, ValueError if wrong."""
        wheels = [[float(one[name]) for name in ("left", "right", "axle_m")] for one in told]
        return cls(
            np.array(wheels).reshape(-1, 3),
            np.array([one["infrared"] for one in told], dtype=np.float64).reshape(-1, 8),
            np.array([one["ground"] for one in told], dtype=np.float64).reshape(-1, 3),
        )


class RobotSenses:
    """What robots' infrared and ground sensors make of the world, each in its own way."""

    def __init__(self, built: BuiltRobots | None, patches: Floats | None) -> None:
        """`built`: None: all are nominal. `patches` (k, 4): x, y, size [m] of squares, and raw."""
        self._built, self._patches = built, patches

    def infrared(self, raw: NDArray[np.int16]) -> NDArray[np.int16]:
        """The readings (n, 8) of robots from those of nominal ones."""
        if self._built is None:
            return raw
        own = np.rint(raw * self._built.infrared)
        return np.clip(own, 0, MAX_RAW).astype(np.int16)

    def ground(self, poses: Floats) -> NDArray[np.int16] | None:
        """The ground readings (n, 3), left to right, of robots at poses (n, 3).

        None where the floor has no patches: then they are what they always are.
        """
        if self._patches is None:
            return None
        cos, sin = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
        left = np.array(GROUND_LEFT_M)
        x = poses[:, :1] + cos * GROUND_AHEAD_M - sin * left
        y = poses[:, 1:2] + sin * GROUND_AHEAD_M + cos * left
        raw = np.full(x.shape, float(GROUND_RAW))
        for at_x, at_y, size, value in self._patches:
            inside = np.maximum(np.abs(x - at_x), np.abs(y - at_y)) <= size / 2.0
            raw = np.where(inside, value, raw)
        gains = 1.0 if self._built is None else self._built.ground
        return np.clip(np.rint(raw * gains), 0, MOST_GROUND_RAW).astype(np.int16)


def to_markers(poses: Floats, offsets: Floats) -> Floats:
    """Poses (n, 3) of markers from those of their bodies, with offsets (n, 3) in their frames."""
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    moved: Floats = poses.copy()
    moved[:, 0] += cos * offsets[:, 0] - sin * offsets[:, 1]
    moved[:, 1] += sin * offsets[:, 0] + cos * offsets[:, 1]
    moved[:, 2] += offsets[:, 2]
    return moved
