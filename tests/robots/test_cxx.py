"""Controllers in C++: in `vsense sim`, in the lab, on ARMv5; clear where they do not build."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from tests.bench.robot import HERE as BENCH
from tests.conftest import require_tool, require_zig
from vsense.config import argos
from vsense.config.experiment import load
from vsense.modes.sim._simulation import Simulation
from vsense.robots import boards, build
from vsense.robots._compiled import SHOWN_LINES
from vsense.robots.compiling import BuildError, Sources, native, own_cxxflags
from vsense.robots.sources import ProgramSources
from vsense.run.programs import shared_objects

WALKER = Path(__file__).parent / "walker.cpp"
TIMEOUT_S = 300


@pytest.fixture(autouse=True)
def cache(own_cache: Path) -> None:
    require_tool("c++", "build-essential")


@pytest.fixture
def walker(tmp_path: Path) -> Path:
    copy = tmp_path / "walker.cpp"
    shutil.copy2(WALKER, copy)
    return copy


def ran(*command: str | Path) -> str:
    done = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_an_experiment_names_one_and_its_robots_drive(walker: Path) -> None:
    shipped = build.source_tree().root / "vsense" / "config" / "experiments" / "pollutant.argos"
    file = walker.with_name("mine.argos")
    file.write_text(shipped.read_text().replace('library="pollutant"', 'library="walker.cpp"'))
    experiment = load(str(file), 5.0)
    assert experiment.controllers[0].library == "walker.cpp"
    run = Simulation(experiment, shared_objects(experiment), 1)
    run.run()
    places = run.record.poses[:, : len(run.record.tags), :2]
    moved = abs(places[-1] - places[0]).max(axis=1)
    assert (moved > 0.02).any()


@pytest.mark.parametrize("suffix", [".cpp", ".cc", ".cxx"])
def test_the_labs_daemon_has_it(walker: Path, suffix: str) -> None:
    walker.rename(walker.with_suffix(suffix))
    made = build.daemon(f"walker{suffix}", walker.parent)
    assert "controller walker " in ran(made, "--version")
    assert build.daemon(f"walker{suffix}", walker.parent) == made


@pytest.mark.parametrize("name", ["small", "cxx_memory", "made", "my  own"])
def test_it_may_have_any_name(walker: Path, tmp_path: Path, name: str) -> None:
    """Names of what is made on the way, too."""
    require_zig()
    built = boards.build(str(walker.rename(walker.with_stem(name))), "epuck", tmp_path / "vsensed")
    assert built.controller.stem == name


def test_its_hash_is_the_same_on_every_machine(walker: Path, tmp_path: Path) -> None:
    require_zig()
    sources = build.source_tree().daemon(ProgramSources((walker,)))
    zig = boards.toolchain(boards.TARGETS["epuck"], build.cache_directory())
    assert sources.controller_hash(zig) == sources.controller_hash(native())
    assert sources.dependencies(zig) == [
        walker,
        *(build.source_tree().root / "robot" / name for name in ("controller.h", "walk.h")),
    ]


def test_it_runs_on_the_oldest_board(tmp_path: Path) -> None:
    qemu = require_tool("qemu-arm", "qemu-user")
    require_zig()
    built = boards.build(str(WALKER), "epuck", tmp_path / "vsensed")
    print(f"vsensed for ARMv5 with a controller in C++: {built.size} bytes")
    said = ran(qemu, "-cpu", "arm926", built.path, "--version")
    assert said.endswith(f"controller walker {built.hash}\n")


def test_its_steps_run_there_too(tmp_path: Path) -> None:
    """Vectors, the C++ library's memory and atomics, on the emulated processor."""
    qemu = require_tool("qemu-arm", "qemu-user")
    require_zig()
    tree = build.source_tree()
    own = [path for path in tree.daemon_sources() if path.name != "main.c"]
    sources = Sources([*own, BENCH / "robot_steps.c"], ProgramSources((WALKER,)), tree.includes())
    sources.link(boards.toolchain(boards.TARGETS["epuck"], build.cache_directory()), tmp_path / "s")
    assert int(ran(qemu, "-cpu", "arm926", tmp_path / "s", "live", "50")) == 50


def test_an_error_names_file_and_line(walker: Path) -> None:
    walker.write_text("#include <vector>\nstd::vector<int> broken = ;\n")
    with pytest.raises(
        BuildError, match=r"the controller .*walker\.cpp does not (.|\n)*walker\.cpp:2:"
    ):
        build.daemon("walker.cpp", walker.parent)
    assert not list(walker.parent.rglob("vsensed*")), "nothing half-made is left behind"


def test_exceptions_are_off_unless_the_user_wants_them(
    walker: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    thrower = walker.read_text().replace(
        "    // The state", "    try { throw 1; } catch (int) {}\n    // The state"
    )
    walker.write_text(thrower)
    with pytest.raises(BuildError, match=r"walker\.cpp:\d+:\d+: error: exception"):
        build.shared("walker.cpp", walker.parent)
    monkeypatch.setenv("CXXFLAGS", "-fexceptions")
    assert build.shared("walker.cpp", walker.parent).is_file()


def test_a_missing_compiler_is_told(walker: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CXX", "no-such-c++")
    with pytest.raises(BuildError, match=r"no C\+\+ compiler 'no-such-c\+\+'.*build-essential"):
        build.daemon("walker.cpp", walker.parent)
    assert build.daemon("pollutant").name == "vsensed", "C needs none"


def test_flags_have_quotes_as_in_a_shell_and_are_named_where_they_are_wrong(
    walker: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CXXFLAGS", "-DNAME='\"a b\"'  -O1")
    assert own_cxxflags() == ['-DNAME="a b"', "-O1"]
    monkeypatch.setenv("CXXFLAGS", "-DNAME='a")
    with pytest.raises(BuildError, match="CXXFLAGS=-DNAME='a: no closing quotation"):
        build.shared("walker.cpp", walker.parent)
    monkeypatch.setenv("CXXFLAGS", "-fno-such-thing")
    with pytest.raises(BuildError, match=r"does not build with CXXFLAGS=-fno-such-thing:\n"):
        build.shared("walker.cpp", walker.parent)


MANY_WORDS = """
#include <map>
struct Pair { int x; };
static void Fill(std::map<Pair, int> &all) { all[Pair()] = undeclared; }
"""
"""Four errors at most, and notes of every operator < that the library has."""


def test_of_a_compilers_words_the_errors_are_shown(walker: Path) -> None:
    walker.write_text(walker.read_text() + MANY_WORDS)
    line = walker.read_text().splitlines().index(MANY_WORDS.splitlines()[3]) + 1
    with pytest.raises(BuildError) as told:
        build.shared("walker.cpp", walker.parent)
    first, *lines = str(told.value).splitlines()
    assert first == f"the controller {walker} does not build:"
    errors = [n for n, words in enumerate(lines) if " error: " in words]
    notes = [n for n, words in enumerate(lines) if " note: " in words]
    assert any(lines[n].startswith(f"{walker}:{line}:") for n in errors)
    assert any("operator<" in lines[n] for n in errors) and max(errors) < min(notes)
    assert len(lines) == SHOWN_LINES + 1 and lines[-1].endswith(" more lines)")


def test_of_a_linkers_words_each_missing_symbol_is_shown_once(walker: Path) -> None:
    seen = '__attribute__((visibility("default")))'
    body = "{ return Absent(Kind()) + Gone(Kind()); }"
    calls = "".join(f"{seen} int Call{n}() {body}\n" for n in range(30))
    absent = f"namespace own {{ struct Kind {{}}; int Absent(Kind); int Gone(Kind); {calls} }}"
    walker.write_text(f"{absent}\n{walker.read_text()}")
    with pytest.raises(BuildError) as told:
        build.shared("walker.cpp", walker.parent)
    first, absent, gone, *others = str(told.value).splitlines()
    assert first == f"the controller {walker} does not build:"
    assert absent.endswith("undefined reference to `own::Absent(own::Kind)' (30 times)")
    assert gone.endswith("undefined reference to `own::Gone(own::Kind)' (30 times)")
    assert len(others) < 4


def test_another_compiler_makes_a_new_build(walker: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = []
    for flags in ("", "-DMINE"):
        monkeypatch.setenv("CXXFLAGS", flags)
        made.append(build.daemon("walker.cpp", walker.parent))
    assert made[0] != made[1]


def test_debians_compilers_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(boards, "_zig", lambda target, cache: None)
    monkeypatch.setattr(shutil, "which", lambda name: name if name.endswith("-gcc") else None)
    found = boards.toolchain(boards.TARGETS["epuck"], tmp_path)
    with pytest.raises(BuildError, match=r"'arm-linux-gnueabi-g\+\+'.*apt install g\+\+-arm-linux"):
        found.for_cxx()


def test_a_port_in_cxx_is_found_but_not_what_argos_was_built_from(walker: Path) -> None:
    folder = walker.parent
    assert argos.ported_controller("build/libwalker.so", folder) == "walker.cpp"
    walker.write_text("#include <argos3/core/control_interface/ci_controller.h>\n")
    assert argos.ported_controller("build/libwalker.so", folder) is None
    (folder / "walker.cxx").write_text(WALKER.read_text())
    assert argos.ported_controller("build/libwalker.so", folder) == "walker.cxx"
    (folder / "walker.c").write_text("")
    assert argos.ported_controller("build/libwalker.so", folder) == "walker.c"
