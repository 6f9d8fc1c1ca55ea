"""What `scripts/bench mutants` changes, and whether it sees what the tests see."""

from __future__ import annotations

import ast
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.mutants import covered as covered_module
from tests.mutants import mutants as mutants_module
from tests.mutants.mutants import FOLDERS, Mutant, Verdict, draw, files, mutants, stages_of, try_all
from tests.rigs.places import ROOT

PYTHON = '''\
"""1 + 1 of a docstring."""
LIMIT: Literal[3] = 4  # 5 < 6
def f(a: int = 1, *, b: float) -> bool:
    é = "7 == 7", f"{8 + 8}"
    return (a) <= b and not a is not None
'''
C = """\
#define LIMIT (1 + 2) /* 3 + 4 */
int f(int a) { // 5 < 6
    const char *s = "7 == 7";
    return a <= 0x0f && -a < s[1u] * 2;
}
"""


def test_comparisons_operators_and_numbers_of_python() -> None:
    assert [str(m).removeprefix("x.py:") for m in mutants("x.py", PYTHON)] == [
        "2: 4 -> (4 + 1)",
        "3: 1 -> (1 + 1)",
        "5: <= -> <",
        "5: and -> or",
        "5: is not -> is",
    ]


def test_comparisons_operators_and_numbers_of_c() -> None:
    assert [str(m).removeprefix("x.c:") for m in mutants("x.c", C)] == [
        "4: <= -> <",
        "4: 0x0f -> 0x10",
        "4: && -> ||",
        "4: < -> <=",
        "4: 1 -> 2",
        "4: * -> /",
        "4: 2 -> 3",
    ]


def test_a_seed_draws_the_same_mutants_again_and_those_of_python_parse() -> None:
    code = files(["vsense/run", "robot"])
    drawn = draw(code, 60, 7)
    assert drawn == draw(code, 60, 7) != draw(code, 60, 8)
    for mutant in drawn:
        text = (ROOT / mutant.path).read_text("utf-8")
        changed = mutant.apply(text)
        assert text.splitlines()[mutant.line - 1] != changed.splitlines()[mutant.line - 1]
        if mutant.path.endswith(".py"):
            ast.parse(changed)


def test_a_module_is_held_by_its_own_tests_first_and_by_those_of_who_imports_it_most() -> None:
    nearest, *rooms = stages_of("vsense/world/sensors/bank.py")
    assert "tests/world/sensors/test_bank.py" in nearest
    assert [stage[0] for stage in rooms] == ["tests/world/sensors", "tests/world", "tests/run"]
    assert "--ignore=tests/world/sensors" in rooms[1]  # no test runs twice
    assert stages_of("robot/guard.c")[0] == ["tests/robots/test_c_suite.py"]


def checkout(folder: Path, texts: dict[str, str], monkeypatch: pytest.MonkeyPatch) -> None:
    """A checkout of these files, in place of this one."""
    for name, text in texts.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    (folder / ".venv").mkdir()
    for command in (["git", "init", "-q"], ["git", "add", *texts]):
        subprocess.run(command, cwd=folder, check=True)
    monkeypatch.setattr(mutants_module, "ROOT", folder)


def test_what_no_test_notices_survives(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    texts = {
        "setup.py": "",
        "vsense/room/thing.py": "def double(x):\n    return 2 * x\n\ndef unused():\n    return 3\n",
        "tests/room/test_thing.py": "from vsense.room.thing import double\n\n"
        "def test_it():\n    assert double(3) == 6\n",
    }
    checkout(tmp_path, texts, monkeypatch)
    drawn = sorted(draw(files(["vsense"]), 9, 1), key=lambda mutant: mutant.start)
    assert [m.old for m in drawn] == ["2", "*", "3"]
    assert try_all(drawn, jobs=2) == [Verdict.KILLED, Verdict.KILLED, Verdict.SURVIVED]
    assert (tmp_path / "vsense/room/thing.py").read_text() == texts["vsense/room/thing.py"]


def test_the_library_is_built_as_it_was_after_a_mutant_of_c(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    texts = {
        "setup.py": "import shutil; shutil.copy('firmware_bridge/thing.c', 'library')",
        "firmware_bridge/thing.c": "int thing = 1;\n",
        "vsense/room/thing.py": "UNUSED = 3\n",
        "tests/robots/test_c_suite.py": "def test_nothing():\n    pass\n",
        "tests/room/test_thing.py": "def test_it():\n"
        "    assert open('library').read() == 'int thing = 1;\\n'\n",
    }
    checkout(tmp_path, texts, monkeypatch)
    drawn = sorted(draw(files(FOLDERS), 9, 1), key=lambda mutant: mutant.path)
    assert [m.path for m in drawn] == ["firmware_bridge/thing.c", "vsense/room/thing.py"]
    assert try_all(drawn, jobs=1) == [Verdict.SURVIVED, Verdict.SURVIVED]


def test_a_library_that_does_not_build_kills_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    texts = {"setup.py": "raise SystemExit(1)", "vsense/room/thing.py": "UNUSED = 3\n"}
    checkout(tmp_path, texts, monkeypatch)
    with pytest.raises(RuntimeError, match="does not build without a change"):
        try_all(draw(files(["vsense"]), 1, 1), jobs=1)


def test_what_breaks_the_import_of_a_test_is_noticed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    texts = {
        "setup.py": "",
        "vsense/room/thing.py": "VALUE = 1 // (3 - 2)\n",
        "tests/room/test_thing.py": "from vsense.room import thing\n\n"
        "def test_it():\n    assert thing\n",
    }
    checkout(tmp_path, texts, monkeypatch)
    drawn = [mutant for mutant in draw(files(["vsense"]), 9, 1) if mutant.old == "2"]
    assert try_all(drawn, jobs=1) == [Verdict.KILLED], "3 - 3 divides by 0"


def test_a_test_that_fails_without_a_change_kills_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    texts = {
        "setup.py": "",
        "vsense/room/thing.py": "def double(x):\n    return 2 * x\n",
        "tests/room/test_thing.py": "def test_it():\n    assert 1 == 2\n",
    }
    checkout(tmp_path, texts, monkeypatch)
    assert try_all(draw(files(["vsense"]), 2, 1), jobs=1) == [Verdict.UNJUDGED] * 2


COVERED = """\
LIMIT = 3

def half(
    x,
):
    if (
        x > 0
    ):
        return x / 2
    return 0

def told():
    return half(
        LIMIT
    )
"""
TESTED = """\
import subprocess, sys
import pytest
from vsense.room import thing

@pytest.mark.parametrize("x", [4, 6])
def test_half(x):
    assert thing.half(x) == x / 2

def test_nothing():
    assert thing.half(0) == 0

def test_told():
    command = "from vsense.room.thing import told; assert told()"
    subprocess.run([sys.executable, "-c", command], check=True)
"""


ALL = """\
from vsense.room import thing

def test_all():
    thing.half(8)
"""


def test_only_the_tests_that_run_a_line_judge_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    texts = {
        "pyproject.toml": "[tool.pytest.ini_options]\nmarkers = ['alone', 'paced']\n",
        "setup.py": "",
        "vsense/__init__.py": "",
        "vsense/room/__init__.py": "",
        "vsense/room/thing.py": COVERED,
        "tests/room/test_thing.py": TESTED,
        "tests/other/test_all.py": ALL,
    }
    checkout(tmp_path, texts, monkeypatch)
    for name in ("mutants/covered.py", "rigs/places.py"):
        (tmp_path / "tests" / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(Path(covered_module.__file__).parents[1] / name, tmp_path / "tests" / name)
    monkeypatch.setattr(covered_module, "ROOT", tmp_path)
    monkeypatch.setattr(covered_module, "FOLDER", tmp_path / "build/covered")
    with pytest.raises(FileNotFoundError):
        covered_module.Covered()
    assert covered_module.measure(["tests/room", "tests/other"], 1) == 0
    found = covered_module.Covered()

    def tests_of(line: int, text: str = COVERED) -> set[str] | None:
        mutant = Mutant("vsense/room/thing.py", line, 0, 0, "", "")
        tests = found.tests_of(mutant, text)
        return tests if tests is None else {test.partition("::test_")[2] for test in tests}

    assert tests_of(7) == {"half[4]", "half[6]", "nothing", "told", "all"}
    assert tests_of(9) == {"half[4]", "half[6]", "told", "all"}
    assert tests_of(10) == {"nothing"}
    assert tests_of(14) == {"told"}, "in a process that the test has started"
    assert tests_of(1) == {"half[4]", "half[6]", "nothing", "told", "all"}
    assert tests_of(1, COVERED + "\n") is None
    stages = found.stages_of(Mutant("vsense/room/thing.py", 9, 0, 0, "", ""), COVERED)
    assert stages is not None and stages[-1][-1].endswith("::test_all"), "its folder's come first"
    drawn = [m for m in mutants("vsense/room/thing.py", COVERED) if m.line in (7, 9)]
    assert try_all(drawn, jobs=1) == [Verdict.SURVIVED] * 2 + [Verdict.KILLED] * 2
