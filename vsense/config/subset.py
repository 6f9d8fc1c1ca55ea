"""A smaller swarm than an experiment's file says."""

from __future__ import annotations

from dataclasses import replace

from vsense.config.specs import Experiment
from vsense.errors import UsageError


def first_robots(experiment: Experiment, count: int | None) -> Experiment:
    """Keeps only the first robots of an experiment.

    Args:
        experiment: the experiment.
        count: how many; None: all.

    Raises:
        UsageError: there are not so many, or what pollutes would be left out.
    """
    if count is None:
        return experiment
    if count > len(experiment.robots):
        raise UsageError(f"--robots {count}: {experiment.file} has {len(experiment.robots)}")
    left_out = {robot.tag for robot in experiment.robots[count:]}
    if left_out & {source.tag for source in experiment.sources}:
        raise UsageError(f"--robots {count}: would leave out what pollutes")
    return replace(experiment, robots=experiment.robots[:count])
