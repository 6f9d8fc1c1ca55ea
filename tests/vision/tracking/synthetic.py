"""A small renderer for tests: markers on a cluttered floor, with exact ground truth.

It shares nothing with the lab's renderer but the camera model and the marker families, and
draws by brute force: every pixel of a marker is the mean of samples over its area and over
the exposure.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike

from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import MarkerFamily, SquareFamily

BLACK, WHITE = 30.0, 205.0
HEIGHT_M = 0.06


@dataclass(frozen=True, slots=True)
class Robot:
    """One marker: its number, the disc's centre, its heading and how it moves."""

    tag: int
    x_m: float
    y_m: float
    yaw_rad: float
    speed_m_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Look:
    """How hard the picture is."""

    psf_px: float = 0.6
    noise: float = 2.5
    exposure_s: float = 0.010
    light: float = 0.35
    vignetting: float = 0.35
    litter: int = 25
    ground: float = 118.0
    black: float = BLACK
    white: float = WHITE


HARD = Look(psf_px=1.2, noise=5.0, exposure_s=0.03, light=0.6)


def render(
    camera: Camera,
    family: MarkerFamily,
    robots: list[Robot],
    look: Look = Look(),
    seed: int = 0,
    height_m: float = HEIGHT_M,
) -> np.ndarray:
    """Returns the camera's (height, width) uint8 picture of the robots at mid-exposure."""
    rng = np.random.default_rng(seed)
    picture = floor(camera, rng, look)
    for robot in robots:
        _draw(picture, camera, family, robot, look, height_m)
    if look.psf_px > 0.0:
        picture = cv2.GaussianBlur(picture, (0, 0), look.psf_px)
    picture *= _light(camera, rng, look)
    sigma = np.sqrt(look.noise**2 + 0.02 * np.maximum(picture, 0.0) * (look.noise > 0.0))
    picture += sigma * rng.standard_normal(picture.shape, dtype=np.float32)
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


def floor(camera: Camera, rng: np.random.Generator, look: Look) -> np.ndarray:
    """Returns a float32 floor with texture, tile joints and litter."""
    shape = (camera.height_px, camera.width_px)
    picture = np.full(shape, look.ground, dtype=np.float32)
    for octave in (4, 16, 64, 256):
        small = rng.standard_normal((shape[0] // octave + 2, shape[1] // octave + 2))
        size = (shape[1], shape[0])
        picture += 4.0 * cv2.resize(small.astype(np.float32), size, interpolation=cv2.INTER_LINEAR)
    drawn = np.clip(picture, 0, 255).astype(np.uint8)
    for x in range(70, shape[1], 333):
        cv2.line(drawn, (x, 0), (x, shape[0]), 80, 2)
    for _ in range(look.litter):
        _litter(drawn, rng)
    return drawn.astype(np.float32)


def _litter(picture: np.ndarray, rng: np.random.Generator) -> None:
    x, y = (int(rng.integers(n)) for n in picture.shape[::-1])
    shade = float(rng.uniform(10, 240))
    kind = int(rng.integers(6))
    side = int(rng.integers(8, 40))
    turn = float(rng.uniform(0, 360))
    if kind == 0:
        cv2.ellipse(picture, (x, y), (side, side // 2 + 2), turn, 0, 360, shade, -1, cv2.LINE_AA)
    elif kind == 1:
        corners = rng.integers(-side, side, (3, 2)) + np.array([x, y])
        cv2.fillPoly(picture, [corners.astype(np.int32)], shade, cv2.LINE_AA)
    elif kind == 2:
        path = np.cumsum(rng.integers(-40, 41, (12, 2)), axis=0) + np.array([x, y])
        cv2.polylines(picture, [path.astype(np.int32)], False, shade, 3, cv2.LINE_AA)
    elif kind == 3:
        cv2.putText(picture, "Vs4", (x, y), cv2.FONT_HERSHEY_SIMPLEX, side / 12, shade, 4)
    else:
        card = cv2.boxPoints(((x, y), (60.0, 46.0), turn)).astype(np.int32)
        inner = cv2.boxPoints(((x, y), (32.0, 21.0), turn)).astype(np.int32)
        cv2.fillPoly(picture, [card], WHITE, cv2.LINE_AA)
        cv2.fillPoly(picture, [inner], BLACK, cv2.LINE_AA)


def _light(camera: Camera, rng: np.random.Generator, look: Look) -> np.ndarray:
    size = (camera.width_px, camera.height_px)
    patches = rng.uniform(1.0 - look.light, 1.0 + look.light, (3, 4)).astype(np.float32)
    light = cv2.resize(patches, size, interpolation=cv2.INTER_CUBIC)
    rows = np.linspace(-1, 1, size[1], dtype=np.float32)[:, np.newaxis] ** 2
    columns = np.linspace(-1, 1, size[0], dtype=np.float32)[np.newaxis] ** 2
    return light * (1.0 - look.vignetting * (rows + columns) / 2.0)


def _draw(
    picture: np.ndarray,
    camera: Camera,
    family: MarkerFamily,
    robot: Robot,
    look: Look,
    height_m: float,
    fine: int = 5,
) -> None:
    """Draws one marker over the floor."""
    centre = camera.project(np.array([robot.x_m, robot.y_m, height_m]))
    reach = int(0.6e-3 * family.disc_diameter_mm * camera.fx_px / (camera.position_m[2] - height_m))
    column, row = np.rint(centre).astype(int)
    x0, x1 = max(column - reach, 0), min(column + reach + 1, camera.width_px)
    y0, y1 = max(row - reach, 0), min(row + reach + 1, camera.height_px)
    if x0 >= x1 or y0 >= y1:
        return
    ground = _samples(camera, (x0, y0, x1, y1), height_m, fine)
    times = (np.arange(3) - 1) / 3.0 * look.exposure_s if robot.speed_m_s else np.zeros(1)
    region = picture[y0:y1, x0:x1]
    drawn = np.zeros_like(region)
    ahead = np.array([np.cos(robot.yaw_rad), np.sin(robot.yaw_rad)])
    turn = np.array([[ahead[0], -ahead[1]], [ahead[1], ahead[0]]])
    for time in times:
        x, y = (robot.x_m, robot.y_m) + robot.speed_m_s * time * ahead
        along, across = 1e3 * (ground[0] - x), 1e3 * (ground[1] - y)
        on_disc = along**2 + across**2 <= (family.disc_diameter_mm / 2) ** 2
        white = np.zeros_like(on_disc)
        offset = np.stack((along[on_disc], across[on_disc]), axis=-1) @ turn
        white[on_disc] = family.is_white(robot.tag, offset + family.disc_centre_mm)
        discs, whites = (
            mask.view(np.uint8).sum(axis=0, dtype=np.uint8) for mask in (on_disc, white)
        )
        shade = look.white * whites + look.black * (discs - whites)
        drawn += (1.0 - discs / fine**2) * region + shade / fine**2
    picture[y0:y1, x0:x1] = drawn / len(times)


def _samples(
    camera: Camera, window: tuple[int, int, int, int], height_m: float, fine: int
) -> np.ndarray:
    """Returns x and y [m] of the samples in each pixel, (2, fine * fine, height, width).

    Between a pixel's corners they are interpolated: a lens bends nothing inside of a pixel by more
    than a ten-thousandth of it.
    """
    x0, y0, x1, y1 = window
    columns, rows = np.arange(x0, x1 + 1) - 0.5, np.arange(y0, y1 + 1) - 0.5
    corners = camera.to_plane(np.stack(np.meshgrid(columns, rows), axis=-1), height_m)
    share = ((np.arange(fine) + 0.5) / fine)[:, np.newaxis, np.newaxis]
    corners = np.moveaxis(corners, -1, 0)[:, np.newaxis]
    upright = corners[..., :-1] + share * (corners[..., 1:] - corners[..., :-1])
    upright, share = upright[:, np.newaxis], share[:, np.newaxis]
    samples = upright[..., :-1, :] + share * (upright[..., 1:, :] - upright[..., :-1, :])
    return samples.reshape(2, fine**2, y1 - y0, x1 - x0)


def cell_corners(family: MarkerFamily | SquareFamily) -> np.ndarray:
    """Returns the corners (2, 2) of the cells, ahead and to the left of the disc's centre [m]."""
    if isinstance(family, SquareFamily):
        half = 5e-4 * (family.size_mm - 2.0 * family.cell_mm)
        return np.array([(-half, -half), (half, half)])
    cells, half = family.cells_mm - family.disc_centre_mm, 0.5 * family.cell_mm
    return 1e-3 * np.array([cells.min(axis=0) - half, cells.max(axis=0) + half])


INCLINED_PX, INCLINED_M = (1600, 1200), 3.0


def inclined(lean_deg: float, focal_px: float) -> Camera:
    """A camera 3 m from the arena's middle, which it looks at."""
    c, s = math.cos(math.radians(lean_deg)), math.sin(math.radians(lean_deg))
    turn = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]) @ np.diag([1.0, -1.0, -1.0])
    middle = (INCLINED_PX[0] - 1) / 2, (INCLINED_PX[1] - 1) / 2
    place = -INCLINED_M * turn[2]
    lens = (0.0, 0.0, 0.0, 0.0, 0.0)
    return Camera(
        "c", *INCLINED_PX, focal_px, focal_px, *middle, lens, tuple(turn.ravel()), tuple(place)
    )


def lay_over(
    picture: np.ndarray, camera: Camera, robot: Robot, corners: ArrayLike, shade: int
) -> None:
    """Covers a rectangle of a marker, of which `corners` are two: rear right and front left."""
    (rear, right), (front, left) = np.asarray(corners)
    at = np.array([(rear, right), (front, right), (front, left), (rear, left)])
    c, s = np.cos(robot.yaw_rad), np.sin(robot.yaw_rad)
    places = np.array([robot.x_m, robot.y_m]) + at @ np.array([[c, s], [-s, c]])
    pixels = camera.project(np.column_stack((places, np.full(4, HEIGHT_M))))
    cv2.fillConvexPoly(picture, np.rint(16 * pixels).astype(np.int32), shade, cv2.LINE_AA, 4)
