"""The daemon's C tests under the sanitizers, and what its files may need and keep."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from tests.conftest import require_tool
from tests.rigs.compiling import (
    C_SRC,
    FIRMWARE,
    POLLUTANT,
    ROBOT,
    ROBOT_SUITES,
    RUNS,
    TESTS,
    compiled,
    symbols,
)
from tests.robots.conftest import FLAGS, STRICT, Builder

EDGE = {"base_reset", "board_link", "board_process", "calls", "check", "crash", "guard_link"}
EDGE |= {"orphan", "guard_process", "guard_rights", "key", "main", "net", "networks", "radio"}
EDGE |= {"random", "report", "restart", "signals", "trace", "uid", "watchdog", "worker"}
EDGE |= {"driver", "driver_process", "two_wheels", "wifi_line"}
"""The files that talk to the operating system; all others are pure."""

SYSTEM = {"errno", "fcntl", "poll", "signal", "termios", "time", "unistd", "pthread"}
STACK_MAX = 16384
"""[byte] of stack that one function may use."""


def cc(target: Path, *arguments: str | Path) -> Path:
    """Compiles and links the daemon's C with warnings as errors."""
    return compiled(target, *arguments, "-I", ROBOT, "-I", FIRMWARE, "-lm")


@pytest.mark.parametrize(
    ("name", "times"),
    [*((name, 1) for name in ROBOT_SUITES)]
    + [pytest.param(name, 10, marks=pytest.mark.campaign) for name in RUNS],
)
def test_c_suite_under_sanitizers(name: str, times: int, build: Builder, tmp_path: Path) -> None:
    objects = build.objects(ROBOT_SUITES[name])
    program = cc(tmp_path / name, *FLAGS, TESTS / f"{name}.c", *objects)
    command = [str(program), *([str(times * RUNS[name])] if name in RUNS else [])]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr


MUTANTS = [
    ("if (now_ns >= still_ns(g))", "if (0)"),
    ("g->expiry_ns < beat_ns ? g->expiry_ns : beat_ns", "beat_ns"),
    ("g->expiry_ns < beat_ns ? g->expiry_ns : beat_ns", "g->expiry_ns"),
    ("    hold(g, VS_CAUSE_SIGNAL);\n", ""),
    ("    hold(g, VS_CAUSE_BASE);\n", ""),
    ("if (g->ending == ENDING_ORPHANED && result == VS_OK)", "if (g->ending && result == VS_OK)"),
    ("ENDING_ORPHANED && result == VS_OK)", "ENDING_ORPHANED && result != VS_ERR_BUSY)"),
    ("g->due = (uint8_t)!moving(g);", "g->due = 0;"),
    ("    if (!g->ending)\n        answer(g, result, result == VS_OK);", "answer(g, result, 1);"),
    ("} else if (g->due || g->ending == ENDING_ORPHANED) {", "} else if (!g->ending && g->due) {"),
    ("if (g->ending && now_ns >= g->end_ns)", "if (0)"),
    ("        if (g->lost)\n            answer(g, VS_ERR_SILENT, 0);\n        else\n", ""),
    ("now_ns < g->heard_ns + VS_GUARD_HUNG_NS", "1"),
    ("    g->heard_ns = now_ns;\n", ""),
    ("    begin_end(g, ENDING_ORPHANED, now_ns);\n    g->hung", "    g->hung"),
]


@pytest.mark.parametrize(("old", "new"), MUTANTS)
def test_a_guard_with_a_fault_would_be_found_out(old: str, new: str, tmp_path: Path) -> None:
    text = (ROBOT / "guard.c").read_text()
    assert old in text
    broken = tmp_path / "guard.c"
    broken.write_text(text.replace(old, new, 1))
    program = cc(tmp_path / "mutant", "-std=c99", "-O1", TESTS / "robot_guard.c", broken)
    done = subprocess.run([str(program)], capture_output=True, text=True, timeout=60)
    assert done.returncode == 1


@pytest.mark.parametrize("source", sorted(ROBOT.rglob("*.c")), ids=lambda path: path.stem)
def test_pure_file_knows_no_system_and_keeps_no_state(source: Path, tmp_path: Path) -> None:
    plain = ["-O2", "-fno-pic", "-fno-pie", "-fno-stack-protector", "-fstack-usage", "-c"]
    built = cc(tmp_path / "file.o", *STRICT, *plain, source)
    report = built.with_suffix(".su").read_text().splitlines()
    assert {row for row in report if int(row.split("\t")[1]) > STACK_MAX} == set()
    if source.stem in EDGE:
        return
    headers = set(re.findall(r"#include <(\S+)\.h>", source.read_text()))
    assert not headers & SYSTEM and not any(name.startswith("sys/") for name in headers)
    assert {name for name, kind in symbols(built).items() if kind in "dDbBC"} == set()


def test_daemon_allocates_nothing(tmp_path: Path) -> None:
    sources = [*C_SRC.glob("*.c"), *ROBOT.glob("*.c"), POLLUTANT]
    built = cc(tmp_path / "vsensed", *STRICT, "-O0", *sources)
    needed = {name for name, kind in symbols(built).items() if kind == "U"}
    assert not needed & {"malloc", "calloc", "realloc", "free", "fopen", "strdup"}
    late = {"timerfd_create", "eventfd", "epoll_create1", "accept4", "pipe2", "getrandom"}
    assert not needed & late, "2.6 kernels on robots have none of these"


def test_controller_header_is_cplusplus_too(tmp_path: Path) -> None:
    source = tmp_path / "walker.cpp"
    source.write_text(
        '#include "controller.h"\n'
        'static void init(void *, struct vs_robot *robot) { vs_robot_sensor(robot, "light"); }\n'
        "static void step(void *, struct vs_robot *robot) { vs_robot_set_wheels(robot, 1, 1); }\n"
        'const struct vs_controller vs_controller = {"walker", 0, init, step, nullptr};\n'
    )
    cxx = require_tool("c++", "build-essential")
    command = [cxx, "-std=c++11", "-Wall", "-Wextra", "-pedantic", "-Werror", "-I", str(ROBOT)]
    built = tmp_path / "walker.o"
    done = subprocess.run([*command, "-c", str(source), "-o", str(built)], capture_output=True)
    assert done.returncode == 0, done.stderr.decode()
    assert symbols(built)["vs_controller"] in "DR"
