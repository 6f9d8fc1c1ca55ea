"""Changes one place of the code at random and asks the tests: `scripts/bench mutants`.

A mutant is a comparison, an operator or a number of one line changed, in Python or in C. Each is
put into a copy of the checkout, whose tests of that room and of the one that imports it most then
run, nearest first, until one fails. Where that test passes without the change, the mutant is
killed. One that no test notices is printed with its line and what it was changed to: a test is
missing there, or nothing observable has changed.
"""

from __future__ import annotations

import argparse
import ast
import itertools
import json
import os
import queue
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from tests.conftest import share_parts
from tests.mutants.covered import Covered, measure
from tests.rigs.places import ROOT

FOLDERS = ("vsense", "c_src", "robot", "firmware_bridge")
_LIBRARY = ("c_src", "c_src/host", "firmware_bridge")
LIMIT_S = 240.0
"""Tests that take longer have failed: they may have met an endless loop."""

SWAPS = {
    **{"==": "!=", "!=": "==", "<": "<=", "<=": "<", ">": ">=", ">=": ">"},
    **{"+": "-", "-": "+", "*": "/", "/": "*", "//": "*", "%": "*"},
    **{"and": "or", "or": "and", "&&": "||", "||": "&&", "&": "|", "|": "&", "<<": ">>"},
    **{">>": "<<", "is not": "is", "is": "is not", "not in": "in", "in": "not in"},
    **{"+=": "-=", "-=": "+=", "*=": "/=", "True": "False", "False": "True"},
}
_C_TOKEN = re.compile(
    r"""(?P<skip>//[^\n]*|/\*.*?\*/|"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])*'|^[ \t]*\#(?:\\\n|[^\n])*
    |->|\+\+|--|[&|^%]=|<<=|>>=)
    |(?P<operator>(?<=\ )(?:==|!=|<=|>=|&&|\|\||<<|>>|\+=|-=|\*=|[<>+\-*/%&|])(?=\ ))
    |(?P<number>(?<![\w.])(?:0[xX][0-9a-fA-F]+|[0-9]+(?:\.[0-9]*)?(?:[eE][+-]?[0-9]+)?)(?=[uUlLfF]*\b))""",
    re.X | re.S | re.M,
)


class Verdict(Enum):
    """What the tests say of a mutant; `UNJUDGED`: the test that failed does so without it."""

    KILLED, SURVIVED, UNJUDGED = "killed", "SURVIVED", "UNJUDGED"


@dataclass(frozen=True)
class Mutant:
    """One change: `text[start:end]` of the file becomes `new`."""

    path: str
    line: int
    start: int
    end: int
    old: str
    new: str

    def apply(self, text: str) -> str:
        """The file's text with the change."""
        return text[: self.start] + self.new + text[self.end :]

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.old} -> {self.new}"


def mutants(path: str, text: str) -> list[Mutant]:
    """All mutants of a file's text, in its order; `path` is relative to the checkout."""
    spans = _python_spans(text) if path.endswith(".py") else _c_spans(text)
    return [
        Mutant(path, text.count("\n", 0, start) + 1, start, end, text[start:end], new)
        for start, end, new in sorted(spans)
    ]


def _c_spans(text: str) -> Iterator[tuple[int, int, str]]:
    for match in _C_TOKEN.finditer(text):
        if match["operator"] in SWAPS:
            yield match.start(), match.end(), SWAPS[match[0]]
        elif match["number"]:
            yield match.start(), match.end(), _next_number(match[0])


def _next_number(number: str) -> str:
    """A literal one larger, of the same kind."""
    if number.lower().startswith("0x"):
        return hex(int(number, 16) + 1)
    return str(int(number) + 1) if number.isdigit() else f"({number} + 1)"


def _python_spans(text: str) -> Iterator[tuple[int, int, str]]:
    raw = text.encode()
    starts = [0]
    for line in raw.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))

    def offset(line: int, column: int) -> int:
        return len(raw[: starts[line - 1] + column].decode())

    def end(node: ast.expr | ast.stmt) -> int:
        return offset(node.end_lineno or 0, node.end_col_offset or 0)

    for node in _code(ast.parse(text)):
        if isinstance(node, ast.Constant):
            start = offset(node.lineno, node.col_offset)
            if isinstance(node.value, bool):
                yield start, end(node), str(not node.value)
            elif isinstance(node.value, int | float):
                yield start, end(node), f"({text[start : end(node)]} + 1)"
            continue
        for left, right in _around(node):
            # Between two operands there are the operator, blanks, parentheses and comments.
            begin, between = end(left), text[end(left) : offset(right.lineno, right.col_offset)]
            match = re.search(r"not\s+in|is\s+not|[a-z]+|[^\s\w()\\#]+", between)
            if match and (new := SWAPS.get(" ".join(match[0].split()))):
                yield begin + match.start(), begin + match.end(), new


def _around(node: ast.AST) -> Iterable[tuple[ast.expr, ast.expr]]:
    """The operands on both sides of each operator of an expression."""
    if isinstance(node, ast.Compare):
        operands = [node.left, *node.comparators]
    elif isinstance(node, ast.BoolOp):
        operands = node.values
    elif isinstance(node, ast.BinOp):
        operands = [node.left, node.right]
    elif isinstance(node, ast.AugAssign):
        operands = [node.target, node.value]
    else:
        return ()
    return itertools.pairwise(operands)


def _code(node: ast.AST) -> Iterator[ast.AST]:
    """All that is calculated: without annotations, imports, and f-strings, whose places lie."""
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list"):
            continue
        for child in value if isinstance(value, list) else [value]:
            left_out = ast.JoinedStr | ast.Import | ast.ImportFrom
            if isinstance(child, ast.AST) and not isinstance(child, left_out):
                yield child
                yield from _code(child)


def draw(paths: Sequence[str], count: int, seed: int) -> list[Mutant]:
    """`count` mutants of these files, each place as likely as any other; fewer where fewer are."""
    places = [m for path in paths for m in mutants(path, (ROOT / path).read_text("utf-8"))]
    return random.Random(seed).sample(places, min(count, len(places)))


def files(below: Sequence[str]) -> list[str]:
    """The files of code below these paths, relative to the checkout."""
    listed = _git("ls-files", "--", *below)
    return [p for p in listed if p.startswith(FOLDERS) and p.endswith((".py", ".c"))]


def _git(*words: str) -> list[str]:
    """The lines that git prints of the checkout."""
    done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


def stages_of(path: str) -> list[list[str]]:
    """The tests that should notice a change of this file: stages of pytest's words, nearest first.

    Those of the file itself, of its folder, of its room, and of the room that imports it most.
    """
    if not path.endswith(".py"):
        c_suites = ["tests/wire/test_c_suite.py", "tests/kernels/test_c_suite.py"]
        if path.startswith(("robot/", "firmware_bridge/")):
            return [["tests/robots/test_c_suite.py"], ["tests/robots"]]
        if path.startswith("c_src/host/"):
            return [["tests/kernels"], ["tests/world", "tests/vision", "tests/modes/sim"]]
        return [[*c_suites, "tests/robots/test_c_suite.py"], ["tests/wire"], ["tests/robots"]]
    folder, stem = Path(path).parent, Path(path).stem.strip("_")
    module = ".".join(Path(path).with_suffix("").parts)
    imported = re.compile(
        rf"\b{re.escape(module)}\b|from {re.escape(module.rpartition('.')[0])} import[^\n]*"
        rf"\b{re.escape(Path(path).stem)}\b"
    )
    own = Path("tests", *folder.parts[1:])
    by_text = [
        file.relative_to(ROOT).as_posix()
        for file in sorted((ROOT / "tests").rglob("test_*.py"))
        if (file.stem == f"test_{stem}" and own in file.relative_to(ROOT).parents)
        or imported.search(file.read_text("utf-8"))
    ]
    importers = Counter(
        Path("tests", *file.relative_to(ROOT).parts[1:-1]).as_posix()
        for file in (ROOT / "vsense").rglob("*.py")
        if imported.search(file.read_text("utf-8"))
    )
    room = Path(*own.parts[:2])
    above = [name for name, _ in importers.most_common() if room.parts != Path(name).parts[:2]]
    stages, done = [by_text] if by_text else [], by_text
    for name in dict.fromkeys([own.as_posix(), room.as_posix(), *above[:1]]):
        if name != "tests" and (ROOT / name).is_dir():
            stages.append([name, *(f"--ignore={tested}" for tested in done)])
            done = [*done, name]
    return stages


class Copy:
    """A copy of the checkout in which one mutant after the other is tried."""

    def __init__(self, root: Path, covered: Covered | None = None) -> None:
        self.root, self._covered = root, covered
        for name in _git("ls-files"):
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, root / name)
        (root / ".venv").symlink_to(ROOT / ".venv")
        self._cache, self._results = (Path(f"{root}-{name}") for name in ("cache", "results"))
        share_parts(self._cache)
        caches = dict.fromkeys(("XDG_CACHE_HOME", "VSENSE_TEST_BUILDS"), str(self._cache))
        self._environment = os.environ | caches | {"PYTHONPATH": str(root)}
        self._changes = 0
        self._build_as_it_is()

    def verdict(self, mutant: Mutant) -> Verdict:
        """Whether a test notices the change. What does not compile is noticed."""
        path = self.root / mutant.path
        text = path.read_text("utf-8")
        is_c = not mutant.path.endswith(".py")
        in_library = is_c and path.parent in [self.root / folder for folder in _LIBRARY]
        if self._is_changed and not in_library:
            self._build_as_it_is()
        # What builds robots' programs does not count as a source of them.
        is_built = is_c or path.is_relative_to(self.root / "vsense/robots")
        if is_built:
            self._forget_builds()
        try:
            self._write(path, mutant.apply(text))
            if in_library:
                self._is_changed = True
                if not self._build():
                    return Verdict.KILLED
            stages = self._stages(mutant, text)
            failed = next((s for s in stages if not self._passes(s)), None)
        finally:
            self._write(path, text)
            if is_built:
                self._forget_builds()
        if failed is None:
            return Verdict.SURVIVED
        if self._is_changed:
            self._build_as_it_is()
        # A busy machine or the time of day may have failed it, too.
        return Verdict.KILLED if self._passes(self._failed() or failed) else Verdict.UNJUDGED

    def _forget_builds(self) -> None:
        """Empties the caches of programs; what all programs share stays the user's."""
        shutil.rmtree(self._cache, ignore_errors=True)
        share_parts(self._cache)

    def _write(self, path: Path, text: str) -> None:
        """Writes a file at a time of its own: bytecode is known by its file's second and size."""
        path.write_text(text, "utf-8")
        self._changes += 1
        os.utime(path, (self._changes, self._changes))

    def _stages(self, mutant: Mutant, text: str) -> list[list[str]]:
        """The tests that run the line, where that was measured; else those of its rooms."""
        stages = None if self._covered is None else self._covered.stages_of(mutant, text)
        return stages_of(mutant.path) if stages is None else stages

    def _build_as_it_is(self) -> None:
        if not self._build():
            raise RuntimeError("the C library does not build without a change")
        self._is_changed = False

    def _build(self) -> bool:
        command = [sys.executable, "setup.py", "build_ext", "--inplace", "--force"]
        return self._run(command, LIMIT_S) == 0

    def _failed(self) -> list[str]:
        """Words for the test that failed last, or for the file that could not be read; none, where
        the tests did not come to an end."""
        with suppress(FileNotFoundError):
            failed = json.loads((self._results / "v/cache/lastfailed").read_text("utf-8"))
            names = [name for name in failed if name]  # the session itself has none
            return names if any("::" in name for name in names) else ["--collect-only", *names]
        return []

    def _passes(self, stage: Sequence[str]) -> bool:
        shutil.rmtree(self._results, ignore_errors=True)
        options = ["-x", "-q", "-o", f"cache_dir={self._results}", "--hypothesis-seed=0"]
        marks = ["-m", "not alone and not paced"]
        command = [sys.executable, "-m", "pytest", *options, *marks, *stage]
        return self._run(command, LIMIT_S) in (0, 5)  # 5: no test is there

    def _run(self, command: Sequence[str], limit_s: float) -> int | None:
        """The exit code; None after `limit_s`, and nothing that was started is left."""
        process = subprocess.Popen(
            command,
            cwd=self.root,
            env=self._environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            return process.wait(limit_s)
        except subprocess.TimeoutExpired:
            return None
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def main() -> int:
    """Draws, tries and prints; 1 where a mutant survived."""
    about = (__doc__ or "").partition("\n\n")[2]
    parser = argparse.ArgumentParser(prog="scripts/bench mutants", description=about)
    parser.add_argument("paths", nargs="*", metavar="PATH", help="files and folders (all code)")
    parser.add_argument("--changed", action="store_true", help="files that differ from main")
    parser.add_argument("--count", type=int, default=20, metavar="N", help="mutants (20)")
    parser.add_argument("--seed", type=int, default=1, metavar="S", help="of the drawing (1)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), metavar="N", help="at once")
    parser.add_argument(
        "--measure",
        action="store_true",
        help="first note which tests run which lines (an hour), and ask only those from then on",
    )
    options = parser.parse_args()
    if options.measure:
        measure(["tests"], options.jobs)
    below = options.paths or list(FOLDERS)
    if options.changed:
        below = _git("diff", "--name-only", "--diff-filter=d", "main", "--", *below)
    drawn = draw(files(below) if below else [], options.count, options.seed)
    if not drawn:
        parser.error(f"no code to change below {' '.join(options.paths) or 'these paths'}")
    verdicts = try_all(drawn, options.jobs)
    killed, unjudged = (verdicts.count(v) for v in (Verdict.KILLED, Verdict.UNJUDGED))
    judged = len(drawn) - unjudged
    rest = f"; {unjudged} unjudged: their test fails without a change, too" if unjudged else ""
    share = f"{killed / judged:.0%}" if judged else "none"
    print(f"{killed} of {judged} killed ({share}), seed {options.seed}{rest}")
    return int(killed < len(drawn))


def try_all(drawn: Sequence[Mutant], jobs: int) -> list[Verdict]:
    """Tries these mutants, `jobs` at once; prints and gives each one's verdict, in order."""
    covered = None
    with suppress(FileNotFoundError):
        covered = Covered()
    with tempfile.TemporaryDirectory(prefix="vsense-mutants-") as folder:
        copies: queue.SimpleQueue[Copy] = queue.SimpleQueue()
        for number in range(jobs):
            copies.put(Copy(Path(folder, str(number)), covered))

        def judge(mutant: Mutant) -> Verdict:
            copy = copies.get()
            try:
                verdict = copy.verdict(mutant)
            finally:
                copies.put(copy)
            print(f"{verdict.value:<8} {mutant}", flush=True)
            return verdict

        with ThreadPoolExecutor(jobs) as pool:
            return list(pool.map(judge, drawn))


if __name__ == "__main__":
    sys.exit(main())
