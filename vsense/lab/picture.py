"""`pollutant.png`: the arena before and after the wind turned, and the swarm over time.

Figures 5.1 and 5.2 of the thesis in one picture: two views of the arena as the cameras saw it with
the cone and the robots drawn in, and below them how many robots were in the cone and lit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.config.specs import BODY_RADIUS_M

Image = NDArray[np.uint8]
Colour = tuple[int, int, int]

SCALE = 2
"""Drawn this much larger and reduced at the end: smooth lines and letters."""
PANEL_PX_PER_M = 300
MARGIN = 40
CHART_HEIGHT = 300

INK: Colour = (50, 42, 38)
MUTED: Colour = (140, 130, 124)
GRID: Colour = (232, 228, 226)
CONE: Colour = (60, 140, 245)
LIT: Colour = (48, 48, 226)
DARK: Colour = (160, 96, 40)
FONT = cv2.FONT_HERSHEY_DUPLEX


@dataclass(frozen=True, slots=True)
class Scene:
    """One moment of the arena.

    Attributes:
        title: what moment this is.
        view: (h, w) grey top view of the floor, `PANEL_PX_PER_M` px per metre, +y up.
        cone_m: (3, 2) corners of the polluted triangle in the arena frame, apex first; None
            where nothing pollutes.
        poses: (n, 3) x, y in m and yaw in rad of the robots.
        lit: (n,) whether each robot's red LEDs are on.
        inside: (n,) whether each robot is in the cone.
    """

    title: str
    view: Image
    cone_m: NDArray[np.float64] | None
    poses: NDArray[np.float64]
    lit: NDArray[np.bool_]
    inside: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Curve:
    """The swarm over time.

    Attributes:
        time_s: (n + 1,) when each timestep began, and when the last one ended.
        inside: (n,) robots in the cone.
        lit: (n,) robots lit there.
        robots: number of robots.
        turn_s: when the wind turned, None if it did not.
    """

    time_s: NDArray[np.float64]
    inside: NDArray[np.int64]
    lit: NDArray[np.int64]
    robots: int
    turn_s: float | None


def draw(heading: str, subtitle: str, scenes: Sequence[Scene], curve: Curve | None) -> Image:
    """Draws the whole picture.

    Args:
        heading: what experiment this is.
        subtitle: how it was run.
        scenes: at least one moment, all of the same size.
        curve: the swarm over time; None: no chart.

    Returns:
        (h, w, 3) BGR image.
    """
    panels = [_panel(scene) for scene in scenes]
    height, width = panels[0].shape[:2]
    total_width = SCALE * MARGIN * (len(panels) + 1) + width * len(panels)
    top = SCALE * 116
    chart_top = top + height + SCALE * 96
    chart_height = 0 if curve is None else SCALE * (CHART_HEIGHT + 64)
    canvas = np.full((chart_top + chart_height, total_width, 3), 255, np.uint8)
    _text(canvas, heading, (MARGIN, 50), INK, 1.0)
    _text(canvas, subtitle, (MARGIN, 78), MUTED, 0.52)
    for index, (scene, panel) in enumerate(zip(scenes, panels)):
        left = SCALE * MARGIN * (index + 1) + width * index
        canvas[top : top + height, left : left + width] = panel
        cv2.rectangle(canvas, (left, top), (left + width, top + height), MUTED, SCALE)
        x, y = left // SCALE, (top + height) // SCALE
        inside, lit = int(scene.inside.sum()), int((scene.lit & scene.inside).sum())
        _text(canvas, scene.title, (x, y + 28), INK, 0.6)
        if scene.cone_m is None:
            continue
        robots = "robot" if inside == 1 else "robots"
        text = f"{inside} {robots} in the cone, {lit} of them lit"
        _text(canvas, text, (x, y + 52), LIT, 0.52)
    if curve is not None:
        _chart(canvas, curve, chart_top)
    size = (canvas.shape[1] // SCALE, canvas.shape[0] // SCALE)
    return np.asarray(cv2.resize(canvas, size, interpolation=cv2.INTER_AREA), np.uint8)


def _text(canvas: Image, text: str, at: tuple[int, int], colour: Colour, size: float) -> None:
    """Writes text; `at` is the left end of its base line in px of the finished picture."""
    origin = (at[0] * SCALE, at[1] * SCALE)
    weight = SCALE if size >= 0.9 else 1
    cv2.putText(canvas, text, origin, FONT, size * SCALE, colour, weight, cv2.LINE_AA)


def _width(text: str, size: float) -> int:
    """Width of a text in px of the finished picture."""
    return int(cv2.getTextSize(text, FONT, size * SCALE, 1)[0][0] / SCALE)


def _panel(scene: Scene) -> Image:
    """The view in colour with the cone and the robots drawn in."""
    height, width = scene.view.shape
    large = cv2.resize(scene.view, (width * SCALE, height * SCALE), interpolation=cv2.INTER_CUBIC)
    image = cv2.cvtColor(large, cv2.COLOR_GRAY2BGR)
    # A lighter floor lets the overlay speak without hiding what the cameras saw.
    image = cv2.addWeighted(image, 0.72, np.full_like(image, 255), 0.28, 0)
    zoom = PANEL_PX_PER_M * SCALE
    centre = np.array([width, height]) * SCALE / 2

    def pixel(points_m: NDArray[np.float64]) -> NDArray[np.int32]:
        return np.asarray(np.rint(points_m * [zoom, -zoom] + centre), np.int32)

    if scene.cone_m is not None:
        image = _draw_cone(np.asarray(image, np.uint8), pixel(scene.cone_m), int(0.05 * zoom))
    radius = int(BODY_RADIUS_M * zoom)
    for pose, lit in zip(scene.poses, scene.lit):
        tip = pose[:2] + 2.1 * BODY_RADIUS_M * np.array([np.cos(pose[2]), np.sin(pose[2])])
        at, end = (tuple(map(int, p)) for p in pixel(np.array([pose[:2], tip])))
        if lit:
            glow = image.copy()
            cv2.circle(glow, at, int(1.9 * radius), LIT, -1, cv2.LINE_AA)
            image = cv2.addWeighted(glow, 0.30, image, 0.70, 0)
        colour = LIT if lit else DARK
        cv2.circle(image, at, radius, colour, 3 * SCALE, cv2.LINE_AA)
        cv2.line(image, at, end, colour, 2 * SCALE, cv2.LINE_AA)
    finished = np.asarray(image, np.uint8)
    _scale_bar(finished, zoom)
    return finished


def _draw_cone(image: Image, corners: NDArray[np.int32], radius: int) -> Image:
    """Tints the cone and rings its source."""
    tint = image.copy()
    cv2.fillConvexPoly(tint, corners, CONE, cv2.LINE_AA)
    mixed = np.asarray(cv2.addWeighted(tint, 0.30, image, 0.70, 0), np.uint8)
    cv2.polylines(mixed, [corners], True, CONE, 2 * SCALE, cv2.LINE_AA)
    cv2.circle(mixed, tuple(map(int, corners[0])), radius, CONE, 3 * SCALE, cv2.LINE_AA)
    return mixed


def _scale_bar(image: Image, zoom: int) -> None:
    """Half a metre, for the eye."""
    left, bottom = 16 * SCALE, image.shape[0] - 16 * SCALE
    right = left + zoom // 2
    cv2.line(image, (left, bottom), (right, bottom), INK, 2 * SCALE, cv2.LINE_AA)
    _text(image, "0.5 m", (left // SCALE, bottom // SCALE - 8), INK, 0.45)


def _chart(canvas: Image, curve: Curve, top: int) -> None:
    """Robots in the cone and lit over time, with the turn of the wind."""
    left, right = SCALE * (MARGIN + 40), canvas.shape[1] - SCALE * (MARGIN + 110)
    bottom = top + SCALE * CHART_HEIGHT
    end_s = float(curve.time_s[-1])

    def at(time_s: float, count: float) -> tuple[int, int]:
        x = left + (right - left) * time_s / end_s
        return round(x), round(bottom - (bottom - top) * count / max(curve.robots, 1))

    for count in _ticks(curve.robots, 5):
        y = at(0, count)[1]
        cv2.line(canvas, (left, y), (right, y), GRID, SCALE)
        label = f"{count:g}"
        where = (left // SCALE - 10 - _width(label, 0.45), y // SCALE + 5)
        _text(canvas, label, where, MUTED, 0.45)
    for time_s in _ticks(end_s, 8):
        x = at(time_s, 0)[0]
        cv2.line(canvas, (x, bottom), (x, bottom + 6 * SCALE), MUTED, SCALE)
        label = f"{time_s:g} s"
        where = (x // SCALE - _width(label, 0.45) // 2, bottom // SCALE + 24)
        _text(canvas, label, where, MUTED, 0.45)
    _text(canvas, "robots", (MARGIN, top // SCALE - 14), MUTED, 0.45)
    if curve.turn_s is not None and curve.turn_s < end_s:
        x = at(curve.turn_s, 0)[0]
        cv2.line(canvas, (x, top - 8 * SCALE), (x, bottom), MUTED, SCALE, cv2.LINE_AA)
        _text(canvas, "the wind turns", (x // SCALE + 8, top // SCALE - 2), MUTED, 0.45)
    ends = []
    for counts, colour, name in ((curve.inside, CONE, "in the cone"), (curve.lit, LIT, "lit")):
        stairs = zip(np.repeat(curve.time_s, 2)[1:-1], np.repeat(counts, 2))
        points = [at(float(time_s), float(count)) for time_s, count in stairs]
        cv2.polylines(canvas, [np.array(points, np.int32)], False, colour, 2 * SCALE, cv2.LINE_AA)
        ends.append((points[-1][1] // SCALE, name, colour))
    _line_names(canvas, ends, right // SCALE + 12)
    cv2.line(canvas, (left, bottom), (right, bottom), MUTED, SCALE)


def _line_names(canvas: Image, ends: list[tuple[int, str, Colour]], x: int) -> None:
    """Names each line at its end, pushing the second name away where the two would touch."""
    ends = sorted(ends, key=lambda end: end[0])
    lowest = -100
    for y, name, colour in ends:
        y = max(y, lowest + 20)
        _text(canvas, name, (x, y + 5), colour, 0.5)
        lowest = y


def _ticks(end: float, most: int) -> NDArray[np.float64]:
    """Round values from 0 to `end`, at most `most` steps of 1, 2 or 5 times a power of ten."""
    raw = end / most
    power = 10.0 ** np.floor(np.log10(raw))
    step = next(s * power for s in (1, 2, 5, 10) if s * power >= raw - 1e-9)
    return np.asarray(np.arange(0, end + 1e-9, max(step, 1.0)))
