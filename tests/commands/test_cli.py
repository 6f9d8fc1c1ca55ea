"""The command line: every way out of it is an exit code and at most one line."""

from __future__ import annotations

import argparse
import importlib.util
import os
import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from unittest.mock import ANY

import cv2
import numpy as np
import pytest

from scripts.site.commands import options, parsers
from vsense import __version__, cli, commands
from vsense.base import errors
from vsense.base.errors import UsageError
from vsense.commands import _arguments
from vsense.monitor import recording
from vsense.monitor.ui._watchers import page_access
from vsense.monitor.ui.access import WebAddress


def test_ctrl_c_while_the_commands_load_is_no_traceback(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(words: Sequence[str]) -> argparse.ArgumentParser:
        raise KeyboardInterrupt

    monkeypatch.setattr(commands, "parser", interrupted)
    assert cli.main(["sim"]) == 130
    assert capsys.readouterr().err == "vsense: interrupted\n"


def test_error_is_one_line_and_its_exit_code(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(options: argparse.Namespace) -> int:
        raise UsageError("no such thing")

    parser = argparse.ArgumentParser()
    parser.add_argument("command")
    parser.set_defaults(run=run)
    monkeypatch.setattr(commands, "parser", lambda words: parser)
    assert cli.main(["sim"]) == 2
    assert capsys.readouterr().err == "vsense: no such thing\n"


LONG = "x" * 300


@pytest.mark.parametrize(
    "words",
    [
        "sim", "lab", "run", "track", "replay", "export", "report", "pack", "reproduce", "series",
        "benchmark check", "camera track", "camera calibrate import -o x", "robot list --roster",
        "camera markers find --family arrow4x4",
    ],
)  # fmt: skip
def test_a_name_that_no_file_can_have_is_said(
    words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main([*words.split(), LONG]) == 2
    said = capsys.readouterr().err
    assert LONG in said and said.startswith("vsense: ") and said.count("\n") == 1


def test_every_command_explains_itself(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main(["--help"])
    assert ended.value.code == 0
    shown = capsys.readouterr().out
    assert all(f"\n    {name} " in shown for name in commands.COMMANDS)


def test_vsense_alone_says_where_to_begin(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main([]) == 0
    shown = capsys.readouterr().out
    assert 9 <= len(shown.splitlines()) <= 12 and shown == commands.START
    named = {line.split()[1] for line in shown.splitlines() if line.startswith("  vsense")}
    assert named <= {*commands.names()} - commands.FORMER_COMMANDS.keys() and "sim" in named


def test_every_command_is_in_one_group() -> None:
    grouped = [name for names in commands.GROUPS.values() for name in names]
    assert sorted(grouped) == sorted(commands.COMMANDS)


FORMER_LINES = {
    "start": "--json",
    "stop": "--emergency --all",
    "replace": "23=37",
    "handover": "23 --force",
    "cameras": "",
    "cameras --json": "",
    "cameras tune": "cam1 --sweep",
    "markers": "--ids 1-20 -o sheet.pdf",
    "calibrate check": "--points points.csv",
    "arena align": "pollutant --undo",
    "track": "a.xml b.xml --offline",
    "serve": "a.xml b.xml",
    "record": "pollutant folder",
}
"""Former commands with their arguments."""


@pytest.mark.parametrize("former", FORMER_LINES)
def test_a_former_name_does_what_the_new_one_does(
    former: str, capsys: pytest.CaptureFixture[str]
) -> None:
    typed = [*former.split(), *FORMER_LINES[former].split()]
    name = commands.FORMER_COMMANDS[typed[0]]
    rest = typed[1:]
    if name == "camera" and (not rest or rest[0].startswith("-")):
        name = "camera list"
    parsed = [
        vars(commands.parser(words).parse_args(words))
        for words in (commands.current(typed), [*name.split(), *rest])
    ]
    parsed[0]["command"] = {"record": "render"}.get(former, parsed[0]["command"])
    for values in parsed:  # what notes the options of a whole suite wraps the function
        values["run"] = getattr(values["run"], "args", [values["run"]])[0]
    assert parsed[0] == parsed[1] and capsys.readouterr() == ("", "")


def test_the_former_family_has_the_help_of_the_new_one(capsys: pytest.CaptureFixture[str]) -> None:
    pages = [shown_options([name, "--help"], capsys)[0] for name in ("cameras", "camera")]
    assert pages[0] == pages[1] and "\n    tune " in pages[0]


def test_a_former_name_is_in_no_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert not commands.FORMER_COMMANDS.keys() & commands.COMMANDS.keys()
    assert {line.split()[0] for line in FORMER_LINES} <= commands.FORMER_COMMANDS.keys()
    for words in (["stop", "--help"], ["stop", "--zzz"]):
        with pytest.raises(SystemExit):
            cli.main(words)
        said = "".join(capsys.readouterr())
        assert "vsense control stop" in said and "vsense stop" not in said


@pytest.mark.parametrize(
    "words", ["control", "camera", "camera calibrate", "camera arena", "robot"]
)
def test_a_family_alone_shows_what_there_is(words: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main(words.split())
    said = capsys.readouterr()
    assert (ended.value.code, said.out) == (2, "")
    (listed,) = (
        action.choices
        for parser in parsers_of(words)
        for action in parser._actions
        if parser.prog == f"vsense {words}" and action.nargs == argparse.PARSER
    )
    assert all(f"\n    {name} " in said.err for name in listed)


def parsers_of(words: str) -> list[argparse.ArgumentParser]:
    """The parser of these words, with all below it."""
    name = words.split()[0]
    if words in commands.FAMILIES:
        root = commands.parser([words])
        return [next(a.choices[words] for a in root._actions if a.nargs == argparse.PARSER)]
    return list(parsers(words if name in commands.FAMILIES else name))


MANY = 14
"""So many options a page of help shows at most, unless it is asked for all."""
PAGES = sorted(
    {p.prog.removeprefix("vsense ") for name in commands.COMMANDS for p in parsers(name)}
)


def shown_options(words: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[str, set[str]]:
    """A page of help, and the options that have a line there."""
    with pytest.raises(SystemExit) as ended:
        cli.main(words)
    assert ended.value.code == 0
    page = capsys.readouterr().out
    return page, {
        name
        for line in page.splitlines()
        for name in re.findall(r"--[a-z][a-z0-9-]*", line.strip().split("  ")[0])
        if re.match(r"  -", line)
    }


@pytest.mark.parametrize("name", PAGES)
def test_help_shows_few_options_and_on_demand_all(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (parser,) = (p for p in parsers(command_of(name)) if p.prog == f"vsense {name}")
    actions = (action for action in parser._actions if action.help is not argparse.SUPPRESS)
    known = {word for action in actions for word in action.option_strings if word[:2] == "--"}
    page, few = shown_options([*name.split(), "--help"], capsys)
    assert len(few - {"--help"}) <= MANY
    _, every = shown_options([*name.split(), "--help", "all"], capsys)
    assert every == known
    assert shown_options(["help", *name.split(), "all"], capsys)[1] == known
    assert page.splitlines()[-1] == last_line(name, len(known) - len(few))
    assert (few == known) == (len(known - {"--help"}) <= MANY)
    assert len(few) > 6 or few == known


def last_line(name: str, hidden: int) -> str:
    return f"{hidden} more options: vsense {name} --help all" if hidden else ANY


def command_of(name: str) -> str:
    """The command whose page this is, or an action's of it."""
    return next(c for c in commands.COMMANDS if f"{name} ".startswith(f"{c} "))


def test_the_common_options_are_those_of_some_page() -> None:
    every = {word for name in commands.COMMANDS for p in parsers(name) for word in options(p)}
    assert every >= commands.COMMON and commands.FEW == MANY


@pytest.mark.parametrize("option", ["--version", "-v"])
def test_the_version_is_that_of_all_that_counts(
    option: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main([option])
    assert ended.value.code == 0
    words = capsys.readouterr().out
    assert f"vsense {__version__}" in words and f"OpenCV {cv2.__version__}" in words
    assert f"Python {platform.python_version()}, NumPy {np.__version__}" in words


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["lab", "x", "--duratoin", "3"], "lab: unrecognized arguments: --duratoin 3 (is '--dura"),
        (["lab", "x", "--duration", "0"], "lab: argument --duration: 0: expected 1 to 86400 sec"),
        (["robot", "keys", "--zzz"], "robot keys: unrecognized arguments: --zzz; see vsense robot"),
        (["sim"], "sim: the following arguments are required: experiment; see vsense sim --help"),
    ],
)
def test_wrong_usage_is_one_line_of_the_command(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main(words)
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"vsense {said}")


@pytest.mark.parametrize(("words", "page"), [(["help"], "vsense"), (["help", "sim"], "vsense sim")])
def test_help_may_be_a_word(
    words: list[str], page: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main(words)
    assert ended.value.code == 0
    assert capsys.readouterr().out.startswith(f"usage: {page} ")


@pytest.mark.parametrize(
    ("wrong", "hint"),
    [
        ("simm", "is 'sim' meant?"),
        ("simulate", "is 'sim' meant?"),
        ("calibration", "is 'camera calibrate' meant?"),
        ("paus", "is 'control pause' or "),
        ("camra", "is 'camera' or 'camera arena' meant?"),
        ("xyz", "there are: benchmark, camera, compare, completion, control, "),
    ],
)
def test_an_unknown_command_tells_what_may_be_meant(
    wrong: str, hint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main([wrong, "--option"]) == 2
    assert f"vsense: there is no command '{wrong}'; {hint}" in capsys.readouterr().err


def test_a_command_that_is_gone_tells_where_it_is(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["bench", "tracking", "--json"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("vsense: there is no command 'bench'") and "scripts/bench" in line
    assert not commands.REMOVED.keys() & commands.COMMANDS.keys()


def test_names_that_may_be_meant() -> None:
    assert errors.instead("bog", ["bug", "dog", "far"]) == "is 'dog' or 'bug' meant?"
    assert errors.instead("q", ["b", "a"], "known are") == "known are: a, b"
    assert errors.instead("q", []) == "there are: none"
    assert errors.instead("?", map(str, range(41))).endswith(", 7, 8, 9")
    assert errors.instead("?", map(str, range(122))).endswith(", 97 and 2 others")
    assert "others" not in errors.instead("nix", map(str, range(100))), "as many pages as there are"


@pytest.mark.parametrize("name", sorted(commands.COMMANDS))
def test_every_command_has_a_page_of_help(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main([*name.split(), "--help"])
    assert ended.value.code == 0
    assert f"usage: vsense {name}" in capsys.readouterr().out


WITHOUT_EXTRAS = """
import importlib, sys
from vsense import commands
from vsense.base import errors

class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in errors.EXTRAS:
            raise ModuleNotFoundError(name)

sys.meta_path.insert(0, Hidden())
for name, _ in commands.COMMANDS.values():
    importlib.import_module(f"vsense.commands.{name}")
"""


def test_every_command_loads_without_the_extras() -> None:
    command = [sys.executable, "-c", WITHOUT_EXTRAS]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_the_table_of_extras_is_that_of_the_package() -> None:
    lines = [line.partition("; extra == ") for line in metadata.requires("vsense") or ()]
    ours = {extra.strip("'\"") for _, _, extra in lines} - {
        *("", "test", "bench", "docs", "release", "all")
    }
    assert ours >= {"record", "robot", "web"}
    for line, _, extra in lines:
        if extra.strip("'\"") in ours and not line.startswith("vsense["):
            package = line.rstrip("0123456789.<>=").removesuffix("-sdk")  # imported without
            package = package.replace("pyserial", "serial").removeprefix("eclipse-")  # likewise
            own_extra = package.partition("[")[2].removesuffix("]")  # dask[distributed]
            assert errors.EXTRAS[own_extra or package] == extra.strip("'\"")


def test_a_missing_package_is_named_with_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    recording.require()
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(UsageError) as caught:
        recording.require()
    needed = r"recordings need the Python package mcap: .*pip install 'mcap>=1.6' 'zstandard>=0.22'"
    assert re.fullmatch(needed, str(caught.value))
    with pytest.raises(UsageError, match=r"the page needs .* aiohttp: .*pip install 'aiohttp>=3"):
        page_access(WebAddress("127.0.0.1", 0))


def test_the_pip_is_that_of_this_python(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: "/usr/bin/pip")
    line = errors.pip_line("aiohttp")
    assert line.startswith(f"{sys.executable} -m pip install 'aiohttp")
    monkeypatch.setattr(shutil, "which", lambda name: str(Path(sys.executable).with_name(name)))
    assert errors.pip_line("ziglang").startswith("pip install ziglang==")

    def nowhere(name: str) -> list[str]:
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "requires", nowhere)
    assert errors.pip_line("ziglang") == "pip install ziglang"


@dataclass
class Asked:
    """Stands for a command's record."""

    port: int
    host: str = "everywhere"
    where: str = "here"


def test_a_field_without_an_option_is_absent_on_purpose_only() -> None:
    options = argparse.Namespace(port=1, more=2)
    made = _arguments.fill(Asked, options, "host", where="there")
    assert made == Asked(1, "everywhere", "there")
    for absent, named in (((), "host"), (("host", "port"), "port"), (("host", "more"), "more")):
        with pytest.raises(TypeError, match=f"^Asked: expected .*: {named}$"):
            _arguments.fill(Asked, options, *absent, where="there")
    with pytest.raises(TypeError, match=r"^Asked: .*: host, where$"):
        _arguments.fill(Asked, options)


def loaded_by(command: str) -> set[str]:
    code = (
        f"import sys\nfrom vsense import commands\ncommands.parser([{command!r}])\n"
        "print(*(name for name in sys.modules))"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(ran.stdout.split())


def test_an_emergency_stop_needs_no_library() -> None:
    # A checkout that is being built anew, or an installation that is damaged, must still stop.
    loaded = loaded_by("stop")
    assert "vsense.commands.orders" in loaded
    assert not loaded & {"numpy", "cv2", "vsense.base.native", "vsense._native", "vsense._kernels"}


def test_a_simulation_starts_without_opencv() -> None:
    loaded = loaded_by("sim")
    assert "vsense.vision.markers.families" in loaded and "cv2" not in loaded


@pytest.mark.parametrize("text", ["nan", "inf", "-inf", "0.99", "86400.1", "-1", "x", ""])
def test_no_length_of_time(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError):
        _arguments.seconds(text)


@pytest.mark.parametrize("text", ["1", "86400", "1e3"])
def test_length_of_time(text: str) -> None:
    assert _arguments.seconds(text) == float(text)


def test_the_exit_code_is_right_where_nobody_reads_the_error() -> None:
    reads, writes = os.pipe()
    os.close(reads)
    command = [sys.executable, "-m", "vsense", "run", "no-such-experiment"]
    done = subprocess.run(command, stderr=writes, timeout=60.0, check=False)
    os.close(writes)
    assert done.returncode == 2


def test_a_dry_simulation_says_what_the_run_would_lack(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["sim", "--dry", "foraging", "--web", "8081", "--foxglove", "8081"]) == 2
    said = capsys.readouterr()
    assert "--foxglove: 8081" in said.err and said.out == ""


def test_a_watched_run_is_forked_with_what_it_needs() -> None:
    code = (
        "import sys\nfrom vsense.modes.sim._kept import prepare\nprepare(b'', True)\n"
        "print(*(name for name in sys.modules))"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert {"vsense.modes.sim._paced", "vsense.modes.sim._recording"} <= set(ran.stdout.split())


def test_a_wrong_choice_is_told_with_what_is_meant(capsys: pytest.CaptureFixture[str]) -> None:
    for words, hint in (
        ("robot lst", "'list'"),
        ("camera lis", "'list'"),
        ("cameras lis", "'list'"),
        ("control strat", "'start' or 'status'"),
        ("sim x --format pgn", "'png'"),
    ):
        with pytest.raises(SystemExit) as ended:
            cli.main(words.split())
        assert ended.value.code == 2 and f"; is {hint} meant?" in capsys.readouterr().err
