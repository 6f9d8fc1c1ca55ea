"""The driver of a Thymio, through `thymiodirect`, against a dongle that speaks Aseba's protocol.

Numbers of messages and instructions, and their layout: Mobsya/aseba 78225eb aseba/common/consts.h,
aseba/common/msg/msg.cpp, aseba/vm/vm.c; variables: aseba/targets/playground/robots/thymio2.
"""

from __future__ import annotations

import os
import signal
import struct
import sys
import threading
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.rigs.places import ROOT
from tests.robots.conftest import QUICKLY, Builder
from tests.robots.rig import MS, TAG, Daemon, Host, S
from vsense.base.clock import host_ns
from vsense.robots.link.wire import Wanted

LIST_NODES, GET_NODE_DESCRIPTION = 0xA011, 0xA010
SET_BYTECODE, RUN, GET_VARIABLES, SET_VARIABLES = 0xA001, 0xA003, 0xA00B, 0xA00C
DESCRIPTION, NAMED_VARIABLE, LOCAL_EVENT, NATIVE, VARIABLES, PRESENT = (
    *(0x9000, 0x9001, 0x9002, 0x9003, 0x9005),
    0x900C,
)
NAMES = (
    "_id 1,event.source 1,event.args 32,_productId 1,_fwversion 2,button.backward 1,button.left 1"
    ",button.center 1,button.forward 1,button.right 1,prox.horizontal 7,prox.comm.rx 1"
    ",prox.comm.tx 1,prox.ground.ambiant 2,prox.ground.reflected 2,prox.ground.delta 2"
    ",motor.left.target 1,motor.right.target 1,motor.left.speed 1,motor.right.speed 1"
    ",motor.left.pwm 1,motor.right.pwm 1,acc 3,temperature 1,rc5.address 1,rc5.command 1"
    ",mic.intensity 1,mic.threshold 1,timer.period 2,sd.present 1"
)
SIZES = {name: int(size) for name, size in (pair.split() for pair in NAMES.split(","))}
EVENTS = [
    *(f"button.{where}" for where in ("backward", "left", "center", "forward", "right")),
    *("buttons", "prox", "prox.comm", "tap", "acc", "mic", "sound.finished", "temperature"),
    *("rc5", "motor", "timer0", "timer1"),
]
MOST_VARIABLES = 620
NODE = 41


def _text(text: str) -> bytes:
    return bytes([len(text)]) + text.encode()


class FakeThymio(threading.Thread):
    """A Thymio behind a dongle: its description, its variables, and the instructions that it knows.

    Attributes:
        plugged: its radio is heard; a dongle without one says nothing.
        moved: every change of the motors' targets, and when.
    """

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.device = os.ttyname(self._slave)
        self.plugged, self.over = True, False
        self.at, total = {}, 0
        for name, size in SIZES.items():
            self.at[name] = total
            total += size
        self.own = total
        self.memory = [0] * MOST_VARIABLES
        self.code: dict[int, int] = {}
        self.asked: list[bytes] = []
        self.moved: list[tuple[int, int, int]] = [(host_ns(), 0, 0)]
        self._due_ns: int | None = None

    @property
    def targets(self) -> tuple[int, int]:
        return self.moved[-1][1:]

    def run(self) -> None:
        data = b""
        os.set_blocking(self._master, False)
        while not self.over:
            try:
                data += os.read(self._master, 4096)
            except BlockingIOError:
                time.sleep(0.001)
            if not self.plugged:
                data = b""
            while len(data) >= 6 and len(data) >= 6 + int.from_bytes(data[:2], "little"):
                length, _, number = struct.unpack_from("<3H", data)
                self.asked.append(data[: 6 + length])
                self._take(number, data[6 : 6 + length])
                data = data[6 + length :]
            self._timer()
            self._note()
        os.close(self._master)
        os.close(self._slave)

    def _say(self, number: int, payload: bytes) -> None:
        os.write(self._master, struct.pack("<3H", len(payload), NODE, number) + payload)

    def _take(self, number: int, payload: bytes) -> None:
        words = struct.unpack(f"<{len(payload) // 2}H", payload)
        if number == LIST_NODES:
            self._say(PRESENT, struct.pack("<H", 5))
        elif number == GET_NODE_DESCRIPTION and words[0] == NODE:
            counts = (len(SIZES), len(EVENTS), 1)
            head = struct.pack("<7H", 5, 1534, 32, MOST_VARIABLES, *counts)
            self._say(DESCRIPTION, _text("thymio-II") + head)
            for name, size in SIZES.items():
                self._say(NAMED_VARIABLE, struct.pack("<H", size) + _text(name))
            for name in EVENTS:
                self._say(LOCAL_EVENT, _text(name) + _text("?"))
            native = _text("leds.top") + _text("?") + struct.pack("<H", 0)
            self._say(NATIVE, native)
        elif number == SET_BYTECODE and words[0] == NODE:
            self.code |= {words[1] + i: word for i, word in enumerate(words[2:])}
        elif number == RUN and words[0] == NODE:
            self._event(0xFFFF)
        elif number == SET_VARIABLES and words[0] == NODE:
            self.memory[words[1] : words[1] + len(words) - 2] = words[2:]
        elif number == GET_VARIABLES and words[0] == NODE:
            start, count = words[1:3]
            values = self.memory[start : start + count]
            self._say(VARIABLES, struct.pack(f"<{count + 1}H", start, *values))

    def _event(self, number: int) -> None:
        """Runs the code of an event, as vm.c does: its table comes first, its length before it."""
        vectors = {self.code[at]: self.code[at + 1] for at in range(1, self.code[0], 2)}
        at, stack = vectors.get(number), list[int]()
        while at is not None:
            code = self.code[at]
            kind, rest = code >> 12, code & 0xFFF
            at += 1
            if kind == 0:
                return
            if kind == 1:
                stack.append((rest ^ 0x800) - 0x800)
            elif kind == 3:
                stack.append((self.memory[rest] ^ 0x8000) - 0x8000)
            elif kind == 4:
                self.memory[rest] = stack.pop() & 0xFFFF
            else:
                assert code == 0x8004, f"no instruction that is known here: {code:04x}"
                stack.append(stack.pop() * stack.pop())

    def _timer(self) -> None:
        period_ms = self.memory[self.at["timer.period"]]
        if not period_ms:
            return
        if self._due_ns is None:
            self._due_ns = host_ns() + period_ms * MS
        elif host_ns() >= self._due_ns:
            self._due_ns += period_ms * MS
            self._event(0xFFFE - EVENTS.index("timer0"))

    def _note(self) -> None:
        at = self.at["motor.left.target"]
        left, right = ((value ^ 0x8000) - 0x8000 for value in self.memory[at : at + 2])
        if (left, right) != self.targets:
            self.moved.append((host_ns(), left, right))
        speed = self.at["motor.left.speed"]
        self.memory[speed : speed + 2] = self.memory[at : at + 2]


@pytest.fixture
def thymio() -> Iterator[FakeThymio]:
    one = FakeThymio()
    one.start()
    yield one
    one.over = True
    one.join()


@pytest.fixture(scope="module")
def backer(tmp_path_factory: pytest.TempPathFactory, build: Builder) -> Path:
    """A daemon whose controller drives back where something is near ahead on the right."""
    folder = tmp_path_factory.mktemp("backer")
    source = folder / "backer.c"
    source.write_text(
        '#include "controller.h"\n'
        "static void init(void *s, struct vs_robot *r) { (void)s; (void)r; }\n"
        "static void step(void *s, struct vs_robot *r)\n{ double v[8] = {0}; (void)s;\n"
        '  (void)vs_robot_values(r, vs_robot_sensor(r, "proximity"), v, 8);\n'
        "  vs_robot_set_wheels(r, v[0] > 3000 ? -644 : 644, 322); }\n"
        'const struct vs_controller vs_controller = {"backer", 1, init, step, 0};\n'
    )
    return build(folder / "vsensed", source, *QUICKLY)


class Run:
    """A host and a daemon with the driver of a Thymio."""

    def __init__(self, program: Path, device: str) -> None:
        self.host = Host()
        driver = ROOT / "robot" / "drivers" / "thymio.py"
        words = ["--host", "127.0.0.1", "--port", str(self.host.port), "--tag", str(TAG)]
        base = f"exec:{sys.executable} {driver} {device}"
        self.daemon = Daemon(program, *words, "--insecure", "--base", base)

    def wait_for(self, condition: Callable[[], object], what: str) -> None:
        import select

        end_ns = host_ns() + 20 * S
        while not condition():
            assert host_ns() < end_ns, f"waited in vain for {what}:\n{self.daemon.said}"
            watched = [*self.host.descriptors(), self.daemon.stderr]
            ready = set(select.select(watched, [], [], 0.001)[0])
            if self.daemon.stderr in ready:
                self.daemon.read()
            self.host.serve(ready, host_ns())

    def run(self, thymio: FakeThymio) -> None:
        self.wait_for(lambda: self.host.connected, "a session")
        self.host.wanted = Wanted.RUN
        self.wait_for(lambda: thymio.targets[0] > 0, "motion")

    def close(self) -> None:
        self.daemon.close()
        self.host.close()


@pytest.fixture
def run(thymio: FakeThymio, backer: Path) -> Iterator[Run]:
    pytest.importorskip("thymiodirect")
    one = Run(backer, thymio.device)
    one.run(thymio)
    yield one
    one.close()


def test_a_thymio_drives_as_its_controller_says(run: Run, thymio: FakeThymio) -> None:
    assert thymio.asked[0] == struct.pack("<4H", 2, 1, LIST_NODES, 5)
    # 644 steps/s of 128.805 um are 83 mm/s, half of what a target of 500 is
    run.wait_for(lambda: thymio.targets == (250, 125), "its speeds")
    run.wait_for(lambda: run.host.last.left_steps_s == 644, "what the host hears")
    thymio.memory[thymio.at["prox.horizontal"] + 3] = 4300  # ahead, 20 degrees to the right
    run.wait_for(lambda: thymio.targets == (-250, 125), "what it sees")
    run.host.say(Wanted.STOP)
    run.wait_for(lambda: thymio.targets == (0, 0), "rest")
    run.wait_for(lambda: run.host.last.left_steps_s == 0, "that it is believed")
    assert run.host.last.base_errors == 0
    run.daemon.process.terminate()
    run.wait_for(lambda: run.daemon.process.poll() == 0, "an end in order")


WATCHDOG_NS = 450 * MS
"""Two periods, and what this process may be late."""


def stops_by_itself(run: Run, thymio: FakeThymio, since_ns: int) -> None:
    run.wait_for(lambda: thymio.targets == (0, 0), "rest")
    took_ns = thymio.moved[-1][0] - since_ns
    print("targets 0 after", took_ns // MS, "ms")
    assert took_ns < WATCHDOG_NS


def test_it_stops_by_itself_when_driver_and_daemon_are_killed_at_once(
    run: Run, thymio: FakeThymio
) -> None:
    from tests.rigs.processes import descendants

    family = descendants(run.daemon.process.pid) | {run.daemon.process.pid}
    for number in (signal.SIGSTOP, signal.SIGKILL):
        for pid in family:
            os.kill(pid, number)
    stops_by_itself(run, thymio, host_ns())


def test_it_stops_by_itself_when_its_radio_breaks_and_drives_on_later(
    run: Run, thymio: FakeThymio
) -> None:
    thymio.plugged = False
    stops_by_itself(run, thymio, host_ns())
    run.wait_for(lambda: "the driver is late or silent" in run.daemon.said, "the word")
    thymio.plugged = True
    run.wait_for(lambda: "the driver answers again" in run.daemon.said, "the word")
    run.wait_for(lambda: thymio.targets[0] > 0, "motion again")


def test_it_stops_when_its_host_falls_silent(run: Run, thymio: FakeThymio) -> None:
    run.host.silent = True
    fresh_ns = run.host.fresh_ns
    run.wait_for(lambda: thymio.targets == (0, 0), "rest")
    assert thymio.moved[-1][0] - fresh_ns < 500 * MS


def test_another_driver_does_not_get_its_line(run: Run, thymio: FakeThymio, backer: Path) -> None:
    second = Run(backer, thymio.device)
    second.wait_for(lambda: "another process holds the device" in second.daemon.said, "its reason")
    second.close()
