"""What the cameras would say about a simulated arena: every marker, nearly where it is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vsense.arena import POSE, ArenaState, wrap_angle

POSITION_STD_M = 26e-6
"""Standard deviation of a tracked position along each axis: 0.037 mm in all, as in the lab.
Source: `tracking.position_rmse_mm` of `vsense lab pollutant --json`, 120 s, seeds 1 to 3."""

HEADING_STD_RAD = 1.1e-3
"""That of a tracked heading: 0.062 degrees. Source: `tracking.heading_rmse_deg` there."""

_STREAM = 1
"""Tells these random numbers from the others that follow from a run's seed."""

_BLOCK = 256
"""Errors of so many timesteps are drawn at once: one call costs as much as ten of them."""


class SimulatedTracker:
    """Makes arena states of true poses."""

    def __init__(self, tags: Sequence[int], seed: int) -> None:
        """A tracker that knows these tags.

        Args:
            tags: robots and objects, in the order of the poses.
            seed: of the errors.
        """
        self._order = np.argsort(np.asarray(tags, dtype=np.uint32))
        self._random = np.random.default_rng([seed, _STREAM])
        self._errors = np.zeros((0, len(tags), 3))
        self._used = 0
        self._states = np.zeros(len(tags), dtype=POSE)
        self._states["tag"] = np.asarray(tags)[self._order]
        self._states["confidence"] = 1.0
        self._states["cameras"] = 1
        self._states["seen"] = True
        self._last: tuple[NDArray[np.float64], int] | None = None

    def update(self, poses: NDArray[np.float64], timestep: int, capture_ns: int) -> ArenaState:
        """Sees everybody.

        Args:
            poses: (n, 3) true x_m, y_m, yaw_rad in (-pi, pi].
            timestep: of the arena state.
            capture_ns: when this is, later than the call before.
        """
        robots = self._states.copy()
        seen = poses[self._order] + self._error()
        x_m, y_m, yaw_rad = seen.T
        robots["x_m"], robots["y_m"], robots["yaw_rad"] = x_m, y_m, yaw_rad
        if np.abs(yaw_rad).max(initial=0.0) > np.pi:
            robots["yaw_rad"] = wrap_angle(yaw_rad)
        robots["capture_ns"] = capture_ns
        if self._last is not None:
            before, before_ns = self._last
            east_m, north_m, _ = (seen - before).T
            robots["speed_m_s"] = np.hypot(east_m, north_m) / (1e-9 * (capture_ns - before_ns))
        self._last = seen, capture_ns
        return ArenaState(timestep, capture_ns, robots, len(robots))

    def _error(self) -> NDArray[np.float64]:
        """This timestep's errors (n, 3)."""
        if self._used == len(self._errors):
            self._errors = self._random.standard_normal((_BLOCK, len(self._states), 3))
            self._errors *= (POSITION_STD_M, POSITION_STD_M, HEADING_STD_RAD)
            self._used = 0
        self._used += 1
        error: NDArray[np.float64] = self._errors[self._used - 1]
        return error
