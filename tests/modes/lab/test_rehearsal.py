"""The tracker of emulated robots comes and goes with the run that listens."""

from __future__ import annotations

import argparse
import socket
import time
from collections.abc import Callable, Iterator

import pytest

from vsense.base.shared import LabError
from vsense.commands import _arguments
from vsense.modes.lab import rehearsal
from vsense.modes.lab.rehearsal import LineWriter

PATIENCE_S = 5.0


@pytest.fixture
def host() -> Iterator[socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(PATIENCE_S)
        yield server


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    monkeypatch.setattr(rehearsal, "TRACKER_RETRY_NS", 0)
    return []


def write_until(writer: LineWriter, done: Callable[[], object]) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not done():
        assert time.monotonic() < end_s
        writer.write(b"line\n")
        time.sleep(0.001)


def test_lines_arrive_and_a_host_that_comes_back_gets_them_again(
    host: socket.socket, told: list[str]
) -> None:
    port = host.getsockname()[1]
    writer = LineWriter("127.0.0.1", port, told.append)
    for _ in range(2):
        writer.write(b"line 1\n")
        writer.write(b"line 2\n")
        taken, _ = host.accept()
        with taken:
            assert taken.makefile("rb").readline() == b"line 1\n"
            assert writer.connected
        write_until(writer, lambda: not writer.connected)
        host.settimeout(0)
        with pytest.raises(BlockingIOError):
            while True:
                host.accept()[0].close()
        host.settimeout(PATIENCE_S)
        writer.close()
    assert told[0] == f"the tracker is connected to 127.0.0.1, port {port}"
    assert told[1].startswith("the tracker has lost the run: ")


def test_nobody_listens_and_nothing_is_said(host: socket.socket, told: list[str]) -> None:
    port = host.getsockname()[1]
    host.close()
    writer = LineWriter("127.0.0.1", port, told.append)
    writer.write(b"line\n")
    assert not writer.connected and told == []
    writer.close()


def test_what_the_host_says_of_a_line_is_passed_on(host: socket.socket, told: list[str]) -> None:
    writer = LineWriter("127.0.0.1", host.getsockname()[1], told.append)
    writer.write(b"line\n")
    taken, _ = host.accept()
    with taken:
        taken.sendall(b'{"line": 1, "error": "is no JSON \x1b[2J"}\n')
        write_until(writer, lambda: len(told) > 1)
    writer.close()
    assert told[1] == r'the run says of the tracker: {"line": 1, "error": "is no JSON \x1b[2J"}'


def test_what_is_no_run_is_told_in_one_sentence(host: socket.socket, told: list[str]) -> None:
    port = host.getsockname()[1]
    writer = LineWriter("127.0.0.1", port, told.append)
    writer.write(b"line\n")
    taken, _ = host.accept()
    words = rf"^127\.0\.0\.1, port {port}: what listens there is no .*'HTTP/1\.1 400 Bad"
    with taken, pytest.raises(LabError, match=words):
        taken.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n<html>\n")
        write_until(writer, lambda: False)
    writer.close()
    assert len(told) == 1


def test_a_host_that_does_not_read_is_left(host: socket.socket, told: list[str]) -> None:
    writer = LineWriter("127.0.0.1", host.getsockname()[1], told.append)
    writer.write(b"x" * 1000)
    taken, _ = host.accept()
    with taken:
        end_s = time.monotonic() + PATIENCE_S
        while writer.connected:
            assert time.monotonic() < end_s
            writer.write(b"x" * 1_000_000)
    writer.close()
    assert told[1] == "the tracker has lost the run: it does not read what the tracker writes"


@pytest.mark.parametrize(
    ("text", "where"),
    [("lines", ("", 0)), ("lines:5041", ("", 5041)), ("lab-pc:4040", ("lab-pc", 4040))],
)
def test_where_a_tracker_is(text: str, where: tuple[str, int]) -> None:
    assert _arguments.tracker(text) == where


@pytest.mark.parametrize(
    "text", ["", "line", "4040", ":4040", "lab-pc:", "lab-pc:http", "a:70000", "lines:h:1"]
)
def test_what_says_no_tracker(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="expected"):
        _arguments.tracker(text)
