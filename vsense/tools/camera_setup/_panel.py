"""A camera's pictures measured, and as a block of text: histogram, figures, advice."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Image
from vsense.tools.camera_setup._advice import (
    ExposureReading,
    PictureScale,
    advise,
    brightness,
    noise,
)
from vsense.vision.cameras.source import EXPOSURE, GAIN, Controls
from vsense.vision.markers.families import MarkerFamily, SquareFamily
from vsense.vision.tracking.marker_finder import FoundMarkers, MarkerFinder
from vsense.vision.tracking.single_camera import OpenCamera

WIDTH = 80
BAR_COLUMNS = 32
ROWS = 4
_EIGHTHS = " ▁▂▃▄▅▆▇█"
_PLAIN = " .:|#"
"""For terminals without blocks."""
_INDENT = " " * 10
_TAGS_MAX = 48


@dataclass(frozen=True, slots=True)
class PanelView:
    """What to show of a camera at one moment.

    `size_px` is (width, height); `rate_hz` is None after the first picture; `family` names the
    markers that were looked for.
    """

    id: str
    size_px: tuple[int, int]
    rate_hz: float | None
    reading: ExposureReading
    family: str
    markers: FoundMarkers


class Tuner:
    """Measures the pictures of a camera."""

    def __init__(
        self,
        camera: OpenCamera,
        family: MarkerFamily | SquareFamily,
        finder: MarkerFinder,
        speed_m_s: float,
        wanted: Controls,
        scale: PictureScale | None,
    ) -> None:
        """Takes an open camera, the markers to look for, and what the user knows of the picture.

        `speed_m_s` is the robots'; `wanted` is what the camera was asked for.
        """
        self.camera = camera
        self.family = family
        self.speed_m_s = speed_m_s
        self._wanted = {EXPOSURE: wanted.exposure_us, GAIN: wanted.gain_raw}
        self._scale = scale
        self._finder = finder

    @property
    def cell_m(self) -> float:
        """Side of a marker's cell."""
        return 1e-3 * float(self.family.cell_mm)

    def view(self, first: Image, second: Image, rate_hz: float | None) -> PanelView:
        """Measures two pictures in a row, which come at `rate_hz`."""
        seen = self._finder.find(second)
        scale = self._scale
        if scale is None and self._finder.px_per_m is not None:
            scale = PictureScale(self._finder.px_per_m, "size of the markers")
        reading = ExposureReading(
            self._value(EXPOSURE),
            self._value(GAIN),
            brightness(second),
            noise(first, second),
            self.speed_m_s,
            scale,
            self.cell_m,
            None if scale is None else self._finder.cell_width(scale.px_per_m),
        )
        height, width = second.shape
        return PanelView(self.camera.id, (width, height), rate_hz, reading, self.family.name, seen)

    def _value(self, name: str) -> float | None:
        """Returns a camera's own value, or else the one it was asked for."""
        controls = self.camera.controls
        value = None if controls is None else controls.value(name)
        return self._wanted[name] if value is None else value


def lines(view: PanelView, blocks: bool = True) -> list[str]:
    """Returns the block's lines, none wider than `WIDTH`; `blocks`: with block characters."""
    light = view.reading.light
    bars = histogram(light.counts, blocks)
    return [
        _head(view),
        "",
        *(f"{_INDENT}{bar}" for bar in bars),
        f"{_INDENT}0       64      128     192   255",
        "",
        f"light     mean {light.mean:.0f}, 1 % below {light.dark:.0f}, 1 % above {light.light:.0f};"
        f" saturated {100 * light.saturated:.1f} %, black {100 * light.black:.1f} %",
        f"noise     {_noise(view.reading)}",
        f"blur      {_blur(view.reading)}",
        f"markers   {_markers(view)}",
        *textwrap.wrap(f"advice    {advise(view.reading)}", WIDTH, subsequent_indent=_INDENT),
    ]


def histogram(counts: NDArray[np.int64], blocks: bool = True) -> list[str]:
    """Draws (256,) counts as `ROWS` lines of `BAR_COLUMNS` characters.

    Heights are square roots of the counts, so that the few pixels of markers can be seen.
    """
    steps = _EIGHTHS if blocks else _PLAIN
    fine = len(steps) - 1
    sums = np.sqrt(counts.reshape(BAR_COLUMNS, -1).sum(axis=1))
    heights = np.ceil(sums / max(sums.max(), 1.0) * ROWS * fine).astype(int)
    return [
        "".join(steps[min(max(height - row * fine, 0), fine)] for height in heights)
        for row in reversed(range(ROWS))
    ]


def facts(view: PanelView) -> dict[str, Any]:
    """Returns the same as JSON values."""
    reading, light = view.reading, view.reading.light
    scale = reading.scale
    return {
        "id": view.id,
        "width_px": view.size_px[0],
        "height_px": view.size_px[1],
        "rate_hz": _round(view.rate_hz, 2),
        "exposure_us": reading.exposure_us,
        "gain": reading.gain,
        "histogram": light.counts.reshape(BAR_COLUMNS, -1).sum(axis=1).tolist(),
        "mean": round(light.mean, 2),
        "p1": light.dark,
        "p99": light.light,
        "saturated": round(light.saturated, 5),
        "black": round(light.black, 5),
        "noise": _round(reading.noise, 2),
        "speed_m_s": reading.speed_m_s,
        "px_per_m": None if scale is None else round(scale.px_per_m, 1),
        "px_per_m_from": None if scale is None else scale.source,
        "blur_px": _round(reading.blur_px, 2),
        "family": view.family,
        "markers": view.markers.count,
        "tags": list(view.markers.tags),
        "advice": advise(reading),
    }


def _head(view: PanelView) -> str:
    width, height = view.size_px
    parts = [f"{width} x {height} px"]
    if view.rate_hz is not None:
        parts.append(f"{view.rate_hz:.1f} pictures/s")
    if view.reading.exposure_us is not None:
        parts.append(f"exposure {view.reading.exposure_us:g} us")
    if view.reading.gain is not None:
        parts.append(f"gain {view.reading.gain:g}")
    return f"{view.id}: {', '.join(parts)}"


def _noise(reading: ExposureReading) -> str:
    if reading.noise is None:
        return "unknown: the picture is black or white all over"
    return f"{reading.noise:.1f} grey levels"


def _blur(reading: ExposureReading) -> str:
    if reading.scale is None:
        return "unknown: no marker in the picture gives its scale; give --px-per-m"
    scale = f"{reading.scale.px_per_m:.0f} px/m ({reading.scale.source})"
    if reading.blur_px is None:
        return f"unknown: the camera does not report its exposure; {scale}"
    return f"{reading.blur_px:.1f} px at {reading.speed_m_s:g} m/s, {scale}"


def _markers(view: PanelView) -> str:
    count, tags = view.markers.count, view.markers.tags
    if count == 0:
        return f"none of {view.family}"
    return f"{count} of {view.family}: {_numbers(tags)}"


def _numbers(tags: Sequence[int]) -> str:
    """Returns as many numbers as fit the line."""
    if not tags:
        return "no number could be read"
    shown: list[str] = []
    for number, tag in enumerate(tags):
        if len(" ".join([*shown, str(tag)])) > _TAGS_MAX:
            return f"{' '.join(shown)} and {len(tags) - number} more"
        shown.append(str(tag))
    return " ".join(shown)


def _round(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)
