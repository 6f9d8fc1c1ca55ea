"""The arena from above as a recording knows it, and the axes around it."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.pictures import arena_view
from vsense.pictures.arena_view import CONE, ArenaMoment
from vsense.pictures.canvas import INK, MUTED, SCALE, Canvas, Colour, Floats, Image, width_of
from vsense.pictures.painting import FLOOR_PX_PER_M, Lamp, WorldSnapshot
from vsense.report.facts import MOST_ASPECT, entities, number, numbers
from vsense.report.gather import ODD, Gatherer
from vsense.report.plot import TEXT, ticks
from vsense.world.entities import Arena

MOST_CELLS = 1_800
"""A floor is drawn with at most so many cells along a side."""
FLOOR_SHARE = 0.5
"""How much of the floor's colour is left."""
NEAR_SIZES = 20.0
"""What is further away than so many sizes of the arena is not drawn."""
_FAR_PX = 20_000
_LEFT, _TOP, _BOTTOM, _RIGHT = 50, 30, 46, 18
_CORNERS = 0.5 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
_ROUND = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)


@dataclass(frozen=True, slots=True)
class Map:
    """A piece of a picture that shows the arena.

    Attributes:
        canvas: the arena alone; its (0, 0) is the arena's upper left corner.
        place: px of (n, 2) points in the arena frame.
        zoom: px per m.
    """

    canvas: Canvas
    place: Callable[[Floats], Floats]
    zoom: float


def arena_of(found: Gatherer) -> Arena:
    """The recorded arena; where it is unknown, the room that the robots needed."""
    if found.facts.arena is not None:
        return found.facts.arena
    ways = [track.points_m for track in found.tracks.of.values()]
    points = np.concatenate([*ways, np.zeros((0, 2))])
    points = points[(np.abs(points) < 1e4).all(axis=1)]
    if not len(points):
        return Arena((1.0, 1.0, 0.0), (0.0, 0.0, 0.0))
    low, high = points.min(axis=0), points.max(axis=0)
    size = np.maximum(high - low + 0.2, 0.2)
    size = np.maximum(size, size.max() / MOST_ASPECT)
    middle = (low + high) / 2.0
    return Arena((float(size[0]), float(size[1]), 0.0), (float(middle[0]), float(middle[1]), 0.0))


def draw_map(found: Gatherer, width: int, solid: bool = True) -> Map:
    """Draws the arena with what stands and lies in it at the end.

    Args:
        found: what the recording says.
        width: of the map [px].
        solid: with floor, zones and lights; else the outlines of what is in the way only.
    """
    arena = arena_of(found)
    zoom = width / arena.size_m[0]
    canvas = Canvas(width, max(round(arena.size_m[1] * zoom), 1))
    centre, half = np.array(arena.centre_m[:2]), np.array(arena.size_m[:2]) / 2.0

    def place(points_m: Floats) -> Floats:
        places = (points_m - centre) * [zoom, -zoom] + half * zoom
        return np.asarray(np.clip(places, -_FAR_PX, _FAR_PX))

    picture = arena_view.draw(_scene(found, arena)) if solid else None
    if picture is not None:
        size = (canvas.image.shape[1], canvas.image.shape[0])
        canvas.image[:] = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    for first, last in found.cones.values() if solid else ():
        if np.abs(np.array(first) - np.array(last)).max() > 0.1:
            dashed(canvas, place(np.array(first)), CONE)
    if not solid:
        painting = _painting(found, arena)
        for outline in (*painting.virtual, *painting.physical):
            canvas.lines(place(outline + centre), MUTED, 1.0, closed=True)
    return Map(canvas, place, zoom)


def dashed(canvas: Canvas, corners: Floats, colour: Colour) -> None:
    """Draws a closed shape with broken lines, (n, 2) px."""
    for begin, end in zip(corners, np.roll(corners, -1, axis=0)):
        count = max(int(np.linalg.norm(end - begin) / 5.0), 1)
        stops = np.linspace(begin, end, 2 * (count // 2) + 2)
        for dash in stops.reshape(-1, 2, 2):
            canvas.lines(dash, colour, 1.5)


def framed(map_: Map, arena: Arena, extra: int = 0) -> Canvas:
    """Puts a map into a picture with axes in m; `extra` px stay free at the right."""
    height, width = (round(side / SCALE) for side in map_.canvas.image.shape[:2])
    whole = Canvas(_LEFT + width + _RIGHT + extra, _TOP + height + _BOTTOM)
    whole.place(map_.canvas.image, _LEFT, _TOP)
    low = np.array(arena.centre_m[:2]) - np.array(arena.size_m[:2]) / 2.0
    high = low + np.array(arena.size_m[:2])
    for value in ticks(low[0], high[0], 6):
        x = _LEFT + float(map_.place(np.array([[value, low[1]]]))[0, 0])
        whole.lines(np.array([[x, _TOP + height], [x, _TOP + height + 5]]), MUTED)
        label = f"{value:g}"
        whole.text(label, x - width_of(label, TEXT) / 2, _TOP + height + 20, INK, TEXT)
    for value in ticks(low[1], high[1], 6):
        y = _TOP + float(map_.place(np.array([[low[0], value]]))[0, 1])
        whole.lines(np.array([[_LEFT - 5, y], [_LEFT, y]]), MUTED)
        label = f"{value:g}"
        whole.text(label, _LEFT - 9 - width_of(label, TEXT), y + 5, INK, TEXT)
    whole.text("y [m]", 4, _TOP - 12, INK, TEXT)
    whole.text(
        "x [m]", _LEFT + (width - width_of("x [m]", TEXT)) / 2, _TOP + height + 38, INK, TEXT
    )
    return whole


def map_width(arena: Arena, whole: int, extra: int = 0) -> int:
    """The width of a map, so that its picture is `whole` px wide, and no tower."""
    width = whole - _LEFT - _RIGHT - extra
    return min(width, max(round(1.6 * width * arena.size_m[0] / arena.size_m[1]), 60))


def map_origin() -> tuple[int, int]:
    """Where a framed map's upper left corner is [px]."""
    return _LEFT, _TOP


def _scene(found: Gatherer, arena: Arena) -> ArenaMoment:
    nobody = np.zeros((0, 3))
    painting = _painting(found, arena)
    return ArenaMoment("", "", None, painting, nobody, np.zeros(0, np.bool_), np.zeros((0, 0, 2)))


def _painting(found: Gatherer, arena: Arena) -> WorldSnapshot:
    """The recorded world as pictures know it; what is damaged in it is left out."""
    centre = np.array(arena.centre_m[:2])
    things = entities(found.world)
    near_m = NEAR_SIZES * max(arena.size_m)
    outlines = ((bool(e.get("physical")), o - centre) for e in things for o in _outlines(e))
    solids = [(physical, o) for physical, o in outlines if np.abs(o).max() < near_m]
    cones = (np.array(last) - centre for _, last in found.cones.values())
    return WorldSnapshot(
        arena=arena,
        floor=_floor(found.world, arena),
        fields=(),
        virtual=tuple(outline for physical, outline in solids if not physical),
        physical=tuple(outline for physical, outline in solids if physical),
        lamps=tuple(lamp for e in things for lamp in _lamps(e, centre)),
        cones=tuple(cone for cone in cones if np.abs(cone).max() < near_m),
        strangers=np.array(list(_strangers(things, centre, near_m))).reshape(-1, 3),
        leds=np.zeros((0, 3), np.uint8),
    )


def _outlines(entity: Mapping[str, Any]) -> Iterator[Floats]:
    """The outline of a box or a cylinder, (k, 2) arena frame."""
    at, kind = numbers(entity.get("position_m"), 2), entity.get("kind")
    radius, size = number(entity.get("radius_m")), numbers(entity.get("size_m"), 2)
    if at is not None and kind == "cylinder" and radius is not None:
        yield radius * np.stack([np.cos(_ROUND), np.sin(_ROUND)], axis=-1) + at
    if at is not None and kind == "box" and size is not None:
        yield _turned(_CORNERS * size, number(entity.get("yaw_rad")) or 0.0) + at


def _turned(points: Floats, yaw_rad: float) -> Floats:
    cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.asarray(points @ np.array([[cosine, sine], [-sine, cosine]]))


def _lamps(entity: Mapping[str, Any], centre: Floats) -> Iterator[Lamp]:
    at, colour = numbers(entity.get("position_m"), 2), _colour(entity.get("color"))
    if entity.get("kind") == "light" and at is not None:
        yield Lamp(np.array(at) - centre, colour or (255, 255, 255))


def _strangers(
    things: list[Mapping[str, Any]], centre: Floats, near_m: float
) -> Iterator[tuple[float, ...]]:
    for entity in things:
        pose = numbers([entity.get(name) for name in ("x_m", "y_m", "yaw_rad")], 3)
        if entity.get("kind") == "robot" and pose is not None:
            x_m, y_m = pose[0] - float(centre[0]), pose[1] - float(centre[1])
            if max(abs(x_m), abs(y_m)) < near_m:
                yield x_m, y_m, pose[2]


def _colour(value: Any) -> tuple[int, int, int] | None:
    found = numbers(value, 3)
    if found is None:
        return None
    red, green, blue = (int(min(max(part, 0.0), 255.0)) for part in found)
    return red, green, blue


def _floor(world: Mapping[str, Any], arena: Arena) -> Image | None:
    """The floor with its zones, (h, w, 4) red, green, blue, alpha; None: it is white."""
    size = np.array(arena.size_m[:2])
    per_m = min(6 * FLOOR_PX_PER_M, MOST_CELLS / size.max())
    columns, rows = (max(round(side * per_m), 1) for side in size)
    x = ((np.arange(columns) + 0.5) / columns - 0.5) * size[0] + arena.centre_m[0]
    y = (0.5 - (np.arange(rows) + 0.5) / rows) * size[1] + arena.centre_m[1]
    across, up = np.meshgrid(x, y)
    colours = np.full((rows, columns, 4), 255, np.uint8)
    data = world.get("floor")
    data = data if isinstance(data, dict) else {}
    colours[..., :3] = _colour(data.get("color")) or (255, 255, 255)
    try:
        _lay_picture(colours, data, across, up)
    except (*ODD, binascii.Error, cv2.error):
        pass
    for entity in entities(world):
        colour = _colour(entity.get("color"))
        if colour is not None and entity.get("kind") == "zone":
            colours[_inside(entity, across, up)] = (*colour, 255)
    # Paler than it is, so that ways upon it can be seen.
    colours[..., :3] = 255 - (FLOOR_SHARE * (255.0 - colours[..., :3])).astype(np.uint8)
    return None if (colours[..., :3] == 255).all() else colours


def _lay_picture(colours: Image, data: Mapping[str, Any], across: Floats, up: Floats) -> None:
    """Lays the floor's picture over its colour.

    Raises:
        one of ODD, binascii.Error, cv2.error: it is damaged.
    """
    png, size, centre = data.get("png"), numbers(data.get("size_m"), 2), data.get("centre_m")
    middle = numbers(centre, 2) or (0.0, 0.0)
    if not isinstance(png, str) or size is None or min(size) <= 0.0:
        return
    raw = np.frombuffer(base64.b64decode(png), np.uint8)
    image = cv2.imdecode(raw, cv2.IMREAD_COLOR)
    if image is None:
        return
    height, width = image.shape[:2]
    column = np.clip((across - middle[0]) / size[0] + 0.5, 0, 1) * (width - 1)
    row = np.clip(0.5 - (up - middle[1]) / size[1], 0, 1) * (height - 1)
    colours[..., :3] = image[row.round().astype(int), column.round().astype(int), ::-1]


def _inside(zone: Mapping[str, Any], across: Floats, up: Floats) -> NDArray[np.bool_]:
    """Which of the points lie in a zone."""
    at = numbers([zone.get("x_m"), zone.get("y_m")], 2)
    radius, size = number(zone.get("radius_m")), numbers(zone.get("size_m"), 2)
    if at is None:
        return np.zeros(across.shape, np.bool_)
    dx, dy = across - at[0], up - at[1]
    if zone.get("shape") == "circle":
        return np.asarray(np.hypot(dx, dy) <= (radius or 0.0))
    if size is None:
        return np.zeros(across.shape, np.bool_)
    yaw = number(zone.get("yaw_rad")) or 0.0
    along = dx * np.cos(yaw) + dy * np.sin(yaw)
    beside = dy * np.cos(yaw) - dx * np.sin(yaw)
    return np.asarray((np.abs(along) <= size[0] / 2) & (np.abs(beside) <= size[1] / 2))
