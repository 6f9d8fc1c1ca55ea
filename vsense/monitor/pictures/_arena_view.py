"""The arena from above with the virtual world and the robots drawn in.

The cameras' view lies beneath; without cameras it is plain paper with the real walls.
"""

from __future__ import annotations

import cv2
import numpy as np

from vsense.base.arena import Floats, Image
from vsense.base.canvas import INK, MUTED, SCALE, Canvas, Colour
from vsense.monitor.pictures._projections import FromAbove, upright
from vsense.monitor.pictures._scene import ArenaMoment, draw_ground, draw_scene

VIEW_PX = 900
"""Width of a view; its height follows from the arena."""

_PAPER = 247
_SOLID: Colour = (190, 184, 180)
_GRID: Colour = (230, 228, 226)
_GRID_M = 0.5
_MOST_LINES = 100


def draw(scene: ArenaMoment, width_px: int = VIEW_PX, scale: int = SCALE) -> Image:
    """Draws a moment, (h, w, 3) BGR, `scale` times as large as it will be shown."""
    snapshot = scene.snapshot
    size_m = np.array(snapshot.arena.size_m[:2])
    view = FromAbove(size_m, width_px)
    canvas = Canvas(*view.size_px, scale)
    if scene.view is None:
        canvas.image[:] = _PAPER
        _grid(canvas, view, size_m)
    else:
        _lay_beneath(canvas, scene.view)
    draw_ground(canvas, snapshot, view)
    for solid in snapshot.physical if scene.view is None else ():
        outline = view.area(upright(solid.outline_m, 0.0))
        canvas.fill(outline, _SOLID)
        canvas.lines(outline, MUTED, 1.0, closed=True)
    draw_scene(canvas, scene, view)
    _scale_bar(canvas, view.zoom)
    return canvas.image


def _lay_beneath(canvas: Canvas, picture: Image) -> None:
    height, width = canvas.image.shape[:2]
    large = cv2.resize(picture, (width, height), interpolation=cv2.INTER_CUBIC)
    grey = cv2.cvtColor(large, cv2.COLOR_GRAY2BGR)
    # A lighter floor makes the drawing clear and keeps the cameras' view visible.
    canvas.image[:] = cv2.addWeighted(grey, 0.72, np.full_like(grey, 255), 0.28, 0)


def _grid(canvas: Canvas, view: FromAbove, size_m: Floats) -> None:
    """Draws lines half a metre apart, through the arena's middle; none in an arena of hundreds."""
    if size_m.max() > _MOST_LINES * _GRID_M:
        return
    half = size_m / 2.0
    for axis in (0, 1):
        last = int(np.ceil(half[axis] / _GRID_M)) - 1
        for number in range(-last, last + 1):
            ends = np.zeros((2, 3))
            ends[:, axis] = number * _GRID_M
            ends[:, 1 - axis] = -half[1 - axis], half[1 - axis]
            canvas.lines(view.area(ends), _GRID, 1.0)


def _scale_bar(canvas: Canvas, zoom: float) -> None:
    bottom = canvas.image.shape[0] / canvas.scale - 16.0
    canvas.lines(np.array([[16.0, bottom], [16.0 + zoom / 2.0, bottom]]), INK, 2.0)
    canvas.text("0.5 m", 16.0, bottom - 8.0, INK, 0.45)
