"""The daemon's settings file: what it may say, who wins, and clear words about what is wrong."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tests.robots.rig import TAG, Rig

NO_PAIR = "expected a setting and its value, such as 'port = 4050', got"
GOOD = "host = 127.0.0.1\nport = 4050\ntag = 23\nbase = argos:/nowhere/ttyS0\n"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "robot.conf"


def ask(program: Path, *arguments: str | Path) -> tuple[int, str]:
    done = subprocess.run([program, *arguments], capture_output=True, text=True, timeout=30)
    return done.returncode, done.stderr


def test_a_robot_runs_from_its_settings_alone(program: Path, file: Path) -> None:
    rig = Rig(program)
    try:
        file.write_text(
            f"# a robot\nhost=127.0.0.1\nport = {rig.host.port}\ntag = {TAG}\n"
            f"\tbase = argos:{rig.device}\r\n\nname = the one of the file\ninsecure = yes\n"
        )
        rig.begin("--config", str(file), "--name", "the other")
        rig.run()
        assert (rig.host.hellos[0].tag, rig.host.hellos[0].name) == (TAG, "the other")
    finally:
        rig.close()


@pytest.mark.parametrize("order", [0, 1])
def test_command_line_wins_wherever_it_stands(program: Path, file: Path, order: int) -> None:
    file.write_text(GOOD)
    halves = [["--config", str(file)], ["--insecure", "--base", "argos:/elsewhere/ttyS0"]]
    status, said = ask(program, *halves[order], *halves[1 - order])
    assert status == 1
    assert "cannot open the base /elsewhere/ttyS0: errno 2" in said


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        (GOOD.replace("4050", "70000"), 2, "port: expected a number from 0 to 65535, got '70000'"),
        (GOOD + "\n# more\nspeed = 3", 7, "unknown setting 'speed'; see vsensed --help"),
        (GOOD + "--name = x\n", 5, "unknown setting '--name'"),
        (GOOD + "config = other\n", 5, "unknown setting 'config'"),
        (GOOD + "port = 4051\n", 5, "port: is set twice, before in line 2"),
        (
            GOOD + "hello\n",
            5,
            f"{NO_PAIR} 'hello'",
        ),
        (GOOD + "uid =\n", 5, f"{NO_PAIR} 'uid"),
        (
            GOOD + "proximity-scale = 80:90\n",
            5,
            "proximity-scale: expected 1 or 8 NOTHING:WALL, -4096..4096, 16 apart, got '80:90'",
        ),
        (GOOD + "axle-length = 5.3\n", 5, "axle-length: expected 40..70 mm, got '5.3'"),
        (GOOD + "x" * 300 + " = 1\n", 5, "unknown setting 'xxx"),
    ],
)
def test_what_is_wrong_is_told_with_its_line(
    program: Path, file: Path, text: str, line: int, words: str
) -> None:
    file.write_text(text)
    status, said = ask(program, "--config", file)
    assert status == 2
    assert said.startswith(f"vsensed: {file}:{line}: {words}") and said.count("\n") == 1


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "cannot be read: errno 2"),
        (b"host\0 = 1", "expected a text of at most 4096 bytes"),
        (b"#" * 4097, "expected a text of at most 4096 bytes"),
    ],
)
def test_a_file_that_is_none(program: Path, file: Path, content: bytes | None, words: str) -> None:
    if content is not None:
        file.write_bytes(content)
    status, said = ask(program, "--config", file)
    assert (status, said) == (2, f"vsensed: {file}: {words}\n")


def test_the_longest_file_is_read_to_its_end(program: Path, file: Path) -> None:
    file.write_text("#" * (4095 - len("\ntag = x")) + "\ntag = x")
    assert "robot.conf:2: tag: expected a number" in ask(program, "--config", file)[1]


def test_what_the_file_leaves_open_is_named(program: Path, file: Path) -> None:
    file.write_text(GOOD.replace("tag = 23\n", ""))
    status, said = ask(program, "--config", file)
    assert (status, said) == (2, "vsensed: --tag is missing; see vsensed --help\n")
    status, said = ask(program, "--config")
    assert (status, said) == (2, "vsensed: --config: expected a value after it\n")
