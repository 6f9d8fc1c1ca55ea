"""The spec of the `atoms` process: where everything in the lab stands at first."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.errors import UsageError

_POSE = ("x_m", "y_m", "yaw_rad")
_SIZE = ("size_x_m", "size_y_m")


@dataclass(frozen=True, slots=True)
class AtomsSpec:
    """A lab's floor at the start.

    Attributes:
        robots: (m, 3) x_m, y_m, yaw_rad by robot index, arena frame.
        bases: what each robot is based on, of `vsense.lab.bases.KINDS`.
        objects: (k, 3) likewise of tagged bodies that never move.
        boxes: (b, 5) x_m, y_m, yaw_rad, size_x_m, size_y_m of walls and boxes.
        cylinders: (c, 3) x_m, y_m, radius_m of what stands and is round.
        truth: name of the truth ring.
        log: path of the actuation log.
        directory: run directory.
        seed: seed of the sensors' noise.
    """

    robots: NDArray[np.float64]
    bases: list[str]
    objects: NDArray[np.float64]
    boxes: NDArray[np.float64]
    cylinders: NDArray[np.float64]
    truth: str
    log: Path
    directory: Path
    seed: int

    @classmethod
    def parse(cls, line: bytes) -> AtomsSpec:
        """Reads a spec from one line of JSON; see `vsense.lab.atoms`.

        Raises:
            UsageError: what is wrong, and where in the spec.
        """
        try:
            spec = json.loads(line)
        except ValueError as error:
            raise UsageError(f"spec: not JSON: {error}") from None
        if not isinstance(spec, dict):
            raise UsageError(f"spec: expected an object, not {spec!r}")
        robots = _rows(spec, "robots", ("index", "tag", *_POSE))
        order = np.argsort(robots[:, 0])
        if not np.array_equal(robots[order, 0], np.arange(len(robots))):
            found = [int(index) for index in robots[:, 0]]
            raise UsageError(f"spec: robots: expected indices 0..{len(robots) - 1}, not {found}")
        boxes = _rows(spec, "boxes", (*_POSE, *_SIZE))
        if (boxes[:, 3:] <= 0.0).any():
            raise UsageError("spec: boxes: expected sizes above 0")
        cylinders = _rows(spec, "cylinders", ("x_m", "y_m", "radius_m"))
        if (cylinders[:, 2] <= 0.0).any():
            raise UsageError("spec: cylinders: expected radii above 0")
        return cls(
            robots[order, 2:],
            _bases(spec, len(robots)),
            _rows(spec, "objects", ("tag", *_POSE))[:, 1:],
            boxes,
            cylinders,
            _text(spec, "truth"),
            Path(_text(spec, "log")),
            Path(_text(spec, "directory")),
            int(_number(spec, "seed", "spec: ")),
        )


def _bases(spec: dict[str, Any], count: int) -> list[str]:
    bases = spec.get("bases")
    if not isinstance(bases, list) or len(bases) != count:
        raise UsageError(f"spec: bases: expected a list of {count} texts, not {bases!r}")
    return [str(base) for base in bases]


def _rows(spec: dict[str, Any], name: str, fields: tuple[str, ...]) -> NDArray[np.float64]:
    """The numbers (n, fields) of a list of objects."""
    entries = spec.get(name)
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise UsageError(f"spec: {name}: expected a list of objects, not {entries!r}")
    rows = [
        [_number(entry, field, f"spec: {name}[{number}].") for field in fields]
        for number, entry in enumerate(entries)
    ]
    return np.array(rows, dtype=np.float64).reshape(len(rows), len(fields))


def _number(entry: dict[str, Any], field: str, where: str) -> float:
    value = entry.get(field)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise UsageError(f"{where}{field}: expected a finite number, not {value!r}")
    return value


def _text(spec: dict[str, Any], name: str) -> str:
    value = spec.get(name)
    if not isinstance(value, str) or not value:
        raise UsageError(f"spec: {name}: expected a text, not {value!r}")
    return value
