"""The pictures of a benchmark, rendered by the lab's studio, with what is truly in them.

All sets show the same floors, light and poses; only the markers differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vsense.modes.lab._bodies import Body
from vsense.modes.lab._camera_spec import LabCameraSpec, camera_at
from vsense.modes.lab._renderer import Studio
from vsense.vision.cameras.camera import Camera

Floats = NDArray[np.float64]
Image = NDArray[np.uint8]

MARKER_M = 0.06
"""Height of the markers above the floor."""
SPEED_M_S = 0.12
EXPOSURE_S = 0.010
FRAMES_PER_S = 15.0

_APART_M = 0.0715
_SPIN_RAD_S = np.radians(258.0)
_REACH_M = (1.02, 0.74)
"""Robots stay this near to the middle of a picture, so that their markers are whole in it."""
_PITCH_M = (2.0, 1.5)
_SEED = 3


@dataclass(frozen=True, slots=True)
class FrameTruth:
    """The markers (n,) in a picture, and their discs' centres (n, 2)."""

    tags: NDArray[np.int64]
    centres_px: Floats


@dataclass(frozen=True, slots=True)
class FrameSet:
    """Pictures (height, width) of one family's markers, each with its camera and its truth."""

    name: str
    family: str
    tags: tuple[int, ...]
    cameras: tuple[Camera, ...]
    images: tuple[Image, ...]
    truth: tuple[FrameTruth, ...]


def cameras(columns: int, rows: int) -> tuple[Camera, ...]:
    """Cameras that look straight down, side by side."""
    pitch_x_m, pitch_y_m = _PITCH_M
    return tuple(
        camera_at(f"cam_{column}_{row}", column * pitch_x_m, row * pitch_y_m)
        for row in range(rows)
        for column in range(columns)
    )


def crowd(rng: np.random.Generator, count: int, reach_m: tuple[float, float] = _REACH_M) -> Floats:
    """Poses (count, 3) around the middle of a picture; discs do not overlap."""
    poses: list[tuple[float, float, float]] = []
    while len(poses) < count:
        x, y = rng.uniform((-reach_m[0], -reach_m[1]), reach_m)
        if all(np.hypot(x - other[0], y - other[1]) > _APART_M for other in poses):
            poses.append((x, y, rng.uniform(-np.pi, np.pi)))
    return np.array(poses).reshape(-1, 3)


class RenderedSwarm:
    """Robots that drive ahead at full speed and spin now and then; none touches another.

    They stay within `reach_m` of the origin in x and y.
    """

    def __init__(self, count: int, seed: int, reach_m: tuple[float, float] = _REACH_M) -> None:
        self._rng = np.random.default_rng(seed)
        self._reach_m = reach_m
        self._poses = crowd(self._rng, count, reach_m)
        self._spinning = np.zeros(count, dtype=int)
        self._turn = np.zeros(count)

    def drive(self) -> Floats:
        """Moves all by the time of one picture; returns their poses, (count, 3)."""
        now, rng = self._poses, self._rng
        for k in range(len(now)):
            if self._spinning[k] == 0 and rng.random() < 0.05:
                self._spinning[k] = rng.integers(2, 8)
                self._turn[k] = rng.choice((-1.0, 1.0)) * _SPIN_RAD_S / FRAMES_PER_S
            if self._spinning[k] > 0:
                self._spinning[k] -= 1
                now[k, 2] += self._turn[k]
                continue
            step = SPEED_M_S / FRAMES_PER_S * np.array((np.cos(now[k, 2]), np.sin(now[k, 2])))
            place = now[k, :2] + step
            gaps = np.hypot(*(np.delete(now, k, axis=0)[:, :2] - place).T)
            if np.all(np.abs(place) < self._reach_m) and np.all(gaps > _APART_M):
                now[k, :2] = place
            else:
                self._spinning[k], self._turn[k] = 6, _SPIN_RAD_S / FRAMES_PER_S
        return np.array(now)


class MovingStudio:
    """Pictures of one family's markers on robots that drive ahead while they are exposed."""

    def __init__(self, family: str, tags: Sequence[int], rig: tuple[Camera, ...], seed: int):
        bodies = tuple(Body(tag, MARKER_M) for tag in tags)
        spec = LabCameraSpec(rig, (), bodies, family, 100_000_000, "", Path(), seed)
        self._studio = Studio(spec)
        self._images = np.empty(spec.shape, dtype=np.uint8)
        self._dark = np.zeros(len(tags), dtype=np.uint16)

    def expose(self, timestep: int, poses: Floats) -> Image:
        """Pictures (cameras, h, w) of robots at `poses` in mid-exposure, always in one array."""
        ahead = 0.5 * EXPOSURE_S * SPEED_M_S
        way = np.stack((np.cos(poses[:, 2]), np.sin(poses[:, 2]), np.zeros(len(poses))), axis=1)
        through = np.array([poses + share * ahead * way for share in (-0.67, 0.0, 0.67)])
        self._studio.prepare(timestep, self._images)
        self._studio.expose(timestep, through, self._dark, self._images)
        return self._images


class Painter:
    """Renders one family's pictures."""

    def __init__(self, name: str, family: str, tags: tuple[int, ...], rig: tuple[Camera, ...]):
        self._name, self._family, self._tags, self._rig = name, family, tags, rig
        self._studio = MovingStudio(family, tags, rig, _SEED)
        self._timestep = 0

    def crowds(self, count: int) -> FrameSet:
        """Pictures of the whole roster, each below another camera."""
        rng = np.random.default_rng(_SEED)
        shots = []
        for number in range(count):
            place = number % len(self._rig)
            poses = crowd(rng, len(self._tags))
            poses[:, :2] += self._rig[place].position_m[:2]
            shots.append(self._shoot(place, poses))
        return self._set(shots)

    def spread(self) -> FrameSet:
        """One picture of each camera, the roster spread out below all of them."""
        rng = np.random.default_rng(_SEED + 1)
        poses = crowd(rng, len(self._tags))
        below = np.arange(len(self._tags)) % len(self._rig)
        poses[:, :2] += np.array([self._rig[k].position_m[:2] for k in below])
        return self._set([self._shoot(number, poses) for number in range(len(self._rig))])

    def walk(self, count: int) -> FrameSet:
        """Pictures of the first camera in which the roster drives, turns and spins."""
        swarm = RenderedSwarm(len(self._tags), _SEED + 2)
        here = np.array((*self._rig[0].position_m[:2], 0.0))
        return self._set([self._shoot(0, swarm.drive() + here) for _ in range(count)])

    def _set(self, shots: list[tuple[Camera, Image, FrameTruth]]) -> FrameSet:
        rig, images, truth = zip(*shots, strict=True)
        return FrameSet(self._name, self._family, self._tags, rig, images, truth)

    def _shoot(self, number: int, poses: Floats) -> tuple[Camera, Image, FrameTruth]:
        """Takes a picture with one camera; all are at `poses` in mid-exposure."""
        self._timestep += 1
        images = self._studio.expose(self._timestep, poses)
        camera = self._rig[number]
        points = np.column_stack((poses[:, :2], np.full(len(poses), MARKER_M)))
        seen = camera.project(points)
        whole = camera.contains(seen, 30.0)
        truth = FrameTruth(np.array(self._tags)[whole], seen[whole])
        return camera, images[number].copy(), truth
