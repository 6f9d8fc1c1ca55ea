"""Views of a board as ideal cameras would have them, without drawing a picture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vsense.modes.lab._camera_spec import rig
from vsense.modes.lab.board_studio import board_plan
from vsense.vision.calibration._views import BoardViews, View
from vsense.vision.calibration.board import Board
from vsense.vision.calibration.frame import BoardPose
from vsense.vision.cameras.camera import Camera
from vsense.world.entities import Arena

BOARD = Board.parse("charuco:7x5:80mm:4X4_50")
ARENA = Arena((3.0, 2.4, 1.0), (0.0, 0.0, 0.5))
CAMERAS = sorted(rig(ARENA), key=lambda camera: camera.id)
SIZE = (CAMERAS[0].width_px, CAMERAS[0].height_px)
PLAN = board_plan(CAMERAS, BOARD, 16, 24, 1)
ORIGIN = (float(PLAN[0][1].shift[0]), float(PLAN[0][1].shift[1]), 0.0)
"""Where the board's origin is at moment floor_00, which is not turned."""


def see(
    camera: Camera, moment: str, pose: BoardPose, noise: NDArray[np.float64] | None = None
) -> View:
    """One camera's view, empty where the board is out of sight."""
    pixels = camera.project(pose.apply(BOARD.points_m))
    if noise is not None:
        pixels = pixels + noise
    inside = camera.contains(pixels, 4.0)
    return View(camera.id, moment, np.flatnonzero(inside), pixels[inside])


def shoot(
    plan: Sequence[tuple[str, BoardPose]],
    cameras: Sequence[Camera] = CAMERAS,
    sigma_px: float = 0.04,
    seed: int = 1,
) -> BoardViews:
    """All views with eight corners or more."""
    rng = np.random.default_rng(seed)
    shape = (len(BOARD.points_m), 2)
    views = [
        see(camera, moment, pose, rng.normal(0.0, sigma_px, shape) if sigma_px else None)
        for moment, pose in plan
        for camera in cameras
    ]
    views = sorted((v for v in views if len(v.ids) >= 8), key=lambda v: (v.camera, v.moment))
    names = [camera.id for camera in cameras]
    return BoardViews(
        {camera.id: (camera.width_px, camera.height_px) for camera in cameras},
        views,
        {name: sum(view.camera == name for view in views) for name in names},
    )


def arena_grid(step_m: float = 0.1, height_m: float = 0.06) -> NDArray[np.float64]:
    """(n, 3) places of robots' markers all over the arena."""
    x, y = (np.arange(-s / 2, s / 2 + 1e-9, step_m) for s in ARENA.size_m[:2])
    flat = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return np.column_stack((flat, np.full(len(flat), height_m)))


def arena_errors_m(cameras: Sequence[Camera], height_m: float = 0.06) -> tuple[float, float]:
    """The worst error of a robot's place, and the worst step between two cameras.

    Robots are where the true cameras, `CAMERAS`, see them.
    """
    points = arena_grid(height_m=height_m)
    found = np.full((len(cameras), len(points), 2), np.nan)
    for number, (true, camera) in enumerate(zip(CAMERAS, cameras)):
        assert true.id == camera.id
        pixels = true.project(points)
        seen = true.contains(pixels)
        found[number, seen] = camera.to_plane(pixels[seen], height_m)
    error = np.linalg.norm(found - points[:, :2], axis=-1)
    step = np.linalg.norm(found[:, np.newaxis] - found[np.newaxis], axis=-1)
    return float(np.nanmax(error)), float(np.nanmax(step))
