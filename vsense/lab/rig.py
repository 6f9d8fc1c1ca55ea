"""Where the lab's cameras hang: two by two above the arena, looking straight down."""

from __future__ import annotations

import numpy as np

from vsense.config.specs import Arena
from vsense.lab.shared import LabError
from vsense.tracking.camera import Camera

HEIGHT_M = 2.43
"""Above the floor. Source: thesis, 2.1."""
FOCAL_PX = 1620.0
"""Gives 1.5 mm per pixel on the floor."""
SIZE_PX = (1620, 1220)
"""Width and height of a picture. Source: thesis, 2.1."""
DISTORTION = (-0.12, 0.02, 0.0, 0.0, 0.0)
"""A barrel of 47 px in the corners."""

_TALLEST_M = 0.15
_MARGIN_M = 0.05


def rig(arena: Arena) -> list[Camera]:
    """Hangs up four cameras, "cam_0_0" to "cam_1_1": column and row, from low x and y.

    Each stands above the middle of its quarter of the arena and sees at least 5 cm beyond it,
    so that every marker is whole in one picture.

    Raises:
        LabError: The arena is too large for four cameras.
    """
    size_x, size_y = arena.size_m[:2]
    test = _camera("test", 0.0, 0.0)
    corner = np.array((test.width_px - 1.0, 0.0))
    edges = np.array(((corner[0], test.cy_px), (test.cx_px, corner[1])))
    reach = test.to_plane(edges, _TALLEST_M)
    reach_x, reach_y = reach[0, 0] - _MARGIN_M, reach[1, 1] - _MARGIN_M
    if size_x > 4.0 * reach_x or size_y > 4.0 * reach_y:
        raise LabError(
            f"arena of {size_x:g} x {size_y:g} m: the lab's four cameras see at most "
            f"{4.0 * reach_x:.2f} x {4.0 * reach_y:.2f} m"
        )
    return [
        _camera(
            f"cam_{column}_{row}",
            arena.centre_m[0] + (column - 0.5) * size_x / 2.0,
            arena.centre_m[1] + (row - 0.5) * size_y / 2.0,
        )
        for row in range(2)
        for column in range(2)
    ]


def _camera(id: str, x_m: float, y_m: float) -> Camera:
    return Camera.looking_down(id, x_m, y_m, HEIGHT_M, FOCAL_PX, SIZE_PX, DISTORTION)
