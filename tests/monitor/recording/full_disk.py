"""Records while the disk is full for a while; run by test_full_disk.py.

Arguments: "limit" or "disk", the recording, and for "disk" a file whose removal makes room.
"limit" is the kernel's bound on the size of a file, which needs no rights.
"""

from __future__ import annotations

import json
import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path

from vsense.base.clock import host_ns
from vsense.base.message_bus import Message, MessageBus
from vsense.monitor.recording._recorder import Recorder
from vsense.monitor.recording._waiting import WaitingBounds

LIMIT_BYTES = 100_000
PATIENCE_S = 60.0


class Run:
    """A run that publishes ten times faster than real ones."""

    def __init__(self, path: Path) -> None:
        self.bus = MessageBus()
        self.events: list[str] = []
        self.bus.join(
            lambda message: self.events.append(message.data["level"]),
            lambda topic: topic == "/event",
        )
        self.recorder = Recorder(self.bus, path, bounds=WaitingBounds(message_bytes=200_000))
        self.count = 0

    def until(self, done: Callable[[], bool]) -> None:
        """Publishes until something has happened."""
        end_s = time.monotonic() + PATIENCE_S
        while not done():
            assert time.monotonic() < end_s, self.recorder.state()
            noise = [hash((self.count, n)) for n in range(200)]
            message = Message("/arena", host_ns(), {"n": self.count, "noise": noise})
            self.bus.publish(message)
            self.count += 1
            time.sleep(0.01)


def main() -> None:
    """Fills the disk, makes room, and fills it again for the end."""
    how, path = sys.argv[1], Path(sys.argv[2])
    if how == "limit":
        resource.setrlimit(resource.RLIMIT_FSIZE, (LIMIT_BYTES, resource.RLIM_INFINITY))
    run = Run(path)
    state = run.recorder.state
    run.until(lambda: state()["trouble"] is not None)
    trouble, full_bytes = state()["trouble"], path.stat().st_size
    run.until(lambda: state()["lost_messages"] > 100)
    if how == "limit":
        resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    else:
        Path(sys.argv[3]).unlink()
    run.until(lambda: state()["trouble"] is None)
    goal = run.count + 50
    run.until(lambda: run.count >= goal)
    run.recorder.close()
    json.dump(
        {
            "trouble": trouble,
            "full_bytes": full_bytes,
            "published": run.count,
            "events": run.events,
            "end": state(),
        },
        sys.stdout,
    )


if __name__ == "__main__":
    main()
