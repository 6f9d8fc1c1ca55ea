"""Measures a picture's brightness and noise, and advises on exposure and gain.

In dim light a longer exposure smears what moves, and more gain brings noise (thesis, 2.2.2). The
best exposure is as long as the blur allows; gain provides the rest. Source of the limits:
reference/tracking.md, section 2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Image
from vsense.vision.cameras.health import DARK_LEVEL
from vsense.vision.tracking.marker_detector import CellWidth

WHITE_GREY, BLACK_GREY = 254, 1
"""Limits of saturated and of black pixels: lens corrections and JPEG round by one level."""
_BLOCK_PX = 16
_FLAT = (6.0, 249.0)
"""Blocks with a mean beyond these are clipped and show too little noise."""


@dataclass(frozen=True, slots=True)
class Brightness:
    """The brightness of one picture, in grey levels from 0 to 255.

    `counts` (256,) are the pixels of each level, `dark` and `light` the 1st and 99th percentile,
    `saturated` and `black` shares of the pixels, 0 to 1.
    """

    counts: NDArray[np.int64]
    mean: float
    dark: float
    light: float
    saturated: float
    black: float


def brightness(image: Image) -> Brightness:
    """Measures an (h, w) uint8 picture."""
    counts = np.bincount(image.ravel(), minlength=256)
    below = np.cumsum(counts) / image.size
    return Brightness(
        counts=counts,
        mean=float(counts @ np.arange(256)) / image.size,
        dark=float(np.searchsorted(below, 0.01)),
        light=float(np.searchsorted(below, 0.99)),
        saturated=float(counts[WHITE_GREY:].sum()) / image.size,
        black=float(counts[: BLACK_GREY + 1].sum()) / image.size,
    )


def noise(first: Image, second: Image) -> float | None:
    """Measures the noise of a camera at rest, from two (h, w) uint8 pictures in a row.

    The difference of two pictures has the noise of both: sigma of the difference / sqrt 2. Each
    block is measured about its own mean, which excludes a lamp's flicker; the median over the
    blocks excludes robots that drive through the picture.

    Returns:
        Standard deviation of a pixel [grey levels]; None where the picture is clipped all over, or
        too small.
    """
    rows, columns = (side // _BLOCK_PX for side in first.shape)
    if first.shape != second.shape or rows * columns == 0:
        return None
    blocks = slice(rows * _BLOCK_PX), slice(columns * _BLOCK_PX)
    shape = (rows, _BLOCK_PX, columns, _BLOCK_PX)
    now = second[blocks].reshape(shape).astype(np.float32)
    change = now - first[blocks].reshape(shape)
    level = now.mean(axis=(1, 3))
    useful = (level > _FLAT[0]) & (level < _FLAT[1])
    if not useful.any():
        return None
    return float(np.median(change.std(axis=(1, 3))[useful])) / float(np.sqrt(2.0))


MOST_BLUR_CELLS = 0.8
"""Numbers lost to blur: none by 2.4 px in cells of 3 px (hard set S3), 1.5 % by 3.2 px in 4 px
(S4), up to 15 % by 2.4 px in 2 px (F2)."""
GOOD_BLUR_CELLS = 0.5
"""The blur to aim at: half of a cell costs nothing in any set."""
MOST_NOISE = 6.0
"""Up to this noise all robots were found and named; with 8 in the hard set 1.5 % were not."""
LEAST_LIGHT = 150.0
"""White paper at 150 above black at 60 already costs 1 % (low contrast)."""
GOOD_LIGHT = 200.0
"""White at 200 leaves room for places with stronger light."""
MOST_SATURATED = 0.01
"""Beyond this, bright paper spreads and moves the edges of markers."""


@dataclass(frozen=True, slots=True)
class ExposureReading:
    """What is known of a camera's pictures; None: unknown.

    `gain` has the camera's own unit; `noise` is a pixel's standard deviation [grey levels];
    `speed_m_s` is the robots', `cell_m` the side of a marker's cell, and `width` how wide it is
    in the picture.
    """

    exposure_us: float | None
    gain: float | None
    light: Brightness
    noise: float | None
    speed_m_s: float
    scale: PictureScale | None
    cell_m: float
    width: CellWidth | None

    @property
    def blur_px(self) -> float | None:
        """How far a robot moves during the exposure."""
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
        """The exposure that gives `GOOD_BLUR_CELLS` of blur."""
        return None if self.speed_m_s <= 0 else 1e6 * GOOD_BLUR_CELLS * self.cell_m / self.speed_m_s

    @property
    def is_blurred(self) -> bool:
        """Whether a moving robot's cells run into each other."""
        blur, cell = self.blur_px, self.cell_px
        return blur is not None and cell is not None and blur > MOST_BLUR_CELLS * cell


def advise(reading: ExposureReading) -> str:
    """Returns one line: what to change first, or that all is well."""
    light, width = reading.light, reading.width
    if width is not None and width.is_illegible:
        return width.in_words()
    if light.mean < DARK_LEVEL:
        return "the picture is dark: is there light, and is the lens open?" + _brighter(reading)
    if light.saturated > MOST_SATURATED:
        return f"{100.0 * light.saturated:.1f} % is saturated: {_darker(reading)}"
    if reading.is_blurred:
        return _sharper(reading)
    if light.light < LEAST_LIGHT:
        return f"dim: the lightest 1 % is at {light.light:.0f} of 255" + _brighter(reading)
    if reading.noise is not None and reading.noise > MOST_NOISE:
        text = f"noise {reading.noise:.1f}: above {MOST_NOISE:g} numbers are misread; less gain"
        return text + _longer(reading, ", and ")
    return width.in_words() if width is not None and width.is_small else "good: nothing to change"


def rounded(exposure_us: float) -> float:
    """Rounds an exposure down to two digits."""
    unit = 10.0 ** max(len(str(int(exposure_us))) - 2, 0)
    return float(exposure_us // unit * unit)


def _sharper(reading: ExposureReading) -> str:
    blur, cell, longest = reading.blur_px, reading.cell_px, reading.longest_us
    assert blur is not None and cell is not None and longest is not None
    exposure_us = rounded(longest)
    better = reading.blur_of(exposure_us)
    return (
        f"blur {blur:.1f} px: above {MOST_BLUR_CELLS * cell:.1f} px cells of {cell:.1f} px are"
        f" lost; exposure {exposure_us:g} us would give {better:.1f} px, then raise gain or light"
    )


def _darker(reading: ExposureReading) -> str:
    """Says how to get less light: less gain first, which also reduces noise."""
    if reading.exposure_us is None:
        return "less gain or exposure"
    shorter = f"exposure {rounded(reading.exposure_us / 2.0):g} us"
    return f"less gain, or {shorter}" if reading.gain else shorter


def _brighter(reading: ExposureReading) -> str:
    """Says how to get more light: exposure as far as the blur allows, then gain."""
    return _longer(reading, "; ") or "; more gain, or better more lamps"


def _longer(reading: ExposureReading, before: str) -> str:
    """Returns a longer exposure that is still sharp, or ""."""
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


@dataclass(frozen=True, slots=True)
class PictureScale:
    """Pixels per metre at the height of the markers, and for the user how they are known."""

    px_per_m: float
    source: str


def blur_px(exposure_us: float, speed_m_s: float, px_per_m: float) -> float:
    """Returns how far something moves in the picture during the exposure."""
    return speed_m_s * 1e-6 * exposure_us * px_per_m
