"""Records in many processes and kills each at a random moment; run by test_crash.py.

Arguments: folder, how many, seed. For number N it leaves `N.mcap` and `N.said`: how many messages
had been published when the process died, and when the last of them was.
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

from vsense.base.arena import Frame
from vsense.base.clock import host_ns
from vsense.base.message_bus import Message, MessageBus
from vsense.monitor.recording._recorder import Recorder

AT_ONCE = 10
SAID = struct.Struct("<qq")


def live(folder: Path, number: int) -> None:
    """Publishes until the end."""
    path = folder / f"{number}.said"
    begun = path.with_suffix(".begun")
    begun.write_bytes(bytes(SAID.size))
    with begun.open("r+b") as file:
        said = mmap.mmap(file.fileno(), SAID.size)
    begun.rename(path)  # whole from the beginning, whenever it is killed
    bus = MessageBus()
    recorder = Recorder(bus, folder / f"{number}.mcap", pictures=True)
    image = np.random.default_rng(number).integers(0, 255, (60, 80), dtype=np.uint8)
    count = 0
    while True:
        now_ns = host_ns()
        bus.publish(Message("/arena", now_ns, {"n": count, "x_m": [0.1 * count] * 15}))
        count += 1
        said[:] = SAID.pack(count, now_ns)
        if count % 10 == 0:
            recorder.pictures([Frame("left", image, count, now_ns, now_ns)])
        time.sleep(0.01)


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
