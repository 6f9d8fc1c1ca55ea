"""The C tests of what robot and host share, under the sanitizers, and what a compiled file may
need: almost nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.rigs.compiling import (
    C_SRC,
    PROTOCOL,
    SANITIZE,
    STRICT,
    TESTS,
    WIRE_SUITES,
    check_pure,
    compiled,
    declared_functions,
    run_test,
    symbols,
)
from tests.rigs.places import ROOT
from tests.robots.conftest import Builder
from tests.wire.c_vectors import write_vectors

EDGES = ("vs_posix", "vs_i2c_posix")
"""The files that talk to the operating system; all others are pure."""

PURE = sorted(p for p in C_SRC.glob("*.c") if p.stem not in EDGES)


@pytest.fixture(scope="module")
def build(tmp_path_factory: pytest.TempPathFactory) -> Builder:
    """Compiles once what both suites need."""
    return Builder(tmp_path_factory.mktemp("wire"))


@pytest.mark.parametrize("chars", ["-fsigned-char", "-funsigned-char"])
@pytest.mark.parametrize("name", WIRE_SUITES)
def test_c_suite_under_sanitizers(name: str, chars: str, build: Builder, tmp_path: Path) -> None:
    write_vectors(ROOT / "tests" / "golden" / "wire.json", tmp_path / "wire_vectors.h")
    flags = ["-std=c99", *STRICT, *SANITIZE, chars]
    objects = build.objects(WIRE_SUITES[name], flags)
    done = run_test(compiled(tmp_path / name, *flags, TESTS / f"{name}.c", *objects))
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("source", PURE, ids=lambda path: path.name)
def test_pure_file_needs_no_system_and_keeps_no_state(source: Path, tmp_path: Path) -> None:
    check_pure(source, "-std=c99", tmp_path)


def test_headers_promise_only_what_exists(tmp_path: Path) -> None:
    """Every function of a header is defined, and every global function is in a header."""
    headers = [p for p in C_SRC.glob("vs_*.h") if p.stem not in (*EDGES, "vs_io")]
    sources = [*PROTOCOL, C_SRC / "vs_i2c.c", C_SRC / "vs_format.c"]
    kinds = symbols(compiled(tmp_path / "vs.o", "-std=c99", "-O0", "-r", *sources))
    assert declared_functions(headers) == {name for name, kind in kinds.items() if kind == "T"}
