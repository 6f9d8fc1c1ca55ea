"""What an experiment file says, as frozen records: lengths in m, angles in rad, arena frame.

Every record that comes from one element carries the line it stood in, so that a fault which
shows only later (a body that does not fit, a controller that does not build) is still reported
at its place: `Experiment.error(line, message)`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from vsense.errors import ConfigError
from vsense.sensors.base import MountedSensor
from vsense.world.pollution import PollutantSource

BODY_RADIUS_M = 0.035
"""Radius of an e-puck's body, and of every tagged object. Source: argos3-epuck."""

Vector = tuple[float, float, float]


class Pose(NamedTuple):
    """Where a body stands: middle of its base, and its heading."""

    x_m: float
    y_m: float
    yaw_rad: float


@dataclass(frozen=True, slots=True)
class Arena:
    """The box that everything stands in.

    Attributes:
        size_m: extent along x, y, z.
        centre_m: its middle.
    """

    size_m: Vector
    centre_m: Vector

    def contains(self, x_m: float, y_m: float, margin_m: float = 0.0) -> bool:
        """Tells whether a point lies inside, at least margin_m from the border."""
        return (
            abs(x_m - self.centre_m[0]) <= self.size_m[0] / 2.0 - margin_m
            and abs(y_m - self.centre_m[1]) <= self.size_m[1] / 2.0 - margin_m
        )


@dataclass(frozen=True, slots=True)
class Box:
    """A box that stands in the real arena.

    Attributes:
        id: its name.
        position_m: middle of its base.
        size_m: extent along its own x, y, z.
        yaw_rad: its turn about z.
        line: line of its element.
    """

    id: str
    position_m: Vector
    size_m: Vector
    yaw_rad: float
    line: int


@dataclass(frozen=True, slots=True)
class Draw:
    """How a `<distribute>` draws three numbers.

    Attributes:
        method: "uniform" (between two corners), "gaussian" (mean and standard deviation) or
            "constant" (the first of the two, always).
        first: lower corner, mean, or the values.
        second: upper corner, or standard deviation.
    """

    method: str
    first: Vector
    second: Vector


@dataclass(frozen=True, slots=True)
class Distribution:
    """Where the bodies of one `<distribute>` may start.

    Attributes:
        position_m: x, y, z; z does not count.
        orientation_rad: turns about z, y, x; only the first counts.
        max_trials: draws per body before giving up.
        line: line of its `<entity>`.
    """

    position_m: Draw
    orientation_rad: Draw
    max_trials: int
    line: int


@dataclass(frozen=True, slots=True)
class RobotSpec:
    """A robot of the experiment.

    Attributes:
        id: NAME_TAG_ROBOT.
        tag: number on its marker.
        number: the last part of its id; the original's last octet of the robot's address.
        pose: start pose, or None where it is distributed.
        distribution: how its start pose is drawn, or None.
        line: line of its element.
    """

    id: str
    tag: int
    number: int
    pose: Pose | None
    distribution: Distribution | None
    line: int


@dataclass(frozen=True, slots=True)
class ObjectSpec:
    """A thing with a marker on it that is no robot, such as the polluter.

    Attributes:
        id: NAME_TAG_NUMBER.
        tag: number on its marker.
        pose: where it stands at the start.
        line: line of its element.
    """

    id: str
    tag: int
    pose: Pose
    line: int


@dataclass(frozen=True, slots=True)
class ControllerSpec:
    """What drives the robots.

    Attributes:
        id: its name in the file.
        library: a shipped controller's name, or the path of a C source.
        params: the user's own settings, passed on as they are.
        line: line of its element.
    """

    id: str
    library: str
    params: Mapping[str, str]
    line: int

    @property
    def params_text(self) -> str:
        """The settings as robots are told them: lines "key=value\\n"."""
        return "".join(f"{key}={value}\n" for key, value in self.params.items())


@dataclass(frozen=True, slots=True)
class MarkerSpec:
    """The markers on robots and objects.

    Attributes:
        family: name of the marker family.
        height_m: height of the markers above the floor.
        line: line of its element; of the root where it is absent.
    """

    family: str
    height_m: float
    line: int


@dataclass(frozen=True, slots=True)
class Experiment:
    """A checked experiment file.

    Attributes:
        name: the file's name without ending.
        file: the file as errors call it.
        path: where it lies; relative paths in it are taken from its folder.
        length_s: length of the run; 0: no limit. To change it, give it to `load`: the wind's
            turn may be a share of it.
        ticks_per_second: timesteps in one second.
        seed: seed of everything that is drawn; 0: the caller takes one from the clock.
        host: IPv4 address of the virtual sensor server, in numbers, as the robots are told.
        port: its port.
        arena: the arena.
        boxes: boxes in the real arena.
        robots: the robots, in the file's order.
        objects: tagged things that are no robots.
        marker: the markers.
        controller: what drives all robots.
        sensors: their virtual sensors, in the file's order.
        sources: what pollutes.
        warnings: what is passed over: `file:line: what happens instead`.
    """

    name: str
    file: str
    path: Path
    length_s: float
    ticks_per_second: int
    seed: int
    host: str
    port: int
    arena: Arena
    boxes: tuple[Box, ...]
    robots: tuple[RobotSpec, ...]
    objects: tuple[ObjectSpec, ...]
    marker: MarkerSpec
    controller: ControllerSpec
    sensors: tuple[MountedSensor, ...]
    sources: tuple[PollutantSource, ...]
    warnings: tuple[str, ...]

    @property
    def timestep_s(self) -> float:
        """Length of a timestep."""
        return 1.0 / self.ticks_per_second

    @property
    def timesteps(self) -> int:
        """Timesteps of the run; 0: no limit."""
        return round(self.length_s * self.ticks_per_second)

    def error(self, line: int, message: str) -> ConfigError:
        """Makes the error that something in the file cannot be had."""
        return ConfigError(self.file, line, message)
