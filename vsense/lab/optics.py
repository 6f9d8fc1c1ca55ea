"""What lens and exposure do to the light: rays, vignetting, blur.

Magnitudes: tracking.md section 1 of the project's references.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.tracking.camera import Camera

Image32 = NDArray[np.float32]
Window = tuple[slice, slice]
Row = tuple[float, float, float]

PSF_SIGMA_PX = 0.6
"""Optical point spread."""
BLUR_SIGMA_PX = float(np.hypot(PSF_SIGMA_PX, 12.0**-0.5))
"""Point spread together with the square pixel's own width, whose variance is 1/12 px^2."""
VIGNETTING = 0.35
"""Share of the light that is lost in the picture's corners."""
EXPOSURE_NS = 10_000_000

_STEP = 4
"""Lenses are solved at every fourth pixel: between them a straight line is off by 1e-3 px."""


def everywhere(
    evaluate: Callable[[NDArray[np.float64]], NDArray[np.float64]], shape: tuple[int, int]
) -> tuple[Image32, Image32]:
    """Evaluates a smooth function at every pixel of a picture.

    Args:
        evaluate: Gets pixels (..., 2), column and row, and returns (..., 2).
        shape: Rows and columns of the picture.

    Returns:
        Both results, (rows, columns) float32, solved at every fourth pixel and interpolated.
    """
    height, width = shape
    columns = np.arange(-1, width // _STEP + 2) * _STEP + (_STEP - 1) / 2
    rows = np.arange(-1, height // _STEP + 2) * _STEP + (_STEP - 1) / 2
    coarse = evaluate(np.stack(np.meshgrid(columns, rows), axis=-1)).astype(np.float32)
    size = (coarse.shape[1] * _STEP, coarse.shape[0] * _STEP)
    fine = [
        cv2.resize(coarse[..., k], size, interpolation=cv2.INTER_LINEAR)[
            _STEP : _STEP + height, _STEP : _STEP + width
        ]
        for k in range(2)
    ]
    return np.ascontiguousarray(fine[0]), np.ascontiguousarray(fine[1])


class RayMap:
    """Where each pixel's ray goes, by the exact inverse of the lens model.

    Attributes:
        camera: The camera.
        x_m, y_m: (h, w) float32, where the ray meets the floor, arena frame.
    """

    def __init__(self, camera: Camera) -> None:
        """Solves the rays of one camera."""
        self.camera = camera
        self.x_m, self.y_m = everywhere(
            lambda pixels: camera.to_plane(pixels, 0.0), (camera.height_px, camera.width_px)
        )

    def affine(
        self, window: Window, height_m: float, rows: tuple[Row, Row]
    ) -> tuple[Image32, Image32]:
        """Maps the pixels of a window through a horizontal plane by an affine function.

        Args:
            window: Rows and columns.
            height_m: The plane's height above the floor.
            rows: Factors of arena x and y [1/m] where the ray crosses the plane, and offset,
                of each coordinate of the result.

        Returns:
            Both coordinates, float32, of the window's shape.
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
        """Returns the least and greatest x, then y [m] that the camera sees of the floor."""
        x, y = self.x_m, self.y_m
        return float(x.min()), float(x.max()), float(y.min()), float(y.max())


def vignetting(camera: Camera) -> Image32:
    """Returns (h, w) float32, the share of the light that reaches each pixel, 1 in the middle."""
    x = (np.arange(camera.width_px) - camera.cx_px) / camera.fx_px
    y = (np.arange(camera.height_px) - camera.cy_px) / camera.fy_px
    squared = (x * x)[np.newaxis, :] + (y * y)[:, np.newaxis]
    return np.asarray(1.0 - VIGNETTING * squared / squared.max(), dtype=np.float32)


def blur(image: Image32) -> Image32:
    """Returns the picture as the lens's point spread and the pixels' width leave it."""
    return np.asarray(cv2.GaussianBlur(image, (0, 0), BLUR_SIGMA_PX), dtype=np.float32)


def sample_times_ns(capture_ns: int, samples: int) -> list[int]:
    """Returns the moments whose pictures, averaged, stand for one exposure."""
    step = EXPOSURE_NS / samples
    return [capture_ns + round((k - (samples - 1) / 2) * step) for k in range(samples)]
