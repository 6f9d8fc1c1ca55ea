"""The robots' daemons: one real `vsensed` per robot, started, watched and ended; and their traces.

`vsensed --trace` writes the readings of each controller at every step.
"""

from __future__ import annotations

import hashlib
import os
import random
import re
import shlex
import struct
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vsense.base.clock import pace
from vsense.base.files import cut_log, log_ends
from vsense.base.processes import Lifeline, describe_exit, terminate
from vsense.base.shared import LabError, file_errors
from vsense.config.specs import Experiment
from vsense.modes.lab._metrics import UNKNOWN_AGE
from vsense.modes.lab.hardware import EmulatedRadio
from vsense.robots import build
from vsense.robots.crashes import words_of_log
from vsense.robots.link.keys import KeySource, daemon_options

CLOCK_OFFSET_NS = 3_600_000_000_000
"""Every robot's clock is off by up to an hour ..."""

CLOCK_DRIFT_PPM = 100.0
"""... and runs fast or slow by up to this much, as real boards do."""


_NONE: Mapping[str, str] = {}
_NO_RADIOS: Mapping[int, EmulatedRadio] = {}


@dataclass(frozen=True, slots=True)
class LabRobot:
    """One robot of the lab.

    Attributes:
        daemon: its program.
        name: its id in the experiment.
        base: its daemon's `--base`, `KIND:DEVICE`.
        clock_offset_ns: how far its own clock is ahead of the host's.
        clock_drift_ppm: how much too fast its own clock runs.
        trace: file of its daemon's control steps.
        settings: more options of its daemon.
    """

    daemon: Path
    tag: int
    name: str
    base: str
    clock_offset_ns: int
    clock_drift_ppm: float
    trace: Path
    settings: tuple[str, ...] = ()

    def host_time_ns(self, local_ns: int) -> int:
        """The host's clock when this robot's own clock shows `local_ns`."""
        ahead_ns = local_ns - self.clock_offset_ns
        # In integers: a double holds a month in nanoseconds only to half a microsecond.
        return ahead_ns - round(ahead_ns * self.clock_drift_ppm / (1e6 + self.clock_drift_ppm))


class LabSwarm:
    """All daemons of one run. They are in sessions of their own: Ctrl-C is the lab's to handle."""

    def __init__(
        self,
        host: str,
        port: int,
        seed: int,
        directory: Path,
        keys: KeySource | None,
        radios: Mapping[int, EmulatedRadio] = _NO_RADIOS,
    ) -> None:
        """Prepares an empty swarm; traces, logs and start scripts go into `directory`.

        Each robot has a key made of `keys`; None: none has. Their files go with the swarm. Who is
        in `radios`, by tag, tells of that; the others tell of none.
        """
        self._radios = radios
        self._keys = keys
        self._host = host
        self._port = port
        self._random = random.Random(seed)
        self._directory = directory
        self._directory.mkdir(parents=True, exist_ok=True)
        self._processes: dict[int, subprocess.Popen[bytes]] = {}
        self._lifeline = Lifeline()
        self.robots: list[LabRobot] = []
        self._ever: list[LabRobot] = []

    def start(
        self, daemon: Path, tag: int, name: str, base: str, settings: Mapping[str, str] = _NONE
    ) -> LabRobot:
        """Starts the daemon of one robot and leaves a script that starts it again.

        `settings` are more options of it, by name.
        """
        trace, again = self._directory / f"{tag}.trace", 1
        while trace in (robot.trace for robot in self._ever):
            again += 1
            trace = self._directory / f"{tag}-{again}.trace"
        robot = LabRobot(
            daemon,
            tag,
            name,
            base,
            self._random.randrange(-CLOCK_OFFSET_NS, CLOCK_OFFSET_NS),
            round(self._random.uniform(-CLOCK_DRIFT_PPM, CLOCK_DRIFT_PPM), 3),
            trace,
            tuple(word for name, value in settings.items() for word in (f"--{name}", value)),
        )
        self.robots.append(robot)
        self._ever.append(robot)
        script = self.script(tag)
        try:
            command = self._command(robot)
            if (radio := self._radios.get(tag)) is not None:
                self.radio_file(tag).write_text(radio.file_text())
            words = f"exec {shlex.join(command)} <{self._lifeline.place}"
            script.write_text(f"#!/bin/sh\n# Starts this robot's daemon again.\n{words}\n")
            script.chmod(0o755)
            self._processes[tag] = self._lifeline.start(command, self.log(tag))
        except OSError as error:
            raise LabError(f"{error.filename}: {error.strerror}") from None
        return robot

    def replace(
        self, row: int, daemon: Path, tag: int, settings: Mapping[str, str] = _NONE
    ) -> None:
        """Ends the daemon of the robot in a row, and starts that of another one in its part."""
        gone = self.robots.pop(row)
        if gone.tag in self._processes:
            terminate([self._processes.pop(gone.tag)])
        self._key_file(gone).unlink(missing_ok=True)
        self.start(daemon, tag, gone.name, gone.base, settings)
        self.robots.insert(row, self.robots.pop())

    def script(self, tag: int) -> Path:
        """The script that starts a robot's daemon again."""
        return self._directory / f"{tag}.sh"

    def radio_file(self, tag: int) -> Path:
        """What a robot reads of its radio, once a second; it is there where it has one."""
        return self._directory / f"{tag}.radio"

    def log(self, tag: int) -> Path:
        """The output of a robot's daemon."""
        return self._directory / f"{tag}.log"

    def complaints(self) -> list[str]:
        """What the controllers asked for in vain, or do not know: each complaint once."""
        said = dict.fromkeys(
            line.partition(": ")[2]
            for robot in self.robots
            for line in log_ends(self.log(robot.tag)).splitlines()
            if line.startswith(f"vsensed {robot.tag}: controller '")
        )
        return list(said)

    def fallen(self) -> list[tuple[LabRobot, str]]:
        """Daemons that have ended since the last call, and how; keeps their logs in bounds.

        LabError: a log that is too long cannot be cut.
        """
        ended = []
        for robot in self.robots:
            with file_errors(self.log(robot.tag)):
                cut_log(self.log(robot.tag))
            process = self._processes.get(robot.tag)
            if process is not None and process.poll() is not None:
                del self._processes[robot.tag]
                words = describe_exit(process.returncode)
                if process.returncode < 0:
                    words += words_of_log(self.log(robot.tag), robot.daemon)
                ended.append((robot, words))
        return ended

    def end(self) -> None:
        """Ends all daemons: SIGTERM, and SIGKILL for those that do not end."""
        terminate(self._processes.values())
        self._processes.clear()
        self._lifeline.close()
        for robot in self.robots:
            self._key_file(robot).unlink(missing_ok=True)

    def _key_file(self, robot: LabRobot) -> Path:
        return self._directory / f"{robot.tag}.key"

    def _command(self, robot: LabRobot) -> list[str]:
        uid = hashlib.sha256(f"vsense lab robot {robot.tag}".encode()).digest()[:16]
        who = daemon_options(uid, self._keys, self._key_file(robot))
        return [
            str(robot.daemon),
            *("--host", self._host, "--port", str(self._port)),
            *("--tag", str(robot.tag), "--name", robot.name, *who),
            *("--base", robot.base, "--trace", str(robot.trace.resolve())),
            # This machine's own radio is no robot's.
            *("--radio", str(self.radio_file(robot.tag).resolve())),
            *robot.settings,
            *("--clock-offset-ns", str(robot.clock_offset_ns)),
            *("--clock-drift-ppm", str(robot.clock_drift_ppm)),
            *(("--clock-permille", str(round(pace() * 1000))) if pace() < 1.0 else ()),
        ]


TRACE = np.dtype(
    [
        ("step", "i8"), ("timestep", "i8"), ("now_ns", "i8"), ("rx_ns", "i8"),
        ("newest_ns", "i8"), ("known", "?"), ("value", "f8"), ("capture_ns", "i8"),
        ("age_ns", "i8"), ("stale", "?"), ("left", "i8"), ("right", "i8"),
    ]
)  # fmt: skip
"""One control step of one robot; all times on the host's clock.

`now_ns` is when the controller was called, `rx_ns` when the datagram with the newest capture had
come, `newest_ns` the time of that capture. `known` is whether the controller had a value of every
virtual sensor, `value` that of the judged one, `capture_ns` when it was measured (the oldest one,
where none is judged); `age_ns` (-1: unknown) and `stale` are the controller's. `left` and `right`
are the commanded wheel speeds [steps/s].
"""


def daemons_of(experiment: Experiment) -> dict[str, Path]:
    """The daemon of each controller that drives robots, by its id; raises as `build.daemon`."""
    driving = {robot.controller for robot in experiment.robots}
    return {c.id: build.daemon(c.program) for c in experiment.controllers if c.id in driving}


def read_trace(
    robot: LabRobot, sensors: Sequence[str], judged: str | None, offset: int = 0
) -> NDArray[np.void]:
    """Reads a robot's trace: (n,) TRACE; empty where the daemon never made a step.

    `judged` is the one of its sensors whose value, one single, is read; None: no value is read.
    Lines that begin before byte `offset` are left out, and those that the daemon did not finish:
    the last one, and where the disk was full.

    Raises:
        LabError: the file cannot be read, or a line is no trace line.
    """
    if not os.path.isfile(robot.trace):
        return np.empty(0, TRACE)
    rows = []
    with file_errors(robot.trace), robot.trace.open("rb") as file:
        if offset:
            file.seek(offset - 1)
            offset += len(file.readline()) - 1
        for line in file:
            if (step := _STEP.search(line)) is not None:
                words = step[1].decode(errors="replace").split()
                try:
                    rows.append(_row(robot, words, sensors, judged))
                except (KeyError, ValueError) as error:
                    number = 1 + robot.trace.read_bytes()[:offset].count(b"\n")
                    raise LabError(f"{robot.trace}:{number}: not a trace line: {error}") from None
            offset += len(line)
    return np.array(rows, TRACE)


_STEP = re.compile(rb".*(?<!time)(step \d[^#\n]*)\n")
"""A control step in a line of a trace; before it, what a full disk took of another one."""
_TRACE_LINE = 6144
"""The longest, in bytes."""


def last_traced(robot: LabRobot) -> int:
    """The timestep of the last control step in a robot's trace, -1: there is none.

    LabError: the file cannot be read.
    """
    if not os.path.isfile(robot.trace):
        return -1
    with file_errors(robot.trace), robot.trace.open("rb") as file:
        file.seek(max(os.path.getsize(robot.trace) - 2 * _TRACE_LINE, 0))
        steps = _STEP.findall(file.read())
    timestep = re.match(rb"step \d+ timestep (\d+) ", steps[-1]) if steps else None
    return -1 if timestep is None else int(timestep[1])


def _row(
    robot: LabRobot, words: list[str], sensors: Sequence[str], judged: str | None
) -> tuple[object, ...]:
    fields = dict(zip(words[::2], words[1::2]))
    return (
        int(fields["step"]),
        int(fields["timestep"]),
        robot.host_time_ns(int(fields["now_ns"])),
        robot.host_time_ns(int(fields["rx_ns"])),
        int(fields["capture_ns"]),
        *_held(fields["values"], sensors, judged),
        int(fields["left"]),
        int(fields["right"]),
    )


def _held(
    text: str, sensors: Sequence[str], judged: str | None
) -> tuple[bool, float, int, int, bool]:
    """Known, value, capture, age and stale out of "name=hex@capture:age:stale,...".

    The times are those of the judged sensor; without one the oldest reading's, so that no
    fresh sensor hides another's age.
    """
    items = dict(item.split("=", 1) for item in text.split(",")) if sensors else {}
    held = [items[name] for name in sensors]
    if not held or "-" in held:
        return False, 0.0, 0, UNKNOWN_AGE, True
    timed = held if judged is None else [items[judged]]
    times = [item.split("@")[1].split(":") for item in timed]
    capture, age, stale = min(times, key=lambda time: int(time[0]))
    value = 0.0
    if judged is not None:
        (value,) = struct.unpack("<f", bytes.fromhex(items[judged].split("@")[0]))
    return True, value, int(capture), int(age), stale != "0"
