"""What was found, as a table for people and as data for programs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from vsense.cameras.finding import FoundCamera
from vsense.tracking.genicam_settings import PIXEL_FORMATS

HEAD = ("id", "kind", "address", "model", "resolution", "rate", "formats")
FORMATS_SHOWN = 3
_UNKNOWN = "-"


def lines(found: Sequence[FoundCamera]) -> list[str]:
    """Gives a row for each camera, and what is wrong with it below that."""
    rows = [_row(camera) for camera in found]
    widths = [max(len(row[k]) for row in [HEAD, *rows]) for k in range(len(HEAD))]
    table = [_joined(HEAD, widths)]
    for camera, row in zip(found, rows):
        table.append(_joined(row, widths))
        if camera.trouble:
            table.append(f"  ! {camera.trouble}")
    return table


def facts(camera: FoundCamera) -> dict[str, Any]:
    """Gives a camera for programs; null is what it does not tell."""
    details = camera.details
    width, height = details.size_px or (None, None)
    return {
        "id": camera.id,
        "kind": camera.kind,
        "address": camera.address or None,
        "model": camera.model,
        "serial": camera.serial or None,
        "mac": camera.mac or None,
        "width_px": width,
        "height_px": height,
        "formats": list(details.formats),
        "rate_hz": details.rate_hz,
        "exposure_us": details.exposure_us,
        "exposure_bounds_us": details.exposure_bounds_us,
        "gain": details.gain,
        "gain_bounds": details.gain_bounds,
        "trouble": camera.trouble or None,
    }


def formats(names: Sequence[str]) -> str:
    """Gives the first few formats, those that vsense takes before all others."""
    usable = [name for name in PIXEL_FORMATS if name in names]
    ordered = [*usable, *(name for name in names if name not in usable)]
    more = len(ordered) - FORMATS_SHOWN
    shown = " ".join(ordered[:FORMATS_SHOWN])
    return f"{shown} +{more}" if more > 0 else shown or _UNKNOWN


def _row(camera: FoundCamera) -> tuple[str, ...]:
    details = camera.details
    size = _UNKNOWN if details.size_px is None else "x".join(map(str, details.size_px))
    rate = _UNKNOWN if details.rate_hz is None else f"{details.rate_hz:.4g} Hz"
    return (
        camera.id,
        camera.kind,
        camera.address or _UNKNOWN,
        camera.model or _UNKNOWN,
        size,
        rate,
        formats(details.formats),
    )


def _joined(row: Sequence[str], widths: Sequence[int]) -> str:
    return "  ".join(cell.ljust(width) for cell, width in zip(row, widths)).rstrip()
