"""Nobody waits for a terminal that is not read, nor for a disk that hangs."""

from __future__ import annotations

import io
import math
import os
import pty
import select
import socket
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TextIO

import pytest

from vsense.base import writing
from vsense.base.terminal import Console
from vsense.base.writing import BackgroundWriter

FLOOD = 5000
"""Lines of 100 bytes: more than a terminal, a pipe or a socket holds, and more than may wait."""
NEVER_S = 30.0
HANGING = 5000
"""Lines of 100 bytes that wait for a disk: more than a pipe holds, fewer than may wait."""


def _pipe() -> tuple[int, int]:
    return os.pipe()


def _terminal() -> tuple[int, int]:
    return pty.openpty()


def _stopped() -> tuple[int, int]:
    """As after Ctrl-S."""
    reader, written = pty.openpty()
    termios.tcflow(written, termios.TCOOFF)
    return reader, written


def _socket() -> tuple[int, int]:
    ours, theirs = socket.socketpair()
    return ours.detach(), theirs.detach()


READERS = {"pipe": _pipe, "terminal": _terminal, "stopped": _stopped, "socket": _socket}


@contextmanager
def opened(make: Callable[[], tuple[int, int]]) -> Iterator[tuple[int, TextIO]]:
    reader, written = make()
    with suppress(OSError), os.fdopen(written, "w") as stream:
        yield reader, stream
    os.close(reader)


def all_of(reader: int) -> str:
    found = b""
    while select.select([reader], [], [], 0.05)[0]:
        found += os.read(reader, 1 << 16)
    return found.decode().replace("\r\n", "\n")


def _refuse(*arguments: object) -> int:
    raise PermissionError


def in_time(work: Callable[[], None]) -> None:
    """Does the work; fails where it never ends."""
    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    thread.join(NEVER_S)
    assert not thread.is_alive(), "it waits for who does not read"


@pytest.mark.parametrize("kind", [*READERS, "others"])
def test_who_does_not_read_keeps_nobody_waiting(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if kind == "others":  # under sudo the pipe is another account's: it is not opened again
        monkeypatch.setattr(writing.os, "open", _refuse)
    with opened(READERS.get(kind, _pipe)) as (reader, stream):
        before = os.get_blocking(stream.fileno())
        console = Console(stream)
        in_time(lambda: [console.say(f"{n:05} {'x' * 93}") for n in range(FLOOD)] and None)
        assert os.get_blocking(stream.fileno()) == before  # it is other programs', too
        if kind == "stopped":
            assert all_of(reader) == ""
            termios.tcflow(stream.fileno(), termios.TCOON)
        found = ""
        while "left out here" not in found:
            console.progress("live line")
            found += all_of(reader)
        console.say("read again")
        found += all_of(reader)
        lines = [line.lstrip("\r\x1b[K") for line in found.splitlines()]
        numbers = [int(line[:5]) for line in lines if line[:5].isdigit()]
        assert numbers == list(range(len(numbers))) and 0 < len(numbers) < FLOOD
        told = [line for line in lines if "left out here" in line]
        assert told == [f"vsense: {FLOOD - len(numbers)} lines are left out here: nobody read them"]
        assert "read again" in lines[-1] or "read again" in lines[-2]


OTHERS = """
import fcntl, os, sys, termios
os.setsid()
fcntl.ioctl(2, termios.TIOCSCTTY, 0)
opened = os.open
os.open = lambda name, *rest: opened("/dev/full/x" if "fd" in name else name, *rest)
from vsense.base.terminal import Console
for number in range({count}):
    Console().say("x" * 99)
os.open = opened
os.close(os.open({ended!r}, os.O_CREAT))
os._exit(0)
"""


def test_under_sudo_the_terminal_of_another_account_keeps_nobody_waiting(tmp_path: Path) -> None:
    reader, written = pty.openpty()
    code = OTHERS.format(count=FLOOD, ended=str(tmp_path / "ended"))
    process = subprocess.Popen([sys.executable, "-c", code], stdin=written, stderr=written)
    try:
        process.wait(NEVER_S)
        assert (tmp_path / "ended").exists(), all_of(reader)[-2000:]
    finally:
        process.kill()
        process.wait()
        os.close(reader)
        os.close(written)


@contextmanager
def hanging(folder: Path) -> Iterator[tuple[Path, Callable[[], str]]]:
    """A file whose disk takes nothing until the second thing, which gives all, is called."""
    path = folder / "hanging"
    os.mkfifo(path)
    reader = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    yield path, lambda: all_of(reader)
    os.close(reader)


def test_a_disk_that_hangs_keeps_nobody_waiting_and_is_told_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writing, "HUNG_S", 0.1)
    said: list[str] = []
    with hanging(tmp_path) as (path, read), path.open("w") as file:
        writer = BackgroundWriter("the log", said.append)

        def write(number: int) -> None:
            file.write(f"{number:099}\n")
            file.flush()

        def write_all() -> None:
            for number in range(HANGING):
                writer.do(lambda number=number: write(number))

        in_time(write_all)
        end_s = time.monotonic() + NEVER_S
        while not said and time.monotonic() < end_s:
            writer.do(lambda: None)
            time.sleep(0.01)
        assert len(said) == 1 and said[0].startswith("the disk does not answer for ")
        assert not writer.idle
        found = ""
        while len(said) < 2 and time.monotonic() < end_s:
            found += read()
        writer.close()
        found += read()
        numbers = list(map(int, found.split()))
        assert numbers == list(range(HANGING))
        assert said[1] == "the disk answers again: nothing is lost of the log"
        assert len(said) == 2


@pytest.mark.parametrize("hurried", [False, True])
def test_who_ends_waits_for_a_hung_disk_for_a_bounded_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, hurried: bool
) -> None:
    monkeypatch.setattr(writing, "left_s", lambda: 0.0 if hurried else math.inf)
    said: list[str] = []
    held = threading.Event()
    writer = BackgroundWriter("the log", said.append)
    writer.do(held.wait)
    in_time(lambda: writer.close() if hurried else writer.close(wait_s=0.1))
    assert len(said) == 1 and "is lost if this process ends before" in said[0]
    held.set()


def test_what_fails_is_told_and_the_rest_is_written() -> None:
    said: list[str] = []
    done: list[int] = []
    writer = BackgroundWriter("the log", said.append)
    writer.do(lambda: [][0])
    writer.do(lambda: done.append(1))
    writer.close()
    assert done == [1] and said == [
        "the log: not all of it is written: IndexError('list index out of range')"
    ]


def test_a_disk_that_is_only_slow_loses_nothing_in_silence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writing, "MOST_WRITES", 3)
    said: list[str] = []
    done: list[str] = []
    slow = threading.Event()
    writer = BackgroundWriter("the log", said.append)
    for number in range(10):
        writer.do(lambda number=number: (slow.wait(), done.append(str(number))))
    threading.Timer(0.1, slow.set).start()
    writer.close(lambda: done.append("closed"))
    lost = 10 - (len(done) - 1)
    assert done == [*map(str, range(len(done) - 1)), "closed"] and lost >= 6
    assert said == [f"{lost} parts of the log are lost: the disk was too slow for them"]


@pytest.mark.parametrize("kind", ["pipe", "terminal"])
def test_consoles_of_several_threads_write_each_line_once(kind: str) -> None:
    with opened(READERS[kind]) as (reader, stream):

        def say(name: str) -> None:
            console = Console(stream)
            for number in range(300):
                console.say(f"{name} {number}")

        threads = [threading.Thread(target=say, args=(name,)) for name in "abc"]
        for thread in threads:
            thread.start()
        found = ""
        while any(thread.is_alive() for thread in threads):
            found += all_of(reader)
        for name in "abc":
            lines = [line for line in (found + all_of(reader)).splitlines() if line[0] == name]
            assert lines == [f"{name} {number}" for number in range(300)]
            found += all_of(reader)


class Notebook(io.StringIO):
    """As of Jupyter: `fileno` is of the server's terminal."""

    def fileno(self) -> int:
        return 2


def test_a_stream_that_is_none_of_the_systems_is_written_as_it_is() -> None:
    stream = Notebook()
    Console(stream).say("in the cell")
    assert stream.getvalue() == "in the cell\n"


def test_the_last_words_wait_for_a_slow_reader(tmp_path: Path) -> None:
    code = "from vsense.base.terminal import Console; Console().say('x' * 250_000 + 'end')"
    process = subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE)
    assert process.stderr is not None
    time.sleep(1.5)  # longer than what is waited after a signal, and than Python takes to start
    assert process.stderr.read().endswith(b"end\n") and process.wait(NEVER_S) == 0


def test_a_file_that_hangs_keeps_no_run_waiting(tmp_path: Path) -> None:
    path = tmp_path / "nohup.out"
    with path.open("w") as stream:
        console = Console(stream)
        console.write_aside()
        flushed = threading.Event()
        stream.flush = lambda: flushed.wait(NEVER_S)  # type: ignore[method-assign]
        in_time(lambda: [console.say(f"line {number}") for number in range(9)] and None)
        flushed.set()
        assert console._aside is not None
        console._aside.close()
        del stream.flush
    assert path.read_text().splitlines() == [f"line {number}" for number in range(9)]
