"""Tracks: what is known of one robot from timestep to timestep.

A track believes a sighting only where the robot can have driven since it was last seen. A robot
that is not seen is carried on at its last velocity for a moment, then held, with an age and a
covariance that grow and a confidence that falls, and in the end it is forgotten.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsense.tracking.views import HEIGHT_DOUBT_M, Sighting
from vsense.tracking.views import covariances as view_covariances

_NEW_VELOCITY = 0.6
_HELD_SHARE = 0.3
_ANY_YAW = math.pi**2 / 3.0
"""Variance of a heading of which nothing is known."""


@dataclass(frozen=True, slots=True)
class Limits:
    """What a track believes.

    Attributes:
        max_speed_m_s: Greatest speed of a robot (0.25: an e-puck drives 0.13, with a margin).
        slack_m: Added to how far a robot can have come (0.02: noise, and being pushed).
        insist: Timesteps after which sightings out of reach, but consistent with each other,
            are believed after all: a robot was picked up and set down elsewhere (3).
        carry_s: How long a robot that is not seen is carried on at its last velocity (0.3).
        fade_s: Time constant of the confidence of a robot that is not seen (1.0).
        forget_s: Age at which a robot is left out of the arena state (5.0).
        height_doubt_m: Standard deviation of the markers' heights (0.002).
        speed_doubt: How far off a robot is found where it is carried on, as a share of its
            greatest speed: robots turn, stop and start without a warning (0.2).
        turn_doubt_rad_s: The same for its heading, per second (1.5).
    """

    max_speed_m_s: float = 0.25
    slack_m: float = 0.02
    insist: int = 3
    carry_s: float = 0.3
    fade_s: float = 1.0
    forget_s: float = 5.0
    height_doubt_m: float = HEIGHT_DOUBT_M
    speed_doubt: float = 0.2
    turn_doubt_rad_s: float = 1.5


class Track:
    """One robot: `last` is the sighting believed last, `seen` whether in the newest timestep."""

    def __init__(self, first: Sighting) -> None:
        self._start(first)

    def _start(self, first: Sighting) -> None:
        self.last = first
        self.seen = True
        self._trust = 1.0
        self._velocity = (0.0, 0.0)
        self._turn_rad_s = 0.0
        self._stray: Sighting | None = None
        self._strays = 0

    def update(self, sightings: Sequence[Sighting], limits: Limits) -> int:
        """Believes the one sighting that can be this robot, if there is exactly one.

        `sightings` are the tag's in this timestep. Returns how many were out of reach.
        """
        reachable = [s for s in sightings if _reaches(self.last, s, limits)]
        self.seen = len(reachable) == 1
        if self.seen:
            self._believe(reachable[0])
            self._trust = 1.0 if len(sightings) == 1 else 0.5
            self._stray, self._strays = None, 0
        elif len(sightings) == 1:
            self._doubt(sightings[0], limits)
        return len(sightings) - len(reachable)

    def _believe(self, sighting: Sighting) -> None:
        last, (old_vx, old_vy) = self.last, self._velocity
        elapsed = 1e-9 * (sighting.capture_ns - last.capture_ns)
        if elapsed > 0.0:
            keep = 1.0 - _NEW_VELOCITY
            vx, vy = (sighting.x_m - last.x_m) / elapsed, (sighting.y_m - last.y_m) / elapsed
            self._velocity = keep * old_vx + _NEW_VELOCITY * vx, keep * old_vy + _NEW_VELOCITY * vy
            turn = math.remainder(sighting.yaw_rad - last.yaw_rad, math.tau) / elapsed
            self._turn_rad_s = keep * self._turn_rad_s + _NEW_VELOCITY * turn
        self.last = sighting

    def _doubt(self, sighting: Sighting, limits: Limits) -> None:
        """Counts sightings out of reach, and starts again where they insist."""
        agrees = self._stray is not None and _reaches(self._stray, sighting, limits)
        self._strays = self._strays + 1 if agrees else 1
        self._stray = sighting
        if self._strays >= limits.insist:
            self._start(sighting)

    @property
    def speed_m_s(self) -> float:
        """Speed over ground, smoothed over about two timesteps."""
        return math.hypot(*self._velocity)

    def pose(self, now_ns: int, limits: Limits) -> tuple[float, float, float]:
        """Returns where the robot is taken to be at `now_ns`: x, y [m] and yaw [rad]."""
        ahead = min(self.age_s(now_ns), limits.carry_s)
        if ahead == 0.0:
            return self.last.x_m, self.last.y_m, self.last.yaw_rad
        yaw = math.remainder(self.last.yaw_rad + ahead * self._turn_rad_s, math.tau)
        return (
            self.last.x_m + ahead * self._velocity[0],
            self.last.y_m + ahead * self._velocity[1],
            yaw if yaw > -math.pi else math.pi,
        )

    def age_s(self, now_ns: int) -> float:
        """Returns how long ago it was seen, at `now_ns`."""
        return max(1e-9 * (now_ns - self.last.capture_ns), 0.0)

    def confidence(self, now_ns: int, limits: Limits) -> float:
        """Returns the confidence at `now_ns`, in [0, 1]."""
        if self.seen:
            return self._trust
        return self._trust * math.exp(-self.age_s(now_ns) / limits.fade_s)


def covariances(tracks: Sequence[Track], now_ns: int, limits: Limits) -> NDArray[np.float64]:
    """Returns the covariances of the errors of tracks' poses, (n, 3, 3): x, y [m] and yaw [rad].

    They are the pictures', and what the robots may have done since. Where a robot is held after
    having been carried on, it may have driven on or not.
    """
    covariance = view_covariances([track.last for track in tracks])
    age = np.array([track.age_s(now_ns) for track in tracks])
    held = np.maximum(age - limits.carry_s, 0.0)
    gone = limits.max_speed_m_s * (limits.speed_doubt * age + _HELD_SHARE * held)
    covariance[:, 0, 0] += gone**2
    covariance[:, 1, 1] += gone**2
    turned = (limits.turn_doubt_rad_s * age) ** 2
    covariance[:, 2, 2] = np.minimum(covariance[:, 2, 2] + turned, _ANY_YAW)
    return covariance


def _reaches(last: Sighting, now: Sighting, limits: Limits) -> bool:
    elapsed = max(1e-9 * (now.capture_ns - last.capture_ns), 0.0)
    distance = math.hypot(now.x_m - last.x_m, now.y_m - last.y_m)
    return distance <= limits.slack_m + limits.max_speed_m_s * elapsed
