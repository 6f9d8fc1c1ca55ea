"""The measures of a run since it began, for pages that open late, reload, or miss timesteps.

Thinned to what a chart can show; of what is thinned the smallest and the largest value stay.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from vsense.monitor.recording.form import Data
from vsense.world.world import World

LEDS_ON = "LEDs on"
"""Is shown in runs in which some robot ever had one on."""
BUCKETS_MAX = 400
"""Buckets of a history; a chart has about as many columns of pixels."""

_Bucket = list[float]
"""The smallest, the largest and the newest value."""


class MeasureHistory:
    """Collects measures by timestep, in buckets of as many timesteps as are needed."""

    def __init__(self) -> None:
        self._width = 1
        self._starts: list[int] = []
        self._columns: dict[str, list[_Bucket | None]] = {}

    def add(self, run_timestep: int, measures: Mapping[str, float]) -> None:
        """Adds the measures of a timestep, which is no earlier than the one before."""
        start = run_timestep - run_timestep % self._width
        if not self._starts or self._starts[-1] != start:
            self._starts.append(start)
            for column in self._columns.values():
                column.append(None)
        for name, value in measures.items():
            column = self._columns.setdefault(name, [None] * len(self._starts))
            bucket = column[-1]
            if bucket is None:
                column[-1] = [value, value, value]
            else:
                bucket[:] = min(bucket[0], value), max(bucket[1], value), value
        if len(self._starts) > BUCKETS_MAX:
            self._thin()

    def _thin(self) -> None:
        """Makes buckets of twice as many timesteps."""
        self._width *= 2
        starts, columns = self._starts, self._columns
        self._starts, self._columns = [], {}
        for row, start in enumerate(starts):
            for edge in range(3):
                parts = {name: column[row] for name, column in columns.items()}
                self.add(start, {name: part[edge] for name, part in parts.items() if part})

    def data(self, run: int, timestep_s: float) -> Data:
        """Gives /history of a run of this number; see `MESSAGES.md`."""
        empty = (None, None, None)
        return {
            "run": run,
            "bucket_s": round(self._width * timestep_s, 9),
            "time_s": [round(start * timestep_s, 6) for start in self._starts],
            "measures": {
                name: dict(zip(("low", "high", "last"), zip(*(b or empty for b in column))))
                for name, column in self._columns.items()
                if name != LEDS_ON or any(bucket and bucket[1] for bucket in column)
            },
        }


def measures_of(world: World, robots: Iterable[int], leds_on: int) -> dict[str, float]:
    """The experiment's own measures, and what the page counts in every experiment.

    Args:
        robots: tags of the robots, which are counted in a polluted cone.
        leds_on: how many robots have a LED on.
    """
    measures = {**world.results, LEDS_ON: leds_on}
    if world.sources:
        rows = world.robots[np.isin(world.robots["tag"], list(robots))]
        places = np.stack((rows["x_m"], rows["y_m"]), axis=-1)
        cones: list[Any] = [cone for source in world.sources if (cone := world.cone(source))]
        inside = [cone.contains(places) for cone in cones] or [np.zeros(len(rows), bool)]
        measures["in the cone"] = int(np.any(inside, axis=0).sum())
    return measures
