"""What a report keeps of a run: timesteps, silences, cameras, robots."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.studies.report._facts import number

SILENCE_LIMIT_NS = 500_000_000
"""A longer time without an arena state is reported."""
MOST_INTERVALS = 1_000
"""Silences, link losses and camera troubles of a recording, listed one by one: each so many."""


@dataclass(slots=True)
class Interval:
    """A time in which something was wrong; `to_ns` None: it was not over at the end."""

    what: str
    from_ns: int
    to_ns: int | None = None


class Flow:
    """The arena states of a run, one after the other.

    Attributes:
        begin_ns: capture time of the first; None: there was none.
        end_ns: capture time of the last in the run.
        newest_ns: capture time of the newest.
        lived, missed: how many timesteps of the run are there, and are not.
        intervals: silences.
        time_ns: (n,) capture times.
        seen: (n,) how many robots were seen in each.
        connected: (n,) how many robots were connected then; -1: not known yet.
    """

    def __init__(self) -> None:
        self.begin_ns: int | None = None
        self.end_ns = self.newest_ns = 0
        self.lived = self.missed = 0
        self.intervals: list[Interval] = []
        self.time_ns, self.seen, self.connected = array("q"), array("i"), array("i")
        self._run_timestep: int | None = None

    def add(self, capture_ns: int, run_timestep: int, seen: int, connected: int) -> None:
        """Adds an arena state; `run_timestep` is -1 outside of a run."""
        if self.begin_ns is None:
            self.begin_ns = self.newest_ns = capture_ns
        else:
            self.pass_over(capture_ns)
        last = self._run_timestep
        if run_timestep >= 0:
            if last is not None and run_timestep > last:
                self.missed += run_timestep - last - 1
            self._run_timestep = run_timestep
        self.end_ns = max(capture_ns, self.end_ns)
        self.lived += 1
        self.time_ns.append(capture_ns)
        self.seen.append(seen)
        self.connected.append(connected)

    def pass_over(self, capture_ns: int) -> None:
        """Adds an arena state that is no part of the run, such as one in a pause."""
        if self.begin_ns is None:
            return
        if capture_ns - self.newest_ns > SILENCE_LIMIT_NS and len(self.intervals) < MOST_INTERVALS:
            self.intervals.append(Interval("no arena state", self.newest_ns, capture_ns))
        self.newest_ns = max(capture_ns, self.newest_ns)


class CameraCounts:
    """The cameras' state.

    Attributes:
        rates_hz: of each camera, sum and number of the messages with a rate.
        dropped: pictures that each dropped.
        intervals: times in which one was in trouble.
    """

    def __init__(self) -> None:
        self.rates_hz: dict[str, tuple[float, int]] = {}
        self.dropped: dict[str, int] = {}
        self.intervals: list[Interval] = []
        self._open: dict[str, tuple[str, Interval]] = {}

    def add(self, time_ns: int, data: Mapping[str, Any]) -> None:
        """Adds a `/cameras`; KeyError, TypeError, ValueError, AttributeError if it is damaged."""
        for row in data["cameras"]:
            name, state = str(row["id"]), str(row.get("state") or "ok")
            rate_hz, dropped = number(row.get("rate_hz")), number(row.get("dropped"))
            if rate_hz is not None:
                total, count = self.rates_hz.get(name, (0.0, 0))
                self.rates_hz[name] = (total + rate_hz, count + 1)
            if dropped is not None:
                self.dropped[name] = int(dropped)
            self._follow(time_ns, name, state, str(row.get("text") or ""))

    def _follow(self, time_ns: int, name: str, state: str, text: str) -> None:
        before = self._open.get(name)
        if before is not None and before[0] != state:
            before[1].to_ns = time_ns
            del self._open[name]
        if state != "ok" and name not in self._open:
            interval = Interval(f"camera {name}: {text or state}", time_ns)
            self._open[name] = (state, interval)
            if len(self.intervals) < MOST_INTERVALS:
                self.intervals.append(interval)


UNKNOWN, FINE, STOPPED, UNSEEN, LOST = range(5)
"""States of a robot; the greater the worse."""

BINS = 1024
BIN_TIMESTEPS = 5
_NONE: Mapping[int, int] = {}


class LinkHealth:
    """One robot's health.

    Attributes:
        reports: messages about it.
        connected: those in which it was connected.
        losses: how often its link was lost.
        stops: how often its wheels were held without an order, by cause.
        battery_mv: the lowest voltage [mV]; None unknown.
        base_errors: errors of its base while looked at; None unknown.
        signal_dbm: the weakest signal of its Wi-Fi [dBm]; None unknown.
        silent_ms: the longest time since it was heard [ms]; None unknown.
    """

    def __init__(self) -> None:
        self.reports = self.connected = self.losses = 0
        self.stops: Counter[str] = Counter()
        self.battery_mv: float | None = None
        self.base_errors: float | None = None
        self.signal_dbm: float | None = None
        self.silent_ms: float | None = None
        self._cause = ""
        self._first_errors: float | None = None

    def add(self, connected: bool, cause: str, battery: Any, errors: Any) -> None:
        """Adds what one message says of it."""
        self.reports += 1
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

    def hear(self, signal: Any, silent: Any) -> None:
        """Adds what one message says of its Wi-Fi, and how long nothing was heard."""
        signal_dbm, silent_ms = number(signal), number(silent)
        if signal_dbm is not None:
            self.signal_dbm = min(signal_dbm, self.signal_dbm or signal_dbm)
        if silent_ms is not None:
            self.silent_ms = max(silent_ms, self.silent_ms or 0.0)


class SeenRobots:
    """The health of all robots; `names` by tag, as far as they are known.

    Attributes:
        of: by tag.
        losses: times without link.
        leds: the LEDs that are on now, bits by tag.
        connected: how many are connected now; -1: not known yet.
    """

    def __init__(self, names: Mapping[int, str]) -> None:
        self._names = names
        self.of: dict[int, LinkHealth] = {}
        self.losses: list[Interval] = []
        self.leds: dict[int, int] = {}
        self.connected = -1
        self._open: dict[int, Interval] = {}

    def add(self, time_ns: int, data: Mapping[str, Any]) -> dict[int, int]:
        """Adds a `/robots`; gives each robot's state by tag: `FINE`, `STOPPED` or `LOST`.

        KeyError, TypeError, ValueError if it is damaged.
        """
        tags = [int(tag) for tag in data["tag"]]
        none = [None] * len(tags)
        names = (
            *("connected", "stop_cause", "battery_mv", "base_errors", "leds"),
            *("signal_dbm", "heard_ms"),
        )
        columns = [data.get(name) or none for name in names]
        states: dict[int, int] = {}
        self.leds = {}
        for tag, connected, cause, battery, errors, leds, *air in zip(tags, *columns, strict=True):
            health = self.of.get(tag) or self.of.setdefault(tag, LinkHealth())
            health.add(bool(connected), str(cause or ""), battery, errors)
            health.hear(*air)
            self._link(time_ns, tag, bool(connected))
            states[tag] = LOST if not connected else STOPPED if cause else FINE
            if isinstance(leds, int):
                self.leds[tag] = leds
        self.connected = sum(state != LOST for state in states.values())
        return states

    def _link(self, time_ns: int, tag: int, connected: bool) -> None:
        loss = self._open.get(tag)
        if not connected and loss is None:
            self._open[tag] = Interval(f"robot {self._names.get(tag, tag)}", time_ns)
            self.of[tag].losses += 1
            if len(self.losses) < MOST_INTERVALS:
                self.losses.append(self._open[tag])
        elif connected and loss is not None:
            loss.to_ns = time_ns
            del self._open[tag]


class Strips:
    """Each robot's state over time, the worst in each of at most `BINS` equal times.

    Attributes:
        begin_ns: where the first begins; None: nothing was added yet.
        bin_ns: duration of one; it doubles when they do not suffice.
    """

    def __init__(self, timestep_ns: int) -> None:
        self.begin_ns: int | None = None
        self.bin_ns = BIN_TIMESTEPS * timestep_ns
        self._rows: dict[int, NDArray[np.uint8]] = {}
        self._used = 0

    def add(
        self, time_ns: int, states: Mapping[int, int], since: Mapping[int, int] = _NONE
    ) -> None:
        """Adds the present states by tag; `since` has older beginnings of some of them [ns]."""
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
        """Gives the tags, and (robots, times) their states."""
        tags = sorted(self._rows)
        rows = [self._rows[tag][: self._used] for tag in tags]
        return tags, np.array(rows, np.uint8).reshape(len(tags), self._used)

    def _halve(self) -> None:
        self.bin_ns *= 2
        self._used = -(-self._used // 2)
        for row in self._rows.values():
            row[: BINS // 2] = row.reshape(-1, 2).max(axis=1)
            row[BINS // 2 :] = UNKNOWN
