"""What a roster may say of a robot: names, and the values that each may have."""

from __future__ import annotations

import ipaddress
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from vsense.base.errors import ConfigError
from vsense.base.native import lib
from vsense.base.toml import Reader, Schema, boolean, integer, matching, real, single_line
from vsense.world.robot_models import EPUCK, RobotModel


@dataclass(frozen=True, slots=True)
class RobotCalibration:
    """What was measured of a robot's wheels and sensors; None: it was not.

    The names are those of vsensed's settings, with a unit where they have one. Scales are as it
    takes them: raw readings LOW:HIGH, one for all sensors or one for each, with commas between.

    Attributes:
        when: the day, or day and time, in ISO 8601; "": not known.
    """

    wheel_diameter_mm: float | None = None
    wheel_ratio: float | None = None
    axle_length_mm: float | None = None
    proximity_scale: str | None = None
    light_scale: str | None = None
    ground_scale: str | None = None
    when: str = ""

    @property
    def settings(self) -> dict[str, str]:
        """An e-puck's settings of vsensed by their names."""
        values = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "when"}
        return {
            name.removesuffix("_mm").replace("_", "-"): _text(value)
            for name, value in values.items()
            if value is not None
        }

    def settings_of(self, model: RobotModel) -> dict[str, str]:
        """The settings of a robot of a model: vsensed takes what an e-puck as far off would have.

        Raises:
            ValueError: vsensed takes none so far off; the message says what was expected.
        """
        _, *nominal = model.ring.span
        return replace(
            self,
            wheel_diameter_mm=_share("wheel_diameter_mm", self, model.diameter_m),
            axle_length_mm=_share("axle_length_mm", self, model.axle_m),
            proximity_scale=_rescaled(self.proximity_scale, model.name, nominal),
        ).settings


@dataclass(frozen=True, slots=True)
class MarkerOffset:
    """Where a robot wears its marker: in its own frame, from the middle of its axle.

    Attributes:
        x_m, y_m: the marker's centre, x forward and y left.
        yaw_rad: where the marker's heading points, counter-clockwise from the robot's.
        when: it was measured, in ISO 8601; "": not known.
    """

    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float = 0.0
    when: str = ""

    @classmethod
    def read(cls, values: Mapping[str, Any]) -> MarkerOffset:
        """Makes it of a roster's values."""
        return cls(
            x_m=values.get("x_mm", 0.0) / 1e3,
            y_m=values.get("y_mm", 0.0) / 1e3,
            yaw_rad=math.radians(values.get("yaw_deg", 0.0)),
            when=values.get("when", ""),
        )

    @property
    def text(self) -> str:
        """For people: x and y in mm, and the heading in degrees."""
        x_mm, y_mm, yaw_deg = self.x_m * 1e3, self.y_m * 1e3, math.degrees(self.yaw_rad)
        return f"{x_mm:+.1f} {y_mm:+.1f} mm {yaw_deg:+.1f}°"

    @property
    def values(self) -> dict[str, float | str]:
        """Makes a roster's values of it."""
        numbers: dict[str, float | str] = {
            "x_mm": round(self.x_m * 1e3, 3),
            "y_mm": round(self.y_m * 1e3, 3),
            "yaw_deg": round(math.degrees(self.yaw_rad), 3),
        }
        return numbers | ({"when": self.when} if self.when else {})


_HEX_32 = matching("[0-9a-fA-F]{32}", 'the 32 hexadecimal digits of vsensed --identify: "0f3a…"')


def _uid(value: Any) -> str:
    return str(_HEX_32(value)).lower()


def _name(value: Any) -> str:
    expected = f"a text without blanks of at most {lib.VS_NAME_MAX} bytes"
    text = str(matching(_SETTING, expected)(value))
    if len(text.encode()) > lib.VS_NAME_MAX:
        raise ValueError(expected)
    return text


def _address(value: Any) -> str:
    try:
        return str(ipaddress.IPv4Address(value if type(value) is str else ""))
    except ValueError:
        raise ValueError('a numeric IPv4 address, such as "192.168.1.10"') from None


_DAY = matching(r"\d{4}-\d\d-\d\d([T ]\d\d:\d\d\S*)?", 'a day, such as "2026-11-23"')


def _when(value: Any) -> str:
    """A text, or one of TOML's own dates."""
    return str(_DAY(value.isoformat() if hasattr(value, "isoformat") else value))


def _spans(count: int, least: int, most: int, words: str) -> Reader:
    """Spans of raw readings; vsensed reads them again (`calibration.c`), and says the same."""
    expected = f'1 or {count} {words} in a text, {least}..{most} and 16 apart, such as "80:1500"'

    def read(value: Any) -> str:
        text = re.sub(r"\s", "", value) if type(value) is str and len(value) <= 1000 else ""
        spans = [re.fullmatch(r"(-?\d{1,4}):(-?\d{1,4})", span) for span in text.split(",")]
        if len(spans) not in (1, count):
            raise ValueError(expected)
        for span in spans:
            low, high = (int(span[1]), int(span[2])) if span else (0, 0)
            if not (least <= low and low + 16 <= high <= most):
                raise ValueError(expected)
        return text

    return read


_SETTING = r"[^\s'\"\\$`#]+"
_BASE = rf"(?!exec:\Z){_SETTING}( {_SETTING})*"

DEFAULTS: Schema = {
    "base": matching(_BASE, 'a base of vsensed, such as "argos:/dev/ttyS0" or "exec:mine.py"'),
    "run_host": _address,
    "port": integer(1, 65535),
    "battery_stop_mv": integer(0, 5000),
    "watchdog": matching(_SETTING, 'a device, such as "/dev/watchdog"'),
}
"""What may stand in [defaults], and of one robot."""

CALIBRATION_FIELDS: Schema = {
    "wheel_diameter_mm": real(1.0, 500.0, " mm"),
    "wheel_ratio": real(0.9, 1.1),
    "axle_length_mm": real(1.0, 2000.0, " mm"),
    "proximity_scale": _spans(8, -4096, 4096, "NOTHING:WALL"),
    "light_scale": _spans(8, -4096, 4096, "DARK:BRIGHT"),
    "ground_scale": _spans(3, 0, 1023, "BLACK:WHITE"),
    "when": _when,
}
"""The ranges are those of `calibration.c`; see `RobotCalibration.settings_of` for lengths."""

MARKER_FIELDS: Schema = {
    "x_mm": real(-50.0, 50.0, " mm"),
    "y_mm": real(-50.0, 50.0, " mm"),
    "yaw_deg": real(-180.0, 180.0, "°"),
    "when": _when,
}

_WHY = 'why in a line, such as "left motor stalls"; without this name it works'

ROBOT_FIELDS: Schema = {
    "tag": integer(0, 65535),
    "host": matching(
        r"(?!-)[A-Za-z0-9_.@:\[\]%-]+", '[user@]host for ssh, such as "root@192.168.1.30"'
    ),
    "uid": _uid,
    "name": _name,
    "model": matching(r"[\w.-]{1,64}", 'a robot model, such as "thymio2"'),
    "spare": boolean,
    "out_of_order": single_line(_WHY),
    **DEFAULTS,
    "calibration": CALIBRATION_FIELDS,
    "marker": MARKER_FIELDS,
}

LAB: Schema = {"defaults": DEFAULTS, "robot": [ROBOT_FIELDS]}
"""What may stand in a roster."""


_OLD_OPTION = re.compile(r"[a-z-]+=\S+")


def refuse_lines(path: Path, text: str) -> None:
    """Says how a list of lines, as robots.txt was, is written now: `host tag=23 base=overo`.

    Raises:
        ConfigError: it is one.
    """
    for number, line in enumerate(text.splitlines(), 1):
        host, *options = line.partition("#")[0].split() or [""]
        tags = [option[4:] for option in options if option.startswith("tag=")]
        if (
            tags
            and tags[0].isdecimal()
            and not set(host) & set("[]=")
            and all(map(_OLD_OPTION.fullmatch, options))
        ):
            words = f'tag = {tags[0]} and host = "{host}", in robots.toml'
            raise ConfigError(
                str(path), number, f"this robot is a table [[robot]] now, with {words}"
            )


_LENGTHS_MM = {"wheel_diameter_mm": (30.0, 50.0), "axle_length_mm": (40.0, 70.0)}
"""What vsensed takes of an e-puck, as `calibration.c` has it."""


_SPAN_MOST, _SPAN_LEAST = 4096, 16
"""What vsensed takes of spans of proximity: their ends, and how far these are apart."""


def _share(name: str, measured: RobotCalibration, nominal_m: float) -> float | None:
    """A length [mm] as an e-puck would have it."""
    value: float | None = getattr(measured, name)
    if value is None:
        return None
    usual_m = {"wheel_diameter_mm": EPUCK.diameter_m, "axle_length_mm": EPUCK.axle_m}[name]
    share = 1.0 if nominal_m == usual_m else usual_m / nominal_m
    least, most = _LENGTHS_MM[name]
    if not least <= value * share <= most:
        raise ValueError(f"{name} = {value:g}: expected {least / share:.4g} to {most / share:.4g}")
    return value * share


def _rescaled(text: str | None, model: str, nominal: Sequence[float]) -> str | None:
    """Spans of proximity as an e-puck would have them, whose readings become `nominal` here."""
    usual = EPUCK.ring.span[1:]
    if text is None or tuple(nominal) == usual:
        return text
    error = f"proximity_scale = {text[:40]!r}: expected"
    if nominal[0] == nominal[1]:
        raise ValueError(f"{error} none: sensors of the model {model} do not see a wall 1 cm ahead")
    spans = []
    for span in text.split(","):
        low, high = map(float, span.split(":"))
        gain = (nominal[1] - nominal[0]) / (high - low)
        nothing = low + (usual[0] - nominal[0]) / gain
        wall = nothing + (usual[1] - usual[0]) / gain
        if max(abs(nothing), abs(wall)) > _SPAN_MOST or wall - nothing < _SPAN_LEAST:
            words = f"{-_SPAN_MOST}..{_SPAN_MOST} and {_SPAN_LEAST} apart as an e-puck's"
            raise ValueError(f"{error} {words}; {span} of {model} are {nothing:.0f}:{wall:.0f}")
        spans.append(f"{nothing:.0f}:{wall:.0f}")
    return ",".join(spans)


def _text(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.10g}"
