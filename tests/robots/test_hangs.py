"""Processes of the real daemon that hang: a board's, the worker, a guard that nothing can end."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.rigs.processes import children, is_alive
from tests.robots.conftest import QUICKLY, ROOT, Builder
from tests.robots.rig import Rig, S
from tests.robots.stopping import FAULTY, GUARD_NS, still_within, wait_said
from vsense.base.clock import host_ns

HANG_NS = 2 * S
GROUND, RAB = 1, 2
"""Places among a worker's children: the guard is the first."""


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
    began_ns = host_ns()
    os.kill(process, signal.SIGSTOP)
    rig.wait_for(lambda: any(f"the {name} bus hangs" in line for line in logged(rig)), "a word")
    if board == GROUND:
        rig.wait_for(lambda: rig.applied[-1].leds & 1 == 0, "a floor that nobody knows")
    else:
        rig.link.ground.ground[0] = 100
        rig.wait_for(lambda: rig.applied[-1].leds & 1 == 0, "the ground sensors, which go on")
    rig.live_for(HANG_NS - (host_ns() - began_ns))
    assert all(a.left_steps_s == 300 for a in rig.applied[seen:]), "it drives on"
    assert len(rig.applied) > seen + 15
    os.kill(process, signal.SIGCONT)
    rig.wait_for(lambda: any(f"the {name} bus moves again" in line for line in logged(rig)), "it")
    rig.link.ground.ground[0] = 900
    rig.wait_for(lambda: rig.applied[-1].leds & 1 == 1, "the floor")
    wait_said(rig, 1, f"base: the {name} bus hangs: going on without")
    assert children(rig.daemon.process.pid) == others
    assert rig.host.last.guard_restarts == rig.host.last.base_errors == 0


def test_a_board_whose_process_dies_gets_another(talking: Rig) -> None:
    rig = talking
    guard, ground, rab = children(rig.daemon.process.pid)
    os.kill(ground, signal.SIGKILL)
    wait_said(rig, 1, "base: the ground sensors' process ended: starting another")
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
    rig.wait_for(lambda: not any(map(is_alive, family)), "the end of all")
    rig.start()
    rig.run()


@pytest.fixture
def watchdog(tmp_path: Path) -> Iterator[Path]:
    """A pipe for a board's watchdog; `is_free` tells whether anybody has it open."""
    path = tmp_path / "watchdog"
    os.mkfifo(path)
    yield path


class Device:
    """The reading end of such a pipe."""

    def __init__(self, path: Path) -> None:
        self._fd = os.open(path, os.O_RDONLY | os.O_NONBLOCK)

    def is_free(self) -> bool:
        """Whether the next daemon would get it."""
        try:
            while os.read(self._fd, 100):
                pass
        except BlockingIOError:
            return False
        return True

    def close(self) -> None:
        os.close(self._fd)


def test_a_board_that_hangs_holds_nothing_that_the_next_daemon_needs(
    talker: Path, watchdog: Path, tmp_path: Path
) -> None:
    for name in ("direction", "value"):
        (tmp_path / name).touch()
    device = Device(watchdog)
    options = f",ground,rab,rab_bytes=4,reset={tmp_path}"
    rig = Rig(talker, "--watchdog", str(watchdog), kind="gctronic", options=options)
    rig.start()
    try:
        rig.run()
        family = children(rig.daemon.process.pid)
        assert not device.is_free()
        for board in (GROUND, RAB):
            held = [os.readlink(p) for p in Path(f"/proc/{family[board]}/fd").iterdir()]
            assert not [path for path in held if path.startswith(str(tmp_path))]
            assert sum(path.startswith("socket:") for path in held) == 2, "the worker, and its bus"
        os.kill(family[GROUND], signal.SIGSTOP)
        rig.daemon.process.kill()
        rig.wait_for(
            lambda: not any(map(is_alive, (family[0], family[RAB]))), "the end of the others"
        )
        assert not rig.moving and device.is_free()
        os.kill(family[GROUND], signal.SIGKILL)
    finally:
        rig.close()
        device.close()


def test_a_guard_whose_last_words_nobody_takes_holds_nothing(
    probe: Path, watchdog: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    block = tmp_path / "block"
    monkeypatch.setenv("PROBE_LOG", str(block))
    monkeypatch.setenv("VSENSED_SERVICE", "1")
    device = Device(watchdog)
    rig = Rig(probe, "--watchdog", str(watchdog))
    rig.start()
    try:
        rig.run()
        guard = rig.daemon.guard
        assert guard is not None
        block.touch()
        rig.host.drop()  # which is worth a line
        rig.wait_for(lambda: rig.daemon.process.poll() is not None, "the end of the worker")
        rig.wait_for(device.is_free, "the watchdog")
        assert is_alive(guard), "it waits for its log"
        block.unlink()
        rig.wait_for(lambda: not is_alive(guard), "its end")
        wait_said(rig, 1, "the worker hung for 3 s: stopped the wheels, ended it")
    finally:
        rig.close()
        device.close()


@pytest.fixture(scope="module")
def hanging(tmp_path_factory: pytest.TempPathFactory, build: Builder) -> Path:
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
        wait_said(rig, 1, "the worker hung for 3 s: stopped the wheels, ended it")
        rig.wait_for(lambda: rig.moving, "motion again")
        assert Path(f"/proc/{guard}/comm").read_text() == "vsensed\n", "the guard became it"
        assert not Path(f"/proc/{worker}/exe").exists()
        (another,) = children(guard)
        if os.geteuid() == 0:
            assert os.sched_getscheduler(another) == os.SCHED_FIFO, "a guard with its rights"
        assert os.sched_getscheduler(guard) == os.SCHED_OTHER
        assert Path(f"/proc/{guard}/oom_score_adj").read_text() == "0\n"
        rig.wait_for(lambda: not rig.moving, "rest")
        rig.wait_for(lambda: len(starts(rig)) == 3, "and another one")
    finally:
        end_all(rig.device)
        rig.close()


@pytest.mark.parametrize("service", [False, True])
def test_a_worker_that_hangs_ends_with_its_guard_if_both_are_told_to(
    hanging: Path, monkeypatch: pytest.MonkeyPatch, service: bool
) -> None:
    """As `killall vsensed` and Ctrl-C do: who hangs hears no signal, and its guard has ended."""
    if service:
        monkeypatch.setenv("VSENSED_SERVICE", "1")
    rig = Rig(hanging)
    rig.start()
    try:
        rig.run()
        rig.wait_for(lambda: not rig.moving, "rest")
        guard = rig.daemon.guard
        assert guard is not None
        for pid in (rig.daemon.process.pid, guard):
            os.kill(pid, signal.SIGINT)
        rig.wait_for(lambda: rig.daemon.process.poll() is not None, "the end of the worker")
        wait_said(rig, 1, "asked to end, but the worker hung: ended it")
        rig.wait_for(lambda: not is_alive(guard), "the end of the guard")
        assert not workers(rig.device) and not rig.moving and len(starts(rig)) == 1
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


def test_under_the_init_script_a_worker_that_hangs_is_started_anew(
    hanging: Path, tmp_path: Path
) -> None:
    rig = Rig(hanging)
    script = ROOT / "vsense" / "robots" / "board" / "vsensed.init"
    board = tmp_path / "board"
    for folder in ("usr/local/bin", "etc", "var/run", "var/log"):
        (board / folder).mkdir(parents=True)
    shutil.copy(hanging, board / "usr/local/bin/vsensed")
    words = [*rig.words()[:-1], "--insecure", "yes"]
    lines = (f"{name[2:]} = {value}" for name, value in zip(words[::2], words[1::2]))
    (board / "etc/vsensed.conf").write_text("\n".join(lines) + "\n")
    environment = {**os.environ, "VSENSED_ROOT": str(board)}
    subprocess.run(["sh", script, "start"], env=environment, timeout=30, check=True)
    log = board / "var/log/vsensed.log"
    try:
        most = 0
        rig.run()

        def again() -> bool:
            nonlocal most
            most = max(most, len(workers(rig.device)))
            return len(starts(rig)) == 2

        rig.wait_for(again, "a new daemon")
        assert most == 1, "never two daemons"
        rig.wait_for(lambda: "the worker hung for 3 s: stopped" in log.read_text(), "a word")
        rig.wait_for(lambda: rig.moving, "motion again")
    finally:
        subprocess.run(["sh", script, "stop"], env=environment, timeout=30, check=True)
        rig.wait_for(lambda: not workers(rig.device), "the end")
        rig.close()


def test_under_systemds_rules_a_worker_that_hangs_is_started_anew(hanging: Path) -> None:
    rig = Rig(hanging)
    unit = ROOT / "vsense" / "robots" / "board" / "vsensed.service"
    device = rig.device
    words = [sys.executable, "-m", "tests.robots.systemd_rules", unit, hanging, *rig.words()]
    device = rig.device
    with subprocess.Popen(words, cwd=ROOT, stderr=subprocess.PIPE, text=True) as service:
        try:
            most = 0
            rig.run()

            def again() -> bool:
                nonlocal most
                most = max(most, len(workers(device)))
                return len(starts(rig)) == 2

            rig.wait_for(again, "a new daemon")
            assert most == 1, "never two daemons"
            assert not rig.moving, "the wheels stood before"
            rig.wait_for(lambda: rig.moving, "motion again")
        finally:
            service.terminate()
            rig.wait_for(lambda: service.poll() is not None, "the end of the service")
            rig.close()
        assert service.stderr is not None
        assert "the worker hung for 3 s: stopped the wheels, ended it" in service.stderr.read()
        assert not workers(device)


def workers(device: str) -> list[int]:
    """Daemons that have the device open, and are no daemon's child."""
    found = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if (folder / "comm").read_text() == "vsensed\n" and device in {
                os.readlink(p) for p in (folder / "fd").iterdir()
            }:
                found[int(folder.name)] = int((folder / "stat").read_text().split()[3])
        except OSError:
            continue
    return [pid for pid, parent in found.items() if parent not in found]


def test_a_guard_that_cannot_be_ended_is_not_waited_for(
    probes: Callable[[], Rig], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PROBE_UNDEAD", "1")
    rig = probes()

    def fail() -> int:
        os.kill(children(rig.daemon.process.pid)[-1], signal.SIGSTOP)
        return host_ns()

    still_within(rig, GUARD_NS, fail, lambda: None)
    rig.run()
    assert rig.host.last.guard_restarts > 0


def test_a_log_that_takes_nothing_holds_the_worker_and_not_the_guard(
    probes: Callable[[], Rig], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    block = tmp_path / "block"
    monkeypatch.setenv("PROBE_LOG", str(block))
    rig = probes()
    guard = rig.daemon.guard
    block.touch()
    rig.host.drop()  # which is worth a line
    rig.wait_for(lambda: not rig.moving, "rest")
    rig.live_for(S)
    assert not rig.moving and is_alive(guard) and len(rig.host.hellos) == 1, "the worker waits"
    block.unlink()
    rig.run()
    assert rig.daemon.guard == guard


def test_a_full_card_changes_nothing(rigs: Callable[..., Rig], program: Path) -> None:
    rig = rigs()
    with open("/dev/full", "w") as full:
        process = subprocess.Popen([program, *rig.words()], stderr=full, preexec_fn=os.setpgrp)
    try:
        rig.run()
        process.terminate()
        rig.wait_for(lambda: process.poll() is not None, "the end")
        assert process.returncode == 0 and not rig.moving
    finally:
        process.kill()
        process.wait()


def test_the_guard_has_its_rights_or_they_are_told(rigs: Callable[..., Rig]) -> None:
    rig = rigs()
    rig.start()
    rig.run()
    guard = rig.daemon.guard
    assert guard is not None
    text = r"the guard runs without ([^:]*): the system refuses"
    told_without = re.findall(text, rig.daemon.said)
    assert len(told_without) <= 1, "one line at the start"
    refused = told_without[0] if told_without else ""
    has_time = os.sched_getscheduler(guard) == os.SCHED_FIFO
    has_score = Path(f"/proc/{guard}/oom_score_adj").read_text() == "-1000\n"
    assert has_time == ("real-time priority" not in refused)
    assert has_score == ("the least out-of-memory score" not in refused)
    assert os.sched_getscheduler(rig.daemon.process.pid) == os.SCHED_OTHER
