"""The arena from above with the virtual world and the robots drawn in.

The cameras' view lies beneath; without cameras it is plain paper with the real walls.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.pictures.canvas import INK, MUTED, SCALE, Canvas, Colour, Floats, Image
from vsense.pictures.run_samples import WorldSnapshot
from vsense.world.entities import BODY_RADIUS_M

WIDTH_PX = 900
"""Width of a view; its height follows from the arena."""

CONE: Colour = (60, 140, 245)
LIT: Colour = (48, 48, 226)
DARK: Colour = (160, 96, 40)
TRAIL: Colour = (190, 140, 90)
VIRTUAL: Colour = (170, 60, 130)
VIRTUAL_ROBOT: Colour = (130, 150, 20)
_PAPER = 247
_SOLID: Colour = (190, 184, 180)
_FIELDS: tuple[Colour, ...] = ((60, 160, 60), (190, 60, 170), (200, 150, 0))
_LAMP: Colour = (40, 200, 250)

Place = Callable[[Floats], Floats]


@dataclass(frozen=True, slots=True)
class ArenaMoment:
    """One moment of the arena; places are relative to the arena's middle.

    Attributes:
        title: The moment in words.
        note: A remark about it, or "".
        view: (h, w) grey top view of the floor by the cameras, +y up; None: no cameras.
        poses: (n, 3) x, y in m and yaw in rad of the robots.
        lit: (n,) whether each robot's red LEDs are on.
        trails: (t, n, 2) earlier places of the robots, the oldest first; may be empty.
    """

    title: str
    note: str
    view: Image | None
    snapshot: WorldSnapshot
    poses: Floats
    lit: NDArray[np.bool_]
    trails: Floats


def draw(scene: ArenaMoment) -> Image:
    """Draws a moment, (h, w, 3) BGR, `SCALE` times as large as it will be shown."""
    snapshot = scene.snapshot
    width_m, height_m = snapshot.arena.size_m[:2]
    zoom = WIDTH_PX / width_m
    canvas = Canvas(WIDTH_PX, round(height_m * zoom))
    middle = np.array([width_m, height_m]) * zoom / 2.0

    def place(points_m: Floats) -> Floats:
        return np.asarray(points_m * [zoom, -zoom] + middle)

    _ground(canvas, scene)
    for outline in snapshot.physical if scene.view is None else ():
        canvas.fill(place(outline), _SOLID)
        canvas.lines(place(outline), MUTED, 1.0, closed=True)
    for cone in snapshot.cones:
        canvas.fill(place(cone), CONE, 0.30)
        canvas.lines(place(cone), CONE, 2.0, closed=True)
        canvas.ring(place(cone[0]), 0.05 * zoom, CONE, 3.0)
    for outline in snapshot.virtual:
        canvas.fill(place(outline), VIRTUAL, 0.35)
        canvas.lines(place(outline), VIRTUAL, 1.5, closed=True)
    _lamps(canvas, snapshot, place, zoom)
    _robots(canvas, scene, place, zoom)
    _scale_bar(canvas, zoom)
    return canvas.image


def _ground(canvas: Canvas, scene: ArenaMoment) -> None:
    """Draws the cameras' view, or paper; upon it the virtual floor and the fields."""
    height, width = canvas.image.shape[:2]
    size = (width, height)
    if scene.view is None:
        canvas.image[:] = _PAPER
    else:
        large = cv2.resize(scene.view, size, interpolation=cv2.INTER_CUBIC)
        grey = cv2.cvtColor(large, cv2.COLOR_GRAY2BGR)
        # A lighter floor makes the drawing clear and keeps the cameras' view visible.
        canvas.image[:] = cv2.addWeighted(grey, 0.72, np.full_like(grey, 255), 0.28, 0)
    floor = scene.snapshot.floor
    if floor is not None:
        large = cv2.resize(floor, size, interpolation=cv2.INTER_NEAREST)
        # White is an unpainted floor, which does not hide the cameras' view.
        painted = (large[..., :3] != 255).any(axis=-1) * (large[..., 3] / 255.0)
        _blend(canvas, large[..., 2::-1], painted * 0.55)
    for number, shares in enumerate(scene.snapshot.fields):
        large = cv2.resize(shares, size, interpolation=cv2.INTER_LINEAR)
        _blend(canvas, np.array(_FIELDS[number % len(_FIELDS)]), 0.75 * np.sqrt(large))


def _blend(canvas: Canvas, colour: NDArray[np.generic], share: Floats) -> None:
    """Mixes in a colour, (3,) or (h, w, 3), with the (h, w) share of each pixel."""
    weight = share[..., None]
    mixed = canvas.image * (1.0 - weight) + np.asarray(colour, np.float64) * weight
    canvas.image[:] = np.rint(mixed).astype(np.uint8)


def _lamps(canvas: Canvas, snapshot: WorldSnapshot, place: Place, zoom: float) -> None:
    """Draws the lights; one outside of the arena at its edge."""
    half = np.array(snapshot.arena.size_m[:2]) / 2.0
    for lamp in snapshot.lamps:
        at = place(np.clip(lamp.place_m, -half, half))
        colour = _LAMP if lamp.colour == (255, 255, 255) else lamp.colour[::-1]
        for radius_m, share in ((0.30, 0.12), (0.18, 0.16), (0.09, 0.30)):
            canvas.glow(at, radius_m * zoom, colour, share)
        canvas.dot(at, 0.035 * zoom, colour)
        canvas.ring(at, 0.035 * zoom, INK, 1.0)


def _robots(canvas: Canvas, scene: ArenaMoment, place: Place, zoom: float) -> None:
    """Draws rings with a line along the heading, red where the LEDs are on."""
    radius = BODY_RADIUS_M * zoom
    for robot in range(scene.trails.shape[1] if len(scene.trails) > 1 else 0):
        canvas.lines(place(scene.trails[:, robot]), TRAIL, 1.0)
    snapshot = scene.snapshot
    for pose, lit, virtual in zip(scene.poses, scene.lit, snapshot.leds):
        at = place(pose[:2])
        if lit:
            canvas.glow(at, 1.9 * radius, LIT, 0.30)
        if virtual.any():
            red, green, blue = (int(value) for value in virtual)
            canvas.glow(at, 1.5 * radius, (blue, green, red), 0.6)
        _robot(canvas, pose, place, radius, LIT if lit else DARK)
    for pose in snapshot.virtual_robots:
        canvas.glow(place(pose[:2]), radius, VIRTUAL_ROBOT, 0.35)
        _robot(canvas, pose, place, radius, VIRTUAL_ROBOT)


def _robot(canvas: Canvas, pose: Floats, place: Place, radius: float, colour: Colour) -> None:
    tip = pose[:2] + 2.1 * BODY_RADIUS_M * np.array([np.cos(pose[2]), np.sin(pose[2])])
    canvas.ring(place(pose[:2]), radius, colour, 3.0)
    canvas.lines(place(np.array([pose[:2], tip])), colour, 2.0)


def _scale_bar(canvas: Canvas, zoom: float) -> None:
    bottom = canvas.image.shape[0] / SCALE - 16.0
    canvas.lines(np.array([[16.0, bottom], [16.0 + zoom / 2.0, bottom]]), INK, 2.0)
    canvas.text("0.5 m", 16.0, bottom - 8.0, INK, 0.45)
