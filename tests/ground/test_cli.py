"""The command line: every way out of it is an exit code and at most one line."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import pytest

from vsense import cli, commands
from vsense.commands import arguments
from vsense.errors import UsageError


def test_ctrl_c_while_the_commands_load_is_no_traceback(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(words: Sequence[str]) -> argparse.ArgumentParser:
        raise KeyboardInterrupt

    monkeypatch.setattr(commands, "parser", interrupted)
    assert cli.main([]) == 130
    assert capsys.readouterr().err == "vsense: interrupted\n"


def test_error_is_one_line_and_its_exit_code(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(options: argparse.Namespace) -> int:
        raise UsageError("no such thing")

    parser = argparse.ArgumentParser()
    parser.set_defaults(run=run)
    monkeypatch.setattr(commands, "parser", lambda words: parser)
    assert cli.main([]) == 2
    assert capsys.readouterr().err == "vsense: no such thing\n"


def test_every_command_explains_itself(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main(["--help"])
    assert ended.value.code == 0
    shown = capsys.readouterr().out
    assert all(f"\n    {name} " in shown for name in commands.COMMANDS)


@pytest.mark.parametrize("name", sorted(commands.COMMANDS))
def test_every_command_has_a_page_of_help(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main([name, "--help"])
    assert ended.value.code == 0
    assert f"usage: vsense {name}" in capsys.readouterr().out


@pytest.mark.parametrize("text", ["nan", "inf", "-inf", "0.99", "86400.1", "-1", "x", ""])
def test_no_length_of_time(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError):
        arguments.seconds(text)


@pytest.mark.parametrize("text", ["1", "86400", "1e3"])
def test_length_of_time(text: str) -> None:
    assert arguments.seconds(text) == float(text)
