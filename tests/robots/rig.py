"""One real daemon between a real pseudo-terminal with the firmware's code and a scripted host.

Everything runs in one loop on the monotonic clock, driven by `Rig.wait_for`: no threads, no sleeps.
"""

from __future__ import annotations

import os
import select
import signal
import socket
import subprocess
import tty
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from vsense.base.clock import host_ns
from vsense.base.readings import SensorReadings
from vsense.modes.lab._microcontrollers import Actuation, Microcontrollers
from vsense.robots.link._peer import Orders, Peer
from vsense.robots.link.table import Direction, Entry, Table
from vsense.robots.link.wire import (
    PUBLISHED,
    GoodbyeCause,
    Header,
    Hello,
    Notice,
    PacketType,
    RefuseCode,
    StopCause,
    Telemetry,
    Wanted,
    Welcome,
    answer_key,
    decode,
    encode,
    packet_length,
)
from vsense.robots.python_swarm import OWN_COUNTS
from vsense.run.remote import REMOTE_TABLE, OwnDevices
from vsense.world.robot_models import model_of

MS = 1_000_000
S = 1_000_000_000
TIMESTEP_NS = 100 * MS
LATENCY_NS = 20 * MS
"""How old a capture is when the host first sends it."""

TAG = 23
TABLE = Table([Entry(7, "pollutant", "f4"), Entry(9, "magic", "2*u1")])
PARAMS = "speed_cm_s=8\nstop_probability=1\nstop_probabilty=0\nnear_raw=far\n"
"""Of these the controller does not know one, and one is no number."""

CLEAN = b"\x00\x00\x00\x00"
POLLUTED = b"\x00\x00\x80\x3f"


def traced(path: Path) -> list[dict[str, str]]:
    """The control steps of a trace, each as its columns by name."""
    lines = [line.split() for line in path.read_text().splitlines()[1:]]
    return [dict(zip(words[::2], words[1::2])) for words in lines]


def _open(port: int) -> tuple[socket.socket, socket.socket]:
    """TCP and UDP on one port; 0: any that no other program has, of either kind."""
    while True:
        listener = socket.create_server(("127.0.0.1", port))
        datagrams = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            datagrams.bind(listener.getsockname())
        except OSError:
            listener.close()
            datagrams.close()
            if port != 0:
                raise
        else:
            return listener, datagrams


class Host:
    """The host's end, with a switch for everything that can go wrong.

    Attributes:
        wanted, from_timestep, run: what every STATE says.
        silent: nothing is sent and nothing read any more.
        frozen: captures no longer advance, sequences do.
        udp: datagrams are sent and heard.
        refuse: HELLO is answered with REFUSE, or with these bytes.
        root: what the keys of its sessions are made of.
        answer: in place of that for its answers, None: as it should be.
        pollutant: payload of the first sensor.
        table, params: what WELCOME offers from the next greeting on.
        hellos, telemetry, goodbyes: what came.
        log_heard: the log line up to which it says to have heard.
        fresh_ns: when the newest STATE with a newer capture left.
    """

    def __init__(self, port: int = 0) -> None:
        self.wanted = Wanted.IDLE
        self.from_timestep = 0
        self.run = 1
        self.silent = self.frozen = False
        self.refuse: bool | bytes = False
        self.root = PUBLISHED
        self.answer: bytes | None = None
        self.udp = True
        self.pollutant = CLEAN
        self.table = TABLE
        self.params = PARAMS
        self.hellos: list[Hello] = []
        self.telemetry: list[Telemetry] = []
        self.goodbyes: list[Notice] = []
        self.fresh_ns = self.log_heard = 0
        self._peer = Peer()
        self._session = 0
        self._timestep = self._capture_ns = self._sent_ns = 0
        self._address: Any = None
        self._stream = b""
        self._connection: socket.socket | None = None
        self._listener, self._datagrams = _open(port)
        self.port: int = self._listener.getsockname()[1]

    @property
    def connected(self) -> bool:
        """Whether a session is open."""
        return self._peer.session != 0

    @property
    def last(self) -> Telemetry:
        """The newest telemetry."""
        return self.telemetry[-1] if self.telemetry else Telemetry()

    def descriptors(self) -> list[int]:
        """What has to be waited for."""
        sockets = [self._listener, self._datagrams, self._connection]
        return [] if self.silent else [s.fileno() for s in sockets if s is not None]

    def serve(self, ready: set[int], now_ns: int) -> None:
        """Reads what came and sends what is due."""
        if self.silent:
            return
        if self._listener.fileno() in ready:
            self.drop()
            self._connection = self._listener.accept()[0]
            self._connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        elif self._connection is not None and self._connection.fileno() in ready:
            self._read_stream(now_ns)
        if self._datagrams.fileno() in ready:
            packet, source = self._datagrams.recvfrom(2000)
            if self.udp and self._hear(packet, True, now_ns):
                self._address = source
        if self.connected and now_ns - self._sent_ns >= 50 * MS:
            self.send(now_ns)

    def send(self, now_ns: int) -> None:
        """Sends one STATE; every second one is of a new timestep."""
        self._sent_ns = now_ns
        timestep = now_ns // TIMESTEP_NS
        if timestep > self._timestep and not self.frozen:
            self._timestep, self._capture_ns = timestep, now_ns - LATENCY_NS
            self.fresh_ns = now_ns
        values = [(self.pollutant, self._capture_ns), (b"\x01\x02", -1)]
        packet = self._peer.send_state(
            Orders(self.run, self.wanted, self.from_timestep),
            timestep & 0xFFFFFFFF,
            self._capture_ns,
            values[: len(self.table.of_direction(Direction.SENSOR))],
            now_ns,
            self.log_heard,
        )
        if self.udp and self._address is not None:
            self._datagrams.sendto(packet, self._address)
        elif self._connection is not None:
            self._connection.sendall(packet)

    def say(self, wanted: Wanted) -> None:
        """Wants another run state, and says so at once."""
        self.wanted = wanted
        self.send(host_ns())

    def goodbye(self, cause: GoodbyeCause = GoodbyeCause.END) -> None:
        """Ends the session in an orderly way."""
        assert self._connection is not None
        notice = Notice(cause, "that was all")
        packet = self._peer.encode(Header(PacketType.GOODBYE), notice, host_ns())
        self._connection.sendall(packet)
        self._peer.close()

    def drop(self) -> None:
        """Ends the connection without a word."""
        if self._connection is not None:
            self._connection.close()
        self._connection, self._address, self._stream = None, None, b""
        self._peer.close()

    def close(self) -> None:
        """Ends everything."""
        self.drop()
        self._listener.close()
        self._datagrams.close()

    def _read_stream(self, now_ns: int) -> None:
        assert self._connection is not None
        try:
            got = self._connection.recv(65536)
        except ConnectionError:
            got = b""
        self._stream += got
        while (length := packet_length(self._stream)) and length <= len(self._stream):
            packet, self._stream = self._stream[:length], self._stream[length:]
            self._take(packet, now_ns)
        if not got:
            self.drop()

    def _take(self, packet: bytes, now_ns: int) -> None:
        if packet[3] == PacketType.TELEMETRY:
            self._hear(packet, False, now_ns)
            return
        key = bytes(self._peer._peer.rx_key) if self.connected else self.root
        header, message = decode(packet, key)
        if isinstance(message, Notice):
            self.goodbyes.append(message)
        elif isinstance(message, Hello):
            self.hellos.append(message)
            self._greet(header, packet, now_ns)

    def _greet(self, hello: Header, packet: bytes, now_ns: int) -> None:
        assert self._connection is not None
        if self.refuse:
            notice = Notice(RefuseCode.TAG_IN_USE, "robot 23 is here already")
            key = answer_key(self.answer or self.root, packet)
            refuse = encode(Header(PacketType.REFUSE), notice, key)
            self._connection.sendall(refuse if self.refuse is True else self.refuse)
            return
        self._session += 1
        self._peer.open(self._session, self.table, hello.send_ns, now_ns)
        welcome = Welcome(self.table, TIMESTEP_NS // 1000, 99, self.params)
        header = Header(PacketType.WELCOME, run=self.run)
        self._connection.sendall(
            self._peer.welcome(self.answer or self.root, packet, header, welcome, now_ns)
        )

    def _hear(self, packet: bytes, udp: bool, now_ns: int) -> bool:
        heard = self._peer.receive_telemetry(packet, udp, now_ns)
        if heard is not None:
            self.telemetry.append(heard[1])
        return heard is not None


class Daemon:
    """One `vsensed` process and what it says on standard error."""

    def __init__(self, program: Path, *arguments: str) -> None:
        # In a process group of its own: the kernel ignores Ctrl-Z in one that nobody waits for.
        self.process = subprocess.Popen(
            [program, *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            preexec_fn=os.setpgrp,
        )
        assert self.process.stderr is not None
        self.stderr = self.process.stderr.fileno()
        os.set_blocking(self.stderr, False)
        self.open = True
        self.said = ""

    @property
    def guard(self) -> int | None:
        """The guard's process id; None while there is none."""
        task = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children")
        children = task.read_text().split() if task.exists() else []
        return int(children[0]) if children else None

    @property
    def printed(self) -> str:
        """What it printed on standard output, once it has ended."""
        assert self.process.stdout is not None and self.process.poll() is not None
        return self.process.stdout.read().decode()

    def read(self) -> None:
        """Takes what it said."""
        try:
            got = os.read(self.stderr, 65536)
        except BlockingIOError:
            return
        self.open = bool(got)
        self.said += got.decode()

    def close(self) -> None:
        """Kills what is left."""
        guard = self.guard
        self.process.kill()
        self.process.wait()
        if guard is not None and Path(f"/proc/{guard}").exists():
            os.kill(guard, signal.SIGKILL)
        for pipe in (self.process.stdout, self.process.stderr):
            assert pipe is not None
            pipe.close()


class Rig:
    """Host, daemon and microcontroller, and the loop that keeps them alive.

    Attributes:
        applied: every actuator frame that reached the motors.
        held_up_ns: the longest time that this loop itself was late: the canary. A time that was
            measured while it was large says nothing.
    """

    def __init__(
        self,
        program: Path,
        *more: str,
        kind: str = "argos",
        options: str = "",
        watchdog: bool = False,
    ) -> None:
        self._program = program
        self._more = more
        self._options = options
        self.host = Host()
        models = [model_of("thymio2")] if kind == "thymio" else []
        self.base = Microcontrollers([kind], watchdog, models=models)
        self.applied: list[Actuation] = []
        self.held_up_ns = 0
        self.plugged = True
        self.daemons: list[Daemon] = []

    @property
    def device(self) -> str:
        """The pseudo-terminal that is the robot's serial port, or the socket that is its bus."""
        return self.base.devices[0]

    @property
    def link(self) -> Any:
        """The line to the microcontroller, and its C structs."""
        return self.base.links[0]

    @property
    def daemon(self) -> Daemon:
        """The newest daemon."""
        return self.daemons[-1]

    @property
    def moving(self) -> bool:
        """Whether the wheels turn now."""
        last = self.applied[-1] if self.applied else None
        return last is not None and (last.left_steps_s, last.right_steps_s) != (0, 0)

    def words(self, **changes: str) -> list[str]:
        """A daemon's arguments, with some of them changed."""
        words = {"host": "127.0.0.1", "port": str(self.host.port), "tag": str(TAG)}
        words |= {"base": self.base.bases[0] + self._options, **changes}
        secure = [] if "key" in words else ["--insecure"]
        return [word for name, value in words.items() for word in (f"--{name}", value)] + secure

    def start(self) -> Daemon:
        """Starts a daemon."""
        return self.begin(*self.words(), *self._more)

    def begin(self, *arguments: str) -> Daemon:
        """Starts a daemon with these arguments alone."""
        self.daemons.append(Daemon(self._program, *arguments))
        return self.daemon

    def wait_for(self, condition: Callable[[], object], what: str, seconds: float = 20) -> None:
        """Lives until the condition holds; fails after much longer than it can take."""
        end_ns = host_ns() + int(seconds * S)
        while not condition():
            said = "".join(daemon.said for daemon in self.daemons)
            assert host_ns() < end_ns, f"waited in vain for {what}; daemon said:\n{said}"
            self.live()

    def live_for(self, duration_ns: int) -> None:
        """Lives on for a while."""
        end_ns = host_ns() + duration_ns
        self.wait_for(lambda: host_ns() >= end_ns, "time to pass", 3600)

    def live(self) -> None:
        """One round, of a millisecond at the longest."""
        began_ns = host_ns()
        bases = [self.base] if self.plugged else []
        pipes = [d.stderr for d in self.daemons if d.open]
        watched = [*bases, *self.host.descriptors(), *pipes]
        ready = set(select.select(watched, [], [], self._wait_s(began_ns))[0])
        came = self.base.readable() if self.plugged else []
        now_ns = host_ns()
        if self.plugged:
            self.base.receive(came, now_ns)
            self.applied += self.base.advance(now_ns)
        self.host.serve(ready, now_ns)
        for daemon in self.daemons:
            if daemon.open and daemon.stderr in ready:
                daemon.read()
        self.held_up_ns = max(self.held_up_ns, host_ns() - began_ns - MS)

    def _wait_s(self, now_ns: int) -> float:
        """A millisecond, or less if the base has something to do."""
        due_ns = self.base.due_ns if self.plugged else None
        return 0.001 if due_ns is None else min(max(due_ns - now_ns, 0) / 1e9, 0.001)

    def run(self) -> None:
        """Has the host want a run, and waits until the wheels turn and the robot says so."""
        self.wait_for(lambda: self.host.connected, "a session")
        self.host.wanted = Wanted.RUN
        heard = len(self.host.telemetry)
        self.wait_for(
            lambda: (
                self.moving
                and len(self.host.telemetry) > heard
                and self.host.last.left_steps_s != 0
                and self.host.last.stop_cause == StopCause.NONE
            ),
            "motion",
        )

    def unplug(self) -> None:
        """Pulls the serial line's plug."""
        if self.plugged:
            self.plugged = False
            self.base.close()

    def close(self) -> None:
        """Ends everything."""
        for daemon in self.daemons:
            daemon.close()
        self.host.close()
        self.unplug()


def own_of(rig: Rig) -> dict[str, list[float]]:
    """What the host makes of what the robot says of its own sensors; those that it has now.

    On a busy machine that may be none: whoever waits for one waits on.
    """
    devices = OwnDevices(Table(), [TAG], TIMESTEP_NS)
    numbers, older_us = REMOTE_TABLE.readings(rig.host.last.payload)["own"]
    if older_us is None or older_us >= 1.5 * TIMESTEP_NS / 1000:
        return {}
    devices.hear(TAG, numbers, 0)
    none = SensorReadings([TAG], [], np.zeros((1, 0), np.uint8), np.zeros((1, 0), np.int64))
    sensed = devices.sense(none, 0)
    values = [np.frombuffer(data, "<f4").tolist() for data, _ in sensed[TAG]]
    return {n: v for n, v, t in zip(OWN_COUNTS, values, sensed.captures_ns[0]) if t == 0}


class BareRobot:
    """Two wheels and a lamp behind a terminal, as `base_bare.c` says."""

    def __init__(self) -> None:
        self.master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.device = os.ttyname(self._slave)
        self.state = (0, 0, 0)
        self._line = b""

    def serve(self) -> None:
        self._line += os.read(self.master, 100)
        while b"\n" in self._line:
            line, _, self._line = self._line.partition(b"\n")
            left, right, lamp = map(int, line.split())
            self.state = (left, right, lamp)
            os.write(self.master, b"ok\n")

    def close(self) -> None:
        os.close(self.master)
        os.close(self._slave)


def live_until(condition: Callable[[], object], robot: BareRobot, host: Host) -> None:
    """Has host and robot live until the condition holds."""
    end_ns = host_ns() + 20_000 * MS
    while not condition():
        assert host_ns() < end_ns, f"waited in vain; the robot does {robot.state}"
        watched = [robot.master, *host.descriptors()]
        ready = set(select.select(watched, [], [], 0.001)[0])
        if robot.master in ready:
            robot.serve()
        host.serve(ready, host_ns())
