"""Rigid motions: turns, poses of bodies, and the arena frame moved over a calibrated rig.

A calibration says well where the cameras are to each other, and less well where the arena is: that
is as good as the first board was laid. The one can be moved without touching the other: all cameras
turn about the vertical and shift along the floor together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from vsense.base.arena import Floats
from vsense.vision.cameras.camera import Camera


@dataclass(frozen=True, slots=True)
class FrameShift:
    """From one arena frame to another: a turn about the vertical, then a shift along the floor."""

    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float = 0.0

    @classmethod
    def between(cls, places: Floats, wanted: Floats) -> FrameShift:
        """Returns the shift that takes (n, 2) places nearest to others, in least squares.

        One place tells no turn, and gets none; several need not be in one spot.

        Source: Umeyama, Least-squares estimation of transformation parameters, 1991, in the plane.
        """
        middle, goal = places.mean(axis=0), wanted.mean(axis=0)
        (x, y), (u, v) = (places - middle).T, (wanted - goal).T
        yaw = math.atan2(float(np.sum(x * v - y * u)), float(np.sum(x * u + y * v)))
        left = goal - cls(0.0, 0.0, yaw).apply(middle[np.newaxis])[0]
        return cls(float(left[0]), float(left[1]), yaw)

    def apply(self, places: Floats) -> Floats:
        """Carries (n, 2) places over."""
        cos, sin = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        turn = np.array(((cos, -sin), (sin, cos)))
        return np.asarray(places @ turn.T + (self.x_m, self.y_m))

    def moved(self, camera: Camera) -> Camera:
        """Returns a camera whose places are in the other frame."""
        cos, sin = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        about = np.array(((cos, -sin, 0.0), (sin, cos, 0.0), (0.0, 0.0, 1.0)))
        x, y = self.apply(np.array([camera.position_m[:2]]))[0].tolist()
        rotation = np.reshape(camera.rotation, (3, 3)) @ about.T
        return replace(
            camera,
            rotation=tuple(rotation.ravel().tolist()),
            position_m=(x, y, camera.position_m[2]),
        )

    def in_words(self) -> str:
        """The shift for people; of a turn it is said about which point."""
        shift = f"{1e3 * self.x_m:+.1f} mm along x, {1e3 * self.y_m:+.1f} mm along y"
        return f"{shift}, turned by {math.degrees(self.yaw_rad):+.3f} deg about the old origin"


def turn(vectors: Floats) -> Floats:
    """Returns (n, 3, 3) rotations by the (n, 3) vectors, direction the axis, length the angle.

    Source: Rodrigues' formula.
    """
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    axis = vectors / np.maximum(angle[:, :, 0], 1e-300)
    cross = np.zeros((len(vectors), 3, 3))
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -axis[:, 2], axis[:, 1], -axis[:, 0]
    cross -= np.transpose(cross, (0, 2, 1))
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross)


@dataclass(frozen=True, slots=True)
class BoardPose:
    """A body's pose: `turn` (3, 3) @ point + `shift` (3,) [m] takes its points to another frame."""

    turn: Floats
    shift: Floats

    def inverse(self) -> BoardPose:
        """Returns the inverse transform."""
        return BoardPose(self.turn.T, -self.turn.T @ self.shift)

    def after(self, first: BoardPose) -> BoardPose:
        """Returns this transform applied after another."""
        return BoardPose(self.turn @ first.turn, self.turn @ first.shift + self.shift)

    def apply(self, points: Floats) -> Floats:
        """Transforms (n, 3) points."""
        return np.asarray(points @ self.turn.T + self.shift)
