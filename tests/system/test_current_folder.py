"""What lies in the current folder is not vsense's: a user's `random.py`, somebody's `numpy.py`."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import require_zig
from vsense.base import processes
from vsense.commands import COMMANDS
from vsense.robots import boards

pytestmark = [pytest.mark.system, pytest.mark.quick]

ROOT = Path(__file__).parents[2]
TRAPS = (
    *("numpy", "cv2", "cffi", "aiohttp", "foxglove", "tomlkit", "mcap", "ziglang", "helper"),
    *("random", "queue", "signal", "json", "subprocess", "struct", "socket", "select", "tempfile"),
    *("argparse", "asyncio", "ctypes", "dataclasses", "logging", "typing", "zipfile"),
)
"""Modules that vsense imports, and one of nobody's."""
MODULES = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for path in (ROOT / "vsense").rglob("*.py")
    if '__name__ == "__main__"' in path.read_text()
)
"""Those that are started as processes."""
PLAN = 'mode = "sim"\nexperiment = "foraging"\nduration_s = 1\nrobots.count = 2\n' + (
    '[[condition]]\nname = "sighted"\n[[start]]\nname = "drawn"\nseed = 7\n'
)
PATIENCE_S = 120


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder in which every module says that it was imported, and fails."""
    here = tmp_path / "here"
    here.mkdir()
    for name in TRAPS:
        text = f"open({str(tmp_path / 'imported')!r}, 'a').write(__name__ + ' ')\nraise SystemExit"
        (here / f"{name}.py").write_text(text)
    return here


def run(folder: Path, *command: str) -> subprocess.CompletedProcess[str]:
    """Runs a program there to its end; nothing there was imported."""
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONSAFEPATH")}
    done = subprocess.run(
        command, cwd=folder, env=environment, stdin=subprocess.DEVNULL,
        capture_output=True, text=True, timeout=PATIENCE_S,
    )  # fmt: skip
    imported = folder.parent / "imported"
    assert not imported.exists(), f"{imported.read_text()}: {done.stderr}"
    return done


def vsense(folder: Path, line: str, module: bool = True) -> None:
    """Runs one of our commands there; it succeeds."""
    program = [sys.executable, "-m", "vsense"]
    installed = [str(Path(sys.executable).with_name("vsense"))]
    done = run(folder, *(program if module else installed), *line.split())
    assert done.returncode == 0, done.stderr


EVERY_COMMAND = """
import sys; del sys.path[0]; import contextlib, os, runpy
for command in sys.argv[1:]:
    sys.path.insert(0, "")
    sys.argv = ["vsense", *command.split(), "--help"]
    with contextlib.suppress(SystemExit):
        runpy.run_module("vsense", run_name="__main__", alter_sys=True)
    assert not {"", os.getcwd()} & {*sys.path}, command
"""
"""Does what `python -m vsense COMMAND --help` does, for one command after the other."""


def test_of_every_command_nothing_is_imported_from_there(folder: Path) -> None:
    done = run(folder, sys.executable, "-c", EVERY_COMMAND, *COMMANDS)
    assert done.returncode == 0, done.stderr
    assert all(f"usage: vsense {command} " in done.stdout for command in COMMANDS)


@pytest.mark.parametrize("module", MODULES)
@pytest.mark.parametrize("old", [False, True], ids=["here", "before 3.11"])
def test_of_every_process_nothing_is_imported_from_there(
    module: str, old: bool, folder: Path
) -> None:
    words = [sys.executable, "-c", processes.LAUNCHER, module]
    done = run(folder, *(words if old else processes.python_module(module)))
    assert "No module named" not in done.stderr


SIMULATED = ["sim foraging --duration 1 --runs 2 -j 2 -o runs.csv --record"]
LAB = ["lab phototaxis --duration 1 --robots 2 --port 0 --web 0 --foxglove 0 -o run --record"]


@pytest.mark.parametrize(
    ("lines", "module"),
    [
        (SIMULATED, True),
        (SIMULATED, False),
        pytest.param(LAB, True, marks=pytest.mark.paced),
        (["series plan.toml", "pack plan-sim -o plan.zip", "reproduce plan.zip -o again"], True),
        (["doctor --json", "docs experiments", "new mine"], True),
    ],
    ids=["sim", "sim, installed", "lab", "series", "doctor"],
)
def test_what_is_started_imports_nothing_from_there(
    lines: list[str], module: bool, folder: Path
) -> None:
    """With `-m`, which puts the current folder first; an installed command starts the same."""
    (folder / "plan.toml").write_text(PLAN)
    for line in lines:
        vsense(folder, line, module)


def test_the_cross_compiler_imports_nothing_from_there(folder: Path) -> None:
    require_zig()
    compiler = boards.toolchain(boards.TARGETS["epuck"], folder.parent)
    done = run(folder, *compiler.command, "--version")
    assert done.returncode == 0 and "clang" in done.stdout, done.stderr


def test_a_users_modules_are_found_by_his_own_code(folder: Path) -> None:
    """Beside his experiment; they stand in nobody's way there, whatever they are called."""
    vsense(folder, "new mine")
    mine = folder / "mine"
    for trap in folder.glob("*.py"):
        trap.rename(mine / trap.name)
    (mine / "helper.py").write_text("import random\nDRAWN = random.Random(3).random()\n")
    code = mine / "mine.py"
    future = "from __future__ import annotations\n"
    asks = f"{future}import helper\nassert 0.0 < helper.DRAWN < 1.0\n"
    assert future in code.read_text()
    code.write_text(code.read_text().replace(future, asks))
    for where, file in ((mine, "mine.argos"), (folder, "mine/mine.argos")):
        vsense(where, f"sim {file} --duration 1 -o {folder}/{where.name}.csv")
