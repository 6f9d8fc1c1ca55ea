"""`vsense docs`: every page of the tree is listed, found and printed with links that work."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tests.rigs.places import ROOT
from vsense import cli
from vsense.base import terminal
from vsense.base.errors import UsageError
from vsense.tools.shipped import documents


def test_every_page_of_the_tree_is_listed() -> None:
    folders = ("c_src", "firmware_bridge", "robot", "vsense")
    pages = {*ROOT.glob("*.md"), *(p for f in folders for p in (ROOT / f).rglob("*.md"))}
    pages |= {page for page in (ROOT / "tests").rglob("README.md") if "data" not in page.parts}
    every = documents.listed()
    assert {d.path for d in every if d.group == "pages"} == pages
    assert len({d.name for d in every}) == len(every), "no two have one name"
    assert [d.name for d in every if not d.title()] == []


def test_what_people_write_by_is_listed() -> None:
    names = {document.name for document in documents.listed()}
    assert {"foraging.argos", "foraging.c", "controller.h", "walk.h", "resources.xsd"} <= names
    assert {
        "foxglove-layout.json",
        "plan.toml",
        "resources.xml",
        "sensors/leds.py",
        "actuators/leds.py",
    } <= names
    assert "guard.h" not in names, "the daemon's own"


@pytest.mark.parametrize(
    ("name", "place"),
    [
        ("readme", "README.md"),
        ("cameras", "vsense/tools/camera_setup/README.md"),
        ("sensors", "vsense/world/sensors/README.md"),
        ("protocol", "c_src/PROTOCOL.md"),
        ("controller.h", "robot/controller.h"),
        ("guard.h", "robot/guard.h"),
        ("vsense/world/world.py", "vsense/world/world.py"),
        ("sensors/base.py", "vsense/world/sensors/base.py"),
        ("start.c", "vsense/config/experiments/start/start.c"),
    ],
)
def test_found_by_name_or_by_the_end_of_its_place(name: str, place: str) -> None:
    assert documents.find(name).path == ROOT / place


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("controler.h", "'controler.h'.*'controller.h'"),
        ("Sensor", "is 'sensors'"),
        (
            "base.py",
            "'base.py': vsense/world/actuators/base.py, vsense/world/sen",
        ),
        ("../../etc/passwd", "no page"),
        ("", "page ''"),
    ],
)
def test_what_is_not_there(name: str, told: str) -> None:
    with pytest.raises(UsageError, match=told):
        documents.find(name)


def test_links_are_commands_that_print_what_they_name() -> None:
    commands = set()
    for page in (d for d in documents.listed() if d.group == "pages"):
        text = documents.printed(page)
        commands |= set(re.findall(r"\(vsense docs ([^)]+)\)", text))
        assert not re.search(r"\]\((?!https?:)[^)]*\)", re.sub(r"(?s)```.*?```|`[^`]*`", "", text))
    assert {"sensors", "controller.h", "tests"} <= commands
    for name in commands:
        documents.find(name)


def test_the_command_prints_lists_and_says_where(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["docs"]) == 0
    listed = capsys.readouterr().out
    assert re.search(r"^  sensors +Virtual sensors$", listed, re.M)
    assert cli.main(["docs", "controller.h"]) == 0
    assert capsys.readouterr().out == (ROOT / "robot/controller.h").read_text()
    assert cli.main(["docs", "--path", "resources.xsd"]) == 0
    assert capsys.readouterr().out == f"{ROOT / 'vsense/config/schema/resources.xsd'}\n"
    assert cli.main(["docs", "--path"]) == 2


def test_a_long_page_goes_to_the_pager_of_a_terminal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "the page"
    pager = tmp_path / "pager"
    pager.write_text(f"#!/bin/sh\ncat >'{page}'\n")
    pager.chmod(0o755)
    monkeypatch.setenv("PAGER", f"{pager} --option")
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    terminal.paged("short\n")
    assert capsys.readouterr().out == "short\n" and not page.exists()
    terminal.paged("line\n" * 500)
    assert page.read_text() == "line\n" * 500
    monkeypatch.setenv("PAGER", "no-such-pager")
    terminal.paged("line\n" * 500)
    assert capsys.readouterr().out == "line\n" * 500


def docs(stdout: int | None) -> tuple[int, str]:
    """Exit code and standard error of the command with another standard output; None: closed."""
    closed = "" if stdout is not None else ">&-"
    command = f"exec {shlex.quote(sys.executable)} -m vsense docs changelog {closed}"
    done = subprocess.run(
        ["sh", "-c", command], stdout=stdout, stderr=subprocess.PIPE, text=True, check=False
    )
    return done.returncode, done.stderr


def test_where_nobody_reads_there_is_no_traceback() -> None:
    reads, writes = os.pipe()
    os.close(reads)
    assert docs(writes) == (0, ""), "who reads only the begin has what it wanted"
    os.close(writes)
    assert docs(None) == (0, "")
    with open("/dev/full", "w") as full:
        told = docs(full.fileno())
    assert told == (1, "vsense: standard output: No space left on device\n")
