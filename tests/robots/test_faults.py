"""The real daemon when something dies, falls silent or lies: wheels stop, then all goes on."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.rigs.places import ROOT
from tests.rigs.processes import is_alive
from tests.robots.conftest import Builder
from tests.robots.rig import MS, Rig, S
from tests.robots.stopping import (
    BEAT_NS,
    FAULTY,
    GUARD_NS,
    ORDER_NS,
    SILENCE_NS,
    still_within,
    wait_said,
)
from vsense.base.clock import host_ns
from vsense.base.native import lib
from vsense.robots.link.wire import StopCause, Wanted


def test_stop_reaches_the_base(rig: Rig) -> None:
    def fail() -> int:
        rig.host.say(Wanted.STOP)
        return host_ns()

    still_within(rig, ORDER_NS, fail, lambda: rig.host.say(Wanted.RUN))


def test_sigterm_reaches_the_base(rig: Rig) -> None:
    def fail() -> int:
        rig.daemon.process.terminate()
        return host_ns()

    def mend() -> None:
        rig.wait_for(lambda: rig.daemon.process.poll() == 0, "the end")
        rig.start()

    still_within(rig, ORDER_NS, fail, mend)


def test_silent_host(rig: Rig) -> None:
    def fail() -> int:
        rig.host.silent = True
        return 0

    def mend() -> None:
        rig.host.silent = False

    said = "nothing fresh from the host for 400 ms"
    attempts = still_within(rig, SILENCE_NS, fail, mend)
    rig.wait_for(lambda: said in rig.daemon.said, said)
    # Once for each silence at most: the host may be heard again before the worker looks.
    assert rig.daemon.said.count(said) <= attempts


def test_frozen_tracker_must_not_keep_wheels_turning(rig: Rig) -> None:
    def fail() -> int:
        rig.host.frozen = True
        return 0

    def mend() -> None:
        rig.wait_for(lambda: rig.host.last.stop_cause == StopCause.STALE, "the cause")
        rig.host.frozen = False

    still_within(rig, SILENCE_NS, fail, mend)


def test_motion_needs_three_fresh_frames_after_a_silence(rig: Rig) -> None:
    rig.run()
    rig.host.frozen = True
    rig.wait_for(lambda: rig.host.last.stop_cause == StopCause.STALE, "the cause")
    rig.wait_for(lambda: not rig.moving, "rest")
    for frames in (1, 2, 3):
        assert not rig.moving
        before_ns = rig.host.fresh_ns
        rig.host.frozen = False
        rig.wait_for(lambda before_ns=before_ns: rig.host.fresh_ns > before_ns, "a fresh frame")
        rig.host.frozen = frames < 3
    rig.wait_for(lambda: rig.moving, "motion")


def test_worker_killed_and_started_again(rig: Rig) -> None:
    def fail() -> int:
        rig.daemon.process.kill()
        return host_ns()

    def mend() -> None:
        guard = guards.pop()
        rig.wait_for(lambda: not is_alive(guard), "the guard's end")
        assert rig.base.links[0].program.state.state == lib.FW_ARGOS_FRAME
        start()

    guards: list[int | None] = []

    def start() -> None:
        rig.start()
        rig.wait_for(lambda: rig.daemon.guard, "a guard")
        guards.append(rig.daemon.guard)

    rig.wait_for(lambda: rig.daemon.guard, "a guard")
    guards.append(rig.daemon.guard)
    still_within(rig, ORDER_NS, fail, mend)
    rig.run()
    assert {hello.uid for hello in rig.host.hellos} == {rig.host.hellos[0].uid}


def test_worker_stopped_and_continued(rig: Rig) -> None:
    def fail() -> int:
        rig.daemon.process.send_signal(signal.SIGSTOP)
        return host_ns()

    def mend() -> None:
        rig.daemon.process.send_signal(signal.SIGCONT)

    still_within(rig, BEAT_NS, fail, mend)
    rig.run()
    assert rig.host.last.guard_restarts == 0


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_guard_dead_or_stopped_is_replaced(rig: Rig, number: signal.Signals) -> None:
    lost: list[int] = []

    def fail() -> int:
        guard = rig.daemon.guard
        assert guard is not None
        lost.append(guard)
        os.kill(guard, number)
        return host_ns()

    def mend() -> None:
        rig.wait_for(lambda: rig.daemon.guard not in (None, lost[-1]), "another guard")
        assert not is_alive(lost[-1])

    still_within(rig, GUARD_NS, fail, mend)
    rig.run()
    rig.wait_for(lambda: rig.host.last.guard_restarts == len(lost), "the count")
    assert len(set(lost)) == len(lost)


@pytest.mark.parametrize("fault", ["continue", "*(volatile int *)0 = 1"])
def test_controller_that_hangs_or_crashes_stops_the_wheels(
    tmp_path: Path, build: Builder, fault: str
) -> None:
    source = tmp_path / "faulty.c"
    source.write_text(FAULTY.replace("FAULT", fault))
    rig = Rig(build(tmp_path / "vsensed", source))
    try:
        rig.start()
        rig.run()
        rig.wait_for(lambda: not rig.moving, "rest")
        crashed = fault != "continue"
        if crashed:
            rig.wait_for(lambda: rig.daemon.process.poll() is not None, "the crash")
        assert (rig.daemon.process.poll() is not None) == crashed
    finally:
        rig.close()


def test_guard_told_to_end_alone_is_replaced(rig: Rig) -> None:
    rig.run()
    guard = rig.daemon.guard
    assert guard is not None
    os.kill(guard, signal.SIGTERM)
    rig.wait_for(lambda: rig.host.last.guard_restarts == 1, "another guard")
    rig.run()


@pytest.mark.parametrize("count", range(1, 12))
def test_daemon_finds_a_microcontroller_in_mid_frame(rigs: Callable[..., Rig], count: int) -> None:
    rig = rigs()
    half = bytes([0x2C, 1, 0x2C, 1, 0, 0, 0xFF, 3, 0, 0, 0])[:count]
    line = os.open(rig.device, os.O_RDWR | os.O_NOCTTY)
    os.write(line, bytes(5) + half)
    rig.wait_for(lambda: rig.base.links[0].program.state.got == count, "half a frame")
    os.close(line)
    rig.start()
    rig.run()
    commanded = rig.applied[-1]
    assert rig.applied[0].left_steps_s == int.from_bytes(half[:2].ljust(2, b"\0"), "little")
    assert {a.left_steps_s for a in rig.applied[1:]} <= {0, commanded.left_steps_s}
    assert {a.right_steps_s for a in rig.applied[1:]} <= {0, commanded.right_steps_s}
    assert commanded.leds == 0


def test_second_daemon_on_the_same_port_is_turned_away(rig: Rig) -> None:
    rig.run()
    first = rig.daemon
    second = rig.start()
    rig.wait_for(lambda: second.process.poll() is not None, "the end")
    assert second.process.returncode == 1
    rig.wait_for(lambda: not second.open, "its last words")
    assert f"cannot open the base {rig.device}: another process holds the device" in second.said
    assert first.process.poll() is None
    assert rig.moving


def test_base_that_hangs_up_ends_the_daemon(rig: Rig) -> None:
    rig.run()
    guard = rig.daemon.guard
    rig.unplug()
    rig.wait_for(lambda: rig.daemon.process.poll() is not None, "the end")
    assert rig.daemon.process.returncode == 1
    rig.wait_for(lambda: not rig.daemon.open, "its last words")
    assert "the base hung up" in rig.daemon.said
    assert not is_alive(guard)


def test_base_that_is_switched_off_is_waited_for(rig: Rig) -> None:
    rig.run()
    real = rig.base.receive
    rig.base.receive = lambda ready, _: [os.read(fd, 256) for fd in ready]  # type: ignore
    rig.wait_for(lambda: rig.host.last.stop_cause == StopCause.BASE, "the cause")
    assert rig.host.last.base_errors > 0
    wait_said(rig, 1, "the base does not answer")
    rig.base.receive = real  # type: ignore[method-assign]
    rig.wait_for(lambda: rig.host.last.stop_cause == StopCause.NONE, "recovery")
    rig.run()


def test_refusal_is_told_once_and_tried_again(rig: Rig) -> None:
    rig.host.refuse = True
    rig.wait_for(lambda: len(rig.host.hellos) >= 3, "three tries")
    wait_said(rig, 1, "the host refuses: robot 23 is here already")
    rig.host.refuse = False
    rig.run()


def test_a_host_of_the_version_before_is_told_of_once(rig: Rig) -> None:
    """What a host of version 2 said once to a greeting that is not its own's."""
    recorded = json.loads((ROOT / "tests" / "golden" / "version_2.json").read_text())
    rig.host.refuse = bytes.fromhex(recorded["refuse"])
    rig.wait_for(lambda: len(rig.host.hellos) >= 3, "three tries")
    wait_said(rig, 1, "the host refuses: another version of the protocol; do ")
    assert rig.daemon.said.count("'vsense robot deploy' there; trying on") == 1
    rig.host.refuse = False
    rig.run()


def test_goodbye_holds_the_wheels_until_the_next_session(rig: Rig) -> None:
    rig.run()
    rig.host.refuse = True
    rig.host.goodbye()
    rig.wait_for(lambda: not rig.moving, "rest")
    wait_said(rig, 1, "connection lost: that was all; trying on")
    rig.wait_for(lambda: len(rig.host.hellos) >= 2, "another try")
    rig.host.refuse = False
    rig.run()


def test_host_that_drops_the_connection_is_found_again(rig: Rig) -> None:
    rig.run()
    rig.host.drop()
    rig.wait_for(lambda: not rig.moving, "rest")
    rig.run()
    assert len(rig.host.hellos) == 2


def test_half_open_connection_is_given_up(rig: Rig) -> None:
    rig.run()
    rig.host.silent = True
    wait_said(rig, 1, "connection lost: the host is silent; trying on")
    rig.host.silent = False
    rig.run()


def test_without_udp_state_goes_over_tcp(rig: Rig) -> None:
    rig.host.udp = False
    rig.run()
    wait_said(rig, 1, "no UDP from the host for 1 s: going on over TCP")
    seen = len(rig.host.telemetry)
    rig.wait_for(lambda: len(rig.host.telemetry) > seen + 10, "telemetry by TCP")
    assert rig.moving
    rig.host.udp = True
    wait_said(rig, 1, "UDP is back")
    assert rig.moving


def test_daemon_holds_no_more_descriptors_after_many_guards(rig: Rig) -> None:
    rig.run()
    worker = Path(f"/proc/{rig.daemon.process.pid}/fd")
    before = len(list(worker.iterdir()))
    for restarts in range(1, 4):
        guard = rig.daemon.guard
        assert guard is not None
        os.kill(guard, signal.SIGKILL)
        rig.wait_for(lambda n=restarts: rig.host.last.guard_restarts == n, "another guard")
        rig.run()
    assert len(list(worker.iterdir())) == before
    held = {os.readlink(p) for p in Path(f"/proc/{rig.daemon.guard}/fd").iterdir()}
    assert rig.device in held
    assert sum(name.startswith("socket:") for name in held) == 1


def test_queued_frames_are_not_fresh(rig: Rig) -> None:
    """A worker that slept for a second finds datagrams, but they are a second old."""
    rig.run()
    rig.daemon.process.send_signal(signal.SIGSTOP)
    rig.wait_for(lambda: not rig.moving, "rest")
    began_ns = host_ns()
    rig.wait_for(lambda: rig.host.fresh_ns > began_ns + S, "a queue")
    rig.host.silent = True
    rig.live_for(600 * MS)
    seen = len(rig.applied)
    rig.daemon.process.send_signal(signal.SIGCONT)
    rig.live_for(600 * MS)
    assert {a.left_steps_s for a in rig.applied[seen:]} <= {0}
    rig.host.silent = False
    rig.run()
