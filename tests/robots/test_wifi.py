"""An e-puck2 over its own Wi-Fi: what stops it, and what does not."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from tests.robots.rig import MS, TAG, Rig, S
from tests.robots.stopping import ORDER_NS, still_within, wait_said
from vsense.base.clock import host_ns
from vsense.robots.link.wire import Wanted

Rigs = Callable[..., Rig]

STOP_NS = ORDER_NS + 200 * MS
"""What the air may take comes on top: 2 ms and more, and of 1 in 100 packets 80 ms more."""
GUARD_NS = 600 * MS
"""150 ms until the guard is missed, a new connection, and the air."""


@pytest.fixture
def rig(rigs: Rigs) -> Rig:
    one = rigs(kind="wifi")
    one.start()
    one.run()
    return one


def test_a_stop_counts_when_the_robot_has_it(rig: Rig) -> None:
    def fail() -> int:
        rig.host.say(Wanted.STOP)
        return host_ns()

    still_within(rig, STOP_NS, fail, lambda: None)
    rig.run()
    rig.link.broken = True
    rig.daemon.process.terminate()
    rig.wait_for(lambda: rig.daemon.process.poll() is not None, "the end")
    assert rig.moving and rig.daemon.process.returncode == 1, "nobody says that it stands"
    rig.wait_for(lambda: "the base did not answer at the end" in rig.daemon.said, "its word")


def test_it_drives_on_when_its_air_is_gone_and_each_new_connection_begins_with_a_stop(
    rig: Rig,
) -> None:
    """The page says so: what a robot's own firmware does then is not known."""
    rig.link.broken = True
    wait_said(rig, 1, "base: it has said nothing for a second; connecting again")
    rig.wait_for(lambda: rig.host.last.base_errors > 0, "what the host hears")
    rig.live_for(500 * MS)
    assert rig.moving
    before = len(rig.applied)
    rig.link.broken = False
    rig.wait_for(lambda: len(rig.applied) > before, "a word")
    rig.wait_for(lambda: not rig.moving, "rest")
    rig.wait_for(lambda: rig.moving, "motion again")


def test_a_guard_or_a_worker_that_dies(rig: Rig) -> None:
    def kill_guard() -> int:
        assert rig.daemon.guard is not None
        os.kill(rig.daemon.guard, signal.SIGKILL)
        return host_ns()

    still_within(rig, GUARD_NS, kill_guard, lambda: None)
    rig.run()
    rig.daemon.process.kill()
    killed_ns = host_ns()
    rig.wait_for(lambda: not rig.moving, "rest")
    assert rig.applied[-1].time_ns - killed_ns < STOP_NS


def test_both_killed_at_once_leave_it_driving_and_the_next_daemon_stops_it(rig: Rig) -> None:
    guard = rig.daemon.guard
    assert guard is not None
    for number in (signal.SIGSTOP, signal.SIGKILL):
        for pid in (guard, rig.daemon.process.pid):
            os.kill(pid, number)
    rig.live_for(S)
    assert rig.moving
    rig.host.drop()
    rig.start()
    rig.wait_for(lambda: not rig.moving, "rest")
    rig.run()


def test_an_address_that_is_none_is_refused(rigs: Rigs) -> None:
    one = rigs(kind="wifi")
    for base in ("wifi:192.168.1", "wifi:127.0.0.1:0", "wifi:robot.local"):
        daemon = one.begin(*one.words(base=base, tag=str(TAG)))
        one.wait_for(lambda d=daemon: d.process.poll() is not None, "its end")
        assert daemon.process.returncode == 1
        one.wait_for(lambda d=daemon: "cannot open the base" in d.said, "its reason")


@pytest.mark.parametrize(("floor", "lamps"), [("yes", 0b11), ("no", 0b10)])
def test_its_ground_sensors_are_read_where_it_has_them(
    talker: Path, floor: str, lamps: int
) -> None:
    with closing(Rig(talker, kind="wifi", options=f",floor={floor}")) as one:
        one.start()
        one.run()
        one.wait_for(lambda: one.applied[-1].leds & 0b11 == lamps, "a bright floor, if any")


def test_nobody_at_its_address_is_told(rigs: Rigs) -> None:
    one = rigs(kind="wifi")
    one.link.close()
    one.plugged = False
    one.start()
    wait_said(one, 1, "base: nobody answers at its address: is it on, and its selector at Wi-Fi?")
    assert one.daemon.process.poll() is None
