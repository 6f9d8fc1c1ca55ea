"""Child processes of the lab: how they end, and the canary among them.

The canary is an idle process with a 10 ms timer that notes how late it was woken. A latency
measured on a busy machine says as much about the machine as about vsense; the canary's figures of
the same run tell the two apart. `python -m vsense.lab.processes` runs until its standard input
ends, then prints one lateness in ms per line, one line per tick.
"""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import time
from typing import Any

END_TIMEOUT_S = 5.0
"""A process that was told to end and does not within this time is killed."""


def end(process: subprocess.Popen[Any], timeout_s: float = END_TIMEOUT_S) -> None:
    """Waits for a process that was told to end, and kills it where it does not listen."""
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
    """Reads up to a line's end and not a byte further, so that `select` sees all that follows.

    Returns:
        The line; empty where the input ended before it did.
    """
    line = bytearray()
    while not line.endswith(b"\n"):
        byte = os.read(descriptor, 1)
        if not byte:
            return b""
        line += byte
    return bytes(line)


PERIOD_NS = 10_000_000


def watch() -> list[float]:
    """Ticks every 10 ms until standard input ends.

    Returns:
        How late each tick was, in ms. A tick that was missed whole counts once, with its lateness.
    """
    lateness_ms: list[float] = []
    due_ns = time.monotonic_ns() + PERIOD_NS
    while True:
        wait_s = max(0, due_ns - time.monotonic_ns()) / 1e9
        if select.select([sys.stdin], [], [], wait_s)[0]:
            return lateness_ms
        now_ns = time.monotonic_ns()
        if now_ns >= due_ns:
            lateness_ms.append((now_ns - due_ns) / 1e6)
            due_ns += PERIOD_NS * (1 + (now_ns - due_ns) // PERIOD_NS)


class Canary:
    """The canary process, from now until `end`."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "vsense.lab.processes"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
        )

    def end(self) -> list[float]:
        """Ends it and gives how late its ticks were, in ms; nothing if it was killed."""
        output, _ = self._process.communicate()
        return [float(value) for value in output.split()]

    def close(self) -> None:
        """Ends it if it still runs."""
        if self._process.poll() is None:
            self._process.communicate()


if __name__ == "__main__":
    try:
        print("\n".join(f"{value:.3f}" for value in watch()), flush=True)
    except BrokenPipeError:
        # Whoever asked is gone; what is still buffered must not be tried again at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
