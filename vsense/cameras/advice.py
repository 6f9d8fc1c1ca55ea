"""What to change about exposure and gain.

In dim light a longer exposure smears what moves, and more gain brings noise (thesis, 2.2.2); so the
exposure is best as long as the blur allows, and gain is for what is missing then. The limits are
those of what was measured. Source: reference/tracking.md, section 2.
"""

from __future__ import annotations

from dataclasses import dataclass

from vsense.cameras.measures import Brightness
from vsense.cameras.scale import Scale, blur_px
from vsense.tracking.health import HealthLimits

MOST_BLUR_CELLS = 0.8
"""Blur of 2.4 px cost no number where a cell is 3 px (hard set S3), 3.2 px 1.5 % where it is 4 px
(S4), and 2.4 px up to 15 % where it is 2 px (F2): what counts is the share of a cell."""
GOOD_BLUR_CELLS = 0.5
"""What to aim at: half of a cell costs nothing in any set."""
MOST_NOISE = 6.0
"""Up to this noise all robots were found and named; with 8 in the hard set 1.5 % were not."""
LEAST_LIGHT = 150.0
"""White paper at 150 above black at 60 already costs 1 % (low contrast)."""
GOOD_LIGHT = 200.0
"""White at 200 leaves room for where the light is stronger."""
MOST_SATURATED = 0.01
"""Beyond this edges of paper swell into what is saturated: they move by what they glare."""
DARK_MEAN = HealthLimits().dark_level
"""A picture below shows nothing."""


@dataclass(frozen=True, slots=True)
class Reading:
    """What is known of a camera's pictures.

    Attributes:
        exposure_us: exposure time, None where the camera does not tell.
        gain: in the camera's own unit, None where it does not tell.
        light: the brightness.
        noise: standard deviation of a pixel [grey levels], None where it cannot be told.
        speed_m_s: of the robots.
        scale: None where it is not known.
        cell_m: side of a marker's cell.
    """

    exposure_us: float | None
    gain: float | None
    light: Brightness
    noise: float | None
    speed_m_s: float
    scale: Scale | None
    cell_m: float

    @property
    def blur_px(self) -> float | None:
        """How far a robot moves while a picture is exposed."""
        return None if self.exposure_us is None else self.blur_of(self.exposure_us)

    def blur_of(self, exposure_us: float) -> float | None:
        """How far a robot would move with another exposure."""
        if self.scale is None:
            return None
        return blur_px(exposure_us, self.speed_m_s, self.scale.px_per_m)

    @property
    def cell_px(self) -> float | None:
        """Side of a marker's cell in the picture."""
        return None if self.scale is None else self.cell_m * self.scale.px_per_m

    @property
    def longest_us(self) -> float | None:
        """The longest exposure that gives the blur to aim at."""
        return None if self.speed_m_s <= 0 else 1e6 * GOOD_BLUR_CELLS * self.cell_m / self.speed_m_s

    @property
    def is_blurred(self) -> bool:
        """Whether a moving robot's cells run into each other."""
        blur, cell = self.blur_px, self.cell_px
        return blur is not None and cell is not None and blur > MOST_BLUR_CELLS * cell


def advise(reading: Reading) -> str:
    """Gives one line: what to do first, or that all is well."""
    light = reading.light
    if light.mean < DARK_MEAN:
        return "the picture is dark: is there light, and is the lens open?" + _brighter(reading)
    if light.saturated > MOST_SATURATED:
        return f"{_percent(light.saturated)} is saturated: {_darker(reading)}"
    if reading.is_blurred:
        return _sharper(reading)
    if light.light < LEAST_LIGHT:
        return f"dim: the lightest 1 % is at {light.light:.0f} of 255" + _brighter(reading)
    if reading.noise is not None and reading.noise > MOST_NOISE:
        text = f"noise {reading.noise:.1f}: above {MOST_NOISE:g} numbers are misread; less gain"
        return text + _longer(reading, ", and ")
    return "good: nothing to change"


def rounded(exposure_us: float) -> float:
    """Gives an exposure with two digits, never a longer one."""
    unit = 10.0 ** max(len(str(int(exposure_us))) - 2, 0)
    return float(exposure_us // unit * unit)


def _sharper(reading: Reading) -> str:
    blur, cell, longest = reading.blur_px, reading.cell_px, reading.longest_us
    assert blur is not None and cell is not None and longest is not None
    exposure_us = rounded(longest)
    better = reading.blur_of(exposure_us)
    return (
        f"blur {blur:.1f} px: above {MOST_BLUR_CELLS * cell:.1f} px cells of {cell:.1f} px are"
        f" lost; exposure {exposure_us:g} us would give {better:.1f} px, then raise gain or light"
    )


def _darker(reading: Reading) -> str:
    """Says how to get less light: less gain first, which brings nothing but noise then."""
    if reading.exposure_us is None:
        return "less gain or exposure"
    shorter = f"exposure {rounded(reading.exposure_us / 2.0):g} us"
    return f"less gain, or {shorter}" if reading.gain else shorter


def _brighter(reading: Reading) -> str:
    """Says how to get more light: exposure as far as the blur allows, then gain."""
    return _longer(reading, "; ") or "; more gain, or better more lamps"


def _longer(reading: Reading, before: str) -> str:
    """Says which exposure is longer and still sharp, or nothing where there is none."""
    exposure_us, longest_us = reading.exposure_us, reading.longest_us
    if exposure_us is None:
        return f"{before}more exposure"
    if longest_us is None:
        return ""
    wanted_us = exposure_us * GOOD_LIGHT / max(reading.light.light, 1.0)
    longer_us = rounded(min(wanted_us, longest_us))
    if longer_us <= exposure_us:
        return ""
    blur = reading.blur_of(longer_us)
    cost = "" if blur is None else f" (blur {blur:.1f} px)"
    rest = ", then gain" if wanted_us > longest_us else ""
    return f"{before}exposure {longer_us:g} us{cost}{rest}"


def _percent(share: float) -> str:
    return f"{100.0 * share:.1f} %"
