"""`vsense robot build`: one static file per board, small enough, and clear where it cannot be."""

from __future__ import annotations

import importlib.util
import json
import os
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from tests.bench import robot as robot_bench
from tests.conftest import require_tool, require_zig
from tests.robots.conftest import ROOT
from vsense import cli
from vsense.base.errors import UsageError
from vsense.robots import boards
from vsense.robots.build import SourceTree, source_tree
from vsense.robots.compiling import BuildError, Toolchain, native
from vsense.robots.sources import HASH_DIGITS, ProgramSources, folders_digest

POLLUTANT = ROOT / "robot" / "controllers" / "pollutant.c"


@pytest.fixture
def without_zig(monkeypatch: pytest.MonkeyPatch) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name == "ziglang" else find(name)
    )


def program(folder: Path, name: str, script: str) -> None:
    """Makes a shell script that can be called."""
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(f"#!/bin/sh\n{script}\n")
    (folder / name).chmod(0o755)


ARITHMETIC = 8_000
"""[byte] More of software floating point than the controller that the limit is meant for has."""


def test_arm_daemon_is_static_and_small(arm_daemon: Path) -> None:
    data = arm_daemon.read_bytes()
    assert data[:4] == b"\x7fELF" and data[4] == 1, "32 bits"
    assert int.from_bytes(data[18:20], "little") == 40, "ARM"
    assert b"/lib/ld-" not in data, "static"
    assert len(data) <= robot_bench.SIZE_MAX
    assert b"clock-permille" not in data, "a robot has no slow clock"
    print(f"vsensed for ARMv5: {len(data)} bytes")


def test_arm_daemon_is_small_with_the_largest_shipped_controller(tmp_path: Path) -> None:
    require_zig()
    controllers = source_tree().controllers()
    largest = max(controllers, key=lambda name: controllers[name].stat().st_size)
    built = boards.build(largest, "epuck", tmp_path / "vsensed")
    print(f"vsensed for ARMv5 with {largest}: {built.size} bytes")
    assert built.size <= robot_bench.SIZE_MAX + ARITHMETIC


def test_arm_daemon_runs_on_the_oldest_board_and_says_what_it_is(arm_daemon: Path) -> None:
    qemu = require_tool("qemu-arm", "qemu-user")
    command = [qemu, "-cpu", "arm926", str(arm_daemon), "--version"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    digest = source_tree().daemon(ProgramSources((POLLUTANT,))).controller_hash(boards.native())
    own = folders_digest(source_tree().includes())
    assert done.stdout == f"vsensed 0.1.0+{own}, controller pollutant {digest}\n", done.stderr


def test_host_build_through_the_command(
    tmp_path: Path, without_zig: None, capsys: pytest.CaptureFixture[str]
) -> None:
    require_tool("cc", "build-essential")
    made = tmp_path / "here" / "vsensed"
    words = ["robot", "build", "--controller", str(POLLUTANT), "--target", "host", "-o", str(made)]
    assert cli.main([*words, "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["size"] == made.stat().st_size and facts["controller"] == str(POLLUTANT)
    done = subprocess.run([made, "--version"], capture_output=True, text=True, timeout=30)
    assert done.stdout.endswith(f"controller pollutant {facts['hash']}\n")
    assert len(facts["hash"]) == HASH_DIGITS


def test_sources_and_headers_of_argos_are_named(
    natively: None,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    require_tool("c++", "build-essential")
    monkeypatch.chdir(tmp_path)
    walk = ROOT / "tests" / "system" / "walk.cpp"
    (tmp_path / "pace.h").write_text("#define WALK_CM_S 4.0\n")
    text = (ROOT / "vsense/config/experiments/foraging.argos").read_text()
    text = text.replace("foraging_controller", "walk_controller")
    text = text.replace('library="foraging"', 'library="walk"')
    (tmp_path / "walk.argos").write_text(text)
    shutil.copy(ROOT / "vsense/config/experiments/foraging.py", tmp_path)
    words = ["--sources", f"walk={walk}", "--include", ".", "--target", "host", "--json"]
    one = ["--controller", "walk", "--label", "walk_controller"]
    for named in (one, ["--experiment", "walk.argos"]):
        assert cli.main(["robot", "build", *named, *words]) == 0
        facts = json.loads(capsys.readouterr().out)
        assert Path((facts if named is one else facts[0])["controller"]) == walk


def test_hash_is_of_the_controller_and_its_own_headers(tmp_path: Path) -> None:
    require_tool("cc", "build-essential")
    compiler = boards.native()

    def digest(folder: str, header: str) -> str:
        place = tmp_path / folder
        place.mkdir()
        shutil.copy2(POLLUTANT, place / "mine.c")
        with open(place / "mine.c", "a") as source:
            source.write('#include "mine.h"\n')
        (place / "mine.h").write_text(header)
        return source_tree().daemon(ProgramSources((place / "mine.c",))).controller_hash(compiler)

    assert digest("a", "#define X 1\n") == digest("b", "#define X 1\n")
    assert digest("c", "#define X 2\n") != digest("d", "#define X 3\n")


def test_a_daemon_tells_which_sources_it_was_made_of(tmp_path: Path) -> None:
    """Whatever file of robot/ differs, and not the controller's."""
    require_tool("cc", "build-essential")

    def said(name: str, more: str) -> list[str]:
        root = tmp_path / name
        for folder in source_tree().includes():
            shutil.copytree(folder, root / folder.name)
        with open(root / "robot" / "talk.c", "a") as source:
            source.write(more)
        tree, compiler = SourceTree(root), native()
        quick = replace(compiler, flags=(*compiler.flags, "-O0"))
        tree.daemon(tree.program("pollutant"), plain=True).link_daemon(quick, root / "vsensed")
        asked = [str(root / "vsensed"), "--version"]
        return subprocess.run(asked, capture_output=True, text=True, timeout=60).stdout.split()

    same, other = said("a", ""), said("b", "/* mended */\n")
    assert same[1] == f"0.1.0+{folders_digest(source_tree().includes())},", "in any folder"
    assert re.fullmatch(r"0\.1\.0\+[0-9a-f]{12},", other[1])
    assert other[1] != same[1] and other[2:] == same[2:]


@pytest.mark.parametrize("name", ["epuck", "pi-puck", "aarch64"])
def test_no_cross_compiler_names_both_that_there_are(
    name: str, without_zig: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(UsageError, match=r"pip install ziglang==[0-9.]+ .*apt install gcc-") as no:
        boards.toolchain(boards.TARGETS[name], tmp_path)
    assert "\n" not in str(no.value)


def test_debians_compiler_is_taken_where_zig_is_not(
    without_zig: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program(tmp_path / "bin", "arm-linux-gnueabi-gcc", "exit 0")
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    found = boards.toolchain(boards.TARGETS["epuck"], tmp_path)
    assert found.command == ("arm-linux-gnueabi-gcc",)
    assert {"-static", "-march=armv5te"} <= set(found.flags)


def test_zig_is_asked_for_every_board_and_keeps_its_cache_with_ours(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: object())
    for target in boards.TARGETS.values():
        found = boards.toolchain(target, tmp_path)
        assert found.command[-2:] == ("ziglang", "cc") and "-target" in found.flags
        assert found.environment["ZIG_GLOBAL_CACHE_DIR"] == str(tmp_path / "zig")


def test_a_newer_zig_that_cannot_link_is_told_from_a_fault_of_the_users(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = (
        'case "$*" in *-MM*) echo "it: x.c";; *--version*) echo "zig 0.17.0";;'
        ' *) echo "ld.lld: error: undefined symbol: __sync_lock_test_and_set_1" >&2; exit 1;; esac'
    )
    program(tmp_path, "zig", script)
    fake = Toolchain((str(tmp_path / "zig"),))
    monkeypatch.setattr(boards, "toolchain", lambda target, cache: fake)
    (tmp_path / "x.c").write_text("int x;\n")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(BuildError, match=r"zig 0\.17\.0 cannot link for ARMv5: .*==0\.15\.2"):
        boards.build("x.c", "epuck", tmp_path / "vsensed")
    assert not (tmp_path / "vsensed").exists()


def test_one_file_alone_is_compiled_with_the_controllers_hash(tmp_path: Path) -> None:
    """A compiler that keeps what it has compiled, as zig does, needs no other one again."""
    notes = tmp_path / "notes"
    script = f"""echo "$*" >>{notes}
case "$*" in *-MM*) echo "it: {POLLUTANT}"; exit;; esac
while [ "$1" != -o ]; do shift; done
: >"$2\""""
    program(tmp_path, "cc", script)
    fake = Toolchain((str(tmp_path / "cc"),), small=("-Os",))
    sources = source_tree().daemon(ProgramSources((POLLUTANT,)), plain=True)
    digest = sources.link_daemon(fake, tmp_path / "vsensed")
    lines = notes.read_text().splitlines()
    hashed = [line for line in lines if f'-DVSENSED_CONTROLLER_HASH="{digest}"' in line]
    assert len(lines) == 5 and [line.count(".c ") for line in hashed] == [1]
    assert "/controller_hash.c " in hashed[0]
    assert "/controller_hash.o " in lines[-1] and "/small.o " in lines[-1]


def test_a_controller_that_does_not_build_leaves_the_old_daemon(
    tmp_path: Path, without_zig: None, capsys: pytest.CaptureFixture[str]
) -> None:
    require_tool("cc", "build-essential")
    (tmp_path / "mine.c").write_text("int broken = ;\n")
    made = tmp_path / "vsensed"
    made.write_text("the old one")
    words = ["--controller", str(tmp_path / "mine.c"), "--target", "host", "-o", str(made)]
    assert cli.main(["robot", "build", *words]) == 1
    assert "mine.c:1:" in capsys.readouterr().err
    assert made.read_text() == "the old one"
    assert sorted(os.listdir(tmp_path)) == ["mine.c", "vsensed"]
