"""The scripts around the programs, tried in a tree whose Python and compiler are stand-ins."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from scripts.site.links import broken
from tests.conftest import require_tool

ROOT = Path(__file__).parent.parent


def program(path: Path, script: str) -> Path:
    """Makes a shell script that can be called."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)
    return path


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A repository with the real scripts; its `vsense` prints where and how it was called."""
    tree = tmp_path / "a tree"
    shutil.copytree(ROOT / "scripts", tree / "scripts")
    for name in (
        "pyproject.toml",
        "setup.py",
        "vsense/__init__.py",
        "c_src/a.c",
        "c_src/b.py",
        "c_src/host/k.c",
        "firmware_bridge/f.h",
    ):
        (tree / name).parent.mkdir(parents=True, exist_ok=True)
        (tree / name).touch()
    program(tree / ".venv/bin/python", 'echo "$PWD" "$@" >>"$(dirname "$0")/calls"')
    program(tree / ".venv/bin/vsense", 'echo "$PWD"; printf "<%s>" "$@"')
    return tree


def demo(tree: Path, *arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
    """Calls `scripts/demo` from another folder."""
    return call(tree, "demo", *arguments, **variables)


def call(
    tree: Path, name: str, *arguments: str, **variables: str
) -> subprocess.CompletedProcess[str]:
    """Calls a script from another folder."""
    require_tool("bash", "bash")
    elsewhere = tree.parent / "elsewhere"
    elsewhere.mkdir(exist_ok=True)
    python = program(tree.parent / "bin/python-stand-in", "exit 0")
    program(tree.parent / "bin/ccache", "exit 0")
    path = f"{tree.parent}/bin:{os.environ['PATH']}"
    return subprocess.run(
        [os.path.relpath(tree / "scripts" / name, elsewhere), *arguments],
        cwd=elsewhere,
        env={**os.environ, "PYTHON": str(python), "PATH": path, **variables},
        capture_output=True,
        text=True,
        timeout=60,
    )


def called(tree: Path, script: str, *arguments: str, **variables: str) -> tuple[int, str]:
    """Exit code of a script, and what it says on standard error."""
    python = program(tree.parent / "bin/python-stand-in", "exit 0")
    done = subprocess.run(
        [require_tool("bash", "bash"), tree / "scripts" / script, *arguments],
        env={**os.environ, "PYTHON": str(python), "VSENSE_URL": "", **variables},
        capture_output=True,
        text=True,
        timeout=60,
    )
    return done.returncode, done.stderr.splitlines()[-1]


def test_a_release_says_what_it_lacks_before_it_builds(tree: Path, tmp_path: Path) -> None:
    assert called(tree, "release") == (
        1,
        "vsense: VSENSE_URL is not set: where are the sources published?",
    )
    code, said = called(tree, "release", "biuld")
    assert code == 1 and said.endswith(
        "scripts/release build [FOLDER], scripts/release check [FOLDER]"
    )
    full = tmp_path / "full"
    (full / "theirs").mkdir(parents=True)
    assert called(tree, "release", "build", str(full)) == (1, f"vsense: {full} is not empty")
    assert [path.name for path in full.iterdir()] == ["theirs"]


def test_a_release_is_what_the_changelog_begins_with(tree: Path) -> None:
    program(tree / ".venv/bin/python", "echo 0.2.0")
    (tree / "CHANGELOG.md").write_text("# C\n\n## Unreleased\n\n## 0.2.0 - 2027-01-31\n")
    assert called(tree, "release", VSENSE_URL="https://example.org") == (
        1,
        "vsense: CHANGELOG.md begins with '## Unreleased', expected '## 0.2.0 - DATE'",
    )
    (tree / "CHANGELOG.md").write_text("# C\n\n## 0.2.0 - 2027-01-31\n")
    (tree / ".github").mkdir()
    (tree / ".github" / "CITATION.cff").write_text("version: 0.2.0\ndate-released: 2026-11-25\n")
    assert called(tree, "release", VSENSE_URL="https://example.org") == (
        1,
        "vsense: .github/CITATION.cff has no line 'date-released: 2027-01-31'",
    )


def test_callers_folder_is_kept(tree: Path) -> None:
    done = demo(tree, "mine.argos", "--output", "out", CDPATH=f"{tree}")
    assert done.returncode == 0, done.stderr
    place = tree.parent / "elsewhere"
    assert done.stdout == f"{place}\n<lab><mine.argos><--web><0><--output><out>"
    assert f'\n    source "{tree}/.venv/bin/activate"\n' in done.stderr
    assert (tree / ".venv/bin/calls").read_text().split("--editable ")[1] == f"{tree}[web,record]\n"
    assert (tree / ".venv/built").read_text().strip()
    assert list(place.iterdir()) == []


def test_two_scripts_at_once_build_once(tree: Path) -> None:
    demo(tree)
    once = (tree / ".venv/bin/calls").read_text()
    for file in (".venv/built", ".venv/bin/calls"):
        (tree / file).unlink()
    program(tree / ".venv/bin/python", 'sleep 0.5; echo "$PWD" "$@" >>"$(dirname "$0")/calls"')
    with ThreadPoolExecutor(2) as both:
        done = list(both.map(demo, [tree, tree]))
    assert [one.returncode for one in done] == [0, 0], done
    assert (tree / ".venv/bin/calls").read_text() == once


def test_second_start_builds_nothing(tree: Path) -> None:
    demo(tree)
    calls = tree / ".venv/bin/calls"
    before = calls.read_text()
    done = demo(tree, "--json", CC="no-such-compiler")
    assert done.stdout.endswith("<lab><pollutant><--web><0><--json>"), done.stderr
    assert calls.read_text() == before
    for builds, name in enumerate(("c_src/a.c", "c_src/host/k.c"), 2):
        (tree / name).write_text("int edited;\n")
        assert demo(tree).returncode == 0
        assert calls.read_text() == builds * before


@pytest.mark.parametrize("compiler", ["ccache gcc", "ccache", " ", " ccache  gcc -m32"])
def test_compiler_may_have_words(tree: Path, compiler: str) -> None:
    done = demo(tree, CC=compiler)
    assert done.returncode == 0, done.stderr


def test_missing_compiler_is_one_line_with_its_cure(tree: Path) -> None:
    done = demo(tree, CC="no-such-compiler gcc")
    assert done.returncode == 1
    assert len(done.stderr.splitlines()) == 1
    assert "no C compiler; install it with: sudo apt install build-essential" in done.stderr


def test_docs_builds_where_the_tree_is_and_says_where_pages_lie(tree: Path) -> None:
    done = call(tree, "docs")
    assert (done.returncode, done.stdout) == (0, f"{tree}/build/docs/html/index.html\n"), (
        done.stderr
    )
    calls = (tree / ".venv/bin/calls").read_text().splitlines()
    assert calls[-1] == f"{tree} -m scripts.site.build build/docs"


def test_docs_refuses_what_it_does_not_know(tree: Path) -> None:
    done = call(tree, "docs", "--srve")
    assert done.returncode == 1 and "--serve [PORT]" in done.stderr


SUBJECTS = (
    *("tracking", "identity", "world", "sim", "homing", "grabbing", "robot"),
    "embedded",
    *("hard", "argos", "spread", "faults", "fuzz", "soak", "mutants", "callbacks"),
    *("disobedience", "firmware", "nodes"),
)


@pytest.mark.parametrize("subject", SUBJECTS)
def test_bench_runs_every_subject_where_the_caller_is(tree: Path, subject: str) -> None:
    done = call(tree, "bench", subject, "--json", "a b")
    assert done.returncode == 0, done.stderr
    place, _, words = (tree / ".venv/bin/calls").read_text().splitlines()[-1].partition(" -m ")
    module, _, given = words.partition(" ")
    assert place == str(tree.parent / "elsewhere")
    assert (ROOT / module.replace(".", "/")).with_suffix(".py").exists()
    assert given == (f"{subject} --json a b" if module == "tests.bench.main" else "--json a b")


IMPORTS = """
import importlib, importlib.machinery, sys
find, (module, *hidden) = importlib.machinery.PathFinder.find_spec, sys.argv[1:]
def find_spec(name, path=None, target=None):
    return None if name.partition(".")[0] in hidden else find(name, path, target)
importlib.machinery.PathFinder.find_spec = find_spec
importlib.import_module(module)
"""
OF_TESTS = ("pytest", "hypothesis", "aiohttp", "cryptography", "mcap", "zstandard", "matplotlib")
OF_TESTS += ("scipy", "distributed", "argcomplete", "foxglove", "xdist")
"""What the extra `test` brings."""


@pytest.mark.parametrize(
    ("module", "brought"),
    [
        *(("tests.bench.main", brought) for brought in ({"ziglang"}, set())),
    ],
)
def test_what_scripts_start_needs_their_own_extras_only(module: str, brought: set[str]) -> None:
    hidden = {*OF_TESTS, "ziglang", "sphinx"} - brought
    command = [sys.executable, "-c", IMPORTS, module, *sorted(hidden)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")


def test_pages_are_staged_without_what_only_tests_need(tmp_path: Path) -> None:
    """With what `scripts/docs` installs but Sphinx; and all their links lead somewhere there."""
    fill = f"\nfrom scripts.site import build\nbuild.stage(build.Path({str(tmp_path)!r}))"
    hidden = {*OF_TESTS, "ziglang", "sphinx"} - {"aiohttp", "mcap", "zstandard"}
    command = [sys.executable, "-c", IMPORTS + fill, "scripts.site.build", *sorted(hidden)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=100)
    assert (done.returncode, done.stderr) == (0, "")
    staged = [str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*.md")]
    assert {"index.md", "reference/commands.md", "source/.github/RELEASE.md.md"} <= {*staged}
    texts = ((page, (tmp_path / page).read_text()) for page in staged)
    assert [line for page, text in texts for line in broken(tmp_path, page, text)] == []


def test_bench_lists_its_subjects(tree: Path) -> None:
    done = call(tree, "bench", "--help")
    assert done.returncode == 0 and done.stderr == ""
    assert set(re.findall(r"^  (\w+)  ", done.stdout, re.M)) == set(SUBJECTS)
    for words in ((), ("nothing",), ("--json",)):
        wrong = call(tree, "bench", *words)
        assert (wrong.returncode, wrong.stdout, wrong.stderr) == (2, "", done.stdout)
    assert not (tree / ".venv/bin/calls").exists()
