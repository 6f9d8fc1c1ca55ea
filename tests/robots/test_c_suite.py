"""The daemon's C tests under the sanitizers, and what its files may need and keep."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from tests.conftest import require_tool
from tests.robots.conftest import FLAGS, ROOT, STRICT, Builder

TESTS = ROOT / "tests" / "c"
ROBOT = ROOT / "robot"
C_SRC = ROOT / "c_src"
FIRMWARE = ROOT / "firmware_bridge"
PROTOCOL = [
    C_SRC / f"vs_{part}.c"
    for part in (
        *("err", "bytes", "tag", "wire", "table", "shown", "body"),
        *("peer", "clock", "offer", "greeting", "session"),
    )
]
POLLUTANT = ROBOT / "controllers" / "pollutant.c"
OWN = [ROBOT / f"{part}.c" for part in ("robot", "leds", "log", "base_sensors", "number")]
CALIBRATION = [ROBOT / "calibration.c"]
MINDS = [ROBOT / f"{part}.c" for part in ("loop", "homing", "guard", "safety", "battery")]
MINDS += [*CALIBRATION, *OWN]
BASES = [*ROBOT.glob("base*.c"), *C_SRC.glob("epuck_*.c"), *C_SRC.glob("vs_i2c*.c")]
BASES += [ROBOT / "number.c", C_SRC / "vs_format.c", C_SRC / "vs_posix.c"]
BASES += [*FIRMWARE.glob("*.c")]
SUITES = {
    "robot_base": BASES,
    "robot_base_asercom": BASES,
    "robot_base_i2c": BASES,
    "robot_base_boards": BASES,
    "robot_base_config": BASES,
    "robot_base_sensors": [*OWN, *PROTOCOL],
    "robot_memory": [ROBOT / "memory.c"],
    "robot_guard": [ROBOT / "guard.c"],
    "robot_guard_process": [
        *(ROBOT / f"{part}.c" for part in ("guard", "guard_process", "report", "signals")),
        *(ROBOT / "watchdog.c", *BASES),
    ],
    "robot_posix": [],
    "robot_format": [C_SRC / "vs_format.c"],
    "robot_i2c_posix": [C_SRC / "vs_format.c"],
    "robot_radio": [*(ROBOT / f"{part}.c" for part in ("number", "signals")), C_SRC / "vs_posix.c"],
    "robot_reset": [C_SRC / "vs_format.c"],
    "robot_settings": [ROBOT / "settings.c"],
    "robot_uid": [
        *(ROBOT / f"{part}.c" for part in ("options", "options_help", "presets", "settings")),
        *CALIBRATION,
        *(p for p in BASES if FIRMWARE not in p.parents),
        C_SRC / "vs_bytes.c",
    ],
    "robot_watchdog": [],
    "robot_battery": [ROBOT / "battery.c"],
    "robot_number": [ROBOT / "number.c"],
    "robot_calibration": [*CALIBRATION, ROBOT / "number.c"],
    "robot_stop": [ROBOT / "guard.c", *BASES],
    "robot_homing": [ROBOT / "homing.c"],
    "robot_loop": [TESTS / "robot_life.c", *MINDS, *PROTOCOL],
    "robot_inprocess": [
        *(ROBOT / f"{part}.c" for part in ("inprocess", "loop", "homing", "safety", "battery")),
        *CALIBRATION,
        *OWN,
        *PROTOCOL,
    ],
    "robot_controller": [*OWN, ROBOT / "walk.c", POLLUTANT, *PROTOCOL],
    "robot_walk": [*OWN, ROBOT / "walk.c", POLLUTANT, *PROTOCOL],
}
RUNS = {"robot_base": "3000", "robot_loop": "300", "robot_base_asercom": "500"}
RUNS |= {"robot_base_i2c": "2000"}
"""How many random worlds a suite goes through."""

EDGE = {"base_reset", "board_link", "board_process", "calls", "check", "guard_link"}
EDGE |= {"guard_process", "guard_rights", "key", "main", "net", "networks", "radio", "random"}
EDGE |= {"report", "restart", "signals", "trace", "uid", "watchdog", "worker"}
"""The files that talk to the operating system; all others are pure."""

SYSTEM = {"errno", "fcntl", "poll", "signal", "termios", "time", "unistd", "pthread"}
STACK_MAX = 16384
"""[byte] of stack that one function may use."""


def cc(target: Path, *arguments: str | Path) -> Path:
    """Compiles and links with warnings as errors."""
    command = [require_tool("cc", "build-essential"), *map(str, arguments)]
    command += ["-I", str(C_SRC), "-I", str(ROBOT), "-I", str(FIRMWARE), "-I", str(TESTS)]
    done = subprocess.run([*command, "-o", str(target), "-lm"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return target


def symbols(path: Path) -> dict[str, str]:
    """Name and kind of every symbol, as `nm` says them."""
    nm = [require_tool("nm", "binutils"), str(path)]
    lines = subprocess.run(nm, capture_output=True, text=True, check=True).stdout.splitlines()
    return {line.split()[-1].split("@")[0]: line.split()[-2] for line in lines}


@pytest.mark.parametrize("name", SUITES)
def test_c_suite_under_sanitizers(name: str, build: Builder, tmp_path: Path) -> None:
    objects = build.objects(SUITES[name])
    program = cc(tmp_path / name, *FLAGS, TESTS / f"{name}.c", *objects)
    command = [str(program), *([RUNS[name]] if name in RUNS else [])]
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
    built = cc(tmp_path / "vsensed", *STRICT, "-Os", *sources)
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
