"""A picture of one arena state: every camera's picture with its detections drawn in."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import UNNAMED, ArenaState, Floats, Frame, Image
from vsense.base.canvas import FONT, INK, MUTED, Canvas, Colour
from vsense.monitor.pictures._projections import ThroughLens
from vsense.monitor.pictures._views import as_they_hang, levels_of, lightened
from vsense.vision.cameras.camera import Camera

PANEL_PX = 960
"""Width of one camera's picture in the finished one."""

_MARGIN = 24
_HEAD = 92
_CAPTION = 40
_ZOOM = 2
_RING_M = 0.038
_ARROW_M = 0.085
_NAMED: Colour = (110, 150, 0)
_TWICE: Colour = (200, 60, 200)
_NAMELESS: Colour = (48, 48, 226)
_CARRIED: Colour = (40, 140, 245)
_SIZE = 0.55 * _ZOOM
_PAD = 3 * _ZOOM
_TURNS = (0.0, 0.8, -0.8, 1.6, -1.6, 2.4, -2.4)
"""Possible places of a name, as angles from right behind the robot."""


def draw(
    state: ArenaState,
    frames: Sequence[Frame],
    cameras: Sequence[Camera],
    detections: Mapping[str, NDArray[np.void]],
    heights_m: Mapping[int, float],
) -> Image:
    """Draws one arena state and the pictures that it was made of.

    `detections` are the cameras' DETECTION arrays, `heights_m` the heights of the tags' markers
    above the floor.

    Returns:
        (h, w, 3) uint8 BGR: the cameras as they hang above the arena, +y up.
    """
    images = {frame.camera: frame.image for frame in frames}
    panels = [
        [_panel(images.get(c.id), c, state, detections.get(c.id), heights_m) for c in row]
        for row in as_they_hang(cameras)
    ]
    widest = max(sum(p.shape[1] + _MARGIN for p in row) for row in panels)
    heights = [max(p.shape[0] for p in row) + _CAPTION + _MARGIN for row in panels]
    canvas = np.full((_HEAD + sum(heights), widest + _MARGIN, 3), 255, np.uint8)
    _head(canvas, state)
    top = _HEAD
    for row, row_panels, height in zip(as_they_hang(cameras), panels, heights):
        left = _MARGIN
        for camera, panel in zip(row, row_panels):
            canvas[top : top + panel.shape[0], left : left + panel.shape[1]] = panel
            caption = _caption(camera, detections.get(camera.id))
            _text(canvas, caption, (left, top + panel.shape[0] + 26), INK, 0.6)
            left += panel.shape[1] + _MARGIN
        top += height
    return canvas


def _head(canvas: Image, state: ArenaState) -> None:
    robots = state.robots
    seen = int(robots["seen"].sum())
    facts = [f"{seen} of {len(robots)} robots seen", f"{state.unnamed} without a name"]
    if state.duplicates:
        facts.append(f"there twice: {', '.join(map(str, state.duplicates))}")
    _text(canvas, f"timestep {state.timestep}", (_MARGIN, 44), INK, 1.0)
    _text(canvas, ", ".join(facts), (_MARGIN, 74), MUTED, 0.55)
    legend = [("named", _NAMED), ("from another camera, or carried on", _CARRIED)]
    legend += [("without a name", _NAMELESS), ("there twice", _TWICE)]
    right = canvas.shape[1] - _MARGIN
    for word, colour in reversed(legend):
        right -= cv2.getTextSize(word, FONT, 0.55, 1)[0][0]
        _text(canvas, word, (right, 74), MUTED, 0.55)
        cv2.circle(canvas, (right - 14, 68), 7, colour, 3, cv2.LINE_AA)
        right -= 44


def _caption(camera: Camera, rows: NDArray[np.void] | None) -> str:
    if rows is None:
        return f"{camera.id}: no picture"
    named = int((rows["tag"] != UNNAMED).sum())
    return f"{camera.id}: {named} marker{'s' if named != 1 else ''}"


def _panel(
    image: Image | None,
    camera: Camera,
    state: ArenaState,
    rows: NDArray[np.void] | None,
    heights_m: Mapping[int, float],
) -> Image:
    """One camera's picture with its markers, drawn large and reduced at the end."""
    size = (PANEL_PX, round(PANEL_PX * camera.height_px / camera.width_px))
    if image is None or rows is None:
        return np.full((size[1], size[0], 3), 235, np.uint8)
    large = (size[0] * _ZOOM, size[1] * _ZOOM)
    panel = lightened(image, large, levels_of(image))
    pen = _Pen(panel, camera)
    seen = set(rows["tag"].tolist())
    for robot in state.robots:
        tag = int(robot["tag"])
        place = np.array((robot["x_m"], robot["y_m"], heights_m[tag]))
        if tag not in seen and camera.contains(camera.project(place)):
            pen.robot(place, float(robot["yaw_rad"]), str(tag), _CARRIED)
    usual_m = float(np.median(list(heights_m.values())))
    for row in rows:
        tag = int(row["tag"])
        height_m = heights_m.get(tag, usual_m)
        ground = camera.to_plane(np.array((row["x_px"], row["y_px"])), height_m)
        colour = _TWICE if tag in state.duplicates else _NAMED
        name = str(tag) if tag != UNNAMED else "?"
        place = np.array((*ground, height_m))
        pen.robot(place, float(row["yaw_rad"]), name, _NAMELESS if tag == UNNAMED else colour)
    pen.write_names()
    return np.asarray(cv2.resize(pen.canvas, size, interpolation=cv2.INTER_AREA), np.uint8)


@dataclass(frozen=True, slots=True)
class _Name:
    """A name to be written: the place of its robot, and the direction behind the robot."""

    text: str
    colour: Colour
    middle: Floats
    ring: float
    behind_rad: float


class _Pen:
    """Draws robots into one camera's picture, through its lens."""

    def __init__(self, canvas: Image, camera: Camera) -> None:
        self.canvas = canvas
        self._pen = Canvas.over(canvas)
        self._view = ThroughLens(camera, canvas.shape[1], np.zeros(2))
        self._names: list[_Name] = []

    def robot(self, place_m: Floats, yaw_rad: float, name: str, colour: Colour) -> None:
        """Draws a ring around a robot's marker and an arrow along its heading."""
        turn = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
        rim = place_m + _RING_M * np.stack((np.cos(turn), np.sin(turn), 0.0 * turn), axis=-1)
        ahead = np.array((math.cos(yaw_rad), math.sin(yaw_rad), 0.0))
        ends = place_m + np.outer((_RING_M, _ARROW_M, 0.0, -_ARROW_M), ahead)
        spots = [spot[0] for spot in map(self._view.spot, ends) if spot is not None]
        if len(spots) < len(ends):
            return
        for piece in self._view.line(rim, closed=True):
            self._pen.lines(piece, colour, 3 * _ZOOM)
        start, tip, middle, back = spots
        foot, head = (np.rint(end).astype(int).tolist() for end in (start, tip))
        cv2.arrowedLine(self.canvas, foot, head, colour, 3 * _ZOOM, cv2.LINE_AA, 0, 0.35)
        behind_rad = math.atan2(*(back - middle)[::-1])
        self._names.append(_Name(name, colour, middle, math.dist(middle, start), behind_rad))

    def write_names(self) -> None:
        """Writes all names, each where it covers no robot and no other name, if possible."""
        taken = [(name.middle, np.full(2, name.ring)) for name in self._names]
        for name in self._names:
            (width, height), _ = cv2.getTextSize(name.text, FONT, _SIZE, _ZOOM)
            half = np.array((width / 2, height / 2)) + _PAD
            places = [self._beside(name, half, turn) for turn in _TURNS]
            free = [p for p in places if not _covers(p, half, taken)]
            place = (free or places)[0]
            taken.append((place, half))
            low, high = np.rint(place - half).astype(int), np.rint(place + half).astype(int)
            cv2.rectangle(self.canvas, low.tolist(), high.tolist(), (255, 255, 255), -1)
            cv2.rectangle(self.canvas, low.tolist(), high.tolist(), name.colour, _ZOOM)
            base = (int(low[0]) + _PAD, int(high[1]) - _PAD)
            cv2.putText(self.canvas, name.text, base, FONT, _SIZE, INK, _ZOOM, cv2.LINE_AA)

    def _beside(self, name: _Name, half: Floats, turn_rad: float) -> Floats:
        """The middle of a name's plate beside its robot, inside the picture."""
        angle = name.behind_rad + turn_rad
        way = np.array((math.cos(angle), math.sin(angle)))
        out = name.ring + _PAD + float(np.min(half / np.maximum(np.abs(way), 1e-3)))
        limit = np.array(self.canvas.shape[1::-1]) - half - _PAD
        return np.asarray(np.clip(name.middle + out * way, half + _PAD, limit))


def _covers(place: Floats, half: Floats, taken: Sequence[tuple[Floats, Floats]]) -> bool:
    """Whether a plate overlaps with another one or with a robot."""
    return any(bool(np.all(np.abs(place - p) < half + h)) for p, h in taken)


def _text(canvas: Image, text: str, at: tuple[int, int], colour: Colour, size: float) -> None:
    cv2.putText(canvas, text, at, FONT, size, colour, 1, cv2.LINE_AA)
