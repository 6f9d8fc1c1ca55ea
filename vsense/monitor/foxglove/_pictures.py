"""What belongs to the cameras' pictures: where each camera is, its lens, and what is seen in it.

Our pixel (0, 0) is the centre of the upper left pixel, as in OpenCV, whose lens model Foxglove's
calibrations have; its annotations count from that pixel's corner. A picture may come at a scale.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.monitor.foxglove import _shapes
from vsense.monitor.foxglove._shapes import ARENA_FRAME, Json, Rgba
from vsense.vision.cameras.camera import Camera
from vsense.world.robot_models import EPUCK

_RING: Rgba = (0.1, 0.9, 0.3, 1.0)
_TEXT: Rgba = (1.0, 1.0, 1.0, 1.0)
_BACKGROUND: Rgba = (0.0, 0.0, 0.0, 0.5)
_NOTHING: Rgba = (0.0, 0.0, 0.0, 0.0)
_LINES = 4
"""The kind of annotation with one line for each two points."""
_WIDTH_PX, _FONT_SHARE = 2.0, 0.6
"""Of lines; and a label's height as a share of its circle's diameter."""
_DECIMALS = 2
"""Of a pixel."""


@dataclass(frozen=True, slots=True)
class ShownScale:
    """A picture's size as it is shown: a share of the camera's, along x and along y."""

    x: float = 1.0
    y: float = 1.0

    @classmethod
    def of(cls, data: Mapping[str, Any]) -> ShownScale:
        """From the data of `/picture/CAMERA`, whose sides are whole pixels."""
        width, height, scale = data["width_px"], data["height_px"], float(data.get("scale", 1.0))
        if not (0.0 < scale <= 1.0 and width >= 1 and height >= 1):
            raise ValueError("a picture without size")
        return cls(round(width * scale) / width, round(height * scale) / height)


def calibration(camera: Camera, shown: ShownScale, utc_ns: int) -> Json:
    """The lens: OpenCV's model of five coefficients for the picture as it comes, not rectified."""
    fx, fy = camera.fx_px * shown.x, camera.fy_px * shown.y
    # A pixel's centre is half a pixel from its corner, at any scale.
    cx = (camera.cx_px + 0.5) * shown.x - 0.5
    cy = (camera.cy_px + 0.5) * shown.y - 0.5
    return {
        "timestamp": _shapes.stamp(utc_ns),
        "frame_id": _shapes.camera_frame(camera.id),
        "width": round(camera.width_px * shown.x),
        "height": round(camera.height_px * shown.y),
        "distortion_model": "plumb_bob",
        "D": list(camera.distortion),
        "K": [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        "R": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        "P": [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    }


def frame(camera: Camera, utc_ns: int) -> Json:
    """Where the camera's optical frame is in the arena."""
    to_arena = np.reshape(camera.rotation, (3, 3)).T
    turn, name = _shapes.matrix_turn(to_arena), _shapes.camera_frame(camera.id)
    return _shapes.transform(utc_ns, ARENA_FRAME, name, camera.position_m, turn)


def marks(
    camera: Camera,
    images: Mapping[str, Sequence[Any]],
    names: Mapping[int, str],
    heights_m: Mapping[int, float],
    radii_m: Mapping[int, float],
    shown: ShownScale,
    utc_ns: int,
) -> Json:
    """Circle, heading and name of each robot that was read in a camera's picture.

    `images` are this camera's rows of `/arena`'s `images`, in columns; `heights_m` the markers'
    heights and `radii_m` the bodies' radii by tag.
    """
    tags = list(map(int, images["tag"]))
    if not tags:
        return {"timestamp": _shapes.stamp(utc_ns), "circles": [], "points": [], "texts": []}
    size = np.array([shown.x, shown.y])
    centres = (np.column_stack((images["x_px"], images["y_px"])) + 0.5) * size
    shapes = [(radii_m.get(tag, EPUCK.radius_m), heights_m.get(tag, 0.0)) for tag in tags]
    arms = _arms(camera, images, np.array(shapes)) * size
    radii = np.hypot(arms[:, 0], arms[:, 1])
    stamp = _shapes.stamp(utc_ns)
    return {
        "timestamp": stamp,
        "circles": [_circle(stamp, *circle) for circle in zip(centres, radii)],
        "points": [_headings(stamp, centres, centres + arms)],
        "texts": [
            _label(stamp, centre, radius, names.get(tag, str(tag)))
            for tag, centre, radius in zip(tags, centres, radii)
        ],
    }


def _arms(
    camera: Camera, images: Mapping[str, Sequence[Any]], shapes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """From each centre to where the body's edge is along its heading, (n, 2) camera pixels.

    `shapes` are (n, 2) radius and height of the marker [m].
    """
    yaw = np.asarray(images["yaw_rad"], dtype=np.float64)
    middles = np.column_stack((images["x_m"], images["y_m"], shapes[:, 1])).astype(np.float64)
    flat = np.zeros_like(yaw)
    edges = middles + shapes[:, :1] * np.column_stack((np.cos(yaw), np.sin(yaw), flat))
    return camera.project(edges) - camera.project(middles)


def _circle(stamp: Json, centre: NDArray[np.float64], radius_px: float) -> Json:
    return {
        "timestamp": stamp,
        "position": _pixel(centre),
        "diameter": round(2.0 * float(radius_px), _DECIMALS),
        "thickness": _WIDTH_PX,
        "fill_color": _shapes.color(_NOTHING),
        "outline_color": _shapes.color(_RING),
    }


def _headings(stamp: Json, centres: NDArray[np.float64], ends: NDArray[np.float64]) -> Json:
    points = np.stack((centres, ends), axis=1).reshape(-1, 2)
    return {
        "timestamp": stamp,
        "type": _LINES,
        "points": [_pixel(point) for point in points],
        "outline_color": _shapes.color(_RING),
        "outline_colors": [],
        "fill_color": _shapes.color(_NOTHING),
        "thickness": _WIDTH_PX,
    }


def _label(stamp: Json, centre: NDArray[np.float64], radius_px: float, text: str) -> Json:
    """A text right above the circle, beginning at its middle."""
    return {
        "timestamp": stamp,
        "position": _pixel(centre - (0.0, float(radius_px))),
        "text": text,
        "font_size": max(round(2.0 * _FONT_SHARE * float(radius_px), 1), 8.0),
        "text_color": _shapes.color(_TEXT),
        "background_color": _shapes.color(_BACKGROUND),
    }


def _pixel(point: NDArray[np.float64]) -> Json:
    return {"x": round(float(point[0]), _DECIMALS), "y": round(float(point[1]), _DECIMALS)}
