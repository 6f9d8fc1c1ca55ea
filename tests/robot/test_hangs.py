"""Processes of the real daemon that hang: a board's, the worker, a guard that nothing can end."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.robot.conftest import Build
from tests.robot.rig import Rig, S
from tests.robot.test_faults import FAULTY, alive, told

QUICKLY = ("-O0", "-fno-sanitize=all")
HANG_NS = 2 * S
GROUND, RAB = 1, 2
"""Places among a worker's children: the guard is the first."""


def children(pid: int) -> list[int]:
    """A process's children, in the order in which they were started."""
    return [int(n) for n in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


@pytest.fixture(scope="module")
def talker(tmp_path_factory: pytest.TempPathFactory, build: Build) -> Path:
    """Path of `vsensed` with the controller of `boards.c`."""
    target = tmp_path_factory.mktemp("talker") / "vsensed"
    return build(target, Path(__file__).parent / "boards.c", *QUICKLY)


@pytest.fixture
def talking(talker: Path) -> Iterator[Rig]:
    """A robot that drives, with both boards on the bus of its base."""
    one = Rig(talker, kind="gctronic", options=",ground,rab,rab_bytes=4")
    one.start()
    one.run()
    one.wait_for(lambda: one.applied[-1].leds & 0b11 == 0b11, "the bright floor, and a way")
    yield one
    one.close()


def logged(rig: Rig) -> set[str]:
    """Lines that the host has heard; it says so."""
    rig.host.log_heard = max(rig.host.log_heard, rig.host.last.log_number)
    return {t.log for t in rig.host.telemetry}


@pytest.mark.parametrize(
    ("board", "name"), [(GROUND, "ground sensors'"), (RAB, "range-and-bearing board's")]
)
def test_a_board_that_hangs_costs_its_own_readings(talking: Rig, board: int, name: str) -> None:
    rig = talking
    process = children(rig.daemon.process.pid)[board]
    others = children(rig.daemon.process.pid)
    seen = len(rig.applied)
    began_ns = time.monotonic_ns()
    os.kill(process, signal.SIGSTOP)
    rig.wait_for(lambda: any(f"the {name} bus hangs" in line for line in logged(rig)), "a word")
    if board == GROUND:
        rig.wait_for(lambda: rig.applied[-1].leds & 1 == 0, "a floor that nobody knows")
    else:
        rig.link.ground.ground[0] = 100
        rig.wait_for(lambda: rig.applied[-1].leds & 1 == 0, "the ground sensors, which go on")
    rig.live_for(HANG_NS - (time.monotonic_ns() - began_ns))
    assert all(a.left_steps_s == 300 for a in rig.applied[seen:]), "it drives on"
    assert len(rig.applied) > seen + 15
    os.kill(process, signal.SIGCONT)
    rig.wait_for(lambda: any(f"the {name} bus moves again" in line for line in logged(rig)), "it")
    rig.link.ground.ground[0] = 900
    rig.wait_for(lambda: rig.applied[-1].leds & 1 == 1, "the floor")
    told(rig, 1, f"base: the {name} bus hangs: going on without")
    assert children(rig.daemon.process.pid) == others
    assert rig.host.last.guard_restarts == rig.host.last.base_errors == 0


def test_a_board_whose_process_dies_gets_another(talking: Rig) -> None:
    rig = talking
    guard, ground, rab = children(rig.daemon.process.pid)
    os.kill(ground, signal.SIGKILL)
    told(rig, 1, "base: the ground sensors' process ended: starting another")
    rig.link.ground.ground[0] = 100
    rig.wait_for(lambda: rig.applied[-1].leds & 1 == 0, "no floor, or the new one")
    rig.link.ground.ground[0] = 900
    rig.wait_for(lambda: rig.applied[-1].leds & 1 == 1, "the floor")
    assert children(rig.daemon.process.pid)[:2] == [guard, rab]
    assert rig.moving and rig.host.last.guard_restarts == 0


def test_boards_end_with_their_worker_and_hold_no_base(talking: Rig) -> None:
    rig = talking
    family = children(rig.daemon.process.pid)
    rig.daemon.process.kill()
    rig.wait_for(lambda: not rig.moving, "rest")
    rig.wait_for(lambda: not any(map(alive, family)), "the end of all")
    rig.start()
    rig.run()


@pytest.fixture(scope="module")
def hanging(tmp_path_factory: pytest.TempPathFactory, build: Build) -> Path:
    """Path of `vsensed` with a controller that hangs in its eleventh step."""
    folder = tmp_path_factory.mktemp("hanging")
    source = folder / "faulty.c"
    source.write_text(FAULTY.replace("FAULT", "continue"))
    return build(folder / "vsensed", source, *QUICKLY)


def starts(rig: Rig) -> list[int]:
    """Which daemons greeted, each once."""
    return list(dict.fromkeys(hello.started for hello in rig.host.hellos))


def test_a_worker_that_hangs_is_replaced_without_a_service(hanging: Path) -> None:
    rig = Rig(hanging)
    rig.start()
    worker, guard = rig.daemon.process.pid, None
    try:
        rig.run()
        guard = rig.daemon.guard
        assert guard is not None
        rig.wait_for(lambda: not rig.moving, "rest")
        rig.wait_for(lambda: rig.daemon.process.poll() is not None, "the end of the worker")
        assert rig.daemon.process.returncode == -signal.SIGKILL
        assert not rig.moving, "the wheels stood before"
        rig.wait_for(lambda: len(starts(rig)) == 2, "a new daemon")
        told(rig, 1, "the worker hung for 3 s: stopped the wheels, ended it")
        rig.wait_for(lambda: rig.moving, "motion again")
        assert Path(f"/proc/{guard}/comm").read_text() == "vsensed\n", "the guard became it"
        assert len(children(guard)) == 1 and not Path(f"/proc/{worker}/exe").exists()
        assert os.sched_getscheduler(guard) == os.SCHED_OTHER
        assert Path(f"/proc/{guard}/oom_score_adj").read_text() == "0\n"
        rig.wait_for(lambda: not rig.moving, "rest")
        rig.wait_for(lambda: len(starts(rig)) == 3, "and another one")
    finally:
        end_all(rig.device)
        rig.close()


def end_all(device: str) -> None:
    """Ends every daemon that has the device open: those that replaced one are nobody's children."""
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            name = (folder / "comm").read_text()
            if name == "vsensed\n" and device in {
                os.readlink(p) for p in (folder / "fd").iterdir()
            }:
                os.kill(int(folder.name), signal.SIGKILL)
        except OSError:
            continue
