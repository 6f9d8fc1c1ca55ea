"""What the puppet plays: an arena with things in it, wandering robots, and painted pictures."""

from __future__ import annotations

import base64
import json
import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.vision.cameras.camera import Camera

SIZE_M = (3.0, 2.4, 1.0)
POLLUTER = 900
EPUCK_RAD = [math.radians(-a) for a in (17.2, 45.8, 90.0, 151.9, -151.9, -90.0, -45.8, -17.2)]
CAMERA_PX = (1280, 960)
PICTURE_SCALE = 0.375


class Swarm:
    """Robots that wander and turn round at the walls."""

    def __init__(self, count: int, seed: int) -> None:
        self.random = np.random.default_rng(seed)
        half = np.array(SIZE_M[:2]) / 2 - 0.15
        self.tags = [int(tag) for tag in 11 + 4 * np.arange(count)]
        self.places = self.random.uniform(-half, half, (count, 2))
        self.yaws = self.random.uniform(-np.pi, np.pi, count)
        self.turns = self.random.uniform(-1.0, 1.0, count)
        self.speed_m_s = 0.1

    def move(self, step_s: float) -> None:
        """Lets all drive for a while."""
        self.turns += self.random.normal(0.0, 0.4, len(self.tags))
        self.turns = np.clip(self.turns, -1.5, 1.5)
        self.yaws += self.turns * step_s
        ahead = np.stack((np.cos(self.yaws), np.sin(self.yaws)), axis=-1)
        wanted = self.places + ahead * self.speed_m_s * step_s
        half = np.array(SIZE_M[:2]) / 2 - 0.07
        outside = (np.abs(wanted) > half).any(axis=1)
        self.yaws[outside] += 2.4
        self.places = np.clip(wanted, -half, half)
        self.yaws = (self.yaws + np.pi) % (2 * np.pi) - np.pi


def cone(time_s: float) -> tuple[list[float], list[float]]:
    """The polluted triangle, which turns slowly."""
    turn = 0.15 * time_s
    angles = (turn - math.pi / 4, turn + math.pi / 4)
    return (
        [0.0, *(math.cos(a) for a in angles)],
        [0.0, *(math.sin(a) for a in angles)],
    )


def in_cone(places: NDArray[Any], time_s: float) -> NDArray[np.bool_]:
    """Which places (n, 2) lie in it."""
    turn = 0.15 * time_s
    along = places[:, 0] * math.cos(turn) + places[:, 1] * math.sin(turn)
    across = places[:, 1] * math.cos(turn) - places[:, 0] * math.sin(turn)
    return np.asarray((along > 0) & (along < math.cos(math.pi / 4)) & (np.abs(across) < along))


def experiment(swarm: Swarm, cameras: int, mode: str) -> dict[str, Any]:
    """The `/experiment` message."""
    columns = math.ceil(math.sqrt(cameras))
    return {
        "mode": mode, "command": "replay" if mode == "replay" else "lab", "user": "anna",
        "name": "pollutant", "seed": 1, "blind": False, "version": "0.1",
        "file_text": "<argos-configuration/>", "timestep_s": 0.1, "length_s": 120.0,
        "arena": {"size_m": list(SIZE_M), "centre_m": [0.0, 0.0, 0.5]},
        "robots": [{"tag": t, "name": f"epuck_{t}", "height_m": 0.076} for t in swarm.tags],
        "objects": [{"tag": POLLUTER, "name": "polluter"}],
        "controllers": [{
            "id": "cleaners", "library": "pollutant", "tags": swarm.tags,
            "sensors": [
                {"name": "pollutant", "layout": "u1", "count": 1, "angles_rad": None},
                {"name": "proximity", "layout": "8*f4", "count": 8,
                 "angles_rad": EPUCK_RAD},
                {"name": "light", "layout": "16*f4", "count": 16,
                 "angles_rad": EPUCK_RAD},
                {"name": "gps", "layout": "2*f4", "count": 2, "angles_rad": None},
            ],
            "actuators": [{"name": "cleaner", "layout": "u1", "count": 1}],
        }],
        "cameras": [
            {"id": f"cam{k}", "tracker": f"tracker_{k // 2}", "width_px": CAMERA_PX[0],
             "height_px": CAMERA_PX[1], "row": k // columns, "column": k % columns,
             "position_m": [*camera_middle(k, cameras), 2.5], "model": model(k, cameras)}
            for k in range(cameras)
        ],
        "body_radius_m": 0.035,
    }  # fmt: skip


def camera_middle(camera: int, cameras: int) -> tuple[float, float]:
    """Where on the floor a camera looks at."""
    columns = math.ceil(math.sqrt(cameras))
    rows = math.ceil(cameras / columns)
    x = ((camera % columns) + 0.5) / columns - 0.5
    y = 0.5 - ((camera // columns) + 0.5) / rows
    return x * SIZE_M[0], y * SIZE_M[1]


def model(camera: int, cameras: int) -> dict[str, Any]:
    """A camera's model: it looks straight down, and bends nothing."""
    focal_px = 2.5 * px_per_m(cameras)
    made = Camera.looking_down(
        f"cam{camera}", *camera_middle(camera, cameras), 2.5, focal_px, CAMERA_PX
    )
    return dict(json.loads(made.to_json()))


def px_per_m(cameras: int) -> float:
    """The scale of all cameras' pictures, on the floor."""
    return CAMERA_PX[0] / (SIZE_M[0] / math.ceil(math.sqrt(cameras)) * 1.15)


def to_pixels(
    places: NDArray[Any], camera: int, cameras: int
) -> tuple[NDArray[Any], NDArray[np.bool_], float]:
    """Pixels of places (n, 2) in a camera's full picture, which of them it sees, px per m."""
    scale = px_per_m(cameras)
    offset = (places - np.array(camera_middle(camera, cameras))) * scale
    pixels = np.array(CAMERA_PX) / 2 + offset * [1.0, -1.0]
    inside = ((pixels > 0) & (pixels < np.array(CAMERA_PX))).all(axis=1)
    return pixels, inside, scale


def world() -> dict[str, Any]:
    """The `/world` message."""
    walls = [
        ("wall_north", [0.0, 1.19, 0.0], [3.0, 0.02, 0.08]),
        ("wall_south", [0.0, -1.19, 0.0], [3.0, 0.02, 0.08]),
        ("wall_east", [1.49, 0.0, 0.0], [0.02, 2.36, 0.08]),
        ("wall_west", [-1.49, 0.0, 0.0], [0.02, 2.36, 0.08]),
    ]
    entities: list[dict[str, Any]] = [
        {"kind": "box", "id": i, "position_m": p, "size_m": s, "yaw_rad": 0.0, "physical": True}
        for i, p, s in walls
    ]
    entities += [
        {"kind": "box", "id": "gate", "position_m": [-0.9, 0.55, 0.0],
         "size_m": [0.5, 0.06, 0.1], "yaw_rad": 0.5, "physical": False},
        {"kind": "cylinder", "id": "pillar", "position_m": [0.95, -0.7, 0.0], "radius_m": 0.1,
         "height_m": 0.3, "physical": False},
        {"kind": "light", "id": "sun", "position_m": [-1.2, -0.9, 0.8], "intensity": 2.0,
         "color": [255, 255, 255]},
        {"kind": "light", "id": "red", "position_m": [1.9, 0.9, 0.8], "intensity": 1.0,
         "color": [255, 80, 60]},
        {"kind": "zone", "id": "nest", "shape": "circle", "x_m": 1.0, "y_m": 0.7,
         "radius_m": 0.28, "size_m": [0.0, 0.0], "yaw_rad": 0.0, "color": [60, 160, 90],
         "value": 1.0},
        {"kind": "zone", "id": "silent", "shape": "rectangle", "x_m": -0.3, "y_m": -0.95,
         "radius_m": 0.0, "size_m": [0.6, 0.25], "yaw_rad": 0.0, "color": None, "value": 0.0},
        {"kind": "robot", "id": "ghost", "tag": 65536, "x_m": 0.5, "y_m": 0.85, "yaw_rad": -0.6},
    ]  # fmt: skip
    return {
        "entities": entities,
        "floor": {"color": [255, 255, 255], "size_m": list(SIZE_M[:2]), "centre_m": [0.0, 0.0],
                  "png": floor_png()},
    }  # fmt: skip


def floor_png() -> str:
    """A floor with a grey patch; the rest is white, as without paint."""
    floor = np.full((48, 60, 3), 255, np.uint8)
    cv2.rectangle(floor, (4, 30), (16, 44), (210, 210, 210), -1)
    cv2.rectangle(floor, (8, 34), (12, 40), (90, 90, 90), -1)
    return base64.b64encode(cv2.imencode(".png", floor)[1].tobytes()).decode()


def fields(time_s: float) -> dict[str, Any]:
    """The `/fields` message: a cloud that wanders."""
    columns, rows, cell = 60, 48, 0.05
    x = (np.arange(columns) + 0.5) * cell - SIZE_M[0] / 2
    y = (np.arange(rows) + 0.5) * cell - SIZE_M[1] / 2
    at = (0.9 * math.cos(0.1 * time_s) - 0.2, 0.6 * math.sin(0.1 * time_s) - 0.2)
    cloud = np.exp(-((x[None] - at[0]) ** 2 + (y[:, None] - at[1]) ** 2) / 0.06)
    levels = np.rint(255 * cloud).astype(np.uint8)
    return {"fields": [{
        "id": "pheromone", "corner_m": [-SIZE_M[0] / 2, -SIZE_M[1] / 2], "cell_m": cell,
        "columns": columns, "rows": rows, "peak": 0.8,
        "levels": base64.b64encode(levels.tobytes()).decode(),
    }]}  # fmt: skip


def picture(swarm: Swarm, camera: int, cameras: int) -> bytes:
    """A camera's JPEG: a grey floor with white discs."""
    width, height = (round(side * PICTURE_SCALE) for side in CAMERA_PX)
    image = np.full((height, width), 118, np.uint8)
    for x in range(-width, width, 60):
        cv2.line(image, (x, 0), (x + height, height), 112, 1)
    pixels, inside, scale = to_pixels(swarm.places, camera, cameras)
    for (x, y), yaw in zip(pixels[inside] * PICTURE_SCALE, swarm.yaws[inside]):
        at, radius = (round(x), round(y)), round(0.035 * scale * PICTURE_SCALE)
        cv2.circle(image, at, radius, 235, -1, cv2.LINE_AA)
        tip = (round(x + radius * math.cos(yaw)), round(y - radius * math.sin(yaw)))
        cv2.line(image, at, tip, 20, 3, cv2.LINE_AA)
    noise = swarm.random.integers(0, 9, image.shape, dtype=np.uint8)
    return cv2.imencode(".jpg", image + noise, [cv2.IMWRITE_JPEG_QUALITY, 75])[1].tobytes()
