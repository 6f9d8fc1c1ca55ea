"""What all child processes of the lab have in common: how they end."""

from __future__ import annotations

import signal
import subprocess
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
