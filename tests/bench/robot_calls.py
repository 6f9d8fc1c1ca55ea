"""How many system calls a robot's daemon makes per control step, all its processes together.

The real daemon for ARMv5 runs on an emulated processor, between a real virtual sensor server and an
emulated microcontroller; the emulator tells every call. On a board of an e-puck a call costs far
more than the control step's own instructions between two of them.
"""

from __future__ import annotations

import os
import re
import select
import statistics
import subprocess
from pathlib import Path

from vsense.base.clock import host_ns
from vsense.modes.lab._microcontrollers import Microcontrollers
from vsense.robots.compiling import BuildError
from vsense.robots.link.keys import INSECURE
from vsense.robots.link.server import VirtualSensorServer
from vsense.robots.link.table import Entry, ExpectedRobot, Table
from vsense.robots.link.wire import Wanted

TAG = 23
PARAMS = "stop_probability=0.3\nspeed_cm_s=12\nwalk_s=8\n"
TIMESTEP_NS = 100_000_000
WARM_UP = 20
"""Timesteps that are not counted: clocks are compared, the controller begins."""

PATIENCE_NS = 30_000_000_000
"""For the first control step; an emulator on a busy machine is slow."""

YOUNG = re.compile(r"(_time64|64|statx|getrandom|_time64_.*)$")
OLD = frozenset({"fcntl64", "fstat64", "fstatat64", "lstat64", "stat64", "_llseek", "mmap2"})
"""Names that end in 64 and are as old as the port to ARM."""

_CALL = re.compile(rb"\d+ ([a-z_0-9]+)\(")


def per_step(qemu: str, program: Path, steps: int) -> int:
    """Counts the calls of each control step at 10 Hz; gives the median.

    A call that came to Linux after 2.6.24 counts twice: the kernel of an old board does not know
    it, and the C library asks once more in the old way.

    Args:
        qemu: the emulator, `qemu-arm`.
        program: the daemon for ARMv5.
        steps: how many control steps.

    Raises:
        BuildError: the daemon ends, or makes no control step.
    """
    base = Microcontrollers(["argos"])
    server = VirtualSensorServer(
        host="127.0.0.1",
        port=0,
        timestep_ns=TIMESTEP_NS,
        seed=5,
        expected={TAG: ExpectedRobot("robot", Table([Entry(1, "pollutant", "f4")]), PARAMS)},
        trust=INSECURE,
        on_event=lambda event: None,
    )
    words = ["--host", "127.0.0.1", "--port", str(server.start()), "--tag", str(TAG)]
    words.append("--insecure")
    daemon = subprocess.Popen(
        [qemu, "-cpu", "arm926", "-strace", program, *words, "--base", base.bases[0]],
        stderr=subprocess.PIPE,
    )
    try:
        return _Life(base, server, daemon).median(steps)
    finally:
        daemon.terminate()
        daemon.communicate()
        server.close()
        base.close()


class _Life:
    """Host, microcontroller and daemon, timestep by timestep."""

    def __init__(
        self, base: Microcontrollers, server: VirtualSensorServer, daemon: subprocess.Popen[bytes]
    ) -> None:
        assert daemon.stderr is not None
        self._base, self._server, self._daemon = base, server, daemon
        self._trace = daemon.stderr.fileno()
        self._rest = b""
        self._timestep = 0
        self._next_ns = host_ns()
        os.set_blocking(self._trace, False)

    def median(self, steps: int) -> int:
        """Counts after the robot has run for a while."""
        end_ns = host_ns() + PATIENCE_NS
        self._server.command(Wanted.RUN)
        while (said := self._server.robots()[TAG].telemetry) is None or said.control_step == 0:
            if host_ns() > end_ns or self._daemon.poll() is not None:
                raise BuildError("the daemon makes no control step on the emulated processor")
            self._live()
        for _ in range(WARM_UP):
            self._live()
        return round(statistics.median(self._live() for _ in range(steps)))

    def _live(self) -> int:
        """One timestep; gives the calls that were made in it."""
        self._timestep += 1
        self._next_ns += TIMESTEP_NS
        now_ns = host_ns()
        self._server.publish(self._timestep, now_ns - 20_000_000, {TAG: [(bytes(4), now_ns)]})
        calls = 0
        while (now_ns := host_ns()) < self._next_ns:
            due_ns = min(self._base.due_ns or self._next_ns, self._next_ns)
            watched = [self._base, self._trace]
            ready = select.select(watched, [], [], max(due_ns - now_ns, 0) / 1e9)[0]
            came, now_ns = self._base.readable(), host_ns()
            self._base.receive(came, now_ns)
            self._base.advance(now_ns)
            if self._trace in ready:
                calls += self._read()
        return calls

    def _read(self) -> int:
        """Counts the calls that the emulator has told of."""
        *lines, self._rest = (self._rest + os.read(self._trace, 1 << 16)).split(b"\n")
        names = (name.decode() for line in lines for name in _CALL.findall(line))
        return sum(2 if YOUNG.search(name) and name not in OLD else 1 for name in names)
