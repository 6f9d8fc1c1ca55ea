"""When robots are sent a new value: the updating condition of the thesis (3.3.4).

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
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.base.xml.element import Element
from vsense.world.sensors.quality import Scale

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


def from_xml(element: Element, sensor: Any, update_every: int) -> tuple[Updating, int]:
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
