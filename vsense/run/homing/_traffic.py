"""Collision avoidance: each robot's direction and speed in the next timestep.

Every robot samples directions and speeds and predicts them over a horizon of 2.5 s. Robots decide
in the order of their priority; later ones avoid what earlier ones have chosen. How a robot moves
that is given a goal is a model of the daemon's law, with the numbers of `robot/homing.c`.

Source: sampled velocities with a predicted cost are the dynamic window approach (D. Fox,
W. Burgard, S. Thrun, 1997); decisions by priority are M. Erdmann's and T. Lozano-Perez's (1987).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Floats, wrap_angle
from vsense.run.homing.floor import DrivingFloor

MAX_M_S = 0.12
"""Fastest drive, the daemon's."""
RATE_PER_S = 1.5
"""A goal that lies x m away is driven to with so many times x m/s."""
TURN_RATE_PER_S, TURN_MAX_RAD_S = 2.5, 1.7
"""A goal that lies x rad aside is turned to with so many times x rad/s."""
NARROW_RAD = 1.0
"""A robot drives ahead only while its goal lies less than this aside; it slows down before."""

STEP_S = 0.25
HORIZON_STEPS = 10
"""Prediction horizon: 2.5 s."""

_ASIDE = np.radians([15.0, 30.0, 45.0, 60.0, 75.0, 90.0, 120.0, 150.0, 180.0])
ASIDE_RAD: Floats = np.concatenate([[0.0], _ASIDE, -_ASIDE[:-1]])
"""The sampled directions, relative to the wanted one."""
SHARES = (1.0, 0.5)
"""The sampled speeds, as shares of the wanted one."""
CHOICES = len(ASIDE_RAD) * len(SHARES) + 1
"""The last one is to stand."""


def choices(bearing_rad: Floats, speed_m_s: Floats) -> tuple[Floats, Floats]:
    """What each robot could do: (n, CHOICES) directions in the arena [rad], and speeds [m/s].

    Args:
        bearing_rad: (n,) where each wants to go, arena frame.
        speed_m_s: (n,) how fast.
    """
    count = len(bearing_rad)
    directions = np.zeros((count, CHOICES))
    speeds = np.zeros((count, CHOICES))
    wide = len(ASIDE_RAD)
    for number, share in enumerate(SHARES):
        part = slice(number * wide, (number + 1) * wide)
        directions[:, part] = bearing_rad[:, np.newaxis] + ASIDE_RAD
        speeds[:, part] = share * speed_m_s[:, np.newaxis]
    return directions, speeds


def predict(poses: Floats, directions: Floats, speeds: Floats, reach_m: Floats) -> Floats:
    """Predicts the positions of robots: (n, k, HORIZON_STEPS, 2) x_m, y_m.

    Args:
        poses: (n, 3) x_m, y_m, yaw_rad.
        directions, speeds: (n, k), see `choices`; with speed 0 a robot does not even turn.
        reach_m: (n,) how far each drives, then it stands.
    """
    yaw = np.repeat(poses[:, 2:3], directions.shape[1], axis=1)
    x, y = (np.repeat(poses[:, i : i + 1], directions.shape[1], axis=1) for i in (0, 1))
    places = np.empty((*directions.shape, HORIZON_STEPS, 2))
    moves = speeds > 0.0
    left = np.repeat(reach_m[:, np.newaxis], directions.shape[1], axis=1)
    for step in range(HORIZON_STEPS):
        aside = wrap_angle(directions - yaw)
        turn = np.clip(TURN_RATE_PER_S * aside, -TURN_MAX_RAD_S, TURN_MAX_RAD_S) * STEP_S
        ahead = speeds * np.maximum(0.0, 1.0 - np.abs(aside) / NARROW_RAD) * STEP_S
        ahead = np.minimum(ahead, left)
        left = left - ahead
        middle = yaw + np.where(moves, turn, 0.0) / 2.0
        x, y = x + ahead * np.cos(middle), y + ahead * np.sin(middle)
        yaw = yaw + np.where(moves, turn, 0.0)
        places[..., step, 0], places[..., step, 1] = x, y
    return places


def carrot_m(speed_m_s: float) -> float:
    """How far away a goal must lie that a robot is to drive to with this speed."""
    return speed_m_s / RATE_PER_S


def braked_m_s(distance_m: float) -> float:
    """How fast the daemon drives to a goal."""
    return min(MAX_M_S, RATE_PER_S * distance_m)


def in_frame(pose: tuple[float, float, float], x_m: float, y_m: float) -> tuple[float, float]:
    """A point as a robot sees it: ahead, and to its left [m]."""
    dx, dy = x_m - pose[0], y_m - pose[1]
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    return dx * cosine + dy * sine, dy * cosine - dx * sine


COLLISION_STEPS = 4
"""A collision within so many predicted steps (1 s) is ruled out."""
COLLISION_COST_M = 1.0
"""Cost of a later collision, as a length of path; it falls linearly to 0 at the horizon."""
TRAFFIC_CLEARANCE_M, CLEARANCE_COST_M = 0.03, 0.1
"""Wanted clearance, and the cost of having none. Near a target with less clearance, that one is
wanted."""
HYSTERESIS = 0.1
MAX_HYSTERESIS_M = 0.02
"""Cost of another direction than the last one, as a share of the path, and at most."""
OVERLAP_TOLERANCE_M = 0.002
"""Where the distance is too small already, it may shrink by so much."""
STAND = CHOICES - 1


@dataclass(slots=True)
class Traffic:
    """n robots at one moment.

    Attributes:
        poses: (n, 3) x_m, y_m, yaw_rad.
        moves: (n,) whether it can drive; all others stand.
        targets: (n, 2) the next point of its path, in line of sight.
        speeds: (n,) wanted [m/s]; that of a robot at its target is low, for making way.
        reach_m: (n,) the longest drive.
        order: rows by priority, the highest first.
        apart_m: (n, n) the least distance of two centres.
        room_m: (n,) the least distance of a centre from walls.
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
    """Chosen directions [rad] and speeds [m/s], (n,), and whether they are the wanted ones."""

    headings: Floats
    speeds: Floats
    wanted: NDArray[np.bool_]


def decide(traffic: Traffic, floor: DrivingFloor) -> Decision:
    """Chooses a direction and a speed for every robot."""
    poses = traffic.poses
    count = len(poses)
    away = traffic.targets - poses[:, :2]
    directions, speeds = choices(np.arctan2(away[:, 1], away[:, 0]), traffic.speeds)
    paths = predict(poses, directions, speeds, traffic.reach_m)
    costs = _own_costs(traffic, directions, speeds, paths)
    wall_gaps = _wall_gaps(traffic, floor, paths)
    driven = np.where(traffic.moves, traffic.driven, 0.0)
    before = traffic.headings[:, np.newaxis], driven[:, np.newaxis]
    predicted = predict(poses, *before, traffic.reach_m)[:, 0]
    waiting = traffic.moves & (driven > 0.0)
    chosen = np.full(count, STAND)
    for robot in traffic.order:
        if not traffic.moves[robot]:
            continue
        gaps = _robot_gaps(traffic, robot, paths[robot], predicted)
        # Robots that decide later will make way, but not at once.
        gaps[:, waiting, COLLISION_STEPS:] = math.inf
        clearance_m = _clearance_m(traffic, robot, floor)
        cost = costs[robot] + _contact_costs(
            np.minimum(gaps.min(axis=1), wall_gaps[robot]), clearance_m
        )
        chosen[robot] = int(np.argmin(cost))
        predicted[robot] = paths[robot, chosen[robot]]
        waiting[robot] = False
    rows = np.arange(count)
    return Decision(directions[rows, chosen], speeds[rows, chosen], chosen == 0)


def _own_costs(traffic: Traffic, directions: Floats, speeds: Floats, paths: Floats) -> Floats:
    """(n, CHOICES) distance to the target at the horizon, plus the cost of a change."""
    left_m = np.hypot(*(paths[:, :, -1] - traffic.targets[:, np.newaxis]).transpose(2, 0, 1))
    turned = np.abs(wrap_angle(directions - traffic.headings[:, np.newaxis]))
    changed = np.where(speeds > 0.0, np.minimum(turned, 1.0), 1.0)
    far_m = np.hypot(*(traffic.targets - traffic.poses[:, :2]).T)
    hysteresis_m = np.where(
        traffic.driven > 0.0, np.minimum(HYSTERESIS * far_m, MAX_HYSTERESIS_M), 0.0
    )
    return np.asarray(left_m + hysteresis_m[:, np.newaxis] * changed)


def _wall_gaps(traffic: Traffic, floor: DrivingFloor, paths: Floats) -> Floats:
    """(n, CHOICES, HORIZON_STEPS) distance from walls beyond the least one."""
    free = floor.clearance_m(paths) - traffic.room_m[:, np.newaxis, np.newaxis]
    now = floor.clearance_m(traffic.poses[:, :2]) - traffic.room_m
    return _tolerating_overlap(free, now[:, np.newaxis, np.newaxis])


def _robot_gaps(traffic: Traffic, robot: int, paths: Floats, predicted: Floats) -> Floats:
    """(CHOICES, n, HORIZON_STEPS) distance from each other robot beyond the least one."""
    apart = paths[:, np.newaxis] - predicted[np.newaxis]
    gaps = np.hypot(apart[..., 0], apart[..., 1]) - traffic.apart_m[robot][:, np.newaxis]
    here = traffic.poses[:, :2] - traffic.poses[robot, :2]
    now = np.hypot(here[:, 0], here[:, 1]) - traffic.apart_m[robot]
    gaps = _tolerating_overlap(gaps, now[np.newaxis, :, np.newaxis])
    gaps[:, robot] = math.inf
    return gaps


def _tolerating_overlap(gaps: Floats, now: Floats) -> Floats:
    """Allows what keeps the present distance, where that is too small already."""
    return np.where(now < 0.0, gaps - now + OVERLAP_TOLERANCE_M, gaps)


def _clearance_m(traffic: Traffic, robot: int, floor: DrivingFloor) -> float:
    """The clearance that a robot wants on its way to its target."""
    target = traffic.targets[robot]
    away = np.hypot(*(traffic.poses[:, :2] - target).T) - traffic.apart_m[robot]
    away[robot] = math.inf
    wall_m = float(floor.clearance_m(target)) - float(traffic.room_m[robot])
    return max(0.001, min(TRAFFIC_CLEARANCE_M, wall_m, float(away.min())))


def _contact_costs(gaps: Floats, clearance_m: float) -> Floats:
    """(CHOICES,) cost of collisions and of missing clearance; gaps (CHOICES, HORIZON_STEPS)."""
    touches = gaps < 0.0
    first = np.where(touches.any(axis=1), touches.argmax(axis=1), HORIZON_STEPS)
    nearest = gaps.min(axis=1)
    soon = gaps[:, :COLLISION_STEPS].min(axis=1)
    collision = COLLISION_COST_M * (HORIZON_STEPS - first) / HORIZON_STEPS
    clearance = CLEARANCE_COST_M * np.clip((clearance_m - nearest) / TRAFFIC_CLEARANCE_M, 0.0, 1.0)
    return np.asarray(np.where(first < COLLISION_STEPS, 1e3 - soon, collision + clearance))
