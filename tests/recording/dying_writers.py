"""Records in many processes and kills each at a random moment; run by test_crash.py.

Arguments: folder, how many, seed. For number N it leaves `N.mcap` and `N.said`: how many messages
had been published when the process died, when the last of them was, and for how long the machine
and its disk had held the process up. What they hold up cannot be on the disk in time.
"""

from __future__ import annotations

import mmap
import os
import random
import signal
import struct
import sys
import time
from pathlib import Path

import numpy as np

from vsense.arena import Frame
from vsense.message_bus import Message, MessageBus
from vsense.recording.recorder import Recorder

AT_ONCE = 10
SAID = struct.Struct("<qqq")
PERIOD_NS = 10_000_000


class Disk:
    """Measures how long the disk takes to have what was written."""

    def __init__(self) -> None:
        self._sync, self._taken_ns = os.fdatasync, 0
        self._since_ns: int | None = None
        os.fdatasync = self._measured

    def _measured(self, fd: int) -> None:
        self._since_ns = time.monotonic_ns()
        self._sync(fd)
        self._taken_ns += time.monotonic_ns() - self._since_ns
        self._since_ns = None

    def held_up_ns(self, now_ns: int) -> int:
        """All the time that it took so far; `now_ns` counts for what it has not answered yet."""
        since_ns = self._since_ns
        return self._taken_ns + (0 if since_ns is None else max(now_ns - since_ns, 0))


def live(folder: Path, number: int) -> None:
    """Publishes until the end."""
    path = folder / f"{number}.said"
    path.write_bytes(bytes(SAID.size))
    with path.open("r+b") as file:
        said = mmap.mmap(file.fileno(), SAID.size)
    bus = MessageBus()
    recorder = Recorder(bus, folder / f"{number}.mcap", pictures=True)
    image = np.random.default_rng(number).integers(0, 255, (60, 80), dtype=np.uint8)
    disk = Disk()
    count, late_ns, before_ns = 0, 0, time.monotonic_ns()
    while True:
        now_ns = time.monotonic_ns()
        late_ns += max(now_ns - before_ns - PERIOD_NS, 0)
        before_ns = now_ns
        bus.publish(Message("/arena", now_ns, {"n": count, "x_m": [0.1 * count] * 15}))
        count += 1
        said[:] = SAID.pack(count, now_ns, late_ns + disk.held_up_ns(now_ns))
        if count % 10 == 0:
            recorder.pictures([Frame("left", image, count, now_ns, now_ns)])
        time.sleep(PERIOD_NS / 1e9)


def main() -> None:
    """Kills them all, some at a time."""
    folder, number, seed = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    draw = random.Random(seed)
    for first in range(0, number, AT_ONCE):
        begun_s = time.monotonic()
        ends: list[tuple[float, int]] = []
        for each in range(first, min(first + AT_ONCE, number)):
            child = os.fork()
            if child == 0:
                try:
                    live(folder, each)
                finally:
                    os._exit(1)
            # Every fifth while its file is just being made.
            ends.append((draw.uniform(0.0, 0.05 if each % 5 == 0 else 2.0), child))
        for end_s, child in sorted(ends):
            time.sleep(max(begun_s + end_s - time.monotonic(), 0.0))
            os.kill(child, signal.SIGKILL)
            _, status = os.waitpid(child, 0)
            assert os.WTERMSIG(status) == signal.SIGKILL, "it must live until it is killed"


if __name__ == "__main__":
    main()
