"""Tracks: what is known of one robot from timestep to timestep.

A track believes a sighting only where the robot can have driven since it was last seen. A robot
that is not seen is carried on at its last velocity for a moment, then held, with an age and a
covariance that grow and a confidence that falls, and in the end it is forgotten.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import POSE, Floats, wrap_angle
from vsense.vision.tracking._rows import is_in
from vsense.vision.tracking._views import HEIGHT_DOUBT_M, VIEW, covariances

_LATER_S = 0.1
"""So much later than its picture a row may be exposed."""
_NEW_VELOCITY = 0.6
_LEAST_ELAPSED_S = 0.004
"""Between two sightings: in less a marker's error alone is a speed of metres per second."""
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


TRACK = np.dtype(
    [
        ("last", VIEW),
        ("seen", "?"),
        ("trust", "f8"),
        ("velocity_m_s", "f8", (2,)),
        ("turn_rad_s", "f8"),
        ("strays", "i8"),
        ("stray", VIEW),
    ]
)
"""One robot: `last` is the sighting believed last, `seen` whether in the newest timestep, `trust`
its confidence then; `velocity_m_s` and `turn_rad_s` are smoothed over about two timesteps; `strays`
counts sightings out of reach that were consistent with each other, `stray` is the last of them.
"""


class RobotTracks:
    """All robots' tracks: `rows`, (n,) TRACK sorted by tag."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self.rows: NDArray[np.void] = np.zeros(0, dtype=TRACK)

    def update(self, sightings: NDArray[np.void]) -> int:
        """Takes a timestep's sightings, (n,) VIEW sorted by tag.

        Each track believes the one sighting that can be its robot, if there is exactly one.
        Returns how many were out of reach.
        """
        tags, tracked = sightings["tag"], self.rows["last"]["tag"]
        begin, end = np.searchsorted(tags, tracked), np.searchsorted(tags, tracked, "right")
        self.rows["seen"] = False
        once = np.flatnonzero(end - begin == 1)
        now = sightings[begin[once]]
        near = _reaches(self.rows["last"][once], now, self._limits)
        self._believe(once[near], now[near], 1.0)
        self._doubt(once[~near], now[~near])
        strange = int(np.count_nonzero(~near))
        for row in np.flatnonzero(end - begin > 1).tolist():
            places = sightings[begin[row] : end[row]]
            reachable = places[_reaches(self.rows["last"][[row]], places, self._limits)]
            if len(reachable) == 1:
                self._believe(np.array([row]), reachable, 0.5)
            strange += len(places) - len(reachable)
        if len(new := sightings[~is_in(tags, tracked)]):
            self._begin(new)
        return strange

    def forget(self, now_ns: int) -> None:
        """Drops the robots that were not seen for too long."""
        oldest_ns = now_ns - round(1e9 * self._limits.forget_s)
        self.rows = self.rows[self.rows["last"]["capture_ns"] >= oldest_ns]

    def poses(self, now_ns: int) -> NDArray[np.void]:
        """Returns where the robots are taken to be at `now_ns`, (n,) POSE sorted by tag."""
        rows, last = self.rows, self.rows["last"]
        poses = np.zeros(len(rows), dtype=POSE)
        age_s = self._age_s(now_ns)
        ahead_s = np.minimum(age_s, self._limits.carry_s)
        poses["tag"] = last["tag"]
        poses["x_m"] = last["x_m"] + ahead_s * rows["velocity_m_s"][:, 0]
        poses["y_m"] = last["y_m"] + ahead_s * rows["velocity_m_s"][:, 1]
        carried = wrap_angle(last["yaw_rad"] + ahead_s * rows["turn_rad_s"])
        poses["yaw_rad"] = np.where(ahead_s != 0.0, carried, last["yaw_rad"])
        poses["speed_m_s"] = np.hypot(*rows["velocity_m_s"].T)
        poses["capture_ns"] = last["capture_ns"]
        poses["age_ns"] = np.maximum(now_ns - last["capture_ns"], 0)
        faded = rows["trust"] * np.exp(-age_s / self._limits.fade_s)
        poses["confidence"] = np.where(rows["seen"], rows["trust"], faded)
        poses["cameras"] = np.where(rows["seen"], last["cameras"], 0)
        poses["seen"] = rows["seen"]
        poses["covariance"] = self._covariances(age_s)
        return poses

    def _age_s(self, now_ns: int) -> Floats:
        """Returns how long ago the robots were seen, (n,); less than 0 in a row that came later."""
        return np.maximum(1e-9 * (now_ns - self.rows["last"]["capture_ns"]), -_LATER_S)

    def _covariances(self, age_s: Floats) -> Floats:
        """Returns the covariances of the errors of the poses, (n, 3, 3): x, y [m] and yaw [rad].

        They are the pictures', and what the robots may have done since. Where a robot is held after
        having been carried on, it may have driven on or not.
        """
        limits, covariance = self._limits, covariances(self.rows["last"])
        age_s = np.abs(age_s)
        held = np.maximum(age_s - limits.carry_s, 0.0)
        gone = limits.max_speed_m_s * (limits.speed_doubt * age_s + _HELD_SHARE * held)
        covariance[:, 0, 0] += gone**2
        covariance[:, 1, 1] += gone**2
        turned = (limits.turn_doubt_rad_s * age_s) ** 2
        covariance[:, 2, 2] = np.minimum(covariance[:, 2, 2] + turned, _ANY_YAW)
        return covariance

    def _begin(self, sightings: NDArray[np.void]) -> None:
        """Begins a track of each tag that is at one place only."""
        tags, counts = np.unique(sightings["tag"], return_counts=True)
        new = sightings[is_in(sightings["tag"], tags[counts == 1])]
        rows = np.concatenate((self.rows, _new_tracks(new)))
        self.rows = rows[np.argsort(rows["last"]["tag"])]

    def _believe(self, rows: NDArray[np.intp], now: NDArray[np.void], trust: float) -> None:
        """Takes a sighting of each of some tracks; both in the same order."""
        tracks = self.rows[rows]
        last = tracks["last"]
        elapsed = 1e-9 * (now["capture_ns"] - last["capture_ns"])
        moved = elapsed >= _LEAST_ELAPSED_S
        way = np.stack((now["x_m"] - last["x_m"], now["y_m"] - last["y_m"]), axis=-1)
        turn = wrap_angle(now["yaw_rad"] - last["yaw_rad"])
        keep, since = 1.0 - _NEW_VELOCITY, np.where(moved, elapsed, 1.0)
        velocity = keep * tracks["velocity_m_s"] + _NEW_VELOCITY * (way / since[:, np.newaxis])
        most = self._limits.max_speed_m_s
        velocity *= (most / np.maximum(np.hypot(*velocity.T), most))[:, np.newaxis]
        tracks["velocity_m_s"] = np.where(moved[:, np.newaxis], velocity, tracks["velocity_m_s"])
        turning = keep * tracks["turn_rad_s"] + _NEW_VELOCITY * (turn / since)
        tracks["turn_rad_s"] = np.where(moved, turning, tracks["turn_rad_s"])
        tracks["last"], tracks["trust"], tracks["seen"], tracks["strays"] = now, trust, True, 0
        self.rows[rows] = tracks

    def _doubt(self, rows: NDArray[np.intp], now: NDArray[np.void]) -> None:
        """Counts sightings out of reach, and starts again where they insist."""
        tracks = self.rows[rows]
        agrees = (tracks["strays"] > 0) & _reaches(tracks["stray"], now, self._limits)
        tracks["strays"] = np.where(agrees, tracks["strays"] + 1, 1)
        tracks["stray"] = now
        insists = tracks["strays"] >= self._limits.insist
        tracks[insists] = _new_tracks(now[insists])
        self.rows[rows] = tracks


def _new_tracks(sightings: NDArray[np.void]) -> NDArray[np.void]:
    tracks = np.zeros(len(sightings), dtype=TRACK)
    tracks["last"], tracks["seen"], tracks["trust"] = sightings, True, 1.0
    return tracks


def _reaches(last: NDArray[np.void], now: NDArray[np.void], limits: Limits) -> NDArray[np.bool_]:
    """Whether robots can have come from where they were last to where they are now, (n,) VIEW."""
    elapsed = np.maximum(1e-9 * (now["capture_ns"] - last["capture_ns"]), 0.0)
    distance = np.hypot(now["x_m"] - last["x_m"], now["y_m"] - last["y_m"])
    return np.asarray(distance <= limits.slack_m + limits.max_speed_m_s * elapsed)
