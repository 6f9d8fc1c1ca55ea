"""What a run tells, by hand: one of everything that Foxglove is shown."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable
from typing import Any

import cv2
import numpy as np

from vsense.base.message_bus import Message
from vsense.monitor.foxglove.channels import Channels, Derived
from vsense.monitor.ui.messages import entity
from vsense.vision.cameras.camera import Camera
from vsense.world.entities import Box, Cylinder, Led, Light, VirtualRobot, Zone

AT_NS, SHIFT_NS = 7_000_000_000, 1_700_000_000_123_456_789
CAMERA = Camera.looking_down("cam", 0.5, -0.25, 2.5, 800.0, (640, 480), (-0.1, 0.02, 0, 0, 0))
VIRTUAL = 0x10000
ENTITIES = [
    Box("wall", (1.0, 0.5, 0.0), (0.4, 0.02, 0.1), 0.5, True, (Led((0.2, 0.0, 0.1), (255, 0, 0)),)),
    Cylinder("pillar", (-0.5, 0.5, 0.0), 0.1, 0.3),
    Light("lamp", (0.0, 0.0, 1.0), 1.5, (255, 255, 0)),
    Zone("nest", "circle", -1.0, 0.0, 0.3, color=(0, 128, 0)),
    Zone("strip", "rectangle", 1.0, 0.0, size_m=(0.5, 0.2), yaw_rad=0.3),
    VirtualRobot("ghost", VIRTUAL, 0.1, 0.2, 1.0),
]
FLOOR = np.zeros((2, 3, 3), np.uint8)
FLOOR[0, 0] = (10, 20, 200)
"""Blue, green, red: its upper left pixel is red."""


def experiment() -> dict[str, Any]:
    """Two robots, a box with a tag, one camera."""
    return {
        "arena": {"size_m": [3.0, 2.0, 1.0], "centre_m": [0.25, 0.0, 0.5]},
        "robots": [
            {"tag": 3, "name": "epuck3", "height_m": 0.06},
            {"tag": 14, "name": "epuck14", "height_m": 0.06},
        ],
        "objects": [{"tag": 22, "name": "stone"}],
        "cameras": [{"id": "cam", "model": json.loads(CAMERA.to_json())}],
    }


def world() -> dict[str, Any]:
    """One thing of each kind, on a floor with a picture."""
    png = base64.b64encode(cv2.imencode(".png", FLOOR)[1].tobytes()).decode()
    floor = {"color": [255, 255, 255], "size_m": [3.0, 2.0], "centre_m": [0.25, 0.0], "png": png}
    return {"entities": [entity(thing) for thing in ENTITIES], "floor": floor}


def arena() -> dict[str, Any]:
    """Robot 3 is seen by the camera, 14 is not, 22 is the stone."""
    x_px, y_px = CAMERA.project(np.array([0.5, -0.2, 0.06]))
    return {
        "robots": {
            "tag": [3, 14, 22],
            "x_m": [0.5, -0.1, 0.3],
            "y_m": [-0.2, 0.4, 0.4],
            "yaw_rad": [1.5, -3.0, 0.0],
            "seen": [True, False, True],
        },
        "cameras": ["cam"],
        "images": {
            **{"tag": [3], "camera": [0], "x_px": [float(x_px)], "y_px": [float(y_px)]},
            **{"x_m": [0.5], "y_m": [-0.2], "yaw_rad": [1.5]},
        },
    }


def everything() -> list[Message]:
    """One message of each topic, in the order of a run."""
    signals = {
        "leds": {"tag": [14, VIRTUAL], "color": [[0, 0, 255], [255, 0, 0]]},
        "cones": [{"x_m": [0.0, 0.5, 1.0, 0.5], "y_m": [0.0, 0.5, 0.0, -0.5]}],
        "measures": {"robots_in_cone": 2, "light_m": 0.5, "unknown": None},
    }
    levels = base64.b64encode(bytes(range(6))).decode()
    grid = {"id": "scent", "corner_m": [-1.0, -0.5], "cell_m": 0.1, "columns": 3, "rows": 2}
    picture = {"camera": "cam", "capture_ns": AT_NS, "format": "jpeg", "width_px": 640}
    told = {
        "/experiment": experiment(),
        "/world": world(),
        "/picture/cam": {**picture, "height_px": 480, "scale": 0.5},
        "/arena": arena(),
        "/signals": signals,
        "/robots": {"tag": [3, 14, 22], "leds": [0b11_0000_0101, 0, None]},
        "/fields": {"fields": [{**grid, "peak": 2.0, "levels": levels}]},
        "/event": {"text": "robot 14 has joined", "level": "warning", "by": None},
        "/gap": {"from_ns": 1, "to_ns": 2, "messages": 3, "pictures": 0, "why": "the disk"},
    }
    return [Message(topic, AT_NS, data) for topic, data in told.items()]


def converted(messages: Iterable[Message], channels: Channels | None = None) -> dict[str, Any]:
    """The newest data of each derived topic."""
    channels = channels or Channels(SHIFT_NS)
    made: list[Derived] = [one for each in messages for one in channels.convert(each)]
    return {one.topic: one.data for one in made}


def turned(turn: dict[str, float], vector: Any) -> Any:
    """A vector turned by a quaternion: v + 2 q x (q x v + w v)."""
    q = np.array([turn["x"], turn["y"], turn["z"]])
    return vector + 2.0 * np.cross(q, np.cross(q, vector) + turn["w"] * np.asarray(vector))
