"""What a calibration found: for people, for programs, and for the roster."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vsense.base.arena import Floats
from vsense.base.terminal import aligned
from vsense.config.roster import RosterRobot
from vsense.modes.lab.hardware import RobotHardware, scales
from vsense.tools.robot_calibration._commanding import PROXIMITY
from vsense.tools.robot_calibration._motion_fit import PARAMETERS, MotionFit
from vsense.tools.robot_calibration._sensor_fit import SensorFit
from vsense.world.robot_models import EPUCK, RING_SENSORS

_SENSOR_HEAD = ("sensor", "nothing:wall, black:white, raw", "left over", "wall off", "readings")


def scale_name(name: str) -> str:
    """The roster's name of a sensor's spans."""
    return f"{name}_scale"


def _span_ratio(fit: SensorFit, text: str) -> float:
    """The width of the span that has changed most, over what it was: a scale of the roster."""
    before = np.array([[float(end) for end in span.split(":")] for span in text.split(",")])
    ratios = np.diff(fit.spans)[:, 0] / np.diff(before)[: len(fit.spans), 0]
    return float(ratios[np.argmax(np.abs(ratios - 1.0))])


def _sensor_rows(sensors: Mapping[str, SensorFit], true: Mapping[str, Floats]) -> list[list[str]]:
    """Rows of a table with `_SENSOR_HEAD`; the truth stands below, where a lab has it."""
    rows = []
    for name, fit in sensors.items():
        wall = f"{1000.0 * fit.error_m:+.1f} mm" if name == PROXIMITY else ""
        rest = f"{100.0 * fit.rest:.1f} %" if name == PROXIMITY else ""
        rows.append([name, _spans_text(fit.spans), rest, wall, str(fit.readings)])
        if scale_name(name) in true:
            rows.append(["  truth", _spans_text(true[scale_name(name)]), "", "", ""])
    return rows


def _sensor_errors(
    sensors: Mapping[str, SensorFit], true: Mapping[str, Floats]
) -> dict[str, float]:
    """The largest errors: `proximity_low` and `ground_low` (raw, of nothing and of black), and
    `proximity_width`, `ground_width` (of the spans, as a share)."""
    errors = {}
    for name, fit in sensors.items():
        if (spans := true.get(scale_name(name))) is not None:
            widths = np.diff(fit.spans) / np.diff(spans)
            errors[f"{name}_low"] = float(np.abs(fit.spans[:, 0] - spans[:, 0]).max())
            errors[f"{name}_width"] = float(np.abs(widths - 1.0).max())
    return errors


def _sensors_json(
    sensors: Mapping[str, SensorFit], troubles: Mapping[str, str], true: Mapping[str, Floats]
) -> dict[str, Any]:
    sensors_json: dict[str, Any] = {
        name: {
            "spans": fit.spans.round(2).tolist(),
            "sigma": fit.sigmas.round(2).tolist(),
            "rest": round(fit.rest, 4),
            "wall_off_mm": round(1000.0 * fit.error_m, 3),
            "readings": fit.readings,
            **({"truth": true[key].round(2).tolist()} if (key := scale_name(name)) in true else {}),
        }
        for name, fit in sensors.items()
    }
    sensors_json |= {name: {"why": why} for name, why in troubles.items()}
    return {"sensors": sensors_json} if sensors_json else {}


def _spans_text(spans: Floats) -> str:
    return " ".join(f"{low:.0f}:{high:.0f}" for low, high in spans)


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
        sensors: what was found of them, by name.
        troubles: what was to be found of them and was not, and why, by name.
    """

    tag: int
    name: str
    fit: MotionFit | None
    why: str = ""
    truth: RobotHardware | None = None
    before: RosterRobot | None = None
    sensors: Mapping[str, SensorFit] = field(default_factory=dict)
    troubles: Mapping[str, str] = field(default_factory=dict)

    @property
    def is_whole(self) -> bool:
        """Whether all was found that was to be."""
        return self.fit is not None and not self.troubles

    @property
    def values(self) -> dict[str, float]:
        """The numbers that were found, by the roster's names; none where it was left out."""
        return {} if self.fit is None else _numbers(self.fit)

    @property
    def changes(self) -> dict[str, float]:
        """What was found of wheels, axle and sensors over what the roster held, by its names.

        Of a scale's spans that counts which has changed most.
        """
        if self.before is None:
            return {}
        held = self.before.calibration
        ratios = {
            name: value / old
            for name, value in self.values.items()
            if name not in _MARKER and (old := getattr(held, name)) is not None
        }
        for name, fit in self.sensors.items():
            if (text := getattr(held, scale_name(name))) is not None:
                ratios[scale_name(name)] = _span_ratio(fit, text)
        return ratios

    @property
    def _true_spans(self) -> Mapping[str, Floats]:
        if self.truth is None or self.truth.sensors is None:
            return {}
        return self.truth.sensors.spans(self.truth.model)

    def sensor_rows(self) -> list[list[str]]:
        """Its rows of the sensors' table."""
        rows = _sensor_rows(self.sensors, self._true_spans)
        heads = [[str(self.tag), self.name], *([["", ""]] * len(rows))]
        return [[*head, *row] for head, row in zip(heads, rows)]

    def sensor_errors(self) -> dict[str, float]:
        """How far its sensors are from the lab's truth."""
        return _sensor_errors(self.sensors, self._true_spans)

    def as_json(self) -> dict[str, Any]:
        """All of it; numbers by the roster's names."""
        data: dict[str, Any] = {"tag": self.tag, "name": self.name, "calibrated": bool(self.values)}
        if self.fit is None:
            return {**data, "why": self.why}
        fit = self.fit
        data |= {"found": _rounded(self.values, 6), "sigma": _rounded(fit.sigmas, 6)}
        data["covariance"] = {"of": list(PARAMETERS), "rows": fit.covariance.tolist()}
        data |= {"poses": fit.poses, "rms_mm": round(1000.0 * fit.rms_m, 4)}
        data["rms_deg"] = round(math.degrees(fit.rms_rad), 4)
        if self.truth is not None:
            data["truth"] = _rounded(_numbers(self.truth), 6)
        data |= _sensors_json(self.sensors, self.troubles, self._true_spans)
        if self.changes:
            data["over_roster"] = _rounded(self.changes, 6)
        return data

    def for_roster(self, today: str) -> dict[str, Any]:
        """What `vsense.config.roster.update` takes."""
        numbers = _rounded(self.values, 4)
        parts = {n: "marker" if n in _MARKER else "calibration" for n in numbers}
        values: dict[str, Any] = {f"{parts[n]}.{n}": value for n, value in numbers.items()}
        assert self.fit is not None
        if self.fit.model != EPUCK:
            values = {"model": self.fit.model.name} | values
        spans = {scale_name(name): fit.spans for name, fit in self.sensors.items()}
        if PROXIMITY in self.sensors:
            # vsensed takes a span for each place of an e-puck's ring.
            nominal = np.tile(self.fit.model.ring.span[1:], (RING_SENSORS, 1))
            nominal[: len(self.sensors[PROXIMITY].spans)] = self.sensors[PROXIMITY].spans
            spans[scale_name(PROXIMITY)] = nominal
        values |= {f"calibration.{name}": text for name, text in scales(spans).items()}
        return values | {"marker.when": today, "calibration.when": today}


def table(results: list[RobotResult]) -> str:
    """The table for people; below what was found stands the truth, where a lab has it."""
    head = ["tag", "robot", *(head for head, _ in _NUMBERS.values()), "left over", "poses"]
    rows = [head]
    for result in (result for result in results if result.fit is not None):
        fit = result.fit
        assert fit is not None
        rest = f"{1000.0 * fit.rms_m:.2f} mm {math.degrees(fit.rms_rad):.2f} deg"
        rows.append([str(result.tag), result.name, *_cells(result.values), rest, str(fit.poses)])
        if result.truth is not None:
            rows.append(["", "  truth", *_cells(_numbers(result.truth)), "", ""])
    lines = aligned(rows, 2) if len(rows) > 1 else []
    rows = [row for result in results for row in result.sensor_rows()]
    if rows:
        lines += ["", *aligned([["tag", "robot", *_SENSOR_HEAD], *rows], 2)]
    lines += [
        f"{result.tag} {result.name}: left out: {result.why}"
        for result in results
        if result.fit is None
    ]
    lines += [
        f"{result.tag} {result.name}: {name}: {why}"
        for result in results
        if result.fit is not None
        for name, why in result.troubles.items()
    ]
    return "\n".join(lines)


def worst(results: list[RobotResult]) -> dict[str, float]:
    """The largest errors against a lab's truth; empty where there is none.

    `marker_mm`, `marker_deg`; `distance` and `turn`: shares of a way straight ahead, and of a turn
    on the spot; and those of `_sensor_errors`.
    """
    compared = [result for result in results if result.fit is not None and result.truth is not None]
    errors: dict[str, float] = {}
    for result in compared:
        fitted, true = result.values, _numbers(result.truth)  # type: ignore[arg-type]
        off = math.hypot(fitted["x_mm"] - true["x_mm"], fitted["y_mm"] - true["y_mm"])
        way = fitted["wheel_diameter_mm"] / true["wheel_diameter_mm"]
        own = {
            "marker_mm": off,
            "marker_deg": abs(fitted["yaw_deg"] - true["yaw_deg"]),
            "distance": abs(way - 1.0),
            "turn": abs(way * true["axle_length_mm"] / fitted["axle_length_mm"] - 1.0),
        }
        own |= result.sensor_errors()
        errors |= {name: max(value, errors.get(name, 0.0)) for name, value in own.items()}
    return errors


def _numbers(of: MotionFit | RobotHardware) -> dict[str, float]:
    """What was found or is true, by the roster's names."""
    wheels = {
        "wheel_diameter_mm": of.wheel_diameter_mm,
        "wheel_ratio": of.wheel_ratio,
        "axle_length_mm": 1000.0 * of.axle_m,
    }
    return wheels | {name: float(of.marker.values[name]) for name in _MARKER}


def _rounded(values: Mapping[str, float], digits: int) -> dict[str, float]:
    return {name: round(value, digits) + 0.0 for name, value in values.items()}  # no "-0.0"


def _cells(values: Mapping[str, float]) -> list[str]:
    return [f"{values[name]:.{digits}f}" for name, (_, digits) in _NUMBERS.items()]
