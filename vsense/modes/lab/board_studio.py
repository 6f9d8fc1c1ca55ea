"""Pictures of a calibration board as the lab's cameras see it, for `vsense camera calibrate`."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np

from vsense.base.arena import Floats, Image
from vsense.base.errors import UsageError, failing_as
from vsense.config.specs import Experiment
from vsense.modes.lab._backdrop import FULL_DN
from vsense.modes.lab._camera_spec import cameras_above, rig
from vsense.modes.lab._optics import RayMap, Sensor, Window, blur, to_levels, vignetting
from vsense.modes.lab._scene import Scene
from vsense.vision.calibration.board import Board, raster
from vsense.vision.calibration.frame import BoardPose, turn
from vsense.vision.cameras.camera import Camera, Image32
from vsense.world.entities import Arena

BOARD_PX_PER_M = 2500.0
PAPER_LEVEL, INK_LEVEL = 225.0, 18.0
"""Reflectances, 255 is perfectly white."""

_MARGIN_M = 0.02
_FINER = 4
"""Each pixel is the mean of 4 x 4 rays."""
_MARGIN_PX = 4
_LEAST_SHARE = 0.5
"""Of the board's corners that a picture has to show."""
_LITTER = 20
_SPOTS = 0.72 * np.array(((-1, -1), (1, 1), (-1, 1), (1, -1), (0, 0), (1, 0), (0, 1), (-1, 0)))
"""Places of a held board in the picture: first the corners, where a lens distorts most."""
_EVERYTHING = (slice(None), slice(None))


class BoardStudio:
    """Cameras above a floor, and a board."""

    def __init__(self, cameras: Sequence[Camera], board: Board, seed: int) -> None:
        """Builds the floor, about a second; the pictures of all cameras have one size."""
        self._cameras = list(cameras)
        self._board = board
        texture = raster(board, BOARD_PX_PER_M, _MARGIN_M).astype(np.float32) / 255.0
        self._paper = np.asarray(INK_LEVEL + (PAPER_LEVEL - INK_LEVEL) * texture, dtype=np.float32)
        self._rays = [RayMap(camera) for camera in cameras]
        scene = Scene(self._rays, seed, _LITTER)
        self._floors = [scene.floor(rays) for rays in self._rays]
        self._lights = [
            scene.light(rays) * vignetting(rays.camera) * np.float32(FULL_DN / 255.0)
            for rays in self._rays
        ]
        self._empty = [
            to_levels(blur(floor * light)) for floor, light in zip(self._floors, self._lights)
        ]
        self._sensor = Sensor(cameras[0].height_px, cameras[0].width_px, seed)
        self._shots = 0

    def take(self, pose: BoardPose) -> Iterator[tuple[str, Image]]:
        """Pictures (h, w), with the camera's id, of every camera that sees at least half of the
        board.

        `pose` is from board to arena frame; all of the board is below the cameras.
        """
        for number, camera in enumerate(self._cameras):
            window = self._window(camera, pose)
            if window is not None:
                self._shots += 1
                yield camera.id, self._picture(number, window, pose)

    def _window(self, camera: Camera, pose: BoardPose) -> Window | None:
        """The window that the board covers; None where too much of it is out of sight."""
        pixels = camera.project(pose.apply(self._board.points_m))
        if camera.contains(pixels, _MARGIN_PX).mean() < _LEAST_SHARE:
            return None
        across, up = self._board.size_m
        edge = np.array([(x, y, 0.0) for x in (0.0, 0.5, 1.0) for y in (0.0, 0.5, 1.0)])
        corners = edge * (across + 2.0 * _MARGIN_M, up + 2.0 * _MARGIN_M, 1.0)
        pixels = camera.project(pose.apply(corners - (_MARGIN_M, _MARGIN_M, 0.0)))
        left, top = np.floor(pixels.min(axis=0)).astype(int) - _MARGIN_PX
        right, bottom = np.ceil(pixels.max(axis=0)).astype(int) + _MARGIN_PX
        return (
            slice(max(top, 0), min(bottom, camera.height_px)),
            slice(max(left, 0), min(right, camera.width_px)),
        )

    def _picture(self, number: int, window: Window, pose: BoardPose) -> Image:
        surface = self._floors[number][window].astype(np.float32)
        paper, cover = self._sheet(number, window, pose)
        surface += paper - cover * surface
        levels = self._empty[number].copy()
        # The blur's reach stays inside the window's margin, where there is only floor.
        levels[window] = to_levels(blur(surface * self._lights[number][window]))
        image = np.empty(levels.shape, dtype=np.uint8)
        noise = self._sensor.noise(number, self._shots)
        self._sensor.read(levels, noise, _EVERYTHING, image)
        return image

    def _sheet(self, number: int, window: Window, pose: BoardPose) -> tuple[Image32, Image32]:
        """The board in a window: reflectance times cover, and cover."""
        rays = self._rays[number]
        rows, columns = window
        shape = (rows.stop - rows.start, columns.stop - columns.start)
        fine = (shape[1] * _FINER, shape[0] * _FINER)
        floor = [
            np.asarray(cv2.resize(along[window], fine), dtype=np.float32)
            for along in (rays.x_m, rays.y_m)
        ]
        x, y = self._on_board(rays.camera, floor[0], floor[1], pose)
        height = self._paper.shape[0]
        u = (x + _MARGIN_M) * BOARD_PX_PER_M - 0.5
        v = height - 0.5 - (y + _MARGIN_M) * BOARD_PX_PER_M
        layers = [
            cv2.remap(layer, u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR)
            for layer in (self._paper, np.ones_like(self._paper))
        ]
        paper, cover = (
            cv2.resize(layer, shape[::-1], interpolation=cv2.INTER_AREA) for layer in layers
        )
        return paper, cover  # type: ignore[return-value]

    def _on_board(
        self, camera: Camera, x_m: Image32, y_m: Image32, pose: BoardPose
    ) -> tuple[Image32, Image32]:
        """Where rays to points of the floor cross the board, in its frame [m]."""
        back = pose.inverse()
        start = back.apply(np.array(camera.position_m)[np.newaxis])[0]
        factors = np.column_stack((back.turn[:, :2], back.shift - start)).astype(np.float32)
        along = [by_x * x_m + by_y * y_m + offset for by_x, by_y, offset in factors]
        reach = np.float32(-start[2]) / along[2]
        x, y = (np.float32(start[k]) + reach * along[k] for k in range(2))
        return x, y


def board_plan(
    cameras: Sequence[Camera], board: Board, floor: int, held: int, seed: int
) -> list[tuple[str, BoardPose]]:
    """Moments `floor_00`, ... and `held_00`, ... with the board's poses below the cameras.

    It lies `floor` times on the floor, first unturned in the middle, and is `held` times held up
    and tilted.
    """
    rng = np.random.default_rng([seed, 7])
    spots = np.array([camera.position_m[:2] for camera in cameras])
    reach = np.array([_reach_m(camera) for camera in cameras]).mean(axis=0)
    low, high = spots.min(axis=0) - 0.8 * reach, spots.max(axis=0) + 0.8 * reach
    plan = [("floor_00", _lying(board, spots.mean(axis=0), 0.0))]
    for number, share in enumerate(_spread(rng, floor - 1), start=1):
        yaw = rng.uniform(-np.pi, np.pi)
        plan.append((f"floor_{number:02d}", _lying(board, low + share * (high - low), yaw)))
    for number in range(held):
        camera = cameras[number % len(cameras)]
        spot = _SPOTS[number // len(cameras) % len(_SPOTS)] + rng.uniform(-0.1, 0.1, 2)
        plan.append((f"held_{number:02d}", _before(camera, board, spot, rng)))
    return plan


def _before(camera: Camera, board: Board, spot: Floats, rng: np.random.Generator) -> BoardPose:
    """A board held up, tilted, at a spot of the picture: (0, 0) its middle, (1, 1) a corner."""
    height = rng.uniform(0.15, 0.4) * camera.position_m[2]
    reach = (1.0 - height / camera.position_m[2]) * _reach_m(camera)
    lean = rng.uniform(-np.pi, np.pi)
    tilt = np.radians(rng.uniform(15.0, 40.0)) * np.array((np.cos(lean), np.sin(lean), 0.0))
    middle = np.array((*(np.array(camera.position_m[:2]) + spot * reach), height))
    return board_at(board, middle, tilt, rng.uniform(-np.pi, np.pi))


def _reach_m(camera: Camera) -> Floats:
    edge = np.array(((camera.width_px - 1.0, camera.cy_px), (camera.cx_px, 0.0)))
    reach = camera.to_plane(edge, 0.0) - np.array(camera.position_m[:2])
    return np.array((reach[0, 0], reach[1, 1]))


def _spread(rng: np.random.Generator, count: int) -> Floats:
    """(count, 2) places in the unit square that keep apart.

    Source: Roberts, The unreasonable effectiveness of quasirandom sequences, 2018.
    """
    golden = 1.3247179572447460
    steps = np.arange(1, count + 1)[:, None] * np.array((1.0 / golden, 1.0 / golden**2))
    return np.asarray((rng.uniform(size=2) + steps) % 1.0)


def _lying(board: Board, middle: Floats, yaw: float) -> BoardPose:
    return board_at(board, np.array((*middle, 0.0)), np.zeros(3), yaw)


def board_at(board: Board, middle: Floats, tilt: Floats, yaw: float) -> BoardPose:
    """A board around its middle, turned about the vertical and then tilted."""
    about = turn(np.array((tilt, (0.0, 0.0, yaw))))
    rotation = about[0] @ about[1]
    half = np.array((*board.size_m, 0.0)) / 2.0
    return BoardPose(rotation, middle - rotation @ half)


STUDIO_ARENA = Arena((3.0, 2.4, 1.0), (0.0, 0.0, 0.5))
ON_FLOOR, HELD_UP = 16, 24
"""Numbers of pictures on the floor and held up."""

_QUALITY = 95


def write(directory: Path, board_text: str, seed: int, experiment: Experiment | None) -> int:
    """Writes pictures/CAMERA/MOMENT.jpg and truth/CAMERA.json; prints the next command.

    The cameras hang above the experiment's arena, or above one of 3 m x 2.4 m.

    Raises:
        UsageError: the board is none, or the folder cannot be written.
    """
    board = Board.parse(board_text)
    cameras = rig(STUDIO_ARENA) if experiment is None else cameras_above(experiment, None)
    plan = board_plan(cameras, board, ON_FLOOR, HELD_UP, seed)
    with failing_as(UsageError, f"{directory}: cannot be written"):
        (directory / "truth").mkdir(parents=True, exist_ok=True)
        for camera in cameras:
            (directory / "pictures" / camera.id).mkdir(parents=True, exist_ok=True)
            (directory / "truth" / f"{camera.id}.json").write_text(camera.to_json() + "\n")
        studio, count = BoardStudio(cameras, board, seed), 0
        for moment, pose in plan:
            for camera_id, image in studio.take(pose):
                data = cv2.imencode(".jpg", image, (cv2.IMWRITE_JPEG_QUALITY, _QUALITY))[1]
                path = directory / "pictures" / camera_id / f"{moment}.jpg"
                path.write_bytes(data.tobytes())
                count += 1
    print(directory / "pictures")
    x, y, _ = plan[0][1].shift
    print(
        f"{count} pictures of {len(cameras)} cameras; now: vsense camera calibrate rig --board"
        f" {board} --pictures {directory / 'pictures'} --floor 'floor_*' --origin={x:.3f},{y:.3f},0"
        " -o cameras",
        file=sys.stderr,
    )
    return 0
