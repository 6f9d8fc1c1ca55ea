"""What a controller must not be: one with static variables, or one without its entry."""

from __future__ import annotations

import re
import signal
import subprocess
from pathlib import Path

import pytest

from tests.conftest import require_tool, require_zig
from tests.rigs.places import ROOT
from vsense import cli
from vsense.robots import _compiled, boards, build
from vsense.robots.compiling import BuildError, native
from vsense.robots.crashes import words_of_log
from vsense.robots.sources import ProgramSources

STATE = """#include "controller.h"

struct mine { int light; };
static void step(void *state, struct vs_robot *robot)
{
    (void)state;
    /* HERE */
    vs_robot_set_wheels(robot, 1, 1);
}
const struct vs_controller vs_controller = {"mine", sizeof(struct mine), 0, step, 0};
"""
COUNTING = STATE.replace("/* HERE */", "static int n;\n    vs_robot_set_leds(robot, n++ & 1);")


@pytest.fixture(autouse=True)
def cache(own_cache: Path) -> None:
    require_tool("cc", "build-essential")


def compiled(folder: Path, text: str, *words: str, name: str = "mine.c") -> tuple[Path, Path]:
    """The object file of a program, and its source."""
    source, target = folder / name, folder / "mine.o"
    source.write_text(text)
    folders = [f"-I{path}" for path in build.source_tree().includes()]
    compiler = ("c++", "-O2") if name.endswith(".cpp") else ("cc", "-std=c99", "-O2")
    command = [*(words or compiler), *folders, "-c", str(source), "-o", str(target)]
    subprocess.run(command, check=True, timeout=120)
    return target, source


@pytest.mark.parametrize(
    ("before", "here", "line", "names"),
    [
        ("", "static int n;\n vs_robot_set_leds(robot, n++ & 1);", 7, {"n"}),
        ("static double sum[4];", "vs_robot_set_leds(robot, ++sum[1] > 3);", 2, {"sum"}),
        ("int total;", "total++;", 2, {"total"}),
        ("int total = 7;", "total++;", 2, {"total"}),
        ("static int at, is;", "vs_robot_set_leds(robot, at++ + is++);", 2, {"at", "is"}),
    ],
)
def test_variables_that_robots_would_share_are_named(
    before: str, here: str, line: int, names: set[str], tmp_path: Path
) -> None:
    text = STATE.replace("\n\n", f"\n{before}\n", 1).replace("/* HERE */", here)
    words = _compiled.fault(*compiled(tmp_path, text))
    assert words is not None and words.startswith(f"{tmp_path / 'mine.c'}:{line}: ")
    assert set(re.findall(r"'(\w+)'", words.partition(" would be")[0])) == names


@pytest.mark.parametrize(
    ("before", "here"),
    [
        ("static const int n = 4;", "vs_robot_set_leds(robot, n);"),
        ("static int never = 4;", "vs_robot_set_leds(robot, never);"),
        ('static const char *const all[] = {"a", "b"};', "vs_robot_log(robot, all[1]);"),
        ("", "static const double far[] = {1, 2}; vs_robot_set_leds(robot, far[1] > 1);"),
    ],
)
def test_constants_are_no_variables(before: str, here: str, tmp_path: Path) -> None:
    text = STATE.replace("\n\n", f"\n{before}\n", 1).replace("/* HERE */", here)
    assert _compiled.fault(*compiled(tmp_path, text)) is None


@pytest.mark.parametrize("path", sorted((ROOT / "robot" / "controllers").glob("*.c")))
def test_shipped_controllers_have_none(path: Path, tmp_path: Path) -> None:
    assert _compiled.fault(*compiled(tmp_path, path.read_text())) is None


@pytest.mark.parametrize("name", ["start", "labyrinth"])
def test_what_new_makes_has_none(name: str, tmp_path: Path) -> None:
    assert cli.main(["new", str(tmp_path / "own"), "--from", name, "--sensor"]) == 0
    assert _compiled.fault(*compiled(tmp_path, (tmp_path / "own" / "own.c").read_text())) is None


def test_other_compilers_objects_are_read_too(tmp_path: Path) -> None:
    require_zig()
    arm = boards_compiler()
    words = _compiled.fault(*compiled(tmp_path, COUNTING, *arm))
    assert words is not None and "mine.c:7: 'step.n' would be shared" in words


def boards_compiler() -> list[str]:
    found = boards.toolchain(boards.TARGETS["epuck"], build.cache_directory())
    return [*found.command, *found.flags]


@pytest.mark.parametrize("kind", ["sim", "lab", "robot"])
def test_they_are_refused_wherever_it_is_built(kind: str, tmp_path: Path, capsys) -> None:
    source = tmp_path / "mine.c"
    source.write_text(COUNTING)
    if kind == "robot":
        words = ["--controller", str(source), "--target", "host", "-o", str(tmp_path / "made")]
        assert cli.main(["robot", "build", *words]) == 1
        said = capsys.readouterr().err
    else:
        make = {"sim": build.shared, "lab": build.daemon}[kind]
        with pytest.raises(BuildError) as caught:
            make(str(source))
        said = str(caught.value)
    assert f"{source}:7: 'n' would be shared by all robots" in said or ": 'step.n'" in said


@pytest.mark.parametrize("name", ["mine.c", "mine.cpp"])
def test_a_missing_entry_is_one_sentence(name: str, tmp_path: Path) -> None:
    source = tmp_path / name
    source.write_text(STATE.replace(" vs_controller =", " vs_controler ="))
    if name.endswith(".cpp"):
        require_tool("c++", "build-essential")
    with pytest.raises(BuildError) as caught:
        build.shared(str(source))
    assert str(caught.value).startswith(f"{source} defines no vs_controller: expected")
    assert "\n" not in str(caught.value) and "undefined reference" not in str(caught.value)


def test_in_cxx_it_is_said_once(tmp_path: Path, capsys) -> None:
    require_tool("c++", "build-essential")
    source = tmp_path / "mine.cpp"
    source.write_text(COUNTING.replace("#include", "#include <iostream>\n#include", 1))
    for _ in range(2):
        build.shared(str(source))
    said = capsys.readouterr().err
    assert said.count("share its static variables, and real robots do not: n\n") == 1


def test_argos_controllers_are_told_once_and_not_refused(
    shared_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    require_tool("c++", "build-essential")
    monkeypatch.setenv("XDG_CACHE_HOME", str(shared_cache))  # our part of it is there already
    text = (ROOT / "tests/robots/argos/controllers/readings.cpp").read_text()
    here = text.index("{", text.index("::ControlStep()")) + 1
    source = tmp_path / "readings.cpp"
    source.write_text(
        f"{text[:here]}\n    static int steps = 0;\n    LOG << ++steps;\n{text[here:]}"
    )
    program = ProgramSources((source,), (ROOT / "tests/robots/argos/controllers",), "readings")
    build.shared(program)
    build.shared(program)
    said = capsys.readouterr().err
    assert said.count("share its static variables, and real robots do not: steps\n") == 1


def test_a_board_gets_no_lines_of_its_source(tmp_path: Path) -> None:
    """What `-g` adds stays on this machine: daemons for boards are stripped."""
    source = tmp_path / "mine.c"
    source.write_text(STATE)
    assert native().debug and not boards.toolchain(boards.TARGETS["epuck"], tmp_path).debug
    assert b".debug_line" in build.daemon(str(source)).read_bytes()
    built = boards.build(str(source), "epuck", tmp_path / "vsensed")
    assert b".debug_line" not in built.path.read_bytes()


def test_a_daemon_of_the_lab_that_crashes_tells_its_line(tmp_path: Path) -> None:
    source, log = tmp_path / "mine.c", tmp_path / "31.log"
    born = "__attribute__((constructor)) static void born(void)\n{\n    abort();\n}\n"
    source.write_text(f"#include <stdlib.h>\n{STATE}{born}")
    line = source.read_text().splitlines().index("    abort();") + 1
    made = build.daemon(str(source))
    with log.open("wb") as out:
        done = subprocess.run([str(made), "--version"], stdout=out, stderr=out, timeout=60)
    assert done.returncode == -signal.SIGABRT
    assert words_of_log(log, made) == f" at mine.c:{line}"
    log.write_text("vsensed 31: wheels free\n")
    assert words_of_log(log, made) == ""
