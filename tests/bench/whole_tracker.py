"""The whole tracker: 16 cameras with 20 robots each, from pictures to arena state.

Every picture of every timestep is searched. Beside it the same pictures are only searched by the
kernel, in C: what the tracker takes more is Python's.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tests.bench.frames import FRAMES_PER_S, MARKER_M, SPEED_M_S, MovingStudio, cameras, crowd
from vsense.base.arena import Frame, Image
from vsense.vision.markers.families import load_family
from vsense.vision.tracking._prediction import MarkerSearch
from vsense.vision.tracking._workers import Kernels, Picture, Workers
from vsense.vision.tracking.arena_tracker import ArenaTracker

CAMERAS = (4, 4)
PER_CAMERA = 20
WORKERS = 2

_SEED = 5
_PERIOD_NS = round(1e9 / FRAMES_PER_S)


@dataclass(slots=True)
class _Spent:
    """Milliseconds of each timestep: in all, on all processors, and on them for the search."""

    wall: list[float]
    cpu: list[float]
    search: list[float]


class WholeTracker:
    """One family's robots in all cameras, as they drive ahead and back again."""

    def __init__(self, family: str, tags: Sequence[int], steps: int) -> None:
        """Renders `steps` timesteps of robots with `tags`, 20 below each camera."""
        self._rig = cameras(*CAMERAS)
        rng, below = np.random.default_rng(_SEED), []
        for camera in self._rig:
            below.append(crowd(rng, PER_CAMERA) + np.array([*camera.position_m[:2], 0.0]))
        poses = np.concatenate(below)
        ahead = np.stack((np.cos(poses[:, 2]), np.sin(poses[:, 2]), 0.0 * poses[:, 2]), axis=1)
        studio = MovingStudio(family, tags, self._rig, _SEED)
        self._images: list[Image] = []
        for step in range(steps):
            way = step * SPEED_M_S / FRAMES_PER_S
            self._images.append(studio.expose(step + 1, poses + way * ahead).copy())
        heights_m = dict.fromkeys(tags, MARKER_M)
        self._workers = Workers(WORKERS)
        made = load_family(family)
        self._kernels = Kernels(MarkerSearch(made, heights_m), self._workers)
        self._tracker = ArenaTracker.for_family(self._rig, made, heights_m)
        self._turns = enumerate(itertools.cycle([*range(steps), *range(steps - 2, 0, -1)]))
        self._robots = len(tags)
        self.spent = _Spent([], [], [])
        self.named: list[float] = []

    def run(self, timesteps: int, counts: bool) -> None:
        """Tracks so many timesteps; notes what they took, where it `counts`."""
        for timestep, place in itertools.islice(self._turns, timesteps):
            now_ns = timestep * _PERIOD_NS
            images = self._images[place]
            frames = [
                Frame(camera.id, image, timestep, now_ns, now_ns)
                for camera, image in zip(self._rig, images, strict=True)
            ]
            begin, cpu = time.perf_counter(), time.process_time()
            state = self._tracker.update(frames)
            wall, cpu = time.perf_counter() - begin, time.process_time() - cpu
            begin = time.process_time()
            self._kernels.begin([Picture(*one) for one in zip(images, self._rig, strict=True)])
            self._kernels.search()
            search = time.process_time() - begin
            if counts:
                self.spent.wall.append(1e3 * wall)
                self.spent.cpu.append(1e3 * cpu)
                self.spent.search.append(1e3 * search)
                self.named.append(float(state.robots["seen"].sum()) / self._robots)

    def close(self) -> None:
        """Ends the threads."""
        self._workers.close()
        self._tracker.close()


def report(arrows: WholeTracker, squares: WholeTracker) -> dict[str, Any]:
    """Returns `arrows_ms`, `squares_ms`, the medians of a timestep; their `arrows_cpu_ms` and
    `squares_cpu_ms`; `c_share`, of the arrows' processor time; and `named_share`, the least."""
    middle = {"arrows": arrows.spent, "squares": squares.spent}
    made: dict[str, Any] = {f"{n}_ms": float(np.median(s.wall)) for n, s in middle.items()}
    made |= {f"{n}_cpu_ms": float(np.median(s.cpu)) for n, s in middle.items()}
    made["c_share"] = float(np.median(arrows.spent.search)) / made["arrows_cpu_ms"]
    made["named_share"] = min(map(float, map(np.mean, (arrows.named, squares.named))))
    return made
