"""The C tests: which files each is made of, how they are compiled, and what these may need."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterable
from pathlib import Path

from tests.conftest import require_tool
from tests.rigs.places import ROOT

C_SRC = ROOT / "c_src"
TESTS = ROOT / "tests" / "c"
PARTS = ("err", "bytes", "tag", "wire", "table", "shown", "body", "peer", "clock", "offer")
PARTS += ("greeting", "session")
PROTOCOL = [C_SRC / f"vs_{part}.c" for part in PARTS]
WIRE_SUITES = dict.fromkeys(("test_wire", "test_session"), PROTOCOL)

HOST = C_SRC / "host"
PICTURES = [
    HOST / f"vs_{part}.c"
    for part in (
        *("math", "lens", "levels", "scan", "shape", "corners", "outline", "edges"),
        *("sums", "words", "square", "codes", "markers"),
    )
]
RAYS = [HOST / f"vs_{part}.c" for part in ("math", "sight", "rays", "obstacles")]
PHYSICS = [HOST / f"vs_{part}.c" for part in ("math", "near", "contacts", "physics", "ring")]
KERNEL_SUITES = {
    "test_scan": PICTURES,
    "test_words": PICTURES,
    "test_rays": RAYS,
    "test_light": [*RAYS, HOST / "vs_light.c"],
    "test_leds": [*RAYS, HOST / "vs_leds.c"],
    "test_devices": [
        *RAYS,
        *(HOST / f"vs_{part}.c" for part in ("camera", "hearing", "hearing_noise", "libm", "cxx")),
        *(HOST / f"vs_{part}.c" for part in ("noticed", "proximity")),
    ],
    "test_world": [
        *(*RAYS, HOST / "vs_world.c"),
        *(HOST / f"vs_{part}.c" for part in ("scene", "field", "floor", "libm", "places")),
    ],
    "test_physics": PHYSICS,
    "test_sim": [
        *RAYS,
        *PHYSICS[1:],
        *(HOST / f"vs_{p}.c" for p in ("world", "scene", "field", "slip", "cxx", "sim")),
    ],
}
"""C test -> the kernel's files: none needs another kernel's."""

ROBOT = ROOT / "robot"
FIRMWARE = ROOT / "firmware_bridge"
POLLUTANT = ROBOT / "controllers" / "pollutant.c"
OWN = [ROBOT / f"{part}.c" for part in ("robot", "params", "leds", "log", "base_sensors", "number")]
OWN += [C_SRC / "vs_format.c"]
CALIBRATION = [ROBOT / "calibration.c"]
MINDS = [ROBOT / f"{part}.c" for part in ("loop", "telling", "homing", "guard", "safety")]
MINDS += [ROBOT / "battery.c", *CALIBRATION, *OWN]
BASES = [*ROBOT.glob("base*.c"), *C_SRC.glob("epuck_*.c"), *C_SRC.glob("vs_i2c*.c")]
BASES += [ROBOT / "number.c", C_SRC / "vs_format.c", C_SRC / "vs_posix.c"]
BASES += [
    *ROBOT.glob("driver*.c"),
    ROBOT / "wifi_line.c",
    *(ROBOT / f"{p}.c" for p in ("guard_rights", "report", "signals")),
]
BASES += [*FIRMWARE.glob("*.c")]
ROBOT_SUITES = {
    "robot_base": BASES,
    "robot_base_asercom": BASES,
    "robot_base_i2c": BASES,
    "robot_base_boards": BASES,
    "robot_base_config": BASES,
    "robot_base_sensors": [*OWN, *PROTOCOL],
    "robot_memory": [ROBOT / "memory.c"],
    "robot_guard": [ROBOT / "guard.c"],
    "robot_guard_process": [
        *(ROBOT / f"{part}.c" for part in ("guard", "guard_process")),
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
        *(ROBOT / f"{part}.c" for part in ("inprocess", "loop", "telling", "homing", "safety")),
        ROBOT / "battery.c",
        *CALIBRATION,
        *OWN,
        *PROTOCOL,
    ],
    "robot_controller": [*OWN, ROBOT / "walk.c", POLLUTANT, *PROTOCOL],
    "robot_walk": [*OWN, ROBOT / "walk.c", POLLUTANT, *PROTOCOL],
}
RUNS = {"robot_base": 1000, "robot_loop": 100, "robot_base_asercom": 150, "robot_base_i2c": 600}
"""How many random worlds a suite goes through; ten times as many with `-m campaign`."""

STRICT = ["-pedantic", "-Wall", "-Wextra", "-Wshadow", "-Wconversion", "-Werror"]
SANITIZE = ["-g", "-O1", "-fsanitize=address,undefined,float-cast-overflow"]
SANITIZE += ["-fno-sanitize-recover=all"]

SYMBOLS = {"memcpy", "memmove", "memset", "memcmp", "strlen", "strcmp", "strncmp"}
"""What a pure C file may take from the C library: it costs nothing on any machine."""

STACK_MAX = 8192
"""[byte] of stack that one function may use."""


def compiled(target: Path, *arguments: str | Path) -> Path:
    """Compiles and links with warnings as errors."""
    command = [require_tool("cc", "build-essential"), *map(str, arguments)]
    command += ["-I", str(C_SRC), "-I", str(TESTS), "-I", str(target.parent), "-o", str(target)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return target


def run_test(program: Path) -> subprocess.CompletedProcess[str]:
    """Runs a C test to its end."""
    return subprocess.run([str(program)], capture_output=True, text=True, check=False, timeout=120)


def check_pure(source: Path, standard: str, folder: Path) -> None:
    """Asserts that a file needs no system, keeps no state and uses little stack."""
    plain = ["-O2", "-fno-pic", "-fno-pie", "-fno-stack-protector", "-fstack-usage", "-c"]
    built = compiled(folder / f"{source.stem}.o", standard, *STRICT, *plain, source)
    kinds = symbols(built)
    needed = {name for name, kind in kinds.items() if kind == "U"}
    assert {n for n in needed if not n.startswith(("vs_", "epuck_"))} <= SYMBOLS
    assert {name for name, kind in kinds.items() if kind in "dDbBC"} == set()
    report = built.with_suffix(".su").read_text().splitlines()
    used = {row.split("\t")[0]: row.split("\t")[1:] for row in report}
    assert {name for name, (size, _) in used.items() if int(size) > STACK_MAX} == set()
    assert {name for name, (_, kind) in used.items() if kind == "dynamic"} == set()


def symbols(path: Path) -> dict[str, str]:
    """Name and kind of every symbol, as `nm` says them."""
    nm = [require_tool("nm", "binutils"), str(path)]
    lines = subprocess.run(nm, capture_output=True, text=True, check=True).stdout.splitlines()
    return {line.split()[-1].split("@")[0]: line.split()[-2] for line in lines}


def declared_functions(headers: Iterable[Path]) -> set[str]:
    """Names of the functions whose prototypes are in these headers."""
    found: set[str] = set()
    for header in headers:
        text = re.sub(r"/\*.*?\*/", "", header.read_text(), flags=re.DOTALL)
        text = re.sub(r"^static inline .*?^}", "", text, flags=re.DOTALL | re.MULTILINE)
        found |= set(re.findall(r"\b(vs_\w+)\([^;{]*\);", text))
    return found


def counting_compiler(folder: Path) -> tuple[Path, Path]:
    """A compiler that notes each program it links, and the file of its notes."""
    notes, compiler = folder / "linked", folder / "counting-cc"
    compiler.write_text(
        f'#!/bin/sh\ncase "$*" in *" -Wl,--gc-sections "*) echo >>{notes};; esac\nexec cc "$@"\n'
    )
    compiler.chmod(0o755)
    return compiler, notes
