"""Stops from outside: what still stops the wheels when the daemon cannot."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from tests.rigs.processes import children
from tests.robots.rig import MS, Rig, S
from tests.robots.stopping import ATTEMPTS, CANARY_NS, still_within, wait_said
from vsense.base.clock import host_ns
from vsense.base.native import lib
from vsense.modes.lab._microcontrollers import Actuation
from vsense.modes.lab.hardware import BASE_KINDS
from vsense.robots.link.wire import StopCause

Rigs = Callable[..., Rig]

NATIVE = [kind for kind in BASE_KINDS if kind not in ("exec", "wifi")]
"""A driver stops its robot when its daemon is gone."""

WATCHDOG_NS = 400 * MS
STEP_NS = 100 * MS
STOP_NS = 450 * MS
IN_RESET = "base: its microcontroller does not answer and is being reset"


def kill_both(rig: Rig) -> int:
    """Kills worker and guard at once while the wheels turn; returns when."""

    def tell(number: signal.Signals) -> int:
        guard = rig.daemon.guard
        assert guard is not None
        now_ns = host_ns()
        # The guard first: the kernel wakes what is stopped when its parent ends.
        for pid in (guard, rig.daemon.process.pid):
            os.kill(pid, number)
        return now_ns

    while True:
        rig.run()
        stopped_ns = tell(signal.SIGSTOP)
        rig.live_for(20 * MS)  # what was under way arrives
        if rig.moving:
            break
        tell(signal.SIGCONT)
    tell(signal.SIGKILL)
    rig.wait_for(lambda: not rig.daemon.open, "the end of both processes")
    return stopped_ns


def stopped_ns(rig: Rig, since_ns: int) -> int:
    """When the wheels came to rest for good."""
    rests = [a.time_ns for a in rig.applied if (a.left_steps_s, a.right_steps_s) == (0, 0)]
    return next(at_ns for at_ns in rests if at_ns >= since_ns)


@pytest.mark.parametrize("kind", NATIVE)
def test_both_processes_killed_at_once_with_a_firmware_watchdog(rigs: Rigs, kind: str) -> None:
    rig = rigs(kind=kind, watchdog=True)
    rig.start()
    rig.run()
    rig.live_for(S)
    assert rig.link.program.state.body.stops == 0, "a daemon that lives feeds it"
    killed_ns = kill_both(rig)
    rig.wait_for(lambda: not rig.moving, "rest")
    assert stopped_ns(rig, killed_ns) - killed_ns <= WATCHDOG_NS + STEP_NS
    assert rig.link.program.state.body.stops == 1
    rig.start()
    rig.run()


@pytest.mark.parametrize("kind", NATIVE)
def test_both_processes_killed_at_once_without_one(rigs: Rigs, kind: str) -> None:
    """README and `--help` say so; the next daemon finds the robot and stops it."""
    rig = rigs(kind=kind)
    rig.start()
    kill_both(rig)
    rig.live_for(2 * S)
    assert rig.moving, "nobody is left who could stop the wheels"
    rig.start()
    rig.wait_for(lambda: not rig.moving, "standing wheels")


def wire_reset(rig: Rig, folder: Path) -> None:
    """Makes a GPIO's folder, and has its value reset the microcontroller while it is 0.

    A reset frees the bus that the microcontroller holds low.
    """
    for name in ("direction", "value"):
        (folder / name).touch()
    value = folder / "value"
    link, base = rig.link, rig.base
    advance = base.advance
    reset = getattr(lib, f"{link.program.kind.prefix}_reset")

    def reset_or_advance(now_ns: int) -> list[Actuation]:
        if value.read_bytes() == b"0":
            reset(link.program.state, now_ns // 1000)
            link.wires.stuck = 0
            base.wake()
        return advance(now_ns)

    base.advance = reset_or_advance  # type: ignore[method-assign]


@pytest.mark.parametrize("kind", ["gctronic", "york"])
def test_a_stuck_bus_is_freed_by_a_reset(rigs: Rigs, tmp_path: Path, kind: str) -> None:
    rig = rigs(kind=kind, options=f",reset={tmp_path}")
    wire_reset(rig, tmp_path)
    rig.start()

    def fail() -> int:
        rig.link.wires.stuck = 1
        return host_ns()

    still_within(rig, STOP_NS, fail, lambda: None)
    assert rig.link.wires.stuck == 0 and IN_RESET in rig.daemon.said
    rig.run()
    assert (tmp_path / "direction").read_text() == "high"
    assert (tmp_path / "value").read_text() == "1"


@pytest.mark.parametrize("kind", ["gctronic", "york"])
def test_without_a_reset_a_stuck_bus_leaves_the_wheels_turning(rigs: Rigs, kind: str) -> None:
    rig = rigs(kind=kind)
    rig.start()
    rig.run()
    rig.link.wires.stuck = 1
    wait_said(rig, 1, "wheels held: the base does not answer")
    rig.live_for(S)
    assert rig.moving
    rig.link.wires.stuck = 0
    rig.wait_for(lambda: not rig.moving, "standing wheels")


def test_a_robot_that_is_switched_off_is_reset_now_and_then(rigs: Rigs, tmp_path: Path) -> None:
    rig = rigs(kind="gctronic", options=f",reset={tmp_path}")
    wire_reset(rig, tmp_path)
    rig.link.program.state.device.address = 0x7F
    rig.start()
    rig.wait_for(lambda: IN_RESET in rig.daemon.said, "a reset")
    rig.live_for(S)
    assert (tmp_path / "value").read_text() == "1", "it is let go, and has time to boot"


@pytest.fixture
def watched(rigs: Rigs, tmp_path: Path) -> Iterator[tuple[Rig, int]]:
    """A rig that drives, and what its daemon writes to its watchdog."""
    path = tmp_path / "watchdog"
    os.mkfifo(path)
    reader = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    rig = rigs("--watchdog", str(path))
    rig.start()
    rig.run()
    yield rig, reader
    os.close(reader)


def test_guard_feeds_the_boards_watchdog_and_an_orderly_end_closes_it(
    watched: tuple[Rig, int],
) -> None:
    rig, reader = watched
    rig.live_for(3 * S)
    fed = os.read(reader, 100)
    assert 2 <= len(fed) <= 8 and set(fed) == {0}
    guard = rig.daemon.guard
    assert guard is not None
    os.kill(guard, signal.SIGKILL)
    rig.wait_for(lambda: rig.host.last.guard_restarts == 1, "another guard")
    rig.run()
    os.read(reader, 100)
    rig.live_for(2 * S)
    assert set(os.read(reader, 100)) == {0}, "the next guard feeds it, too"
    rig.daemon.process.terminate()
    rig.wait_for(lambda: rig.daemon.process.poll() == 0, "the end")
    assert os.read(reader, 100).endswith(b"V")


def test_the_boards_watchdog_outlives_a_daemon_that_is_killed(watched: tuple[Rig, int]) -> None:
    rig, reader = watched
    kill_both(rig)
    assert b"V" not in os.read(reader, 100)


def test_daemon_does_without_a_watchdog_that_it_cannot_have(rigs: Rigs) -> None:
    rig = rigs("--watchdog", "/nowhere/watchdog")
    rig.start()
    rig.run()
    words = "--watchdog /nowhere/watchdog: errno 2; going on without it"
    assert rig.daemon.said.count(words) == 1


def test_a_file_is_no_watchdog_and_stays_as_it_is(rigs: Rigs, tmp_path: Path) -> None:
    path = tmp_path / "notes"
    path.write_text("do not lose this")
    rig = rigs("--watchdog", str(path))
    rig.start()
    rig.run()
    wait_said(rig, 1, f"--watchdog {path}: is no device; going on without it")
    rig.live_for(2 * S)
    assert path.read_text() == "do not lose this"


def set_battery(rig: Rig, millivolts: int) -> None:
    rig.link.program.state.body.inputs.battery_mv = millivolts


def test_a_pi_pucks_battery_reaches_the_host_and_stops_the_robot(rigs: Rigs) -> None:
    rig = rigs("--battery-stop-mv", "3500", kind="gctronic", options=",battery")
    rig.start()
    rig.run()
    rig.wait_for(lambda: (rig.host.last.battery_mv, rig.host.last.battery_low) == (4000, 0), "it")
    set_battery(rig, 3300)
    rig.wait_for(lambda: rig.host.last.stop_cause == StopCause.BATTERY, "the cause")
    rig.wait_for(lambda: not rig.moving, "rest")
    assert (rig.host.last.battery_mv, rig.host.last.battery_low) == (3300, 1)
    wait_said(rig, 1, "wheels held: the battery is empty")
    set_battery(rig, 3640)
    rig.live_for(2 * S)
    assert not rig.moving, "a battery rises when the wheels rest"
    set_battery(rig, 3700)
    rig.run()


def test_a_battery_that_is_only_told_to_be_low_stops_the_robot(rigs: Rigs) -> None:
    rig = rigs("--battery-stop-mv", "3400")
    rig.start()
    rig.run()
    set_battery(rig, 3300)
    rig.wait_for(lambda: rig.host.last.stop_cause == StopCause.BATTERY, "the cause")
    rig.wait_for(lambda: not rig.moving, "rest")
    assert rig.host.last.battery_mv == 0


def test_a_battery_stops_nobody_who_has_not_asked_for_it(rigs: Rigs) -> None:
    rig = rigs(kind="asercom")
    rig.start()
    rig.run()
    set_battery(rig, 3000)
    rig.live_for(5 * S)
    assert rig.moving and rig.host.last.battery_low == 1


KILLED, HELD = (signal.SIGSTOP, signal.SIGKILL), (signal.SIGSTOP,)
FAILURES: dict[str, tuple[tuple[str, ...], tuple[signal.Signals, ...]]] = {
    "driver killed": (("driver",), KILLED),
    "driver held": (("driver",), HELD),
    "worker killed": (("worker",), KILLED),
    "worker held": (("worker",), HELD),
    "guard killed": (("guard",), KILLED),
    "guard held": (("guard",), HELD),
    "daemon killed": (("guard", "worker"), KILLED),
    "daemon held": (("guard", "worker"), HELD),
    "driver and daemon killed": (("driver", "guard", "worker"), KILLED),
    "host silent": ((), ()),
    "host gone": ((), ()),
    "link broken": ((), ()),
}
"""What fails: who gets which signals."""
DRIVES_ON = {
    "exec": {"driver and daemon killed", "link broken"},
    "ros2": {"driver and daemon killed", "link broken"},
    "wifi": {"daemon killed", "daemon held", "link broken"},
    "thymio": set[str](),
}
"""What stops nobody; a ROS 2 robot's own controller may, the lab's has none."""
ANEW = {"exec": {"driver killed", "driver held"}, "ros2": {"driver killed", "driver held"}}
"""What stops it is the next driver, an interpreter that has to start: no bound of ours."""


class Ways:
    """One robot, and what can fail of it."""

    def __init__(self, rig: Rig, way: str) -> None:
        self.rig, self.way = rig, way
        rig.start()
        rig.run()

    def pids(self, *names: str) -> list[int]:
        worker, guard = self.rig.daemon.process.pid, self.rig.daemon.guard
        assert guard is not None
        drivers = children(guard) if self.way != "wifi" else []
        known = {"worker": worker, "guard": guard, **dict(zip(["driver"], drivers))}
        return [known[name] for name in names]

    def link(self, works: bool) -> None:
        if self.way == "exec":
            self.rig.plugged = works
        else:
            name = {"wifi": "broken", "thymio": "plugged", "ros2": "mute"}[self.way]
            setattr(self.rig.link, name, works == (self.way == "thymio"))

    def host(self, failure: str, works: bool) -> None:
        if failure == "host gone" and not works:
            self.rig.host.drop()
        self.rig.host.silent = not works

    def fail(self, failure: str) -> int | None:
        """When the wheels had rested after a failure, in ms; None: they turned on."""
        rig = self.rig
        names, signals = FAILURES[failure]
        rig.live_for(2200 * MS if "driver" in failure else 300 * MS)  # a young one waits for that
        rig.wait_for(lambda: rig.moving, "motion")
        pids, since_ns = self.pids(*names), host_ns()
        rig.held_up_ns = 0
        for number in signals:
            for pid in pids:
                os.kill(pid, number)
        if failure.startswith("host"):
            self.host(failure, False)
        elif failure == "link broken":
            self.link(False)
        if failure in DRIVES_ON[self.way]:
            rig.live_for(S)
            assert rig.moving, failure
            took_ms = None
        else:
            rig.wait_for(lambda: not rig.moving, f"rest after {failure}")
            took_ms = (rig.applied[-1].time_ns - since_ns) // MS
        self.mend(failure, pids, signals)
        return took_ms

    def mend(self, failure: str, pids: list[int], signals: tuple[signal.Signals, ...]) -> None:
        rig = self.rig
        if failure.startswith("host"):
            self.host(failure, True)
        elif failure == "link broken":
            self.link(True)
        elif signals == HELD:
            for pid in pids:
                with suppress(ProcessLookupError):  # it was killed, and another is in its place
                    os.kill(pid, signal.SIGCONT)
        if rig.daemon.process.poll() is not None:
            rig.host.drop()
            rig.start()
        rig.run()


@pytest.mark.parametrize(
    "way",
    ["thymio", "ros2", *(pytest.param(w, marks=pytest.mark.campaign) for w in ("exec", "wifi"))],
)
def test_whatever_fails_each_way_in_stops_as_its_page_says(rigs: Rigs, way: str) -> None:
    """The table of robot/DRIVERS.md; the first two have tests of their own besides."""
    ways, took_ms = Ways(rigs(kind=way), way), dict[str, int | None]()
    for failure in FAILURES:
        if way == "wifi" and "driver" in failure:
            continue
        for _ in range(ATTEMPTS):
            took_ms[failure] = ways.fail(failure)
            late = (took_ms[failure] or 0) > STOP_NS // MS
            if not late or ways.rig.held_up_ns < CANARY_NS:
                break
        print(way, failure, took_ms[failure], "ms; this loop late by", ways.rig.held_up_ns // MS)
        if failure not in ANEW.get(way, ()):
            assert (took_ms[failure] or 0) <= STOP_NS // MS, failure
