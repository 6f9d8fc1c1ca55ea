"""Which tests run a line, measured once: `scripts/bench mutants --measure`.

As pytest's plugin this module has coverage.py note the lines of `vsense/` that each test runs, also
in the processes that it starts, and how long it takes; as a library it reads what was noted.
"""

from __future__ import annotations

import ast
import hashlib
import itertools
import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import coverage
import pytest

from tests.rigs.places import ROOT

if TYPE_CHECKING:
    from tests.mutants.mutants import Mutant

FOLDER = ROOT / "build" / "covered"
"""What was measured of this checkout."""
PART_S, ALL_S = 30.0, 240.0
"""Tests run together, and in all, for a mutant: by the times that were measured."""
_TIMES = "times-"
_OPTIONS = """\
[run]
source_dirs = {root}/vsense
parallel = True
data_file = {folder}/lines
context = ${{PYTEST_CURRENT_TEST-}}
disable_warnings = no-data-collected,module-not-imported,module-not-measured
"""
"""Processes that a test has started have its name from pytest, by their environment."""


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Notes what a test runs under its name, and its time."""
    measured = coverage.Coverage.current()
    assert measured is not None, "started without the environment of `measure`"
    measured.switch_context(item.nodeid)
    start_s = time.monotonic()
    try:
        return (yield)
    finally:
        row = json.dumps([item.nodeid, time.monotonic() - start_s])
        with (FOLDER / f"{_TIMES}{os.getpid()}").open("a", encoding="utf-8") as file:
            file.write(f"{row}\n")


def measure(tests: Sequence[str], jobs: int) -> int:
    """Runs these tests; pytest's exit code. A test that fails has run its lines, too."""
    shutil.rmtree(FOLDER, ignore_errors=True)
    FOLDER.mkdir(parents=True)
    options, starts = FOLDER / "options", FOLDER / "sitecustomize.py"
    options.write_text(_OPTIONS.format(root=ROOT, folder=FOLDER), "utf-8")
    starts.write_text("import coverage; coverage.process_startup()\n", "utf-8")
    digests = {
        file.relative_to(ROOT).as_posix(): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in _code()
    }
    own = {"COVERAGE_PROCESS_START": str(options), "PYTHONPATH": f"{ROOT}:{FOLDER}"}
    outer = {name: value for name, value in os.environ.items() if name != "PYTEST_CURRENT_TEST"}
    words = ["-p", "tests.mutants.covered", "-n", str(jobs), "-m", "not alone and not paced"]
    command = [sys.executable, "-m", "pytest", "-q", *words, *tests]
    code = subprocess.run(command, cwd=ROOT, env=outer | own).returncode
    combine = [sys.executable, "-m", "coverage", "combine", "--quiet", f"--rcfile={options}"]
    subprocess.run(combine, cwd=FOLDER, check=True)
    # The last, so that what was cut short counts as not measured.
    (FOLDER / "digests").write_text(json.dumps(digests), "utf-8")
    return code


def _code() -> Iterator[Path]:
    yield from sorted((ROOT / "vsense").rglob("*.py"))


class Covered:
    """What was measured: FileNotFoundError where nothing was."""

    def __init__(self) -> None:
        self._digests = json.loads((FOLDER / "digests").read_text("utf-8"))
        self._lines = coverage.CoverageData(str(FOLDER / "lines"))
        self._lines.read()
        rows = [row for file in FOLDER.glob(f"{_TIMES}*") for row in file.open(encoding="utf-8")]
        self._times_s: dict[str, float] = dict(map(json.loads, rows))
        self._files: dict[str, dict[int, list[str]]] = {}

    def tests_of(self, mutant: Mutant, text: str) -> list[str] | None:
        """The tests that run a mutant's line, the quickest first; `text` is its file's.

        Of a line that runs when its module is imported: those that run a function of the file, or
        a line with the name that it gives a value. None: the file has changed since.
        """
        if self._digests.get(mutant.path) != hashlib.sha256(text.encode()).hexdigest():
            return None
        function, name = _place(ast.parse(text), mutant.line)
        if function is None:
            contexts = self._of(mutant.path, None) | self._of_name(name)
        else:
            contexts = self._of(mutant.path, function)
        tests = {re.sub(r" \((?:setup|call|teardown)\)$", "", context) for context in contexts}
        return sorted(tests & self._times_s.keys(), key=lambda test: (self._times_s[test], test))

    def stages_of(self, mutant: Mutant, text: str) -> list[list[str]] | None:
        """Those of them that take `ALL_S` together, in parts one after the other: the tests of the
        mutant's folder, then the others, each the quickest first; None: the file has changed.
        """
        tests = self.tests_of(mutant, text)
        if tests is None:
            return None
        nearest = f"{Path('tests', *Path(mutant.path).parts[1:-1]).as_posix()}/"
        chosen = [test for end_s, test in self._timed(tests) if end_s < ALL_S]
        chosen.sort(key=lambda test: not test.startswith(nearest))
        parts = itertools.groupby(self._timed(chosen), lambda timed: timed[0] // PART_S)
        return [[test for _, test in part] for _, part in parts]

    def _timed(self, tests: Sequence[str]) -> list[tuple[float, str]]:
        """When each of these tests ends, one after the other [s]."""
        return [*zip(itertools.accumulate(self._times_s[test] for test in tests), tests)]

    def _of(self, path: str, lines: range | None) -> set[str]:
        if path not in self._files:
            self._files[path] = self._lines.contexts_by_lineno(str(ROOT / path))
        found = self._files[path]
        inside = found if lines is None else [line for line in lines if line in found]
        return {context for line in inside for context in found[line]}

    def _of_name(self, name: str) -> set[str]:
        contexts: set[str] = set()
        if not name:
            return contexts
        known = re.compile(rf"\b{re.escape(name)}\b")
        for file in _code():
            for number, line in enumerate(file.read_text("utf-8").splitlines(), 1):
                if known.search(line):
                    relative = file.relative_to(ROOT).as_posix()
                    contexts |= self._of(relative, range(number, number + 1))
        return contexts


def _place(tree: ast.Module, line: int) -> tuple[range | None, str]:
    """The lines of the statement that a line belongs to, where it is inside of a function; else
    None, and the name that its statement gives a value, "" for none."""
    functions = [n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef)]
    bodies = [n for n in functions if n.body[0].lineno <= line <= (n.end_lineno or 0)]
    statements: list[Any] = [n for n in ast.walk(tree) if isinstance(n, ast.stmt)]
    around = [n for n in statements if n.lineno <= line <= (n.end_lineno or 0)]
    inner = max(around, key=lambda n: n.lineno)
    if bodies:
        # A statement that holds others ends, for this, where the first of those begins.
        block = getattr(inner, "body", None) or [n.body[0] for n in getattr(inner, "cases", ())]
        last = inner.end_lineno if not block else max(block[0].lineno - 1, inner.lineno)
        return range(inner.lineno, last + 1), ""
    targets = getattr(inner, "targets", None) or [getattr(inner, "target", None)]
    return None, targets[0].id if isinstance(targets[0], ast.Name) else ""
