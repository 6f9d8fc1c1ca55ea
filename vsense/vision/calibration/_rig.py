"""One solution for all cameras of a rig: every picture and every known point at once."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats
from vsense.vision.calibration._bundle import (
    CAMERA_SIZE,
    POSE_SIZE,
    Bundle,
    Estimate,
    Knowledge,
    camera_of,
)
from vsense.vision.calibration._intrinsics import NOISE_PX, any_lens
from vsense.vision.calibration._placement import (
    FloorReference,
    Placement,
    Placer,
    camera_from_points,
)
from vsense.vision.calibration._solution import (
    CalibrationError,
    Solution,
    ViewResult,
    assemble,
    bad_views,
    by_view,
    floor_sigma_m,
    huber_limit_px,
    rms,
)
from vsense.vision.calibration._views import BoardViews, View
from vsense.vision.calibration.board import Board
from vsense.vision.calibration.frame import BoardPose

REFINE_SIGMA = (0.005, 0.005, 0.005, 0.005, 0.02, 0.05, 0.002, 0.002, 0.05)
"""Standard deviations of a calibrated lens: fx, fy as shares of the focal length, cx, cy of the
picture's width, then the distortion."""

_WIDE_PX = 50.0
_NOISE_PX = (0.02, 5.0)
_ROUNDS = 3


class Trust(Enum):
    """What becomes of the lenses that a rig starts from."""

    HOLD = "they stay as they are"
    REFINE = "they move a little: by REFINE_SIGMA"
    FREE = "they are a first guess"


@dataclass(frozen=True, slots=True)
class Rig:
    """What a rig's calibration starts from.

    `board` is None where only known points are used; `lenses` are camera -> (9,); `trust` is how
    far the pictures may change them.
    """

    shoot: BoardViews
    board: Board | None
    floor: FloorReference
    lenses: dict[str, Floats]
    trust: Trust


class RigSolver:
    """Calibrates a rig."""

    def __init__(self, rig: Rig) -> None:
        """Sorts cameras, moments and points; raises UsageError if no moment is on the floor."""
        self._rig = rig
        self._cameras = sorted(rig.lenses)
        self._flat = rig.floor.moments(rig.shoot.views)
        self._views = [*rig.shoot.views, *rig.floor.sightings]
        self._measured = {view.moment for view in rig.floor.sightings}
        self._bodies = sorted({view.moment for view in self._views})
        self._notes: list[str] = []
        self._noise_px = NOISE_PX
        self._anchor = self._choose_anchor()

    def solve(self) -> Solution:
        """Places everything, then adjusts it; raises CalibrationError for unlinked cameras."""
        estimate = self._start()
        used = np.ones(len(self._views), dtype=bool)
        limit = _WIDE_PX
        for _ in range(_ROUNDS):
            bundle = self._bundle(used, limit)
            estimate = bundle.solve(estimate)
            residuals = bundle.residuals(estimate)
            limit = huber_limit_px(residuals)
            self._noise_px = float(np.clip(rms(residuals) / np.sqrt(2.0), *_NOISE_PX))
            bundle = self._bundle(used, limit)
            estimate = bundle.solve(estimate)
            bad = self._bad(used, bundle, estimate)
            if not bad.any():
                break
            used &= ~bad
        return self._solution(estimate, bundle, used)

    def _choose_anchor(self) -> str | None:
        """The moment whose board fixes the arena frame; None where known points do."""
        if self._flat:
            return self._flat[0]
        if self._rig.floor.sightings:
            return None
        count: dict[str, int] = {}
        for view in self._views:
            count[view.moment] = count.get(view.moment, 0) + len(view.ids)
        if not count:
            raise CalibrationError("the board was found in no picture; check --board")
        anchor = max(sorted(count), key=lambda moment: count[moment])
        self._notes.append(
            f"no floor was given: the arena frame is the board's at moment {anchor}, "
            "and floor heights mean nothing"
        )
        return anchor

    def _points(self, view: View) -> Floats:
        """What a view saw, in the body's frame."""
        board = self._rig.board
        if view.moment in self._measured or board is None:
            return np.zeros((len(view.ids), 3))
        return np.asarray(board.points_m[view.ids])

    def _place_m(self, body: str) -> Floats:
        return self._rig.floor.points_m[body.removeprefix("point ")]

    def _start(self) -> Estimate:
        floor, lenses = self._rig.floor, self._rig.lenses
        start = Placement()
        if self._anchor is not None:
            start.bodies[self._anchor] = floor.lying(*floor.origin)
        for camera in self._cameras:
            mine = [view for view in floor.sightings if view.camera == camera]
            if mine:
                points = np.array([self._place_m(view.moment) for view in mine])
                pixels = np.array([np.median(view.pixels, axis=0) for view in mine])
                pose = camera_from_points(lenses[camera], points, pixels)
                if pose is not None:
                    start.cameras[camera] = pose
        views = list(self._rig.shoot.views)
        Placer(lenses, views, [self._points(view) for view in views]).place(start)
        poses = [self._body_pose(body, start) for body in self._bodies]
        cameras = [start.cameras[camera] for camera in self._cameras]
        return Estimate(
            np.array([lenses[camera] for camera in self._cameras]),
            np.array([pose.turn for pose in cameras]),
            np.array([pose.shift for pose in cameras]),
            np.array([pose.turn for pose in poses]),
            np.array([pose.shift for pose in poses]),
        )

    def _body_pose(self, body: str, placed: Placement) -> BoardPose:
        if body in self._measured:
            return BoardPose(np.eye(3), self._place_m(body))
        pose = placed.bodies.get(body)
        if pose is None:
            raise CalibrationError(f"moment {body}: the corners make no board; leave it out")
        flatten = body in self._flat and body != self._anchor
        return self._rig.floor.flattened(pose) if flatten else pose

    def _bundle(self, used: NDArray[np.bool_], limit_px: float) -> Bundle:
        views = [view for view, use in zip(self._views, used) if use]
        points = [self._points(view) for view in views]
        seen = assemble(views, points, self._cameras, self._bodies)
        return Bundle(seen, self._knowledge(), limit_px)

    def _knowledge(self) -> Knowledge:
        lenses = [self._known_lens(camera) for camera in self._cameras]
        mean, sigma = (np.array(part) for part in zip(*lenses))
        camera_free = np.ones((len(self._cameras), CAMERA_SIZE), dtype=bool)
        camera_free[:, POSE_SIZE:] = self._rig.trust is not Trust.HOLD
        body_free = np.ones((len(self._bodies), POSE_SIZE), dtype=bool)
        shift_mean, shift_weight = np.zeros((2, len(self._bodies), 3))
        for number, body in enumerate(self._bodies):
            if body in self._measured:
                body_free[number, :3] = False
                shift_mean[number] = self._place_m(body)
                shift_weight[number] = (self._noise_px / self._rig.floor.sigma_m) ** 2
            elif body == self._anchor:
                body_free[number] = False
            elif body in self._flat:
                # On the floor a board can slide, and turn about the vertical.
                body_free[number] = (False, False, True, True, True, False)
        weight = (self._noise_px / sigma) ** 2
        return Knowledge(camera_free, body_free, mean, weight, shift_mean, shift_weight)

    def _known_lens(self, camera: str) -> tuple[Floats, Floats]:
        """Mean and standard deviation of a lens, before the pictures."""
        size = self._rig.shoot.sizes[camera]
        if self._rig.trust is Trust.FREE:
            return any_lens(size)
        lens = self._rig.lenses[camera]
        scale = np.array([lens[0], lens[1], size[0], size[0], 1.0, 1.0, 1.0, 1.0, 1.0])
        return lens, scale * REFINE_SIGMA

    def _bad(
        self, used: NDArray[np.bool_], bundle: Bundle, estimate: Estimate
    ) -> NDArray[np.bool_]:
        """Views to leave out: far off, and not needed to link the cameras."""
        grouped = by_view(bundle.residuals(estimate), bundle.sightings)
        errors = np.array([rms(residuals) for residuals in grouped])
        bad = np.zeros(len(self._views), dtype=bool)
        bad[np.flatnonzero(used)[bad_views(errors)]] = True
        bad &= [v.moment != self._anchor and v.moment not in self._measured for v in self._views]
        left = [v for v, use in zip(self._rig.shoot.views, used & ~bad) if use]
        groups = Placer(self._rig.lenses, left, [self._points(v) for v in left]).groups()
        return bad if len(groups) == 1 else np.zeros_like(bad)

    def _solution(self, estimate: Estimate, bundle: Bundle, used: NDArray[np.bool_]) -> Solution:
        everything = self._bundle(np.ones_like(used), _WIDE_PX)
        grouped = by_view(everything.residuals(estimate), everything.sightings)
        results = [
            ViewResult(view.camera, view.moment, view.pixels, residuals, bool(use))
            for view, residuals, use in zip(self._views, grouped, used)
        ]
        residuals = bundle.residuals(estimate)
        # Per coordinate, where a residual has two.
        variance = 0.5 * rms(residuals) ** 2
        covariance = variance * bundle.covariance(estimate)
        sizes, floor = self._rig.shoot.sizes, bool(self._flat or self._measured)
        cameras = tuple(
            camera_of(name, sizes[name], *parts)
            for name, *parts in zip(
                self._cameras, estimate.lenses, estimate.camera_turn, estimate.camera_shift
            )
        )
        lens_sigma = np.sqrt(np.maximum(np.einsum("cii->ci", covariance)[:, POSE_SIZE:], 0.0))
        return Solution(
            cameras,
            tuple(results),
            dict(zip(self._cameras, lens_sigma)),
            {c.id: floor_sigma_m(c, block) for c, block in zip(cameras, covariance) if floor},
            dict(zip(self._bodies, zip(estimate.body_turn, estimate.body_shift))),
            tuple(self._notes),
        )
