"""How the run went on: timesteps lived and missed, silences, latencies, cameras."""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from vsense.report.facts import clock_ns, number

SILENCE_NS = 500_000_000
"""From here on a time without an arena state is worth a line."""
MOST_SPELLS = 1_000
"""Silences, link losses and camera troubles of a recording, listed one by one: each so many."""


@dataclass(slots=True)
class Spell:
    """A time in which something was amiss.

    Attributes:
        what: for people.
        from_ns: when it began.
        to_ns: when it was over; None: it was not until the end.
    """

    what: str
    from_ns: int
    to_ns: int | None = None


class Flow:
    """The arena states of a run, one after the other.

    Attributes:
        begin_ns: capture time of the first; None: there was none.
        end_ns: capture time of the last that the run lived.
        newest_ns: capture time of the newest.
        lived: how many timesteps there were.
        missed: how many timesteps of the run are not there.
        spells: silences.
        time_ns: (n,) capture times.
        seen: (n,) how many robots were seen in each.
        connected: (n,) how many robots were connected then; -1: nobody told yet.
    """

    def __init__(self) -> None:
        self.begin_ns: int | None = None
        self.end_ns = self.newest_ns = 0
        self.lived = self.missed = 0
        self.spells: list[Spell] = []
        self.time_ns, self.seen, self.connected = array("q"), array("i"), array("i")
        self._run_timestep: int | None = None

    def take(self, capture_ns: int, run_timestep: int, seen: int, connected: int) -> None:
        """Takes an arena state; `run_timestep` is -1 where no run is on."""
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
        """Takes an arena state that the run does not live, such as one in a pause."""
        if self.begin_ns is None:
            return
        if capture_ns - self.newest_ns > SILENCE_NS and len(self.spells) < MOST_SPELLS:
            self.spells.append(Spell("no arena state", self.newest_ns, capture_ns))
        self.newest_ns = max(capture_ns, self.newest_ns)


class Latencies:
    """How old a picture was when the readings made from it left.

    Attributes:
        time_ns: (n,) capture times.
        latency_ms: (n,).
    """

    def __init__(self) -> None:
        self.time_ns, self.latency_ms = array("q"), array("d")

    def take(self, sent_ns: int, data: Mapping[str, Any]) -> None:
        """Takes a `/readings`.

        Raises:
            KeyError, TypeError, ValueError: it is damaged.
        """
        capture_ns = clock_ns(data["capture_ns"])
        self.time_ns.append(capture_ns)
        self.latency_ms.append((sent_ns - capture_ns) / 1e6)


class Measures:
    """What the experiment measured over time.

    Attributes:
        of: by name, times since the run began [s] and values, (n,) each.
    """

    def __init__(self) -> None:
        self.of: dict[str, tuple[array[float], array[float]]] = {}

    def take(self, time_s: float, values: Mapping[str, Any]) -> None:
        """Takes the measures of a timestep; what is no number is left out."""
        for name, value in values.items():
            known = number(value)
            if known is not None:
                times, column = self.of.setdefault(str(name), (array("d"), array("d")))
                times.append(time_s)
                column.append(known)


class CameraCounts:
    """How the cameras were.

    Attributes:
        rates_hz: of each camera, (sum, how many times it was told).
        dropped: pictures that each dropped.
        spells: times in which one was not well.
    """

    def __init__(self) -> None:
        self.rates_hz: dict[str, tuple[float, int]] = {}
        self.dropped: dict[str, int] = {}
        self.spells: list[Spell] = []
        self._open: dict[str, tuple[str, Spell]] = {}

    def take(self, time_ns: int, data: Mapping[str, Any]) -> None:
        """Takes a `/cameras`.

        Raises:
            KeyError, TypeError, ValueError, AttributeError: it is damaged.
        """
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
            spell = Spell(f"camera {name}: {text or state}", time_ns)
            self._open[name] = (state, spell)
            if len(self.spells) < MOST_SPELLS:
                self.spells.append(spell)
