"""What a robot is: its body, wheels and sensors, read from `models/NAME.toml`.

Nothing else knows a robot's number. An experiment says `vs:model="NAME"`; a file of that name
beside the `.argos` file comes before the shipped ones. Lengths are in m, in the robot's frame: x
forward, y left, from the middle between its wheels on the floor; angles are counter-clockwise from
straight ahead.

    [body] radius_m, height_m, marker_height_m, mass_kg; nose_m: how far ahead what lines of sight
        meet and bodies do not sits, and its radius; none by default
    [wheels] axle_m, diameter_m, steps_per_turn, max_steps_s; timer_hz: steppers make a step every
        whole number of such ticks, 0 (default): any speed; acceleration_m_s2 of a wheel, 0
        (default): at once
    [ring] its own proximity sensors, up to 8, in the order in which controllers get them: places_m,
        headings_deg, half_cone_deg, table_m and table_raw (readings of a surface ahead; the last is
        that of nothing), noise_raw; stands_for, where the ring is not an e-puck's: for ps0 to ps7
        the sensors (from 0) of which controllers get the greatest reading there, [] none
    [ground] places_m of its ground sensors
    [leds] ring_m: places of bits 0 to 7; front_m: of bit 9

What follows is for virtual devices, and the e-puck's where a file lacks the table:

    [infrared] the ring of proximity and light sensors: radius_m, height_m; range_m and curve, see
        `vsense.world.sensors.proximity`; angles_rad that controllers are told, places_rad where
        they sit and look, by default the same; or lines_m of rangefinders, from x, y to x, y
    [generic] that of ARGoS's <proximity>, where it is another one: likewise
    [base_ground] places_m of further ones
    [lamps] places_m, x, y, z, of single LEDs that virtual cameras see
    [radio] of range-and-bearing messages: height_m, range_m, bytes
    [camera] omnidirectional: height_m, aperture_deg from its axis
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Point
from vsense.base.errors import UsageError, instead
from vsense.base.files import PACKAGE_FOLDER
from vsense.base.native import kernels
from vsense.base.toml import read_toml_text
from vsense.world._model_file import CURVES, read_tables

MODEL_SUFFIX = ".toml"
MODELS_FOLDER = PACKAGE_FOLDER / "world" / "models"
_NAME = re.compile(r"[\w.-]{1,64}")
_WALL_M, _SATURATED_RAW = 0.01, 4000.0
RING_SENSORS = kernels.VS_RING_SENSORS
"""Proximity sensors that the wire has room for."""


@dataclass(frozen=True, slots=True)
class RingModel:
    """A robot's own proximity sensors, by default none; see the module."""

    places_m: tuple[Point, ...] = ()
    headings_deg: tuple[float, ...] = ()
    half_cone_deg: float = 0.0
    table_m: tuple[float, ...] = (0.0,)
    table_raw: tuple[float, ...] = (0.0,)
    noise_raw: float = 0.0
    stands_for: tuple[tuple[int, ...], ...] = ()

    @property
    def headings_rad(self) -> NDArray[np.float64]:
        """Where the sensors look, (k,)."""
        angles: NDArray[np.float64] = np.radians(np.array(self.headings_deg))
        return angles

    @property
    def span(self) -> tuple[float, float, float]:
        """Between what raw readings it is calibrated: how far a white wall is [m], 1 cm where no
        reading is at its end there; what is read of nothing, and of this wall."""
        near = [m for m, raw in zip(self.table_m, self.table_raw) if raw < _SATURATED_RAW]
        wall_m = max(_WALL_M, near[0] if near else _WALL_M)
        wall_raw = float(np.interp(wall_m, self.table_m, self.table_raw))
        return wall_m, self.table_raw[-1], wall_raw


@dataclass(frozen=True, slots=True)
class InfraredModel:
    """Sensors around the body; see the module."""

    radius_m: float
    height_m: float
    range_m: float
    curve: str
    angles_rad: tuple[float, ...] = ()
    places_rad: tuple[float, ...] = ()
    lines_m: tuple[tuple[float, ...], ...] = ()


@dataclass(frozen=True, slots=True)
class LedModel:
    """Where a robot's LEDs are, seen from above."""

    ring_m: tuple[Point, ...] = ()
    front_m: Point = (0.0, 0.0)


@dataclass(frozen=True, slots=True)
class RadioModel:
    """What says and hears range-and-bearing messages."""

    height_m: float
    range_m: float
    bytes: int


@dataclass(frozen=True, slots=True)
class CameraModel:
    """An omnidirectional camera."""

    height_m: float
    aperture_deg: float


@dataclass(frozen=True, slots=True)
class RobotModel:
    """A kind of robot; see the module.

    Attributes:
        file: where it was read.
        step_m: way of a wheel per motor step.
    """

    file: Path
    radius_m: float
    height_m: float
    marker_height_m: float
    mass_kg: float
    axle_m: float
    diameter_m: float
    steps_per_turn: int
    max_steps_s: int
    infrared: InfraredModel
    generic: InfraredModel
    radio: RadioModel
    camera: CameraModel
    ground_m: tuple[Point, ...]
    lamps_m: tuple[tuple[float, ...], ...]
    base_ground_m: tuple[Point, ...] = ()
    timer_hz: int = 0
    acceleration_m_s2: float = 0.0
    nose_m: tuple[float, ...] = (0.0, 0.0)
    ring: RingModel = RingModel()
    leds: LedModel = LedModel()

    @property
    def name(self) -> str:
        """What experiments call it."""
        return self.file.stem

    @property
    def step_m(self) -> float:
        return self.diameter_m * math.pi / self.steps_per_turn

    @property
    def v_max_m_s(self) -> float:
        """Fastest speed that its wheels can be told."""
        return self.max_steps_s * self.step_m

    @property
    def reach_m(self) -> float:
        """How far from its middle something may be that it touches or feels."""
        return self.radius_m + self.ring.table_m[-1] + _CLOSE_M

    def motor_speed(self, steps_s: float) -> float:
        """The speed [step/s] at which a motor turns when it is commanded `steps_s`."""
        commanded = min(int(abs(steps_s)), self.max_steps_s)
        if commanded == 0 or self.timer_hz == 0:
            return math.copysign(commanded, steps_s)
        return math.copysign(self.timer_hz / (self.timer_hz // commanded), steps_s)


WHEELS = ("axle_m", "diameter_m", "steps_per_turn", "max_steps_s", "timer_hz")
"""What decides how a robot drives as it is told to."""

_CLOSE_M = 0.005
"""More than bodies can close in a tick."""


def model_of(name: str, folder: Path | None = None) -> RobotModel:
    """The model of a name: a file in `folder`, or a shipped one.

    Raises:
        UsageError: there is none of this name, or its file cannot be read.
        ConfigError: the file is wrong; the error names file, line, value and expectation.
    """
    known = shipped_models()
    if not _NAME.fullmatch(name):
        raise UsageError(f"{name[:40]!r} is no name of a robot model; {instead(name[:40], known)}")
    own = None if folder is None else folder / f"{name}{MODEL_SUFFIX}"
    if own is not None and os.path.lexists(own):
        return read_model(own)
    if name not in known:
        there = instead(name, [*known, *([] if folder is None else models_in(folder))])
        raise UsageError(f"there is no robot model {name!r}; {there}")
    return read_model(MODELS_FOLDER / f"{name}{MODEL_SUFFIX}")


@cache
def shipped_models() -> tuple[str, ...]:
    """The names of the models that come with vsense."""
    return tuple(models_in(MODELS_FOLDER))


def models_in(folder: Path) -> list[str]:
    """Names of the files in a folder that may be models: rosters and plans have no wheels."""
    files = [file for file in sorted(folder.glob(f"*{MODEL_SUFFIX}")) if os.path.isfile(file)]
    return [file.stem for file in files if "[wheels]" in file.read_text(errors="replace")]


def read_model(path: Path) -> RobotModel:
    """The model of a file as it is now; raises as `model_of`."""
    return _read(path, read_toml_text(path))


_PARTS: Mapping[str, Callable[..., Any]] = {
    "ring": RingModel, "leds": LedModel, "infrared": InfraredModel, "generic": InfraredModel,
    "radio": RadioModel, "camera": CameraModel,
}  # fmt: skip
_PLACES = ("ground", "base_ground", "lamps")
_USUAL = MODELS_FOLDER / f"epuck{MODEL_SUFFIX}"
_LENT = ("infrared", "generic", "radio", "camera", "ground_m", "lamps_m")
"""What a model has of `_USUAL`, where its file says nothing else."""


@cache
def _read(path: Path, text: str) -> RobotModel:
    tables = read_tables(path, text, MODELS_FOLDER)
    known = {name: make(**tables[name]) for name, make in _PARTS.items() if name in tables}
    known |= {f"{name}_m": tables[name]["places_m"] for name in _PLACES if name in tables}
    if "infrared" in known:
        known.setdefault("generic", replace(known["infrared"], curve=CURVES[1]))
    if path != _USUAL:
        known = _lent(tables["body"]["radius_m"], tables["body"]["height_m"]) | known
    return RobotModel(file=path, **tables["body"], **tables["wheels"], **known)


def _lent(radius_m: float, height_m: float) -> dict[str, Any]:
    """What an e-puck has, on a body of another size: rings as far outside of it."""
    usual = read_model(_USUAL)
    lent = {name: getattr(usual, name) for name in _LENT}
    for name in ("infrared", "generic") if radius_m != usual.radius_m else ():
        ring: InfraredModel = lent[name]
        lent[name] = replace(
            ring,
            radius_m=radius_m + (ring.radius_m - usual.radius_m),
            height_m=min(ring.height_m, height_m),
        )
    return lent


EPUCK = read_model(_USUAL)
"""What a robot is unless a file says otherwise, and what a tagged object's body is like."""
