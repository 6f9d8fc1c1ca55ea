"""The measures of a run since it began, for pages that open late, reload, or miss timesteps.

Thinned to what a chart can show; of what is thinned the smallest and the largest value stay.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from vsense.monitor.recording.form import Data
from vsense.world.world import World

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
        old, self._starts = self._starts, []
        columns: dict[str, list[_Bucket | None]] = {name: [] for name in self._columns}
        for row, before in enumerate(old):
            start = before - before % self._width
            joins = bool(self._starts) and self._starts[-1] == start
            if not joins:
                self._starts.append(start)
            for name, column in columns.items():
                bucket = self._columns[name][row]
                column.append(_joined(column.pop(), bucket) if joins else bucket)
        self._columns = columns

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
            },
        }


def _joined(first: _Bucket | None, second: _Bucket | None) -> _Bucket | None:
    if first is None or second is None:
        return first or second
    return [min(first[0], second[0]), max(first[1], second[1]), second[2]]


def measures_of(world: World, robots: Iterable[int], leds_on: int | None) -> dict[str, float]:
    """The experiment's own measures, and what the page counts in every experiment.

    Args:
        robots: tags of the robots, which are counted in a polluted cone.
        leds_on: how many robots have a LED on; None: none ever had.
    """
    measures = dict(world.results)
    if world.sources:
        rows = world.robots[np.isin(world.robots["tag"], list(robots))]
        places = np.stack((rows["x_m"], rows["y_m"]), axis=-1)
        cones: list[Any] = [cone for source in world.sources if (cone := world.cone(source))]
        inside = [cone.contains(places) for cone in cones] or [np.zeros(len(rows), bool)]
        measures["in the cone"] = int(np.any(inside, axis=0).sum())
    if leds_on is not None:
        measures["LEDs on"] = leds_on
    return measures
