"""Drawn markers in real photographs, as sharp and as noisy as the photograph is itself.

What a photograph does to a black edge on white is read off the AprilTags in it, with OpenCV's
detector, so that nothing of ours measures itself; its noise off its smoothest parts.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from tests.vision.tracking.synthetic import Robot
from vsense.vision.cameras.camera import Camera
from vsense.vision.markers.families import Family

_FINE = 5
_BLOCK = 16
_LIGHT_PX = 15.0
_BRIGHTEST = 245.0


@dataclass(frozen=True, slots=True)
class Character:
    """How a photograph shows things: point spread, noise, black and white."""

    psf_px: float
    noise: float
    black: float
    white: float


def character(photo: np.ndarray) -> Character | None:
    """Reads a photograph's character off its tags; None where it shows none large enough."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    corners, ids, _ = cv2.aruco.ArucoDetector(dictionary).detectMarkers(photo)
    spreads, blacks, whites = [], [], []
    for quad in corners if ids is not None else ():
        for start, end in zip(quad[0], np.roll(quad[0], -1, axis=0), strict=True):
            spread, black, white = _edge(photo, start, end)
            spreads.append(spread)
            blacks.append(black)
            whites.append(white)
    if not spreads:
        return None
    psf = float(np.median(spreads))
    return Character(psf, noise_of(photo), float(np.median(blacks)), float(np.median(whites)))


def _edge(photo: np.ndarray, start: np.ndarray, end: np.ndarray) -> tuple[float, float, float]:
    """Returns the spread [px], the black and the white of one side's median edge."""
    ahead = (end - start) / np.linalg.norm(end - start)
    normal = np.array([ahead[1], -ahead[0]])
    along = start + np.linspace(0.2, 0.8, 15)[:, np.newaxis] * (end - start)
    reach = np.linspace(-3.0, 3.0, 25)
    points = (along[:, np.newaxis] + reach[:, np.newaxis] * normal).astype(np.float32)
    grey = cv2.remap(photo, points[..., 0], points[..., 1], cv2.INTER_LINEAR).astype(float)
    rise = np.maximum(np.diff(grey, axis=1), 0.0)
    where = 0.5 * (reach[1:] + reach[:-1])
    total = np.maximum(rise.sum(axis=1), 1e-6)
    mean = (rise @ where) / total
    variance = (rise * (where - mean[:, np.newaxis]) ** 2).sum(axis=1) / total
    level = np.median(grey, axis=0)
    return float(np.sqrt(np.median(variance))), float(level.min()), float(level.max())


def noise_of(photo: np.ndarray) -> float:
    """Returns the standard deviation of the noise in a photograph's smoothest blocks."""
    high, wide = (side // _BLOCK * _BLOCK for side in photo.shape)
    fine = photo[:high, :wide].astype(float) - cv2.GaussianBlur(photo[:high, :wide], (0, 0), 3.0)
    blocks = fine.reshape(high // _BLOCK, _BLOCK, wide // _BLOCK, _BLOCK)
    return float(np.percentile(blocks.std(axis=(1, 3)), 25.0))


def compose(
    photo: np.ndarray,
    camera: Camera,
    family: Family,
    robots: list[Robot],
    look: Character,
    height_m: float,
    seed: int,
) -> np.ndarray:
    """Returns the photograph with markers lying in it, in the light of their surroundings.

    Where the surroundings are brighter than the tags' paper, so is the markers'.
    """
    high, wide = photo.shape
    picture = photo.astype(np.float32)
    around = 1.1 * cv2.GaussianBlur(picture, (0, 0), _LIGHT_PX) / look.white
    gain = np.clip(around, 1.0, max(_BRIGHTEST / look.white, 1.0))
    cover = np.zeros((high, wide), np.float32)
    light = np.zeros((high, wide), np.float32)
    for robot in robots:
        _lay(cover, light, camera, family, robot, look, height_m)
    light *= gain
    cover, light = (cv2.GaussianBlur(layer, (0, 0), look.psf_px) for layer in (cover, light))
    grain = np.random.default_rng(seed).standard_normal((high, wide)) * look.noise
    picture = picture * (1.0 - cover) + light + grain * cover
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


def _lay(
    cover: np.ndarray,
    light: np.ndarray,
    camera: Camera,
    family: Family,
    robot: Robot,
    look: Character,
    height_m: float,
) -> None:
    centre = camera.project(np.array([robot.x_m, robot.y_m, height_m]))
    reach = int(0.6e-3 * family.disc_diameter_mm * camera.fx_px / (camera.position_m[2] - height_m))
    column, row = np.rint(centre).astype(int)
    part = (np.arange(_FINE) + 0.5) / _FINE - 0.5
    steps = (np.arange(-reach, reach + 1)[:, np.newaxis] + part).ravel()
    ground = camera.to_plane(np.stack(np.meshgrid(column + steps, row + steps), -1), height_m)
    c, s = np.cos(robot.yaw_rad), np.sin(robot.yaw_rad)
    offset = 1e3 * (ground - (robot.x_m, robot.y_m)) @ np.array([[c, -s], [s, c]])
    on_disc = np.hypot(offset[..., 0], offset[..., 1]) <= family.disc_diameter_mm / 2
    white = family.is_white(robot.tag, offset + family.disc_centre_mm)
    shade = np.where(white, look.white, look.black) * on_disc
    side = 2 * reach + 1
    place = np.s_[row - reach : row + reach + 1, column - reach : column + reach + 1]
    cover[place] = on_disc.reshape(side, _FINE, side, _FINE).mean(axis=(1, 3))
    light[place] = shade.reshape(side, _FINE, side, _FINE).mean(axis=(1, 3))
