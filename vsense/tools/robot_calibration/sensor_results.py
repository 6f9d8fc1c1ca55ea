"""What a calibration found of sensors: parts of `results`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from vsense.tools.robot_calibration.commanding import PROXIMITY
from vsense.tools.robot_calibration.sensor_fit import Floats, SensorFit

HEAD = ("sensor", "nothing:wall, black:white, raw", "left over", "wall off", "readings")


def scale_name(name: str) -> str:
    """The roster's name of a sensor's spans."""
    return f"{name}_scale"


def over(fit: SensorFit, text: str) -> float:
    """The width of the span that has changed most, over what it was: a scale of the roster."""
    before = np.array([[float(end) for end in span.split(":")] for span in text.split(",")])
    ratios = np.diff(fit.spans)[:, 0] / np.diff(before)[:, 0]
    return float(ratios[np.argmax(np.abs(ratios - 1.0))])


def rows(sensors: Mapping[str, SensorFit], true: Mapping[str, Floats]) -> list[list[str]]:
    """Rows of a table with `HEAD`; below what was found stands the truth, where a lab has it."""
    found = []
    for name, fit in sensors.items():
        wall = f"{1000.0 * fit.error_m:+.1f} mm" if name == PROXIMITY else ""
        rest = f"{100.0 * fit.rest:.1f} %" if name == PROXIMITY else ""
        found.append([name, _text(fit.spans), rest, wall, str(fit.readings)])
        if scale_name(name) in true:
            found.append(["  truth", _text(true[scale_name(name)]), "", "", ""])
    return found


def errors(sensors: Mapping[str, SensorFit], true: Mapping[str, Floats]) -> dict[str, float]:
    """The largest errors: `proximity_low` and `ground_low` (raw, of nothing and of black), and
    `proximity_width`, `ground_width` (of the spans, as a share)."""
    told = {}
    for name, fit in sensors.items():
        if (spans := true.get(scale_name(name))) is not None:
            widths = np.diff(fit.spans) / np.diff(spans)
            told[f"{name}_low"] = float(np.abs(fit.spans[:, 0] - spans[:, 0]).max())
            told[f"{name}_width"] = float(np.abs(widths - 1.0).max())
    return told


def as_json(
    sensors: Mapping[str, SensorFit], troubles: Mapping[str, str], true: Mapping[str, Floats]
) -> dict[str, Any]:
    """What `calibration.json` has of a robot's sensors."""
    told: dict[str, Any] = {
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
    told |= {name: {"why": why} for name, why in troubles.items()}
    return {"sensors": told} if told else {}


def _text(spans: Floats) -> str:
    return " ".join(f"{low:.0f}:{high:.0f}" for low, high in spans)
