"""How the robots were: connected, seen, stopped and why, from `/robots`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.report.facts import number
from vsense.report.flow import MOST_SPELLS, Spell

UNKNOWN, FINE, STOPPED, UNSEEN, LOST = range(5)
"""How a robot is; the greater the worse."""

BINS = 1024
BIN_TIMESTEPS = 5
_NONE: Mapping[int, int] = {}


class LinkHealth:
    """One robot's health.

    Attributes:
        told: messages that told of it.
        connected: those in which it was connected.
        losses: how often its link was lost.
        stops: how often its wheels were held and nobody wanted that, by cause.
        battery_mv: the lowest voltage [mV]; None unknown.
        base_errors: errors of its base while looked at; None unknown.
    """

    def __init__(self) -> None:
        self.told = self.connected = self.losses = 0
        self.stops: Counter[str] = Counter()
        self.battery_mv: float | None = None
        self.base_errors: float | None = None
        self._cause = ""
        self._first_errors: float | None = None

    def take(self, connected: bool, cause: str, battery: Any, errors: Any) -> None:
        """Takes what one message tells of it."""
        self.told += 1
        self.connected += connected
        if cause and cause != self._cause:
            self.stops[cause] += 1
        self._cause = cause
        battery_mv, count = number(battery), number(errors)
        if battery_mv is not None:
            self.battery_mv = min(battery_mv, self.battery_mv or battery_mv)
        if count is not None:
            if self._first_errors is None or count < self._first_errors:
                self._first_errors = count
            self.base_errors = count - self._first_errors


class SeenRobots:
    """The health of all robots.

    Attributes:
        of: by tag.
        losses: times without link.
        lit: tags of the robots whose ring LEDs are on now.
        connected: how many are connected now; -1: nobody told yet.
    """

    def __init__(self, names: Mapping[int, str]) -> None:
        """Begins empty; `names` are those of robots by tag, as far as they are known."""
        self._names = names
        self.of: dict[int, LinkHealth] = {}
        self.losses: list[Spell] = []
        self.lit: set[int] = set()
        self.connected = -1
        self._open: dict[int, Spell] = {}

    def take(self, time_ns: int, data: Mapping[str, Any]) -> dict[int, int]:
        """Takes a `/robots`.

        Returns:
            How each robot is, by tag: `FINE`, `STOPPED` or `LOST`.

        Raises:
            KeyError, TypeError, ValueError: it is damaged.
        """
        tags = [int(tag) for tag in data["tag"]]
        none = [None] * len(tags)
        names = ("connected", "stop_cause", "battery_mv", "base_errors", "leds")
        columns = [data.get(name) or none for name in names]
        states: dict[int, int] = {}
        self.lit = set()
        for tag, connected, cause, battery, errors, leds in zip(tags, *columns, strict=True):
            health = self.of.get(tag) or self.of.setdefault(tag, LinkHealth())
            health.take(bool(connected), str(cause or ""), battery, errors)
            self._link(time_ns, tag, bool(connected))
            states[tag] = LOST if not connected else STOPPED if cause else FINE
            if isinstance(leds, int) and leds & 0xFF:
                self.lit.add(tag)
        self.connected = sum(state != LOST for state in states.values())
        return states

    def _link(self, time_ns: int, tag: int, connected: bool) -> None:
        loss = self._open.get(tag)
        if not connected and loss is None:
            self._open[tag] = Spell(f"robot {self._names.get(tag, tag)}", time_ns)
            self.of[tag].losses += 1
            if len(self.losses) < MOST_SPELLS:
                self.losses.append(self._open[tag])
        elif connected and loss is not None:
            loss.to_ns = time_ns
            del self._open[tag]


class Strips:
    """How each robot was over time, the worst in each of at most `BINS` equal times.

    Attributes:
        begin_ns: where the first begins; None: nothing was told yet.
        bin_ns: how long one is; it doubles when they do not suffice.
    """

    def __init__(self, timestep_ns: int) -> None:
        self.begin_ns: int | None = None
        self.bin_ns = BIN_TIMESTEPS * timestep_ns
        self._rows: dict[int, NDArray[np.uint8]] = {}
        self._used = 0

    def take(
        self, time_ns: int, states: Mapping[int, int], since: Mapping[int, int] = _NONE
    ) -> None:
        """Takes how the robots are now.

        Args:
            time_ns: now.
            states: by tag.
            since: tags of robots that have been so since a time before; [ns].
        """
        if self.begin_ns is None:
            self.begin_ns = time_ns
        place = self._place(time_ns)
        while place >= BINS:
            self._halve()
            place = self._place(time_ns)
        self._used = max(self._used, place + 1)
        for tag, state in states.items():
            row = self._rows.get(tag)
            if row is None:
                row = self._rows[tag] = np.zeros(BINS, np.uint8)
            if tag in since:
                part = row[min(self._place(since[tag]), place) : place + 1]
                np.maximum(part, state, out=part)
            elif row[place] < state:
                row[place] = state

    def _place(self, time_ns: int) -> int:
        return max(time_ns - (self.begin_ns or 0), 0) // self.bin_ns

    def table(self) -> tuple[list[int], NDArray[np.uint8]]:
        """Gives the tags, and (robots, times) how they were."""
        tags = sorted(self._rows)
        rows = [self._rows[tag][: self._used] for tag in tags]
        return tags, np.array(rows, np.uint8).reshape(len(tags), self._used)

    def _halve(self) -> None:
        self.bin_ns *= 2
        self._used = -(-self._used // 2)
        for row in self._rows.values():
            row[: BINS // 2] = row.reshape(-1, 2).max(axis=1)
            row[BINS // 2 :] = UNKNOWN
