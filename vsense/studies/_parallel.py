"""An experiment as a parallel environment of PettingZoo: `vsense.parallel_env`.

An agent is a robot, `robot_31`. It observes what its controller would read, and a step is a control
step. The environment is the simulation of `vsense sim`, without the experiment's controller.
"""

from __future__ import annotations

import math
import operator
import secrets
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from vsense.base.errors import UsageError, instead, require
from vsense.config import policies
from vsense.config.specs import ControllerSpec, Experiment
from vsense.modes.sim.stepping import Reward, SteppedSimulation, stepped_controller
from vsense.robots.python_swarm import Leds, SwarmActuator, SwarmReading
from vsense.run.environment import MOST_SEED

_MOST_STEPS_S = 1000.0
"""What every robot's motors can do. Source: robot/controller.h."""
_RENDER_MODES = ("human", "rgb_array")

Observations = dict[str, NDArray[np.float32]]
Infos = dict[str, dict[str, Any]]


class SwarmEnvironment(ParallelEnv[str, NDArray[np.float32], NDArray[np.float32]]):
    """The robots of one controller, which is left out; see `vsense.parallel_env`.

    Attributes:
        simulation: the present run; None before the first `reset`.
        seed: of the present run, or of the one before; 0: there was none.
    """

    simulation: SteppedSimulation | None
    _window: Any = None

    def __init__(
        self,
        experiment: Experiment,
        reward: str | Reward | None,
        actuators: Mapping[str, tuple[float, float]],
        leds: bool,
        render_mode: str | None,
        controller: str,
    ) -> None:
        """See `vsense.parallel_env`."""
        if render_mode not in (None, *_RENDER_MODES):
            raise UsageError(f"render_mode {render_mode!r}: expected {' or '.join(_RENDER_MODES)}")
        if render_mode == "human":
            require("render_mode 'human' needs", "matplotlib")
        spec = stepped_controller(experiment, controller)
        self.metadata = {
            "name": f"vsense_{experiment.name}_v0",
            "render_modes": [*_RENDER_MODES],
            "render_fps": round(experiment.ticks_per_second),
            "is_parallelizable": True,
        }
        self.render_mode, self.simulation = render_mode, None
        self.agents: list[str] = []
        robots = [robot.tag for robot in experiment.robots if robot.controller == spec.id]
        self.possible_agents = [f"robot_{tag}" for tag in robots]
        self._experiment, self._reward, self.seed = experiment, reward, 0
        self._actuators, self._leds, self._controller = actuators, leds, spec.id
        _check_actuators(actuators, spec)
        bounds = policies.observed(spec)
        self._names = [*bounds]
        low, high = (np.concatenate(edges) for edges in zip(*bounds.values()))
        low, high = np.minimum(low, 0.0), np.maximum(high, 0.0)
        self._wide = 2 + len(actuators) + leds
        actions = Box(-1.0, 1.0, (self._wide,), np.float32)
        observations = Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)
        self.observation_spaces = dict.fromkeys(self.possible_agents, observations)
        self.action_spaces = dict.fromkeys(self.possible_agents, actions)

    def observation_space(self, agent: str) -> Box:
        """What an agent observes."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Box:
        """What an agent may do."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, Infos]:
        """Begins a run, whose seed is `seed`; None: one more than that of the run before.

        The first one without a seed has any, so that environments beside each other, copies too,
        do not see the same.
        """
        self.close()
        if seed is not None:
            self.seed = operator.index(seed) or MOST_SEED
        else:
            self.seed = (self.seed or secrets.randbelow(MOST_SEED)) % MOST_SEED + 1
        draws = self.render_mode is not None
        sim = self.simulation = SteppedSimulation(
            self._experiment, self.seed, draws=draws, controller=self._controller
        )
        self._sensors: list[SwarmReading] = [sim.swarm.sensor(name) for name in self._names]
        self._given: list[SwarmActuator] = [sim.swarm.actuator(name) for name in self._actuators]
        self.agents = self.possible_agents[:]
        self._measure = self._measured(sim)
        self._before = self._value(sim)
        return self._observe(), {agent: {} for agent in self.agents}

    def step(
        self, actions: Mapping[str, NDArray[np.float32]]
    ) -> tuple[Observations, dict[str, float], dict[str, bool], dict[str, bool], Infos]:
        """One control step.

        Raises:
            UsageError: the run is over, `reset` begins the next one; or an action or a reward is
                none.
        """
        sim = self.simulation
        if sim is None or not self.agents:
            raise UsageError("the run is over: reset() begins the next one")
        self._act(sim, np.stack([self._action(actions, agent) for agent in self.agents]))
        sim.step()
        agents, over = self.agents, sim.done
        rewards = self._rewards(sim)
        observed = self._observe()
        infos: Infos = {agent: {} for agent in agents}
        if over:
            infos = {agent: {"measures": dict(sim.results)} for agent in agents}
            self.agents = []
        return (
            observed,
            dict(zip(agents, rewards)),
            dict.fromkeys(agents, over and sim.finished),
            dict.fromkeys(agents, over and not sim.finished),
            infos,
        )

    def state(self) -> NDArray[np.float32]:
        """(3 n,) x, y [m] and yaw [rad] of every robot: what none of them knows."""
        if self.simulation is None:
            raise UsageError("there is no run: reset() begins one")
        return self.simulation.poses.astype(np.float32).reshape(-1)

    def render(self) -> NDArray[np.uint8] | None:
        """(h, w, 3) RGB: the arena from above; with "human" it is shown in a window instead."""
        if self.render_mode is None or self.simulation is None:
            return None
        picture = self.simulation.picture()
        if self.render_mode != "human":
            return picture
        from matplotlib import pyplot

        if self._window is None:
            figure, axes = pyplot.subplots(num=self.metadata["name"], clear=True)
            axes.set_axis_off()
            self._window = figure, axes.imshow(picture)
        figure, image = self._window
        image.set_data(picture)
        figure.canvas.draw_idle()
        figure.canvas.flush_events()
        return None

    def close(self) -> None:
        """Ends the present run."""
        if self.simulation is not None:
            self.simulation.close()
            self.simulation = None
        self.agents = []

    def _action(
        self, actions: Mapping[str, NDArray[np.float32]], agent: str
    ) -> NDArray[np.float64]:
        """(k,) what an agent does; UsageError: nothing, or what is no action."""
        if agent not in actions:
            raise UsageError(f"actions: {agent} has none")
        action = np.asarray(actions[agent], np.float64)
        if action.shape != (self._wide,) or not np.isfinite(action).all():
            expected = f"expected {self._wide} finite numbers"
            raise UsageError(f"actions: {agent} has {actions[agent]!r}; {expected}")
        return action

    def _act(self, sim: SteppedSimulation, actions: NDArray[np.float64]) -> None:
        actions = np.clip(actions, -1.0, 1.0)
        swarm = sim.swarm
        swarm.set_wheels(_MOST_STEPS_S * actions[:, 0], _MOST_STEPS_S * actions[:, 1])
        for column, (actuator, (low, high)) in enumerate(
            zip(self._given, self._actuators.values()), 2
        ):
            actuator.set(low + (high - low) * (actions[:, column] + 1.0) / 2.0)
        if self._leds:
            swarm.set_leds(np.where(actions[:, -1] > 0.0, Leds.RING, 0))

    def _observe(self) -> Observations:
        rows = np.concatenate([sensor.values for sensor in self._sensors], axis=1)
        return dict(zip(self.possible_agents, rows.astype(np.float32)))

    def _measured(self, sim: SteppedSimulation) -> str:
        """The name of the measure that is the reward; "": it is none."""
        if callable(self._reward):
            return ""
        names = list(sim.results)
        if self._reward is None and names:
            return names[0]
        if str(self._reward).removeprefix("-") in names:
            return str(self._reward)
        wrong = "measures nothing" if self._reward is None else f"has no measure {self._reward!r}"
        expected = instead(str(self._reward), names) if names else "give reward=FUNCTION"
        raise UsageError(f"{self._experiment.file}: {wrong}; {expected}")

    def _value(self, sim: SteppedSimulation) -> float:
        value = float(sim.results.get(self._measure.removeprefix("-"), 0.0))
        return -value if self._measure.startswith("-") else value

    def _rewards(self, sim: SteppedSimulation) -> list[float]:
        if callable(self._reward):
            given = np.asarray(self._reward(sim), np.float64)
        else:
            now = self._value(sim)
            given, self._before = np.asarray(now - self._before), now
        rewards: list[float] = np.broadcast_to(given, len(self.possible_agents)).tolist()
        for agent, reward in zip(self.possible_agents, rewards):
            if not math.isfinite(reward):
                raise UsageError(f"reward: {agent} has {reward}; expected a finite number")
        return rewards


def _check_actuators(names: Iterable[str], spec: ControllerSpec) -> None:
    there = [mounted.actuator.name for mounted in spec.actuators]
    for name in names:
        if name not in there:
            raise UsageError(f"there is no virtual actuator {name!r}; {instead(name, there)}")
