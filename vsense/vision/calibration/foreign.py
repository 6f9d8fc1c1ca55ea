"""Calibrations of other programs: OpenCV's and ROS's YAML, caliscope's TOML, in and out.

All of them have OpenCV's lens model, the pixel's centre at whole numbers and metres, as our camera
files do. Poses are from the arena frame to the camera's: x_camera = rotation x_arena + translation.
What our cameras cannot say is refused: fisheye and rational lenses, skewed pixels.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from vsense.base.arena import Floats
from vsense.base.errors import ConfigError, UsageError
from vsense.base.files import read_text
from vsense.base.terminal import Console, print_data
from vsense.base.toml import TomlFile
from vsense.vision.calibration._bundle import camera_of
from vsense.vision.calibration._references import keep
from vsense.vision.calibration.session import cameras_of
from vsense.vision.cameras.camera import Camera, CameraError

FORMATS = {"opencv": "yml", "ros": "yaml", "caliscope": "toml"}
"""Formats that are written, and the endings of their files."""

_MOST_SIDE_PX = 1 << 16
_AGREE_PX = 0.01
_FAR_M = 2.0
_ORTHOGONAL = 1e-4
_COEFFICIENTS = (0, 4, 5, 8, 12, 14)
"""Numbers of coefficients that OpenCV's model may have; ours has the first five."""
_LENSES = ("", "0", "pinhole", "plumb_bob", "rational_polynomial", "radtan")
_LENS_KEYS = ("distortion_model", "camera_model", "fisheye_model")
"""Where ROS and OpenCV say what lens it is; `fisheye_model` is 0 or 1."""
_FAR_UP_M = 50.0
"""A camera that is so far away was measured in another unit."""
_MOST_ITEMS = 64
"""Of a list with a line for each; what is longer is not of a camera."""
_KEY = re.compile(r"( *)([A-Za-z_][\w-]*) *:(?: +(.*))?")
_TAG = re.compile(r"!!?[\w-]+ *")
_NOT_POSED = np.diag((1.0, -1.0, -1.0)), np.array((0.0, 0.0, 1.0))
"""The pose of a camera of which only the lens is known, as `calibrate intrinsics` writes it."""

Fail = Callable[[str, str], ConfigError]
"""Makes the error about a value with this name, from its text."""


@dataclass(frozen=True, slots=True)
class Foreign:
    """One camera as another program's file has it; `pose` is rotation and translation, or None."""

    id: str
    size: tuple[int, int]
    matrix: Floats
    distortion: Floats
    pose: tuple[Floats, Floats] | None

    def project(self, points_m: Floats) -> Floats:
        """Where OpenCV shows (n, 3) arena points, (n, 2) px."""
        rotation, translation = self.pose or _NOT_POSED
        vector = cv2.Rodrigues(rotation)[0]
        pixels = cv2.projectPoints(points_m, vector, translation, self.matrix, self.distortion)[0]
        return np.asarray(pixels[:, 0], dtype=np.float64)

    def beside_px(self, camera: Camera) -> float:
        """The largest distance to where a camera of ours shows the same points, all over it."""
        across, down = (np.linspace(0, side - 1, 13) for side in self.size)
        pixels = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
        flat = (pixels - self.matrix[:2, 2]) / (self.matrix[0, 0], self.matrix[1, 1])
        rays = np.column_stack((flat, np.ones(len(flat)))) * _FAR_M
        rotation, translation = self.pose or _NOT_POSED
        points = (rays - translation) @ rotation
        off = self.project(points) - camera.project(points)
        return float(np.hypot(*off.T).max())


def bring_in(paths: Sequence[Path], name: str | None, folder: Path) -> int:
    """Writes camera files of ours from others' files, and says how well they agree; returns 0.

    `name` is that of the only camera; None: the file's own.

    Raises:
        ConfigError: a file is wrong, or says what a camera of ours cannot.
        UsageError: it cannot be read, or two cameras have one name.
    """
    found = [(path, foreign) for path in paths for foreign in read_foreign(path, name)]
    names = [foreign.id for _, foreign in found]
    for path, foreign in found:
        if names.count(foreign.id) > 1:
            raise UsageError(f"{path}: camera {foreign.id} is there twice; give each its --name")
    cameras = [(path, foreign, _ours(path, foreign)) for path, foreign in found]
    written = []
    for path, foreign, camera in cameras:
        written.append(_write(folder / f"{camera.id}.json", camera.to_json() + "\n"))
        _say(f"camera {camera.id}: {foreign.beside_px(camera):.4f} px at most beside {path.name}")
        if foreign.pose is None:
            _say(f"camera {camera.id}: a lens only; vsense camera calibrate rig finds its place")
        elif camera.position_m[2] <= 0.0:
            _say(f"camera {camera.id}: is below the floor: z has to point up, and 0 be the floor")
        elif (far_m := math.hypot(*camera.position_m)) > _FAR_UP_M:
            _say(f"camera {camera.id}: is {far_m:.0f} m away: its translation has to be in m")
    # They have no pictures with them, and older ones are of other calibrations.
    keep(folder, names, {})
    print_data("\n".join(map(str, written)))
    return 0


def send_out(cameras: Path, format: str, folder: Path) -> int:
    """Writes camera files of ours in a format of `FORMATS`, reads them again; returns 0.

    Raises UsageError where a file cannot be read or written.
    """
    known = cameras_of("--cameras", cameras)
    written = []
    if format == "caliscope":
        written.append(_write(folder / "camera_array.toml", _caliscope(known)))
    else:
        for name, camera in known.items():
            text = _as_yaml(camera, format == "opencv")
            written.append(_write(folder / f"{name}.{FORMATS[format]}", text))
    again = [foreign for path in written for foreign in read_foreign(path, None)]
    for camera, foreign in zip(known.values(), again):
        if format == "ros":
            foreign = replace(foreign, pose=_pose(camera))
        name = camera.id if foreign.id == camera.id else f"{camera.id} as {foreign.id}"
        _say(f"camera {name}: {foreign.beside_px(camera):.4f} px at most beside its own file")
        if camera.row_time_s:
            _say(f"camera {camera.id}: row_time_s stays behind: {format} has none")
    if format == "ros":
        _say("camera_info has no poses: they go out as tf, with vsense export --rosbag")
    print_data("\n".join(map(str, written)))
    return 0


def read_foreign(path: Path, name: str | None = None) -> list[Foreign]:
    """Reads all cameras of another program's file.

    Raises:
        ConfigError: it is none, or says what a camera of ours cannot.
        UsageError: it cannot be read.
    """
    try:
        text = read_text(path)
    except (OSError, ValueError) as error:
        raise UsageError(f"{path}: cannot be read: {error}") from None
    cameras = _of_toml(path, text) if path.suffix == ".toml" else [_of_yaml(path, text)]
    if name is not None and len(cameras) > 1:
        raise UsageError(f"--name: {path} has {len(cameras)} cameras, expected one")
    ids = [name or camera.id for camera in cameras]
    for id in ids:
        if not re.fullmatch(r"[A-Za-z0-9_][\w.-]{0,63}", id):
            raise UsageError(f"{path}: camera {id!r}: give it a plain --name, such as cam_0")
    return [Foreign(i, c.size, c.matrix, c.distortion, c.pose) for i, c in zip(ids, cameras)]


def _of_toml(path: Path, text: str) -> list[Foreign]:
    file = TomlFile(path, text)
    tables = file.read({"cameras": _table}).get("cameras", {})
    cameras = []
    for number, table in tables.items():

        def fail(words: str, name: str, number: str = number) -> ConfigError:
            return file.error(f"camera {number}: {name}: {words}", "cameras", number, name)

        if not isinstance(table, dict):
            raise fail("expected a table", number)
        if table.get("fisheye"):
            raise fail("a fisheye lens, expected OpenCV's usual model", "fisheye")
        # rtoml writes None so.
        values = {key: value for key, value in table.items() if value != "null"}
        cameras.append(_camera(f"cam_{number}", values, fail))
    if not cameras:
        raise ConfigError(str(path), 1, "expected caliscope's tables [cameras.0], [cameras.1], ...")
    return cameras


def _table(value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise ValueError("tables of cameras")
    return value


def _of_yaml(path: Path, text: str) -> Foreign:
    lines: dict[str, int] = {}
    found = _yaml(path, text, lines)

    def fail(words: str, name: str) -> ConfigError:
        inside = next((line for key, line in lines.items() if key.startswith(f"{name}.")), 1)
        return ConfigError(str(path), lines.get(name, inside), f"{name}: {words}")

    for key in _LENS_KEYS:
        if (lens := found.get(key, "").strip("\"'")) not in _LENSES:
            raise fail(f"{lens!r}, expected plumb_bob: OpenCV's usual model", key)
    if "fisheye" in found.get("model", ""):
        raise fail("a fisheye lens, expected plumb_bob: OpenCV's usual model", "model")
    names = {
        "matrix": "camera_matrix.data",
        "distortions": "distortion_coefficients.data",
        "rotation": "rotation.data",
        "translation": "translation.data",
    }
    values: dict[str, Any] = {
        "size": [found[key] for key in ("image_width", "image_height") if key in found] or None,
        **{name: found[key].strip("[] ").split(",") for name, key in names.items() if key in found},
    }
    said = {"size": "image_width", **{name: key.split(".")[0] for name, key in names.items()}}
    camera = found.get("camera_name", "").strip("\"'") or path.stem
    return _camera(camera, values, lambda words, name: fail(words, said[name]))


def _yaml(path: Path, text: str, lines: dict[str, int]) -> dict[str, str]:
    """Values of a mapping of values and mappings, by keys such as "a" and "a.b".

    This is what OpenCV and ROS write; a list is one text with commas. `lines` gets where they are.
    """
    found: dict[str, str] = {}
    outer, key, parts, items = "", "", list[str](), 0
    for number, line in enumerate(text.splitlines(), 1):
        line = line.split(" #")[0].rstrip() if not line.startswith("#") else ""
        if parts:
            parts.append(line)
        elif line.lstrip().startswith("- ") and key:
            items += 1 + line.count(",")
            if items <= _MOST_ITEMS:
                found[key] = f"{found[key]},{line.lstrip()[2:]}".strip(",")
            continue
        elif not line or line.startswith(("%", "---", "...")):
            continue
        elif match := _KEY.fullmatch(line):
            value = _TAG.sub("", match[3] or "", count=1)
            name = match[2].lower()
            outer = outer if match[1] else name
            key = f"{outer}.{name}" if match[1] else outer
            lines.setdefault(key, number)
            parts, items = [value], 0
        else:
            words = f"{line[:40]!r}: expected 'name: value', as in OpenCV's .yml or ROS's ost.yaml"
            raise ConfigError(str(path), number, words)
        if not parts[0].startswith("[") or "]" in line:
            found[key], parts = "".join(parts), []
    if parts:
        raise ConfigError(str(path), lines[key], f"{key}: expected ']' at its end")
    return found


def _camera(id: str, values: Mapping[str, Any], fail: Fail) -> Foreign:
    """A camera of lists of numbers; `fail` makes the error about one of them."""
    size = _numbers(values, "size", (2,), fail)
    if not all(1 <= side <= _MOST_SIDE_PX and side == int(side) for side in size):
        raise fail("expected the picture's width and height in px", "size")
    matrix = np.reshape(_numbers(values, "matrix", (9,), fail), (3, 3))
    (fx, skew, _), (zero, fy, _), last = matrix.tolist()
    if skew or zero or last != [0.0, 0.0, 1.0] or not min(fx, fy) > 0.0:
        raise fail("expected fx, 0, cx, 0, fy, cy, 0, 0, 1 with fx and fy above 0", "matrix")
    distortion = _numbers(values, "distortions", _COEFFICIENTS, fail)
    if any(distortion[5:]):
        raise fail(f"{len(distortion)} coefficients, expected k1 k2 p1 p2 k3", "distortions")
    pose = None
    if "rotation" in values or "translation" in values:
        rotation = _numbers(values, "rotation", (3, 9), fail)
        full = cv2.Rodrigues(rotation)[0] if len(rotation) == 3 else rotation.reshape(3, 3)
        orthogonal = np.allclose(full @ full.T, np.eye(3), atol=_ORTHOGONAL)
        if not orthogonal or np.linalg.det(full) < 0:
            raise fail("expected a rotation from arena to camera", "rotation")
        pose = full.astype(np.float64), _numbers(values, "translation", (3,), fail)
    whole = np.concatenate((distortion[:5], np.zeros(max(0, 5 - len(distortion)))))
    return Foreign(id, (int(size[0]), int(size[1])), matrix, whole, pose)


def _numbers(values: Mapping[str, Any], name: str, counts: Sequence[int], fail: Fail) -> Floats:
    """A list of numbers, also one of lists, as one row."""
    given, most = values.get(name), max(counts)
    if given is None:
        raise fail("is missing", name)
    flat = given if isinstance(given, list) else [given]
    if len(flat) <= most and any(isinstance(part, list) for part in flat):
        flat = [v for part in flat for v in (part if isinstance(part, list) else [part])]
    try:
        if len(flat) > most:
            raise ValueError
        numbers = [float(v) for v in flat if not (isinstance(v, str) and not v.strip())]
    except (TypeError, ValueError):
        raise fail(f"expected {most} numbers", name) from None
    if len(numbers) not in counts or not all(map(math.isfinite, numbers)):
        words = " or ".join(map(str, counts))
        raise fail(f"{len(numbers)} numbers, expected {words} that are finite", name)
    return np.array(numbers)


def _ours(path: Path, foreign: Foreign) -> Camera:
    matrix = foreign.matrix
    lens = np.array([*matrix[[0, 1, 0, 1], [0, 1, 2, 2]], *foreign.distortion])
    rotation, translation = foreign.pose or _NOT_POSED
    try:
        camera = camera_of(foreign.id, foreign.size, lens, rotation, translation)
    except CameraError as error:
        raise ConfigError(str(path), 1, str(error)) from None
    off_px = foreign.beside_px(camera)
    if not off_px <= _AGREE_PX:
        raise ConfigError(str(path), 1, f"camera {foreign.id} would be {off_px:.3f} px beside it")
    return camera


def _pose(camera: Camera) -> tuple[Floats, Floats]:
    rotation = np.reshape(camera.rotation, (3, 3))
    return rotation, -rotation @ np.array(camera.position_m)


def _matrix(camera: Camera) -> list[float]:
    return [camera.fx_px, 0.0, camera.cx_px, 0.0, camera.fy_px, camera.cy_px, 0.0, 0.0, 1.0]


def _as_yaml(camera: Camera, opencv: bool) -> str:
    """OpenCV's YAML has tags and poses; ROS's has the pictures' rectification: none."""
    matrix, (rotation, translation) = _matrix(camera), _pose(camera)
    parts = {"camera_matrix": (3, matrix), "distortion_coefficients": (1, list(camera.distortion))}
    if opencv:
        head, tag, kind = "%YAML:1.0\n---\n", " !!opencv-matrix", "   dt: d\n"
        parts["rotation"] = 3, rotation.ravel().tolist()
        parts["translation"] = 3, translation.tolist()
    else:
        head = tag = kind = ""
        parts["rectification_matrix"] = 3, np.eye(3).ravel().tolist()
        parts["projection_matrix"] = 3, [*matrix[:3], 0.0, *matrix[3:6], 0.0, *matrix[6:], 0.0]
    matrices = [
        f"{name}:{tag}\n   rows: {rows}\n   cols: {len(data) // rows}\n{kind}"
        f"   data: {json.dumps(data)}\n"
        for name, (rows, data) in parts.items()
    ]
    size = f"image_width: {camera.width_px}\nimage_height: {camera.height_px}\n"
    name = f'camera_name: "{camera.id}"\ndistortion_model: plumb_bob\n'
    return head + size + name + "".join(matrices)


def _caliscope(cameras: Mapping[str, Camera]) -> str:
    """caliscope numbers its cameras: by the numbers at our names' ends where these differ."""
    ends = [re.search(r"\d+$", name) for name in cameras]
    numbers = [int(end[0]) for end in ends if end is not None and len(end[0]) < 9]
    if len(set(numbers)) < len(cameras):
        numbers = list(range(len(cameras)))
    tables = []
    for number, camera in zip(numbers, cameras.values()):
        rotation, translation = _pose(camera)
        rows = {
            "cam_id": number,
            "size": [camera.width_px, camera.height_px],
            "rotation_count": 0,
            "fisheye": False,
            "ignore": False,
            "matrix": np.reshape(_matrix(camera), (3, 3)).tolist(),
            "distortions": list(camera.distortion),
            "rotation": cv2.Rodrigues(rotation)[0][:, 0].tolist(),
            "translation": translation.tolist(),
        }
        lines = "".join(f"{name} = {json.dumps(value)}\n" for name, value in rows.items())
        tables.append(f"[cameras.{number}]\n{lines}")
    return "\n".join(tables)


def _write(path: Path, text: str) -> Path:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if os.path.exists(path):
            _say(f"{path}: is there, and is written over")
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror}") from None
    return path


def _say(text: str) -> None:
    Console().say(text)
