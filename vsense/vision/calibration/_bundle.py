"""Bundle adjustment: all lenses, camera poses and body poses that explain all pictures best.

A body is a rigid set of points that stays where it is for a moment: a board, or one known point on
the floor. Levenberg-Marquardt with analytic derivatives. The many independent bodies are
eliminated first (Schur complement), so that the system to solve grows with the number of cameras
only.

Source: Triggs et al., Bundle Adjustment - A Modern Synthesis, 2000; Huber, 1964.

A lens is nine numbers: fx, fy, cx, cy [px], k1, k2, p1, p2, k3, as in
    `vsense.vision.cameras.camera`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats, Ints
from vsense.vision.calibration.frame import turn
from vsense.vision.cameras.camera import Camera

LENS_SIZE = 9
NEAREST_DEPTH_M = 1e-3
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
    depth = np.maximum(points[:, 2], NEAREST_DEPTH_M)
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


Bools = NDArray[np.bool_]

POSE_SIZE = 6
"""Turn (about x, y, z), then shift."""
CAMERA_SIZE = POSE_SIZE + LENS_SIZE

_STEPS = 100
_SMALLEST_GAIN = 1e-10
_DAMPING, _UNDAMPED, _STUCK = 1e-4, 1e-8, 1e8
"""At the start, small enough to count as none, and too large to gain anything."""
_SINGULAR = 1e-13


@dataclass(frozen=True, slots=True)
class Estimate:
    """All unknowns.

    Attributes:
        lenses: (c, 9), see `vsense.vision.calibration._bundle`.
        camera_turn: (c, 3, 3) arena to camera frame.
        camera_shift: (c, 3) the arena's origin in the camera frame [m].
        body_turn: (b, 3, 3) body to arena frame.
        body_shift: (b, 3) the body's origin in the arena frame [m].
    """

    lenses: Floats
    camera_turn: Floats
    camera_shift: Floats
    body_turn: Floats
    body_shift: Floats


@dataclass(frozen=True, slots=True)
class Sightings:
    """What the cameras saw, view by view; a view is one camera's sight of one body.

    Attributes:
        camera, body: (v,) of each view; no two views share both.
        start: (v + 1,) where each view's points begin and end.
        points: (n, 3) in the body's frame [m].
        pixels: (n, 2).
    """

    camera: Ints
    body: Ints
    start: Ints
    points: Floats
    pixels: Floats

    @property
    def view(self) -> Ints:
        """(n,) the view that each point belongs to."""
        return np.repeat(np.arange(len(self.camera)), np.diff(self.start))


@dataclass(frozen=True, slots=True)
class Knowledge:
    """What is known beforehand.

    Attributes:
        camera_free: (c, 15) which of turn, shift and lens are unknown.
        body_free: (b, 6) which of turn and shift are unknown.
        lens_mean: (c, 9) prior mean of the lens.
        lens_weight: (c, 9) noise over standard deviation, squared; 0 where nothing is known.
        shift_mean: (b, 3) [m] prior mean of the body's place.
        shift_weight: (b, 3) likewise.
    """

    camera_free: Bools
    body_free: Bools
    lens_mean: Floats
    lens_weight: Floats
    shift_mean: Floats
    shift_weight: Floats


@dataclass(slots=True)
class _Equations:
    """Normal equations: camera blocks, body blocks, and what couples them per view."""

    cameras: Floats
    camera_side: Floats
    bodies: Floats
    body_side: Floats
    ties: Floats


class Bundle:
    """One adjustment."""

    def __init__(self, sightings: Sightings, knowledge: Knowledge, limit_px: float) -> None:
        """Prepares; residuals beyond `limit_px` count linearly (Huber), not squared."""
        self.sightings = sightings
        self._prior = knowledge
        self._limit_px = limit_px
        by_body = np.argsort(sightings.body, kind="stable")
        cuts = np.searchsorted(sightings.body[by_body], np.arange(len(knowledge.body_free) + 1))
        self._views_of = [by_body[a:b] for a, b in pairwise(cuts)]

    def solve(self, estimate: Estimate) -> Estimate:
        """Returns the best estimate near the given one."""
        damping, cost = _DAMPING, self.cost(estimate)
        for _ in range(_STEPS):
            trial = self._stepped(estimate, self._equations(estimate), damping)
            trial_cost = self.cost(trial)
            gain = cost - trial_cost
            settled = abs(gain) <= _SMALLEST_GAIN * cost
            if gain >= 0.0:
                estimate, cost = trial, trial_cost
            # A damped step gains little in poorly known directions, so only an undamped one ends.
            if settled and damping <= _UNDAMPED:
                break
            damping *= 0.1 if gain >= 0.0 or settled else 30.0
            if damping > _STUCK:
                break
        return estimate

    def residuals(self, estimate: Estimate) -> Floats:
        """(n, 2) picture minus model [px]."""
        return self.sightings.pixels - self._projected(estimate)[0]

    def cost(self, estimate: Estimate) -> float:
        """The sum that `solve` minimises [px^2]."""
        size = np.linalg.norm(self.residuals(estimate), axis=1)
        limit = self._limit_px
        seen = np.where(size <= limit, size**2, 2.0 * limit * size - limit**2).sum()
        prior = self._prior
        lens = prior.lens_weight * (estimate.lenses - prior.lens_mean) ** 2
        shift = prior.shift_weight * (estimate.body_shift - prior.shift_mean) ** 2
        return float(seen + lens.sum() + shift.sum())

    def covariance(self, estimate: Estimate) -> Floats:
        """(c, 15, 15) of turn, shift and lens of each camera, for noise of 1 px."""
        equations = self._equations(estimate)
        reduced, _, _ = self._reduced(equations, 0.0)
        free = self._prior.camera_free.ravel()
        inverse = np.zeros_like(reduced)
        scale = _scale(reduced)[free]
        part = reduced[np.ix_(free, free)] * scale[:, None] * scale
        inverse[np.ix_(free, free)] = (
            np.linalg.pinv(part, rcond=_SINGULAR, hermitian=True) * scale[:, None] * scale
        )
        cameras = len(equations.cameras)
        blocks = inverse.reshape(cameras, CAMERA_SIZE, cameras, CAMERA_SIZE)
        return np.asarray(blocks[np.arange(cameras), :, np.arange(cameras), :])

    def _projected(self, estimate: Estimate) -> tuple[Floats, ...]:
        """Pixels, derivatives by point and lens, points in camera frame, points turned."""
        view = self.sightings.view
        camera, body = self.sightings.camera[view], self.sightings.body[view]
        turned = np.einsum("nij,nj->ni", estimate.body_turn[body], self.sightings.points)
        placed = turned + estimate.body_shift[body]
        points = np.einsum("nij,nj->ni", estimate.camera_turn[camera], placed)
        points += estimate.camera_shift[camera]
        return *project(estimate.lenses[camera], points), points, turned

    def _equations(self, estimate: Estimate) -> _Equations:
        pixels, by_point, by_lens, points, turned = self._projected(estimate)
        seen, prior = self.sightings, self._prior
        camera, body = seen.camera[seen.view], seen.body[seen.view]
        by_arena = by_point @ estimate.camera_turn[camera]
        by_camera = np.concatenate((np.cross(points[:, None], by_point), by_point, by_lens), axis=2)
        by_body = np.concatenate((np.cross(turned[:, None], by_arena), by_arena), axis=2)
        both = np.concatenate(
            (by_camera * prior.camera_free[camera, None], by_body * prior.body_free[body, None]), 2
        )
        residuals = seen.pixels - pixels
        size = np.linalg.norm(residuals, axis=1)
        weight = np.minimum(1.0, self._limit_px / np.maximum(size, 1e-12))
        result = self._priors(estimate)
        for number, (first, last) in enumerate(pairwise(seen.start)):
            part = both[first:last].reshape(-1, CAMERA_SIZE + POSE_SIZE)
            weighted = part * np.repeat(weight[first:last], 2)[:, None]
            square, side = weighted.T @ part, weighted.T @ residuals[first:last].ravel()
            c, b = seen.camera[number], seen.body[number]
            result.cameras[c] += square[:CAMERA_SIZE, :CAMERA_SIZE]
            result.bodies[b] += square[CAMERA_SIZE:, CAMERA_SIZE:]
            result.ties[number] = square[:CAMERA_SIZE, CAMERA_SIZE:]
            result.camera_side[c] += side[:CAMERA_SIZE]
            result.body_side[b] += side[CAMERA_SIZE:]
        return result

    def _priors(self, estimate: Estimate) -> _Equations:
        """Equations of prior knowledge only; fixed unknowns do not move."""
        prior = self._prior
        cameras, bodies = len(prior.camera_free), len(prior.body_free)
        camera_weight = np.where(prior.camera_free, 0.0, 1.0)
        body_weight = np.where(prior.body_free, 0.0, 1.0)
        lens_free, shift_free = prior.camera_free[:, POSE_SIZE:], prior.body_free[:, 3:]
        camera_weight[:, POSE_SIZE:] += prior.lens_weight * lens_free
        body_weight[:, 3:] += prior.shift_weight * shift_free
        camera_side = np.zeros((cameras, CAMERA_SIZE))
        body_side = np.zeros((bodies, POSE_SIZE))
        lens_off = prior.lens_mean - estimate.lenses
        camera_side[:, POSE_SIZE:] = prior.lens_weight * lens_off * lens_free
        body_side[:, 3:] = (
            prior.shift_weight * (prior.shift_mean - estimate.body_shift) * shift_free
        )
        return _Equations(
            camera_weight[:, :, None] * np.eye(CAMERA_SIZE),
            camera_side,
            body_weight[:, :, None] * np.eye(POSE_SIZE),
            body_side,
            np.zeros((len(self.sightings.camera), CAMERA_SIZE, POSE_SIZE)),
        )

    def _reduced(self, equations: _Equations, damping: float) -> tuple[Floats, Floats, Floats]:
        """The cameras' equations after the bodies are eliminated, and the bodies' inverses."""
        count = len(equations.cameras)
        bodies = _damped(equations.bodies, max(damping, 1e-14))
        inverses = np.asarray(np.linalg.inv(bodies), dtype=np.float64)
        blocks = np.zeros((count, CAMERA_SIZE, count, CAMERA_SIZE))
        index = np.arange(count)
        blocks[index, :, index, :] = _damped(equations.cameras, damping)
        matrix: Floats = blocks.reshape(count * CAMERA_SIZE, -1)
        side = equations.camera_side.ravel().copy()
        for body, views in enumerate(self._views_of):
            if len(views) == 0:
                continue
            tie = equations.ties[views].reshape(-1, POSE_SIZE)
            rows = self.sightings.camera[views][:, None] * CAMERA_SIZE + np.arange(CAMERA_SIZE)
            rows = rows.ravel()
            carried = tie @ inverses[body]
            matrix[np.ix_(rows, rows)] -= carried @ tie.T
            side[rows] -= carried @ equations.body_side[body]
        return matrix, side, inverses

    def _stepped(self, estimate: Estimate, equations: _Equations, damping: float) -> Estimate:
        matrix, side, inverses = self._reduced(equations, damping)
        cameras = _solved(matrix, side, self._prior.camera_free.ravel())
        cameras = cameras.reshape(-1, CAMERA_SIZE)
        left = equations.body_side.copy()
        carried = np.einsum("vij,vi->vj", equations.ties, cameras[self.sightings.camera])
        np.subtract.at(left, self.sightings.body, carried)
        bodies = np.einsum("bij,bj->bi", inverses, left)
        swing, roll = turn(cameras[:, :3]), turn(bodies[:, :3])
        shift = np.einsum("cij,cj->ci", swing, estimate.camera_shift) + cameras[:, 3:POSE_SIZE]
        return replace(
            estimate,
            lenses=estimate.lenses + cameras[:, POSE_SIZE:],
            camera_turn=swing @ estimate.camera_turn,
            camera_shift=shift,
            body_turn=roll @ estimate.body_turn,
            body_shift=estimate.body_shift + bodies[:, 3:],
        )


def _damped(blocks: Floats, damping: float) -> Floats:
    """The blocks with their diagonals raised, which shortens the step."""
    diagonal = np.einsum("bii->bi", blocks)
    raised = damping * np.maximum(diagonal, 1e-9)
    return np.asarray(blocks + raised[:, :, None] * np.eye(blocks.shape[1]))


def _scale(matrix: Floats) -> Floats:
    """Factors that bring a matrix's diagonal to 1: turns, metres and pixels differ by 1e6."""
    return np.asarray(1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-30)))


def _solved(matrix: Floats, side: Floats, free: Bools) -> Floats:
    """Solves a symmetric system for what is free; the rest stays 0."""
    result = np.zeros(len(side))
    if free.any():
        scale = _scale(matrix)[free]
        part = matrix[np.ix_(free, free)] * scale[:, None] * scale
        step = np.linalg.lstsq(part, side[free] * scale, rcond=_SINGULAR)[0]
        result[free] = step * scale
    return result
