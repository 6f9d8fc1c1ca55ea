"""Who drives where in the next timestep, so that nobody touches anybody.

Every robot weighs some directions and speeds by where they lead in the next 2.5 s. One decides
after the other; who comes later makes way for those before.

Source: sampled velocities that are foretold and weighed are the dynamic window approach (D. Fox,
W. Burgard, S. Thrun, 1997); decisions by priority are M. Erdmann's and T. Lozano-Perez's (1987).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import wrap_angle
from vsense.run.homing.floor import DrivingFloor
from vsense.run.homing.motion import CHOICES, STEPS, choices, foretell

Floats = NDArray[np.float64]

URGENT = 4
"""A contact within so many steps of what is foretold (1 s) is out of the question."""
LATE_M = 1.0
"""A contact later than that costs as much as this way, if it were at once."""
SHY_M, SHY_COST_M = 0.03, 0.1
"""Whoever comes nearer to something than this pays up to so much for it; where its way ends nearer
to it, only for what is nearer still."""
HABIT = 0.1
HABIT_M = 0.02
"""Whoever changes its mind pays this share of its way, and at most this."""
WORSE_M = 0.002
"""Those who are too near already may not come nearer by more than this."""
STAND = CHOICES - 1


@dataclass(slots=True)
class Travellers:
    """Everybody at one moment; n robots.

    Attributes:
        poses: (n, 3) x_m, y_m, yaw_rad.
        moves: (n,) who can be told to drive; all others stand.
        targets: (n, 2) where each wants to go next, in sight of it.
        speeds: (n,) how fast [m/s]; who wants to stay has a low one, to make way with.
        reach_m: (n,) how far it drives at most.
        order: robots by right of way, the first one first.
        apart_m: (n, n) how far two middles must be apart.
        room_m: (n,) how far a middle must be from walls.
        headings, driven: (n,) the last directions [rad] and speeds [m/s].
    """

    poses: Floats
    moves: NDArray[np.bool_]
    targets: Floats
    speeds: Floats
    reach_m: Floats
    order: list[int]
    apart_m: Floats
    room_m: Floats
    headings: Floats
    driven: Floats


@dataclass(slots=True)
class Decision:
    """What robots do: (n,) directions [rad], speeds [m/s], and whether they do as they wanted."""

    headings: Floats
    speeds: Floats
    wanted: NDArray[np.bool_]


def decide(crowd: Travellers, floor: DrivingFloor) -> Decision:
    """Finds what everybody does now."""
    poses = crowd.poses
    count = len(poses)
    away = crowd.targets - poses[:, :2]
    directions, speeds = choices(np.arctan2(away[:, 1], away[:, 0]), crowd.speeds)
    paths = foretell(poses, directions, speeds, crowd.reach_m)
    costs = _own_costs(crowd, directions, speeds, paths)
    walled = _walled(crowd, floor, paths)
    driven = np.where(crowd.moves, crowd.driven, 0.0)
    before = crowd.headings[:, np.newaxis], driven[:, np.newaxis]
    expected = foretell(poses, *before, crowd.reach_m)[:, 0]
    waiting = crowd.moves & (driven > 0.0)
    chosen = np.full(count, STAND)
    for robot in crowd.order:
        if not crowd.moves[robot]:
            continue
        gaps = _gaps(crowd, robot, paths[robot], expected)
        # Those who decide later will make way, but not at once.
        gaps[:, waiting, URGENT:] = math.inf
        shy_m = _shyness_m(crowd, robot, floor)
        cost = costs[robot] + _contact_costs(np.minimum(gaps.min(axis=1), walled[robot]), shy_m)
        chosen[robot] = int(np.argmin(cost))
        expected[robot] = paths[robot, chosen[robot]]
        waiting[robot] = False
    rows = np.arange(count)
    return Decision(directions[rows, chosen], speeds[rows, chosen], chosen == 0)


def _own_costs(crowd: Travellers, directions: Floats, speeds: Floats, paths: Floats) -> Floats:
    """(n, CHOICES) how far from its target each choice leaves a robot, and what it was doing."""
    left_m = np.hypot(*(paths[:, :, -1] - crowd.targets[:, np.newaxis]).transpose(2, 0, 1))
    turned = np.abs(wrap_angle(directions - crowd.headings[:, np.newaxis]))
    changed = np.where(speeds > 0.0, np.minimum(turned, 1.0), 1.0)
    far_m = np.hypot(*(crowd.targets - crowd.poses[:, :2]).T)
    habit_m = np.where(crowd.driven > 0.0, np.minimum(HABIT * far_m, HABIT_M), 0.0)
    return np.asarray(left_m + habit_m[:, np.newaxis] * changed)


def _walled(crowd: Travellers, floor: DrivingFloor, paths: Floats) -> Floats:
    """(n, CHOICES, STEPS) by how much choices keep clear of walls, as `_gaps`."""
    free = floor.clearance_m(paths) - crowd.room_m[:, np.newaxis, np.newaxis]
    now = floor.clearance_m(crowd.poses[:, :2]) - crowd.room_m
    return _eased(free, now[:, np.newaxis, np.newaxis])


def _gaps(crowd: Travellers, robot: int, paths: Floats, expected: Floats) -> Floats:
    """(CHOICES, n, STEPS) by how much more than it must a robot keeps from each other one."""
    apart = paths[:, np.newaxis] - expected[np.newaxis]
    gaps = np.hypot(apart[..., 0], apart[..., 1]) - crowd.apart_m[robot][:, np.newaxis]
    here = crowd.poses[:, :2] - crowd.poses[robot, :2]
    now = np.hypot(here[:, 0], here[:, 1]) - crowd.apart_m[robot]
    gaps = _eased(gaps, now[np.newaxis, :, np.newaxis])
    gaps[:, robot] = math.inf
    return gaps


def _eased(gaps: Floats, now: Floats) -> Floats:
    """Where somebody is too near already, what does not make it worse is allowed."""
    return np.where(now < 0.0, gaps - now + WORSE_M, gaps)


def _shyness_m(crowd: Travellers, robot: int, floor: DrivingFloor) -> float:
    """From how far away a robot is shy of things."""
    target = crowd.targets[robot]
    away = np.hypot(*(crowd.poses[:, :2] - target).T) - crowd.apart_m[robot]
    away[robot] = math.inf
    wall_m = float(floor.clearance_m(target)) - float(crowd.room_m[robot])
    return max(0.001, min(SHY_M, wall_m, float(away.min())))


def _contact_costs(gaps: Floats, shy_m: float) -> Floats:
    """(CHOICES,) what it costs to come too near; gaps (CHOICES, STEPS) to the nearest."""
    touches = gaps < 0.0
    first = np.where(touches.any(axis=1), touches.argmax(axis=1), STEPS)
    nearest = gaps.min(axis=1)
    soon = gaps[:, :URGENT].min(axis=1)
    late = LATE_M * (STEPS - first) / STEPS
    shy = SHY_COST_M * np.clip((shy_m - nearest) / SHY_M, 0.0, 1.0)
    return np.asarray(np.where(first < URGENT, 1e3 - soon, late + shy))
