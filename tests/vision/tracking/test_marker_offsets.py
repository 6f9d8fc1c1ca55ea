"""Markers that sit beside the middle of their robots."""

from __future__ import annotations

import math

import numpy as np
import pytest

from vsense.config.roster_fields import MarkerOffset
from vsense.vision.tracking._views import VIEW, MarkerOffsets, covariances

OFFSET = MarkerOffset(0.003, 0.001, math.radians(5.0))
OFFSETS = MarkerOffsets({31: OFFSET, 23: MarkerOffset(yaw_rad=math.pi)})


def views(*rows: tuple[int, float, float, float]) -> np.ndarray:
    made = np.zeros(len(rows), dtype=VIEW)
    for name, column in zip(("tag", "x_m", "y_m", "yaw_rad"), zip(*rows)):
        made[name] = column
    made["covariance"] = (4e-8, 1e-8, 2e-6, 9e-8, -3e-6, 1e-3)
    return made


def test_the_robot_is_where_a_ruler_finds_it() -> None:
    # A robot at (1, 2) m that looks along +y: 3 mm ahead is +y, 1 mm left is -x.
    seen = views((7, 0.5, 0.5, 3.0), (23, 0.0, 0.0, 3.0), (31, 0.999, 2.003, math.radians(95.0)))
    robots = OFFSETS.to_robots(seen)
    assert robots[2]["x_m"] == pytest.approx(1.0) and robots[2]["y_m"] == pytest.approx(2.0)
    assert robots[2]["yaw_rad"] == pytest.approx(math.pi / 2.0)
    assert robots[1]["yaw_rad"] == pytest.approx(3.0 - math.pi)
    assert robots[0] == seen[0]
    back = OFFSETS.to_markers(robots)
    for name in ("x_m", "y_m", "yaw_rad"):
        assert back[name] == pytest.approx(seen[name], abs=1e-12)


def test_nothing_is_touched_where_nothing_is_known() -> None:
    seen = views((7, 0.5, 0.5, 3.0))
    assert OFFSETS.to_robots(seen) is seen
    assert MarkerOffsets({}).to_robots(seen) is seen
    assert MarkerOffsets({}).to_markers(seen) is seen


def test_an_error_of_the_heading_is_one_of_the_place() -> None:
    seen = views((31, 1.0, 1.0, 0.8))
    cloud = np.repeat(seen, 40_000)
    random = np.random.default_rng(1)
    errors = random.multivariate_normal(np.zeros(3), covariances(seen)[0], len(cloud))
    for name, column in zip(("x_m", "y_m", "yaw_rad"), errors.T):
        cloud[name] += column
    moved = OFFSETS.to_robots(cloud)
    found = np.cov(np.stack([moved[name] for name in ("x_m", "y_m", "yaw_rad")]))
    told = covariances(OFFSETS.to_robots(seen))[0]
    scale = np.sqrt(np.outer(np.diag(told), np.diag(told)))
    assert np.abs(found - told).max() / scale.max() < 0.03
    assert (np.abs(found - told) / scale).max() < 0.03
