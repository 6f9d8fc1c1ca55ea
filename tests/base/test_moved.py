"""Every module of vsense 0.1 is found by its old name, with one warning that names the new one."""

from __future__ import annotations

import importlib
import json
import re
import subprocess
import sys

import pytest

from tests.rigs.places import DATA, ROOT
from vsense import _moved

LEFT = {"vsense.bench", "vsense.commands.bench"}
"""Left the wheel for `tests/bench/`: they measure vsense itself, and `scripts/bench` runs them."""

NAMES = (DATA / "made-by-0.1" / "modules.txt").read_text().split()
MODULES = [name for name in NAMES if not {name, name.rpartition(".")[0]} & LEFT]

EVERY = """
import importlib, json, sys, warnings
old = sys.stdin.read().split()
warnings.simplefilter("always")
with warnings.catch_warnings(record=True) as caught:
    new = {name: importlib.import_module(name).__name__ for name in old}
    again = [importlib.import_module(name) for name in old]
warned = [str(w.message) for w in caught if w.category is FutureWarning]
specs = [m.__name__ for m in list(sys.modules.values())
         if getattr(m, "__name__", "").startswith("vsense.")
         and m.__spec__ and m.__spec__.name != m.__name__]
print(json.dumps([new, warned, specs]))
"""


@pytest.fixture(autouse=True)
def nobody_has_warned(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(_moved._WARNED, "")


def test_every_old_name_gives_the_module_and_warns_once() -> None:
    done = subprocess.run(
        [sys.executable, "-c", EVERY],
        input="\n".join(MODULES),
        capture_output=True,
        text=True,
        check=True,
    )
    names, warned, specs = json.loads(done.stdout)
    assert len(names) == len(MODULES) > 500 and specs == []
    moves = [tuple(text.split()[:3:2]) for text in warned if " now; " in text]
    assert len(moves) == len(set(moves))
    assert all(names.get(old, new) == new for old, new in moves)
    table = {f"vsense.{old}" for old in _moved.TABLE}
    private = {old for old, new in names.items() if new == "._".join(old.rsplit(".", 1))}
    assert "vsense.world.inventory" in private
    assert (table | private) & names.keys() == {old for old, _ in moves} & names.keys()


@pytest.mark.parametrize("name", sorted(set(NAMES) - set(MODULES)))
def test_who_imports_what_left_the_package_reads_where_it_is(name: str) -> None:
    with pytest.raises(ModuleNotFoundError, match="scripts/bench"):
        importlib.import_module(name)


def test_what_left_is_named() -> None:
    assert {f"vsense.{name}" for name in _moved.GONE} == LEFT <= set(NAMES)


@pytest.mark.parametrize(
    "line",
    [
        "from vsense.sim import campaign; campaign.Campaign",
        "from vsense import errors; errors.VsenseError",
        "from vsense.world import inventory; inventory.Inventory",
        "import vsense.sensors.base; vsense.sensors.base.MountedSensor",
        "from vsense.link import robots; from vsense.link.robots import server",
        "from vsense.sensors.base import Scope; import vsense.world.sensors.base as b; "
        "assert b.Scope is Scope",
    ],
)
def test_ways_to_import(line: str) -> None:
    words = [sys.executable, "-W", "always", "-c", line]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "<string>:1: FutureWarning" in done.stderr and " now; " in done.stderr


def test_a_process_that_is_started_warns_of_no_name_again() -> None:
    inner = "import vsense.sensors, vsense.xml"
    outer = (
        f"import vsense.sensors, subprocess, sys; subprocess.run([sys.executable, '-c', {inner!r}])"
    )
    done = subprocess.run([sys.executable, "-c", outer], capture_output=True, text=True, check=True)
    assert re.findall(r"FutureWarning: (\S+) is", done.stderr) == ["vsense.sensors", "vsense.xml"]


def test_where_a_warning_is_an_error_each_import_raises_it() -> None:
    code = """
import pytest
for _ in range(2):
    with pytest.raises(FutureWarning):
        import vsense.xml
"""
    words = [sys.executable, "-W", "error::FutureWarning", "-c", code]
    subprocess.run(words, check=True, capture_output=True)


def test_a_name_that_never_was_is_told_as_ever() -> None:
    with pytest.raises(ModuleNotFoundError, match=r"vsense\.sensor"):
        __import__("vsense.sensor")


def test_the_changelog_says_where_modules_are_that_pages_of_0_1_showed() -> None:
    text = (ROOT / "CHANGELOG.md").read_text()
    rows = dict(re.findall(r"^\| `(vsense[.\w]+)` \| `(vsense[.\w]+)` \|$", text, re.MULTILINE))
    script = (DATA / "made-by-0.1" / "reads.py").read_text()
    shown = set(re.findall(r"^from (vsense\S+)", script, re.MULTILINE))
    assert rows == {old: f"vsense.{_moved._found_at(old.split('.')[1:])}" for old in rows}
    assert shown - {"vsense.sim"} <= rows.keys() <= set(MODULES)
