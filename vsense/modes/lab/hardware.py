"""What the lab's robots differ in: wheels, axles, sensors, and markers that were put on by hand.

Each is drawn by its tag and a seed of its own: the robot with a marker is the same one in every
experiment and run, as in a real lab, until another seed buys new robots.

A robot's radio is emulated, too: the real `vsensed` reads it from a file that looks like
`/proc/net/wireless` (the kernel's net/wireless/wext-proc.c); below the table stands what a board
says by ioctls. No packet is lost or late for it: that is the network's.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from vsense.base.arena import Floats, turned
from vsense.base.errors import UsageError
from vsense.config.roster_fields import MarkerOffset
from vsense.config.specs import Experiment
from vsense.modes.lab._real_sensors import SensorHardware, draw_sensors
from vsense.world.robot_models import EPUCK, RobotModel

BASE_KINDS = ("argos", "asercom", "gctronic", "york", "exec", "wifi")
"""The names of `vsensed --base`."""

MIXED = "mixed"
"""One kind after the other."""

BASES = (*BASE_KINDS, MIXED)

_EMULATED = {**{kind: kind for kind in (*BASE_KINDS, "thymio", "ros2")}, "epuck": "exec"}
"""What the lab makes of a roster's base, or shipped driver."""


def bases_of(name: str | None, types: Sequence[str]) -> list[str]:
    """The kind of base of each robot, of `vsense.modes.lab._links.PROGRAMS`.

    Args:
        name: of `BASES`; None: as the roster says, and else the first of `BASES`.
        types: of each robot, what the roster says, as `Casting.types`; "": nothing.

    Raises:
        UsageError: `name` is none of them.
    """
    if name is None:
        return [_EMULATED.get(kind, BASES[0]) for kind in types]
    if name not in BASES:
        raise UsageError(f"no base {name!r} in the lab: expected one of {', '.join(BASES)}")
    kinds = BASE_KINDS if name == MIXED else (name,)
    return [kinds[robot % len(kinds)] for robot in range(len(types))]


_MOST_RATIO = 1.095
"""Of two wheels: what `vsensed` can be told ends at 1.1."""


@dataclass(frozen=True, slots=True)
class HardwareErrors:
    """How far robots may be off, each up to so much both ways; all 0: none is.

    Attributes:
        marker_m, marker_rad: a marker's centre, in any direction, and its heading.
        wheel: each wheel's diameter, and the axle's length, as a share.
        sensor: each sensor's sensitivity, as a share; see `draw_sensors`.
        seed: of the draw.
    """

    marker_m: float = 0.0
    marker_rad: float = 0.0
    wheel: float = 0.0
    seed: int = 0
    sensor: float = 0.0

    @property
    def any(self) -> bool:
        """Whether anything is drawn."""
        return max(self.marker_m, self.marker_rad, self.wheel, self.sensor) > 0.0


@dataclass(frozen=True, slots=True)
class RobotHardware:
    """How one robot is built.

    Attributes:
        left, right: way of a wheel over that of the nominal one.
        axle_m: distance of the wheels.
        sensors: how they are; None: nominal.
    """

    marker: MarkerOffset
    left: float
    right: float
    axle_m: float
    sensors: SensorHardware | None = None
    model: RobotModel = EPUCK

    @property
    def wheel_diameter_mm(self) -> float:
        """The mean of both wheels."""
        return (1000.0 * self.model.diameter_m) * (self.left + self.right) / 2.0

    @property
    def wheel_ratio(self) -> float:
        """The right wheel over the left one."""
        return self.right / self.left

    def report(self) -> dict[str, Any]:
        """What reports and recordings say of it, by the roster's names."""
        return {
            "wheel_diameter_mm": round(self.wheel_diameter_mm, 4),
            "wheel_ratio": round(self.wheel_ratio, 6),
            "axle_length_mm": round(1000.0 * self.axle_m, 4),
            "marker": self.marker.values,
            **({} if self.sensors is None else scales(self.sensors.spans(self.model))),
        }

    def for_physics(self) -> list[float]:
        """What the lab's physics process is told."""
        return [self.left, self.right, self.axle_m]


def scales(spans: Mapping[str, Floats]) -> dict[str, str]:
    """Spans (n, 2) of raw readings as the roster has them: "67:1466,..."."""
    return {
        name: ",".join(f"{low:.0f}:{high:.0f}" for low, high in rows)
        for name, rows in spans.items()
    }


def draw(tag: int, errors: HardwareErrors, model: RobotModel = EPUCK) -> RobotHardware:
    """Draws the robot with a tag, of a model."""
    random = np.random.default_rng([errors.seed, tag, 11])
    # A disc's even distribution; all numbers are always drawn, so that each depends on itself only.
    away_m = errors.marker_m * math.sqrt(random.random())
    bearing_rad = random.uniform(-math.pi, math.pi)
    yaw_rad = errors.marker_rad * random.uniform(-1.0, 1.0)
    left, right, axle = 1.0 + errors.wheel * random.uniform(-1.0, 1.0, 3)
    right = float(np.clip(right, left / _MOST_RATIO, left * _MOST_RATIO))
    sensors = draw_sensors(random, errors.sensor, model) if errors.sensor > 0.0 else None
    x_m, y_m = away_m * math.cos(bearing_rad), away_m * math.sin(bearing_rad)
    return RobotHardware(
        MarkerOffset(x_m, y_m, float(yaw_rad)),
        float(left),
        right,
        float(model.axle_m * axle),
        sensors,
        model,
    )


_DEAD = 1e-6
"""What the wheels of dead motors still do: physics divides by it."""


def draw_all(
    tags: Sequence[int],
    errors: HardwareErrors,
    dead: Collection[int] = (),
    models: Mapping[int, RobotModel] = {},
) -> dict[int, RobotHardware]:
    """Draws the robots with these tags, e-pucks unless `models` says otherwise, of which the `dead`
    do not move; none where all is as it should be."""
    if not errors.any and not dead:
        return {}
    robots = {tag: draw(tag, errors, models.get(tag, EPUCK)) for tag in tags}
    return robots | {tag: replace(robots[tag], left=_DEAD, right=_DEAD) for tag in dead}


def report_all(robots: Mapping[int, RobotHardware]) -> dict[str, Any]:
    """The truth about drawn robots for reports and recordings: "hardware", by tag; or nothing."""
    reports = {str(tag): robot.report() for tag, robot in robots.items()}
    return {"hardware": reports} if reports else {}


@dataclass(frozen=True, slots=True)
class LabRobots:
    """How a lab's robots differ from nominal ones, and what is known of that.

    Attributes:
        hardware: how robots are built, by tag; empty: as they should be.
        markers: by tag, where the tracker takes markers to sit on their robots.
        settings: by tag, what `vsensed` is told that was measured of its robot.
        worn: by tag, the markers of robots that wear another one.
        radios: by tag, the Wi-Fi of robots that have one.
        black: x, y, radius [m] of black discs on the floor, which ground sensors see.
    """

    hardware: Mapping[int, RobotHardware] = field(default_factory=dict)
    markers: Mapping[int, MarkerOffset] = field(default_factory=dict)
    settings: Mapping[int, Mapping[str, str]] = field(default_factory=dict)
    worn: Mapping[int, int] = field(default_factory=dict)
    radios: Mapping[int, EmulatedRadio] = field(default_factory=dict)
    black: Sequence[tuple[float, float, float]] = ()


NOMINAL = LabRobots()


def to_markers(poses: Floats, offsets: Floats) -> Floats:
    """Poses (n, 3) of markers from those of their bodies, with offsets (n, 3) in their frames."""
    arm_x, arm_y = turned(offsets, poses[:, 2])
    return np.column_stack((poses[:, 0] + arm_x, poses[:, 1] + arm_y, poses[:, 2] + offsets[:, 2]))


WIRELESS_HEAD = (
    "Inter-| sta-|   Quality        |   Discarded packets               | Missed | WE\n"
    " face | tus | link level noise |  nwid  crypt   frag  retry   misc | beacon | 22\n"
)
INTERFACE = "wlan0"

WEAKEST_DBM, STRONGEST_DBM = -110, -40
"""Between these the kernel makes a link quality of 0 to 70 of a signal (wext-compat.c)."""

POWER_SAVING = "saves"

WRITTEN = re.compile(rf"(\d+)=(-\d+)(?:,(\d+(?:\.\d+)?))?(,{POWER_SAVING})?")


@dataclass(frozen=True, slots=True)
class EmulatedRadio:
    """A radio as its robot tells it.

    Attributes:
        signal_dbm: of the access point, -127 to -1.
        rate_mbit_s: its bit rate.
        saves_power: whether its power saving is on.
        retries: frames that it gave up after all tries.
    """

    signal_dbm: int
    rate_mbit_s: float = 54.0
    saves_power: bool = False
    retries: int = 0

    def file_text(self) -> str:
        """The file that `vsensed --radio` reads."""
        quality = min(max(self.signal_dbm, WEAKEST_DBM), STRONGEST_DBM) - WEAKEST_DBM
        row = (
            f"{INTERFACE:>6}: 0000  {quality:3}.  {self.signal_dbm:3}.  -256  "
            f"{0:6} {0:6} {0:6} {self.retries:6} {0:6}   {0:6}\n"
        )
        rate = f"rate {round(1e6 * self.rate_mbit_s)}\n"
        return f"{WIRELESS_HEAD}{row}{rate}power {int(self.saves_power)}\n"


def read_radio(text: str) -> tuple[int, EmulatedRadio]:
    """Reads TAG=DBM[,MBIT][,saves]; ValueError says what was expected."""
    match = WRITTEN.fullmatch(text)
    if match is None:
        expected = f"TAG=DBM[,MBIT_S][,{POWER_SAVING}], such as 23=-84 or 23=-61,5.5,saves"
        raise ValueError(f"'{text}': expected {expected}")
    tag, signal_dbm, rate = int(match[1]), int(match[2]), float(match[3] or 54.0)
    if not -127 <= signal_dbm <= -1 or not 0.1 <= rate <= 2000.0:
        raise ValueError(f"'{text}': expected -127 to -1 dBm, and 0.1 to 2000 Mbit/s")
    return tag, EmulatedRadio(signal_dbm, rate, match[4] is not None)


@dataclass(frozen=True, slots=True)
class EmulatedLab:
    """What a lab on this machine is made of.

    Attributes:
        base: what robots are based on, as `bases_of` takes it.
        firmware_watchdog: their firmware has one, as in `Microcontrollers`.
        cameras: columns and rows of them; None: as many as it takes.
        calibrate: they hang as people hang them, and are known from pictures of a board only.
        pace: all its clocks go at this share of real time.
        robots: what an experiment's robots differ in.
    """

    base: str | None = None
    firmware_watchdog: bool = False
    cameras: tuple[int, int] | None = None
    calibrate: bool = False
    pace: float = 1.0
    robots: Callable[[Experiment], LabRobots] = lambda experiment: NOMINAL
