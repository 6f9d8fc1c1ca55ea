"""`vsense cameras list`: the cameras that are there, as a table or as JSON."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from vsense.base.terminal import aligned
from vsense.vision.cameras.discovery import FoundCamera, find
from vsense.vision.cameras.genicam import PIXEL_FORMATS

HEAD = ("id", "kind", "address", "model", "resolution", "rate", "formats")
FORMATS_SHOWN = 3
_UNKNOWN = "-"


def lines(found: Sequence[FoundCamera]) -> list[str]:
    """Returns a row for each camera, with its trouble below."""
    head, *rows = aligned([HEAD, *(_row(camera) for camera in found)])
    table = [head]
    for camera, row in zip(found, rows):
        table.append(row)
        if camera.trouble:
            table.append(f"  ! {camera.trouble}")
    return table


def facts(camera: FoundCamera) -> dict[str, Any]:
    """Returns a camera as JSON values; null is unknown."""
    details = asdict(camera.details)
    width, height = details.pop("size_px") or (None, None)
    return {
        "id": camera.id,
        "kind": camera.kind,
        "address": camera.address or None,
        "model": camera.model,
        "serial": camera.serial or None,
        "mac": camera.mac or None,
        "width_px": width,
        "height_px": height,
        **details,
        "trouble": camera.trouble or None,
    }


def formats(names: Sequence[str]) -> str:
    """Returns the first few formats, those that vsense takes first."""
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


NOTHING = (
    "no camera found. What to check:",
    "  power and cable: does the camera's lamp shine? PoE needs a switch or an injector for it.",
    "  network: is this host on the cameras' network (ip -4 addr)? A firewall passes UDP 3956?",
    "  /dev/video*: is there one, and are you in the group video (groups)?",
)


def run(as_json: bool) -> int:
    """Prints the table or JSON; without cameras, what to check on standard error, and 1."""
    if sys.stderr.isatty():
        print("asking who is there ...", end="", file=sys.stderr, flush=True)
    found, missing = find()
    if sys.stderr.isatty():
        print("\r\x1b[K", end="", file=sys.stderr, flush=True)
    if as_json:
        print(json.dumps([facts(camera) for camera in found], indent=2))
    elif found:
        print("\n".join(lines(found)))
    if missing:
        print(f"vsense: {missing}", file=sys.stderr)
    if not found:
        print("\n".join(NOTHING), file=sys.stderr)
    return int(not found)
