"""Cameras that nobody has calibrated, looked through as a tracking session does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from vsense.config.tracking_specs import (
    CameraTrackerSpec,
    GrabberSpec,
    RecordSpec,
    Resources,
    TrackerSpec,
    TrackingSession,
)
from vsense.tracking.camera import Camera

AWAY_M = 2.5
"""So high they hang as far as anybody is told."""
NO_TRACKER = "not calibrated"

Size = tuple[int, int]


def session_of(
    name: str,
    specs: Sequence[GrabberSpec],
    sizes_px: Mapping[str, Size],
    px_per_m: float | None = None,
) -> TrackingSession:
    """Makes a tracking session that looks straight down through cameras, and tracks nobody.

    Args:
        name: what it is called.
        specs: the cameras' grabbers.
        sizes_px: width and height of their pictures, by their ids.
        px_per_m: the pictures' scale, where it is known.
    """
    tracker = TrackerSpec(NO_TRACKER, "", 0.0, {}, 1.0, True, 0)
    views = tuple(
        CameraTrackerSpec(spec, _camera(spec.id, sizes_px[spec.id], px_per_m), tracker, spec.line)
        for spec in specs
    )
    record = RecordSpec(False, False, Path(), "png", 0)
    resources = Resources(name, {spec.id: spec for spec in specs}, {}, {})
    return TrackingSession(name, resources, 0, 1, 0.3, views, record)


def sizes_of(session: TrackingSession) -> dict[str, Size]:
    """Gives width and height of all cameras' pictures, by their ids."""
    return {v.camera.id: (v.camera.width_px, v.camera.height_px) for v in session.views}


def _camera(id: str, size_px: Size, px_per_m: float | None) -> Camera:
    focal_px = float(max(size_px)) if px_per_m is None else AWAY_M * px_per_m
    return Camera.looking_down(id, 0.0, 0.0, AWAY_M, focal_px, size_px)
