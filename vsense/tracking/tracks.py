"""Tracks: what is known of one robot from timestep to timestep.

A track believes a sighting only where the robot can have driven since it was last seen. A
robot that is not seen is carried on at its last velocity for a moment, then held, with an age
that grows and a confidence that falls, and in the end it is forgotten.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from vsense.tracking.views import Sighting

_NEW_VELOCITY = 0.6


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
    """

    max_speed_m_s: float = 0.25
    slack_m: float = 0.02
    insist: int = 3
    carry_s: float = 0.3
    fade_s: float = 1.0
    forget_s: float = 5.0


class Track:
    """One robot.

    Attributes:
        last: The sighting believed last.
        seen: Whether it was believed in the newest timestep.
    """

    def __init__(self, first: Sighting) -> None:
        """Starts a track where its robot was seen."""
        self._start(first)

    def _start(self, first: Sighting) -> None:
        self.last = first
        self.seen = True
        self._trust = 1.0
        self._velocity = (0.0, 0.0)
        self._stray: Sighting | None = None
        self._strays = 0

    def update(self, sightings: Sequence[Sighting], limits: Limits) -> int:
        """Believes the one sighting that can be this robot, if there is exactly one.

        Args:
            sightings: The tag's sightings in this timestep; more than one means duplicates.
            limits: What to believe.

        Returns:
            How many sightings were out of reach.
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
        elapsed = 1e-9 * (sighting.capture_ns - self.last.capture_ns)
        if elapsed > 0.0:
            keep = 1.0 - _NEW_VELOCITY
            vx = (sighting.x_m - self.last.x_m) / elapsed
            vy = (sighting.y_m - self.last.y_m) / elapsed
            self._velocity = (
                keep * self._velocity[0] + _NEW_VELOCITY * vx,
                keep * self._velocity[1] + _NEW_VELOCITY * vy,
            )
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

    def position_m(self, now_ns: int, limits: Limits) -> tuple[float, float]:
        """Returns where the robot is taken to be at `now_ns`."""
        if self.seen:
            return self.last.x_m, self.last.y_m
        ahead = min(max(1e-9 * (now_ns - self.last.capture_ns), 0.0), limits.carry_s)
        return (
            self.last.x_m + ahead * self._velocity[0],
            self.last.y_m + ahead * self._velocity[1],
        )

    def confidence(self, now_ns: int, limits: Limits) -> float:
        """Returns the confidence at `now_ns`, in [0, 1]."""
        if self.seen:
            return self._trust
        age = max(1e-9 * (now_ns - self.last.capture_ns), 0.0)
        return self._trust * math.exp(-age / limits.fade_s)


def _reaches(last: Sighting, now: Sighting, limits: Limits) -> bool:
    elapsed = max(1e-9 * (now.capture_ns - last.capture_ns), 0.0)
    distance = math.hypot(now.x_m - last.x_m, now.y_m - last.y_m)
    return distance <= limits.slack_m + limits.max_speed_m_s * elapsed
