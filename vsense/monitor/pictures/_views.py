"""The virtual world and the robots, drawn into the arena from above or into cameras' pictures.

From above the cameras' view lies beneath; without cameras it is plain paper with the real walls.
Into a camera's picture the world is drawn through the camera's own lens.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import cv2
import numpy as np

from vsense.base.arena import Floats, Image
from vsense.base.canvas import INK, MUTED, SCALE, Canvas, Colour
from vsense.monitor.pictures._projections import FromAbove, ThroughLens, upright
from vsense.monitor.pictures._scene import ArenaMoment, draw_ground, draw_scene
from vsense.vision.cameras.camera import Camera

VIEW_PX = 900
"""Width of a view; its height follows from the arena."""

_PAPER = 247
_SOLID: Colour = (190, 184, 180)
_GRID: Colour = (230, 228, 226)
_GRID_M = 0.5
_MOST_LINES = 100

_GAP_PX = 6
_EMPTY: Colour = (45, 38, 32)
_WHITE: Colour = (255, 255, 255)


class Levels(NamedTuple):
    """How grey levels are stretched, so that a dim arena can be seen: from where, and by what."""

    low: float
    gain: float


def levels_of(image: Image) -> Levels:
    """The levels that make a light picture of a grey one."""
    low, high = np.percentile(image[::8, ::8], (0.5, 99.5))
    return Levels(float(low), 190.0 / max(float(high - low), 20.0))


def lightened(image: Image, size: tuple[int, int], levels: Levels) -> Image:
    """A grey picture in another size (width, height) as (h, w, 3) BGR with other levels."""
    how = cv2.INTER_AREA if size[0] < image.shape[1] else cv2.INTER_CUBIC
    grey = cv2.resize(image, size, interpolation=how)
    light = np.clip((grey.astype(np.float32) - levels.low) * levels.gain + 50.0, 0.0, 255.0)
    return np.asarray(cv2.cvtColor(light.astype(np.uint8), cv2.COLOR_GRAY2BGR), np.uint8)


def as_they_hang(cameras: Sequence[Camera]) -> list[list[Camera]]:
    """Returns the cameras from above: rows from high y to low y, each from low x to high."""
    columns = max(1, round(math.sqrt(len(cameras))))
    ordered = sorted(cameras, key=lambda c: (-c.position_m[1], c.position_m[0]))
    rows = [ordered[k : k + columns] for k in range(0, len(ordered), columns)]
    return [sorted(row, key=lambda c: (c.position_m[0], c.id)) for row in rows]


def _draw_panel(
    moment: ArenaMoment,
    picture: Image | None,
    view: ThroughLens,
    levels: Levels,
    title: str,
    scale: int = 1,
) -> Image:
    """Draws a moment over a grey picture; None: there is none.

    (h, w, 3) BGR, `scale` times as large as it will be shown.
    """
    width, height = view.size_px
    if picture is None:
        canvas = Canvas(width, height, scale)
        canvas.image[:] = _EMPTY
        canvas.text(f"{title}: no picture", 8, 18, _WHITE, 0.45)
        return canvas.image
    size = (width * scale, height * scale)
    canvas = Canvas.over(lightened(picture, size, levels), scale)
    draw_ground(canvas, moment.snapshot, view)
    draw_scene(canvas, moment, view)
    shade = canvas.image[: 24 * scale]
    shade[:] = (shade * 0.5).astype(np.uint8)
    canvas.text(title, 8, 17, _WHITE, 0.45)
    return canvas.image


class CameraPanels:
    """The pictures of cameras side by side as they hang, from timestep to timestep.

    Args:
        cameras: in any order.
        width_px: of the whole; the height follows.
        middle_m: (2,) the arena's middle.
        scale: drawn so much larger than it will be shown.

    Attributes:
        size_px: width and height of the whole.
    """

    def __init__(
        self, cameras: Sequence[Camera], width_px: int, middle_m: Floats, scale: int = 1
    ) -> None:
        self._rows, self._scale = as_they_hang(cameras), scale
        columns = max(len(row) for row in self._rows)
        each_px = max((width_px - _GAP_PX * (columns - 1)) // columns, 1)
        self._views = {c.id: ThroughLens(c, each_px, middle_m) for c in cameras}
        self._heights = [max(self._views[c.id].size_px[1] for c in row) for row in self._rows]
        height = sum(self._heights) + _GAP_PX * (len(self._rows) - 1)
        self.size_px = (each_px * columns + _GAP_PX * (columns - 1), height)
        self._levels: dict[str, Levels] = {}

    def draw(
        self,
        moments: Mapping[str, ArenaMoment],
        pictures: Mapping[str, Image],
        paper: Colour,
        titles: Mapping[str, str] | None = None,
    ) -> Image:
        """Draws each camera's moment over its picture; between them is paper.

        All mappings are by the camera's id, which is also its title where there is no other.
        """
        scale = self._scale
        grid = np.full((self.size_px[1] * scale, self.size_px[0] * scale, 3), paper, np.uint8)
        top = 0
        for row, row_px in zip(self._rows, self._heights):
            left = 0
            for camera in row:
                view, picture = self._views[camera.id], pictures.get(camera.id)
                levels = self._levels_of(camera.id, picture)
                title = (titles or {}).get(camera.id, camera.id)
                panel = _draw_panel(moments[camera.id], picture, view, levels, title, scale)
                grid[top : top + panel.shape[0], left : left + panel.shape[1]] = panel
                left += panel.shape[1] + _GAP_PX * scale
            top += (row_px + _GAP_PX) * scale
        return grid

    def _levels_of(self, camera: str, picture: Image | None) -> Levels:
        """Of a camera's first picture, for all of them: each one's own would flicker."""
        if picture is not None and camera not in self._levels:
            self._levels[camera] = levels_of(picture)
        return self._levels.get(camera, Levels(0.0, 1.0))


def shape_of(cameras: Sequence[Camera]) -> float:
    """Width of the cameras' grid by its height."""
    rows = as_they_hang(cameras)
    columns = max(len(row) for row in rows)
    heights = (max(c.height_px / c.width_px for c in row) for row in rows)
    return columns / sum(heights)


def draw_from_above(scene: ArenaMoment, width_px: int = VIEW_PX, scale: int = SCALE) -> Image:
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
