"""Samples of a run for its picture: the virtual world at a few moments, and the measures."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from vsense.config.specs import Experiment
from vsense.monitor.pictures._world_snapshot import WorldSnapshot, take_snapshot
from vsense.world.world import World

SPARE_TIMESTEPS = 3
"""Timesteps kept before a moment, where the host may miss the very last one."""


class RunSamples:
    """Filled timestep by timestep during a run.

    Attributes:
        moment: The run's timestep at whose end the first view is taken: the wind's turn, or
            half-time; None for a run without length.
        timesteps: Those of the run whose pictures are kept for that view.
        snapshots: The world at some timesteps of the run.
        shares: What was left of the first pollutant source, at every sampled timestep.
    """

    def __init__(self, experiment: Experiment, spare: int = SPARE_TIMESTEPS) -> None:
        self._experiment = experiment
        self.moment = experiment.turn_timestep or experiment.timesteps // 2 or None
        self.timesteps = range(
            0 if self.moment is None else max(self.moment - spare, 0), self.moment or 0
        )
        self.snapshots: dict[int, WorldSnapshot] = {}
        self.shares = array("d")
        self._last: int | None = None
        self._series: dict[str, array[float]] = {}

    def add(self, run_timestep: int, world: World) -> None:
        """Samples a timestep of the run, after the world has been updated."""
        self._last = run_timestep
        for name in world.results:
            # A result is 0 before its first value.
            self._series.setdefault(name, array("d", bytes(8 * len(self.shares))))
        for name, series in self._series.items():
            series.append(world.results.get(name, 0.0))
        source = self._experiment.source
        self.shares.append(1.0 if source is None else world.stock.share(source))
        if run_timestep in self.timesteps:
            self.snapshots[run_timestep] = take_snapshot(world, self._experiment)

    def thin(self, stay: Sequence[bool]) -> None:
        """Forgets the sampled timesteps that shall not stay."""
        self.shares = array("d", compress(self.shares, stay))
        for name, series in self._series.items():
            self._series[name] = array("d", compress(series, stay))

    def end(self, world: World) -> None:
        """Samples the world after the last timestep."""
        if self._last is not None:
            self.snapshots[self._last] = take_snapshot(world, self._experiment)

    def measures(self) -> dict[str, NDArray[np.float64]]:
        """The results over time, (n,) each, for every sampled timestep.

        A result is 0 before its first value; constant ones are left out.
        """
        series = {name: np.array(values) for name, values in self._series.items()}
        return {name: values for name, values in series.items() if np.ptp(values) > 0.0}
