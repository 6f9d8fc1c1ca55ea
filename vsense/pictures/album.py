"""What a run leaves for its picture: the measures of every timestep, the world at a few moments."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsense.config.specs import Experiment
from vsense.pictures.painting import WorldSnapshot, paint
from vsense.world.world import World

SPARE = 3
"""The very last timestep before a moment may be one that the host missed."""


class RunSamples:
    """Filled timestep by timestep while a run goes on.

    Attributes:
        moment: the run's timestep at whose end the first view is taken: the wind's turn, or
            half-time; None for a run without length.
        kept: timesteps of the run whose pictures are worth keeping for that view.
        paintings: the world at some timesteps of the run.
        shares: how much was left of the first pollutant source, at every timestep looked at.
    """

    def __init__(self, experiment: Experiment) -> None:
        """An empty album of an experiment."""
        self._experiment = experiment
        turns = [source.turn_timestep for source in experiment.sources[:1]]
        self.moment = next((turn for turn in turns if turn), experiment.timesteps // 2) or None
        self.kept = range(
            0 if self.moment is None else max(self.moment - SPARE, 0), self.moment or 0
        )
        self.paintings: dict[int, WorldSnapshot] = {}
        self.shares: list[float] = []
        self._timesteps: list[int] = []
        self._results: list[dict[str, float]] = []

    def look(self, run_timestep: int, world: World) -> None:
        """Takes down a timestep of the run, after the world has lived it."""
        self._timesteps.append(run_timestep)
        self._results.append(dict(world.results))
        sources = self._experiment.sources
        self.shares.append(world.stock.share(sources[0]) if sources else 1.0)
        if run_timestep in self.kept:
            self.paintings[run_timestep] = paint(world, self._experiment)

    def end(self, world: World) -> None:
        """Takes down what the world looks like after the last timestep."""
        if self._timesteps:
            self.paintings[self._timesteps[-1]] = paint(world, self._experiment)

    def measures(self) -> dict[str, NDArray[np.float64]]:
        """The results over time, (n,) each, for every timestep looked at.

        One that came late is 0 before; what never changes says nothing over time and is left out.
        """
        names = dict.fromkeys(name for results in self._results for name in results)
        series = {
            name: np.array([results.get(name, 0.0) for results in self._results]) for name in names
        }
        return {name: values for name, values in series.items() if np.ptp(values) > 0.0}
