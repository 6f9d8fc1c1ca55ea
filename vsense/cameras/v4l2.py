"""STUB until wip-checks."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class V4l2Device:
    path: str
    name: str
    bus: str
    formats: tuple[str, ...]
    size_px: tuple[int, int] | None
    rate_hz: float | None
    trouble: str


def devices() -> list[V4l2Device]:
    return []
