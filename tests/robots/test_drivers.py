"""Robots that a program of any language drives: what goes over its line, and what stops them."""

from __future__ import annotations

import importlib
import os
import pty
import re
import select
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.rigs import compiling
from tests.rigs.processes import children, is_alive
from tests.robots.conftest import QUICKLY, ROOT, Builder
from tests.robots.rig import MS, TAG, BareRobot, Daemon, Host, Rig, S, live_until
from tests.robots.rosters import deploy
from tests.robots.stopping import GUARD_NS, ORDER_NS, still_within
from vsense.base.clock import host_ns
from vsense.config.roster import read as read_roster
from vsense.robots.drivers import Driver
from vsense.robots.link.wire import Wanted

PAGE = ROOT / "robot" / "DRIVERS.md"
KILLED_NS = 600 * MS
"""From a driver's death to speed 0: the next exchange notices it, the next one has to start."""
HUNG_NS = 1000 * MS
"""300 until it counts as silent, an exchange, and as above."""
UNTIL_NS = 400 * MS
"""From the last frame of a host to rest, by the driver alone."""
EOF_NS = 150 * MS

Rigs = Callable[..., Rig]


def driver_of(rig: Rig) -> int:
    """The process id of its driver."""
    found: list[int] = []

    def look() -> bool:
        guard = rig.daemon.guard
        found[:] = [] if guard is None else [p for p in children(guard) if is_alive(p)]
        return bool(found)

    rig.wait_for(look, "a driver")
    return found[0]


@pytest.fixture
def rig(rigs: Rigs) -> Rig:
    """An emulated e-puck whose daemon has the shipped driver."""
    one = rigs(kind="exec")
    one.start()
    one.run()
    rest = host_ns() + 2 * S  # so long a driver has to live for the next one to start at once
    one.wait_for(lambda: host_ns() > rest, "its youth's end")
    return one


@pytest.mark.paced
@pytest.mark.parametrize(
    ("number", "limit_ns", "words"),
    [
        (signal.SIGKILL, KILLED_NS, "the driver ended: starting another"),
        (signal.SIGSTOP, HUNG_NS, "the driver is late or silent: starting another"),
    ],
)
def test_a_driver_that_dies_or_hangs_is_replaced(
    rig: Rig, number: signal.Signals, limit_ns: int, words: str
) -> None:
    drivers: list[int] = []

    def fail() -> int:
        drivers.append(driver_of(rig))
        os.kill(drivers[-1], number)
        return host_ns()

    def mend() -> None:
        rig.wait_for(lambda: rig.moving, "motion again")
        rig.live_for(2 * S)

    still_within(rig, limit_ns, fail, mend)
    # A busy machine may have held up another one besides.
    rig.wait_for(lambda: rig.daemon.said.count(f"base: {words}") >= len(drivers), words)

    def is_heard() -> bool:
        rig.host.log_heard = max(rig.host.log_heard, rig.host.last.log_number)
        return {words, "the driver answers again"} <= {t.log for t in rig.host.telemetry}

    rig.wait_for(is_heard, "the same for the host")
    assert driver_of(rig) not in drivers and not any(map(is_alive, drivers))
    assert rig.host.last.guard_restarts == 0 and rig.host.last.base_errors > 0


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_guard_that_dies_or_hangs_leaves_the_driver_to_the_next_one(
    rig: Rig, number: signal.Signals
) -> None:
    driver = driver_of(rig)

    def fail() -> int:
        assert rig.daemon.guard is not None
        os.kill(rig.daemon.guard, number)
        return host_ns()

    still_within(rig, GUARD_NS, fail, lambda: None)
    rig.run()
    assert is_alive(driver) and rig.daemon.said.count("the driver") == 0


def test_a_worker_that_dies_ends_guard_and_driver(rig: Rig) -> None:
    driver = driver_of(rig)
    rig.daemon.process.kill()
    killed_ns = host_ns()
    rig.wait_for(lambda: not rig.moving, "rest")
    assert rig.applied[-1].time_ns - killed_ns < ORDER_NS + EOF_NS
    rig.wait_for(lambda: not is_alive(driver), "its end")


def test_a_driver_whose_daemon_is_killed_whole_stops_the_robot(rig: Rig) -> None:
    """What no native base can: there is a process more that knows how."""
    driver = driver_of(rig)
    assert rig.daemon.guard is not None
    rig.daemon.process.send_signal(signal.SIGSTOP)
    os.kill(rig.daemon.guard, signal.SIGKILL)
    rig.daemon.process.kill()
    killed_ns = host_ns()
    rig.wait_for(lambda: not rig.moving, "rest")
    print("speed 0 after", (rig.applied[-1].time_ns - killed_ns) // MS, "ms")
    rig.wait_for(lambda: not is_alive(driver), "its end")


def test_a_driver_whose_daemon_hangs_whole_keeps_to_the_time_it_was_given(rig: Rig) -> None:
    guard = rig.daemon.guard
    assert guard is not None
    for pid in (guard, rig.daemon.process.pid):
        os.kill(pid, signal.SIGSTOP)
    stopped_ns = host_ns()
    rig.wait_for(lambda: not rig.moving, "rest")
    took_ns = rig.applied[-1].time_ns - stopped_ns
    print("speed 0 after", took_ns // MS, "ms")
    assert took_ns < UNTIL_NS
    for pid in (rig.daemon.process.pid, guard):
        os.kill(pid, signal.SIGCONT)


def test_a_daemon_that_is_killed_with_its_driver_leaves_the_wheels_turning(rig: Rig) -> None:
    """The page says so; the next daemon finds the robot and stops it."""
    guard, driver = rig.daemon.guard, driver_of(rig)
    assert guard is not None
    for number in (signal.SIGSTOP, signal.SIGKILL):
        for pid in (driver, guard, rig.daemon.process.pid):
            os.kill(pid, number)
    rig.wait_for(lambda: not rig.daemon.open, "the end of all")
    rig.live_for(S)
    assert rig.moving
    rig.start()
    rig.wait_for(lambda: not rig.moving, "standing wheels")


def test_another_daemons_driver_does_not_get_the_device(rig: Rig) -> None:
    driver = driver_of(rig)
    second = rig.begin(*rig.words(tag=str(TAG + 1)))
    rig.wait_for(lambda: "another process holds the device" in second.said, "its reason")
    rig.wait_for(lambda: "base: the driver ended" in second.said, "the daemon's word")
    assert second.process.poll() is None and is_alive(driver)


def test_deploy_brings_a_driver_with_the_file_that_it_needs(
    boards: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("own", "shipped"):
        (boards / name / "run" / "systemd" / "system").mkdir(parents=True)
    (tmp_path / "mine.py").write_text("import vsense_driver\n")
    (tmp_path / "room.txt").write_text("white\n")
    lines = (
        "own tag=1 base=exec:mine.py~/dev/ttyUSB0~room.txt\nshipped tag=2 base=exec:epuck~/dev/x\n"
    )
    assert deploy(tmp_path, lines) == 2
    said = capsys.readouterr().err
    assert "own: its base is a driver, and this vsensed has none" in said and not list(
        boards.glob("*.told")
    )
    with (tmp_path / "vsensed").open("a") as daemon:
        daemon.write("# exec:COMMAND\n")
    assert deploy(tmp_path, lines) == 0
    place = Path("usr/local/lib/vsense")
    own, shipped = boards / "own", boards / "shipped"
    conf = (own / "etc/vsensed.conf").read_text()
    assert f"base = exec:python3 /{place}/mine.py /dev/ttyUSB0 /{place}/room.txt\n" in conf
    assert f"base = exec:python3 /{place}/epuck.py /dev/x\n" in (
        (shipped / "etc/vsensed.conf").read_text()
    )
    helper = (ROOT / "robot/drivers/vsense_driver.py").read_bytes()
    names = {p.name: p.read_bytes() for p in (own / place).iterdir()}
    assert names == {
        "mine.py": b"import vsense_driver\n",
        "room.txt": b"white\n",
        "vsense_driver.py": helper,
    }
    assert {p.name for p in (shipped / place).iterdir()} == {"epuck.py", "vsense_driver.py"}
    base = str(read_roster(tmp_path / "robots.toml").robots[1].base)
    driver = Driver.of(base, tmp_path)
    assert driver is not None and driver.here().startswith(f"exec:{sys.executable} {ROOT}")


# A driver that does what a test says: its line ends in the test.

RELAY = """
import os, select, socket, sys
test = socket.socket(socket.AF_UNIX)
test.connect(sys.argv[1])
while True:
    for ready in select.select([0, test], [], [])[0]:
        data = os.read(0, 4096) if ready == 0 else test.recv(4096)
        if not data:
            sys.exit(0)
        test.sendall(data) if ready == 0 else os.write(1, data)
"""
KINDS = {"u8": "B", "u16": "H", "u32": "I", "u64": "Q", "i16": "h", "i32": "i", "i64": "q"}


def rows(title: str) -> list[tuple[int, str, int, str]]:
    """A table of the page: place, struct's letter, count and name of each field."""
    text = PAGE.read_text().partition(f"## {title}")[2].partition("\n## ")[0]
    found = re.findall(r"^\| (\d+) \| (?:(\d+) × )?(\w+) \| `(\w+)` \|", text, re.M)
    return [(int(at), KINDS[kind], int(count or 1), name) for at, count, kind, name in found]


def packed(title: str, size: int, **values: Any) -> bytes:
    """A record as the page says, zeros where nothing is said."""
    record = bytearray(size)
    for at, letter, count, name in rows(title):
        value = values.pop(name, 0)
        numbers = value if isinstance(value, tuple) else (value,)
        struct.pack_into(f"<{min(count, len(numbers))}{letter}", record, at, *numbers[:count])
    assert not values, "all are on the page"
    return bytes(record)


class Scripted:
    """Host, daemon, and the test's end of its driver's line."""

    def __init__(self, program: Path, folder: Path, *more: str) -> None:
        path, relay = folder / "line", folder / "relay.py"
        relay.write_text(RELAY)
        self.host = Host()
        self.lines: list[socket.socket] = []
        self.orders: list[dict[str, Any]] = []
        self.answering = True
        self.values: dict[str, Any] = {"flags": 1, "max_mm_s": 200, "battery_low": 255}
        self.delay_ns = 0
        self._due: list[tuple[int, bytes]] = []
        self._listener = socket.socket(socket.AF_UNIX)
        self._listener.bind(str(path))
        self._listener.listen()
        base = f"exec:{sys.executable} {relay} {path}"
        words = ["--host", "127.0.0.1", "--port", str(self.host.port), "--tag", str(TAG)]
        self.daemon = Daemon(program, *words, "--insecure", "--base", base, *more)

    def wait_for(self, condition: Callable[[], object], what: str, seconds: float = 20) -> None:
        end_ns = host_ns() + int(seconds * S)
        while not condition():
            assert host_ns() < end_ns, f"waited in vain for {what}:\n{self.daemon.said}"
            line = self.lines[-1:]
            watched = [self._listener, *line, *self.host.descriptors(), self.daemon.stderr]
            ready = select.select(watched, [], [], 0.001)[0]
            if self._listener in ready:
                self.lines.append(self._listener.accept()[0])
            if line and line[0] in ready:
                self._read(line[0])
            while self._due and self._due[0][0] <= host_ns():
                self.say(self._due.pop(0)[1])
            if self.daemon.stderr in ready:
                self.daemon.read()
            self.host.serve({r for r in ready if isinstance(r, int)}, host_ns())

    def say(self, data: bytes) -> None:
        """Writes what the newest driver shall write; a driver that is gone writes nothing."""
        try:
            self.lines[-1].sendall(data)
        except ConnectionError:
            self._due.clear()

    def _read(self, line: socket.socket) -> None:
        try:
            data = line.recv(1 << 16)
        except ConnectionError:
            data = b""
        assert len(data) % 48 == 0
        for start in range(0, len(data), 48):
            fields = {
                name: struct.unpack_from(f"<{count}{letter}", data, start + at)
                for at, letter, count, name in rows("An order")
            }
            self.orders.append({n: v if len(v) > 1 else v[0] for n, v in fields.items()})
            if self.answering:
                self._due.append((host_ns() + self.delay_ns, self.report()))

    def report(self, **changes: Any) -> bytes:
        """A report that follows the newest order."""
        order_ns = self.orders[-1]["sent_ns"] if self.orders else 0
        own = {"magic": tuple(b"vsd\1"), "order_ns": order_ns, "measured_ns": time.monotonic_ns()}
        return packed("A report", 160, **{**own, **self.values, **changes})

    def run(self) -> None:
        self.wait_for(lambda: self.host.connected, "a session")
        self.host.wanted = Wanted.RUN
        self.wait_for(lambda: self.orders[-1:] and self.orders[-1]["left_um_s"] > 0, "motion")

    def close(self) -> None:
        self.daemon.close()
        for one in (self._listener, *self.lines):
            one.close()
        self.host.close()


@pytest.fixture(scope="module")
def steady(tmp_path_factory: pytest.TempPathFactory, build: Builder) -> Path:
    """A daemon whose controller shows what it senses, and drives 500 and 100 steps a second."""
    folder = tmp_path_factory.mktemp("steady")
    source = folder / "steady.c"
    names = ("proximity", "light", "wheels", "ground", "battery", "gyroscope", "distance")
    shows = "".join(
        f'  n = vs_robot_values(robot, vs_robot_sensor(robot, "{name}"), v, 8);\n'
        f'  vs_robot_show(robot, "{name[:9]}", n > 0 ? v[n - 1] : -1);\n'
        for name in names
    )
    source.write_text(
        '#include "controller.h"\n'
        "static void init(void *s, struct vs_robot *r) { (void)s; (void)r; }\n"
        "static void step(void *s, struct vs_robot *robot)\n{\n  double v[8]; int n; (void)s;\n"
        f"{shows}"
        '  n = vs_robot_sensor(robot, "proximity");\n'
        '  vs_robot_show(robot, "age_ms", (double)(vs_robot_read(robot, n).age_ns / 1000000u));\n'
        "  vs_robot_set_wheels(robot, 500, 100);\n  vs_robot_set_leds(robot, 0x105);\n}\n"
        'const struct vs_controller vs_controller = {"steady", 1, init, step, 0};\n'
    )
    return build(folder / "vsensed", source, *QUICKLY)


@pytest.fixture
def scripted(steady: Path, tmp_path: Path) -> Iterator[Scripted]:
    one = Scripted(steady, tmp_path)
    yield one
    one.close()


def shown(scripted: Scripted) -> dict[str, Any]:
    return dict(scripted.host.last.shown)


def test_the_page_says_what_goes_over_the_line(scripted: Scripted) -> None:
    assert [at for at, *_ in rows("An order")] == [0, 4, 8, 16, 24, 28, 32, 34]
    scripted.values |= {
        "flags": 1 | 2 | 8 | 16,
        "way_um": (0, 0),
        "battery_mv": 3912,
        "proximity_count": 7,
        "light_count": 16,
        "distance_mm": 345,
        "ground": (1, 2, 1023),
        "gyroscope": (1, 2, -1500),
        "proximity": (1, 2, 3, 4, 5, 6, 7, 8),
        "light": tuple(range(4000, 4016)),
    }
    scripted.run()
    scripted.values["way_um"] = (-250_000, 5_000_000)
    scripted.wait_for(lambda: shown(scripted).get("wheels", 0) > 400, "a way")
    assert shown(scripted) == pytest.approx(
        {
            "proximity": 0,  # of seven the eighth is far
            "light": 4007,
            "wheels": 500,
            "ground": 1,
            "battery": 3912,
            "gyroscope": -1.5,
            "distance": 345,
            "age_ms": shown(scripted)["age_ms"],
        },
        abs=0.02,
    )
    order = scripted.orders[-1]
    assert order["magic"] == tuple(b"vsd\1") and order["leds"] == 0x105
    assert (order["left_um_s"], order["right_um_s"]) == (64402, 12880)  # of 128.805 um a step
    assert 0 < order["until_ns"] - order["sent_ns"] < 260 * MS
    assert abs(time.monotonic_ns() - order["sent_ns"]) < S


def test_readings_have_the_age_that_the_driver_says(scripted: Scripted) -> None:
    scripted.values["proximity_count"] = 8
    scripted.run()
    scripted.wait_for(lambda: 0 <= shown(scripted).get("age_ms", -1) < 90, "new ones")
    report = scripted.report
    scripted.report = lambda: report(  # type: ignore[method-assign]
        measured_ns=time.monotonic_ns() - 300 * MS
    )
    scripted.wait_for(lambda: 300 <= shown(scripted)["age_ms"] < 390, "old ones")


def test_speeds_are_what_the_driver_can_do(scripted: Scripted) -> None:
    scripted.values["max_mm_s"] = 30
    scripted.run()
    scripted.wait_for(lambda: scripted.orders[-1]["left_um_s"] < 31_000, "a slow robot")
    assert scripted.orders[-1]["left_um_s"] > 29_000
    assert scripted.orders[-1]["right_um_s"] == 12880


def test_a_slow_driver_drives_and_its_stop_is_believed_when_it_says_so(scripted: Scripted) -> None:
    scripted.delay_ns = 80 * MS
    scripted.run()
    scripted.wait_for(lambda: scripted.host.last.left_steps_s == 500, "its word")
    scripted.host.say(Wanted.STOP)
    scripted.wait_for(lambda: scripted.orders[-1]["left_um_s"] == 0, "the stop")
    scripted.wait_for(lambda: scripted.host.last.left_steps_s == 0, "its word")
    assert scripted.host.last.base_errors == 0 and len(scripted.lines) == 1, scripted.daemon.said


def test_a_driver_whose_robot_is_not_there_at_first_is_asked_again(scripted: Scripted) -> None:
    scripted.answering = False
    scripted.wait_for(lambda: len(scripted.orders) > 9, "orders")
    assert not any(order["left_um_s"] or order["right_um_s"] for order in scripted.orders)
    late = {"order_ns": scripted.orders[0]["sent_ns"]}
    scripted.say(scripted.report(**late))  # it goes through what has come one by one
    scripted.answering = True
    scripted.run()
    assert len(scripted.lines) == 1 and "the driver" not in scripted.daemon.said


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        (lambda s: b"Hello, world!\n" * 12, "writes what is no report: does it print?"),
        (lambda s: s.report(magic=tuple(b"vsd\2")), "is of another version of DRIVERS.md"),
        (lambda s: s.report(order_ns=2**63), "writes what is no report"),
        (lambda s: s.report(measured_ns=time.monotonic_ns() + S), "writes what is no report"),
        (lambda s: s.report(proximity_count=17), "writes what is no report"),
        (lambda s: s.report(battery_low=7), "writes what is no report"),
    ],
)
def test_a_driver_that_is_wrong_is_replaced(
    scripted: Scripted, bad: Callable[[Scripted], bytes], words: str
) -> None:
    scripted.run()
    scripted.say(bad(scripted))
    scripted.wait_for(lambda: f"base: the driver {words}" in scripted.daemon.said, "its fault")
    scripted.wait_for(lambda: len(scripted.lines) == 2, "another one")
    first = len(scripted.orders)
    scripted.wait_for(lambda: len(scripted.orders) > first, "its orders")
    assert scripted.orders[first]["left_um_s"] == 0, "the first one is to rest"
    scripted.wait_for(lambda: scripted.orders[-1]["left_um_s"] > 0, "motion again")


def test_a_late_driver_is_replaced(scripted: Scripted) -> None:
    scripted.run()
    scripted.delay_ns = 400 * MS
    text = "base: the driver is late or silent: starting another"
    scripted.wait_for(lambda: text in scripted.daemon.said, "its fault")
    scripted.delay_ns = 0
    scripted.wait_for(lambda: len(scripted.lines) == 2, "another one")
    scripted.wait_for(lambda: scripted.orders[-1]["left_um_s"] > 0, "motion again")


def test_an_orderly_end_is_told_to_the_driver(scripted: Scripted) -> None:
    scripted.run()
    scripted.daemon.process.terminate()
    scripted.wait_for(lambda: scripted.daemon.process.poll() is not None, "the end")
    assert scripted.daemon.process.returncode == 0
    last = scripted.orders[-1]
    assert (last["flags"], last["left_um_s"], last["leds"]) == (1, 0, 0)


def test_a_command_that_cannot_be_run_is_told(steady: Path) -> None:
    words = ["--host", "127.0.0.1", "--port", "9", "--tag", str(TAG), "--insecure"]
    told = "the driver's command cannot be run: is it there, and executable?"
    check = subprocess.run(
        [steady, *words, "--base", "exec:/nowhere/driver", "--check"],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert check.returncode == 1
    assert f"base     BAD  exec on /nowhere/driver: {told}" in check.stdout


def test_a_driver_in_c_is_one_short_file(tmp_path: Path, steady: Path) -> None:

    source = ROOT / "robot" / "drivers" / "two_wheels.c"
    compiling.compiled(tmp_path / "driver", "-std=c99", *compiling.STRICT, source)
    robot, host = BareRobot(), Host()
    words = ["--host", "127.0.0.1", "--port", str(host.port), "--tag", str(TAG), "--insecure"]
    base = f"exec:{tmp_path / 'driver'} {robot.device}"
    daemon = subprocess.Popen([steady, *words, "--base", base], stderr=subprocess.DEVNULL)
    try:
        host.wanted = Wanted.RUN
        live_until(lambda: robot.state == (64, 12, 1), robot, host)
        daemon.send_signal(signal.SIGSTOP)  # the guard gives it up after 250 ms
        live_until(lambda: robot.state[:2] == (0, 0), robot, host)
        daemon.send_signal(signal.SIGCONT)
        live_until(lambda: robot.state == (64, 12, 1), robot, host)
        daemon.terminate()
        live_until(lambda: daemon.poll() is not None, robot, host)
        assert daemon.returncode == 0 and robot.state == (0, 0, 0)
    finally:
        daemon.kill()
        daemon.wait()
        robot.close()
        host.close()


def test_an_epucks_driver_whose_line_is_gone_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """A terminal that was hung up is readable for ever, and has nothing."""
    monkeypatch.syspath_prepend(str(ROOT / "robot" / "drivers"))
    master, device = pty.openpty()
    robot = importlib.import_module("epuck").EPuck(os.ttyname(device))
    os.close(device)
    os.close(master)
    with pytest.raises(SystemExit, match="the serial line is gone"):
        robot.read()
    os.close(robot.line)
