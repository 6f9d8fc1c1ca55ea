"""What ARGoS's code finds in robot/argos: the values that ARGoS itself gives."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

from tests.conftest import require_tool
from vsense.robots import _argos_code, build

ARGOS = build.source_tree().root / "robot" / "argos"
HERE = Path(__file__).parent / "argos"
PARTS = [ARGOS / f"{part}.cpp" for part in ("base", "configuration", "random")]
HOOKS = """
#include <cstdio>
#include <cstdlib>
extern "C" [[noreturn]] void vs_argos_fail(const char *words) { std::puts(words); std::exit(3); }
extern "C" void vs_argos_log(int is_error, const char *line)
{
    std::printf("%s: %s\\n", is_error ? "error" : "log", line);
}
"""
LOG = """
#include <argos3/core/utility/logging/argos_log.h>
#include <argos3/core/utility/math/vector2.h>
using namespace argos;
int main(int count, char **)
{
    LOG << "one " << 1 << ' ' << 2.5 << std::endl << "two";
    LOGERR << argos::red << "bad" << argos::reset << std::endl;
    LOG << " parts " << CVector2(1.0, 2.0) << "\\nthree\\n";
    LOG << std::setprecision(3) << 3.14159 << " " << 2.71828 << std::endl;
    LOG.GetStream() << "stream " << 7 << std::endl;
    LOG << "no end";
    LOG.Flush();
    if (count > 1)
        THROW_ARGOSEXCEPTION("too many: " << count);
    return 0;
}
"""


def compiled(folder: Path, *words: str | Path) -> Path:
    require_tool("c++", "build-essential")
    (folder / "hooks.cpp").write_text(HOOKS)
    forward = _argos_code.forwarding(ARGOS, folder)
    command = ["c++", "-Wall", "-Wextra", "-Werror", f"-I{forward}", *words]
    command += [*PARTS, folder / "hooks.cpp", "-o", folder / "program"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return folder / "program"


def test_values_are_those_of_argos(tmp_path: Path) -> None:
    """Source: base_values.cpp says with what base_values.txt was made."""
    program = compiled(tmp_path, "-std=c++11", HERE / "base_values.cpp")
    said = subprocess.run(
        [program], capture_output=True, text=True, env={**os.environ, "VSENSE_TEST": "xyz"}
    )
    assert said.returncode == 0
    assert said.stdout.splitlines() == (HERE / "base_values.txt").read_text().splitlines()


def test_without_exceptions_a_failure_says_its_words(tmp_path: Path) -> None:
    (tmp_path / "log.cpp").write_text(LOG)
    plain = ("-fno-exceptions", "-fno-rtti", "-std=c++17")
    program = compiled(tmp_path, *plain, tmp_path / "log.cpp")
    good = subprocess.run([program], capture_output=True, text=True)
    assert good.returncode == 0
    assert good.stdout.splitlines() == [
        "log: one 1 2.5",
        "error: bad",
        "log: two parts 1,2",
        "log: three",
        "log: 3.14 2.72",
        "log: stream 7",
        "log: no end",
    ]
    bad = subprocess.run([program, "more"], capture_output=True, text=True)
    assert bad.returncode == 3
    assert bad.stdout.splitlines()[-1] == "[FATAL] too many: 2"
