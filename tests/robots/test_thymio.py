"""The driver of a Thymio, through `thymiodirect`, against the lab's dongle."""

from __future__ import annotations

import os
import select
import signal
import struct
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.rigs.places import ROOT
from tests.robots.conftest import QUICKLY, Builder
from tests.robots.rig import MS, TAG, Daemon, Host, S
from vsense.base.clock import host_ns
from vsense.modes.lab._links import PROGRAMS
from vsense.modes.lab._thymio import LIST_NODES, Dongle
from vsense.robots.link.wire import Wanted
from vsense.world.robot_models import model_of


class FakeThymio(threading.Thread):
    """The lab's Thymio and dongle, which live by themselves.

    Attributes:
        asked: the messages that it got.
        moved: every change of the motors' targets, and when.
    """

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.dongle = Dongle(PROGRAMS["thymio"], model_of("thymio2"))
        self.device, self.over = self.dongle.device, False
        self.asked: list[tuple[int, bytes]] = []
        self.moved: list[tuple[int, int, int]] = [(host_ns(), 0, 0)]
        take = self.dongle.take

        def note(number: int, payload: bytes, now_ns: int) -> None:
            self.asked.append((number, payload))
            take(number, payload, now_ns)

        self.dongle.take = note  # type: ignore[method-assign]

    @property
    def targets(self) -> tuple[int, int]:
        return self.moved[-1][1:]

    def run(self) -> None:
        while not self.over:
            ready = select.select([self.dongle.readable()], [], [], 0.001)[0]
            now_ns = host_ns()
            if ready:
                self.dongle.receive(now_ns)
            self.dongle.advance(now_ns)
            if self.dongle.targets != self.targets:
                self.moved.append((now_ns, *self.dongle.targets))
        self.dongle.close()


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
    assert thymio.asked[0] == (LIST_NODES, struct.pack("<H", 5))
    # 644 steps/s of 128.805 um are 83 mm/s, half of what a target of 500 is
    run.wait_for(lambda: thymio.targets == (250, 125), "its speeds")
    run.wait_for(lambda: run.host.last.left_steps_s == 644, "what the host hears")
    thymio.dongle.program.proximity[3] = 4300  # ahead, 20 degrees to the right
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
    thymio.dongle.plugged = False
    stops_by_itself(run, thymio, host_ns())
    run.wait_for(lambda: "the driver is late or silent" in run.daemon.said, "the word")
    thymio.dongle.plugged = True
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
