"""The lens model with its derivatives, and small rotations.

A lens is nine numbers: fx, fy, cx, cy [px], k1, k2, p1, p2, k3, as in
    `vsense.vision.cameras.camera`.
"""

from __future__ import annotations

import numpy as np

from vsense.vision.cameras.camera import Camera, Floats

LENS_SIZE = 9
NEAREST_M = 1e-3
"""Points nearer than this, or behind the camera, are projected from this depth."""


def lens_of(camera: Camera) -> Floats:
    """(9,) the lens of a camera."""
    focal = (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)
    return np.array([*focal, *camera.distortion])


def camera_of(
    id: str, size: tuple[int, int], lens: Floats, rotation: Floats, shift: Floats
) -> Camera:
    """Returns a camera with a (9,) lens; `size` is width and height [px].

    `rotation` (3, 3) is from arena to camera frame, `shift` (3,) the arena's origin in the camera
    frame [m].
    """
    # The product of many small turns is rounded; a camera needs an exact rotation.
    left, _, right = np.linalg.svd(rotation)
    clean = left @ right
    fx, fy, cx, cy, *distortion = (float(value) for value in lens)
    return Camera(
        id=id,
        width_px=size[0],
        height_px=size[1],
        fx_px=fx,
        fy_px=fy,
        cx_px=cx,
        cy_px=cy,
        distortion=tuple(distortion),
        rotation=tuple(float(value) for value in clean.ravel()),
        position_m=tuple(float(value) for value in -clean.T @ shift),
    )


def project(lens: Floats, points: Floats) -> tuple[Floats, Floats, Floats]:
    """Projects (n, 3) points in the camera frame [m] through (n, 9) lenses, with derivatives.

    Returns:
        (n, 2) pixels, (n, 2, 3) derivative by the point, (n, 2, 9) derivative by the lens.

    Source: OpenCV, calib3d, pinhole camera with radial and tangential distortion.
    """
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = lens.T
    depth = np.maximum(points[:, 2], NEAREST_M)
    x, y = points[:, 0] / depth, points[:, 1] / depth
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2.0 * (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3))
    xy2, across_x, across_y = 2.0 * x * y, r2 + 2.0 * x * x, r2 + 2.0 * y * y
    x_seen = x * radial + p1 * xy2 + p2 * across_x
    y_seen = y * radial + p1 * across_y + p2 * xy2
    by_point = np.empty((len(points), 2, 3))
    mixed = x * y * slope + 2.0 * (p1 * x + p2 * y)
    by_point[:, 0, 0] = fx * (radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x)
    by_point[:, 0, 1] = fx * mixed
    by_point[:, 1, 0] = fy * mixed
    by_point[:, 1, 1] = fy * (radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x)
    by_point[:, :, 2] = -(by_point[:, :, 0] * x[:, None] + by_point[:, :, 1] * y[:, None])
    by_point /= depth[:, None, None]
    by_lens = np.zeros((len(points), 2, LENS_SIZE))
    by_lens[:, 0, 0], by_lens[:, 1, 1] = x_seen, y_seen
    by_lens[:, 0, 2] = by_lens[:, 1, 3] = 1.0
    for axis, reach in enumerate((fx * x * r2, fy * y * r2)):
        by_lens[:, axis, 4] = reach
        by_lens[:, axis, 5], by_lens[:, axis, 8] = reach * r2, reach * r2 * r2
    by_lens[:, 0, 6], by_lens[:, 0, 7] = fx * xy2, fx * across_x
    by_lens[:, 1, 6], by_lens[:, 1, 7] = fy * across_y, fy * xy2
    return np.stack((fx * x_seen + cx, fy * y_seen + cy), axis=-1), by_point, by_lens


def undistorted(lens: Floats, pixels: Floats) -> Floats:
    """Returns (n, 2) slopes x/z, y/z of the rays through (n, 2) pixels of one lens (9,)."""
    camera = camera_of("lens", (1, 1), lens, np.diag((1.0, -1.0, -1.0)), np.array((0.0, 0.0, 1.0)))
    # One metre above the floor and looking down, floor x and -y are the ray's slopes.
    return camera.to_plane(pixels, 0.0) * (1.0, -1.0)


def turn(vectors: Floats) -> Floats:
    """Returns (n, 3, 3) rotations by the (n, 3) vectors, direction the axis, length the angle.

    Source: Rodrigues' formula.
    """
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    axis = vectors / np.maximum(angle[:, :, 0], 1e-300)
    cross = np.zeros((len(vectors), 3, 3))
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -axis[:, 2], axis[:, 1], -axis[:, 0]
    cross -= np.transpose(cross, (0, 2, 1))
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross)
