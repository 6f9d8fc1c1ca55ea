"""What a robot's packets tell of its link: loss both ways, round trips, jitter, gaps, its radio.

The echoes of the wire (`c_src/PROTOCOL.md`) make each telemetry a round-trip sample: it says which
STATE its robot had heard last, and how long ago that was.
"""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsense.base.clock import clock_difference_ns
from vsense.robots.link.status import LinkFigures, RadioStatus
from vsense.robots.link.wire import Header, StopCause, Telemetry

MS = 1_000_000


RADIO_NS = 1_000_000_000
"""A robot asks its radio once a second."""


@dataclass(slots=True)
class LinkMeter:
    """Measures one robot's link, from its first packet to `figures`."""

    _arrivals_ns: array[int] = field(default_factory=lambda: array("q"))
    _transits_ns: array[int] = field(default_factory=lambda: array("q"))
    _trips_ns: array[int] = field(default_factory=lambda: array("q"))
    _radios: list[RadioStatus] = field(default_factory=list)
    _counts: list[_Span] = field(default_factory=list)
    _stale: int = 0
    _was_stale: bool = False
    _radio_ns: int = -RADIO_NS

    def hear(self, header: Header, heard: Telemetry, sent: int, now_ns: int) -> None:
        """Takes telemetry that was accepted.

        Args:
            sent: STATE packets that the host has sent to the robot so far.
            now_ns: when it came, host's clock.
        """
        counts = _Counts(header.sequence, _taken(heard), sent, heard.overruns, heard.control_step)
        if not self._counts or self._counts[-1].session != header.session:
            # What was counted before is no part of this measurement.
            first = counts._replace(sent_up=header.sequence - 1)
            self._counts.append(_Span(header.session, first))
        self._counts[-1].take(counts)
        self._arrivals_ns.append(now_ns)
        self._transits_ns.append(clock_difference_ns(now_ns, header.send_ns))
        # An echo is of the host's own clock: of what it has not sent yet there is none.
        if 0 < header.echo_ns <= now_ns:
            self._trips_ns.append(max(0, now_ns - header.echo_ns - 1000 * header.hold_us))
        stale = heard.stop_cause == StopCause.STALE
        # A session's first packets have heard no three STATEs yet.
        self._stale += stale and not self._was_stale and self._counts[-1].packets > FIRST_PACKETS
        self._was_stale = stale
        if now_ns - self._radio_ns >= RADIO_NS:
            self._radio_ns = now_ns
            self._radios.append(RadioStatus.of(heard))

    def figures(self, now_ns: int) -> LinkFigures:
        """What was measured up to `now_ns`, host's clock."""
        if not self._arrivals_ns:
            return LinkFigures()
        arrivals = np.array([*self._arrivals_ns, now_ns], np.int64)
        p50_ms, p99_ms = _percentiles(np.array(self._trips_ns, np.int64) / MS)
        packets = len(self._arrivals_ns)
        sent_up, received, sent, overruns, steps = map(sum, zip(*(s.counted for s in self._counts)))
        return LinkFigures(
            heard_s=round((now_ns - self._arrivals_ns[0]) / 1e9, 3),
            packets=packets,
            loss_up=_lost(packets, sent_up),
            loss_down=_lost(received, sent),
            round_trip_p50_ms=p50_ms,
            round_trip_p99_ms=p99_ms,
            jitter_ms=self._jitter_ms(),
            gap_ms=round(float(np.diff(arrivals).max()) / MS, 3),
            stale=self._stale,
            overruns=overruns,
            late=_share(overruns, steps),
            **self._radio(),
            sessions=len(self._counts),
        )

    def _jitter_ms(self) -> float | None:
        """The clocks' difference is in all transits alike, and gone from their differences.

        These are modulo 2^64, as the transits are.
        """
        if len(self._transits_ns) < 2:
            return None
        differences = np.diff(np.array(self._transits_ns, np.int64)).astype(np.float64)
        return round(float(np.abs(differences).mean()) / MS, 3)

    def _radio(self) -> dict[str, Any]:
        signals = [r.signal_dbm for r in self._radios if r.signal_dbm is not None]
        rates = [r.bit_rate_mbit_s for r in self._radios if r.bit_rate_mbit_s is not None]
        counts = [r.retries for r in self._radios if r.retries is not None]
        saved = [r.power_saving for r in self._radios if r.power_saving is not None]
        return {
            "signal_dbm": float(np.median(signals)) if signals else None,
            "weakest_dbm": min(signals, default=None),
            "bit_rate_mbit_s": float(np.median(rates)) if rates else None,
            # A driver that was loaded again counts from 0.
            "retries": max(counts[-1] - counts[0], 0) if counts else None,
            "power_saving": any(saved) if saved else None,
        }


FIRST_PACKETS = 10
"""Of a session: half a second."""


class _Counts(NamedTuple):
    sent_up: int
    received: int
    sent: int
    overruns: int
    steps: int


class _Span:
    """One session's counts: first and newest ones."""

    def __init__(self, session: int, first: _Counts) -> None:
        self.session = session
        self.packets = 0
        self._first = self._last = first

    def take(self, counts: _Counts) -> None:
        self.packets += 1
        self._last = counts

    @property
    def counted(self) -> _Counts:
        """What has come to them meanwhile."""
        return _Counts(*(last - first for first, last in zip(self._first, self._last)))


def _taken(telemetry: Telemetry) -> int:
    """Packets that the robot took, each once."""
    return telemetry.received - telemetry.old - telemetry.foreign - telemetry.corrupt


def _lost(there: int, total: int) -> float | None:
    """A share; the few packets that are on their way count as lost."""
    return _share(total - there, total)


def _share(part: int, total: int) -> float | None:
    """From 0 to 1, whatever a robot says that it has counted."""
    return round(min(max(part / total, 0.0), 1.0), 5) if total > 0 else None


def _percentiles(values: NDArray[np.float64]) -> tuple[float | None, float | None]:
    if not len(values):
        return None, None
    p50, p99 = np.percentile(values, (50, 99)).tolist()
    return round(p50, 3), round(p99, 3)
