"""The lab's physics process, and how the host starts it: physics and microcontrollers in real time.

`python -m vsense.modes.lab._physics_process` reads one line of JSON from standard input, the spec:

    {"robots":  [{"index": 0, "tag": 23, "x_m": 0.1, "y_m": 0.2, "yaw_rad": 0.0}, ...],
     "bases":   ["argos", ...],
     "objects": [{"tag": 22, "x_m": -0.5, "y_m": 0.0, "yaw_rad": 0.0}, ...],
     "boxes":   [{"x_m": 1.2, "y_m": 0, "yaw_rad": 0, "size_x_m": 0.01, "size_y_m": 2}, ...],
     "cylinders": [{"x_m": 0.5, "y_m": 0.5, "radius_m": 0.1}, ...],
     "truth": "name of the truth ring", "log": "path of the actuation log",
     "directory": "run directory", "seed": 1, "watchdog": false, "permille": 1000,
     "wheels": [null, {"relative": [0.05, 0.05], ...}, ...],
     "built": [[1.02, 0.97, 0.0535], ...],
     "sensors": [{"gains": [1.1, ...], ...}, ...], "black": [[0.5, 0.2, 0.05], ...],
     "models": ["path of a robot model", ...]}

`wheels` are `WheelNoise` by index, null: none; `built` how robots are built, as `Physics` takes it,
by index; `sensors` are `SensorHardware` by index, `black` discs on the floor: x, y, radius; with
them robots on a bus have ground boards; `models` are those of robots by index, then of objects:
without, they are e-pucks. There may be none of these lists. `permille` is the clock's
pace, as in `vsense.base.clock.slow`.

It answers with one line of JSON, `{"bases": ["argos:/dev/pts/3", ...], "epoch_ns": ...}`: where the
daemon of every robot finds its base, in the order of the indices, and the time of the first tick.
Then it runs in the time of that clock, 10 ms per tick, until standard input ends or on SIGTERM; its
parent handles Ctrl-C. A line `{"put": 0, "x_m": 0.1, "y_m": 0.2, "yaw_rad": 0.0}` puts an object,
by its place in `objects`, somewhere else; `{"rebuild": 0, "built": [1.02, 0.97, 0.0535]}` has
another robot stand where that of an index stood. Bodies in the truth ring are the robots by index,
then the objects. At the end it writes `physics.json` into the run directory: lateness of ticks,
counters of the serial lines, CPU time.
"""

from __future__ import annotations

import json
import math
import os
import select
import signal
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from vsense.base import clock
from vsense.base.clock import host_ns
from vsense.base.errors import UsageError, VsenseError, failing_as
from vsense.base.processes import describe_exit, end, read_line, start_module
from vsense.base.shared import LabError, LogFile
from vsense.base.terminal import Console
from vsense.config.specs import Experiment, ObjectSpec, RobotSpec
from vsense.modes.lab._canary import Lateness
from vsense.modes.lab._microcontrollers import Actuation, ActuationLog, Microcontrollers
from vsense.modes.lab._physics_spec import BOX, CYLINDER, POSE_COLUMNS, PhysicsSpec, read_number
from vsense.modes.lab._real_sensors import NOMINAL_SENSORS, RealGround
from vsense.modes.lab.hardware import RobotHardware, bases_of
from vsense.modes.lab.truth import TruthWriter
from vsense.world.physics.motion import TICK_NS, NoisyWheels, Physics, obstacles
from vsense.world.physics.proximity_ring import ProximityRing

FLUSH_TICKS = 10
"""The log is written to disk ten times per second."""


class PhysicsProcess:
    """Physics, proximity and microcontrollers, tied together; the clock is an argument."""

    def __init__(self, spec: PhysicsSpec, now_ns: int) -> None:
        """Puts everything in its place; the first tick is now.

        Raises:
            LabError: no terminals or sockets, no truth ring, or a log that cannot be written.
        """
        self._physics = Physics(
            spec.robots, spec.objects, spec.boxes, now_ns, spec.cylinders, spec.built, spec.models
        )
        models = self._physics.models[: len(spec.robots)]
        kinds, grounded = spec.bases, bool(spec.black)
        self.controllers = Microcontrollers(kinds, spec.watchdog, grounded, models)
        sensors = spec.sensors or [NOMINAL_SENSORS] * len(spec.robots)
        names = ("gains", "biases") if spec.sensors else ()
        built = {name: np.array([getattr(s, name) for s in sensors]) for name in names}
        # A Thymio's driver is what puts its sensors in the places of an e-puck's.
        seen = [
            replace(model, ring=replace(model.ring, stands_for=())) if kind == "thymio" else model
            for kind, model in zip(kinds, models, strict=True)
        ]
        self._rings = ProximityRing(self._physics.near, spec.seed, models=seen, **built)
        self._ground = RealGround(spec.black, sensors, spec.seed, models) if spec.black else None
        self._wheels = NoisyWheels(spec.wheels, spec.seed, models)
        self._leds = np.zeros(len(self._physics.poses), dtype=np.uint16)
        self._log = ActuationLog(spec.log)
        self._truth = TruthWriter(spec.truth, len(self._physics.poses))
        self._lateness, self._ticks = Lateness(), 0
        self._objects = len(spec.objects)
        self._tick_ns = now_ns
        self._publish()

    def wake_ns(self) -> int:
        """Time of the next `step` that is due even if no bytes come."""
        due_ns, tick_ns = self.controllers.due_ns, self._tick_ns + TICK_NS
        return tick_ns if due_ns is None else min(due_ns, tick_ns)

    def step(self, ready: Iterable[int], now_ns: int) -> None:
        """Advances to `now_ns`: all ticks that are due, then the bytes that came.

        `ready` is `controllers.readable()`, asked for before the time of the monotonic clock.
        """
        while self._tick_ns + TICK_NS <= now_ns:
            self._tick_ns += TICK_NS
            self._lateness.note((now_ns - self._tick_ns) / 1e6)
            self._ticks += 1
            self._actuate(self.controllers.advance(self._tick_ns))
            self._physics.tick(self._tick_ns)
            self._publish()
        self.controllers.receive(ready, now_ns)
        self._actuate(self.controllers.advance_due(now_ns))

    def put(self, line: bytes) -> None:
        """Puts an object, or another robot, where a line of standard input says.

        UsageError if it makes no sense.
        """
        try:
            said = json.loads(line)
            if "rebuild" in said:
                self._rebuild(int(said["rebuild"]), [float(number) for number in said["built"]])
                return
            row = int(said["put"])
        except (ValueError, KeyError, TypeError, IndexError):
            raise UsageError(f"put: {line[:80]!r} makes no sense") from None
        if not 0 <= row < self._objects:
            raise UsageError(f"put: there is no object {row}")
        pose = [read_number(said, name, "put: ") for name in POSE_COLUMNS]
        self._physics.poses[len(self._physics.poses) - self._objects + row] = pose

    def _rebuild(self, row: int, built: list[float]) -> None:
        robots = len(self._physics.poses) - self._objects
        if not 0 <= row < robots or len(built) != 3 or not all(0.0 < b < math.inf for b in built):
            raise UsageError(f"put: robot {row} cannot be built as {built}")
        self._physics.rebuild(row, built)

    def report(self) -> dict[str, Any]:
        """Contents of `physics.json`: ticks, their lateness in ms, counters of the serial lines."""
        late_ms = self._lateness.ticks() or [0.0]
        return {
            "ticks": self._ticks,
            "lateness_ms": {
                "p50": float(np.percentile(late_ms, 50)),
                "p99": float(np.percentile(late_ms, 99)),
                "max": self._lateness.worst_ms,
            },
            **self.controllers.counters(),
        }

    def close(self) -> None:
        """Ends the log and hangs everything up."""
        self._log.close()
        self._truth.close()
        self.controllers.close()

    def _actuate(self, applied: Sequence[Actuation]) -> None:
        for actuation in applied:
            robot = actuation.robot
            left, right = actuation.left_steps_s, actuation.right_steps_s
            speeds = self._wheels.of_robot(robot, left, right)
            self._physics.drive(robot, *speeds, actuation.time_ns)
            self._leds[robot] = actuation.leds
            self._log.append(actuation)

    def _publish(self) -> None:
        self._truth.write(self._tick_ns, self._physics.poses, self._leds)
        self.controllers.sense(self._rings.read(self._physics.bodies))
        if self._ground is not None:
            robots = self._physics.poses[: len(self.controllers.links)]
            self.controllers.sense_ground(self._ground.read(robots))
        if self._ticks % FLUSH_TICKS == 0:
            self._log.flush()


def run(process: PhysicsProcess, stdin: int, ended: list[int]) -> None:
    """Runs at the clock's pace until the descriptor `stdin` ends or `ended` is not empty."""
    said, bytes_came = b"", process.controllers.fileno()
    while not ended:
        wait_s = clock.real_s(max(0, process.wake_ns() - host_ns()) / 1e9)
        if stdin in select.select([stdin, bytes_came], [], [], wait_s)[0]:
            if not (more := os.read(stdin, 4096)):
                return
            *lines, said = (said + more).split(b"\n")
            for line in lines:
                process.put(line)
        process.step(process.controllers.readable(), host_ns())


def main() -> int:
    """Runs the process; see the module."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    stdin = sys.stdin.fileno()
    ended: list[int] = []
    try:
        spec = PhysicsSpec.parse(read_line(stdin))
        clock.slow(spec.permille)
        signal.signal(signal.SIGTERM, lambda number, frame: ended.append(number))
        epoch_ns = host_ns()
        process = PhysicsProcess(spec, epoch_ns)
        print(json.dumps({"bases": process.controllers.bases, "epoch_ns": epoch_ns}), flush=True)
        started_s = time.process_time()
        run(process, stdin, ended)
        _leave(process, spec.directory / "physics.json", time.process_time() - started_s)
    except VsenseError as error:
        Console().say(f"physics: {error}")
        return error.exit_code
    return 0


def _leave(process: PhysicsProcess, path: Path, cpu_s: float) -> None:
    report = {**process.report(), "cpu_s": cpu_s}
    process.close()
    file = LogFile(path)
    file.append(json.dumps(report, indent=2).encode() + b"\n")
    file.close()


class PhysicsHandle:
    """The host's end of the physics process.

    Attributes:
        bases: where the robots' daemons find their bases, in the experiment's order.
        log: path of the actuation log.
    """

    def __init__(
        self,
        experiment: Experiment,
        truth: str,
        seed: int,
        directory: Path,
        base: str | None,
        watchdog: bool = False,
        hardware: Mapping[int, RobotHardware] = {},
        black: Sequence[tuple[float, float, float]] = (),
    ) -> None:
        """Starts the process with robots, objects and walls of a settled experiment.

        Args:
            truth: name of the truth ring.
            seed: of the proximity sensors' noise.
            directory: of the log.
            base: what robots are based on, as `vsense.modes.lab.hardware.bases_of` takes it.
            watchdog, hardware, black: as in `Microcontrollers` and `LabRobots`.

        Raises:
            LabError: the process has failed.
        """
        self.log = directory / "actuations.bin"
        self._process, self._stdin, self._stdout = start_module("vsense.modes.lab._physics_process")
        spec = _spec(experiment, truth, seed, self.log, hardware, black)
        spec["bases"] = bases_of(base, _types(experiment))
        spec |= {"watchdog": watchdog, "permille": round(clock.pace() * 1000)}
        try:
            self._stdin.write(json.dumps(spec).encode() + b"\n")
            self._stdin.flush()
            answer = self._stdout.readline()
        except BaseException:  # the user does not want it any more
            self._process.terminate()
            self.close()
            raise
        if not answer:
            self._process.wait()
            raise LabError("the lab's physics did not start; the reason stands above")
        self.bases: list[str] = json.loads(answer)["bases"]

    def put(self, row: int, x_m: float, y_m: float, yaw_rad: float) -> None:
        """Puts the tagged object of a row of the experiment's somewhere else.

        Raises:
            LabError: the process has ended.
        """
        self._send({"put": row, "x_m": x_m, "y_m": y_m, "yaw_rad": yaw_rad})

    def rebuild(self, row: int, built: RobotHardware) -> None:
        """Has another robot stand where that of a row stood; raises as `put`."""
        self._send({"rebuild": row, "built": built.for_physics()})

    def _send(self, line: Mapping[str, object]) -> None:
        with failing_as(LabError, "the lab's physics does not listen"):
            self._stdin.write(json.dumps(line).encode() + b"\n")
            self._stdin.flush()

    def check(self) -> None:
        """Raises LabError where the process has ended by itself."""
        if self._process.poll() is not None:
            raise LabError(f"the lab's physics {describe_exit(self._process.returncode)}")

    def close(self) -> None:
        """Ends the process; its log is complete then."""
        with suppress(BrokenPipeError):
            self._stdin.close()
        end(self._process)
        self._stdout.close()


def _spec(
    experiment: Experiment,
    truth: str,
    seed: int,
    log: Path,
    hardware: Mapping[int, RobotHardware] = {},
    black: Sequence[tuple[float, float, float]] = (),
) -> dict[str, object]:
    """The process's spec; see the module."""
    boxes, cylinders = obstacles(experiment.boxes, experiment.cylinders, experiment.tallest_m)
    ours = [hardware[robot.tag] for robot in experiment.robots if hardware]
    built = [body.for_physics() for body in ours]
    sensors = [asdict(body.sensors) for body in ours if body.sensors is not None]
    return {
        "robots": [
            {"index": i, "tag": robot.tag, **_pose(robot)}
            for i, robot in enumerate(experiment.robots)
        ],
        "objects": [{"tag": thing.tag, **_pose(thing)} for thing in experiment.objects],
        "boxes": [dict(zip(BOX, box)) for box in boxes.tolist()],
        "cylinders": [dict(zip(CYLINDER, cylinder)) for cylinder in cylinders.tolist()],
        "models": [str(body.model.file) for body in experiment.bodies],
        "truth": truth,
        "log": str(log),
        "directory": str(log.parent),
        "seed": seed,
        "black": [list(disc) for disc in black],
        "wheels": [None if noise is None else asdict(noise) for noise in experiment.wheel_noises],
        **({"built": built} if built else {}),
        **({"sensors": sensors} if sensors else {}),
    }


def _types(experiment: Experiment) -> list[str]:
    return [experiment.casting.type_of(robot.tag) for robot in experiment.robots]


def _pose(body: RobotSpec | ObjectSpec) -> dict[str, float]:
    assert body.pose is not None
    return body.pose._asdict()


if __name__ == "__main__":
    sys.exit(main())
