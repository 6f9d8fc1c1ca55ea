"""The public four-camera recording of caliscope (tests/data/four-cameras) as one of vsense's.

Its videos are not in the sources: whoever has its folder (`cam_0.mp4` to `cam_3.mp4`,
`timestamps.csv`, `camera_array.toml`, `xy.csv`) makes pictures of them here. Its board has light
cells on dark ground, so the pictures are inverted; the floor is the plane in which the board is
held most of the time.
"""

from __future__ import annotations

import csv
import json
from collections import defaultdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tomlkit

FAMILY = {
    "kind": "square",
    "name": "board",
    "dictionary": "DICT_4X4_1000",
    "size_mm": 40.5,
    "heading_deg": 90.0,
    "disc_diameter_mm": 60.0,
}
"""Three quarters of a square of 54 mm. Source: charuco.toml."""
ALIKE = np.cos(np.radians(20.0))


def write_recording(source: Path, folder: Path) -> Path:
    """Writes pictures, cameras and a resources file; returns that file."""
    cameras = tomlkit.parse((source / "camera_array.toml").read_text()).unwrap()["cameras"]
    turn, origin = floor_of(source, cameras)
    with open(source / "timestamps.csv", newline="") as file:
        times = list(csv.DictReader(file))
    parts: dict[str, list[str]] = {"grabbers": [], "cameras": []}
    for number, camera in sorted(cameras.items()):
        id = f"cam_{number}"
        mine = [row for row in times if row["cam_id"] == number]
        write_pictures(source / f"{id}.mp4", mine, folder / id)
        (folder / f"{id}.json").write_text(camera_file(id, camera, turn, origin))
        table = f'path="{id}" timestamps="{id}/times.csv"'
        parts["grabbers"].append(f'<grabber id="{id}" type="directory" {table} />')
        parts["cameras"].append(f'<camera id="{id}" calibration="{id}.json" />')
    (folder / "board.json").write_text(json.dumps(FAMILY))
    tracker = '<tracker id="t" family="board.json" tags="0-9" robot_height="0" max_speed="5" />'
    path = folder / "resources.xml"
    path.write_text(
        f"<arena_tracking_system><grabbers>{''.join(parts['grabbers'])}</grabbers><trackers>"
        f"{tracker}</trackers><cameras>{''.join(parts['cameras'])}</cameras>"
        "</arena_tracking_system>"
    )
    return path


def write_pictures(video: Path, times: list[dict[str, str]], folder: Path) -> None:
    """Writes a video's pictures, inverted, and when they were taken."""
    folder.mkdir()
    lines, pictures = ["picture,timestep,capture_ns"], cv2.VideoCapture(str(video))
    for number, row in enumerate(times):
        there, image = pictures.read()
        assert there, f"{video} ends after {number} pictures"
        cv2.imwrite(str(folder / f"{number:03}.png"), 255 - cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
        lines.append(f"{number:03}.png,{row['sync_index']},{round(float(row['frame_time']) * 1e9)}")
    (folder / "times.csv").write_text("\n".join(lines) + "\n")


def camera_file(id: str, camera: Any, turn: np.ndarray, origin: np.ndarray) -> str:
    """A camera of caliscope's in the frame of the floor."""
    rotation, matrix = np.array(camera["rotation"]), np.array(camera["matrix"])
    centre = -rotation.T @ np.array(camera["translation"])
    return json.dumps(
        {
            "id": id,
            **dict(zip(("width_px", "height_px"), camera["size"], strict=True)),
            **{"fx_px": matrix[0, 0], "fy_px": matrix[1, 1]},
            **{"cx_px": matrix[0, 2], "cy_px": matrix[1, 2]},
            "distortion": list(camera["distortions"]),
            "position_m": (turn @ (centre - origin)).tolist(),
            "rotation": (rotation @ turn.T).ravel().tolist(),
        }
    )


def floor_of(source: Path, cameras: Any) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and origin of the plane in which the board is most of the time."""
    seen: dict[tuple[str, str], dict[str, tuple[float, float]]] = defaultdict(dict)
    with open(source / "xy.csv", newline="") as file:
        for row in csv.DictReader(file):
            at_px = float(row["img_loc_x"]), float(row["img_loc_y"])
            seen[row["sync_index"], row["keypoint_id"]][row["cam_id"]] = at_px
    corners: dict[str, list[np.ndarray]] = defaultdict(list)
    for (moment, _), views in seen.items():
        if len(views) > 1:
            corners[moment].append(triangulated(cameras, views))
    centres = [-np.array(c["rotation"]).T @ np.array(c["translation"]) for c in cameras.values()]
    planes = []
    for points in (np.array(group) for group in corners.values() if len(group) > 5):
        middle = points.mean(axis=0)
        normal = np.linalg.svd(points - middle)[2][2]
        up = np.sign(normal @ (np.mean(centres, axis=0) - middle))
        planes.append((up * normal, middle))
    normals, middles = map(np.array, zip(*planes, strict=True))
    up = normals[np.argmax([(normals @ n > ALIKE).sum() for n in normals])]
    across = np.cross(up, (0.0, 0.0, 1.0))
    across /= np.linalg.norm(across)
    return np.stack((across, np.cross(up, across), up)), np.median(middles[normals @ up > ALIKE], 0)


def triangulated(cameras: Any, views: dict[str, tuple[float, float]]) -> np.ndarray:
    """The point that several cameras see, (3,) [m]."""
    rows: list[np.ndarray] = []
    for number, at_px in views.items():
        camera = cameras[number]
        lens = np.array(camera["matrix"]), np.array(camera["distortions"])
        x, y = cv2.undistortPoints(np.array([[at_px]]), *lens)[0, 0]
        pose = np.column_stack((camera["rotation"], camera["translation"]))
        rows += [x * pose[2] - pose[0], y * pose[2] - pose[1]]
    point = np.linalg.svd(np.array(rows))[2][-1]
    return np.asarray(point[:3] / point[3])
