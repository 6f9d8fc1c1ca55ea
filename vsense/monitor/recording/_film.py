"""The frames of a video: the arena, the cameras, the clock and the measures in one picture."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np

from vsense.base.arena import Image
from vsense.base.canvas import INK, MUTED, Canvas, Colour, width_of
from vsense.base.terminal import spoken
from vsense.monitor.pictures._scene import CONE, DARK
from vsense.monitor.pictures._views import CameraPanels, draw_from_above, shape_of
from vsense.monitor.recording import IN_CONE, LIT_IN_CONE
from vsense.monitor.recording._scenes import RecordedScenes
from vsense.vision.cameras.camera import Camera

PAD_PX, HEAD_PX = 16, 52
_STRIP, _COLUMN, _HIGHEST = 92, 260, 200
_PAPER: Colour = (242, 239, 236)
_CARD: Colour = (255, 255, 255)
_LINE: Colour = (231, 226, 221)
_RED: Colour = (46, 38, 196)
_LINES: tuple[Colour, ...] = (DARK, (60, 140, 60), (150, 60, 140), (90, 90, 90))
_OWN_LINES = {IN_CONE: CONE, LIT_IN_CONE: DARK}
_MOST_MEASURES = 4
_INVALID = "this run is invalid"
_SCALE = 0.35
"""Size of an axis' numbers."""
OLD_S = 0.5
"""An older picture is said to be old, over it."""

RecordedPicture = tuple[int, Image]
"""When it was captured [ns], and the grey picture."""


class Panel(NamedTuple):
    """A rectangle of the frame [px]."""

    x: int
    y: int
    width: int
    height: int


def arrange(
    size: tuple[int, int], shapes: Sequence[float], measures: bool
) -> tuple[list[Panel], Panel]:
    """Places panels of given shapes (width by height) side by side, and the measures.

    The measures stand below or on the right, where they leave more room for the panels.
    """
    width, height = size[0] - 2 * PAD_PX, size[1] - HEAD_PX - PAD_PX
    gaps = PAD_PX * (len(shapes) - 1)
    across, down = width - gaps, height
    if not measures:
        panel = min(down, across / sum(shapes))
        return _side_by_side(shapes, panel, (size[0], height)), Panel(0, 0, 0, 0)
    below = min(down - _STRIP - PAD_PX, across / sum(shapes))
    beside = min(down, (across - _COLUMN - PAD_PX) / sum(shapes))
    if below >= beside:
        panels = _side_by_side(shapes, below, (size[0], round(below)))
        top = HEAD_PX + round(below) + PAD_PX
        return panels, Panel(PAD_PX, top, width, size[1] - top - PAD_PX)
    panels = _side_by_side(shapes, beside, (size[0] - _COLUMN - PAD_PX, height))
    return panels, Panel(size[0] - PAD_PX - _COLUMN, HEAD_PX, _COLUMN, height)


def _side_by_side(shapes: Sequence[float], height: float, room: tuple[int, int]) -> list[Panel]:
    height = max(height, 8.0)
    widths = [max(int(shape * height), 8) for shape in shapes]
    left = (room[0] - sum(widths) - PAD_PX * (len(shapes) - 1)) // 2
    top = HEAD_PX + max((room[1] - int(height)) // 2, 0)
    places = []
    for width in widths:
        places.append(Panel(left, top, width, int(height)))
        left += width + PAD_PX
    return places


class Film:
    """Draws frames of one shape.

    Args:
        scenes: what is drawn.
        arena: whether the arena from above is shown.
        cameras: that are shown, in any order.
        size: width and height of a frame [px].
        measures: whether there are any.
        invalid: the run is: that stands over its pictures.

    Attributes:
        old_pictures: in how many frames a camera's picture was old, by its name.
    """

    def __init__(
        self,
        scenes: RecordedScenes,
        arena: bool,
        cameras: Sequence[Camera],
        size: tuple[int, int],
        measures: bool,
        invalid: bool = False,
    ) -> None:
        self._invalid = invalid
        self._scenes, self._cameras, self._size = scenes, cameras, size
        self.old_pictures = Counter[str]()
        size_m = scenes.arena.size_m
        shapes = [size_m[0] / size_m[1]] if arena else []
        shapes += [shape_of(cameras)] if cameras else []
        places, self._measures_at = arrange(size, shapes, measures)
        self._arena_at = places[0] if arena else None
        self._cameras_at = places[-1] if cameras else None
        middle = np.array(scenes.arena.centre_m[:2])
        if self._cameras_at is not None:
            self._grid = CameraPanels(cameras, self._cameras_at.width, middle)

    def frame(self, pictures: Mapping[str, RecordedPicture], now_ns: int) -> Image:
        """Draws the newest moment, and the cameras' pictures each with its own."""
        canvas = Canvas(*self._size, 1)
        canvas.image[:] = _PAPER
        self._head(canvas)
        moment = self._scenes.moment()
        if self._arena_at is not None:
            panel = None if moment is None else draw_from_above(moment, self._arena_at.width, 1)
            self._put(canvas, panel, self._arena_at)
        if self._cameras_at is not None:
            self._put(canvas, self._seen(pictures, now_ns), self._cameras_at)
        self._measures(canvas)
        return canvas.image

    def _head(self, canvas: Canvas) -> None:
        scenes = self._scenes
        canvas.text(scenes.name, PAD_PX, 36, INK, 0.9)
        if scenes.state not in ("", "running"):
            left = PAD_PX + width_of(scenes.name, 0.9, 1) + 24
            colour = _RED if scenes.state == "emergency" else MUTED
            canvas.text(scenes.state, left, 36, colour, 0.6)
        if self._invalid:
            middle = (self._size[0] - width_of(_INVALID, 0.6, 1)) / 2
            canvas.text(_INVALID, middle, 36, INK, 0.6)
        clock = "-:--.-" if scenes.time_s is None else clock_text(scenes.time_s)
        canvas.text(clock, self._size[0] - PAD_PX - width_of(clock, 0.9, 1), 36, INK, 0.9)

    def _seen(self, pictures: Mapping[str, RecordedPicture], now_ns: int) -> Image | None:
        """The cameras' newest pictures; where that is not new, its title says how old it is."""
        moments, images, titles = {}, {}, {}
        for camera in self._cameras:
            capture_ns, image = pictures.get(camera.id, (now_ns, None))
            moment = self._scenes.moment_at(capture_ns)
            if moment is None:
                return None
            # Ways of some seconds belong to the view from above.
            moments[camera.id] = replace(moment, trails=np.empty(0))
            old_s = (now_ns - capture_ns) / 1e9
            if image is not None:
                images[camera.id] = image if old_s <= OLD_S else _marked(image, old_s)
            else:
                titles[camera.id] = f"{camera.id}, no picture yet"
            if old_s > OLD_S:
                self.old_pictures[camera.id] += 1
                titles[camera.id] = f"{camera.id}, {old_s:.1f} s ago"
        return self._grid.draw(moments, images, _PAPER, titles)

    def _put(self, canvas: Canvas, panel: Image | None, place: Panel) -> None:
        if panel is None:
            canvas.text("nothing was seen yet", place.x + 12, place.y + 28, MUTED, 0.5)
            return
        height, width = panel.shape[:2]
        room = canvas.image[place.y : place.y + height, place.x : place.x + width]
        room[:] = panel[: room.shape[0], : room.shape[1]]

    def _measures(self, canvas: Canvas) -> None:
        """Draws each measure's value, and its line so far."""
        at = self._measures_at
        measures = list(self._scenes.measures.items())[:_MOST_MEASURES]
        if at.height == 0 or not measures:
            return
        beside = at.height > at.width
        size = ((at.height if beside else at.width) - PAD_PX * (len(measures) - 1)) // len(measures)
        size = min(size, _HIGHEST) if beside else size
        for number, (name, (times, values)) in enumerate(measures):
            ahead = number * (size + PAD_PX)
            box = (
                Panel(at.x, at.y + ahead, at.width, size)
                if beside
                else Panel(at.x + ahead, at.y, size, at.height)
            )
            colour = _OWN_LINES.get(name, _LINES[number % len(_LINES)])
            _measure(canvas, box, name, times, values, colour)


def _marked(image: Image, old_s: float) -> Image:
    """A picture that is old, paler, and with how old across it."""
    height, width = image.shape
    pale = np.asarray(image // 3 + 150, np.uint8)
    text, size = f"{old_s:.1f} s old", width / 240.0
    (across, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, size, 1)
    place = max((width - across) // 2, 0), height // 2
    cv2.putText(pale, text, place, cv2.FONT_HERSHEY_SIMPLEX, size, 0, max(width // 150, 1))
    return pale


def _measure(
    canvas: Canvas,
    box: Panel,
    name: str,
    times: Sequence[float],
    values: Sequence[float],
    colour: Colour,
) -> None:
    low, high = (box.x, box.y), (box.x + box.width, box.y + box.height)
    cv2.rectangle(canvas.image, low, high, _CARD, cv2.FILLED)
    cv2.rectangle(canvas.image, low, high, _LINE, 1)
    canvas.text(spoken(name), box.x + 12, box.y + 22, MUTED, 0.45)
    canvas.text(f"{values[-1]:.4g}", box.x + 12, box.y + 50, INK, 0.8)
    least, most = min(0.0, *values, 0.0), max(*values, 1e-9, 1e-9)
    left, top, bottom = box.x + 92, box.y + 34, box.y + box.height - 24
    right = box.x + box.width - 14
    for text, at_px in ((f"{most:.3g}", top + 8), (f"{least:.3g}", bottom)):
        canvas.text(text, box.x + box.width - 8 - width_of(text, _SCALE, 1), at_px, MUTED, _SCALE)
        right = min(right, box.x + box.width - 14 - round(width_of(text, _SCALE, 1)))
    for text, at_px in ((f"{times[0]:.0f} s", left), (f"{times[-1]:.0f} s", right)):
        canvas.text(text, at_px - width_of(text, _SCALE, 1) / 2, bottom + 15, MUTED, _SCALE)
    span_s = max(times[-1] - times[0], 1e-9)
    # No more points than there are pixels across.
    step = max(len(times) // max(right - left, 1), 1)
    # A measure holds until the next one: a line through stairs.
    seconds = np.repeat(np.array([*times[::step], times[-1]]), 2)[1:]
    numbers = np.repeat(np.array([*values[::step], values[-1]]), 2)[:-1]
    x = left + (right - left) * (seconds - times[0]) / span_s
    y = bottom - (bottom - top) * (numbers - least) / (most - least)
    ends = np.array([[left, bottom], [right, bottom]], np.float64)
    canvas.lines(ends, _LINE, 1.0)
    canvas.lines(np.stack((x, y), axis=-1), colour, 2.0)


def clock_text(time_s: float) -> str:
    """Minutes, seconds and tenths."""
    tenths = int(time_s * 10.0 + 1e-6)
    return f"{tenths // 600}:{tenths // 10 % 60:02}.{tenths % 10}"
