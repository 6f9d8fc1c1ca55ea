"""Robots that do not stop, and robots that do: `scripts/bench disobedience`.

In a lab of 15 robots that drive, a robot's daemon and guard are stopped by a signal, as a board
that hangs, and the emergency stop is pressed. How long until the host says so is counted from the
first STATE with STOP that passes on the loopback. Then as many stops that all robots obey, of which
nothing may be said. Busy loops run all that while. Where a canary was woken late, the trial has
measured the machine, and is void. Needs root, to hear the loopback.
Exit code 0: the bars are met.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from tests.faults.stage import Canary
from tests.rigs.processes import Lab, children, free_port, order
from tests.system.attacker import WANTED_AT, LoopbackAttacker
from vsense.base.clock import host_ns
from vsense.config import experiment
from vsense.modes.lab._microcontrollers import read_actuations
from vsense.robots.link.wire import PacketType, Wanted

QUIET_S, SAID_S = 1.5, 5.0
"""So long nothing may be said of robots that obey, and so long is waited for what must be said."""
LOGGED_S = 0.2
"""By then what a robot was told last is in the microcontrollers' log."""
P99_S, VOID_MOST = 0.5, 0.1
LIFT = re.compile(r"does NOT stop")


class Ears(LoopbackAttacker):
    """Hears when the host first has robots stop.

    Attributes:
        stopped_ns: when the first STATE with STOP passed since this was None, host's clock.
    """

    stopped_ns: int | None = None

    def _note(self, kind: int, way: bytes, source: int, target: int, packet: bytes) -> None:
        super()._note(kind, way, source, target, packet)
        is_stop = packet[3] == PacketType.STATE and packet[WANTED_AT] == Wanted.STOP
        if is_stop and self.stopped_ns is None:
            self.stopped_ns = host_ns()


@contextmanager
def busy(count: int) -> Iterator[None]:
    """So many processes that never wait."""
    loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


class Trials:
    """One lab, and what was said in it."""

    def __init__(self, folder: Path, robots: int, ears: Ears) -> None:
        words = ("--port", str(ears.port), "--robots", str(robots), "--duration", "600", "--hold")
        self.lab, self._ears, self._canary = Lab(folder, "pollutant", *words), ears, Canary()
        self.lab.wait_for("ready to start")
        self._tags = [robot.tag for robot in experiment.load("pollutant").robots[:robots]]

    def close(self) -> None:
        self.lab.process.send_signal(signal.SIGINT)
        self.lab.end()
        self._canary.close()

    def run(self, draw: random.Random, disobeys: bool) -> tuple[float | None, float]:
        """One stop: after how long the host said that a robot does not, and the canary's worst [s];
        None: it said nothing."""
        order("start", self.lab)
        time.sleep(1.0 + draw.random())  # all drive, in no order with timesteps
        held: list[int] = []
        while disobeys and not held:
            place = draw.randrange(len(self._tags))
            worker = self.lab.daemon(self._tags[place])
            held = [worker, *children(worker)]
            for pid in held:
                os.kill(pid, signal.SIGSTOP)
            if not self._turns(place):  # it stands in the cone, and obeys as it is
                for pid in held:
                    os.kill(pid, signal.SIGCONT)
                held.clear()
        self._canary.begin()
        begun, self._ears.stopped_ns = len(self.lab.said), None
        order("stop", self.lab, "--emergency")
        waited_s = time.monotonic() + (SAID_S if disobeys else QUIET_S)
        said_ns = None
        while said_ns is None and time.monotonic() < waited_s:
            if any(LIFT.search(line) for line in self.lab.said[begun:]):
                said_ns = host_ns()
            time.sleep(0.002)
        worst_s = self._canary.worst_s
        for pid in held:
            os.kill(pid, signal.SIGCONT)
        order("reset", self.lab)
        time.sleep(1.5 if disobeys else 0.3)
        stopped_ns = self._ears.stopped_ns
        if said_ns is None or stopped_ns is None:
            return None, worst_s
        return (said_ns - stopped_ns) / 1e9, worst_s

    def _turns(self, place: int) -> bool:
        """Whether a robot's wheels turn."""
        time.sleep(LOGGED_S)
        rows = read_actuations(self.lab.directory / "actuations.bin")
        (*_, last) = rows[rows["robot"] == place]
        return bool(last["left_steps_s"] or last["right_steps_s"])


def main() -> int:
    """Tries, prints, and gives the exit code."""
    parser = argparse.ArgumentParser(prog="scripts/bench disobedience", description=__doc__)
    parser.add_argument("--seeds", type=int, default=20, metavar="N", help="robots that hang (20)")
    parser.add_argument("--honest", type=int, default=40, metavar="N", help="stops obeyed (40)")
    parser.add_argument("--robots", type=int, default=15, metavar="N", help="in the lab (15)")
    parser.add_argument("--busy", type=int, default=4, metavar="N", help="busy loops (4)")
    parser.add_argument("--seed", type=int, default=1, metavar="S", help="of the first trial (1)")
    options = parser.parse_args()
    ears = Ears(free_port())
    times: list[float] = []
    counts = dict.fromkeys(("void", "missed", "false"), 0)
    with tempfile.TemporaryDirectory() as folder, busy(options.busy):
        trials = Trials(Path(folder) / "lab", options.robots, ears)
        try:
            for number in range(options.seeds + options.honest):
                disobeys = number < options.seeds
                draw = random.Random(options.seed + number)
                said_s, worst_s = trials.run(draw, disobeys)
                kind = "hangs" if disobeys else "obeys"
                shown = "nothing said" if said_s is None else f"said after {1e3 * said_s:.0f} ms"
                print(f"{number + 1:4} {kind} {shown}, canary {1e3 * worst_s:.0f} ms", flush=True)
                if worst_s > Canary.LATE_S:
                    counts["void"] += 1
                elif disobeys and said_s is None:
                    counts["missed"] += 1
                elif disobeys and said_s is not None:
                    times.append(said_s)
                elif said_s is not None:
                    counts["false"] += 1
            middle, late = (1e3 * np.percentile(times or [np.nan], share) for share in (50, 99))
            # The lab's own figures of hundreds of runs take minutes.
            print(
                f"{len(times)} said after {middle:.0f} ms, p99 {late:.0f} ms; {counts}", flush=True
            )
        finally:
            trials.close()
            ears.close()
    void = counts["void"] / (options.seeds + options.honest)
    wrong = counts["missed"] or counts["false"] or not late <= 1e3 * P99_S or void > VOID_MOST
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
