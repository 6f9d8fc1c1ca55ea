"""Emulated robots and their tracker, for whoever rehearses `vsense run` with them."""

from __future__ import annotations

import json
import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from tests.rigs.processes import free_port
from vsense.base.clock import host_ns

VSENSE = (sys.executable, "-m", "vsense")
TAGS = (31, 1843)


@dataclass(frozen=True)
class Stage:
    """Emulated robots that wait for a host.

    Attributes:
        directory: what they leave.
        port, lines: where they look for a host, and where their tracker waits for one.
        prefix: what all commands begin with.
        said: where they tell what they do.
        experiment, robots: whose they are, and how many.
    """

    directory: Path
    port: int
    lines: int
    prefix: tuple[str, ...]
    said: Path
    experiment: str = "foraging"
    robots: int = 2

    def link(self, duration_s: float) -> subprocess.CompletedProcess[str]:
        """Measures their links."""
        tags = ",".join(map(str, TAGS))
        words = ("robot", "link", tags, "--for", str(duration_s), "--json", "--insecure")
        return self._vsense(*words, "--port", str(self.port))

    def run(self, *words: str, lines: int = 0, port: int = 0) -> subprocess.CompletedProcess[str]:
        """A run with them; its tracker's `lines`, and they, may come to other ports than theirs."""
        ports = ("--tracker", f"lines:{lines or self.lines}", "--port", str(port or self.port))
        robots = ("--robots", str(self.robots), "--insecure")
        return self._vsense("run", self.experiment, *ports, *robots, *words)

    def _vsense(self, *words: str) -> subprocess.CompletedProcess[str]:
        command = [*self.prefix, *VSENSE, *words]
        return subprocess.run(command, capture_output=True, text=True, timeout=60)


@contextmanager
def emulated(
    folder: Path, prefix: Sequence[str] = (), experiment: str = "", robots: int = 2
) -> Iterator[Stage]:
    """Robots of an experiment, or two of foraging with the radios of a weak and of a sleeping link.

    They end in order, or it fails.
    """
    ports = free_port(), free_port()
    whose = experiment or "foraging", robots
    stage = Stage(folder / "robots", *ports, tuple(prefix), folder / "said", *whose)
    command = [*prefix, *VSENSE, "robot", "emulate", str(robots), "--insecure"]
    command += ["--port", str(stage.port), "--experiment", stage.experiment]
    if not experiment:
        command += ["--radio", "31=-84,5.5", "--radio", "1843=-61,54,saves"]
    command += ["--tracker-port", str(stage.lines), "-o", str(stage.directory)]
    with stage.said.open("w") as file:
        robots = subprocess.Popen(
            command, stderr=file, stdout=subprocess.DEVNULL, start_new_session=True
        )
    try:
        yield stage
        # As a terminal does: what stands before the command, such as unshare, ends with it.
        os.killpg(robots.pid, signal.SIGINT)
        assert robots.wait(20) == 130, stage.said.read_text()
    finally:
        robots.kill()
        robots.wait()


Places = Mapping[int, tuple[float, float]]
"""By tag x_m and y_m."""


class Curtain:
    """Passes a tracker's lines on to a port, but for robots while they are hidden.

    Args:
        port, to: where the tracker writes to, and where its lines go.
        hides: gives who is hidden, of where all are and the time since the first line [s].

    Attributes:
        hidden_ns: when somebody was hidden first and last, host's clock.
        places: where all were, by capture time [ns].
    """

    def __init__(self, port: int, to: int, hides: Callable[[Places, float], set[int]]) -> None:
        self.hidden_ns: list[int] = []
        self.places: dict[int, Places] = {}
        self._to, self._hides = to, hides
        self._listener = socket.create_server(("127.0.0.1", port))
        self._thread = threading.Thread(target=self._pass, daemon=True)
        self._thread.start()

    def _pass(self) -> None:
        with self._listener:
            source, _ = self._listener.accept()
        with source, source.makefile("rb") as lines, self._connected() as target:
            begun_ns = host_ns()
            for line in lines:
                data, now_ns = json.loads(line), host_ns()
                places = {r["tag"]: (r["x_m"], r["y_m"]) for r in data["robots"]}
                self.places[data["capture_ns"]] = places
                hidden = self._hides(places, (now_ns - begun_ns) / 1e9)
                if hidden:
                    data["robots"] = [r for r in data["robots"] if r["tag"] not in hidden]
                    self.hidden_ns = [*self.hidden_ns[:1], now_ns]
                try:
                    target.sendall(json.dumps(data).encode() + b"\n")
                except OSError:
                    return  # the run has ended

    def _connected(self) -> socket.socket:
        while True:
            try:
                return socket.create_connection(("127.0.0.1", self._to))
            except ConnectionRefusedError:
                time.sleep(0.05)


class Network:
    """Between robots and the run's host, TCP and UDP; nothing passes while it is cut.

    Args:
        port, to: where robots look for the host, and where it is.
    """

    def __init__(self, port: int, to: int) -> None:
        self.cut = threading.Event()
        self._to = ("127.0.0.1", to)
        self._listener = socket.create_server(("127.0.0.1", port))
        self._datagrams = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._datagrams.bind(("127.0.0.1", port))
        self._streams: dict[socket.socket, socket.socket] = {}
        self._robots: dict[socket.socket, tuple[str, int]] = {}
        threading.Thread(target=self._pass, daemon=True).start()

    def _pass(self) -> None:
        while True:
            if self.cut.is_set():
                time.sleep(0.01)
            streams = () if self.cut.is_set() else (self._listener, *self._streams)
            waiting = (*streams, self._datagrams, *self._robots)
            for ready in select.select(waiting, (), (), 0.05)[0]:
                if ready is self._listener:
                    self._join(self._listener.accept()[0])
                elif ready in self._streams:
                    self._pass_stream(ready)
                elif ready is self._datagrams or ready in self._robots:
                    self._pass_datagram(ready)

    def _join(self, robot: socket.socket) -> None:
        host = socket.socket()
        if host.connect_ex(self._to):
            robot.close()
            return
        self._streams |= {robot: host, host: robot}

    def _pass_stream(self, source: socket.socket) -> None:
        target = self._streams[source]
        try:
            data = source.recv(65536)
            target.sendall(data)
        except OSError:
            data = b""
        if not data:
            for end in (source, target):
                del self._streams[end]
                end.close()

    def _pass_datagram(self, source: socket.socket) -> None:
        try:
            packet, sender = source.recvfrom(65536)
        except OSError:
            return  # nobody listens at the host's port yet
        if self.cut.is_set():
            return
        if source is not self._datagrams:
            self._datagrams.sendto(packet, self._robots[source])
            return
        host = next((end for end, robot in self._robots.items() if robot == sender), None)
        if host is None:
            host = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            host.connect(self._to)
            self._robots[host] = sender
        try:
            host.send(packet)
        except OSError:
            return
