"""A short scene before two cameras: robots that drive, hide, are there twice, and come anew."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache

from tests.vision.tracking.synthetic import HEIGHT_M, Robot, render
from vsense.base.arena import Frame
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import MarkerFamily, load_family

FAMILY = "arrow4x4"
STEP_NS = 100_000_000
TIMESTEPS = 24
CAMERAS = [
    Camera.looking_down(name, x_m, 0.0, 2.43, 1200.0, (360, 280), (-0.1, 0.01, 1e-4, -1e-4, 0.0))
    for name, x_m in (("right", 0.15), ("left", -0.15))
]
STRANGER = 1234
HEIGHTS_M = {3: HEIGHT_M, 14: HEIGHT_M, 77: HEIGHT_M}


def robots(timestep: int) -> list[Robot]:
    """Where everybody is."""
    gone = 0.008 * timestep
    turned = 0.05 * timestep
    found = [
        Robot(3, -0.2 + gone, 0.05, turned),
        Robot(STRANGER, 0.2, -0.06 + 0.2 * gone, 1.0 - turned),
    ]
    if not 8 <= timestep < 12:
        found.append(Robot(14, 0.1 - gone, -0.05, 2.0 + turned))
    if timestep in (15, 16):
        found.append(Robot(3, 0.2, 0.07, 0.0))
    if timestep > 6:
        found.append(Robot(77, -0.25, 0.07, math.pi - turned))
    return found


@cache
def frames(timestep: int, cameras: int = 2) -> Sequence[Frame]:
    """The pictures of a timestep."""
    family = load_family(FAMILY)
    assert isinstance(family, MarkerFamily)
    at_ns = (timestep + 100) * STEP_NS
    return [
        Frame(
            camera.id,
            render(camera, family, robots(timestep), seed=2 * timestep + place),
            timestep,
            at_ns + 1_000_000 * place,
            at_ns + 20_000_000,
        )
        for place, camera in enumerate(CAMERAS[:cameras])
    ]
