"""AprilTag 3 (pupil-apriltags) as a contestant, in a process of its own.

It has been seen to crash its process when it ends, and it must not take the benchmark with it.
This module is both ends: the parent sends a line for each pass and gets one JSON line back.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsense.bench.contestants import Found
from vsense.bench.frames import FrameSet

_OFFSET_PX = 0.5
"""AprilTag counts pixels from their upper left corner, not from their middle."""


def is_installed() -> bool:
    """Tells whether pupil-apriltags can take part."""
    return importlib.util.find_spec("pupil_apriltags") is not None


class AprilTag:
    """AprilTag 3 on pictures of tag36h11."""

    def __init__(self, name: str, frames: FrameSet, decimate: float, threads: int) -> None:
        """Starts the process."""
        self.name, self.frames, self.threads = name, frames, threads
        self._folder = tempfile.TemporaryDirectory(prefix="vsense-bench-")
        pictures = Path(self._folder.name) / "pictures.npy"
        np.save(pictures, np.array(frames.images))
        self._process = subprocess.Popen(
            [sys.executable, "-m", "vsense.bench.apriltag", pictures, str(decimate), str(threads)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )

    def run(self) -> tuple[list[float], list[Found]]:
        """Does one pass over the pictures; nothing is found where the process has crashed."""
        assert self._process.stdin is not None and self._process.stdout is not None
        try:
            self._process.stdin.write("\n")
            self._process.stdin.flush()
            answer: dict[str, Any] = json.loads(self._process.stdout.readline())
        except (BrokenPipeError, json.JSONDecodeError):
            return [], []
        found = [
            Found(
                np.array(tags, dtype=np.int64),
                np.array(centres, dtype=np.float64).reshape(-1, 2) - _OFFSET_PX,
            )
            for tags, centres in answer["found"]
        ]
        return answer["ms"], found

    def close(self) -> None:
        """Ends the process, in whatever way it likes to end."""
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.close()
        self._process.wait()
        self._process.stdout.close()
        self._folder.cleanup()


def _serve(pictures: NDArray[np.uint8], decimate: float, threads: int) -> None:
    """Answers each line on standard input with one pass over the pictures."""
    module = importlib.import_module("pupil_apriltags")
    detector = module.Detector(families="tag36h11", nthreads=threads, quad_decimate=decimate)
    for _ in sys.stdin:
        times, found = [], []
        for picture in pictures:
            begin = time.perf_counter()
            seen = detector.detect(picture)
            times.append(1e3 * (time.perf_counter() - begin))
            found.append(([tag.tag_id for tag in seen], [tag.center.tolist() for tag in seen]))
        print(json.dumps({"ms": times, "found": found}), flush=True)


if __name__ == "__main__":
    _serve(np.load(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3]))
