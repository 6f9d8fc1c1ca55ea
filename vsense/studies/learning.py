"""Learning in simulation: an experiment as a parallel environment of PettingZoo.

    env = vsense.parallel_env("foraging", duration_s=60, reward="items_home")
    observations, infos = env.reset(seed=1)
    while env.agents:
        actions = {agent: policy(observations[agent]) for agent in env.agents}
        observations, rewards, terminations, truncations, infos = env.step(actions)

An agent is a robot, `robot_31`. It observes what its controller would read, and a step is a control
step. The environment is the simulation of `vsense sim`, without the experiment's controller.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from vsense.base.errors import require
from vsense.modes.sim.stepping import Reward
from vsense.studies.notebook import Setting, load_experiment

if TYPE_CHECKING:
    from vsense.studies._parallel import SwarmEnvironment

def parallel_env(
    experiment: str | Path,
    settings: Mapping[str, Setting] | None = None,
    robots: int | None = None,
    duration_s: float | None = None,
    reward: str | Reward | None = None,
    actuators: Mapping[str, tuple[float, float]] | None = None,
    leds: bool = False,
    render_mode: str | None = None,
) -> SwarmEnvironment:
    """Makes an environment; see `vsense.load` for the first four.

    Observations are float32, sensor after sensor in the order of the file, then the robot's own
    ring where the file has `<epuck_proximity>`: the numbers that a controller reads, 0 where they
    are not known yet. Actions are in -1..1: left and right wheel, 1 is 1000 steps/s (12.9 cm/s);
    then one for each of `actuators`; then one for the LEDs, which are on where it is above 0.

    Args:
        reward: name of a measure of the experiment, whose increase in a step every robot is given;
            or a function. None: the experiment's first measure.
        actuators: virtual actuators by name, and what -1 and 1 stand for of their first number.
        leds: robots have red LEDs to switch.
        render_mode: "rgb_array", "human" (a window, extra `report`), or None.

    Raises:
        UsageError: PettingZoo is not installed (extra `learn`); the experiment has several
            controllers; there is no such measure or actuator.
        VsenseError: as `vsense.load`.
    """
    require("parallel_env() needs", "pettingzoo")
    from vsense.studies._parallel import SwarmEnvironment

    loaded = load_experiment(experiment, settings, robots, duration_s).experiment
    return SwarmEnvironment(loaded, reward, dict(actuators or {}), leds, render_mode)
