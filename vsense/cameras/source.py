"""The seam of every kind of live camera, and the words for what it made of a setting."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

from vsense.cameras.picture import Image

Value = float | str
"""A setting's value: a number in the setting's own unit, or a word such as "Mono8"."""
Bounds = tuple[float, float]
"""The smallest and the largest value that a camera takes."""

SILENCE_S = 0.4
"""A camera that says nothing for this long, and for three periods, is silent."""
PERIODS = 3
FIRST_S = 2.0
"""Some need a while for their first picture."""

_SAME = 1e-6
"""Relative difference below which a number read back is the number asked for."""


@dataclass(frozen=True, slots=True)
class Shot:
    """A picture as a camera hands it over.

    Attributes:
        image: (h, w) uint8; the memory may be the driver's own, and stays valid as long as
            anybody refers to it.
        stamp_ns: When it was taken by the camera's own clock, whatever its zero; None: it has none.
        arrived_ns: When its first bytes reached the host, by the host's monotonic clock; None:
            nobody noted it.
    """

    image: Image
    stamp_ns: int | None = None
    arrived_ns: int | None = None


class Source(Protocol):
    """One camera; belongs to one thread."""

    def open(self) -> list[str]:
        """Opens it, or takes up again what was interrupted, and sets what it was asked for.

        Returns:
            What the camera made of that where it is not what was asked for: a text for each
            setting that it refused or rounded, such as "does not take gain_raw 99".

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
        """Lets it go; can be called again."""


def silence_s(rate_hz: float | None) -> float:
    """Gives how long a camera may say nothing between two pictures [s].

    Args:
        rate_hz: Pictures per second that it should give; None: unknown.
    """
    return max(SILENCE_S, PERIODS / rate_hz if rate_hz else 0.0)


def absent(name: str) -> str:
    """Says that a camera does not know a setting at all."""
    return f"has no {name}"


def refused(name: str, wanted: Value, kept: Value | None, bounds: Bounds | None = None) -> str:
    """Says that a camera did not take a value.

    Args:
        name: The setting, as the user wrote it.
        wanted: What it was asked for.
        kept: What it has instead; None: it does not tell.
        bounds: What it would have taken; None: unknown.
    """
    would = "" if bounds is None else f" ({_text(bounds[0])} to {_text(bounds[1])})"
    instead = "" if kept is None else f": keeps {_text(kept)}"
    return f"does not take {name} {_text(wanted)}{would}{instead}"


def said(name: str, wanted: Value, got: Value, bounds: Bounds | None = None) -> str | None:
    """Says what a camera made of a value that it has been given.

    Args:
        name: The setting, as the user wrote it.
        wanted: What it was asked for.
        got: What was read back.
        bounds: What it takes; a value beyond is refused, one within is rounded.

    Returns:
        None where it has what was asked for.
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
    """Writes a value with all its digits that matter, whole numbers without a point."""
    if isinstance(value, str):
        return value
    return f"{value:.0f}" if float(value).is_integer() else f"{value:.7g}"
