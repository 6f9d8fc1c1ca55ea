"""The measures of a run since it began, for pages that open late, reload, or miss timesteps.

Thinned to what a chart can show; of what is thinned the smallest and the largest value stay.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsense.base.message_bus import DAMAGED, Message
from vsense.monitor.recording import IN_CONE, LIT_IN_CONE
from vsense.monitor.recording.form import Data, ExperimentMessage
from vsense.robots.link.status import RING_LEDS
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


def count_swarm(
    places_m: Mapping[int, tuple[float, float]],
    leds: Mapping[int, int],
    cones: Collection[ArrayLike] | None,
) -> dict[str, int]:
    """Counts the robots with a LED on, those in polluted cones, and those with red LEDs on there.

    Args:
        places_m: of the robots, by tag.
        leds: their LEDs as bits, by tag.
        cones: the corners of each, (3, 2), in either order; None: nothing pollutes.
    """
    counts: dict[str, int] = {}
    if cones is not None:
        places = np.array(list(places_m.values()), np.float64).reshape(-1, 2)
        inside = np.any([np.zeros(len(places), bool), *(_within(c, places) for c in cones)], axis=0)
        tags = [tag for tag, is_inside in zip(places_m, inside) if is_inside]
        counts[IN_CONE] = len(tags)
        counts[LIT_IN_CONE] = sum(leds.get(tag, 0) & RING_LEDS != 0 for tag in tags)
    # The last: it is shown in some runs only, and charts have their colours by their order.
    return counts | {LEDS_ON: sum(bits != 0 for bits in leds.values())}


def _within(corners: ArrayLike, points: NDArray[np.float64]) -> NDArray[np.bool_]:
    start = np.asarray(corners, np.float64)
    side = np.roll(start, -1, axis=0) - start
    offset = points[:, None] - start
    turns = side[:, 0] * offset[..., 1] - side[:, 1] * offset[..., 0]
    return np.asarray((turns >= 0.0).all(axis=1) | (turns <= 0.0).all(axis=1))


def measures_of(world: World, robots: Iterable[int], leds: Mapping[int, int]) -> dict[str, float]:
    """The experiment's own measures, and what is counted in every experiment.

    Args:
        robots: tags of the robots, which are counted in a polluted cone.
        leds: bits of the LEDs that are on, by tag.
    """
    rows = world.robots[np.isin(world.robots["tag"], list(robots))]
    places = dict(zip(rows["tag"].tolist(), zip(rows["x_m"].tolist(), rows["y_m"].tolist())))
    cones = [cone.vertices() for source in world.sources if (cone := world.cone(source))]
    counts = count_swarm(places, leds, cones if world.sources else None)
    # The experiment's own come first, and hold where it counts the same.
    return {**world.results, **counts, **world.results}


class RecordedMeasures:
    """The measures of a recording's runs, from its messages in their order.

    Attributes:
        of_runs: the history of each run, by its number.
    """

    TOPICS = ("/run", "/arena", "/robots", "/signals")

    def __init__(self, experiment: Mapping[str, Any]) -> None:
        """`experiment` is the data of `/experiment`."""
        facts = ExperimentMessage.read(experiment)
        self._objects = {thing.get("tag") for thing in facts.objects}
        self._timestep_s = facts.timestep_s or 0.1
        self._run = 1
        self._pollutes = False
        self._places: dict[int, tuple[float, float]] = {}
        self._leds: dict[int, int] = {}
        self.of_runs: dict[int, MeasureHistory] = {}

    def data(self) -> dict[int, Data]:
        """Gives /history of each run, by its number."""
        return {run: of.data(run, self._timestep_s) for run, of in self.of_runs.items()}

    def take(self, message: Message) -> None:
        """Takes one message; one that is damaged is passed over."""
        data: Any = message.data
        with suppress(*DAMAGED):
            if message.topic == "/run":
                self._run = int(data["run"])
            elif message.topic == "/robots":
                self._leds = dict(zip(data["tag"], data["leds"], strict=True))
            elif message.topic == "/arena":
                names = ("tag", "x_m", "y_m")
                rows = zip(*(data["robots"][name] for name in names), strict=True)
                self._places = {t: (x, y) for t, x, y in rows if t not in self._objects}
            else:
                self._signals(data)

    def _signals(self, data: Mapping[str, Any]) -> None:
        timestep = int(data["timestep"])
        if timestep < 0:
            return
        cones = [tuple(zip(c["x_m"], c["y_m"], strict=True)) for c in data.get("cones") or []]
        self._pollutes |= bool(cones)
        counts = count_swarm(self._places, self._leds, cones if self._pollutes else None)
        own = data.get("measures") or {}
        measures = {**own, **counts, **own}
        numbers = {name: value for name, value in measures.items() if value is not None}
        history = self.of_runs.setdefault(self._run, MeasureHistory())
        history.add(timestep, numbers)
