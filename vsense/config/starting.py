"""Where a run begins, whatever its own seed is: a draw of its own, or poses that somebody wrote.

So runs of several conditions begin alike, and repetitions of one differ in all else that is drawn.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from vsense.base.errors import UsageError
from vsense.config.placement import overlapping, settle
from vsense.config.specs import Experiment, Pose


@dataclass(frozen=True, slots=True)
class StartPlaces:
    """The places of everything that moves or is distributed when a run begins.

    Attributes:
        seed: decides the places of all that is distributed.
        poses: of the robots, in the file's order: x_m, y_m, yaw_rad; (): as the file says.
    """

    seed: int
    poses: tuple[tuple[float, float, float], ...] = ()

    def put(self, experiment: Experiment) -> Experiment:
        """Gives the robots their poses; what is distributed is not placed yet.

        Raises:
            UsageError: there are not as many poses as robots, or two bodies overlap.
        """
        if not self.poses:
            return experiment
        robots = experiment.robots
        if len(self.poses) != len(robots):
            raise UsageError(f"{len(self.poses)} poses: {experiment.file} has {len(robots)} robots")
        placed = tuple(
            replace(robot, pose=Pose(*pose), distribution=None)
            for robot, pose in zip(robots, self.poses)
        )
        found = replace(experiment, robots=placed)
        if displaced := overlapping(found):
            robot, what = displaced[0]
            raise UsageError(f"the pose of {robot.id!r} overlaps with {what}")
        return found

    def settled(self, experiment: Experiment, real: bool = True) -> Experiment:
        """Gives everything its place; for `real` see `settle`.

        Raises:
            UsageError: as `put`.
            ConfigError: as `settle`.
        """
        return settle(self.put(experiment), self.seed, real)

    @classmethod
    def read(cls, data: Mapping[str, Any]) -> StartPlaces:
        """Reads what `dataclasses.asdict` made of one, also from JSON."""
        return cls(int(data["seed"]), tuple(tuple(pose) for pose in data.get("poses", ())))
