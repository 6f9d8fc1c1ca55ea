"""Child processes: how Python ones start, and how all end.

`python -m` searches the current folder for modules before its own library: a user's `random.py` or
`queue.py` would break vsense there, and a `numpy.py` of somebody else's would run. So whatever
starts a Python module starts it with `python_module`.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from typing import IO, Any

END_TIMEOUT_S = 5.0
"""A process that was asked to end and does not within this time is killed."""

LAUNCHER = (
    "import sys; del sys.path[0]; import runpy;"
    " runpy.run_module(sys.argv.pop(1), run_name='__main__', alter_sys=True)"
)
"""Does what `python -P -m` does, for a Python before 3.11, which has no `-P`: with `-c`, as with
`-m`, the current folder is the first that is searched, and `sys` itself is searched for nowhere."""

_SAFE = ("-P", "-m") if sys.version_info >= (3, 11) else ("-c", LAUNCHER)

Started = tuple[subprocess.Popen[bytes], IO[bytes], IO[bytes]]
"""A process, and the pipes to its standard input and from its standard output."""


def python_module(module: str) -> tuple[str, ...]:
    """The words that start a Python module: nothing in the current folder is imported for it."""
    return (sys.executable, *_SAFE, module)


def start_module(module: str, *arguments: str, **options: Any) -> Started:
    """Starts a Python module in a session of its own: Ctrl-C reaches only this process."""
    process = subprocess.Popen(
        [*python_module(module), *arguments],
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
