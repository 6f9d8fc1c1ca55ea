"""The C tests of what robot and host share, under the sanitizers, and what a compiled file may
need: almost nothing."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterable
from pathlib import Path

import pytest

from tests.conftest import require_tool
from tests.rigs.places import ROOT
from tests.wire.c_vectors import write_vectors

C_SRC = ROOT / "c_src"
TESTS = ROOT / "tests" / "c"
STRICT = ["-pedantic", "-Wall", "-Wextra", "-Wshadow", "-Wconversion", "-Werror"]
SANITIZE = [
    "-g",
    "-O1",
    "-fsanitize=address,undefined,float-cast-overflow",
    "-fno-sanitize-recover=all",
]
EDGES = ("vs_posix", "vs_i2c_posix")
"""The files that talk to the operating system; all others are pure."""

PURE = sorted(p for p in C_SRC.glob("*.c") if p.stem not in EDGES)
PARTS = ("err", "bytes", "tag", "wire", "table", "shown", "body", "peer", "clock", "offer")
PARTS += ("greeting", "session")
SESSION = [C_SRC / f"vs_{part}.c" for part in PARTS]
SYMBOLS = {"memcpy", "memmove", "memset", "memcmp", "strlen", "strcmp", "strncmp"}
"""What a pure C file may take from the C library: it costs nothing on any machine."""

STACK_MAX = 8192
"""[byte] of stack that one function may use."""


def build(target: Path, *arguments: str | Path) -> Path:
    """Compiles and links with warnings as errors."""
    command = [require_tool("cc", "build-essential"), *map(str, arguments)]
    command += ["-I", str(C_SRC), "-I", str(TESTS), "-I", str(target.parent), "-o", str(target)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return target


def run(program: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([str(program)], capture_output=True, text=True, check=False, timeout=120)


@pytest.mark.parametrize("chars", ["-fsigned-char", "-funsigned-char"])
@pytest.mark.parametrize("name", ["test_wire", "test_session"])
def test_c_suite_under_sanitizers(name: str, chars: str, tmp_path: Path) -> None:
    write_vectors(ROOT / "tests" / "golden" / "wire.json", tmp_path / "wire_vectors.h")
    flags = ["-std=c99", *STRICT, *SANITIZE, chars]
    done = run(build(tmp_path / name, *flags, TESTS / f"{name}.c", *SESSION))
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("source", PURE, ids=lambda path: path.name)
def test_pure_file_needs_no_system_and_keeps_no_state(source: Path, tmp_path: Path) -> None:
    check_pure(source, "-std=c99", tmp_path)


def check_pure(source: Path, standard: str, folder: Path) -> None:
    """Asserts that a file needs no system, keeps no state and uses little stack."""
    plain = ["-O2", "-fno-pic", "-fno-pie", "-fno-stack-protector", "-fstack-usage", "-c"]
    built = build(folder / f"{source.stem}.o", standard, *STRICT, *plain, source)
    kinds = symbols(built)
    needed = {name for name, kind in kinds.items() if kind == "U"}
    assert {n for n in needed if not n.startswith(("vs_", "epuck_"))} <= SYMBOLS
    assert {name for name, kind in kinds.items() if kind in "dDbBC"} == set()
    report = built.with_suffix(".su").read_text().splitlines()
    used = {row.split("\t")[0]: row.split("\t")[1:] for row in report}
    assert {name for name, (size, _) in used.items() if int(size) > STACK_MAX} == set()
    assert {name for name, (_, kind) in used.items() if kind == "dynamic"} == set()


def symbols(path: Path) -> dict[str, str]:
    """Name and kind of every symbol, as `nm` says them."""
    nm = [require_tool("nm", "binutils"), str(path)]
    lines = subprocess.run(nm, capture_output=True, text=True, check=True).stdout.splitlines()
    return {line.split()[-1]: line.split()[-2] for line in lines}


def declared_functions(headers: Iterable[Path]) -> set[str]:
    """Names of the functions whose prototypes are in these headers."""
    found: set[str] = set()
    for header in headers:
        text = re.sub(r"/\*.*?\*/", "", header.read_text(), flags=re.DOTALL)
        text = re.sub(r"^static inline .*?^}", "", text, flags=re.DOTALL | re.MULTILINE)
        found |= set(re.findall(r"\b(vs_\w+)\([^;{]*\);", text))
    return found


def test_headers_promise_only_what_exists(tmp_path: Path) -> None:
    """Every function of a header is defined, and every global function is in a header."""
    headers = [p for p in C_SRC.glob("vs_*.h") if p.stem not in (*EDGES, "vs_io")]
    sources = [*SESSION, C_SRC / "vs_i2c.c", C_SRC / "vs_format.c"]
    kinds = symbols(build(tmp_path / "vs.o", "-std=c99", "-O2", "-r", *sources))
    assert declared_functions(headers) == {name for name, kind in kinds.items() if kind == "T"}
