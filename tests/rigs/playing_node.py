"""`vsense camera node` whose cameras are folders of pictures, played for ever.

Run as a program, with options of its own and those of `vsense camera node`. Pictures come forwards
and backwards, one every period, dated by multiples of it: the players of one machine are in step,
as cameras that are triggered together.
"""

from __future__ import annotations

import argparse
import resource
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vsense.base.arena import Frame
from vsense.base.clock import host_ns
from vsense.base.errors import GrabberError, VsenseError
from vsense.base.terminal import Console
from vsense.tools.camera_setup.node import NodeOptions, run
from vsense.vision.cameras.picture import pictures_in, read_picture
from vsense.vision.tracking import node


class LoopPlayer:
    """A grabber that plays folders; a camera's `device` is one."""

    timesteps = None
    missed = 0

    def __init__(self, folders: Mapping[str, Path], period_ns: int, keep: bool) -> None:
        self._paths = {c: [f / name for name in pictures_in(f)] for c, f in folders.items()}
        self._period_ns, self._ended, self._turn = period_ns, threading.Event(), -1
        self._kept: dict[Path, np.ndarray] | None = {} if keep else None

    def next(self, timeout_s: float) -> Sequence[Frame]:
        turn = max(host_ns() // self._period_ns, self._turn) + 1
        wait_s = 1e-9 * (turn * self._period_ns - host_ns())
        if wait_s > timeout_s or self._ended.wait(max(wait_s, 0.0)):
            raise GrabberError("nothing was due")
        self._turn = turn
        frames = []
        for camera, paths in self._paths.items():
            order = [*range(len(paths)), *range(len(paths) - 2, 0, -1)]
            image = self._read(paths[order[turn % len(order)]])
            frames.append(
                Frame(camera, image, turn, CLOCK(turn * self._period_ns), CLOCK(host_ns()))
            )
        return frames

    def _read(self, path: Path) -> np.ndarray:
        if self._kept is None:
            return read_picture(path)
        if path not in self._kept:
            self._kept[path] = read_picture(path)
        return self._kept[path]

    def events(self) -> list[Any]:
        return []

    def close(self) -> None:
        self._ended.set()


CLOCK: Callable[[int], int] = lambda ns: ns  # noqa: E731


def main() -> int:
    global CLOCK
    parser = argparse.ArgumentParser()
    parser.add_argument("resources")
    parser.add_argument("--connect")
    parser.add_argument("--name")
    parser.add_argument("--config", type=Path)
    parser.add_argument("--period", type=float, default=0.1)
    parser.add_argument("--keep", action="store_true", help="decoded pictures stay in memory")
    parser.add_argument("--drift-ppm", type=float, default=0.0, help="of the node's clock")
    parser.add_argument("--ahead", type=float, default=0.0, help="of the node's clock [s]")
    parser.add_argument("--memory", type=int, default=0, help="bytes that may be added")
    words = parser.parse_args()
    begun_ns, per_ns = host_ns(), 1.0 + 1e-6 * words.drift_ppm

    def clock(ns: int) -> int:
        return round((ns - begun_ns) * per_ns) + begun_ns + round(1e9 * words.ahead)

    CLOCK = clock
    if words.memory:
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        most = pages * resource.getpagesize() + words.memory
        resource.setrlimit(resource.RLIMIT_AS, (most, most))

    def play(_: Any, grabbers: Any, *__: Any) -> LoopPlayer:
        folders = {camera: Path(spec.source) for camera, spec in grabbers.items()}
        return LoopPlayer(folders, round(1e9 * words.period), words.keep)

    node.live_grabber = play  # type: ignore[assignment]
    options = NodeOptions(words.resources, (words.connect,), words.name, config=words.config)
    try:
        return run(options, lambda: clock(host_ns()))
    except VsenseError as error:
        Console().say(f"vsense: {error}")
        return error.exit_code


if __name__ == "__main__":
    sys.exit(main())
