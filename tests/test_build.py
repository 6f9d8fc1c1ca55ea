"""Builds of the daemon: cached by what went in, and clear when they cannot be had."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from vsense import build
from vsense.errors import UsageError


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache"


def own_controller(folder: Path) -> Path:
    copy = folder / "mine.c"
    shutil.copy2(build.source_tree().controller("pollutant"), copy)
    return copy


def test_build_is_found_again_and_an_edit_makes_a_new_one(tmp_path: Path) -> None:
    source = own_controller(tmp_path)
    first = build.daemon("mine.c", tmp_path)
    stamp = first.stat().st_mtime_ns
    assert build.daemon("mine.c", tmp_path) == first
    assert first.stat().st_mtime_ns == stamp
    source.write_text(source.read_text() + "\n/* edited */\n")
    second = build.daemon("mine.c", tmp_path)
    assert second != first
    assert first.is_file() and second.is_file()


def test_controller_that_does_not_compile_shows_the_compilers_words(tmp_path: Path) -> None:
    own_controller(tmp_path).write_text("int broken = ;\n")
    with pytest.raises(build.BuildError, match=r"mine\.c:1:"):
        build.daemon("mine.c", tmp_path)
    assert not list(tmp_path.rglob("vsensed*")), "nothing half-made is left behind"


def test_unknown_controller_lists_the_known_ones() -> None:
    with pytest.raises(UsageError, match=r"no controller 'nobody'.*pollutant"):
        build.daemon("nobody")


def test_missing_compiler_names_the_line_that_installs_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own_controller(tmp_path)
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(build.BuildError, match="apt install build-essential"):
        build.daemon("mine.c", tmp_path)


def test_unwritable_cache_is_one_clear_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own_controller(tmp_path)
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    with pytest.raises(build.BuildError, match=r"cannot build in .*: Not a directory"):
        build.daemon("mine.c", tmp_path)
