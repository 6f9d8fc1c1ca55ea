"""How good a virtual sensor or actuator is: what a perfect one's numbers become on their way.

Virtual sensing is for trying out devices that do not exist yet (thesis 1.2), so all of them take
the same settings from their elements; all are absent by default:

    noise_level="0.05"    uniform noise of +-0.05               (an attribute of ARGoS)
    noise_std_dev="0.02"  Gaussian noise of this deviation      (an attribute of ARGoS)
    vs:bias="0.1"         is added to every number
    vs:drift="0.001"      by how much the bias grows in a second of the run
    vs:low="0"            saturation: what is below reads as this
    vs:high="1"           saturation: what is above reads as this
    vs:bits="8"           resolution: 2^8 steps from low to high
    vs:latency="2"        what was true 2 timesteps ago arrives now
    vs:drop_out="0.1"     probability that a number is lost: the last one stays
    vs:update_every="5"   recomputed in every 5th timestep

They act in this order: bias and drift, noise, saturation, resolution, drop-out, latency. Noise,
bias, drift and saturation are given in the device's own unit (`Scale.unit`; each device's page
says which), so that one sweep over `sensor.noise` means the same to all of them.
Source: additive noise, uniform or Gaussian, then clipped: iridia.md section 3.

    vs:update="always"         in every timestep (the default)
    vs:update="every:5"        in every 5th, the same as vs:update_every="5"
    vs:update="change"         when a number differs from the one that was sent last
    vs:update="threshold:0.1"  when one differs by at least 0.1, in the sensor's unit
    vs:update="own"            when the sensor's own function `changed` says so (the default of a
                               sensor that has one)

The condition decides when value and capture time are renewed. In between robots are sent the last
value, and its age grows: `stale` has no meaning for a sensor that waits for a change.
"""

from __future__ import annotations

import math
import re
import zlib
from collections import deque
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats, wrap_angle
from vsense.base.errors import VsenseError, instead
from vsense.base.xml.element import Element

NOISES = ("noise_level", "noise_std_dev")
"""The noise that devices have in ARGoS."""

_MAX_AMOUNT = 1e6
_MAX_BITS = 24
_MAX_LATENCY = 1000
_MAX_UPDATE_EVERY = 100_000

_NOISE_BLOCK = 64
"""Noise of so many calls is drawn at once, where it can be: that takes a tenth of the time."""


QUALITY_SETTINGS: Mapping[str, tuple[float, float]] = {
    "noise_level": (0.0, _MAX_AMOUNT),
    "noise_std_dev": (0.0, _MAX_AMOUNT),
    "bias": (-_MAX_AMOUNT, _MAX_AMOUNT),
    "drift_per_s": (-_MAX_AMOUNT, _MAX_AMOUNT),
    "bits": (0, _MAX_BITS),
    "latency": (0, _MAX_LATENCY),
    "drop_out": (0.0, 1.0),
    "update_every": (1, _MAX_UPDATE_EVERY),
}
"""What can be changed while a run goes on, and its bounds; whole numbers where they are."""


class QualityError(VsenseError):
    """A setting that there is not, or that cannot be so."""


@dataclass(frozen=True, slots=True)
class Scale:
    """What the numbers of a device mean to its quality settings; one value each, or one for all.

    Attributes:
        unit: what 1 in a setting means in the device's numbers; 0: the number is no measurement
            (a count, a message's byte) and stays as it is.
        low: the least that the device can give; -inf: no bound.
        high: the most that it can give; inf: no bound.
        wraps: the number is an angle [rad] in (-pi, pi]; it has no saturation, its resolution
            divides the full turn.
    """

    unit: float | Sequence[float] = 1.0
    low: float | Sequence[float] = -math.inf
    high: float | Sequence[float] = math.inf
    wraps: bool | Sequence[bool] = False

    @property
    def bounded(self) -> bool:
        """Whether every measurement that is no angle has two bounds of its own."""
        free = np.isinf(self.low) | np.isinf(self.high)
        return not np.any(free & (np.asarray(self.unit) != 0.0) & ~np.asarray(self.wraps))


@dataclass(frozen=True, slots=True)
class Quality:
    """The settings; the defaults are perfect. The module says what each means.

    Attributes:
        low, high: saturation, None: the device's own.
        bits: resolution, 0: as fine as the layout.
        latency, update_every: [timestep].
        drop_out: probability per timestep.
    """

    noise_level: float = 0.0
    noise_std_dev: float = 0.0
    bias: float = 0.0
    drift_per_s: float = 0.0
    low: float | None = None
    high: float | None = None
    bits: int = 0
    latency: int = 0
    drop_out: float = 0.0
    update_every: int = 1

    @property
    def distorts(self) -> bool:
        """Whether numbers come out different from what goes in."""
        added = (self.noise_level, self.noise_std_dev, self.bias, self.drift_per_s, self.bits)
        return any(added) or self.low is not None or self.high is not None

    def changed(self, name: str, value: float, scale: Scale) -> Quality:
        """The same with another value of one of the `QUALITY_SETTINGS`; `scale` is the device's.

        Raises:
            QualityError: there is no such setting, or it cannot have this value.
        """
        if name not in QUALITY_SETTINGS:
            raise QualityError(f"no setting {name!r:.60}; {instead(name, QUALITY_SETTINGS)}")
        low, high = QUALITY_SETTINGS[name]
        is_integer = isinstance(low, int)
        if not low <= value <= high or (is_integer and value != int(value)):
            kind = "a whole number" if is_integer else "a number"
            raise QualityError(f"{name} is {value:g}, expected {kind} from {low:g} to {high:g}")
        if name == "bits" and value and not scale.bounded and None in (self.low, self.high):
            raise QualityError("bits: the device has no bounds to divide: set vs:low and vs:high")
        changed: Any = {name: int(value) if is_integer else float(value)}
        return replace(self, **changed)

    @classmethod
    def from_xml(cls, element: Element, scale: Scale, noises: Collection[str] = NOISES) -> Quality:
        """Reads the settings of a device's element; `scale` is that of its numbers.

        Of the `NOISES` it has those of `noises`; the others are left to the device itself.

        Raises:
            ConfigError: a setting is wrong, or `vs:bits` has no bounds to divide.
        """
        low, high = _saturation(element, scale)
        bits = element.integer("vs:bits", 1, _MAX_BITS) if element.has("vs:bits") else 0
        if bits and not scale.bounded and None in (low, high):
            needed = "needs 'vs:low' and 'vs:high': it divides what is between"
            raise element.error(needed, "vs:bits")
        return cls(
            **{
                name: element.number(name, 0.0, _MAX_AMOUNT, default=0.0)
                for name in NOISES
                if name in noises
            },
            bias=element.number("vs:bias", -_MAX_AMOUNT, _MAX_AMOUNT, default=0.0),
            drift_per_s=element.number("vs:drift", -_MAX_AMOUNT, _MAX_AMOUNT, "1/s", 0.0),
            low=low,
            high=high,
            bits=bits,
            latency=element.integer("vs:latency", 0, _MAX_LATENCY, 0),
            drop_out=element.number("vs:drop_out", 0.0, 1.0, default=0.0),
            update_every=element.integer("vs:update_every", 1, _MAX_UPDATE_EVERY, 1),
        )


class Distortion:
    """What bias, drift, noise, saturation and resolution make of `count` numbers of `rows` robots.

    What is drawn for one robot depends on no other robot: numbers are drawn for all of them
    each time. Devices with different names, and runs with different seeds, draw independently.

    Attributes:
        unit, low, high: (k,) those of the numbers.
    """

    def __init__(self, quality: Quality, scale: Scale, rows: int, count: int) -> None:
        self._quality = quality
        self._shape = (rows, count)
        # Whoever draws one kind of number only can draw many of them at once: they are the same.
        kinds = (quality.noise_level, quality.noise_std_dev, quality.drop_out)
        self._ahead = _NOISE_BLOCK if np.count_nonzero(kinds) <= 1 else 1
        self._noise, self._used = np.zeros((0, *self._shape)), 0
        self.unit = _per_number(scale.unit, count)
        self._wraps = _per_number(scale.wraps, count).astype(bool)
        low, high = _per_number(scale.low, count), _per_number(scale.high, count)
        if quality.low is not None:
            low = np.maximum(low, quality.low * self.unit)
        if quality.high is not None:
            high = np.minimum(high, quality.high * self.unit)
        apart = self._wraps | (self.unit == 0.0)
        self.low, self.high = np.where(apart, -np.inf, low), np.where(apart, np.inf, high)
        base = np.where(self._wraps, -np.pi, low)
        span = np.where(self._wraps, 2 * np.pi, high - low)
        self._steps = 2.0**quality.bits - np.where(self._wraps, 0.0, 1.0)
        divided = (self.unit != 0.0) & (quality.bits > 0)
        self._base, self._span = np.where(divided, base, 0.0), np.where(divided, span, 0.0)

    def apply(
        self, values: Floats, rows: NDArray[np.bool_], time_s: float, random: np.random.Generator
    ) -> Floats:
        """Distorts numbers (m, k) at a time of the run; they stay within the device's bounds.

        They belong to those of the robots `rows` (n,) that are True.
        """
        quality = self._quality
        offset = self.noise(random)[0]
        self.use(1)
        if quality.bias or quality.drift_per_s:
            offset = offset + (quality.bias + quality.drift_per_s * max(time_s, 0.0))
        distorted = np.clip(values + offset[rows] * self.unit, self.low, self.high)
        distorted = self._divide(distorted)
        return np.where(self._wraps, wrap_angle(distorted), distorted)

    @property
    def is_noise(self) -> bool:
        """Whether `noise`, limited to the bounds, is all that it adds."""
        quality = self._quality
        has_more = quality.bias or quality.drift_per_s or quality.bits or self._wraps.any()
        return quality.distorts and not has_more

    def noise(self, random: np.random.Generator) -> Floats:
        """Noise of the calls to come, (j, n, k) in units, one at least."""
        if self._used == len(self._noise):
            quality, shape = self._quality, (self._ahead, *self._shape)
            self._noise, self._used = np.zeros(shape), 0
            if quality.noise_level > 0.0:
                self._noise += random.uniform(-quality.noise_level, quality.noise_level, shape)
            if quality.noise_std_dev > 0.0:
                self._noise += random.normal(0.0, quality.noise_std_dev, shape)
        return self._noise[self._used :]

    def use(self, calls: int) -> None:
        """The noise of so many calls has been used."""
        self._used += calls

    def _divide(self, values: Floats) -> Floats:
        """Rounds to the nearest of the steps that the resolution has."""
        step = self._span / self._steps if self._quality.bits else self._span
        divisor = np.where(step > 0.0, step, 1.0)
        rounded = self._base + np.rint((values - self._base) / divisor) * divisor
        return np.where(step > 0.0, rounded, values)


T = TypeVar("T")


class Delay(Generic[T]):
    """Returns things a number of timesteps after they were put in; until then `before`."""

    def __init__(self, timesteps: int, before: T) -> None:
        self._waiting: deque[T] = deque([before] * timesteps)

    def push(self, new: T) -> T:
        """Puts in this timestep's thing and takes out the one that is due."""
        self._waiting.append(new)
        return self._waiting.popleft()


def generator(seed: int, name: str) -> np.random.Generator:
    """Makes the source of random numbers of one device, by name, in a run; `seed` is not negative.

    Adding a device to an experiment changes nothing for the others.
    """
    return np.random.default_rng([seed, zlib.crc32(name.encode())])


def _saturation(element: Element, scale: Scale) -> tuple[float | None, float | None]:
    """Reads the bounds, of which something has to be left within the device's own."""
    low, high = (
        element.number(key, -_MAX_AMOUNT, _MAX_AMOUNT) if element.has(key) else None
        for key in ("vs:low", "vs:high")
    )
    if low is not None and high is not None and low >= high:
        raise element.error(f"{high:g} is not above 'vs:low' {low:g}", "vs:high")
    unit = np.asarray(scale.unit)
    measured = (unit != 0.0) & ~np.asarray(scale.wraps)
    if low is not None and np.any(measured & (low * unit >= scale.high)):
        raise element.error(f"{low:g} is above all that the device can give", "vs:low")
    if high is not None and np.any(measured & (high * unit <= scale.low)):
        raise element.error(f"{high:g} is below all that the device can give", "vs:high")
    return low, high


def _per_number(value: float | Sequence[float], count: int) -> Floats:
    return np.broadcast_to(np.asarray(value, dtype=np.float64), (count,))


_SPELT = re.compile(r"(always|change|own)|(threshold|every):(.*)")
_EXPECTED = "'always', 'change', 'threshold:AMOUNT', 'every:TIMESTEPS' or 'own'"
_MAX_EVERY = 100_000
_MAX_THRESHOLD = 1e9


@dataclass(frozen=True, slots=True)
class Updating:
    """An updating condition: "always", "change", "threshold" or "own".

    `threshold` is the least difference that counts, in the sensor's unit.
    """

    kind: str = "always"
    threshold: float = 0.0

    def due(
        self, sensor: Any, scale: Scale, sent: NDArray[Any], fresh: NDArray[Any]
    ) -> NDArray[np.bool_]:
        """Which robots (m,) are sent their new numbers.

        `sent` (m, k) are those that they were sent last, `fresh` (m, k) the new ones; `scale` is
        that of the numbers. The sensor decides where the condition is its own.
        """
        if self.kind == "always":
            return np.ones(len(fresh), dtype=bool)
        if self.kind == "own":
            return np.asarray(sensor.changed(sent, fresh), dtype=bool)
        difference = np.abs(fresh.astype(np.float64) - sent)
        wraps = np.broadcast_to(scale.wraps, difference.shape)
        difference = np.where(wraps, np.minimum(difference, 2.0 * np.pi - difference), difference)
        if self.kind == "change":
            return np.asarray((difference > 0.0).any(axis=1))
        # A number without a unit is no measurement: any change of it counts.
        least = self.threshold * np.asarray(scale.unit)
        return np.asarray(((difference >= least) & (difference > 0.0)).any(axis=1))


ALWAYS = Updating()


def updating_from_xml(element: Element, sensor: Any, update_every: int) -> tuple[Updating, int]:
    """Reads the updating condition of a sensor's element, and every how many timesteps it counts.

    `update_every` is the element's `vs:update_every`.

    Raises:
        ConfigError: it is none, or contradicts `vs:update_every`.
    """
    has_own = callable(getattr(sensor, "changed", None))
    text = element.text("vs:update", "own" if has_own else "always", _EXPECTED)
    match = _SPELT.fullmatch(text)
    if match is None:
        raise element.error(f"{text[:60]!r} is not {_EXPECTED}", "vs:update")
    if match[1] == "own" and not has_own:
        raise element.error(f"the sensor {sensor.name!r} has no condition of its own", "vs:update")
    if match[1]:
        return Updating(match[1]), update_every
    if match[2] == "threshold":
        return Updating("threshold", _amount(element, match[3])), update_every
    if element.has("vs:update_every"):
        raise element.error("says the same as 'vs:update_every'; expected one of them", "vs:update")
    return ALWAYS, _every(element, match[3])


def _amount(element: Element, text: str) -> float:
    try:
        amount = float(text)
    except ValueError:
        amount = math.nan
    if not 0.0 < amount <= _MAX_THRESHOLD:
        expected = f"a number above 0, at most {_MAX_THRESHOLD:g}"
        raise element.error(f"threshold {text[:60]!r}: expected {expected}", "vs:update")
    return amount


def _every(element: Element, text: str) -> int:
    if not re.fullmatch("[0-9]{1,9}", text) or not 1 <= int(text) <= _MAX_EVERY:
        expected = f"a whole number from 1 to {_MAX_EVERY}"
        raise element.error(f"every {text[:60]!r}: expected {expected}", "vs:update")
    return int(text)
