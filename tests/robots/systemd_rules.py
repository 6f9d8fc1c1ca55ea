"""What systemd does with a service, as its manual says: a process for tests on machines without it.

    python -m tests.robots.systemd_rules UNIT COMMAND...

Of the unit it takes `Environment`, `Restart=always`, `RestartSec` and `TimeoutStopSec`. When the
main process ends, all others of the service get SIGTERM, and SIGKILL after the time-out
(systemd.kill(5), KillMode=control-group, the default); then the next begins (systemd.service(5)).
A service's processes are all descendants, also of a parent that has ended, as in a control group.
"""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

PR_SET_CHILD_SUBREAPER = 36


def read(unit: Path) -> dict[str, str]:
    """The settings of its [Service]."""
    _, _, service = unit.read_text().partition("[Service]\n")
    service = service.partition("\n[")[0]
    return dict(line.split("=", 1) for line in service.splitlines() if line[:1].isalpha())


def family() -> list[int]:
    """All descendants; those that have ended are no longer among them."""
    while True:
        try:
            if os.waitpid(-1, os.WNOHANG)[0] == 0:
                break
        except ChildProcessError:
            break
    found: list[int] = []
    waiting = [os.getpid()]
    while waiting:
        file = Path(f"/proc/{(pid := waiting.pop())}/task/{pid}/children")
        try:
            waiting += map(int, file.read_text().split())
        except OSError:
            continue
        found.append(pid)
    return [pid for pid in found if pid != os.getpid()]


def end(number: signal.Signals, within_s: float) -> None:
    """Sends a signal to all, and waits for their end."""
    for pid in family():
        os.kill(pid, number)
    end_s = time.monotonic() + within_s
    while family() and time.monotonic() < end_s:
        time.sleep(0.01)


def main() -> None:
    settings = read(Path(sys.argv[1]))
    assert settings["Restart"] == "always"
    name, _, value = settings["Environment"].partition("=")
    stop_s = float(settings["TimeoutStopSec"])
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())
    try:
        while True:
            process = subprocess.Popen(sys.argv[2:], env={**os.environ, name: value})
            process.wait()
            end(signal.SIGTERM, stop_s)
            end(signal.SIGKILL, 1.0)
            time.sleep(float(settings["RestartSec"]))
    finally:
        end(signal.SIGTERM, stop_s)
        end(signal.SIGKILL, 1.0)


if __name__ == "__main__":
    main()
