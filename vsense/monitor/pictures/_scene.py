"""The virtual world and the robots, drawn over whatever lies beneath.

One drawing for all pictures: of the arena from above, and of cameras through their lenses. Where
things are is the view's matter (`_projections.py`). Colours are those of the page's light theme.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats, Image
from vsense.base.canvas import INK, MUTED, Canvas, Colour, width_of
from vsense.monitor.pictures._projections import Projection, upright
from vsense.monitor.pictures.run_samples import Lamp, Patch, Solid, WorldSnapshot
from vsense.world.robot_models import EPUCK

CONE: Colour = (60, 140, 245)
LIT: Colour = (48, 48, 226)
DARK: Colour = (160, 96, 40)
TRAIL: Colour = (190, 140, 90)
VIRTUAL: Colour = (170, 60, 130)
VIRTUAL_ROBOT: Colour = (130, 150, 20)
SEEN: Colour = (255, 208, 55)
"""A robot's colour over a camera's picture, as on the page."""
RAYS: tuple[Colour, ...] = ((140, 125, 11), (140, 55, 160), (0, 106, 138))
_LIGHT_RAYS: tuple[Colour, ...] = ((224, 208, 79), (210, 138, 228), (74, 194, 224))
_FIELDS: tuple[Colour, ...] = ((60, 160, 60), (190, 60, 170), (200, 150, 0))
_LAMP: Colour = (40, 200, 250)
_WHITE: Colour = (255, 255, 255)
_RAY_M = 0.3
_BAND_PX = 32
_NAME = 0.40
_NAMED_PX = 6.0
"""Radius of a robot from which on its name is written."""
_CORNERS = (
    ((1.25, -0.95), (0.0, 1.0)), ((-1.25, -0.95), (1.0, 1.0)),
    ((1.25, 0.95), (0.0, 0.0)), ((-1.25, 0.95), (1.0, 0.0)),
)  # fmt: skip
"""Where names go: a corner around the robot, and which share of the name's size lies before it."""
_AROUND = tuple((x, y) for x in (-1.0, 0.0, 1.0) for y in (-1.0, 0.0, 1.0) if x or y)
_ROUND = np.linspace(0.0, 2.0 * np.pi, 49)[:-1]
_RIM = np.stack((np.cos(_ROUND), np.sin(_ROUND)), axis=-1)


@dataclass(frozen=True, slots=True)
class Senses:
    """What one robot senses.

    Attributes:
        robot: its row among the robots.
        rays: for each sensor that looks somewhere, angles [rad] from the heading and shares (k,) of
            its greatest reading.
        words: its other readings.
    """

    robot: int
    rays: tuple[tuple[Floats, Floats], ...]
    words: tuple[str, ...]


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
        heights_m: (n,) of the robots' tops, which cameras see; None: as e-pucks are high.
        radii_m: (n,) of the robots; None: e-pucks.
        names: of the robots, to be written beside them; none or all.
        objects: (k, 2) places of the tagged objects that are no robots.
        senses: what one of the robots senses, or None.
    """

    title: str
    note: str
    view: Image | None
    snapshot: WorldSnapshot
    poses: Floats
    lit: NDArray[np.bool_]
    trails: Floats
    heights_m: Floats | None = None
    radii_m: Floats | None = None
    names: Sequence[str] = ()
    objects: Floats | None = None
    senses: Senses | None = None

    @property
    def tops_m(self) -> Floats:
        """(n,) heights of the robots' tops."""
        usual = np.full(len(self.poses), EPUCK.height_m)
        return usual if self.heights_m is None else self.heights_m

    @property
    def rims_m(self) -> Floats:
        """(n,) radii of the robots."""
        usual = np.full(len(self.poses), EPUCK.radius_m)
        return usual if self.radii_m is None else self.radii_m


def draw_ground(canvas: Canvas, snapshot: WorldSnapshot, view: Projection) -> None:
    """Draws the painted floor and the fields over a canvas of the view."""
    size_m = np.array(snapshot.arena.size_m[:2])
    if snapshot.floor is not None:
        # White is an unpainted floor, which does not hide what the cameras see.
        painted = (snapshot.floor[..., :3] != 255).any(axis=-1)
        layer = snapshot.floor[..., [2, 1, 0, 3]].copy()
        layer[..., 3] = layer[..., 3] * (0.55 * painted)
        _lay(canvas, view.spread(layer, size_m, False, canvas.scale))
    for number, shares in enumerate(snapshot.fields):
        if not shares.any():
            continue
        tint = np.empty((*shares.shape, 4), np.uint8)
        tint[..., :3] = _FIELDS[number % len(_FIELDS)]
        tint[..., 3] = np.rint(255.0 * 0.75 * np.sqrt(shares))
        _lay(canvas, view.spread(tint, size_m, True, canvas.scale))


def _lay(canvas: Canvas, layer: Image) -> None:
    """Lays (h, w, 4) BGR and alpha over the canvas, in bands that a processor's cache holds."""
    for first in range(0, len(layer), _BAND_PX):
        band, under = (image[first : first + _BAND_PX] for image in (layer, canvas.image))
        alpha = band[..., 3]
        if alpha.any():
            share = alpha.astype(np.float32) / np.float32(255.0)
            colours = cv2.cvtColor(band, cv2.COLOR_BGRA2BGR)
            under[:] = cv2.blendLinear(colours, under, share, 1.0 - share)


def draw_scene(canvas: Canvas, moment: ArenaMoment, view: Projection) -> None:
    """Draws the virtual things, and upon them the robots."""
    snapshot = moment.snapshot
    for zone in snapshot.zones:
        _zone(canvas, zone, view)
    for cone in snapshot.cones:
        canvas.fill(view.area(upright(cone, 0.0)), CONE, 0.30)
        _outline(canvas, view, upright(cone, 0.0), CONE, 2.0)
        _marked(canvas, view, cone[0] + 0.05 * _RIM, 0.0, 0.05)
    for solid in snapshot.virtual:
        _solid(canvas, solid, view)
    if not view.flat:
        # A wall that is not where the picture has it was described or measured wrongly.
        for solid in snapshot.physical:
            _edges(canvas, solid, view, (230, 226, 222), 1.0)
    for lamp in snapshot.lamps:
        _lamp(canvas, lamp, snapshot, view)
    _robots(canvas, moment, view)
    for robot in snapshot.virtual_robots:
        _virtual_robot(canvas, robot, view)
    if moment.senses is not None:
        _senses(canvas, moment, moment.senses, view)
    _names(canvas, moment, view)


def _outline(
    canvas: Canvas, view: Projection, points: Floats, colour: Colour, width: float
) -> None:
    for piece in view.line(points, closed=True):
        canvas.lines(piece, colour, width)


def _marked(
    canvas: Canvas, view: Projection, outline_m: Floats, height_m: float, radius_m: float
) -> None:
    """Draws the outline of a source, as thick as its size allows."""
    spot = view.spot(np.array([*outline_m.mean(axis=0), height_m]))
    if spot is not None:
        width = float(np.clip(0.25 * radius_m * spot[1], 1.2, 3.0))
        _outline(canvas, view, upright(outline_m, height_m), CONE, width)


def _zone(canvas: Canvas, zone: Patch, view: Projection) -> None:
    """Draws a dashed outline and the name; its colour is in the floor."""
    colour = MUTED if zone.colour is None else zone.colour[::-1]
    corners = np.vstack((zone.outline_m, zone.outline_m[:1]))
    length_m = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    along = np.concatenate(([0.0], np.cumsum(length_m)))
    stops = np.linspace(0.0, along[-1], 2 * max(round(along[-1] / 0.04), 4) + 1)
    x, y = (np.interp(stops, along, corners[:, k]) for k in (0, 1))
    dashes = upright(np.stack((x, y), axis=-1), 0.0)
    for first in range(0, len(dashes) - 1, 2):
        for piece in view.line(dashes[first : first + 2]):
            canvas.lines(piece, colour, 1.3)
    spot = view.spot(np.array([*zone.outline_m.mean(axis=0), 0.0]))
    if spot is not None:
        colour = INK if view.flat else _WHITE
        _in_the_middle(canvas, zone.name, spot[0], colour, _NAME, view)


def _solid(canvas: Canvas, solid: Solid, view: Projection) -> None:
    """Draws what is only sensed: its area, and where heights count its edges."""
    canvas.fill(view.area(upright(solid.outline_m, solid.base_m)), VIRTUAL, 0.35)
    if view.flat:
        _outline(canvas, view, upright(solid.outline_m, solid.base_m), VIRTUAL, 1.5)
        return
    canvas.fill(view.area(upright(solid.outline_m, solid.top_m)), VIRTUAL, 0.30)
    _edges(canvas, solid, view, VIRTUAL, 1.5)


def _edges(canvas: Canvas, solid: Solid, view: Projection, colour: Colour, width: float) -> None:
    base, top = (upright(solid.outline_m, height) for height in (solid.base_m, solid.top_m))
    _outline(canvas, view, base, colour, width)
    _outline(canvas, view, top, colour, width)
    posts = range(len(base)) if len(base) <= 8 else range(0, len(base), len(base) // 6)
    for corner in posts:
        for piece in view.line(np.stack((base[corner], top[corner]))):
            canvas.lines(piece, colour, width)


def _lamp(canvas: Canvas, lamp: Lamp, snapshot: WorldSnapshot, view: Projection) -> None:
    """Draws a light with its glow; from above one outside of the arena at its edge."""
    place, height_m = lamp.place_m, lamp.height_m
    if view.flat:
        half = np.array(snapshot.arena.size_m[:2]) / 2.0
        place = np.clip(place, -half, half)
    else:
        for piece in view.line(np.array([[*place, 0.0], [*place, height_m]])):
            canvas.lines(piece, _LAMP, 1.0)
    spot = view.spot(np.array([*place, height_m]))
    if spot is None:
        return
    at, zoom = spot
    colour = _LAMP if lamp.colour == (255, 255, 255) else lamp.colour[::-1]
    for radius_m, share in ((0.30, 0.12), (0.18, 0.16), (0.09, 0.30)):
        canvas.glow(at, radius_m * zoom, colour, share)
    canvas.dot(at, 0.035 * zoom, colour)
    canvas.ring(at, 0.035 * zoom, INK, 1.0)


def _robots(canvas: Canvas, moment: ArenaMoment, view: Projection) -> None:
    """Draws rings with a line along the heading, red where the LEDs are on."""
    poses, tops = moment.poses, moment.tops_m
    for robot in range(moment.trails.shape[1] if len(moment.trails) > 1 else 0):
        for piece in view.line(upright(moment.trails[:, robot], 0.0)):
            canvas.lines(piece, TRAIL, 1.0)
    for place in () if moment.objects is None else moment.objects:
        square = place + 0.5 * EPUCK.radius_m * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        _marked(canvas, view, square, 0.0 if view.flat else EPUCK.height_m, EPUCK.radius_m)
    rows = zip(poses, tops, moment.rims_m, moment.lit, moment.snapshot.leds)
    for pose, top_m, body_m, lit, virtual in rows:
        spot = view.spot(np.array([*pose[:2], top_m]))
        if spot is None:
            continue
        at, radius = spot[0], body_m * spot[1]
        if lit:
            canvas.glow(at, 1.9 * radius, LIT, 0.30)
        if virtual.any():
            red, green, blue = (int(value) for value in virtual)
            canvas.glow(at, 1.5 * radius, (blue, green, red), 0.6)
        usual = DARK if view.flat else SEEN
        _robot(canvas, pose, (top_m, body_m), view, LIT if lit else usual, radius)


def _robot(
    canvas: Canvas,
    pose: Floats,
    body: tuple[float, float],
    view: Projection,
    colour: Colour,
    radius: float,
) -> None:
    """Draws a ring and a heading; `body`: its top and radius [m]; `radius` [px] says how thick."""
    top_m, body_m = body
    tip = pose[:2] + 2.1 * body_m * np.array([np.cos(pose[2]), np.sin(pose[2])])
    rim = pose[:2] + body_m * _RIM
    _outline(canvas, view, upright(rim, top_m), colour, float(np.clip(0.22 * radius, 1.2, 3.0)))
    for piece in view.line(upright(np.array([pose[:2], tip]), top_m)):
        canvas.lines(piece, colour, float(np.clip(0.18 * radius, 1.2, 2.0)))


def _virtual_robot(canvas: Canvas, robot: Floats, view: Projection) -> None:
    """Draws a body that nobody sees: where it stands, and its top."""
    pose, radius_m, height_m = robot[:3], float(robot[3]), float(robot[4])
    rim = pose[:2] + radius_m * _RIM
    top_m = 0.0 if view.flat else height_m
    canvas.fill(view.area(upright(rim, 0.0)), VIRTUAL_ROBOT, 0.35)
    if not view.flat:
        canvas.fill(view.area(upright(rim, top_m)), VIRTUAL_ROBOT, 0.35)
        _edges(canvas, Solid(rim, 0.0, top_m), view, VIRTUAL_ROBOT, 1.0)
    spot = view.spot(np.array([*pose[:2], top_m]))
    if spot is not None:
        _robot(canvas, pose, (top_m, radius_m), view, VIRTUAL_ROBOT, radius_m * spot[1])


def _senses(canvas: Canvas, moment: ArenaMoment, senses: Senses, view: Projection) -> None:
    """Draws what a robot senses: rays from its rim, and words below it."""
    pose, top_m = moment.poses[senses.robot], moment.tops_m[senses.robot]
    body_m = moment.rims_m[senses.robot]
    colours = RAYS if view.flat else _LIGHT_RAYS
    for number, (angles, shares) in enumerate(senses.rays):
        # Several sensors that look the same way stand side by side.
        turns = pose[2] + angles + 0.05 * number
        ways = np.stack((np.cos(turns), np.sin(turns)), axis=-1)
        reach = body_m + (_RAY_M - body_m) * np.clip(shares, 0.0, 1.0)
        for way, far in zip(ways, reach):
            ends = pose[:2] + np.outer((body_m, far), way)
            for piece in view.line(upright(ends, top_m)):
                canvas.lines(piece, colours[number % len(colours)], 2.5)
    _outline(
        canvas, view, upright(pose[:2] + 2.6 * body_m * _RIM, top_m),
        INK if view.flat else _WHITE, 1.5,
    )  # fmt: skip
    spot = view.spot(np.array([*pose[:2], top_m]))
    if spot is not None:
        at = spot[0] + (0.0, 2.6 * body_m * spot[1] + 14.0)
        for line, word in enumerate(senses.words):
            below = at + np.array([0.0, 16.0 * line])
            _in_the_middle(canvas, word, below, INK if view.flat else _WHITE, 0.45, view)


def _names(canvas: Canvas, moment: ArenaMoment, view: Projection) -> None:
    """Writes names beside the robots, each where it covers no other name, if possible."""
    taken: list[tuple[Floats, Floats]] = []
    colour = INK if view.flat else _WHITE
    rows = zip(moment.poses, moment.tops_m, moment.rims_m, moment.names)
    for pose, top_m, body_m, name in rows:
        spot = view.spot(np.array([*pose[:2], top_m]))
        radius = 0.0 if spot is None else body_m * spot[1]
        if spot is None or radius < _NAMED_PX:
            continue
        size = np.array([width_of(name, _NAME, canvas.scale), 11.0])
        places = [spot[0] + np.array(corner) * radius - size * back for corner, back in _CORNERS]
        room = np.array(view.size_px) - size
        inside = [p for p in places if p.min() >= 0.0 and bool((p <= room).all())] or places
        place = next((p for p in inside if not _covers(p, size, taken)), inside[0])
        taken.append((place, size))
        _label(canvas, name, place + np.array([0.0, 11.0]), colour, _NAME, view)


def _covers(place: Floats, size: Floats, taken: Sequence[tuple[Floats, Floats]]) -> bool:
    return any(bool(np.all((place < p + s) & (p < place + size))) for p, s in taken)


def _label(
    canvas: Canvas, text: str, at: Floats, colour: Colour, size: float, view: Projection
) -> None:
    """Writes a line with a rim that sets it off from what lies beneath; `at` is its left end."""
    rim = (247, 247, 247) if view.flat else (24, 20, 16)
    for across, down in _AROUND:
        canvas.text(text, float(at[0]) + across, float(at[1]) + down, rim, size)
    canvas.text(text, float(at[0]), float(at[1]), colour, size)


def _in_the_middle(
    canvas: Canvas, text: str, at: Floats, colour: Colour, size: float, view: Projection
) -> None:
    width = width_of(text, size, canvas.scale)
    _label(canvas, text, at - (width / 2.0, 0.0), colour, size, view)
