"""What lens, exposure and sensor do to the light: rays, vignetting, blur, grey levels and noise.

Magnitudes: tracking.md section 1 of the project's references.

The noise of a pixel has sigma = sqrt(READ_NOISE^2 + SHOT_NOISE * DN). Fresh noise for every pixel
costs 5 ms per picture and more, so one bank of noise is added at a random offset. Pictures are
held as *levels*, a square root of the light in which the noise is equally strong everywhere: then
one saturating addition and one table make a noisy picture, in 0.7 ms for 2 Mpx. With only 256
levels sigma is right on average, and off by up to 14 % at single grey values.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from vsense.base.arena import Image
from vsense.base.native import kernel_ffi
from vsense.vision.cameras.camera import Camera, Image32, everywhere

Window = tuple[slice, slice]
PixelRow = tuple[float, float, float]

PSF_SIGMA_PX = 0.6
"""Optical point spread."""
BLUR_SIGMA_PX = float(np.hypot(PSF_SIGMA_PX, 12.0**-0.5))
"""Point spread together with the square pixel's own width, whose variance is 1/12 px^2."""
VIGNETTING = 0.35
"""Share of the light that is lost in the picture's corners."""
EXPOSURE_NS = 10_000_000
SAMPLES = 3
"""Moments of the exposure that a picture is averaged over; robots move up to 0.8 px in it."""


class RayMap:
    """The rays of a camera's pixels, by the exact inverse of the lens model.

    Attributes:
        x_m, y_m: (h, w) float32, where the ray meets the floor, arena frame.
    """

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        self.x_m, self.y_m = everywhere(
            lambda pixels: camera.to_plane(pixels, 0.0), (camera.height_px, camera.width_px)
        )

    def affine(
        self, window: Window, height_m: float, rows: tuple[PixelRow, PixelRow]
    ) -> tuple[Image32, Image32]:
        """Maps the pixels of a window by an affine function of a horizontal plane at a height.

        `rows` are, for each coordinate of the result, the factors [1/m] of arena x and y where the
        ray crosses the plane, and the offset. The coordinates have the window's shape.
        """
        centre_x, centre_y, centre_z = self.camera.position_m
        reach = 1.0 - height_m / centre_z
        x, y = self.x_m[window], self.y_m[window]
        mapped = []
        for by_x, by_y, offset in rows:
            shift = offset + (1.0 - reach) * (by_x * centre_x + by_y * centre_y)
            mapped.append(cv2.addWeighted(x, by_x * reach, y, by_y * reach, shift))
        return mapped[0], mapped[1]  # type: ignore[return-value]

    def bounds(self) -> tuple[float, float, float, float]:
        """Least and greatest x, then y [m] that the camera sees of the floor."""
        x, y = self.x_m, self.y_m
        return float(x.min()), float(x.max()), float(y.min()), float(y.max())


def vignetting(camera: Camera) -> Image32:
    """(h, w) float32, the share of the light that reaches each pixel, 1 in the middle."""
    x = (np.arange(camera.width_px) - camera.cx_px) / camera.fx_px
    y = (np.arange(camera.height_px) - camera.cy_px) / camera.fy_px
    squared = (x * x)[np.newaxis, :] + (y * y)[:, np.newaxis]
    return np.asarray(1.0 - VIGNETTING * squared / squared.max(), dtype=np.float32)


def blur(image: Image32) -> Image32:
    """Applies the lens's point spread and the pixels' width."""
    return np.asarray(cv2.GaussianBlur(image, (0, 0), BLUR_SIGMA_PX), dtype=np.float32)


def sample_times_ns(capture_ns: int, samples: int) -> list[int]:
    """The moments whose pictures, averaged, stand for one exposure."""
    step = EXPOSURE_NS / samples
    return [capture_ns + round((k - (samples - 1) / 2) * step) for k in range(samples)]


READ_NOISE = 2.0
"""Sigma of the noise in the dark [DN]."""
SHOT_NOISE = 0.02
"""Growth of the noise's variance with the signal [DN^2 per DN]."""
WHITE_DN = 255.0

_MIDDLE = 16
"""The bank holds noise + 16: noise beyond 7 sigma is cut."""
_SPARE = 256
"""How much larger than the picture the bank is, both ways."""
_SCALE = (255 - 2 * _MIDDLE) / (np.sqrt(READ_NOISE**2 + SHOT_NOISE * WHITE_DN) - READ_NOISE)
_LEVEL_SIGMA = 0.5 * SHOT_NOISE * _SCALE


def to_levels(light_dn: Image32) -> Image:
    """Converts light [DN], not negative, to levels."""
    root = cv2.sqrt(light_dn * SHOT_NOISE + READ_NOISE**2)
    levels = cv2.convertScaleAbs(root, alpha=_SCALE, beta=-READ_NOISE * _SCALE)
    return np.asarray(np.minimum(levels, 255 - 2 * _MIDDLE), dtype=np.uint8)


def _table() -> Image:
    """Readings [DN] of the sums of a level and a value of the bank."""
    level = np.maximum(np.arange(256) - _MIDDLE, 0)
    light = ((level / _SCALE + READ_NOISE) ** 2 - READ_NOISE**2) / SHOT_NOISE
    return np.asarray(np.rint(np.clip(light, 0, WHITE_DN)), dtype=np.uint8)


class Sensor:
    """Noise for pictures of one size."""

    def __init__(self, height_px: int, width_px: int, seed: int) -> None:
        self._shape = (height_px, width_px)
        self._seed = seed
        rng = np.random.default_rng([seed, 0])
        shape = (height_px + _SPARE, width_px + _SPARE)
        sigma = np.sqrt(_LEVEL_SIGMA**2 - 1.0 / 12.0)
        noise = rng.standard_normal(shape, dtype=np.float32) * np.float32(sigma)
        self._bank = np.clip(np.rint(noise) + _MIDDLE, 0, 2 * _MIDDLE).astype(np.uint8)
        self._table = _table()

    def noise(self, camera: int, timestep: int) -> Image:
        """The (h, w) part of the bank for one picture."""
        rng = np.random.default_rng([self._seed, 1, camera, timestep])
        row, column = rng.integers(0, _SPARE, size=2)
        height, width = self._shape
        return np.asarray(self._bank[row : row + height, column : column + width])

    def readout(self) -> Any:
        """The `struct vs_readout` of what `to_levels` and `read` do."""
        readout = kernel_ffi.new("struct vs_readout *")
        readout.shot, readout.read = SHOT_NOISE, READ_NOISE**2
        readout.alpha, readout.beta = _SCALE, -READ_NOISE * _SCALE
        readout.most = 255 - 2 * _MIDDLE
        readout.table = self._table.tolist()
        return readout

    def read(self, levels: Image, noise: Image, window: Window, image: Image) -> None:
        """Reads the levels of a window out into that window of `image`, (h, w) uint8.

        `noise` is that of the whole picture.
        """
        target = image[window]
        cv2.add(levels, noise[window], dst=target)
        cv2.LUT(target, self._table, dst=target)
