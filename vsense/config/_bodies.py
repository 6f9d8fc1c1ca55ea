"""What wears a marker in an experiment: robots, and things that are no robots.

`line` is that of a record's element. Frame and units as in `vsense.config.specs`. A robot's place
is drawn when the experiment is settled, see `vsense.config.placement`; with real robots the cameras
say where it is. How large a body is, its model says, and how high its marker is where the file does
not: `Experiment.marker_height_m`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from vsense.config._distribute import Distribution
from vsense.world.robot_models import EPUCK, RobotModel


class Pose(NamedTuple):
    """Where a body stands: middle of its base, and its heading."""

    x_m: float
    y_m: float
    yaw_rad: float


@dataclass(frozen=True, slots=True)
class RobotSpec:
    """A robot of the experiment, with `tag` on its marker.

    Attributes:
        id: NAME_TAG_ROBOT, or any name where `vs:tag` gives the tag.
        number: the last part of its id (the original's last octet of the robot's address), else
            its place in the file.
        pose: start pose, or None where it is distributed.
        distribution: how its start pose is drawn, or None.
        controller: id of the controller that drives it.
        model: what kind of robot it is.
    """

    id: str
    tag: int
    number: int
    pose: Pose | None
    distribution: Distribution | None
    controller: str
    line: int
    model: RobotModel = EPUCK


@dataclass(frozen=True, slots=True)
class ObjectSpec:
    """A thing with a marker on it that is no robot, such as the polluter; see `RobotSpec`. Its
    model says how large it is."""

    id: str
    tag: int
    pose: Pose | None
    distribution: Distribution | None
    line: int
    model: RobotModel = EPUCK
