"""The process that holds the swarm's keys: what it gives, and what becomes of a run without it."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from tests.rigs.processes import children
from tests.robots.link.rig import TABLE, Clock
from vsense.base.errors import ConfigError, VsenseError
from vsense.robots.link import key_process, keys
from vsense.robots.link._roster import SessionTable
from vsense.robots.link.key_process import ROBOTS_MAX, KeyProcess, answer
from vsense.robots.link.keys import LinkTrust
from vsense.robots.link.table import ExpectedRobot
from vsense.robots.link.wire import Header, Hello, PacketType, encode

UID = bytes(range(16))
NOBODY, SET_DUMPABLE = 65534, 4


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A file with two keys."""
    path = tmp_path / "lab" / "swarm.key"
    keys.follow(path)
    keys.follow(path)
    return path


def started(path: Path | None) -> tuple[KeyProcess, int]:
    """One, and its number."""
    before = children(os.getpid())
    process = KeyProcess(path)
    (pid,) = set(children(os.getpid())) - set(before)
    return process, pid


def test_it_gives_the_keys_that_the_file_gives(file: Path) -> None:
    swarm, process = keys.read(file), KeyProcess(file)
    assert list(process.numbers) == [2, 1] and process.newest == 2
    for number in range(ROBOTS_MAX + 10):
        uid = number.to_bytes(16, "big")
        assert list(process.roots(uid)) == list(swarm.roots(uid))
    assert process.robot_key(UID) == swarm.robot_key(UID)
    assert process.robot_key(UID, 1) == swarm.robot_key(UID, 1)


def test_a_key_that_no_file_has_goes_with_it() -> None:
    first, second = KeyProcess(), KeyProcess()
    assert first.robot_key(UID) == first.robot_key(UID) != second.robot_key(UID)
    assert list(first.numbers) == [1]


def test_former_keys_are_dropped_there(file: Path) -> None:
    process = KeyProcess(file)
    newer = keys.follow(file)
    assert process.drop_former(2) == [1]
    assert keys.read(file).keys.keys() == {2, 3}, "and what was made meanwhile stays"
    assert list(process.numbers) == [2]
    assert dict(process.roots(UID))[2] == newer.robot_key(UID, 2)


@pytest.mark.parametrize(
    ("text", "mode", "kind", "words"),
    [
        ("1 = 00\n", 0o600, ConfigError, r"swarm.key:1: expected a number"),
        ("", 0o600, VsenseError, "holds no key"),
        ("1 = " + "0" * 64, 0o644, VsenseError, "chmod"),
    ],
)
def test_what_is_wrong_with_a_file_is_said_as_ever(
    file: Path, text: str, mode: int, kind: type[VsenseError], words: str
) -> None:
    file.write_text(text)
    file.chmod(mode)
    with pytest.raises(kind, match=words) as caught:
        KeyProcess(file)
    assert type(caught.value) is kind


def test_it_ends_with_whoever_uses_it() -> None:
    process, pid = started(None)
    assert pid in children(os.getpid())
    del process
    assert pid not in children(os.getpid())


@pytest.mark.skipif(os.getuid() != 0, reason="needs to be root, to become somebody else")
def test_other_programs_of_its_account_cannot_look_into_it() -> None:
    """The memory of a process belongs to its account, or to root where none of it may look."""
    asks, questions = os.pipe()
    answers, tells = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.setuid(NOBODY)
        ctypes.CDLL(None).prctl(SET_DUMPABLE, 1, 0, 0, 0)  # as after its start
        os.dup2(asks, 0)
        sys.stdin, sys.stdout = os.fdopen(0), os.fdopen(tells, "w")
        os.write(tells, b"%d\n" % os.stat("/proc/self/mem").st_uid)
        os.close(questions)
        answer(None)
        os._exit(0)
    os.close(tells)
    with os.fdopen(answers) as lines, os.fdopen(questions, "w") as asked:
        assert lines.readline() == f"{NOBODY}\n"
        assert '"numbers": [1]' in lines.readline()
        assert Path(f"/proc/{pid}/mem").stat().st_uid == 0
        asked.close()
        os.waitpid(pid, 0)
    os.close(asks)


def test_a_robot_is_not_answered_while_it_says_nothing_and_those_that_it_knows_are(
    file: Path,
) -> None:
    process, pid = started(file)
    known, robot = process.roots(UID), b"another robot's!"
    table = SessionTable({5: ExpectedRobot("five", TABLE)}, 10**8, 1, LinkTrust(process))
    hello = encode(
        Header(PacketType.HELLO), Hello(robot, 5, "five", "c"), keys.read(file).robot_key(robot)
    )
    os.kill(pid, signal.SIGSTOP)
    reply = table.greet(hello, "10.0.0.5:7", Clock()())
    assert reply.pending is None and reply.packet == b"" and reply.event is not None
    assert "robot 5: the process that holds the swarm's keys does not answer" in reply.event.text
    assert process.roots(UID) == known
    os.kill(pid, signal.SIGCONT)
    assert process.robot_key(UID) == known[0][1]
    while table.greet(hello, "10.0.0.5:7", Clock()()).pending is None:
        pass  # what was asked before is answered first
    os.kill(pid, signal.SIGKILL)
    for _ in range(2):
        with pytest.raises(VsenseError, match="has ended"):
            process.robot_key(b"a robot unknown!")
    assert process.roots(UID) == known


def test_one_that_was_killed_is_started_again_where_its_keys_are_in_a_file(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(key_process, "AGAIN_S", 0.0)
    (kept, pid), (lost, other) = started(file), started(None)
    kept.robot_key(UID)
    for number in (pid, other):
        os.kill(number, signal.SIGKILL)
    newer = keys.follow(file)
    with pytest.raises(VsenseError, match="started again"):
        kept.robot_key(bytes(16), 2)
    monkeypatch.setattr(key_process, "AGAIN_S", 60.0)
    monkeypatch.chdir("/")  # as users' code may
    until_s = time.monotonic() + 60.0
    while list(kept.numbers) != [3, 2, 1]:
        assert time.monotonic() < until_s
        with suppress(VsenseError):
            kept.robot_key(bytes(15) + b"x")
    assert kept.robot_key(UID, 3) == newer.robot_key(UID, 3)
    assert list(kept.numbers) == [3, 2, 1]
    for _ in range(2):
        with pytest.raises(VsenseError, match=r"has ended$"):
            lost.robot_key(UID)


def test_it_goes_on_after_what_it_cannot_do(file: Path) -> None:
    process = KeyProcess(file)
    text = file.read_text()
    file.write_text("1 = 00\n")
    with pytest.raises(ConfigError):
        process.drop_former(2)
    file.write_text(text)
    assert process.drop_former(2) == [1]
