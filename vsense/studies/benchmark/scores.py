"""A run's measures, computed anew from its recording: the mission over the recorded poses.

Nothing is believed but where robots were: the world of the mission is made from the definition's
own files, moved and measured with the recorded arena states. What robots sensed, and what they did
to the world, plays no part in the measures of these missions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from vsense.config.specs import Experiment
from vsense.monitor.recording import form
from vsense.monitor.recording.form import RecordingError
from vsense.monitor.recording.reader import Recording
from vsense.monitor.recording.resense import arena_state
from vsense.run.environment import Environment


def recount(recording: Recording, experiment: Experiment, seed: int) -> dict[str, float]:
    """The measures at the run's end, by name.

    Args:
        recording: of the run, from its beginning.
        experiment: the mission's, with everything at the run's start.
        seed: the run's own.

    Raises:
        RecordingError: it is not of this run, or not all of it is there.
        VsenseError: the mission's loop functions have failed.
    """
    path = recording.path
    environment: Environment | None = None
    lived = -1
    try:
        for message in recording.messages({"/experiment", "/arena", form.ORDERS}):
            if message.topic == form.ORDERS:
                raise RecordingError(f"{path}: somebody changed the world while the run went on")
            if message.topic == "/experiment":
                environment = environment or _made(recording, message.data, experiment, seed)
            elif environment is not None and lived + 1 < experiment.timesteps:
                lived = _step(environment, message.data, lived)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise RecordingError(f"{path}: cannot be counted again: {error!r}") from None
    if environment is None or lived < 0:
        raise RecordingError(f"{path}: holds no run")
    return environment.end()


def _made(
    recording: Recording, told: Mapping[str, Any], experiment: Experiment, seed: int
) -> Environment:
    """The mission's world before its first timestep, with the robots that played."""
    tags = [int(robot["tag"]) for robot in told["robots"]]
    if told["seed"] != seed or len(tags) != len(experiment.robots):
        raise RecordingError(
            f"{recording.path}: is of {len(tags)} robots and seed {told['seed']}, expected"
            f" {len(experiment.robots)} and {seed}"
        )
    robots = tuple(replace(robot, tag=tag) for robot, tag in zip(experiment.robots, tags))
    return Environment(replace(experiment, robots=robots), seed)


def _step(environment: Environment, data: Mapping[str, Any], lived: int) -> int:
    """Lives a recorded timestep, and gives the newest one of the run."""
    run_timestep: int = data["run_timestep"]
    environment.world.update(arena_state(data), run_timestep)
    if run_timestep <= lived:
        return lived
    environment.pre_step()
    environment.act({})
    environment.post_step()
    return run_timestep
