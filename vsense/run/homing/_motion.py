"""How a robot moves that is given a goal: a model of the daemon's law.

The numbers are those of `robot/homing.c`, which turns the wheels; here is what the planner expects
of it over the next seconds, for many robots and many choices at once.
"""

from __future__ import annotations

import math

import numpy as np

from vsense.base.arena import Floats, wrap_angle

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
