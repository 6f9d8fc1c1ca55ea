"""What a calibration found: for people, for programs, and for the roster."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from vsense.config.roster import RosterRobot
from vsense.lab.hardware import RobotHardware
from vsense.robot_calibration.motion_fit import PARAMETERS, MotionFit
from vsense.terminal import aligned

_NUMBERS: Mapping[str, tuple[str, int]] = {
    "wheel_diameter_mm": ("wheel mm", 2),
    "wheel_ratio": ("ratio", 4),
    "axle_length_mm": ("axle mm", 2),
    "x_mm": ("x mm", 2),
    "y_mm": ("y mm", 2),
    "yaw_deg": ("yaw deg", 2),
}
"""Names as the roster's, with their columns' heads and digits."""

_MARKER = ("x_mm", "y_mm", "yaw_deg")


@dataclass(frozen=True, slots=True)
class RobotResult:
    """One robot of a calibration.

    Attributes:
        name: its own in the experiment.
        fit: what was found; None: it was left out.
        why: it was left out.
        truth: what the lab knows of it; None: it is no lab's, or is as it should be.
        before: what the roster held; None: it has no such robot.
    """

    tag: int
    name: str
    fit: MotionFit | None
    why: str = ""
    truth: RobotHardware | None = None
    before: RosterRobot | None = None

    @property
    def found(self) -> dict[str, float]:
        """The numbers that were found, by the roster's names; none where it was left out."""
        return {} if self.fit is None else _numbers(self.fit)

    @property
    def changes(self) -> dict[str, float]:
        """What was found of wheels and axle over what the roster held, by its names."""
        if self.before is None:
            return {}
        held = self.before.calibration
        return {
            name: value / old
            for name, value in self.found.items()
            if name not in _MARKER and (old := getattr(held, name)) is not None
        }

    def as_json(self) -> dict[str, Any]:
        """All of it; numbers by the roster's names."""
        told: dict[str, Any] = {"tag": self.tag, "name": self.name, "calibrated": bool(self.found)}
        if self.fit is None:
            return {**told, "why": self.why}
        fit = self.fit
        told |= {"found": _rounded(self.found, 6), "sigma": _rounded(fit.sigmas, 6)}
        told["covariance"] = {"of": list(PARAMETERS), "rows": fit.covariance.tolist()}
        told |= {"poses": fit.poses, "rms_mm": round(1000.0 * fit.rms_m, 4)}
        told["rms_deg"] = round(math.degrees(fit.rms_rad), 4)
        if self.truth is not None:
            told["truth"] = _rounded(_true(self.truth), 6)
        if self.changes:
            told["over_roster"] = _rounded(self.changes, 6)
        return told

    def for_roster(self, today: str) -> dict[str, Any]:
        """What `vsense.config.roster.update` takes."""
        found = _rounded(self.found, 4)
        parts = {n: "marker" if n in _MARKER else "calibration" for n in found}
        values: dict[str, Any] = {f"{parts[n]}.{n}": value for n, value in found.items()}
        return values | {"marker.when": today, "calibration.when": today}


def table(results: list[RobotResult]) -> str:
    """The table for people; below what was found stands the truth, where a lab has it."""
    head = ["tag", "robot", *(head for head, _ in _NUMBERS.values()), "left over", "poses"]
    rows = [head]
    for one in (result for result in results if result.fit is not None):
        fit = one.fit
        assert fit is not None
        rest = f"{1000.0 * fit.rms_m:.2f} mm {math.degrees(fit.rms_rad):.2f} deg"
        rows.append([str(one.tag), one.name, *_cells(one.found), rest, str(fit.poses)])
        if one.truth is not None:
            rows.append(["", "  truth", *_cells(_true(one.truth)), "", ""])
    lines = aligned(rows, 2) if len(rows) > 1 else []
    lines += [f"{one.tag} {one.name}: left out: {one.why}" for one in results if one.fit is None]
    return "\n".join(lines)


def worst(results: list[RobotResult]) -> dict[str, float]:
    """The largest errors against a lab's truth; empty where there is none.

    `marker_mm`, `marker_deg`; `distance` and `turn`: shares of a way straight ahead, and of a turn
    on the spot.
    """
    known = [one for one in results if one.fit is not None and one.truth is not None]
    errors: dict[str, float] = {}
    for one in known:
        found, true = one.found, _true(one.truth)  # type: ignore[arg-type]
        off = math.hypot(found["x_mm"] - true["x_mm"], found["y_mm"] - true["y_mm"])
        way = found["wheel_diameter_mm"] / true["wheel_diameter_mm"]
        own = {
            "marker_mm": off,
            "marker_deg": abs(found["yaw_deg"] - true["yaw_deg"]),
            "distance": abs(way - 1.0),
            "turn": abs(way * true["axle_length_mm"] / found["axle_length_mm"] - 1.0),
        }
        errors = {name: max(value, errors.get(name, 0.0)) for name, value in own.items()}
    return errors


def _numbers(fit: MotionFit) -> dict[str, float]:
    wheels = {
        "wheel_diameter_mm": fit.wheel_diameter_mm,
        "wheel_ratio": fit.wheel_ratio,
        "axle_length_mm": 1000.0 * fit.axle_m,
    }
    return wheels | {name: float(fit.marker.values[name]) for name in _MARKER}


def _true(built: RobotHardware) -> dict[str, float]:
    wheels = {
        "wheel_diameter_mm": built.wheel_diameter_mm,
        "wheel_ratio": built.wheel_ratio,
        "axle_length_mm": 1000.0 * built.axle_m,
    }
    return wheels | {name: float(built.marker.values[name]) for name in _MARKER}


def _rounded(values: Mapping[str, float], digits: int) -> dict[str, float]:
    return {name: round(value, digits) for name, value in values.items()}


def _cells(values: Mapping[str, float]) -> list[str]:
    return [f"{values[name]:.{digits}f}" for name, (_, digits) in _NUMBERS.items()]
