"""Child processes: how they start and end, and the lab's canary.

The canary is an idle process with a 10 ms timer that notes how late it was woken. Its figures show
how much of a run's latencies is due to a busy machine. `python -m vsense.lab.processes` runs until
its standard input ends, then prints a line for each lateness that came: the lateness in ms, and how
many ticks had it.
"""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
from collections import Counter
from typing import IO, Any

from vsense.clock import host_ns

END_TIMEOUT_S = 5.0
"""A process that was asked to end and does not within this time is killed."""

Started = tuple[subprocess.Popen[bytes], IO[bytes], IO[bytes]]
"""A process, and the pipes to its standard input and from its standard output."""


def start_module(module: str, *arguments: str, **options: Any) -> Started:
    """Starts a Python module in a session of its own: Ctrl-C reaches only this process."""
    process = subprocess.Popen(
        [sys.executable, "-m", module, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        start_new_session=True,
        **options,
    )
    assert process.stdin is not None and process.stdout is not None
    return process, process.stdin, process.stdout


def end(process: subprocess.Popen[Any], timeout_s: float = END_TIMEOUT_S) -> None:
    """Waits for a process that was asked to end, and kills it where it does not."""
    try:
        process.wait(timeout_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def describe_exit(returncode: int) -> str:
    """Says in words how a process ended."""
    if returncode < 0:
        return f"was killed by {signal.Signals(-returncode).name}"
    return f"ended with exit code {returncode}"


def read_line(descriptor: int) -> bytes:
    """Reads a line and not a byte further, so that `select` sees all that follows.

    The line is empty where the input ended before it did.
    """
    line = bytearray()
    while not line.endswith(b"\n"):
        byte = os.read(descriptor, 1)
        if not byte:
            return b""
        line += byte
    return bytes(line)


PERIOD_NS = 10_000_000


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
    lateness = Lateness()
    due_ns = host_ns() + PERIOD_NS
    while True:
        wait_s = max(0, due_ns - host_ns()) / 1e9
        if select.select([sys.stdin], [], [], wait_s)[0]:
            return lateness
        now_ns = host_ns()
        if now_ns >= due_ns:
            lateness.note((now_ns - due_ns) / 1e6)
            due_ns += PERIOD_NS * (1 + (now_ns - due_ns) // PERIOD_NS)


class Canary:
    """The canary process, from now until `end`."""

    def __init__(self) -> None:
        self._process = start_module("vsense.lab.processes")[0]

    def end(self) -> list[float]:
        """Ends it; returns how late its ticks were, in ms, or nothing if it was killed."""
        output, _ = self._process.communicate()
        pairs = (line.split() for line in output.splitlines())
        return Lateness({float(late_ms): int(count) for late_ms, count in pairs}).ticks()

    def close(self) -> None:
        """Ends it if it still runs."""
        if self._process.poll() is None:
            self._process.communicate()


if __name__ == "__main__":
    try:
        print("\n".join(f"{late_ms} {count}" for late_ms, count in watch().items()), flush=True)
    except BrokenPipeError:
        # The parent has ended; what is still buffered must not be tried again at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
