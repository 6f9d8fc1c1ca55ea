"""The pieces that Foxglove's messages are made of: times, poses, colours, solids, lines, labels.

Positions are in m, angles in rad; colours are (red, green, blue, opacity), each from 0 to 1.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

Json = dict[str, Any]
Rgba = tuple[float, float, float, float]
Coordinates = Sequence[float]

PICTURE = "/picture/"
ARENA_FRAME = "arena"
"""The root of all frames: the arena frame, floor at z = 0."""

_SECOND_NS = 1_000_000_000
_METRES, _TURNS = 6, 9
"""Decimals: a micrometre is far below what cameras see; `/arena` has everything unrounded."""
_LATEST_NS = (1 << 32) * _SECOND_NS - 1
"""Seconds have 32 bits."""


def robot_frame(tag: int) -> str:
    """The frame of a robot: origin on the floor below its middle, x along its heading."""
    return f"robot/{tag}"


def camera_frame(camera: str) -> str:
    """A camera's optical frame: x to the right in the picture, y down, z along its axis."""
    return f"camera/{camera}"


def stamp(utc_ns: int) -> Json:
    """A time in ns since 1970."""
    sec, nsec = divmod(min(max(utc_ns, 0), _LATEST_NS), _SECOND_NS)
    return {"sec": sec, "nsec": nsec}


def xy(point: Coordinates) -> Json:
    """The first two numbers of a point."""
    return {"x": round(float(point[0]), _METRES), "y": round(float(point[1]), _METRES)}


def xyz(point: Coordinates) -> Json:
    """A point or vector of three numbers."""
    x, y, z = point
    return dict(zip("xyz", (round(float(v), _METRES) for v in (x, y, z))))


def yaw_turn(yaw_rad: float) -> Json:
    """The quaternion of a turn about z."""
    half = yaw_rad / 2.0
    return {
        "x": 0.0,
        "y": 0.0,
        "z": round(math.sin(half), _TURNS),
        "w": round(math.cos(half), _TURNS),
    }


def matrix_turn(matrix: ArrayLike) -> Json:
    """The quaternion of a 3x3 rotation matrix, of length 1 and with w >= 0.

    Its largest component is found first, so that nothing is divided by almost 0. Source: Shepperd,
    Quaternion from rotation matrix, 1978.
    """
    m = np.asarray(matrix, dtype=np.float64)
    diagonal = np.array([np.trace(m), *np.diag(m)])
    first = int(np.argmax(diagonal))
    if first == 0:
        wxyz = [1.0 + diagonal[0], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]]
    else:
        i, j, k = ((first - 1 + step) % 3 for step in range(3))
        wxyz = [0.0] * 4
        wxyz[0] = m[k, j] - m[j, k]
        wxyz[1 + i] = 1.0 + m[i, i] - m[j, j] - m[k, k]
        wxyz[1 + j], wxyz[1 + k] = m[j, i] + m[i, j], m[k, i] + m[i, k]
    unit = np.array(wxyz) / math.copysign(float(np.linalg.norm(wxyz)), wxyz[0])
    return dict(zip("wxyz", (round(float(v), _TURNS) for v in unit)))


def pose(point: Coordinates = (0.0, 0.0, 0.0), yaw_rad: float = 0.0) -> Json:
    """A position and a turn about z."""
    return {"position": xyz(point), "orientation": yaw_turn(yaw_rad)}


def color(rgba: Rgba) -> Json:
    """A colour."""
    return dict(zip("rgba", (round(v, 3) for v in rgba)))


def from_bytes(rgb: Sequence[float], opacity: float = 1.0) -> Rgba:
    """A colour of three numbers from 0 to 255."""
    red, green, blue = (min(max(float(v) / 255.0, 0.0), 1.0) for v in rgb[:3])
    return red, green, blue, opacity


def transform(utc_ns: int, parent: str, child: str, point: Coordinates, turn: Json) -> Json:
    """Where the frame `child` is in `parent`."""
    return {
        "timestamp": stamp(utc_ns),
        "parent_frame_id": parent,
        "child_frame_id": child,
        "translation": xyz(point),
        "rotation": turn,
    }


def cube(middle: Coordinates, size: Coordinates, rgba: Rgba, yaw_rad: float = 0.0) -> Json:
    """A box; `size` is its extent along its own x, y and z. A sphere has the same fields."""
    return {"pose": pose(middle, yaw_rad), "size": xyz(size), "color": color(rgba)}


def sphere(middle: Coordinates, diameter_m: float, rgba: Rgba) -> Json:
    """A ball."""
    return cube(middle, (diameter_m,) * 3, rgba)


def cylinder(base: Coordinates, radius_m: float, height_m: float, rgba: Rgba) -> Json:
    """An upright cylinder; `base` is the middle of its lower face."""
    middle = (base[0], base[1], base[2] + height_m / 2.0)
    size = (2.0 * radius_m, 2.0 * radius_m, height_m)
    solid = {"pose": pose(middle), "size": xyz(size), "color": color(rgba)}
    return {**solid, "bottom_scale": 1.0, "top_scale": 1.0}


def arrow(tail: Coordinates, yaw_rad: float, length_m: float, rgba: Rgba) -> Json:
    """A horizontal arrow, whose head is its last third."""
    return {
        "pose": pose(tail, yaw_rad),
        "shaft_length": round(length_m * 2.0 / 3.0, _METRES),
        "shaft_diameter": round(length_m / 8.0, _METRES),
        "head_length": round(length_m / 3.0, _METRES),
        "head_diameter": round(length_m / 3.0, _METRES),
        "color": color(rgba),
    }


LOOP, SEGMENTS = 1, 2
"""Kinds of lines: closed through all points, or one for each two points."""


def line(
    points: Iterable[Coordinates], rgba: Rgba, kind: int = LOOP, width_px: float = 2.0
) -> Json:
    """Lines of a width in pixels of the screen."""
    return {
        "type": kind,
        "pose": pose(),
        "thickness": width_px,
        "scale_invariant": True,
        "points": [xyz(point) for point in points],
        "color": color(rgba),
        "colors": [],
        "indices": [],
    }


def fan(points: Sequence[Coordinates], rgba: Rgba) -> Json:
    """A convex area, as triangles from its first corner."""
    first = points[0]
    corners = [corner for pair in pairwise(points[1:]) for corner in (first, *pair)]
    return {
        "pose": pose(),
        "points": [xyz(point) for point in corners],
        "color": color(rgba),
        "colors": [],
        "indices": [],
    }


def label(point: Coordinates, text: str, rgba: Rgba, size_px: float = 14.0) -> Json:
    """A text that faces the viewer, with a height in pixels of the screen."""
    return {
        "pose": pose(point),
        "billboard": True,
        "font_size": size_px,
        "scale_invariant": True,
        "color": color(rgba),
        "text": text,
    }


_KINDS = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")


def entity(utc_ns: int, frame: str, name: str, **pieces: list[Json]) -> Json:
    """A thing of a scene, which stays until it is replaced and moves with its frame.

    `pieces` are lists of solids by the schema's names: `cubes`, `lines`, `texts`, ...
    """
    return {
        "timestamp": stamp(utc_ns),
        "frame_id": frame,
        "id": name,
        "lifetime": {"sec": 0, "nsec": 0},
        "frame_locked": True,
        "metadata": [],
        **{kind: pieces.get(kind, []) for kind in _KINDS},
    }


def scene(utc_ns: int, entities: list[Json]) -> Json:
    """A whole scene: what was there before and is not in it goes.

    It is whole because a viewer that jumps to another time is given the newest message only. What
    has the deletion's own time stays.
    """
    everything = {"timestamp": stamp(utc_ns), "type": 1, "id": ""}
    return {"deletions": [everything], "entities": entities}
