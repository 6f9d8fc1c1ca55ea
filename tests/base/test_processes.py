"""Child processes end with the one that has started them, whatever users' code does there."""

from __future__ import annotations

import subprocess
import sys

FORKS = """
import os, sys, time
from pathlib import Path
from vsense.base.processes import Lifeline, start_module

process, line, _ = start_module("vsense.modes.lab._canary", "1000")
lifeline = Lifeline()
hangs = lifeline.start(["cat"], Path(os.devnull))
alive, ready = os.pipe()
if os.fork() == 0:  # as users' code may
    os.close(alive)
    os.write(ready, b".")
    time.sleep(100)
os.read(alive, 1)
line.close()
lifeline.close()
print(process.wait(20.0), hangs.wait(20.0), flush=True)
os.killpg(0, 9)
"""


def test_a_fork_of_users_code_keeps_no_process_of_ours_alive() -> None:
    done = subprocess.run(
        [sys.executable, "-c", FORKS],
        capture_output=True,
        text=True,
        timeout=60,
        start_new_session=True,
    )
    assert done.stdout == "0 0\n", done.stderr
