"""The pages' scripts as sources: linted, their types checked, their elements and messages known."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import lack, require_tool

ROOT = Path(__file__).parents[3]
PAGE = ROOT / "vsense" / "monitor" / "ui" / "page"
ALIGN = ROOT / "vsense" / "tools" / "camera_setup" / "align"
PLAYER = ROOT / "vsense" / "studies"
HERE = Path(__file__).parent
LINTER_RULES = HERE / "page.oxlintrc.json"
TYPE_RULES = HERE / "page.tsconfig.json"
OXLINT = "oxlint==1.89.0"
LINE_MAX = 120


def oxlint() -> str:
    """The linter, this environment's or this machine's; skips the test where there is none."""
    places = os.pathsep.join((str(Path(sys.executable).parent), os.environ.get("PATH", "")))
    path = shutil.which("oxlint", path=places)
    if path is None:
        lack(f"needs oxlint: pip install {OXLINT}")
    return path


def tsc() -> str:
    """TypeScript's compiler, npm's or this machine's; skips the test where there is none."""
    own = ROOT / "node_modules" / ".bin" / "tsc"
    return str(own) if own.is_file() else require_tool("tsc", "node-typescript")


def lint(*folders: Path) -> subprocess.CompletedProcess[str]:
    scripts = [str(path) for folder in folders for path in folder.glob("*.js")]
    command = [oxlint(), "--config", str(LINTER_RULES), "--format", "unix", *scripts]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


def check_types(rules: Path) -> subprocess.CompletedProcess[str]:
    command = [tsc(), "--project", str(rules), "--pretty", "false"]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


@pytest.fixture
def faulty(tmp_path: Path) -> Path:
    """A folder with scripts in which something is wrong."""
    shutil.copytree(PAGE, tmp_path / "page")
    script = tmp_path / "page" / "events.js"
    script.write_text(f"{script.read_text()}\nvar unused = byId('seek').valeu == null;\n")
    return tmp_path


def test_the_linter_finds_nothing() -> None:
    done = lint(PAGE, ALIGN, PLAYER)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_linter_finds_a_fault(faulty: Path) -> None:
    done = lint(faulty / "page")
    assert done.returncode != 0
    assert {"eslint(eqeqeq)", "eslint(no-var)"} <= set(re.findall(r"eslint\([\w-]+\)", done.stdout))


def test_types_are_right() -> None:
    done = check_types(TYPE_RULES)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_wrong_type_is_found(faulty: Path) -> None:
    rules = faulty / "tsconfig.json"
    looked_at = ["page/events.js", "page/*.d.ts"]
    rules.write_text(json.dumps({"extends": str(TYPE_RULES), "include": looked_at}))
    done = check_types(rules)
    assert done.returncode != 0
    found = re.findall(r"/page/(\w+\.js)\(\d+,\d+\): error (TS\d+)", done.stdout)
    assert ("events.js", "TS2551") in found, done.stdout


@pytest.mark.parametrize("folder", [PAGE, ALIGN], ids=lambda folder: folder.name)
def test_every_element_that_is_asked_for_by_its_id_is_there(folder: Path) -> None:
    html = "".join(path.read_text() for path in folder.glob("*.html"))
    known = set(re.findall(r'\bid="(\w+)"', html))
    asked = {
        (path.name, name)
        for path in folder.glob("*.js")
        for name in re.findall(r'\bbyId\("(\w+)"\)', path.read_text())
    }
    assert len(asked) > 5
    assert {(name, id_) for name, id_ in asked if id_ not in known} == set()


def test_the_types_of_messages_are_those_of_messages_md() -> None:
    lines = (PAGE.parent / "MESSAGES.md").read_text().splitlines()
    types = (PAGE / "types.d.ts").read_text()
    described = re.findall(r"^/\*\* `(/\w+)`[^\n]*\ninterface \w+ \{\n(.*?)^\}", types, re.M | re.S)
    assert len(described) > 10
    for topic, body in described:
        about = [line for line in lines if f"`{topic}" in line or f'"{topic}"' in line]
        names = re.findall(r"^  (\w+)\??:", body, re.M)
        assert names and about, topic
        assert [n for n in names if not re.search(rf"\b{n}\b", "".join(about))] == [], topic


def test_lines_are_short_enough_to_read() -> None:
    long = [
        f"{path.name}:{number}"
        for folder in (PAGE, ALIGN, PLAYER)
        for path in sorted([*folder.glob("*.js"), *folder.glob("*.ts")])
        for number, line in enumerate(path.read_text().splitlines(), 1)
        if len(line) > LINE_MAX
    ]
    assert long == []
