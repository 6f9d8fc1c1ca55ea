"""Where the robots were: thinned ways, driven distances, and how long each spot was occupied.

Memory is bounded, however long a recording is.
"""

from __future__ import annotations

import math
from array import array
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.studies.report.facts import MOST_M, number

Floats = NDArray[np.float64]

CELL_M = 0.05
"""Occupancy is counted in squares of this side."""
STILL_M = 0.005
"""Shorter moves count once they add up to this: a standing robot's pose has noise."""
UNSEEN_NS = 1_000_000_000
"""A way that was not seen for longer is neither drawn nor counted."""
MOST_POINTS = 4_000
"""A robot's way with so many points is thinned to half of them."""


class RobotTrack:
    """One robot's way, from one sighting to the next.

    Attributes:
        seen: timesteps in which it was seen.
        distance_m: driven, along sightings at least `STILL_M` apart.
        followed_s: time between sightings that `distance_m` was driven in.
        longest_unseen_s: the longest time without a sighting, pauses left out.
        last_ns: when it was seen last.
    """

    def __init__(self) -> None:
        self.seen = 0
        self.distance_m = self.followed_s = self.longest_unseen_s = 0.0
        # x and y in turns: a tuple for each point would take seven times the memory.
        self._points = array("d")
        self._spacing_m = STILL_M
        self._most = MOST_POINTS
        self._anchor: tuple[float, float] | None = None
        self._kept: tuple[float, float] | None = None
        self._last: tuple[float, float] | None = None
        self.last_ns = 0

    @property
    def points_m(self) -> Floats:
        """The way, (n, 2) arena frame; a row of NaN is where it was not seen for a while."""
        return np.array([*self._points, *(self._last or ())], np.float64).reshape(-1, 2)

    def add(self, time_ns: int, x_m: float, y_m: float) -> None:
        """Adds a sighting."""
        self.seen += 1
        here = (x_m, y_m)
        if self._anchor is not None:
            unseen_ns = time_ns - self.last_ns
            self.longest_unseen_s = max(self.longest_unseen_s, unseen_ns / 1e9)
            if unseen_ns > UNSEEN_NS:
                self.lift()
            else:
                self.followed_s += unseen_ns / 1e9
        if self._anchor is None:
            self._anchor = here
            self._keep(here)
        else:
            step_m = math.dist(self._anchor, here)
            if step_m >= STILL_M:
                self.distance_m += step_m
                self._anchor = here
        if self._kept is None or math.dist(self._kept, here) >= self._spacing_m:
            self._keep(here)
        self._last, self.last_ns = here, time_ns

    def lift(self) -> None:
        """Ends the present piece of the way: the next is not joined to it."""
        if self._last is not None:
            self._points.extend((*self._last, math.nan, math.nan))
        self._anchor = self._kept = self._last = None

    def _keep(self, here: tuple[float, float]) -> None:
        self._kept = here
        self._points.extend(here)
        if len(self._points) >= 2 * self._most:
            self._spacing_m *= 2.0
            points = np.array(self._points).reshape(-1, 2)
            thinned = points[(np.arange(len(points)) % 2 == 0) | np.isnan(points[:, 0])]
            self._points = array("d", thinned.ravel())
            self._most = max(MOST_POINTS, 2 * len(thinned))


class Tracks:
    """All robots' ways; `is_robot` distinguishes robots from objects by their tags.

    Attributes:
        of: the ways by tag.
        objects_m: where tagged objects were last, by tag.
        states: number of arena states.
        cells: robots' timesteps by square (column, row) of `CELL_M`; (0, 0) begins at the origin.
        places_m: where the robots of the newest state were seen, by tag.
    """

    def __init__(self, is_robot: Callable[[int], bool]) -> None:
        self.of: dict[int, RobotTrack] = {}
        self.objects_m: dict[int, tuple[float, float]] = {}
        self.states = 0
        self.cells: Counter[tuple[int, int]] = Counter()
        self.places_m: dict[int, tuple[float, float]] = {}
        self._is_robot = is_robot

    def add(self, capture_ns: int, robots: Mapping[str, Any]) -> None:
        """Adds the robots of an arena state, in columns.

        KeyError, TypeError, ValueError if it is damaged; then nothing of it was added.
        """
        columns = (robots["tag"], robots["x_m"], robots["y_m"], robots["seen"])
        rows = [
            (int(tag), float(x), float(y))
            for tag, x, y, seen in zip(*columns, strict=True)
            if seen and _is_place(x) and _is_place(y)
        ]
        self.states += 1
        self.places_m = {}
        for tag, x_m, y_m in rows:
            if not self._is_robot(tag):
                self.objects_m[tag] = (x_m, y_m)
                continue
            self.places_m[tag] = (x_m, y_m)
            track = self.of.get(tag) or self.of.setdefault(tag, RobotTrack())
            track.add(capture_ns, x_m, y_m)
            self.cells[math.floor(x_m / CELL_M), math.floor(y_m / CELL_M)] += 1

    def lift(self) -> None:
        """Ends all pieces: during a pause the robots' moves do not count."""
        for track in self.of.values():
            track.lift()


def _is_place(value: Any) -> bool:
    known = number(value)
    return known is not None and abs(known) < MOST_M
