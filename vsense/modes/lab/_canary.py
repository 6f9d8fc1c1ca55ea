"""The lab's canary: an idle process with a 10 ms timer that notes how late it was woken.

Its figures show how much of a run's latencies is due to a busy machine, so its time is that of the
lab's clock, whose pace [permille] is its argument. The process runs until its standard input ends,
then prints a line for each lateness that came: the lateness in ms, and how many ticks had it.
"""

from __future__ import annotations

import os
import select
import sys
from collections import Counter

from vsense.base import clock
from vsense.base.clock import host_ns
from vsense.base.processes import start_module

PROBE_PERIOD_NS = 10_000_000


class Lateness(Counter[float]):
    """How many ticks were how late [ms]: to three digits, so that hours take no more memory than
    minutes.

    Attributes:
        worst_ms: the longest of those that were noted, exactly.
    """

    worst_ms = 0.0

    def note(self, late_ms: float) -> None:
        """Counts a tick."""
        self[float(f"{late_ms:.3g}")] += 1
        self.worst_ms = max(self.worst_ms, late_ms)

    def ticks(self) -> list[float]:
        """The lateness of each tick, in no order."""
        return list(self.elements())


def watch() -> Lateness:
    """Ticks every 10 ms until standard input ends; returns how late the ticks were.

    Ticks that were missed whole count once, with their lateness.
    """
    lateness, stdin, now_ns = Lateness(), [sys.stdin], host_ns()
    due_ns = now_ns + PROBE_PERIOD_NS
    while not select.select(stdin, [], [], clock.real_s(max(0, due_ns - now_ns) / 1e9))[0]:
        now_ns = host_ns()
        if now_ns >= due_ns:
            lateness.note((now_ns - due_ns) / 1e6)
            due_ns += PROBE_PERIOD_NS * (1 + (now_ns - due_ns) // PROBE_PERIOD_NS)
    return lateness


class Canary:
    """The canary process, from now until `end`."""

    def __init__(self) -> None:
        permille = str(round(clock.pace() * 1000))
        self._process = start_module("vsense.modes.lab._canary", permille)[0]

    def end(self) -> list[float]:
        """Ends it; returns how late its ticks were, in ms, or nothing if it was killed."""
        output, _ = self._process.communicate()
        pairs = (line.split() for line in output.splitlines() if line)
        return Lateness({float(late_ms): int(count) for late_ms, count in pairs}).ticks()

    def close(self) -> None:
        """Ends it if it still runs."""
        if self._process.poll() is None:
            self._process.communicate()


if __name__ == "__main__":
    clock.slow(int(sys.argv[1]))
    try:
        print("\n".join(f"{late_ms} {count}" for late_ms, count in watch().items()), flush=True)
    except BrokenPipeError:
        # The parent has ended; what is still buffered must not be tried again at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
