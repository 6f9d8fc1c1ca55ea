"""The camera model: pinhole with OpenCV's five distortion coefficients.

Pixel (0, 0) is the centre of the upper left pixel. The camera frame has z along the optical
axis, x to the right and y down in the picture.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats
from vsense.base.errors import VsenseError
from vsense.base.files import parse_json

Image32 = NDArray[np.float32]

_STEP = 4
"""Smooth functions are evaluated at every fourth pixel: of a lens a straight line between them is
off by 1e-3 px."""
_DIRECTIONS = 48
_REACH = np.arange(0.0, 6.0, 0.01)
"""Tangents of the angles at which a lens is looked at: up to 80 degrees."""
_MARGIN = 0.05
"""Share of the picture's size beyond its border that still belongs to the window."""


def everywhere(
    evaluate: Callable[[Floats], Floats], shape: tuple[int, int]
) -> tuple[Image32, Image32]:
    """Evaluates a smooth function at every pixel of a picture of `shape` (rows, columns).

    `evaluate` takes pixels (..., 2), column and row, and returns (..., 2). It is called for every
    fourth pixel; both results (rows, columns) are interpolated.
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


def _first(where: NDArray[np.bool_]) -> Floats:
    """The reach of the first true place of each row; the last one where there is none."""
    return np.asarray(_REACH[np.where(where.any(axis=1), where.argmax(axis=1), -1)])


def _jacobian(x: Floats, y: Floats, coefficients: tuple[float, ...]) -> Floats:
    """By how much a lens stretches areas around points of the plane."""
    step = 1e-6
    (u_right, v_right), (u_left, v_left) = (distort(x + d, y, coefficients) for d in (step, -step))
    (u_up, v_up), (u_low, v_low) = (distort(x, y + d, coefficients) for d in (step, -step))
    area = (u_right - u_left) * (v_up - v_low) - (u_up - u_low) * (v_right - v_left)
    return np.asarray(area / (4.0 * step * step))


_UNDISTORT_STEPS = 12
_STEP_M = 0.01
_UNDISTORT_TOLERANCE = 1e-10
_MOST_READOUT_S = 0.2


class CameraError(VsenseError):
    """A camera's description that makes no camera."""


@dataclass(frozen=True, slots=True)
class Camera:
    """One calibrated camera.

    Attributes:
        id: Name, unique in the arena.
        fx_px, fy_px: Focal lengths along the picture's x and y; cx_px, cy_px: principal point.
        distortion: k1, k2, p1, p2, k3 of OpenCV's model.
        rotation: 3x3 matrix, row by row, from the arena frame to the camera frame.
        position_m: The camera's centre in the arena frame.
        row_time_s: Of a rolling shutter, from one row's exposure to the next one's; 0: all at once.
            A picture's capture time is that of its middle row.
    """

    id: str
    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    distortion: tuple[float, ...]
    rotation: tuple[float, ...]
    position_m: tuple[float, ...]
    row_time_s: float = 0.0

    def __post_init__(self) -> None:
        for name, size in (("distortion", 5), ("rotation", 9), ("position_m", 3)):
            values = getattr(self, name)
            if len(values) != size or not np.all(np.isfinite(values)):
                raise CameraError(f"camera {self.id}: {name}: {values!r} is not {size} numbers")
        if min(self.width_px, self.height_px) < 1 or not min(self.fx_px, self.fy_px) > 0.0:
            raise CameraError(f"camera {self.id}: size and focal length must be positive")
        if not abs(self.row_time_s) * self.height_px <= _MOST_READOUT_S:
            raise CameraError(
                f"camera {self.id}: row_time_s: {self.row_time_s!r}: expected up to"
                f" {_MOST_READOUT_S:g} s for all {self.height_px} rows"
            )
        matrix = np.reshape(self.rotation, (3, 3))
        if not np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-6) or np.linalg.det(matrix) < 0:
            raise CameraError(f"camera {self.id}: rotation: the rows are no rotation matrix")

    @classmethod
    def looking_down(
        cls,
        id: str,
        x_m: float,
        y_m: float,
        height_m: float,
        focal_px: float,
        size: tuple[int, int],
        distortion: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0),
    ) -> Camera:
        """Returns a camera above (x_m, y_m) that looks straight down.

        In its picture +x is to the right and +y up.

        `size` is (width, height) in pixels; the principal point is the picture's middle.
        """
        width, height = size
        return cls(
            id=id,
            width_px=width,
            height_px=height,
            fx_px=focal_px,
            fy_px=focal_px,
            cx_px=(width - 1) / 2.0,
            cy_px=(height - 1) / 2.0,
            distortion=distortion,
            rotation=(1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0),
            position_m=(x_m, y_m, height_m),
        )

    def project(self, points_m: Floats) -> Floats:
        """Returns the (..., 2) pixels of (..., 3) arena points in front of the camera."""
        points = np.asarray(points_m, dtype=np.float64)
        seen = (points - np.array(self.position_m)) @ np.reshape(self.rotation, (3, 3)).T
        return self.shown(seen[..., 0] / seen[..., 2], seen[..., 1] / seen[..., 2])

    def shown(self, x: Floats, y: Floats) -> Floats:
        """Returns the (..., 2) pixels of points of the normalised image plane."""
        u, v = distort(x, y, self.distortion)
        return np.stack((self.fx_px * u + self.cx_px, self.fy_px * v + self.cy_px), axis=-1)

    def straightened(self, points_px: Floats) -> tuple[Floats, Floats]:
        """Returns x and y, on the normalised image plane, of what (..., 2) pixels show."""
        across = (points_px[..., 0] - self.cx_px) / self.fx_px
        return undistort(across, (points_px[..., 1] - self.cy_px) / self.fy_px, self.distortion)

    def to_plane(self, points_px: Floats, height_m: float | Floats) -> Floats:
        """Returns arena x and y [m] of what (..., 2) pixels show of a horizontal plane.

        `height_m` is the plane's height above the floor, one for all pixels or one each.
        """
        x, y = self.straightened(np.asarray(points_px, dtype=np.float64))
        rays = np.stack((x, y, np.ones_like(x)), axis=-1) @ np.reshape(self.rotation, (3, 3))
        centre = np.array(self.position_m)
        reach = (np.asarray(height_m) - centre[2]) / rays[..., 2]
        return np.asarray(centre[:2] + reach[..., np.newaxis] * rays[..., :2])

    def px_per_m(self, height_m: float) -> float:
        """Returns the scale in the picture's middle, by area, of a plane at a height.

        It is no number where the middle shows nothing of the plane.
        """
        middle = np.array([(self.width_px - 1) / 2.0, (self.height_px - 1) / 2.0])
        with np.errstate(divide="ignore", invalid="ignore"):
            x, y = self.to_plane(middle, height_m)
            steps = [(x, y, height_m), (x + _STEP_M, y, height_m), (x, y + _STEP_M, height_m)]
            here, right, up = self.project(np.array(steps))
            area = abs(float(np.linalg.det(np.stack((right - here, up - here)))))
        return float(area**0.5 / _STEP_M)

    def window_radius(self) -> float:
        """Radius of the disc of the normalised image plane in which the lens model is right.

        It ends a little outside of the picture, or where the model folds back: from there on its
        polynomial shows what lies farther out nearer to the middle, which no lens does.
        """
        angle = np.linspace(0.0, 2.0 * np.pi, _DIRECTIONS, endpoint=False)[:, None]
        x, y = _REACH * np.cos(angle), _REACH * np.sin(angle)
        size_px = np.array((self.width_px, self.height_px))
        shown = self.shown(x, y)
        outside = (shown < -_MARGIN * size_px) | (shown > size_px + _MARGIN * size_px)
        folds = _jacobian(x, y, self.distortion) <= 0.0
        leaves = _first(outside.any(axis=-1) & ~folds)
        folded = _first(folds)
        # A ray that has folded back before it left the picture never leaves it.
        return float(min(leaves.max(), folded.min()))

    def contains(self, points_px: Floats, margin_px: float = 0.0) -> NDArray[np.bool_]:
        """Whether (..., 2) pixels lie in the picture, `margin_px` inside its border."""
        low = margin_px - 0.5
        x, y = points_px[..., 0], points_px[..., 1]
        return np.asarray(
            (x >= low)
            & (x <= self.width_px - 1 - low)
            & (y >= low)
            & (y <= self.height_px - 1 - low)
        )

    def to_json(self) -> str:
        """Returns the camera as the text of a camera file."""
        values = asdict(self)
        if self.row_time_s == 0.0:
            del values["row_time_s"]
        return json.dumps(values, indent=2)

    @classmethod
    def from_json(cls, text: str) -> Camera:
        """Reads the text of a camera file; raises CameraError if a value is missing or wrong."""
        try:
            values: dict[str, Any] = parse_json(text)
            return cls(
                id=str(values["id"]),
                width_px=int(values["width_px"]),
                height_px=int(values["height_px"]),
                fx_px=float(values["fx_px"]),
                fy_px=float(values["fy_px"]),
                cx_px=float(values["cx_px"]),
                cy_px=float(values["cy_px"]),
                distortion=tuple(float(v) for v in values["distortion"]),
                rotation=tuple(float(v) for v in values["rotation"]),
                position_m=tuple(float(v) for v in values["position_m"]),
                row_time_s=float(values.get("row_time_s", 0.0)),
            )
        except json.JSONDecodeError as error:
            raise CameraError(f"camera file: line {error.lineno}: {error.msg}") from None
        except KeyError as error:
            raise CameraError(f"camera file: {error.args[0]} is missing") from None
        except (TypeError, ValueError) as error:
            raise CameraError(f"camera file: {error}") from None


Coefficients = Sequence[float] | Floats
"""k1, k2, p1, p2, k3 of OpenCV's model; or (5, ...) of them, one set for each point."""


def distort(x: Floats, y: Floats, coefficients: Coefficients) -> tuple[Floats, Floats]:
    """Returns where a lens shows points of the normalised image plane, on that plane."""
    k1, k2, p1, p2, k3 = coefficients
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    if not (np.any(p1) or np.any(p2)):
        return x * radial, y * radial
    xy = 2.0 * x * y
    return (
        x * radial + p1 * xy + p2 * (r2 + 2.0 * x * x),
        y * radial + p1 * (r2 + 2.0 * y * y) + p2 * xy,
    )


def undistort(x_seen: Floats, y_seen: Floats, coefficients: Coefficients) -> tuple[Floats, Floats]:
    """Inverts `distort` by Newton's method, whose Jacobian is symmetric here."""
    k1, k2, p1, p2, k3 = coefficients
    x, y = x_seen.copy(), y_seen.copy()
    for _ in range(_UNDISTORT_STEPS):
        x_now, y_now = distort(x, y, coefficients)
        dx, dy = x_seen - x_now, y_seen - y_now
        if dx.size == 0 or max(np.abs(dx).max(), np.abs(dy).max()) < _UNDISTORT_TOLERANCE:
            break
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        slope = 2.0 * (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3))
        a = radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x
        b = slope * x * y + 2.0 * (p1 * x + p2 * y)
        d = radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x
        scale = 1.0 / (a * d - b * b)
        x = x + (d * dx - b * dy) * scale
        y = y + (a * dy - b * dx) * scale
    return x, y
