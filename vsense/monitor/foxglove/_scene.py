"""What stands in the arena as Foxglove's scenes: world, robots, LEDs, cones, fields, floor.

Data as in `vsense/monitor/ui/MESSAGES.md`. Fields that a recording lacks or that are damaged make
KeyError, TypeError, ValueError or IndexError; the caller leaves that message out.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import cv2
import numpy as np

from vsense.config.arena import floor_picture
from vsense.monitor.foxglove import _shapes
from vsense.monitor.foxglove._shapes import ARENA_FRAME, Json, Rgba
from vsense.world.robot_models import EPUCK

_WALL: Rgba = (0.55, 0.55, 0.58, 1.0)
_VIRTUAL: Rgba = (0.45, 0.6, 0.95, 0.5)
"""Of what is sensed, but does not stand in the real arena."""
_BODY: Rgba = (0.2, 0.55, 0.35, 1.0)
_UNSEEN: Rgba = (0.6, 0.6, 0.6, 0.5)
_OBJECT: Rgba = (0.75, 0.5, 0.2, 1.0)
_HEADING: Rgba = (1.0, 1.0, 1.0, 1.0)
_TEXT: Rgba = (1.0, 0.55, 0.0, 1.0)
"""To be read before white floors and before the panel's black."""
_EDGE: Rgba = (0.4, 0.4, 0.45, 1.0)
_CONE: Rgba = (0.95, 0.75, 0.1, 1.0)
_RED: Rgba = (1.0, 0.1, 0.1, 1.0)
_GREEN: Rgba = (0.1, 1.0, 0.2, 1.0)

_LAYER_M = 0.001
"""Flat things lie so far above each other: floor, zones, fields, cones."""
_LED_M, _LAMP_M = 0.012, 0.05
"""Diameters of a drawn LED and a drawn lamp."""
_RING = 8
_FLOOR_CELLS = 128
"""A floor's picture is shown with at most so many columns and rows."""
_UINT8 = 1


def world(data: Mapping[str, Any], arena: Mapping[str, Any] | None, utc_ns: int) -> Json:
    """The scene of `/world`: the arena's edge, and all virtual and physical things.

    `arena` is that of `/experiment`, None: it is not known.
    """
    entities = [] if arena is None else [_edge(arena, utc_ns)]
    floor = data.get("floor")
    # White is what a floor is without paint: it would only dazzle.
    if isinstance(floor, dict) and floor.get("png") is None and min(floor["color"][:3]) < 255:
        (width, depth), (x_m, y_m) = floor["size_m"][:2], floor["centre_m"][:2]
        slab = _shapes.cube(
            (x_m, y_m, -_LAYER_M), (width, depth, _LAYER_M), _shapes.from_bytes(floor["color"])
        )
        entities.append(_shapes.entity(utc_ns, ARENA_FRAME, "floor", cubes=[slab]))
    for thing in data["entities"]:
        make = _THINGS.get(thing["kind"])
        if make is not None:
            entities.append(_shapes.entity(utc_ns, ARENA_FRAME, str(thing["id"]), **make(thing)))
    return _shapes.scene(utc_ns, entities)


def _edge(arena: Mapping[str, Any], utc_ns: int) -> Json:
    (width, depth), (x_m, y_m) = arena["size_m"][:2], arena["centre_m"][:2]
    corners = [(x_m + i * width / 2, y_m + j * depth / 2, 0.0) for i, j in _CORNERS]
    return _shapes.entity(utc_ns, ARENA_FRAME, "arena", lines=[_shapes.line(corners, _EDGE)])


_CORNERS = ((-1, -1), (1, -1), (1, 1), (-1, 1))

Pieces = dict[str, list[Json]]


def _box(thing: Mapping[str, Any]) -> Pieces:
    x_m, y_m, z_m = thing["position_m"]
    size = thing["size_m"]
    middle = (x_m, y_m, z_m + size[2] / 2.0)
    solid = _shapes.cube(middle, size, _paint(thing), thing["yaw_rad"])
    return {"cubes": [solid], "spheres": _lamps(thing, thing["yaw_rad"])}


def _cylinder(thing: Mapping[str, Any]) -> Pieces:
    base, radius_m = thing["position_m"], thing["radius_m"]
    solid = _shapes.cylinder(base, radius_m, thing["height_m"], _paint(thing))
    return {"cylinders": [solid], "spheres": _lamps(thing, 0.0)}


def _paint(thing: Mapping[str, Any]) -> Rgba:
    return _WALL if thing.get("physical") else _VIRTUAL


def _lamps(thing: Mapping[str, Any], yaw_rad: float) -> list[Json]:
    """The LEDs on a box or cylinder: each an offset in its frame, and a colour."""
    cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
    x_m, y_m, z_m = thing["position_m"]
    spheres = []
    for (dx, dy, dz), rgb in thing.get("leds") or ():
        place = (x_m + cosine * dx - sine * dy, y_m + sine * dx + cosine * dy, z_m + dz)
        spheres.append(_shapes.sphere(place, _LED_M, _shapes.from_bytes(rgb)))
    return spheres


def _light(thing: Mapping[str, Any]) -> Pieces:
    x_m, y_m, z_m = thing["position_m"]
    ball = _shapes.sphere((x_m, y_m, z_m), _LAMP_M, _shapes.from_bytes(thing["color"]))
    return {"spheres": [ball], "texts": [_name(thing, (x_m, y_m, z_m + _LAMP_M))]}


def _zone(thing: Mapping[str, Any]) -> Pieces:
    x_m, y_m = thing["x_m"], thing["y_m"]
    seen = thing["color"] is not None
    rgba = _shapes.from_bytes(thing["color"]) if seen else (*_VIRTUAL[:3], 0.25)
    texts = [_name(thing, (x_m, y_m, _LAYER_M))]
    if thing["shape"] == "circle":
        disc = _shapes.cylinder((x_m, y_m, 0.0), thing["radius_m"], _LAYER_M, rgba)
        return {"cylinders": [disc], "texts": texts}
    width, depth = thing["size_m"]
    flat = _shapes.cube((x_m, y_m, _LAYER_M / 2), (width, depth, _LAYER_M), rgba, thing["yaw_rad"])
    return {"cubes": [flat], "texts": texts}


def _robot(thing: Mapping[str, Any]) -> Pieces:
    x_m, y_m = thing["x_m"], thing["y_m"]
    radius_m = thing.get("radius_m", EPUCK.radius_m)
    height_m = thing.get("height_m", EPUCK.height_m)
    return {
        "cylinders": [_shapes.cylinder((x_m, y_m, 0.0), radius_m, height_m, _VIRTUAL)],
        "arrows": [_shapes.arrow((x_m, y_m, height_m), thing["yaw_rad"], radius_m, _HEADING)],
        "texts": [_name(thing, (x_m, y_m, 1.5 * height_m))],
    }


_THINGS = {"box": _box, "cylinder": _cylinder, "light": _light, "zone": _zone, "robot": _robot}


def _name(thing: Mapping[str, Any], place: _shapes.Coordinates) -> Json:
    return _shapes.label(place, str(thing["id"]), _TEXT)


def robots(
    seen: Mapping[int, bool],
    names: Mapping[int, str],
    objects: Iterable[int],
    height_m: Mapping[int, float],
    radius_m: Mapping[int, float],
    utc_ns: int,
) -> Json:
    """The scene of the robots, each in its own frame: it moves with `/tf` alone.

    `seen`: whether a camera sees it now, by tag; `objects` are the tags of what is no robot;
    `height_m` where the marker is, and `radius_m` of the body, by tag.
    """
    things = frozenset(objects)
    entities = []
    for tag, is_seen in seen.items():
        rgba = (_OBJECT if tag in things else _BODY) if is_seen else _UNSEEN
        top_m, body_m = height_m.get(tag) or EPUCK.height_m, radius_m.get(tag, EPUCK.radius_m)
        pieces = {
            "cylinders": [_shapes.cylinder((0.0, 0.0, 0.0), body_m, top_m, rgba)],
            "arrows": [_shapes.arrow((0.0, 0.0, top_m), 0.0, body_m, _HEADING)],
            "texts": [_shapes.label((0.0, 0.0, 1.5 * top_m), names.get(tag, str(tag)), _TEXT)],
        }
        entities.append(_shapes.entity(utc_ns, _shapes.robot_frame(tag), f"robot {tag}", **pieces))
    return _shapes.scene(utc_ns, entities)


def leds(
    lit: Mapping[int, int],
    virtual: Mapping[int, Sequence[float]],
    radius_m: Mapping[int, float],
    utc_ns: int,
) -> Json:
    """The scene of LEDs that are on: the robots' own by their bits, and virtual ones by colour.

    Bits 0 to 7 are the ring, clockwise from the front, 8 the body, 9 the front.
    """
    entities = []
    for tag in sorted({*lit, *virtual}):
        bits, balls, body_m = lit.get(tag, 0), [], radius_m.get(tag, EPUCK.radius_m)
        for number in range(_RING):
            if bits >> number & 1:
                turn = -2.0 * math.pi * number / _RING
                place = (math.cos(turn) * body_m, math.sin(turn) * body_m, 0.05)
                balls.append(_shapes.sphere(place, _LED_M, _RED))
        if bits >> _RING & 1:
            balls.append(_shapes.sphere((0.0, 0.0, 0.03), 2.1 * body_m, (*_GREEN[:3], 0.4)))
        if bits >> (_RING + 1) & 1:
            balls.append(_shapes.sphere((body_m, 0.0, 0.03), _LED_M, _RED))
        if tag in virtual:
            rgba = _shapes.from_bytes(virtual[tag])
            balls.append(_shapes.sphere((0.0, 0.0, EPUCK.height_m), 2.0 * _LED_M, rgba))
        if balls:
            frame = _shapes.robot_frame(tag)
            entities.append(_shapes.entity(utc_ns, frame, f"LEDs of {tag}", spheres=balls))
    return _shapes.scene(utc_ns, entities)


def cones(data: Sequence[Mapping[str, Any]], utc_ns: int) -> Json:
    """The scene of the pollution's cones, which are convex, on the floor."""
    entities = []
    for number, cone in enumerate(data):
        points = [(x, y, 3.0 * _LAYER_M) for x, y in zip(cone["x_m"], cone["y_m"])]
        pieces = {
            "lines": [_shapes.line(points, _CONE, width_px=3.0)],
            "triangles": [_shapes.fan(points, (*_CONE[:3], 0.25))],
        }
        entities.append(_shapes.entity(utc_ns, ARENA_FRAME, f"cone {number}", **pieces))
    return _shapes.scene(utc_ns, entities)


def field(data: Mapping[str, Any], utc_ns: int) -> Json:
    """The grid of one of `/fields`: its bytes as they are, 255 where it is highest."""
    x_m, y_m = data["corner_m"]
    columns = int(data["columns"])
    return {
        **_grid((x_m, y_m, 2.0 * _LAYER_M), columns, (data["cell_m"], data["cell_m"]), utc_ns),
        "row_stride": columns,
        "cell_stride": 1,
        "fields": [{"name": "level", "offset": 0, "type": _UINT8}],
        "data": str(data["levels"]),
    }


def floor(data: Mapping[str, Any], utc_ns: int) -> Json | None:
    """The grid of the floor's picture, red, green, blue and opacity; None: it has none."""
    if data.get("png") is None:
        return None
    image: Any = floor_picture(base64.b64decode(data["png"]))
    most = max(image.shape[:2])
    if most > _FLOOR_CELLS:
        size = [max(round(n * _FLOOR_CELLS / most), 1) for n in image.shape[1::-1]]
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    # Rows of pictures begin above, those of grids at low y.
    image = image if image.shape[2] == 4 else cv2.cvtColor(image, cv2.COLOR_RGB2RGBA)
    cells = np.ascontiguousarray(image[::-1])
    rows, columns = cells.shape[:2]
    (width, depth), (x_m, y_m) = data["size_m"][:2], data["centre_m"][:2]
    corner = (x_m - width / 2.0, y_m - depth / 2.0, -_LAYER_M)
    names = ("red", "green", "blue", "alpha")
    return {
        **_grid(corner, columns, (width / columns, depth / rows), utc_ns),
        "row_stride": 4 * columns,
        "cell_stride": 4,
        "fields": [{"name": n, "offset": at, "type": _UINT8} for at, n in enumerate(names)],
        "data": base64.b64encode(cells.tobytes()).decode(),
    }


def _grid(
    corner: _shapes.Coordinates, columns: int, cell: _shapes.Coordinates, utc_ns: int
) -> Json:
    return {
        "timestamp": _shapes.stamp(utc_ns),
        "frame_id": ARENA_FRAME,
        "pose": _shapes.pose(corner),
        "column_count": columns,
        # Unrounded: over a hundred columns the error would be seen.
        "cell_size": {"x": float(cell[0]), "y": float(cell[1])},
    }
