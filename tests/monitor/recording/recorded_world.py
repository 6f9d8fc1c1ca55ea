"""A short run before two cameras, as its messages tell it: everything that a video draws."""

from __future__ import annotations

import base64
import json
from typing import Any

import numpy as np

from tests.monitor.recording.conftest import BEGIN_NS
from vsense.base.arena import Frame
from vsense.base.message_bus import Message
from vsense.vision.cameras.camera import Camera

TIMESTEPS = 20
DT_NS = 100_000_000
_LENS = (-0.2, 0.05, 1e-3, -1e-3, 0.0)
CAMERAS = [
    Camera.looking_down(name, x_m, 0.0, 2.0, 220.0, (320, 240), _LENS)
    for name, x_m in (("left", -0.2), ("right", 0.4))
]
PICTURE = np.random.default_rng(5).integers(90, 110, (240, 320)).astype(np.uint8)


def experiment() -> dict[str, Any]:
    """The `/experiment` message."""
    return {
        "mode": "live", "command": "lab", "name": "short", "timestep_s": 0.1,
        "arena": {"size_m": [3.0, 2.4, 1.0], "centre_m": [0.0, 0.0, 0.5]},
        "robots": [{"tag": tag, "name": f"r{tag}", "height_m": 0.06} for tag in (1, 2)],
        "objects": [{"tag": 9, "name": "source"}],
        "controllers": [{"id": "c", "library": "l", "tags": [1, 2], "actuators": [], "sensors": [
            {"name": "pollutant", "layout": "f4", "count": 1, "angles_rad": None},
            {"name": "light", "layout": "2*f4", "count": 2, "angles_rad": [0.0, 1.0]},
        ]}],
        "cameras": [
            {"id": c.id, "tracker": c.id, "width_px": 320, "height_px": 240, "row": 0, "column": n,
             "position_m": list(c.position_m), "model": json.loads(c.to_json())}
            for n, c in enumerate(CAMERAS)
        ],
    }  # fmt: skip


def world() -> dict[str, Any]:
    """The `/world` message; one entity is of a kind that nobody knows, one is damaged."""
    box = {"kind": "box", "yaw_rad": 0.3, "leds": []}
    return {
        "entities": [
            {**box, "id": "wall", "position_m": [0.0, 1.1, 0.0], "size_m": [2.8, 0.02, 0.1],
             "physical": True, "yaw_rad": 0.0},
            {**box, "id": "gate", "position_m": [-0.6, 0.5, 0.0], "size_m": [0.4, 0.1, 0.1],
             "physical": False, "colour_of_tomorrow": "blue"},
            {"kind": "light", "id": "l", "position_m": [-0.8, -0.6, 0.4], "intensity": 1.0,
             "color": [80, 80, 255]},
            {"kind": "zone", "id": "nest", "shape": "circle", "x_m": -0.9, "y_m": 0.0,
             "radius_m": 0.2, "size_m": [0.0, 0.0], "yaw_rad": 0.0, "color": [0, 160, 90],
             "value": 0.0},
            {"kind": "robot", "id": "v", "tag": 70000, "x_m": -0.3, "y_m": 0.8, "yaw_rad": 1.0},
            {"kind": "dragon", "id": "d"}, {"kind": "box", "id": "half"}, None,
        ],
        "floor": {"color": [255, 255, 255], "size_m": [3.0, 2.4], "centre_m": [0, 0], "png": None},
    }  # fmt: skip


def messages() -> list[Message]:
    """All messages but the pictures."""
    levels = np.zeros((24, 30), np.uint8)
    levels[4:9, 3:9] = 255
    field = {
        "id": "scent", "corner_m": [-1.5, -1.2], "cell_m": 0.1, "columns": 30, "rows": 24,
        "peak": 2.0, "levels": base64.b64encode(levels.tobytes()).decode(),
    }  # fmt: skip
    told = [
        Message("/experiment", BEGIN_NS, experiment()),
        Message("/run", BEGIN_NS, {"state": "running", "run": 1}),
        Message("/world", BEGIN_NS, world()),
        Message("/fields", BEGIN_NS, {"fields": [field]}),
    ]
    for step in range(TIMESTEPS):
        told += [Message(topic, BEGIN_NS + step * DT_NS, data) for topic, data in moment(step)]
    return told


def moment(step: int) -> list[tuple[str, dict[str, Any]]]:
    """The messages of a timestep; robot 1 drives through the cone, robot 2 stands outside."""
    robots = {
        "tag": [1, 2, 9], "x_m": [0.2 + 0.01 * step, -0.5, 0.0], "y_m": [0.0, -0.3, 0.0],
        "yaw_rad": [0.0, 1.0, 0.0], "seen": [True] * 3, "age_ns": [0] * 3,
    }  # fmt: skip
    return [
        ("/signals", {"timestep": step, "time_s": step * 0.1, "measures": {"found": 7},
                      "leds": {"tag": [2], "color": [[9, 200, 9]]},
                      "cones": [{"x_m": [0.0, 0.5, 0.5], "y_m": [0.0, -0.4, 0.4]}]}),
        ("/robots", {"tag": [1, 2], "leds": [255, 0]}),
        ("/readings", {"timestep": step, "capture_ns": BEGIN_NS + step * DT_NS, "tag": [1, 2],
                       "values": [[[1.0], [0.0, 0.0]], [[0.5], [0.5, 2.0]]],
                       "captured_ns": [[0, 0], [0, 0]]}),
        ("/arena", {"timestep": step, "run_timestep": step, "robots": robots,
                    "capture_ns": BEGIN_NS + step * DT_NS}),
    ]  # fmt: skip


def frames() -> list[Frame]:
    """Both cameras' pictures."""
    return [
        Frame(c.id, PICTURE, step, BEGIN_NS + step * DT_NS, BEGIN_NS + step * DT_NS)
        for step in range(TIMESTEPS)
        for c in CAMERAS
    ]
