"""The file of a robot model: what each table may hold, and what no robot is like.

What the tables mean is said in `vsense.world.robot_models`.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from vsense.base.errors import instead
from vsense.base.native import kernels
from vsense.base.toml import Reader, TomlFile, integer, matching, real

CURVES = ("epuck", "generic", "foot-bot", "distance", "kheperaiv")
"""How infrared sensors respond; the numbers of `enum vs_proximity_curve`."""


def _numbers(least: float, most: float, sizes: Sequence[int]) -> Reader:
    """Reads a list of numbers."""
    number = real(least, most)

    def read(value: Any) -> tuple[float, ...]:
        if not isinstance(value, list) or len(value) not in sizes:
            counts = f"{sizes[0]} to {sizes[-1]}" if len(sizes) > 1 else str(sizes[0])
            raise ValueError(f"a list of {counts} numbers")
        return tuple(number(part) for part in value)

    return read


def _places_of_sensors(value: Any) -> tuple[tuple[int, ...], ...]:
    """Reads for each of an e-puck's sensors which ones stand in for it."""
    number = integer(0, kernels.VS_RING_SENSORS - 1)
    if not isinstance(value, list) or len(value) != kernels.VS_RING_SENSORS:
        raise ValueError(f"{kernels.VS_RING_SENSORS} lists of sensors, for ps0 to ps7")
    if not all(isinstance(part, list) for part in value):
        raise ValueError("lists of sensors, as [[2, 3], [], ...]")
    return tuple(tuple(number(sensor) for sensor in part) for part in value)


def _points(sizes: Sequence[int], axes: str = "x, y") -> Reader:
    """Reads a list of places."""
    point = _numbers(-_MOST_M, _MOST_M, (axes.count(",") + 1,))

    def read(value: Any) -> tuple[tuple[float, ...], ...]:
        if not isinstance(value, list) or len(value) not in sizes:
            raise ValueError(f"a list of {sizes[0]} to {sizes[-1]} places [{axes}]")
        return tuple(point(part) for part in value)

    return read


_MOST_M = 5.0
_LENGTH = real(0.001, _MOST_M, " m")
_SENSORS = range(1, kernels.VS_RING_SENSORS + 1)
_TABLE = range(2, kernels.VS_RING_TABLE_MAX + 1)
_RAW = (0.0, float(kernels.VS_RING_RAW_MAX))
_MANY = range(1, 33)
_AROUND = _numbers(-math.pi, math.pi, _MANY)
_INFRARED: Mapping[str, Reader] = {
    "radius_m": _LENGTH,
    "height_m": _LENGTH,
    "range_m": _LENGTH,
    "curve": matching("|".join(CURVES), f"one of {', '.join(CURVES)}"),
    "angles_rad": _AROUND,
    "places_rad": _AROUND,
    "lines_m": _points(_MANY, "x, y, x, y"),
}
_SCHEMA: Mapping[str, Mapping[str, Reader]] = {
    "body": {
        "radius_m": _LENGTH,
        "height_m": _LENGTH,
        "marker_height_m": real(0.001, 0.99, " m"),
        "mass_kg": real(0.001, 100.0, " kg"),
        "nose_m": _numbers(0.0, _MOST_M, (2,)),
    },
    "wheels": {
        "axle_m": _LENGTH,
        "diameter_m": _LENGTH,
        "steps_per_turn": integer(1, 1_000_000),
        "max_steps_s": integer(1, 32_767),
        "timer_hz": integer(0, 1_000_000),
        "acceleration_m_s2": real(0.0, 1000.0, " m/s2"),
    },
    "ring": {
        "places_m": _points(_SENSORS),
        "headings_deg": _numbers(-360.0, 360.0, _SENSORS),
        "half_cone_deg": real(0.0, 90.0, " degrees"),
        "table_m": _numbers(0.0, _MOST_M, _TABLE),
        "table_raw": _numbers(*_RAW, _TABLE),
        "noise_raw": real(*_RAW),
        "stands_for": _places_of_sensors,
    },
    "leds": {"ring_m": _points(_SENSORS), "front_m": _numbers(-_MOST_M, _MOST_M, (2,))},
    "ground": {"places_m": _points(_MANY)},
    "infrared": _INFRARED,
    "generic": _INFRARED,
    "base_ground": {"places_m": _points(_MANY)},
    "lamps": {"places_m": _points(_MANY, "x, y, z")},
    "radio": {"height_m": _LENGTH, "range_m": real(0.001, 1000.0, " m"), "bytes": integer(1, 16)},
    "camera": {"height_m": _LENGTH, "aperture_deg": real(0.1, 89.0, " degrees")},
}
_WHERE = ("angles_rad", "places_rad", "lines_m")
_OPTIONAL = {
    "body": ("nose_m",), "ring": ("stands_for",), "wheels": ("timer_hz", "acceleration_m_s2"),
    "infrared": _WHERE, "generic": _WHERE,
}  # fmt: skip
"""What tables may lack; only those of `_NEEDED` must be there."""
_NEEDED = ("body", "wheels")
_LIKE: Mapping[str, Reader] = {
    "like": matching("[a-z0-9-]{1,32}", "the name of a shipped model, such as epuck")
}
"""Any table may say instead whose it has."""
_STEPS_MM = (0.12, 0.14)
"""A step is the unit of wheels' speeds everywhere. An e-puck's is 0.1288 mm."""
_BESIDE_M = 0.02
"""Sensors may stick out so far."""


def read_tables(path: Path, text: str, shipped: Path) -> dict[str, dict[str, Any]]:
    """The tables of a model's file, checked; ConfigError with file and line where it is wrong.

    `shipped` is the folder of the models that they may be like.
    """
    file = TomlFile(path, text)
    tables = file.read({name: {**form, **_LIKE} for name, form in _SCHEMA.items()})
    for name in [name for name, table in tables.items() if "like" in table]:
        tables[name] = _table_like(file, name, tables[name], shipped)
    for name, form in _SCHEMA.items():
        if name not in tables and name not in _NEEDED:
            continue
        if name not in tables:
            raise file.error(f"there is no table [{name}]")
        for key in (key for key in form if key not in tables[name]):
            if key not in _OPTIONAL.get(name, ()):
                raise file.error(f"[{name}] lacks {key}", name)
    _check_wheels(file, tables["wheels"], tables["body"]["radius_m"])
    if "ring" in tables:
        _check_ring(file, tables["ring"], tables["body"]["radius_m"])
    for name in {"infrared", "generic"} & tables.keys():
        _check_infrared(file, name, tables[name])
    return tables


def _table_like(
    file: TomlFile, name: str, table: Mapping[str, Any], shipped: Path
) -> dict[str, Any]:
    """The table of a shipped model that one of this file is like; what it says itself counts."""
    path = shipped / f"{table['like']}.toml"
    if path == file.path or not os.path.isfile(path):
        there = instead(table["like"], [p.stem for p in shipped.glob("*.toml")])
        raise file.error(f"there is no shipped model {table['like']!r}; {there}", name, "like")
    lent = read_tables(path, path.read_text(), shipped).get(name)
    if lent is None:
        raise file.error(f"{table['like']} has no [{name}] to be like", name, "like")
    return {**lent, **{key: value for key, value in table.items() if key != "like"}}


def _check_infrared(file: TomlFile, name: str, table: Mapping[str, Any]) -> None:
    """Refuses a ring without a place, and places that do not belong to its angles."""
    angles, places = table.get("angles_rad", ()), table.get("places_rad", ())
    if len(angles) == 0 and "lines_m" not in table:
        raise file.error("expected angles_rad or lines_m", name)
    if places and len(places) != len(angles):
        words = f"has {len(places)} numbers, expected {len(angles)} as angles_rad"
        raise file.error(f"places_rad {words}", name, "places_rad")


def _check_wheels(file: TomlFile, wheels: Mapping[str, Any], radius_m: float) -> None:
    """Refuses wheels that no robot of this size has, and steps that controllers do not count in."""
    step_mm = 1000.0 * wheels["diameter_m"] * math.pi / wheels["steps_per_turn"]
    if not _STEPS_MM[0] <= step_mm <= _STEPS_MM[1]:
        expected = "expected {} to {}, as an e-puck's: a driver converts".format(*_STEPS_MM)
        raise file.error(f"a step of {step_mm:.4g} mm, {expected}", "wheels", "diameter_m")
    if wheels.get("timer_hz") and wheels["timer_hz"] < wheels["max_steps_s"]:
        words = f"timer_hz: {wheels['timer_hz']} makes no {wheels['max_steps_s']} steps a second"
        raise file.error(f"{words}; expected as many at least, or 0", "wheels", "timer_hz")
    if not 0.2 * radius_m <= wheels["axle_m"] <= 2.0 * radius_m:
        least, most = 0.2 * radius_m, 2.0 * radius_m
        words = f"axle_m: expected {least:g} to {most:g} m within this body"
        raise file.error(f"{words}; got {wheels['axle_m']:g}", "wheels", "axle_m")


def _check_ring(file: TomlFile, ring: Mapping[str, Any], radius_m: float) -> None:
    """Refuses lists that do not belong together, sensors elsewhere, and curves that are none."""
    for one, other in (("places_m", "headings_deg"), ("table_m", "table_raw")):
        if len(ring[one]) != len(ring[other]):
            words = f"has {len(ring[other])} numbers, expected {len(ring[one])} as {one}"
            raise file.error(f"{other} {words}", "ring", other)
    there = range(len(ring["places_m"]))
    if any(sensor not in there for part in ring.get("stands_for", ()) for sensor in part):
        words = f"stands_for: expected numbers of sensors, 0 to {there[-1]}"
        raise file.error(words, "ring", "stands_for")
    distances = ring["table_m"]
    if distances[0] != 0.0 or any(b <= a for a, b in pairwise(distances)):
        raise file.error("table_m: expected rising distances from 0", "ring", "table_m")
    if any(b > a for a, b in pairwise(ring["table_raw"])):
        raise file.error("table_raw: expected readings that fall", "ring", "table_raw")
    for place in ring["places_m"]:
        if math.hypot(*place) > radius_m + _BESIDE_M:
            words = f"places_m: {list(place)} is outside of the body of radius {radius_m:g} m"
            raise file.error(words, "ring", "places_m")
