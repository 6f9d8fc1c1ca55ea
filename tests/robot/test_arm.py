"""Every C test again as a program for ARMv5 without a floating point unit, on an emulated ARM926.

The one left out is that of the latest-value buffer between two threads: its atomics do not link
there, and nothing on a robot has two threads.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tests.conftest import require_tool, require_zig
from tests.kernels import test_c_suite as kernels
from tests.robot import test_c_suite as robot
from tests.wire import test_c_suite as wire
from tests.wire.c_vectors import write_vectors
from vsense.robot.boards import TARGETS, toolchain
from vsense.robot.build import cache_directory

ROOT = robot.ROOT
SUITES: dict[str, list[Path]] = {
    **robot.SUITES,
    "test_wire": wire.SESSION,
    "test_session": wire.SESSION,
    **kernels.SUITES,
}
FOLDERS = ("c_src", "c_src/host", "robot", "firmware_bridge", "tests/c")
RUNS = {name: str(max(int(count) // 30, 10)) for name, count in robot.RUNS.items()}
RUNS |= {"test_physics": "30", "test_rays": "5"}
"""An emulated processor lives more slowly: fewer random worlds; of the crowds, every fifth."""


def test_no_suite_is_forgotten() -> None:
    programs = [p for p in (ROOT / "tests" / "c").glob("*.c") if "int main(" in p.read_text()]
    assert {p.stem for p in programs} - {"test_latest"} == set(SUITES)


@pytest.mark.parametrize("name", SUITES)
def test_c_suite_on_arm(name: str, tmp_path: Path) -> None:
    qemu = require_tool("qemu-arm", "qemu-user")
    require_zig()
    write_vectors(ROOT / "tests" / "golden" / "wire.json", tmp_path / "wire_vectors.h")
    folders = [ROOT / folder for folder in FOLDERS]
    program = tmp_path / name
    compiler = toolchain(TARGETS["epuck"], cache_directory())
    done = compiler.run(
        [
            *("-std=c99", "-D_POSIX_C_SOURCE=200809L", *compiler.flags),
            *(f"-I{folder}" for folder in (*folders, tmp_path)),
            *map(str, (ROOT / "tests" / "c" / f"{name}.c", *SUITES[name])),
            *("-lm", "-o", str(program)),
        ]
    )
    assert done.returncode == 0, done.stderr
    command = [qemu, "-cpu", "arm926", str(program), *([RUNS[name]] if name in RUNS else [])]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert ran.returncode == 0, ran.stderr
