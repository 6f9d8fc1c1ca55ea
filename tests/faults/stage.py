"""A running lab whose robots are behind the relay, and what can be seen of it from outside."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.faults.relay import Relay
from tests.rigs.processes import Lab, children, descendants
from tests.system.attacker import Attacker
from vsense.base.clock import host_ns
from vsense.config import experiment
from vsense.modes.lab._microcontrollers import ACTUATION
from vsense.modes.lab.hardware import MIXED, bases_of
from vsense.monitor.ui import control_socket

HERE = Path(__file__).parent
EXPERIMENT = HERE / "spin.argos"
PATIENCE_S = 60.0
POLL_S = 0.02


class StageError(AssertionError):
    """The lab does not do what the rig needs to go on at all."""


class Canary:
    """What a busy machine does to everybody: how late a thread of this process is woken, and how
    much of the processors programs have that are not this process or its children.

    Attributes:
        worst_s: the worst delay since `begin`.
    """

    PERIOD_S = 0.005
    LATE_S, OTHERS_MOST = 0.06, 0.1
    """More than this of a delay, or of all processors, is a machine that does something else."""

    def __init__(self) -> None:
        self.worst_s = 0.0
        self._ended = False
        self.begin()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def begin(self) -> None:
        """What was before counts no longer."""
        self._ours, self._before = self._family(), processor_times()
        self.worst_s, self._begun_s = 0.0, time.monotonic()

    def busy(self) -> str:
        """Why what failed since `begin` may be the machine's fault; "" for a quiet one."""
        if self.worst_s > self.LATE_S:
            return f"the machine was {self.worst_s * 1e3:.0f} ms late"
        # Who was started here is still ours where its parent has ended since.
        ours = self._ours | self._family()
        taken_s = sum(
            spent_s - self._before.get(pid, 0.0)
            for pid, spent_s in processor_times().items()
            if pid not in ours
        )
        share = taken_s / ((time.monotonic() - self._begun_s) * (os.cpu_count() or 1))
        return f"others had {share:.0%} of the processors" if share > self.OTHERS_MOST else ""

    def close(self) -> None:
        self._ended = True
        self._thread.join()

    @staticmethod
    def _family() -> set[int]:
        return {os.getpid(), *descendants()}

    def _run(self) -> None:
        while not self._ended:
            before_s = time.monotonic()
            time.sleep(self.PERIOD_S)
            self.worst_s = max(self.worst_s, time.monotonic() - before_s - self.PERIOD_S)


def processor_times() -> dict[int, float]:
    """Of each process, what it and the children that it has waited for have taken [s], see proc(5).

    The first one has waited for all whose parents have ended, for ours, too: it counts alone.
    """
    tick_s, taken = 1.0 / os.sysconf("SC_CLK_TCK"), {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):  # it has ended meanwhile
            words = path.read_text().rpartition(")")[2].split()
            pid = int(path.parent.name)
            taken[pid] = tick_s * sum(map(int, words[11 : 13 if pid == 1 else 15]))
    return taken


class Stage:
    """A lab of `robots` robots whose wheels turn, with its relay and an attacker on the air.

    Attributes:
        tags: the robots' tags by place.
        on_air: the places of robots without a board, which the lab reaches by its Wi-Fi.
        normal: the wheels' speeds as the controller sets them, and rest.
        restarted: daemons that the rig has started again.
    """

    def __init__(self, folder: Path, relay: Relay, attacker: Attacker, robots: int, seed: int):
        self.relay, self.attacker = relay, attacker
        self.folder = folder
        known = experiment.load(EXPERIMENT)
        self.tags = [robot.tag for robot in known.robots][:robots]
        kinds = bases_of(MIXED, [""] * robots)
        self.on_air = {place for place, kind in enumerate(kinds) if kind == "wifi"}
        self.restarted: list[subprocess.Popen[bytes]] = []
        self._rows: NDArray[np.void] = np.empty(0, ACTUATION)
        self._read_bytes = 0
        words = ("--robots", str(robots), "--seed", str(seed), "--base", MIXED)
        self.lab = Lab(
            *(folder / "run", str(EXPERIMENT), *words, "--record", "--json"),
            module="tests.faults.lab",
        )
        self.lab.wait_for("picture to sent|timestep 0")
        self.wait(lambda: self.moving(self.places), "all robots in motion")
        self.normal = {(0, 0)} | {self.newest(place) for place in self.places}

    # --- what is there

    @property
    def places(self) -> range:
        """The robots, by their place in the experiment."""
        return range(len(self.tags))

    def worker(self, place: int) -> int:
        """Process number of a robot's worker."""
        return self.lab.daemon(self.tags[place])

    def guard(self, place: int) -> int:
        """Process number of a robot's guard."""
        return children(self.worker(place))[0]

    def helper(self, module: str) -> int:
        """Process number of one of the lab's processes: cameras, physics_process."""
        found = [
            p for p, words in self.lab.relatives().items() if f"vsense.modes.lab._{module}" in words
        ]
        return found[0]

    def script(self, place: int) -> Path:
        """What starts a robot's daemon again."""
        return self.lab.directory / "robots" / f"{self.tags[place]}.sh"

    def start_again(self, place: int, script: Path | None = None) -> None:
        """Starts a robot's daemon again."""
        process = subprocess.Popen(
            [script or self.script(place)], start_new_session=True, stderr=subprocess.DEVNULL
        )
        self.restarted.append(process)

    # --- what the wheels do

    def rows(self, place: int | None = None) -> NDArray[np.void]:
        """The microcontrollers' log until now: (n,) `ACTUATION`, of one robot or of all."""
        with (self.lab.directory / "actuations.bin").open("rb") as file:
            file.seek(self._read_bytes)
            data = file.read()
        whole = len(data) // ACTUATION.itemsize * ACTUATION.itemsize
        self._read_bytes += whole
        if whole:
            self._rows = np.concatenate([self._rows, np.frombuffer(data[:whole], ACTUATION)])
        return self._rows if place is None else self._rows[self._rows["robot"] == place]

    def newest(self, place: int) -> tuple[int, int]:
        """A robot's newest wheel speeds [steps/s]; (0, 0) before the first command."""
        rows = self.rows(place)
        if not len(rows):
            return 0, 0
        return int(rows["left_steps_s"][-1]), int(rows["right_steps_s"][-1])

    def moving(self, places: Any) -> bool:
        """Whether the wheels of all these robots turn."""
        return all(self.newest(place) != (0, 0) for place in places)

    def wait(self, condition: Any, what: str, patience_s: float = PATIENCE_S) -> None:
        """Waits until something holds.

        Raises:
            StageError: it did not, with what the lab has said last.
        """
        start_s = time.monotonic()
        while not condition():
            if time.monotonic() - start_s > patience_s:
                raise StageError(f"no {what} in {patience_s:g} s; {''.join(self.lab.said[-5:])}")
            time.sleep(POLL_S)

    # --- what the operator does

    def order(self, word: str) -> None:
        """Gives the lab an order, as the terminal does."""
        place = control_socket.folder() / f"{self.lab.process.pid}.sock"
        with socket.socket(socket.AF_UNIX) as sock:
            sock.settimeout(5.0)
            sock.connect(str(place))
            sock.sendall(json.dumps({"order": word}).encode() + b"\n")
            answer = json.loads(sock.makefile().readline())
        if "error" in answer:
            raise StageError(f"{word}: {answer['error']}")

    def end(self, number: signal.Signals) -> tuple[int, float]:
        """Ends the lab by a signal; gives its exit code and how long it took [s]."""
        start_s = time.monotonic()
        self.lab.process.send_signal(number)
        code = self.lab.end()
        return code, time.monotonic() - start_s

    def close(self) -> None:
        """Leaves nothing behind."""
        if self.lab.process.poll() is None:
            self.lab.process.kill()
            self.lab.end()
        for process in self.restarted:
            process.kill()
            process.wait()
        for pid in self.lab.relatives():
            os.kill(pid, signal.SIGKILL)

    def now(self) -> int:
        """The clock of everything that is measured here [ns]."""
        return host_ns()
