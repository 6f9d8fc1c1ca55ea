"""Completion: what a shell is answered, and that nobody else waits for it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from vsense import cli


def completed(line: str, folder: Path) -> list[str]:
    """What a shell is told that asks how a line may go on; as argcomplete's protocol has it."""
    answer = folder / "answer"
    asking = {
        "_ARGCOMPLETE": "1",
        "_ARGCOMPLETE_STDOUT_FILENAME": str(answer),
        "_ARGCOMPLETE_IFS": "\n",
        "COMP_LINE": line,
        "COMP_POINT": str(len(line)),
    }
    command = [sys.executable, "-m", "vsense"]
    subprocess.run(command, env={**os.environ, **asking}, cwd=folder, check=True, timeout=60.0)
    return [word.strip() for word in answer.read_text().splitlines()]


def test_commands_options_and_experiments_are_completed(tmp_path: Path) -> None:
    (tmp_path / "mine.argos").touch()
    (tmp_path / "mine.c").touch()
    assert completed("vsense cont", tmp_path) == ["control"]
    assert completed("vsense cal", tmp_path) == ["calibrate"]
    assert completed("vsense control st", tmp_path) == ["status", "start", "stop"]
    for line in ("vsense stop --em", "vsense control stop --em"):
        assert completed(line, tmp_path) == ["--emergency"]
    for line in ("vsense camera cali", "vsense cameras cali"):
        assert completed(line, tmp_path) == ["calibrate"]
    assert completed("vsense camera calibrate r", tmp_path) == ["rig"]
    assert completed("vsense sim m", tmp_path) == ["mine.argos"]
    assert set(completed("vsense lab pollutant", tmp_path)) >= {"pollutant", "pollutant-moving"}
    assert completed("vsense lab pollutant --firm", tmp_path) == ["--firmware-watchdog"]


def test_a_shell_is_told_what_to_do(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["completion", "bash"]) == 0
    assert "complete " in capsys.readouterr().out


def test_nothing_is_loaded_for_it_where_no_shell_asks() -> None:
    code = (
        "import sys\nfrom vsense import cli\n"
        "try: cli.main(['sim', '--help'])\nexcept SystemExit: pass\n"
        "print('argcomplete' in sys.modules)"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.splitlines()[-1] == "False"
