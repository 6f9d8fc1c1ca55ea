"""What ARGoS's Lua controllers read and set, as numbers of all robots at once.

`argos.lua` makes a table of them. Units, order and what the robots' own devices stand for are as in
C++ for ARGoS: `robot/argos/rings.cpp`, `devices.cpp` and `neighbours.cpp`, which name the sources.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from vsense.base.arena import Floats
from vsense.robots.python_swarm import RGB, Leds, RowMask, Swarm
from vsense.world.robot_models import EPUCK

RAW_MAX = 4096.0
_OWN_RAW = EPUCK.ring.table_raw[7::-1]
_OWN_VALUE = (0.0, 0.0842, 0.2441, 0.4637, 0.5959, 0.7430, 0.9051, 1.0)
"""What ARGoS reads where the e-puck's own ring reads raw. Source: robot/argos/rings.cpp."""
_STEPS_PER_CM, _MOST_STEPS_S = 77.64, 3e4
_EPUCK_BELOW, _BRIGHT = 3, 0.5
_RING, _COLORED, _EPUCK_BYTES, _BLOB, _HEAD = 8, 3, 4, 5, 2

Convert = Callable[[Floats, bool], Floats]
"""Of (n, k) numbers of a sensor, and whether it is the robots' own: (n, m) as ARGoS reads them."""


def _ring(values: Floats, is_own: bool) -> Floats:
    """Counter-clockwise from the front left, 0 to 1; eight are an e-puck's, in its own order."""
    ordered = values[:, ::-1] if values.shape[1] == _RING else values
    return np.clip(ordered / RAW_MAX, 0.0, 1.0)


def _near(values: Floats, is_own: bool) -> Floats:
    backwards = values[:, ::-1]
    return np.interp(backwards, _OWN_RAW, _OWN_VALUE) if is_own else _ring(values, is_own)


def _foot_bot_weights() -> Floats:
    """(8, 24): what of the e-puck's eight each of the foot-bot's sensors is, as they look."""
    parts = np.array([10.5884, 3.5999, 2.0, 1.2, 0.8571, 0.6667, 0.5806, 0.5247], np.float32)
    at = math.pi / parts.astype(np.float64)
    around = np.concatenate(([at[-1] - 2 * math.pi], at, [at[0] + 2 * math.pi]))
    weights = np.zeros((_RING, 24))
    for number in range(24):
        wanted = math.pi / 12 * (number + 0.5)
        after = int(np.searchsorted(around, wanted))
        share = (wanted - around[after - 1]) / (around[after] - around[after - 1])
        weights[(after - 2) % _RING, number] += 1.0 - share
        weights[(after - 1) % _RING, number] += share
    return weights


_WEIGHTS = _foot_bot_weights()


def _around(convert: Convert) -> Convert:
    def converted(values: Floats, is_own: bool) -> Floats:
        made = convert(values, is_own)
        return made @ _WEIGHTS if made.shape[1] == _RING else made

    return converted


def _sides(columns: Sequence[int], bright: int = 0) -> Convert:
    """Of an e-puck's three. Others have their own, of which ARGoS gives the last `bright` as 0 or
    1: a foot-bot's base is black or white."""

    def converted(values: Floats, is_own: bool) -> Floats:
        if values.shape[1] == _EPUCK_BELOW:
            return values[:, columns]
        grey, bases = np.split(values, [values.shape[1] - bright], axis=1)
        return np.hstack((grey, bases >= _BRIGHT))

    return converted


def _charge(values: Floats, is_own: bool) -> Floats:
    return np.clip((values - 3400.0) / 800.0, 0.0, 1.0)


def _as_it_is(values: Floats, is_own: bool) -> Floats:
    return values


class SensorKind(NamedTuple):
    """How a sensor's numbers get into the table `robot`.

    Attributes:
        source: its name for controllers.
        how: the function of `argos.lua` that makes its part of the table.
        name: that part's.
        number: of its values, 0: as many as it has.
        convert: makes them of the sensor's numbers; `first` is what holds before they are known.
    """

    source: str
    how: str
    name: str
    number: int = 0
    convert: Convert = _as_it_is
    first: float = 0.0


_LEFT, _CENTER, _RIGHT = 0, 1, 2
_MOTOR = [_LEFT, _LEFT, _RIGHT, _RIGHT]
_BASE = [_CENTER, _LEFT, _LEFT, _LEFT, _CENTER, _RIGHT, _RIGHT, _RIGHT]

SENSORS = {
    "battery": SensorKind("battery", "battery", "battery", 1, _charge, 1.0),
    "colored_blob_omnidirectional_camera": SensorKind(
        "omnidirectional_camera", "seen", "colored_blob_omnidirectional_camera"
    ),
    "differential_steering": SensorKind("wheels", "odometer", "wheels", 4),
    "epuck_battery": SensorKind("battery", "charge", "battery", 1, _charge, 1.0),
    "epuck_encoder": SensorKind("wheels", "encoder", "wheels", 2),
    "epuck_ground": SensorKind("ground", "ground", "ground", 3),
    "epuck_light": SensorKind("light", "ring", "light", 8, _ring),
    "epuck_omnidirectional_camera": SensorKind(
        "omnidirectional_camera", "seen", "colored_blob_omnidirectional_camera"
    ),
    "epuck_proximity": SensorKind("proximity", "ring", "proximity", 8, _near),
    "epuck_range_and_bearing": SensorKind("range_and_bearing", "epuck_heard", "range_and_bearing"),
    "epuck_virtual_ground_sensor": SensorKind("ground", "ground", "ground", 3),
    "footbot_base_ground": SensorKind("ground", "below", "base_ground", 8, _sides(_BASE, 8)),
    "footbot_encoder": SensorKind("wheels", "axled", "wheels", 2),
    "footbot_light": SensorKind("light", "ring", "light", 24, _around(_ring)),
    "footbot_motor_ground": SensorKind("ground", "below", "motor_ground", 4, _sides(_MOTOR)),
    "footbot_proximity": SensorKind("proximity", "ring", "proximity", 24, _around(_near)),
    "ground": SensorKind("ground", "numbers", "ground", 0, _sides([_RIGHT, _CENTER, _LEFT], 8)),
    "kheperaiv_proximity": SensorKind("proximity", "even_ring", "proximity", 8, _near),
    "light": SensorKind("light", "numbers", "light", 0, _ring),
    "pipuck_differential_drive": SensorKind("wheels", "driven", "differential_drive", 4),
    "pipuck_ground": SensorKind("ground", "reflected", "ground_sensors", 3),
    "pipuck_rangefinders": SensorKind("rangefinders", "ranges", "rangefinders", 8),
    "pipuck_system": SensorKind("wheels", "system", "system", 1),
    "positioning": SensorKind("gps", "positioning", "positioning", 3),
    "proximity": SensorKind("proximity", "numbers", "proximity", 0, _near),
    "range_and_bearing": SensorKind("range_and_bearing", "heard", "range_and_bearing"),
}
"""By the element of ARGoS that asks for it; other virtual sensors are numbers, by their names."""

_BASES = "base_ground"
"""What a foot-bot has beside "ground"."""
_ROLLED = ("odometer", "encoder", "driven", "axled")
_LISTS = ("seen", "heard", "epuck_heard")
"""Kinds of which a number in front says how many there are."""


class LuaSensor:
    """A sensor of all robots of a controller."""

    def __init__(
        self, swarm: Swarm, kind: SensorKind, heard_bytes: int, two_radii_cm: float
    ) -> None:
        """`heard_bytes` are those of a message that is heard; a range is without `two_radii_cm`."""
        self._swarm, self._two_radii_cm = swarm, two_radii_cm
        self._reading, self._kind = swarm.sensor(kind.source), kind
        self._is_own = kind.source not in swarm.offered
        self._step_s, self._before_cm = swarm.timestep_s, None
        size = self._reading.values.shape[1]
        self.number = kind.number or size
        if kind.how in _LISTS:
            self.number = _BLOB if kind.how == "seen" else _HEAD + heard_bytes
        self.is_list = kind.how in _LISTS
        width = size if self.is_list else self.number
        self._last = np.full((len(swarm), width), kind.first)

    _before_cm: Floats | None

    @property
    def line(self) -> bytes:
        """What `argos.lua` is told of it."""
        return f"{self._kind.how} {self._kind.name} {self.number}\n".encode()

    def values(self) -> Floats:
        """(n, k) as they are in this control step; those that are not known stay as they were."""
        reading, known = self._reading, self._reading.known
        if self._kind.how == "system":
            return np.full((len(known), 1), self._swarm.steps * self._step_s)
        if self._kind.how in _ROLLED:
            new = self._rolled(reading.values, known)
        elif self._kind.how == "heard":
            new = reading.values.copy()
            new[:, 1 :: self.number] += self._two_radii_cm
        else:
            new = self._kind.convert(reading.values, self._is_own)
        if not known.all():
            new = np.where(known[:, None], new, 0.0 if self.is_list else self._last)
        self._last = new
        return new

    def _rolled(self, way_cm: Floats, known: RowMask) -> Floats:
        """(n, 4) the way since the last step [cm], and how fast that is; left and right."""
        before = way_cm if self._before_cm is None else self._before_cm
        covered_cm = np.where(known[:, None], way_cm - before, 0.0)
        self._before_cm = np.where(known[:, None], way_cm, before)
        return np.hstack((covered_cm, covered_cm / self._step_s))[:, : self.number]

    def packed(self) -> list[bytes]:
        """The doubles of a list of every robot: how many places are in use, and these."""
        values = self.values()
        used = 1 + self.number * values[:, 0].astype(int)
        return [row[:end].tobytes() for row, end in zip(values, used)]


def sensors_of(
    swarm: Swarm, declared: Collection[str], heard_bytes: int, two_radii_cm: float
) -> list[LuaSensor]:
    """The sensors that a controller's elements ask for, in the order of ARGoS's map, and all other
    virtual ones; those that are lists come last. See `LuaSensor`."""
    kinds = [SENSORS[name] for name in sorted(declared) if name in SENSORS]
    if _BASES in swarm.offered:
        kinds = [k._replace(source=_BASES) if k.name == _BASES else k for k in kinds]
    served = {kind.source for kind in kinds}
    kinds += [SensorKind(n, "numbers", n) for n in swarm.offered if n not in served]
    kinds.sort(key=lambda kind: kind.how in _LISTS)
    own = "range_and_bearing" not in swarm.offered
    size = _EPUCK_BYTES if own else heard_bytes
    return [LuaSensor(swarm, kind, size, two_radii_cm) for kind in kinds]


class ActuatorKind(NamedTuple):
    """How numbers that a script sets are done; see `SensorKind`."""

    how: str
    name: str
    number: int = 0


ACTUATORS = {
    "differential_steering": ActuatorKind("wheels", "wheels"),
    "epuck_base_leds": ActuatorKind("switches", "base_leds", 8),
    "epuck_range_and_bearing": ActuatorKind("epuck_said", "range_and_bearing", _EPUCK_BYTES),
    "epuck_rgb_leds": ActuatorKind("lights", "overo_leds", 3),
    "epuck_wheels": ActuatorKind("wheels", "wheels"),
    "leds": ActuatorKind("lights", "leds"),
    "pipuck_differential_drive": ActuatorKind("drives", "differential_drive"),
    "pipuck_leds": ActuatorKind("on_off", "leds", _RING + 2),
    "range_and_bearing": ActuatorKind("said", "range_and_bearing"),
}
"""By the element of ARGoS that asks for it."""

_VIRTUAL = {"overo_leds": "rgb_leds", "range_and_bearing": "message"}
"""Names of virtual actuators that differ from ARGoS's; "leds" and "base_leds" are the same."""


class LuaActuators:
    """All that the robots of a controller do, n of them."""

    def __init__(
        self, swarm: Swarm, declared: Collection[str], said_bytes: int, lamps: int
    ) -> None:
        """`said_bytes` are those of a message that is said; the robot has so many `lamps`."""
        self._swarm = swarm
        kinds = [ACTUATORS[name] for name in sorted(declared) if name in ACTUATORS]
        served = {_VIRTUAL.get(kind.name, kind.name) for kind in kinds}
        others = {n: k for n, k in swarm.actuates.items() if n not in {*served, RGB, "message"}}
        kinds += [ActuatorKind("set", name, number) for name, number in others.items()]
        sizes = {"leds": lamps}
        self._kinds = [
            kind._replace(number=kind.number or sizes.get(kind.name, said_bytes)) for kind in kinds
        ]
        bound = {*swarm.actuates, *(served & {"message"})}
        self._ways = {name: swarm.actuator(name) for name in bound}
        self.lines = b"".join(f"{how} {name} {n}\n".encode() for how, name, n in self._kinds)

    def apply(self, numbers: Floats, where: RowMask) -> None:
        """Does what the scripts have set: (n, k) in the order of `lines`, of the robots `where`."""
        at, lit = 0, np.zeros(len(self._swarm), np.uint32)
        shines = False
        for how, name, number in self._kinds:
            size = _SIZES.get(how, _plain)(number)
            part, at = numbers[:, at : at + size], at + size
            if how in ("wheels", "drives"):
                left, right = _steps_s(part if how == "wheels" else 100.0 * part).T
                self._swarm.set_wheels(left, right, where)
                continue
            if how in ("switches", "on_off") or name == "leds":
                shines = True
                lit |= _ring_bits(part[:, :_RING] if how != "lights" else _is_lit(part))
            if how == "on_off":
                lit |= part[:, _RING].astype(np.uint32) * np.uint32(Leds.FRONT)
                lit |= part[:, _RING + 1].astype(np.uint32) * np.uint32(Leds.BODY)
                continue
            if how == "switches":
                part = 255.0 * part
            if name == "overo_leds":
                for led in range(number):
                    red, green, blue = part[:, 3 * led : 3 * led + 3].T
                    self._swarm.set_rgb(led, red, green, blue, where)
            if (way := self._ways.get(_VIRTUAL.get(name, name))) is not None:
                way.set_all(part, where)
        if shines:
            self._swarm.set_leds(lit, where)


def _plain(number: int) -> int:
    return number


_SIZES: Mapping[str, Callable[[int], int]] = {
    "wheels": lambda _: 2,
    "drives": lambda _: 2,
    "lights": lambda number: 3 * number,
    "said": lambda number: 1 + number,
    "epuck_said": lambda number: 1 + number,
}


def _steps_s(speeds_cm_s: Floats) -> Floats:
    """Rounded to whole steps, halves away from zero; what is no number stops the wheel."""
    steps_s = np.fmax(-_MOST_STEPS_S, np.fmin(speeds_cm_s * _STEPS_PER_CM, _MOST_STEPS_S))
    steps_s[np.isnan(speeds_cm_s)] = 0.0
    return np.asarray(np.trunc(steps_s + np.copysign(0.5, steps_s)))


def _is_lit(levels: Floats) -> RowMask:
    """(n, 8) which LEDs of the ring have a colour; those of a larger ring fall on the nearest."""
    lamps: RowMask = np.asarray(levels.reshape(len(levels), -1, 3).any(axis=2))
    ring = lamps.shape[1] - (_COLORED if lamps.shape[1] == _RING + _COLORED else 1)
    lit = np.zeros((len(levels), _RING), dtype=np.bool_)
    for led in range(ring):
        lit[:, led * _RING // ring] |= lamps[:, led]
    return lit


def _ring_bits(lit: Any) -> Any:
    """The robot's own ring counts clockwise."""
    bits = 1 << ((_RING - np.arange(_RING)) % _RING)
    return (np.asarray(lit, bool) * bits).sum(axis=1).astype(np.uint32)
