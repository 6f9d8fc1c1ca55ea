"""The spec of the lab's physics process, read from one line of JSON; see `physics_process`."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.base.errors import UsageError
from vsense.modes.lab._real_sensors import SensorHardware, read_sensors
from vsense.world.physics.motion import WheelNoise
from vsense.world.robot_models import RobotModel, read_model

POSE_COLUMNS = ("x_m", "y_m", "yaw_rad")
BOX = (*POSE_COLUMNS, "size_x_m", "size_y_m")
CYLINDER = ("x_m", "y_m", "radius_m")


@dataclass(frozen=True, slots=True)
class PhysicsSpec:
    """The process's spec; bodies as `Physics` takes them, robots by index.

    `bases` are of `vsense.modes.lab.hardware.BASE_KINDS`; `seed` is that of the sensors' noise;
    `watchdog` as in `Microcontrollers`.
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
    watchdog: bool = False
    wheels: tuple[WheelNoise | None, ...] = ()
    permille: int = 1000
    built: NDArray[np.float64] | None = None
    sensors: Sequence[SensorHardware] = ()
    black: Sequence[Sequence[float]] = ()
    models: Sequence[RobotModel] = ()

    @classmethod
    def parse(cls, line: bytes) -> PhysicsSpec:
        """Reads a spec from one line of JSON; UsageError says what is wrong, and where."""
        try:
            spec = json.loads(line)
        except ValueError as error:
            raise UsageError(f"spec: not JSON: {error}") from None
        if not isinstance(spec, dict):
            raise UsageError(f"spec: expected an object, not {spec!r}")
        robots = _rows(spec, "robots", ("index", "tag", *POSE_COLUMNS))
        order = np.argsort(robots[:, 0])
        if not np.array_equal(robots[order, 0], np.arange(len(robots))):
            indices = [int(index) for index in robots[:, 0]]
            raise UsageError(f"spec: robots: expected indices 0..{len(robots) - 1}, not {indices}")
        boxes = _rows(spec, "boxes", BOX)
        if (boxes[:, 3:] <= 0.0).any():
            raise UsageError("spec: boxes: expected sizes above 0")
        cylinders = _rows(spec, "cylinders", CYLINDER)
        if (cylinders[:, 2] <= 0.0).any():
            raise UsageError("spec: cylinders: expected radii above 0")
        return cls(
            robots[order, 2:],
            _bases(spec, len(robots)),
            _rows(spec, "objects", ("tag", *POSE_COLUMNS))[:, 1:],
            boxes,
            cylinders,
            _text(spec, "truth"),
            Path(_text(spec, "log")),
            Path(_text(spec, "directory")),
            int(read_number(spec, "seed", "spec: ")),
            spec.get("watchdog") is True,
            _wheels(spec, len(robots)),
            int(read_number(spec, "permille", "spec: ")) if "permille" in spec else 1000,
            _built(spec, len(robots)),
            read_sensors(spec["sensors"], len(robots)) if "sensors" in spec else (),
            _black(spec),
            [read_model(Path(file)) for file in spec.get("models", ())],
        )


def _bases(spec: dict[str, Any], count: int) -> list[str]:
    bases = spec.get("bases")
    if not isinstance(bases, list) or len(bases) != count:
        raise UsageError(f"spec: bases: expected a list of {count} texts, not {bases!r}")
    return [str(base) for base in bases]


def _wheels(spec: dict[str, Any], count: int) -> tuple[WheelNoise | None, ...]:
    noises = spec.get("wheels", [None] * count)
    fields = set(asdict(WheelNoise()))
    if not isinstance(noises, list) or len(noises) != count:
        raise UsageError(f"spec: wheels: expected a list of {count}, not {noises!r}")
    for noise in noises:
        if noise is not None and (not isinstance(noise, dict) or set(noise) != fields):
            raise UsageError(f"spec: wheels: expected null or an object of {sorted(fields)}")
    return tuple(None if noise is None else WheelNoise(**noise) for noise in noises)


def _built(spec: dict[str, Any], count: int) -> NDArray[np.float64] | None:
    if "built" not in spec:
        return None
    names = ("left", "right", "axle_m")
    rows = spec["built"]
    right = isinstance(rows, list) and len(rows) == count
    if not right or not all(isinstance(row, list) and len(row) == len(names) for row in rows):
        raise UsageError(f"spec: built: expected {', '.join(names)} of {count} robots")
    entries = [dict(zip(names, row)) for row in rows]
    table = _rows({"built": entries}, "built", names)
    if (table <= 0.0).any():
        raise UsageError("spec: built: expected numbers above 0")
    return table


def _black(spec: dict[str, Any]) -> list[list[float]]:
    """Discs, as numbers: x_m, y_m, radius_m."""
    rows = spec.get("black", [])
    if not isinstance(rows, list) or not all(isinstance(r, list) and len(r) == 3 for r in rows):
        raise UsageError(f"spec: black: expected a list of x_m, y_m, radius_m, not {rows!r}")
    entries = [dict(zip(CYLINDER, row)) for row in rows]
    discs: list[list[float]] = _rows({"black": entries}, "black", CYLINDER).tolist()
    return discs


def _rows(spec: dict[str, Any], name: str, fields: tuple[str, ...]) -> NDArray[np.float64]:
    """The numbers (n, fields) of a list of objects."""
    entries = spec.get(name)
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise UsageError(f"spec: {name}: expected a list of objects, not {entries!r}")
    rows = [
        [read_number(entry, field, f"spec: {name}[{number}].") for field in fields]
        for number, entry in enumerate(entries)
    ]
    return np.array(rows, dtype=np.float64).reshape(len(rows), len(fields))


def read_number(entry: dict[str, Any], field: str, where: str) -> float:
    """Reads a number of an object, which `where` names; UsageError if it is none."""
    value = entry.get(field)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise UsageError(f"{where}{field}: expected a finite number, not {value!r}")
    return value


def _text(spec: dict[str, Any], name: str) -> str:
    value = spec.get(name)
    if not isinstance(value, str) or not value:
        raise UsageError(f"spec: {name}: expected a text, not {value!r}")
    return value
