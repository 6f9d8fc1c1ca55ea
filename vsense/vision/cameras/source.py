"""The interface of every kind of live camera, and messages about its settings."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

from vsense.base.arena import Found, Image


@dataclass(frozen=True, slots=True)
class Controls:
    """What a camera is asked for; None leaves its own choice.

    `size_px` is (width, height); `exposure_us` switches automatic exposure off; `gain_raw` has the
    camera's own unit.
    """

    size_px: tuple[int, int] | None = None
    rate_hz: float | None = None
    exposure_us: float | None = None
    gain_raw: float | None = None


Value = float | str
"""A setting's value: a number in the setting's own unit, or a word such as "Mono8"."""
Bounds = tuple[float, float]
"""The smallest and the largest value that a camera takes."""

CAMERA_SILENCE_S = 0.4
"""A camera without pictures for this time and three periods is silent."""
SILENCE_PERIODS = 3
FIRST_S = 2.0
"""Time that the first picture may take."""

_SAME = 1e-6
"""Relative difference below which a number read back is the number asked for."""


@dataclass(frozen=True, slots=True)
class Shot:
    """A picture as a camera delivers it.

    Attributes:
        image: (h, w) uint8; may be the driver's own memory, and stays valid while it is referred
            to.
        stamp_ns: Capture time by the camera's own clock, with any zero; None: it has none.
        arrived_ns: When its first bytes came, by the host's monotonic clock; None: unknown.
        capture_ns: Capture time by the host's monotonic clock, where somebody measures how the
            clocks differ; None: it follows from the two others.
        found: See `Frame`.
    """

    image: Image
    stamp_ns: int | None = None
    arrived_ns: int | None = None
    capture_ns: int | None = None
    found: Found | None = None


class Source(Protocol):
    """One camera; belongs to one thread."""

    def open(self) -> list[str]:
        """Opens it, or resumes after an interruption, and applies its settings.

        Returns:
            A text for each setting that it refused or rounded, such as "does not take gain_raw
            99".

        Raises:
            GrabberError: It does not open.
        """

    def read(self) -> Shot:
        """Waits for the next picture.

        Raises:
            PictureError: The picture cannot be used; the next one may be good.
            GrabberError: The camera is gone, or silent for too long.
        """

    def close(self) -> None:
        """Closes it; can be called again."""


def silence_s(rate_hz: float | None) -> float:
    """Returns the longest pause between two pictures [s] of a camera; rate None: unknown."""
    return max(CAMERA_SILENCE_S, SILENCE_PERIODS / rate_hz if rate_hz else 0.0)


def absent(name: str) -> str:
    """Says that a camera does not have a setting."""
    return f"has no {name}"


def refused(name: str, wanted: Value, actual: Value | None, bounds: Bounds | None = None) -> str:
    """Says that a camera did not take a value.

    `actual` is what it has instead, `bounds` what it would have taken; None: unknown.
    """
    would = "" if bounds is None else f" ({_text(bounds[0])} to {_text(bounds[1])})"
    instead = "" if actual is None else f": keeps {_text(actual)}"
    return f"does not take {name} {_text(wanted)}{would}{instead}"


def said(name: str, wanted: Value, got: Value, bounds: Bounds | None = None) -> str | None:
    """Describes how a value read back differs from the one asked for; None: it does not.

    A value beyond `bounds` was refused, one within was rounded.
    """
    if _same(wanted, got):
        return None
    if isinstance(wanted, str):
        return refused(name, wanted, got)
    if bounds is not None and not bounds[0] <= wanted <= bounds[1]:
        return refused(name, wanted, got, bounds)
    return f"takes {_text(got)} for {name} {_text(wanted)}"


def _same(wanted: Value, got: Value) -> bool:
    if isinstance(wanted, str) or isinstance(got, str):
        return wanted == got
    return math.isclose(wanted, got, rel_tol=_SAME, abs_tol=1e-9)


def _text(value: Value) -> str:
    """Writes a value with all digits that matter, whole numbers without a point."""
    if isinstance(value, str):
        return value
    return f"{value:.0f}" if float(value).is_integer() else f"{value:.7g}"


FREE = "free"
SOFTWARE = "software"
PIXEL_FORMATS = ("Mono8", "BayerRG8", "BayerGB8", "BayerGR8", "BayerBG8")
"""One byte per pixel. Bayer is taken as grey, which the camera's white balance keeps grey."""

NAMES = {
    "exposure_time_abs": ("ExposureTimeAbs", "ExposureTime"),
    "gain_raw": ("GainRaw", "Gain"),
    "offset_x": ("OffsetX",),
    "offset_y": ("OffsetY",),
    "width": ("Width",),
    "height": ("Height",),
    "pixel_format": ("PixelFormat",),
}
"""The resources file's name, and the cameras' names, the older one first."""
_TIMES = {
    "AcquisitionFrameRate": "frame_rate",
    "AcquisitionFrameRateAbs": "frame_rate",
    "TriggerMode": "trigger",
    "TriggerSource": "trigger",
    "GevSCPSPacketSize": "packet_size",
    "GevSCPD": "packet_delay",
}
"""Features that Aravis sets itself for these attributes."""
AUTOMATIC = {"exposure_time_abs": "ExposureAuto", "gain_raw": "GainAuto"}
"""Features that set these by themselves."""


@dataclass(frozen=True, slots=True)
class GenicamSettings:
    """What a camera is asked for; None leaves its own choice.

    Attributes:
        offset_px: Upper left corner of the part of the sensor that is read.
        pixel_format: One of `PIXEL_FORMATS`; None: the first of them that the camera has.
        packet_size: Bytes of a packet with its IP header; None: the largest that gets through.
        packet_delay_us: Pause between two packets.
        trigger: `FREE`, `SOFTWARE`, or the name of a line such as "Line1".
        features: Names and values of other features, set in this order.
    """

    controls: Controls
    offset_px: tuple[int, int] | None = None
    pixel_format: str | None = None
    packet_size: int | None = None
    packet_delay_us: float | None = None
    trigger: str = FREE
    features: tuple[tuple[str, str], ...] = ()


def attribute_of(feature: str) -> str | None:
    """Returns the resources file's own name for a feature; None: it has none."""
    named = {f: name for name, features in NAMES.items() for f in features}
    return named.get(feature) or _TIMES.get(feature)


EXPOSURE, GAIN = "exposure_time_abs", "gain_raw"
"""As in the resources file: exposure in us, gain in the camera's own unit."""
