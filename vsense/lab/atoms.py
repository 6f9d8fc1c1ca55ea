"""The process that is the lab's floor: true physics and the robots' microcontrollers.

`python -m vsense.lab.atoms` reads one line of JSON from standard input, the spec:

    {"robots":  [{"index": 0, "tag": 23, "x_m": 0.1, "y_m": 0.2, "yaw_rad": 0.0}, ...],
     "bases":   ["argos", ...],
     "objects": [{"tag": 22, "x_m": -0.5, "y_m": 0.0, "yaw_rad": 0.0}, ...],
     "boxes":   [{"x_m": 1.2, "y_m": 0, "yaw_rad": 0, "size_x_m": 0.01, "size_y_m": 2}, ...],
     "cylinders": [{"x_m": 0.5, "y_m": 0.5, "radius_m": 0.1}, ...],
     "truth": "name of the truth ring", "log": "path of the actuation log",
     "directory": "run directory", "seed": 1}

It answers with one line of JSON, `{"bases": ["argos:/dev/pts/3", ...], "epoch_ns": ...}`: what the
daemon of every robot finds its base at, in the order of the indices, and the time of the first
tick. Then it lives in real
time, 10 ms per tick, until standard input ends or on SIGTERM; Ctrl-C is its parent's to handle.
Bodies in the truth ring are the robots by index, then the objects. At the end it leaves
`atoms.json` in the run directory: how late ticks were, what went over the serial lines, CPU time.
"""

from __future__ import annotations

import json
import os
import select
import signal
import sys
import time
from array import array
from pathlib import Path
from typing import Any

import numpy as np

from vsense.errors import VsenseError
from vsense.lab.atoms_spec import AtomsSpec
from vsense.lab.microcontrollers import ActuationLog, Microcontrollers
from vsense.lab.physics import TICK_NS as TICK_NS
from vsense.lab.physics import Physics
from vsense.lab.proximity import ProximityRing
from vsense.lab.shared import LabError
from vsense.lab.truth import TruthWriter

FLUSH_TICKS = 100
"""The log reaches the disk at least once per second."""


class Atoms:
    """Physics, proximity and microcontrollers, tied together; the clock is an argument."""

    def __init__(self, spec: AtomsSpec, now_ns: int) -> None:
        """Puts everything in its place; the first tick is now.

        Raises:
            LabError: no terminals or sockets, no truth ring, or a log that cannot be written.
        """
        self.controllers = Microcontrollers(spec.bases)
        self._physics = Physics(spec.robots, spec.objects, spec.boxes, now_ns, spec.cylinders)
        self._rings = ProximityRing(self._physics.near, spec.seed)
        self._leds = np.zeros(len(self._physics.poses), dtype=np.uint16)
        self._log = ActuationLog(spec.log)
        self._truth = TruthWriter(spec.truth, len(self._physics.poses))
        self._late_ns = array("q")
        self._tick_ns = now_ns
        self._publish()

    def wake_ns(self) -> int:
        """When `step` has something to do even if no bytes come."""
        due_ns, tick_ns = self.controllers.due_ns, self._tick_ns + TICK_NS
        return tick_ns if due_ns is None else min(due_ns, tick_ns)

    def step(self, ready: list[int], now_ns: int) -> None:
        """Lives on to `now_ns`: all ticks that are due, then the bytes that came.

        Args:
            ready: descriptors of `controllers.readable()` that have bytes.
            now_ns: the host's monotonic clock, never going back.
        """
        while self._tick_ns + TICK_NS <= now_ns:
            self._tick_ns += TICK_NS
            self._late_ns.append(now_ns - self._tick_ns)
            self._actuate(self._tick_ns)
            self._physics.tick(self._tick_ns)
            self._publish()
        if ready:
            self.controllers.receive(ready, now_ns)
        self._actuate(now_ns)

    def report(self) -> dict[str, Any]:
        """What `atoms.json` says: ticks, their lateness in ms, counters of the serial lines."""
        late_ms = np.array(self._late_ns or [0]) / 1e6
        return {
            "ticks": len(self._late_ns),
            "lateness_ms": {
                "p50": float(np.percentile(late_ms, 50)),
                "p99": float(np.percentile(late_ms, 99)),
                "max": float(late_ms.max()),
            },
            **self.controllers.counters(),
        }

    def close(self) -> None:
        """Ends the log and hangs everything up."""
        self._log.flush()
        self._truth.close()
        self.controllers.close()

    def _actuate(self, now_ns: int) -> None:
        for actuation in self.controllers.advance(now_ns):
            robot = actuation.robot
            self._physics.drive(
                robot, actuation.left_steps_s, actuation.right_steps_s, actuation.time_ns
            )
            self._leds[robot] = actuation.leds
            self._log.append(actuation)

    def _publish(self) -> None:
        self._truth.write(self._tick_ns, self._physics.poses, self._leds)
        self.controllers.sense(self._rings.read(self._physics.bodies))
        if len(self._late_ns) % FLUSH_TICKS == 0:
            self._log.flush()


def live(atoms: Atoms, stdin: int, ended: list[int]) -> None:
    """Lives in real time until the descriptor `stdin` ends or something gets into `ended`."""
    while not ended:
        wait_s = max(0, atoms.wake_ns() - time.monotonic_ns()) / 1e9
        ready = select.select([stdin, *atoms.controllers.readable()], [], [], wait_s)[0]
        if stdin in ready:
            ready.remove(stdin)
            if not os.read(stdin, 4096):
                return
        atoms.step(ready, time.monotonic_ns())


def _read_line(stdin: int) -> bytes:
    """Reads up to the line's end and not a byte further, so that `select` sees all that follows."""
    line = bytearray()
    while not line.endswith(b"\n"):
        byte = os.read(stdin, 1)
        if not byte:
            break
        line += byte
    return bytes(line)


def main() -> int:
    """Runs the process; see the module."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    stdin = sys.stdin.fileno()
    ended: list[int] = []
    try:
        spec = AtomsSpec.parse(_read_line(stdin))
        signal.signal(signal.SIGTERM, lambda number, frame: ended.append(number))
        epoch_ns = time.monotonic_ns()
        atoms = Atoms(spec, epoch_ns)
        print(json.dumps({"bases": atoms.controllers.bases, "epoch_ns": epoch_ns}), flush=True)
        started_s = time.process_time()
        live(atoms, stdin, ended)
        _leave(atoms, spec.directory / "atoms.json", time.process_time() - started_s)
    except VsenseError as error:
        print(f"atoms: {error}", file=sys.stderr)
        return error.exit_code
    return 0


def _leave(atoms: Atoms, path: Path, cpu_s: float) -> None:
    report = {**atoms.report(), "cpu_s": cpu_s}
    atoms.close()
    try:
        path.write_text(json.dumps(report, indent=2) + "\n")
    except OSError as error:
        raise LabError(f"{path}: {error.strerror}") from None


if __name__ == "__main__":
    sys.exit(main())
