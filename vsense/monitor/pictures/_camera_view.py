"""A camera's picture with the virtual world drawn in, through the camera's own lens."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import cv2
import numpy as np

from vsense.base.arena import Floats, Image
from vsense.base.canvas import Canvas, Colour
from vsense.monitor.pictures._projections import ThroughLens
from vsense.monitor.pictures._scene import ArenaMoment, draw_ground, draw_scene
from vsense.vision.cameras.camera import Camera

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


def draw(
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
                panel = draw(moments[camera.id], picture, view, levels, title, scale)
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
