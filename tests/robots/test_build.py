"""Builds of the daemon: cached by what went in, and clear when they cannot be had."""

from __future__ import annotations

import os
import platform
import pwd
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import require_tool
from tests.rigs.compiling import counting_compiler
from vsense.base.errors import UsageError
from vsense.robots import build
from vsense.robots.compiling import Toolchain


@pytest.fixture(autouse=True)
def cache(own_cache: Path) -> Path:
    return own_cache


@pytest.fixture
def instant(monkeypatch: pytest.MonkeyPatch) -> None:
    """Builds are empty files: enough for who asks where they land."""

    def compile_daemon(tree: build.SourceTree, controller: Path, target: Path) -> None:
        target.parent.mkdir(parents=True, exist_ok=True)
        target.touch()

    monkeypatch.setattr(build, "compile_daemon", compile_daemon)


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


def test_shared_object_is_built_once_and_shows_only_its_own_door(tmp_path: Path) -> None:
    source = own_controller(tmp_path)
    # A name that libc has, too: the controller's own must stay its own.
    source.write_text(source.read_text() + "\nint puts(const char *s) { return s != 0; }\n")
    first = build.shared("mine.c", tmp_path)
    stamp = first.stat().st_mtime_ns
    assert build.shared("mine.c", tmp_path) == first
    assert first.stat().st_mtime_ns == stamp
    command = [require_tool("nm", "binutils"), "-D", "--defined-only", str(first)]
    listed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    names = {line.split()[-1] for line in listed.splitlines()}
    assert names and all(name.startswith(("vs_inprocess_", "vs_hosted_")) for name in names)
    source.write_text(source.read_text() + "\n/* edited */\n")
    assert build.shared("mine.c", tmp_path) != first


def test_shared_object_without_an_entry_leaves_nothing(tmp_path: Path) -> None:
    own_controller(tmp_path).write_text("extern int nothing;\n")
    with pytest.raises(build.BuildError, match=r"mine\.c defines no vs_controller: expected"):
        build.shared("mine.c", tmp_path)
    assert not list(tmp_path.rglob("inprocess*"))


@pytest.mark.usefixtures("instant")
@pytest.mark.parametrize("name", ["mine.h", "my own #1 $ header's.h"])
def test_an_edited_header_of_the_users_own_makes_a_new_build(tmp_path: Path, name: str) -> None:
    source = own_controller(tmp_path)
    header = tmp_path / name
    header.write_text("#define MINE 1\n")
    source.write_text(f'#include "{name}"\n{source.read_text()}')
    first = build.daemon("mine.c", tmp_path)
    assert build.daemon("mine.c", tmp_path) == first
    header.write_text("#define MINE 2\n")
    second = build.daemon("mine.c", tmp_path)
    assert second != first
    header.write_text("#define MINE 1\n")
    assert build.daemon("mine.c", tmp_path) == first


def aged(folder: Path) -> None:
    """What is in a folder was changed long ago."""
    for path in (*folder.iterdir(), folder):
        os.utime(path, ns=(10**18, 10**18 + len(list(folder.iterdir()))))


@pytest.mark.usefixtures("instant")
def test_a_build_that_is_there_is_found_without_a_compiler_until_a_file_or_folder_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked, run = list[str](), Toolchain.run

    def counted(self: Toolchain, arguments: Sequence[str]) -> Any:
        asked.append(arguments[-1])
        return run(self, arguments)

    def daemon() -> tuple[Path, list[str]]:
        asked.clear()
        return build.daemon("mine.c", own), [word.rpartition("/")[2] for word in asked]

    monkeypatch.setattr(Toolchain, "run", counted)
    own = tmp_path / "own"
    own.mkdir()
    source = own_controller(own)
    daemon()
    assert daemon()[1] == ["mine.c"], "it was changed a moment ago"
    aged(own)
    first, _ = daemon()
    assert daemon() == (first, [])
    ours = build.source_tree().root / "robot" / "controller.h"
    (own / "controller.h").write_text(f"{ours.read_text()}/* mine */\n")
    aged(own)
    second, words = daemon()
    assert second != first and words == ["mine.c"], "its own header goes before ours"
    assert daemon() == (second, [])
    (own / "controller.h").unlink()
    assert daemon() == (first, ["mine.c"])
    source.write_text(f"/* edited */\n{source.read_text()}")
    assert daemon()[0] not in (first, second)


@pytest.mark.usefixtures("instant")
def test_other_flags_in_cc_make_a_new_build(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, instant: None
) -> None:
    own_controller(tmp_path)
    first = build.daemon("mine.c", tmp_path)
    monkeypatch.setenv("CC", "cc -DMINE")
    assert build.daemon("mine.c", tmp_path) != first


def test_processes_that_need_the_same_build_make_it_once(
    tmp_path: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (cache / "vsense" / "parts").unlink()  # nobody else has this compiler
    compiler, notes = counting_compiler(tmp_path)
    monkeypatch.setenv("CC", str(compiler))
    words = "import sys\nfrom vsense.robots import build\nsys.stdin.read()\nbuild.shared('prey')"
    several = [
        subprocess.Popen([sys.executable, "-c", words], stdin=subprocess.PIPE) for _ in range(3)
    ]
    for process in several:  # all begin together
        assert process.stdin is not None
        process.stdin.close()
    assert [process.wait() for process in several] == [0, 0, 0]
    assert notes.read_text() == "\n"


def test_another_kind_of_machine_has_builds_of_its_own(
    instant: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Machines of several kinds may share a home."""
    first = build.daemon("prey")
    monkeypatch.setattr(platform, "machine", lambda: "riscv64")
    assert build.daemon("prey") != first


def test_controller_that_does_not_compile_shows_the_compilers_words(tmp_path: Path) -> None:
    own_controller(tmp_path).write_text("int broken = ;\n")
    with pytest.raises(
        build.BuildError, match=r"the controller .*mine\.c does not (.|\n)*mine\.c:1:"
    ):
        build.daemon("mine.c", tmp_path)
    assert not list(tmp_path.rglob("vsensed*")), "nothing half-made is left behind"


def test_controller_whose_header_is_missing_is_named(tmp_path: Path) -> None:
    own_controller(tmp_path).write_text('#include "nowhere.h"\n')
    with pytest.raises(
        build.BuildError, match=r"the controller .*mine\.c does not (.|\n)*nowhere\.h"
    ):
        build.daemon("mine.c", tmp_path)


def test_controller_without_its_variable_is_named(tmp_path: Path) -> None:
    own_controller(tmp_path).write_text("extern int nothing;\n")
    with pytest.raises(build.BuildError, match=r"mine\.c defines no vs_controller: expected"):
        build.daemon("mine.c", tmp_path)


def test_broken_source_of_our_own_is_not_blamed_on_the_controller(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for folder in ("c_src", "robot"):
        shutil.copytree(build.source_tree().root / folder, tmp_path / "tree" / folder)
    tree = build.SourceTree(tmp_path / "tree")
    (tree.root / "robot" / "loop.c").write_text("int broken = ;\n")
    monkeypatch.setattr(build, "source_tree", lambda: tree)
    with pytest.raises(build.BuildError) as caught:
        build.daemon()
    first, _, words = str(caught.value).partition("\n")
    assert first == f"a source of vsensed itself does not build: {tree.root}/robot/loop.c:"
    assert "loop.c:1:" in words


def test_ready_made_daemon_needs_no_compiler(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(build.source_tree().root / "robot", tmp_path / "tree" / "robot")
    tree = build.SourceTree(tmp_path / "tree")
    tree.prebuilt.parent.mkdir()
    tree.prebuilt.touch()
    monkeypatch.setattr(build, "source_tree", lambda: tree)
    monkeypatch.setenv("CC", "no-such-compiler")
    assert build.daemon() == tree.prebuilt


def test_ctrl_c_reaches_no_compiler(tmp_path: Path, cache: Path) -> None:
    """Ctrl-C goes to the terminal's process group; who builds decides what it means."""
    own_controller(tmp_path)
    (cache / "vsense" / "parts").unlink()  # nobody else has this compiler
    compiler = tmp_path / "slow-cc"
    started, go = tmp_path / "started", tmp_path / "go"
    os.mkfifo(started)
    os.mkfifo(go)
    compiler.write_text(
        f'#!/bin/sh\ncase "$*" in *" -shared "*) echo >"{started}"; read word <"{go}";; esac\n'
        'exec cc "$@"\n'
    )
    compiler.chmod(0o755)
    script = (
        "import signal\n"
        "from vsense.robots import build\n"
        "told = []\n"
        "signal.signal(signal.SIGINT, lambda *_: told.append(1))\n"
        f"build.shared('mine.c', build.Path({str(tmp_path)!r}))\n"
        "print(told)\n"
    )
    builder = subprocess.Popen(
        [sys.executable, "-c", script],
        env={**os.environ, "CC": str(compiler)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    with open(started) as news:
        assert news.readline() == "\n"
    os.killpg(builder.pid, signal.SIGINT)
    # Read and write: to open it waits for nobody, should the compiler be gone.
    with open(os.open(go, os.O_RDWR), "w") as word:
        print(file=word, flush=True)
        said, errors = builder.communicate(timeout=60)
    assert (builder.returncode, said) == (0, "[1]\n"), errors
    assert len(list(cache.rglob("inprocess.so"))) == 1


def test_user_without_a_home_is_told_what_to_set(monkeypatch: pytest.MonkeyPatch) -> None:
    def nobody(uid: int) -> None:
        raise KeyError(uid)

    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.delenv("HOME")
    monkeypatch.setattr(pwd, "getpwuid", nobody)
    with pytest.raises(build.BuildError, match="XDG_CACHE_HOME"):
        build.cache_directory()


def test_unknown_controller_lists_the_known_ones() -> None:
    with pytest.raises(UsageError, match=r"controller 'nobody'.*pollutant"):
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
    with pytest.raises(build.BuildError, match="Not a directory"):
        build.daemon("mine.c", tmp_path)
