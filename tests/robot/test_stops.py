"""Stops from outside: what still stops the wheels when the daemon cannot."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable

import pytest

from tests.robot.rig import MS, Rig, S
from vsense.lab.links import KINDS

Rigs = Callable[..., Rig]

WATCHDOG_NS = 400 * MS
STEP_NS = 100 * MS


def kill_both(rig: Rig) -> int:
    """Kills worker and guard at once while the wheels turn; returns when."""

    def tell(number: signal.Signals) -> int:
        guard = rig.daemon.guard
        assert guard is not None
        now_ns = time.monotonic_ns()
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


@pytest.mark.parametrize("kind", KINDS)
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


@pytest.mark.parametrize("kind", KINDS)
def test_both_processes_killed_at_once_without_one(rigs: Rigs, kind: str) -> None:
    """README and `--help` say so; the next daemon finds the robot and stops it."""
    rig = rigs(kind=kind)
    rig.start()
    kill_both(rig)
    rig.live_for(2 * S)
    assert rig.moving, "nobody is left who could stop the wheels"
    rig.start()
    rig.wait_for(lambda: not rig.moving, "standing wheels")
