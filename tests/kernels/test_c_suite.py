"""The C tests of the kernels under the sanitizers, and what a compiled kernel may need."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.rigs.compiling import (
    HOST,
    KERNEL_SUITES,
    PICTURES,
    SANITIZE,
    STRICT,
    TESTS,
    check_pure,
    compiled,
    declared_functions,
    run_test,
    symbols,
)
from tests.robots.conftest import Builder

SOURCES = sorted(HOST.glob("*.c"))


@pytest.fixture(scope="module")
def build(tmp_path_factory: pytest.TempPathFactory) -> Builder:
    """Compiles once what several suites need."""
    return Builder(tmp_path_factory.mktemp("kernels"))


@pytest.mark.parametrize("name", KERNEL_SUITES)
def test_c_suite_under_sanitizers(name: str, build: Builder, tmp_path: Path) -> None:
    flags = ["-std=c99", *STRICT, *SANITIZE, "-I", str(HOST)]
    objects = build.objects(KERNEL_SUITES[name], flags)
    done = run_test(compiled(tmp_path / name, *flags, TESTS / f"{name}.c", *objects, "-lm"))
    assert done.returncode == 0, done.stderr


RACE = ["-std=c11", *STRICT, "-g", "-O1", "-fsanitize=thread", "-pthread", "-I", str(HOST)]


def build_race(target: Path, source: Path, *more: str | Path, test: str = "test_latest") -> Path:
    return compiled(target, *RACE, TESTS / f"{test}.c", source, *more)


def test_defect_05_no_torn_data_between_two_threads(tmp_path: Path) -> None:
    done = run_test(build_race(tmp_path / "test_latest", HOST / "vs_latest.c"))
    assert done.returncode == 0, done.stderr


THREADS = ("-DVS_TEST_THREADS", "-lm")


def test_threads_that_search_the_same_picture_do_not_race(build: Builder, tmp_path: Path) -> None:
    objects = build.objects(PICTURES, RACE)
    done = run_test(build_race(tmp_path / "test_threads", *objects, *THREADS, test="test_words"))
    assert done.returncode == 0, done.stderr


def test_a_kernel_with_a_state_of_its_own_would_be_found_out(
    build: Builder, tmp_path: Path
) -> None:
    broken = tmp_path / "vs_sums.c"
    text = (HOST / "vs_sums.c").read_text()
    mine = "float weight[VS_WORDS_CELLS * VS_WORDS_CELLS];"
    assert mine in text
    broken.write_text(text.replace(mine, f"static {mine}"))
    others = build.objects([p for p in PICTURES if p.name != broken.name], RACE)
    done = run_test(
        build_race(tmp_path / "test_broken", broken, *others, *THREADS, test="test_words")
    )
    assert "data race" in done.stderr


def test_a_buffer_without_ordering_would_be_found_out(tmp_path: Path) -> None:
    broken = tmp_path / "vs_latest.c"
    text = (HOST / "vs_latest.c").read_text()
    assert "memory_order_acq_rel" in text
    broken.write_text(text.replace("memory_order_acq_rel", "memory_order_relaxed"))
    done = run_test(build_race(tmp_path / "test_broken", broken))
    assert "data race" in done.stderr


KERNELS = [path for path in SOURCES if path.stem not in ("vs_crash", "vs_libm")]
"""A handler of signals needs the system, and is given no argument: it keeps where it writes. And
one file takes from the C library what NumPy takes from it."""


@pytest.mark.parametrize("source", KERNELS, ids=lambda path: path.name)
def test_kernel_needs_no_system_and_keeps_no_state(source: Path, tmp_path: Path) -> None:
    check_pure(source, "-std=c11" if source.name == "vs_latest.c" else "-std=c99", tmp_path)


def test_headers_promise_only_what_exists(tmp_path: Path) -> None:
    """Every function of a header is defined, and every global function is in a header."""
    kinds = symbols(compiled(tmp_path / "vs.o", "-std=c11", "-O0", "-r", *SOURCES))
    defined = {name for name, kind in kinds.items() if kind == "T"}
    assert declared_functions(HOST.glob("*.h")) == defined
