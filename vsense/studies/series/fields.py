"""What a plan may say: names, and the values that each may have."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from vsense.base.errors import ConfigError, instead
from vsense.run.runs_csv import MODES

Reader = Callable[[Any], Any]
"""Gives what a value means; ValueError with what was expected."""


def _whole(least: int, most: int) -> Reader:
    def read(value: Any) -> int:
        if type(value) is not int or not least <= value <= most:
            raise ValueError(f"a whole number from {least} to {most}")
        return value

    return read


def _number(least: float, most: float, what: str = "") -> Reader:
    def read(value: Any) -> float:
        if type(value) not in (int, float) or not least <= value <= most:
            raise ValueError(f"a number from {least:g} to {most:g}{what}")
        return float(value)

    return read


def _flag(value: Any) -> bool:
    if type(value) is not bool:
        raise ValueError("true or false")
    return value


def _text(value: Any) -> str:
    if type(value) is not str or not value.strip() or not value.isprintable():
        raise ValueError("a text on one line")
    return value.strip()


def _name(value: Any) -> str:
    if type(value) is not str or not re.fullmatch(r"\w[\w.+-]*", value) or len(value) > 60:
        raise ValueError("letters, digits and . _ + -, at most 60 of them")
    return value


def _mode(value: Any) -> str:
    if value not in MODES:
        raise ValueError(f"one of {', '.join(MODES)}")
    return str(value)


def _poses(value: Any) -> tuple[tuple[float, float, float], ...]:
    expected = "a list of [x in m, y in m, heading in degrees], one for each robot"
    if not isinstance(value, list) or not value:
        raise ValueError(expected)
    found = []
    for pose in value:
        is_pose = isinstance(pose, list) and len(pose) == 3
        if not is_pose or not all(type(n) in (int, float) and abs(n) < 1e4 for n in pose):
            raise ValueError(expected)
        found.append((float(pose[0]), float(pose[1]), math.radians(pose[2])))
    return tuple(found)


def _any(value: Any) -> Any:
    return value


SEED = _whole(1, 2**32 - 1)

PLAN: Mapping[str, Reader] = {
    "name": _name,
    "mode": _mode,
    "experiment": _text,
    "duration_s": _number(0.1, 1e7, " s"),
    "repetitions": _whole(1, 10_000),
    "seed": SEED,
    "again": _whole(0, 1000),
    **dict.fromkeys(("settings", "condition", "start", "void", "robots"), _any),
}
CONDITION: Mapping[str, Reader] = {
    "name": _text,
    "experiment": _text,
    "controller": _text,
    "blind": _flag,
    "settings": _any,
}
START: Mapping[str, Reader] = {"name": _name, "seed": SEED, "poses": _poses}
VOID: Mapping[str, Reader] = {
    "lost_s": _number(0.1, 1e6, " s"),
    "moved_mm": _number(5.0, 1e4, " mm"),
    "late": _number(0.0, 1.0, ", a share"),
    "ended_early": _flag,
    "away_from_start": _flag,
}
ROBOTS: Mapping[str, Reader] = {
    "count": _whole(1, 10_000),
    "battery_v": _number(0.0, 10.0, " V"),
    "least": _whole(1, 10_000),
    "ready_s": _number(1.0, 1e5, " s"),
    "home": _flag,
    "virtual_walls": _flag,
}


class PlanText:
    """The text of a plan, in which errors name lines."""

    def __init__(self, path: Path, text: str) -> None:
        self._path, self._lines = path, text.splitlines()

    def line(self, table: str, number: int | None = None, key: str = "") -> int:
        """Where something stands, counted from 1; `number` is that of a table among many."""
        inside, seen = not table, -1
        found = 1
        for place, line in enumerate(self._lines, 1):
            head = re.match(r"\s*\[+\s*([\w.]+)\s*\]+", line)
            if head is not None and not table:
                if head[1] == key:
                    return place
                inside = False
            elif head is not None:
                seen += head[1] == table
                below = inside and head[1].startswith(f"{table}.")
                inside = below or (head[1] == table and seen == (number or 0))
                found = place if inside and not below else found
            elif inside and key and re.match(rf"\s*['\"]?{re.escape(key)}['\"]?\s*=", line):
                return place
        return found

    def error(self, table: str, number: int | None, key: str, words: str) -> ConfigError:
        """The error that something cannot be."""
        return ConfigError(str(self._path), self.line(table, number, key), words)

    def table(
        self, name: str, number: int | None, given: Any, readers: Mapping[str, Reader]
    ) -> dict[str, Any]:
        """Reads the values of a table; `number` is that among many of its name.

        Raises:
            ConfigError: a name is not known, or a value cannot be.
        """
        if not isinstance(given, dict):
            raise self.error("", None, name, f"{name}: expected a table [{name}]")
        found = {}
        for key, value in given.items():
            if key not in readers:
                raise self.error(name, number, key, f"{key}: not known; {instead(key, readers)}")
            try:
                found[key] = readers[key](value)
            except ValueError as error:
                words = f"{key}: expected {error}, got {value!r}"
                raise self.error(name, number, key, words[:300]) from None
        return found
