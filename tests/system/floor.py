"""A floor without physics for `vsense run`: real daemons, emulated bases, a tracker to play.

Everything but the programs under test lives in one loop on the monotonic clock, driven by
`Floor.wait_for`: no threads, no sleeps. The trackers know their protocols from their documents
alone (iridia.md section 1a; the JSON-lines link's description) and share no code with ours.
"""

from __future__ import annotations

import json
import os
import re
import select
import signal
import socket
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from tests.rigs.processes import free_port
from vsense.base.clock import host_ns
from vsense.modes.lab._microcontrollers import Actuation, Microcontrollers
from vsense.robots import build
from vsense.robots.sources import ProgramSources

MS = 1_000_000
S = 1_000_000_000
PERIOD_NS = 100 * MS
PATIENCE_S = 60.0
START, STOP, ONE_SHOT = 0, 1, 2


class Part(Protocol):
    """Something that lives in the loop."""

    def descriptors(self) -> list[int]:
        """What has to be waited for."""

    def live(self, ready: set[int], now_ns: int) -> None:
        """Does what is due."""

    def close(self) -> None:
        """Ends it."""


class Program:
    """A process whose words can be waited for.

    Attributes:
        said, printed: what it wrote so far to standard error and to standard output.
    """

    def __init__(self, *command: str) -> None:
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True
        )
        self.said = self.printed = ""
        assert self.process.stderr is not None and self.process.stdout is not None
        self._open = {self.process.stderr.fileno(): "said", self.process.stdout.fileno(): "printed"}
        for descriptor in self._open:
            os.set_blocking(descriptor, False)

    @classmethod
    def vsense(cls, *words: str) -> Program:
        """Starts one of our commands."""
        return cls(sys.executable, "-m", "vsense", *words)

    @property
    def ended(self) -> bool:
        """Whether it is over and all its words are here."""
        return not self._open and self.process.poll() is not None

    def tell(self, number: signal.Signals) -> None:
        """Sends it a signal."""
        self.process.send_signal(number)

    def heard(self, pattern: str, times: int = 1) -> Callable[[], bool]:
        """A condition: it has said so that often."""
        return lambda: len(re.findall(pattern, self.said)) >= times

    def descriptors(self) -> list[int]:
        return list(self._open)

    def live(self, ready: set[int], now_ns: int) -> None:
        for descriptor in ready & self._open.keys():
            data = os.read(descriptor, 65536)
            name = self._open[descriptor]
            setattr(self, name, getattr(self, name) + data.decode())
            if not data:
                del self._open[descriptor]

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        for stream in (self.process.stdout, self.process.stderr):
            assert stream is not None
            stream.close()


class Tracker:
    """What trackers of both kinds have in common: robots on a row, every 100 ms a new state.

    Attributes:
        places: (x, y, heading in degrees) by tag.
        sent_ns: when the newest state left.
        frozen: no state leaves any more.
    """

    def __init__(self, tags: list[int]) -> None:
        self.places = {tag: (0.2 * n, 0.1, 90.0) for n, tag in enumerate(tags)}
        self.sent_ns = 0
        self.frozen = False
        self.timestep = 0
        self._due_ns = 0

    def fail(self, fault: str) -> None:
        """Dies, or stays connected without a word."""
        if fault == "dies":
            self.kill()
        self.frozen = fault == "freezes"

    def mend(self, fault: str) -> None:
        """Undoes `fail`."""
        if fault == "dies":
            self.revive()
        self.frozen = False

    def kill(self) -> None:
        """Dies as a process does: all its sockets are closed."""
        raise NotImplementedError

    def revive(self) -> None:
        """Starts again, at the same address and from timestep 0."""
        raise NotImplementedError

    def _is_due(self, now_ns: int) -> bool:
        if self.frozen or now_ns < self._due_ns:
            return False
        self._due_ns = max(self._due_ns + PERIOD_NS, now_ns)
        return True


class OriginalTracker(Tracker):
    """A tracking server of the original system."""

    kind = "original"

    def __init__(self, tags: list[int]) -> None:
        super().__init__(tags)
        self.running = False
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self._client: socket.socket | None = None
        self._bytes = b""

    def framework(self) -> str:
        """What the experiment says of it."""
        return f'<framework ats_host="127.0.0.1" ats_port="{self.port}">'

    def descriptors(self) -> list[int]:
        return [
            s.fileno() for s in (self._listener, self._client) if s is not None and s.fileno() >= 0
        ]

    def live(self, ready: set[int], now_ns: int) -> None:
        if self._listener.fileno() in ready:
            self._client, _ = self._listener.accept()
            self._client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._bytes, self.running = b"", False
        elif self._client is not None and self._client.fileno() in ready:
            self._hear(now_ns)
        if self._is_due(now_ns) and self._client is not None and self.running:
            self.timestep += 1
            self._send(now_ns)

    def kill(self) -> None:
        self._listener.close()
        self._hang_up()

    def revive(self) -> None:
        self._listener = socket.create_server(("127.0.0.1", self.port))
        self.timestep = 0

    def close(self) -> None:
        self.kill()

    def _hear(self, now_ns: int) -> None:
        assert self._client is not None
        data = self._client.recv(4096)
        if not data:
            self._hang_up()
            return
        self._bytes += data
        while len(self._bytes) >= 4:
            (command,) = struct.unpack_from(">I", self._bytes)
            self._bytes = self._bytes[4:]
            if command == ONE_SHOT and not self.frozen:
                self._send(now_ns)
            self.running = command == START or (self.running and command != STOP)
            self.timestep = self.timestep if self.running else 0

    def _send(self, now_ns: int) -> None:
        assert self._client is not None
        robots = [
            f" {tag} 100.0 200.0 3.0 {x_m} {y_m} {yaw}"
            for tag, (x_m, y_m, yaw) in self.places.items()
        ]
        text = f"{self.timestep}{''.join(robots)}".encode()
        self._client.sendall(struct.pack(">I", len(text)) + text)
        self.sent_ns = now_ns

    def _hang_up(self) -> None:
        if self._client is not None:
            self._client.close()
        self._client = None


class LinesTracker(Tracker):
    """Any other tracker, which writes JSON lines to a port of vsense's."""

    kind = "lines"

    def __init__(self, tags: list[int]) -> None:
        super().__init__(tags)
        self.port: int = free_port()
        self._sock: socket.socket | None = None
        self._dead = False

    def framework(self) -> str:
        """What the experiment says of it."""
        return f'<framework><vs:tracker format="lines" port="{self.port}" />'

    def descriptors(self) -> list[int]:
        return []

    def live(self, ready: set[int], now_ns: int) -> None:
        if self._dead or not self._is_due(now_ns):
            return
        try:
            if self._sock is None:
                self._sock = socket.create_connection(("127.0.0.1", self.port))
            self._sock.sendall(self._line(now_ns))
            self.sent_ns = now_ns
        except ConnectionError:
            self._hang_up()

    def kill(self) -> None:
        self._dead = True
        self._hang_up()

    def revive(self) -> None:
        self._dead, self.timestep = False, 0

    def close(self) -> None:
        self.kill()

    def _line(self, now_ns: int) -> bytes:
        self.timestep += 1
        robots = [
            {"tag": tag, "x_m": x_m, "y_m": y_m, "yaw_rad": yaw * 0.0174533}
            for tag, (x_m, y_m, yaw) in self.places.items()
        ]
        line = {"timestep": self.timestep, "capture_ns": now_ns, "send_ns": now_ns}
        return json.dumps(line | {"robots": robots}).encode() + b"\n"

    def _hang_up(self) -> None:
        if self._sock is not None:
            self._sock.close()
        self._sock = None


class Floor:
    """Daemons with their bases, and all that lives in the loop with them.

    Attributes:
        applied: every actuator frame that reached a robot's motors, by tag.
        held_up_ns: the longest time that this loop itself was late: the canary. A time that was
            measured while it was large says nothing.
    """

    def __init__(
        self,
        tags: list[int],
        controller: str | ProgramSources = build.SHIPPED_CONTROLLER,
        base: str = "argos",
    ) -> None:
        """`controller` is what the daemons run, on bases of this kind."""
        self.tags = tags
        self.applied: dict[int, list[Actuation]] = {tag: [] for tag in tags}
        self.held_up_ns = 0
        self._base, self._bases = base, Microcontrollers([base] * len(tags))
        self._daemon = build.daemon(controller)
        self._daemons: dict[int, Program] = {}
        self._parts: list[Part] = []

    def add(self, part: Part) -> None:
        """Has something live in the loop."""
        self._parts.append(part)

    def remove(self, part: Part) -> None:
        """Ends something, and takes it out of the loop."""
        self._parts.remove(part)
        part.close()

    @staticmethod
    def clock() -> int:
        """The clock of the loop and of the bases [ns]."""
        return host_ns()

    def device(self, tag: int) -> str:
        """The line that leads to a robot's base."""
        return self._bases.devices[self.tags.index(tag)]

    def worker(self, tag: int) -> Program:
        """A robot's daemon."""
        return self._daemons[tag]

    def program(self, *words: str) -> Program:
        """Starts one of our commands; the robots here have no keys."""
        made = Program.vsense(*words, *(["--insecure"] if words[0] == "run" else []))
        self.add(made)
        return made

    def connect(
        self, tag: int, port: int, host: str = "127.0.0.1", where: tuple[str, ...] = ()
    ) -> None:
        """Starts a robot's daemon, in place of the one that may run.

        Args:
            tag: which robot.
            port: of the host.
            host: its address.
            where: words before the command, such as those of another network namespace.
        """
        if tag in self._daemons:
            self.disconnect(tag)
        device = self.device(tag)
        words = ["--host", host, "--port", str(port), "--tag", str(tag)]
        words += ["--uid", f"{tag:032x}", "--insecure", "--base", f"{self._base}:{device}"]
        self._daemons[tag] = Program(*where, str(self._daemon), *words)

    def disconnect(self, tag: int) -> None:
        """Kills a robot's worker; its guard stops the wheels."""
        self._daemons.pop(tag).close()

    def speeds(self, tag: int) -> tuple[int, int]:
        """What the motors of a robot do now."""
        if not self.applied[tag]:
            return 0, 0
        last = self.applied[tag][-1]
        return last.left_steps_s, last.right_steps_s

    def moving(self, *tags: int) -> bool:
        """Whether the wheels of all these robots turn; without any, of all there are."""
        return all(self.speeds(tag) != (0, 0) for tag in tags or self.tags)

    def resting(self, *tags: int) -> bool:
        """Whether no wheel of these robots turns; without any, of all there are."""
        return all(self.speeds(tag) == (0, 0) for tag in tags or self.tags)

    def stopped_ns(self, tag: int) -> int:
        """When a resting robot's wheels got speed 0, on its base's clock."""
        rest = 0
        for actuation in reversed(self.applied[tag]):
            if (actuation.left_steps_s, actuation.right_steps_s) != (0, 0):
                break
            rest = actuation.time_ns
        return rest

    def wait_for(self, condition: Callable[[], object], what: str) -> None:
        """Lives until the condition holds; fails after much longer than it can take."""
        end_ns = host_ns() + round(PATIENCE_S * S)
        while not condition():
            if host_ns() > end_ns:
                said = "\n".join(p.said for p in self._everything() if isinstance(p, Program))
                raise AssertionError(f"waited in vain for {what}; said was:\n{said}")
            self.live()

    def live_for(self, duration_ns: int) -> None:
        """Lives on for a while."""
        end_ns = host_ns() + duration_ns
        self.wait_for(lambda: host_ns() >= end_ns, "time to pass")

    def live(self) -> None:
        """One round, of a millisecond at the longest."""
        began_ns = host_ns()
        parts = self._everything()
        watched = [self._bases, *(d for part in parts for d in part.descriptors())]
        ready = set(select.select(watched, [], [], 0.001)[0])
        came, now_ns = self._bases.readable(), host_ns()
        self._bases.receive(came, now_ns)
        for actuation in self._bases.advance(now_ns):
            self.applied[self.tags[actuation.robot]].append(actuation)
        for part in parts:
            part.live(ready, now_ns)
        self.held_up_ns = max(self.held_up_ns, host_ns() - began_ns - MS)

    def close(self) -> None:
        """Ends everything."""
        for part in self._everything():
            part.close()
        self._bases.close()

    def _everything(self) -> list[Part]:
        return [*self._parts, *self._daemons.values()]


CLEAN = """
import numpy as np

class Clean:
    name, layout = "pollutant", "u1"

    def read(self, world, robots):
        return np.zeros((len(robots), 1))

def from_xml(element, scope):
    return Clean()
"""
"""Air without pollutant, for the controller that asks for it."""


def clean_air(folder: Path) -> str:
    """Writes the sensor beside an experiment; returns its element."""
    (folder / "clean.py").write_text(CLEAN)
    return '<vs:sensor file="clean.py" />'


def experiment(folder: Path, framework: str, tags: list[int], length_s: float) -> Path:
    """Writes an experiment with robots that wander about.

    Args:
        folder: where to.
        framework: start tag of <framework>, and what else stands in it.
        tags: of the robots, which are called epuck_TAG_0.
        length_s: of the run.
    """
    robots = "\n".join(
        f'<e-puck id="epuck_{tag}_0"><body position="{0.2 * n},0.1,0" orientation="0,0,0"/>'
        '<controller config="wanderer"/></e-puck>'
        for n, tag in enumerate(tags)
    )
    path = folder / "wander.argos"
    path.write_text(f"""<argos-configuration xmlns:vs="urn:vsense:1">
{framework}
<experiment length="{length_s}" ticks_per_second="10" random_seed="1" />
</framework>
<controllers><pollutant_controller id="wanderer" library="pollutant">
<actuators><epuck_wheels implementation="default" /></actuators>
<sensors><epuck_proximity implementation="default" />{clean_air(folder)}</sensors>
<params speed_cm_s="8" walk_s="100" />
</pollutant_controller></controllers>
<arena size="3,2,1" center="0,0,0.5">
{robots}
</arena>
<physics_engines><dynamics2d id="dyn2d" /></physics_engines>
<media />
</argos-configuration>
""")
    return path
