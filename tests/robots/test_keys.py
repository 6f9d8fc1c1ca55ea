"""A robot's key: who may read its file, and whom a robot with a key obeys."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.robots.rig import TAG, Rig
from vsense.robots.link.keys import SwarmKeys, robot_file
from vsense.robots.link.wire import PUBLISHED

SWARM = SwarmKeys({1: bytes(range(32))})
UID = bytes(range(0x40, 0x50))
KEY = SWARM.robot_key(UID)
GOOD = ["--host", "127.0.0.1", "--port", "9", "--tag", "23", "--base", "argos:/dev/null"]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    made = tmp_path / "robot.key"
    made.write_text(robot_file(UID, KEY))
    made.chmod(0o600)
    return made


@pytest.fixture
def rig(program: Path, file: Path) -> Iterator[Rig]:
    one = Rig(program)
    one.begin(*one.words(key=str(file)))
    yield one
    one.close()


def ask(program: Path, *arguments: str) -> tuple[int, str]:
    done = subprocess.run([program, *GOOD, *arguments], capture_output=True, text=True, timeout=30)
    return done.returncode, done.stderr


KEYED, HOME = 1, 2
"""Capabilities: PROTOCOL.md, section 3."""


def test_a_robot_obeys_the_host_that_has_its_key(rig: Rig) -> None:
    rig.host.root = KEY
    rig.run()
    hello = rig.host.hellos[0]
    assert (hello.uid, hello.tag, hello.capabilities) == (UID, TAG, KEYED | HOME)
    assert KEY.hex() not in rig.daemon.said


def test_a_robot_with_a_key_obeys_nobody_else(rig: Rig) -> None:
    rig.host.root, rig.host.answer = KEY, PUBLISHED
    rig.wait_for(lambda: len(rig.host.hellos) > 2, "greetings that are answered in vain")
    assert not rig.moving and "connected: " not in rig.daemon.said
    rig.host.refuse = True
    rig.wait_for(lambda: "does not know this robot's key refuses" in rig.daemon.said, "doubt")
    assert "robot 23 is here already; bring the key again" in rig.daemon.said


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620, 0o660, 0o666])
def test_a_file_that_others_can_touch_is_refused(program: Path, file: Path, mode: int) -> None:
    file.chmod(mode)
    status, said = ask(program, "--key", str(file))
    assert status == 2
    assert f"{file}: others may read or change it: chmod 600 it" in said


def test_a_file_that_is_none_is_refused(program: Path, tmp_path: Path) -> None:
    status, said = ask(program, "--key", str(tmp_path / "nowhere"))
    assert status == 2 and "errno 2" in said
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo, 0o600)
    for path in (tmp_path, fifo):
        status, said = ask(program, "--key", str(path))
        assert status == 2 and str(path) in said


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda text: text.replace("uid = ", "uid = 1"), "robot.key:1: expected uid = or key ="),
        (lambda text: text + "key = 00\n", "robot.key:3: expected uid = or key ="),
        (lambda text: text + text, "robot.key:3: expected uid = or key ="),
        (lambda text: text.splitlines()[0], "robot.key: expected two lines, uid = and key ="),
        (lambda text: "", "robot.key: expected two lines, uid = and key ="),
        (lambda text: text.replace("key", "tag"), "robot.key:2: expected uid = or key ="),
    ],
)
def test_a_file_that_is_wrong_is_refused_without_its_words(
    program: Path, file: Path, change: Callable[[str], str], words: str
) -> None:
    file.write_text(change(robot_file(UID, KEY)))
    status, said = ask(program, "--key", str(file))
    assert status == 2 and words in said
    assert KEY.hex()[:8] not in said


@pytest.mark.parametrize(
    ("words", "text"),
    [
        ([], "--key is missing: expected either --key FILE"),
        (["--key", "x", "--insecure"], "--key and --insecure: expected either --key FILE"),
        (["--key", "x", "--uid", "0" * 32], "--uid: the file of --key says the robot's uid"),
    ],
)
def test_either_a_key_or_none_and_both_are_said(program: Path, words: list[str], text: str) -> None:
    status, said = ask(program, *words)
    assert status == 2 and text in said


def test_a_robot_without_a_key_does_not_obey_a_host_that_uses_one(program: Path) -> None:
    one = Rig(program)
    try:
        one.start()
        one.wait_for(lambda: one.host.hellos, "a greeting")
        assert one.host.hellos[0].capabilities == HOME and one.host.root == PUBLISHED
        one.host.drop()
        one.host.answer = KEY
        one.wait_for(lambda: len(one.host.hellos) > 2, "greetings that are answered in vain")
        assert "connection lost" in one.daemon.said and not one.moving
    finally:
        one.close()
