"""What is outside of a `vsense run`, emulated: robots with their bases, and a tracker of theirs.

The daemons are real and connect over real sockets, as robots' boards do. The tracker tells the
physics' own places as lines of JSON (`vsense/robots/link/TRACKERS.md`): there are no cameras in it.
It connects to a run that may begin, end and begin again, as the robots do.
"""

from __future__ import annotations

import json
import socket
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from threading import Event

from vsense.base.clock import host_ns
from vsense.base.shared import LabError
from vsense.base.terminal import printable
from vsense.config.specs import Experiment
from vsense.modes.lab._physics_process import PhysicsHandle
from vsense.modes.lab._swarm import LabSwarm, daemons_of
from vsense.modes.lab.hardware import EmulatedRadio
from vsense.modes.lab.truth import TruthReader, make_ring
from vsense.robots.link.keys import KeySource

TRACKER_CONNECT_TIMEOUT_S = 0.1
"""The longest that a timestep waits for the run's host."""
TRACKER_RETRY_NS = 1_000_000_000
ANSWER_MAX = 4096
_SHOWN = 40
"""Letters of what is no answer."""


class LineWriter:
    """The tracker's end of `vsense/robots/link/TRACKERS.md`; connects again and again."""

    def __init__(self, host: str, port: int, say: Callable[[str], None]) -> None:
        self._address = host, port
        self._say = say
        self._socket: socket.socket | None = None
        self._rest = b""
        self._try_ns = 0

    @property
    def connected(self) -> bool:
        """Whether the run's host takes lines."""
        return self._socket is not None

    def write(self, line: bytes) -> None:
        """Sends a line if somebody takes it; one that cannot leave at once ends the connection.

        LabError: what listens there is no run.
        """
        if self._socket is None:
            self._connect()
        if self._socket is None:
            return
        try:
            self._hear(self._socket)
            if self._socket.send(line) != len(line):
                raise ConnectionError("it does not read what the tracker writes")
        except BlockingIOError:
            self._lose("it does not read what the tracker writes")
        except OSError as error:
            self._lose(error.strerror or str(error))

    def close(self) -> None:
        """Ends the connection; can be called again."""
        if self._socket is not None:
            self._socket.close()
        self._socket, self._rest = None, b""

    def _connect(self) -> None:
        if host_ns() < self._try_ns:
            return
        self._try_ns = host_ns() + TRACKER_RETRY_NS
        with suppress(OSError):  # nobody listens yet: the progress line says so
            self._socket = socket.create_connection(self._address, TRACKER_CONNECT_TIMEOUT_S)
            self._socket.setblocking(False)
            self._say(f"the tracker is connected to {self._address[0]}, port {self._address[1]}")

    def _hear(self, connection: socket.socket) -> None:
        """Passes on what the host says of the lines: it answers bad ones."""
        with suppress(BlockingIOError):
            heard = connection.recv(ANSWER_MAX)
            if not heard:
                raise ConnectionError("it has closed the connection")
            *lines, self._rest = (self._rest + heard).split(b"\n")
            for line in lines:
                text = printable(line.decode(errors="replace"))
                if not text.startswith("{"):  # every answer of a run is an object of JSON
                    words = "what listens there is no 'vsense run --tracker lines', it says"
                    where = f"{self._address[0]}, port {self._address[1]}"
                    raise LabError(f"{where}: {words} {text[:_SHOWN]!r}: --tracker-port")
                self._say(f"the run says of the tracker: {text}")

    def _lose(self, reason: str) -> None:
        self.close()
        self._say(f"the tracker has lost the run: {reason}")


class Rehearsal:
    """Emulated robots and their tracker; no process is left behind.

    Attributes:
        robots: how many there are.
    """

    def __init__(
        self,
        experiment: Experiment,
        directory: Path,
        seed: int,
        base: str | None,
        watchdog: bool,
        address: tuple[str, int],
        keys: KeySource | None,
        tracker: LineWriter,
        say: Callable[[str], None],
        radios: Mapping[int, EmulatedRadio],
    ) -> None:
        """Starts all robots of a settled experiment.

        `directory`, `seed`, `base` and `watchdog` are those of `PhysicsHandle`, `address`, `keys`
        and `radios` those of `LabSwarm`. Raises VsenseError where something of it cannot be made.
        """
        self.robots = len(experiment.robots)
        self._timestep_ns = experiment.timestep_ns
        self._tags = list(experiment.tags.values())
        self._tracker, self._say = tracker, say
        daemons = daemons_of(experiment)
        with ExitStack() as stack:
            stack.callback(tracker.close)
            truth = make_ring(len(self._tags))
            stack.callback(truth.close)
            self._truth = TruthReader(truth.name)
            stack.callback(self._truth.close)
            self._floor = PhysicsHandle(experiment, truth.name, seed, directory, base, watchdog)
            stack.callback(self._floor.close)
            self._swarm = LabSwarm(*address, seed, directory / "robots", keys, radios)
            stack.callback(self._swarm.end)
            for robot, base_of in zip(experiment.robots, self._floor.bases):
                self._swarm.start(daemons[robot.controller], robot.tag, robot.id, base_of)
            self._stack = stack.pop_all()

    def run(self, interrupted: Event, progress: Callable[[str], None]) -> None:
        """Writes where everybody is, every timestep, until it is interrupted.

        Raises:
            LabError: the physics has failed; or as of `LineWriter.write`.
        """
        began_ns = host_ns()
        timestep, alive = 0, self.robots
        while not interrupted.is_set():
            timestep = max(timestep + 1, (host_ns() - began_ns) // self._timestep_ns)
            interrupted.wait(max(0, began_ns + timestep * self._timestep_ns - host_ns()) / 1e9)
            self._floor.check()
            self._track(timestep)
            for robot, how in self._swarm.fallen():
                alive -= 1
                again = self._swarm.script(robot.tag)
                self._say(f"robot {robot.tag}: its daemon {how}; again: {again}")
            run = "connected to a run" if self._tracker.connected else "waiting for a run"
            time_s = (host_ns() - began_ns) / 1e9
            progress(f"{time_s:.1f} s  {alive} of {self.robots} daemons  tracker {run}")

    def close(self) -> None:
        """Ends all processes; logs are complete then."""
        self._stack.close()

    def _track(self, timestep: int) -> None:
        """Writes one line: the newest whole tick of the physics, 10 ms old at most."""
        capture_ns = self._truth.newest_ns()
        if capture_ns == 0:
            return
        poses, _ = self._truth.at(capture_ns)
        robots = [
            {"tag": tag, "x_m": round(x, 5), "y_m": round(y, 5), "yaw_rad": round(yaw, 5)}
            for tag, (x, y, yaw) in zip(self._tags, poses.tolist())
        ]
        line = {"timestep": timestep, "capture_ns": capture_ns, "send_ns": host_ns()}
        self._tracker.write(json.dumps({**line, "robots": robots}).encode() + b"\n")
