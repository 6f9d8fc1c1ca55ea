"""A tracker as a process of its own: python -m tests.system.lines_process PORT TAG..."""

from __future__ import annotations

import sys
import time

from tests.system.floor import LinesTracker
from vsense.base.clock import host_ns


def main() -> None:
    """Writes arena states to a port of this machine until somebody ends it."""
    port, *tags = map(int, sys.argv[1:])
    tracker = LinesTracker(tags)
    tracker.port = port
    while True:
        tracker.live(set(), host_ns())
        time.sleep(0.005)


if __name__ == "__main__":
    main()
