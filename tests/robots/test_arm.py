"""Every C test again on emulated ARM: what robots run as a program for ARMv5 without a floating
point unit, on an ARM926; the kernels for 64-bit ARM by Debian's compiler, as hosts compile them.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tests.conftest import require_tool, require_zig
from tests.rigs import compiling
from tests.rigs.places import ROOT
from tests.wire.c_vectors import write_vectors
from vsense.robots import boards
from vsense.robots.boards import TARGETS, toolchain
from vsense.robots.build import cache_directory

WIRE = compiling.WIRE_SUITES
KERNELS = {**compiling.KERNEL_SUITES, "test_latest": [compiling.HOST / "vs_latest.c"]}
SUITES: dict[str, list[Path]] = {**compiling.ROBOT_SUITES, **WIRE, **KERNELS}
EMULATORS = {"epuck": ("qemu-arm", "-cpu", "arm926"), "aarch64": ("qemu-aarch64",)}
LONG = ("robot_stop", "robot_number", "test_scan")
"""They take minutes on an emulated processor."""
FOLDERS = ("c_src", "c_src/host", "robot", "firmware_bridge", "tests/c")
RUNS = {name: str(max(count // 30, 10)) for name, count in compiling.RUNS.items()}
RUNS["robot_homing"] = "7"
"""An emulated processor lives more slowly: fewer random worlds, and each seventh goal."""


def test_no_suite_is_forgotten() -> None:
    programs = [p for p in (ROOT / "tests" / "c").glob("*.c") if "int main(" in p.read_text()]
    assert {p.stem for p in programs} == set(SUITES)


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.campaign] if name in LONG else []) for name in SUITES],
)
def test_c_suite_on_arm(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    board = "aarch64" if name in KERNELS else "epuck"
    emulator, *arguments = EMULATORS[board]
    qemu = require_tool(emulator, "qemu-user")
    if board == "aarch64":
        require_tool("aarch64-linux-gnu-gcc", "gcc-aarch64-linux-gnu")
        monkeypatch.setattr(boards, "_zig", lambda target, cache: None)
    else:
        require_zig()
    folders = [ROOT / folder for folder in FOLDERS]
    if name in WIRE:
        write_vectors(ROOT / "tests" / "golden" / "wire.json", tmp_path / "wire_vectors.h")
        folders.append(tmp_path)  # of these only: the compiler keeps what others have in common
    program = tmp_path / name
    compiler = toolchain(TARGETS[board], cache_directory())
    standard = "-std=c11" if name == "test_latest" else "-std=c99"
    done = compiler.run(
        [
            *(standard, "-D_POSIX_C_SOURCE=200809L", *compiler.flags),
            *(f"-I{folder}" for folder in folders),
            *map(str, (ROOT / "tests" / "c" / f"{name}.c", *SUITES[name])),
            *("-lm", "-pthread", "-o", str(program)),
        ]
    )
    assert done.returncode == 0, done.stderr
    command = [qemu, *arguments, str(program), *([RUNS[name]] if name in RUNS else [])]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert ran.returncode == 0, ran.stderr
