"""Counts what the links of a run sent and received, over all lives of every daemon."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from vsense.link.status import RobotStatus
from vsense.link.wire import Telemetry


@dataclass(slots=True)
class _Robot:
    """One robot's daemons: what the earlier ones had counted, and the newest telemetry."""

    received: int = 0
    dropped: int = 0
    guard_restarts: int = 0
    newest: Telemetry | None = None


@dataclass(slots=True)
class Tally:
    """Counters of STATE packets, from the server's start or from `anew`.

    A daemon counts from its own start. Of one that was killed the last telemetry is what is
    known; what it received after that is counted as lost.

    Attributes:
        sent: packets made by the host.
        received: packets that the robots took, each once.
        dropped: packets that the robots did not take: old, repeated, foreign, damaged.
        sessions: sessions that were opened.
    """

    sent: int = 0
    received: int = 0
    dropped: int = 0
    sessions: int = 0
    _robots: dict[int, _Robot] = field(default_factory=dict)
    _earlier: tuple[int, int, int] = (0, 0, 0)

    def update(self, robots: Mapping[int, RobotStatus]) -> list[RobotStatus]:
        """Takes over the newest status of every robot.

        Returns:
            The robots whose guard was replaced since the last call.
        """
        replaced = []
        for tag, status in robots.items():
            known = self._robots.setdefault(tag, _Robot())
            if status.telemetry is not None and _take(known, status.telemetry):
                replaced.append(status)
        sent, received, dropped = self._earlier
        self.sent = sum(status.sent for status in robots.values()) - sent
        self.sessions = sum(status.sessions for status in robots.values())
        heard = [r.newest for r in self._robots.values() if r.newest is not None]
        self.received = self._before("received") + sum(_taken(t) for t in heard) - received
        self.dropped = self._before("dropped") + sum(_dropped(t) for t in heard) - dropped
        return replaced

    def anew(self) -> Tally:
        """Gives a tally that counts from here."""
        now = (self.sent, self.received, self.dropped)
        sent, received, dropped = (a + b for a, b in zip(self._earlier, now))
        return Tally(
            sessions=self.sessions, _robots=self._robots, _earlier=(sent, received, dropped)
        )

    def _before(self, counter: str) -> int:
        earlier: Iterable[int] = (getattr(robot, counter) for robot in self._robots.values())
        return sum(earlier)


def _take(known: _Robot, now: Telemetry) -> bool:
    """Adds a telemetry; True where it tells of a new guard."""
    before = known.newest
    if before is not None and now.received < before.received:
        known.received += _taken(before)
        known.dropped += _dropped(before)
        known.guard_restarts = 0
    known.newest = now
    replaced = now.guard_restarts > known.guard_restarts
    known.guard_restarts = now.guard_restarts
    return replaced


def _taken(telemetry: Telemetry) -> int:
    return telemetry.received - _dropped(telemetry)


def _dropped(telemetry: Telemetry) -> int:
    return telemetry.old + telemetry.foreign + telemetry.corrupt
