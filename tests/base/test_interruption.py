"""Signals as an event: which came, and what it leaves time for."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from contextlib import suppress

import pytest

from vsense import cli
from vsense.base import interruption as module
from vsense.base.errors import CutShort, VsenseError
from vsense.base.interruption import interruption

NEVER_S = 60.0


@pytest.fixture(autouse=True)
def forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    """The tests that follow have time."""
    monkeypatch.setattr(module, "_newest", module.Interruption())


def come(number: int) -> None:
    """The signal comes now: sent to the process, it may reach another thread, and later."""
    signal.raise_signal(number)


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)]
)
def test_the_first_signal_gives_the_exit_code(number: int, code: int) -> None:
    with interruption() as interrupted:
        assert not interrupted.is_set()
        come(number)
        come(signal.SIGTERM)
        assert interrupted.is_set() and interrupted.code == code


def test_what_was_there_before_is_there_again() -> None:
    before = [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)]
    with interruption() as interrupted, interrupted.at_once(), interrupted.in_time():
        pass
    after = [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)]
    assert after == before


@pytest.mark.parametrize("early", [True, False])
def test_at_once_it_raises_where_the_program_is(early: bool) -> None:
    with interruption() as interrupted:
        if early:
            come(signal.SIGTERM)
        with pytest.raises(CutShort) as caught, interrupted.at_once():
            with suppress(VsenseError):  # it is no failure
                come(signal.SIGTERM)
            pytest.fail("it went on")
        assert caught.value.exit_code == 143 and caught.value.args == (143,)
        come(signal.SIGTERM)


@pytest.mark.parametrize("early", [True, False])
def test_sigterm_leaves_a_moment(monkeypatch: pytest.MonkeyPatch, early: bool) -> None:
    monkeypatch.setattr(module, "LAST_S", 0.2)
    with interruption() as interrupted:
        if early:
            come(signal.SIGTERM)
        with pytest.raises(CutShort) as caught, interrupted.in_time():
            if not early:
                come(signal.SIGTERM)
            threading.Event().wait(NEVER_S)
        assert caught.value.exit_code == 143


def test_ctrl_c_leaves_time_and_another_one_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LAST_S", 0.0)
    with interruption() as interrupted:
        come(signal.SIGINT)
        with pytest.raises(CutShort) as caught, interrupted.in_time():
            threading.Event().wait(2 * module.LEAST_WAIT_S)
            come(signal.SIGINT)
            pytest.fail("it went on")
        assert caught.value.exit_code == 130


def test_who_is_done_in_time_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LAST_S", 0.1)
    with interruption() as interrupted:
        come(signal.SIGTERM)
        with interrupted.in_time():
            pass
        threading.Event().wait(0.3)


SIGNALS_EVERYWHERE = """
import os, signal, sys
from vsense.base.interruption import interruption

left = 50

def come(frame, event, argument):
    global left
    if frame.f_code.co_name in ("wait", "set") and left:
        left -= 1
        os.kill(os.getpid(), signal.SIGTERM)
    return come

with interruption() as interrupted:
    sys.settrace(come)
    interrupted.wait(0.01)
    sys.settrace(None)
    assert left < 50 and interrupted.is_set() and interrupted.wait()
"""


def test_a_signal_may_come_while_the_event_is_at_work() -> None:
    subprocess.run([sys.executable, "-c", SIGNALS_EVERYWHERE], timeout=20.0, check=True)


def test_who_is_not_to_be_hung_up_is_not() -> None:
    """As `nohup` has it."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with interruption() as interrupted:
            come(signal.SIGHUP)
            assert not interrupted.is_set()
    finally:
        signal.signal(signal.SIGHUP, before)


def test_sigterm_after_ctrl_c_leaves_a_moment_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LAST_S", 0.2)
    with interruption() as interrupted:
        come(signal.SIGINT)
        come(signal.SIGTERM)
        with pytest.raises(CutShort) as caught, interrupted.in_time():
            threading.Event().wait(NEVER_S)
        assert caught.value.exit_code == 130


_SIGNALLED = """\
import os, sys
class Signalled:
    def find_spec(self, name, path=None, target=None):
        if name == "vsense.commands":
            try:
                os.kill(os.getpid(), int(sys.argv.pop()))
            except SystemExit:
                if sys.argv.pop() == "within":
                    raise ImportError("numpy._core.multiarray failed to import") from None
                raise
sys.meta_path.insert(0, Signalled())
from vsense.cli import main
sys.exit(main())
"""
"""`vsense`, to which a signal is sent in the moment in which it begins to load its commands, or
within NumPy's import, which makes another error of it."""


@pytest.mark.parametrize("where", ["beside", "within"])
@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_a_signal_while_the_commands_load_has_its_code(number: int, code: int, where: str) -> None:
    words = ["sim", "foraging", "--dry", where, str(int(number))]
    command = [sys.executable, "-c", _SIGNALLED, *words]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (code, "", "")


def test_a_terminal_that_has_gone_changes_no_exit_code(monkeypatch: pytest.MonkeyPatch) -> None:
    def cut_short(words: list[str]) -> int:
        raise CutShort(129)

    monkeypatch.setattr(cli, "_run", cut_short)
    other_end, gone = os.openpty()
    os.close(other_end)
    with suppress(OSError), os.fdopen(gone, "w", buffering=1) as stream:  # it cannot be emptied
        monkeypatch.setattr(sys, "stderr", stream)
        code = cli.main(["sim"])
    assert code == 129


def fill(pipe: int) -> None:
    """Nobody reads it: whoever writes more to it waits."""
    os.set_blocking(pipe, False)
    with suppress(BlockingIOError):
        while True:
            os.write(pipe, b"x" * 4096)
    os.set_blocking(pipe, True)


UNREAD = """
import os
import sys
from vsense import cli
from vsense.base.interruption import interruption
from vsense.base.terminal import Console, print_data

def run(words):
    with interruption() as interrupted:
        os.close(0)
        interrupted.wait()
        with interrupted.in_time():
            try:
                print_data("figures of one run")
            finally:
                print_data("figures of all runs")
    return 0

cli._run = run
sys.exit(cli.main())
"""


def test_sigterm_ends_who_prints_for_nobody() -> None:
    """Of standard output and of standard error nobody reads anything."""
    reader, unread = os.pipe()
    fill(unread)
    alive, ready = os.pipe()
    process = subprocess.Popen(
        [sys.executable, "-c", UNREAD], stdin=ready, stdout=unread, stderr=unread
    )
    try:
        os.close(ready)
        assert os.read(alive, 1) == b""  # it looks at signals now
        process.terminate()
        assert process.wait(NEVER_S) == 143
    finally:
        process.kill()
        process.wait()
        for descriptor in (reader, unread, alive):
            os.close(descriptor)


def test_the_alarm_of_somebody_else_rings_and_is_left_as_it_was() -> None:
    rung = threading.Event()
    before = signal.signal(signal.SIGALRM, lambda number, frame: rung.set())
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.05)
        with interruption():
            assert rung.wait(NEVER_S)
        signal.setitimer(signal.ITIMER_REAL, 50.0)
        with interruption() as interrupted:
            come(signal.SIGTERM)
            assert interrupted.is_set()
        assert 0.0 < signal.getitimer(signal.ITIMER_REAL)[0] <= 50.0
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        with interruption() as interrupted:
            come(signal.SIGTERM)
        assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def test_a_call_that_is_over_is_not_ended() -> None:
    """A signal may come between the end of a call and its being forgotten."""
    with interruption() as interrupted:
        call = module.OpenCall("mine.py", "mine.py", 0.0, threading.get_ident(), 0.0)
        module.calls.append(call)
        come(signal.SIGTERM)
        interrupted.ring(signal.SIGALRM, sys._getframe())
        assert call not in module.calls


NEVER_ENDS = """
import os, time
from vsense import cli
from vsense.base import interruption as module

module.LAST_S = module.END_S = 0.2

def run(words):
    with module.interruption():
        os.close(0)
        while True:
            time.sleep(0.01)

cli._run = run
cli.main()
"""


@pytest.mark.parametrize("unread", [False, True])
def test_what_never_looks_at_the_signal_ends(unread: bool) -> None:
    reader, written = os.pipe()
    if unread:
        fill(written)
    alive, ready = os.pipe()
    process = subprocess.Popen([sys.executable, "-c", NEVER_ENDS], stdin=ready, stderr=written)
    try:
        os.close(ready)
        assert os.read(alive, 1) == b""
        process.terminate()
        assert process.wait(NEVER_S) == 143
        os.close(written)
        said = b"".join(iter(lambda: os.read(reader, 4096), b""))
        assert (b"what should end takes too long: the process ends" in said) != unread
    finally:
        process.kill()
        process.wait()
        for descriptor in (reader, alive):
            os.close(descriptor)
