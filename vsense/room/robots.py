"""How each robot is: its link, its pose, its battery, and its trouble in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from vsense.arena import ArenaState
from vsense.link.status import RobotStatus
from vsense.link.table import Entry
from vsense.link.wire import StopCause, Wanted
from vsense.native import lib
from vsense.room.messages import Data, numbers

UNSEEN_NS = 1_000_000_000
"""A robot may be hidden for a moment: from here on that is trouble."""

CAUSES = {
    StopCause.NONE: "",
    StopCause.WANTED: "",
    StopCause.NO_SESSION: "it has no session",
    StopCause.STALE: "what it hears is too old",
    StopCause.NO_BEAT: "its controller does not answer",
    StopCause.BASE: "its base does not answer",
    StopCause.GUARD: "its guard was replaced",
    StopCause.SIGNAL: "it was told to end",
}
"""Why wheels are held, where nobody wanted that."""


class Roll:
    """Tells how the robots are; it remembers when each was seen last."""

    def __init__(self, names: Mapping[int, str], actuators: Sequence[Entry]) -> None:
        """Begins with nobody seen.

        Args:
            names: the robots by tag.
            actuators: the sensor table's actuators.
        """
        self._names = dict(names)
        self._actuators = actuators
        self._seen_ns: dict[int, int] = {}

    def see(self, state: ArenaState) -> None:
        """Takes an arena state over."""
        seen = state.robots[state.robots["seen"]]
        self._seen_ns |= zip(seen["tag"].tolist(), seen["capture_ns"].tolist())

    def data(self, links: Mapping[int, RobotStatus], state: ArenaState | None, now_ns: int) -> Data:
        """Gives /robots.

        Args:
            links: status of every robot by tag.
            state: the newest arena state, if there is one.
            now_ns: host's monotonic clock.
        """
        twice = frozenset(() if state is None else state.duplicates)
        seen = set() if state is None else set(state.robots["tag"][state.robots["seen"]].tolist())
        rows = [self._row(links[tag], tag in seen, tag in twice, now_ns) for tag in self._names]
        keys = rows[0] if rows else {}
        return {key: [row[key] for row in rows] for key in keys}

    def _row(self, link: RobotStatus, seen: bool, twice: bool, now_ns: int) -> dict[str, Any]:
        seen_ns = self._seen_ns.get(link.tag)
        row: dict[str, Any] = {
            "tag": link.tag,
            "name": self._names[link.tag],
            "connected": link.connected,
            "heard_ms": _ms(link.heard_ns, now_ns),
            "udp": link.udp,
            "seen": seen,
            "pose_age_ms": _ms(seen_ns, now_ns),
            "doubt": "its tag is seen at two places" if twice else None,
            "sessions": link.sessions,
            "version": link.version,
            "controller": link.controller,
            "hash": link.hash,
        }
        row |= self._telemetry(link)
        row["trouble"] = _trouble(row, seen_ns is None or now_ns - seen_ns > UNSEEN_NS)
        return row

    def _telemetry(self, link: RobotStatus) -> dict[str, Any]:
        told = link.telemetry
        if told is None:
            return dict.fromkeys(_TOLD) | {"state": "idle", "stop_cause": "", "leds": 0}
        known = told.battery_low != lib.VS_BATTERY_UNKNOWN
        return {
            "state": _STATES.get(told.state, str(told.state)),
            "stop_cause": CAUSES.get(told.stop_cause, f"cause {told.stop_cause}"),  # type: ignore[call-overload]
            "battery_mv": told.battery_mv or None,
            "battery_low": bool(told.battery_low) if known else None,
            "leds": told.leds,
            "left_steps_s": told.left_steps_s,
            "right_steps_s": told.right_steps_s,
            "base_errors": told.base_errors,
            "guard_restarts": told.guard_restarts,
            "actuators": numbers(self._actuators, told.payload) if self._actuators else [],
        }


_STATES = {state.value: state.name.lower() for state in Wanted}

_TOLD = (
    *("state", "stop_cause", "battery_mv", "battery_low", "leds", "left_steps_s"),
    *("right_steps_s", "base_errors", "guard_restarts", "actuators"),
)


def _ms(then_ns: int | None, now_ns: int) -> float | None:
    return None if then_ns is None else round((now_ns - then_ns) / 1e6, 1)


def _trouble(row: Mapping[str, Any], unseen: bool) -> str:
    """The worst that is wrong with a robot, in words; "" where nothing is."""
    if not row["connected"]:
        heard_ms = row["heard_ms"]
        return "not connected" if heard_ms is None else f"link lost for {heard_ms / 1e3:.1f} s"
    if row["doubt"]:
        return str(row["doubt"])
    if row["stop_cause"]:
        return f"stopped: {row['stop_cause']}"
    if unseen:
        age_ms = row["pose_age_ms"]
        return "never seen" if age_ms is None else f"not seen for {age_ms / 1e3:.1f} s"
    if row["battery_low"]:
        return "battery low"
    # A robot with the original client has no session of ours, and TCP alone.
    slow = row["sessions"] and not row["udp"]
    return "no UDP: its readings come over TCP" if slow else ""
