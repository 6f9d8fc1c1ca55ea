"""What robots complain about in their telemetry: told once when it begins, once when it is over."""

from __future__ import annotations

from collections.abc import Mapping

from vsense.link.status import RobotStatus
from vsense.link.wire import StopCause, Telemetry

PATIENCE_NS = 1_000_000_000
"""A daemon that has just started looks for its base for a moment: that is no trouble yet."""

BATTERY_LOW = 1


class Complaints:
    """Which robots are in trouble, from one status to the next."""

    def __init__(self) -> None:
        self._since_ns: dict[tuple[int, str], int] = {}
        self._told: set[tuple[int, str]] = set()

    def update(self, robots: Mapping[int, RobotStatus], now_ns: int) -> list[str]:
        """Takes over the newest status of every robot.

        Args:
            robots: status by tag.
            now_ns: the host's monotonic clock.

        Returns:
            A line for each trouble that has lasted long enough to be told, or that is over.
        """
        lines = []
        for tag, status in robots.items():
            if status.telemetry is None or not status.connected:
                continue
            for begun, over, present in _troubles(status.telemetry):
                key = (tag, begun)
                if not present:
                    self._since_ns.pop(key, None)
                    if key in self._told:
                        self._told.remove(key)
                        lines.append(f"robot {status.name}: {over}")
                    continue
                lasted_ns = now_ns - self._since_ns.setdefault(key, now_ns)
                if lasted_ns >= PATIENCE_NS and key not in self._told:
                    self._told.add(key)
                    lines.append(f"robot {status.name}: {begun}")
        return lines


def _troubles(telemetry: Telemetry) -> list[tuple[str, str, bool]]:
    """Words for each trouble, words for its end, and whether a telemetry tells of it."""
    return [
        (
            "its base does not answer: its wheels are held",
            "its base answers again",
            telemetry.stop_cause == StopCause.BASE,
        ),
        (
            "its battery is low",
            "its battery is no longer low",
            telemetry.battery_low == BATTERY_LOW,
        ),
    ]
