"""Rows of /cameras and /robots: rates, links, poses, batteries, and what is wrong in words."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from vsense.base.arena import ArenaState, Frame
from vsense.base.native import lib
from vsense.monitor.recording.form import Data
from vsense.monitor.ui.messages import numbers
from vsense.robots.link.status import RadioStatus, RobotStatus
from vsense.robots.link.table import Entry
from vsense.robots.link.wire import ShownData, StopCause, Wanted
from vsense.run.alarms import disobeys
from vsense.vision.cameras.camera import Camera
from vsense.vision.cameras.grabber import Troubles

CAMERA_LOST_NS = 1_000_000_000
"""A camera without a picture for this long is lost, whatever else is known of it."""


class CameraTable:
    """Counts the cameras' pictures; one thread."""

    def __init__(self, cameras: Sequence[Camera], troubles: Troubles) -> None:
        self._cameras = [camera.id for camera in cameras]
        self._troubles = troubles
        self._pictures: Counter[str] = Counter()
        self._newest_ns: dict[str, int] = {}
        self._reported_ns: int | None = None

    def see(self, frames: Sequence[Frame]) -> None:
        """Counts the pictures of a timestep."""
        for frame in frames:
            self._pictures[frame.camera] += 1
            self._newest_ns[frame.camera] = frame.capture_ns

    def data(self, now_ns: int) -> Data:
        """Gives /cameras; rates count from the last call."""
        reported_ns, self._reported_ns = self._reported_ns, now_ns
        span_s = None if reported_ns is None else (now_ns - reported_ns) / 1e9
        pictures, self._pictures = self._pictures, Counter()
        return {"cameras": [self._camera(id, pictures[id], span_s, now_ns) for id in self._cameras]}

    def _camera(self, id: str, pictures: int, span_s: float | None, now_ns: int) -> Data:
        present = [event for (camera, _), event in self._troubles.present.items() if camera == id]
        silent_ns = now_ns - self._newest_ns.get(id, now_ns)
        state, text = "ok", ""
        if silent_ns > CAMERA_LOST_NS:
            state, text = "lost", f"no picture for {silent_ns / 1e9:.1f} s"
        elif present:
            state, text = present[-1].kind, present[-1].text
        return {
            "id": id,
            "rate_hz": None if not span_s else round(pictures / span_s, 2),
            "dropped": self._troubles.counts[id, "damaged"],
            "state": state,
            "text": text,
        }


ROBOT_UNSEEN_NS = 1_000_000_000
"""A robot may be hidden for a moment; longer is trouble."""

CAUSES = {
    StopCause.NONE: "",
    StopCause.WANTED: "",
    StopCause.NO_SESSION: "it has no session",
    StopCause.STALE: "what it hears is too old",
    StopCause.NO_BEAT: "its controller does not answer",
    StopCause.BASE: "its base does not answer",
    StopCause.GUARD: "its guard was replaced",
    StopCause.SIGNAL: "it was asked to end",
    StopCause.BATTERY: "its battery is empty",
}
"""Why wheels are held without an order."""


class RobotTable:
    """The robots' rows, and when each was seen last.

    `names` are the experiment's, by tag; `controllers` are the ids of those that the experiment has
    for them, `actuators` those of each robot's table, by tag.
    """

    def __init__(
        self,
        names: Mapping[int, str],
        controllers: Mapping[int, str],
        actuators: Mapping[int, Sequence[Entry]],
    ) -> None:
        self._names = dict(names)
        self._controllers = dict(controllers)
        self._actuators = actuators
        self._seen_ns: dict[int, int] = {}

    def see(self, state: ArenaState) -> None:
        """Notes which robots an arena state has seen."""
        seen = state.robots[state.robots["seen"]]
        self._seen_ns |= zip(seen["tag"].tolist(), seen["capture_ns"].tolist())

    def data(self, links: Mapping[int, RobotStatus], state: ArenaState | None, now_ns: int) -> Data:
        """Gives /robots, from the status of every robot by tag and the newest arena state."""
        twice = frozenset(() if state is None else state.duplicates)
        seen = set() if state is None else set(state.robots["tag"][state.robots["seen"]].tolist())
        rows = [
            self._row(links[tag], tag in seen, tag in twice, now_ns)
            for tag in self._names
            if tag in links
        ]
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
            "expected": self._controllers[link.tag],
            "authenticated": link.key is not None if link.connected else None,
            "held": link.held if link.connected and link.holdable else "",
        }
        row |= self._telemetry(link)
        row["trouble"] = (
            disobeys(link, now_ns)
            or link.refused
            or _trouble(row, seen_ns is None or now_ns - seen_ns > ROBOT_UNSEEN_NS)
        )
        return row

    def _telemetry(self, link: RobotStatus) -> dict[str, Any]:
        telemetry = link.telemetry
        if telemetry is None:
            return dict.fromkeys(_TELEMETRY) | {
                "state": "idle",
                "stop_cause": "",
                "leds": 0,
                "shown": {},
            }
        has_level = telemetry.battery_low != lib.VS_UNKNOWN
        return {
            "state": _STATES.get(telemetry.state, str(telemetry.state)),
            "stop_cause": CAUSES.get(telemetry.stop_cause, f"cause {telemetry.stop_cause}"),  # type: ignore[call-overload]
            "battery_mv": telemetry.battery_mv or None,
            "battery_low": bool(telemetry.battery_low) if has_level else None,
            "leds": telemetry.leds,
            "left_steps_s": telemetry.left_steps_s,
            "right_steps_s": telemetry.right_steps_s,
            "base_errors": telemetry.base_errors,
            "base_resets": telemetry.base_resets,
            "overruns": telemetry.overruns,
            "guard_restarts": telemetry.guard_restarts,
            **asdict(RadioStatus.of(telemetry)),
            "actuators": numbers(self._actuators[link.tag], telemetry.payload),
            "shown": shown(telemetry.shown),
        }


def shown(values: ShownData) -> dict[str, float | str | None]:
    """A controller's shown values by name; JSON knows no number that is not finite."""
    return {
        name: None if isinstance(value, float) and not math.isfinite(value) else value
        for name, value in values
    }


_STATES = {state.value: state.name.lower() for state in Wanted} | {Wanted.HOME.value: "homing"}

_TELEMETRY = (
    *("state", "stop_cause", "battery_mv", "battery_low", "leds", "left_steps_s"),
    *("right_steps_s", "base_errors", "base_resets", "overruns", "guard_restarts", "actuators"),
    *("signal_dbm", "bit_rate_mbit_s", "retries", "power_saving", "shown"),
)


def _ms(then_ns: int | None, now_ns: int) -> float | None:
    return None if then_ns is None else round((now_ns - then_ns) / 1e6, 1)


def _trouble(row: Mapping[str, Any], unseen: bool) -> str:
    """The worst trouble of a robot, in words; "" where there is none."""
    if not row["connected"]:
        heard_ms = row["heard_ms"]
        return "not connected" if heard_ms is None else f"link lost for {heard_ms / 1e3:.1f} s"
    if row["doubt"]:
        return str(row["doubt"])
    if row["stop_cause"]:
        return f"stopped: {row['stop_cause']}"
    if row["held"]:
        return f"stands ({row['held']})"
    if unseen:
        age_ms = row["pose_age_ms"]
        return "never seen" if age_ms is None else f"not seen for {age_ms / 1e3:.1f} s"
    if row["battery_low"]:
        return "battery low"
    # A robot with the original client has no session of ours, and TCP alone.
    slow = row["sessions"] and not row["udp"]
    return "no UDP: its readings come over TCP" if slow else ""
