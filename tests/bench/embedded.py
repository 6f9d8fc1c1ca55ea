"""What libvsense costs on a microcontroller: flash, RAM and stack on a Cortex-M4, by its rooms.

Exact, and the same on every machine with the same compiler.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.rigs.places import ROOT
from vsense.base.errors import UsageError

C_SRC = ROOT / "c_src"
COMPILER = "arm-none-eabi-gcc"
PACKAGES = "gcc-arm-none-eabi libnewlib-arm-none-eabi"
FLASH_MAX, RAM_MAX = 12 * 1024, 3 * 1024
"""[byte] of session, codec and keys with the rooms of VS_SMALL."""

ROOMS = ((8, 64, 512), (16, 256, 800), (32, 1024, 1200), (32, 4096, 1200))
"""Entries, bytes of parameters, bytes of a datagram; the first are those of VS_SMALL, the last
those of a robot with an operating system."""

FLAGS = ("-std=c99", "-Os", "-mcpu=cortex-m4", "-mthumb", "-ffunction-sections", "-fdata-sections")
LINK = ("-nostartfiles", "-Wl,--gc-sections", "-Wl,-e,main", "--specs=nosys.specs")

EVERYTHING = """
#include "vs_session.h"
struct vs_session session;
volatile unsigned char sink;
int main(void)
{
    static struct vs_session_config config;
    static uint8_t buf[VS_DATAGRAM_MAX];
    static struct vs_telemetry telemetry;
    struct vs_value value;
    enum vs_event event;
    size_t n = 0;

    vs_session_init(&session, &config);
    vs_session_connected(&session, buf, sink);
    vs_session_tcp_out(&session, buf, sizeof buf, sink, &n);
    vs_session_tcp_in(&session, buf, n, sink, &n, &event);
    vs_session_udp_in(&session, buf, n, sink, &event);
    vs_session_tick(&session, sink, &event);
    vs_session_telemetry(&session, &telemetry, sink, buf, sizeof buf, &n);
    sink = vs_session_over_tcp(&session, sink);
    vs_session_value(&session, vs_table_find(&session.table, "light"), &value);
    sink = vs_session_age_ns(&session, value.capture_ns, sink);
    vs_session_goodbye(&session, VS_BYE_END, "end");
    vs_session_disconnected(&session);
    return sink;
}
"""
NOTHING = "int main(void) { return 0; }\n"

Say = Callable[[str], None]


def run(say: Say) -> dict[str, Any]:
    """Measures it.

    Returns:
        `compiler`, `flash_max`, `ram_max`, and in `rooms` by row of ROOMS `entries`, `params`,
        `datagram`, `flash`, `ram` and `stack` [byte].

    Raises:
        UsageError: no compiler.
    """
    compiler = shutil.which(COMPILER)
    if compiler is None:
        raise UsageError(f"needs {COMPILER}: apt install {PACKAGES}")
    version = subprocess.run([compiler, "--version"], capture_output=True, text=True, check=True)
    rows = []
    with tempfile.TemporaryDirectory(prefix="vsense-bench-") as folder:
        nothing = _flash(compiler, Path(folder), NOTHING, ())
        for entries, params, datagram in ROOMS:
            say(f"{entries} entries, {params} bytes of parameters, {datagram} a datagram")
            rooms = {"TABLE_MAX": entries, "PARAMS_ROOM": params, "DATAGRAM_MAX": datagram}
            defines = ("-DVS_SMALL", *(f"-DVS_{name}={room}" for name, room in rooms.items()))
            flash = _flash(compiler, Path(folder), EVERYTHING, defines) - nothing
            row = {"entries": entries, "params": params, "datagram": datagram, "flash": flash}
            rows.append({**row, "ram": _session(Path(folder)), "stack": _stack(Path(folder))})
    return {
        "compiler": version.stdout.splitlines()[0],
        "flash_max": FLASH_MAX,
        "ram_max": RAM_MAX,
        "rooms": rows,
    }


def _flash(compiler: str, folder: Path, program: str, defines: tuple[str, ...]) -> int:
    """[byte] of code and constants that a linked program has, the C library's included."""
    source, made = folder / "program.c", folder / "program"
    source.write_text(program)
    for usage in folder.glob("*.su"):
        usage.unlink()
    words = [compiler, *FLAGS, *defines, f"-I{C_SRC}", "-fstack-usage", *LINK]
    words += [str(source), *_sources(), "-o", str(made)]
    subprocess.run(words, check=True, cwd=folder, capture_output=True)
    size = shutil.which("arm-none-eabi-size") or "size"
    said = subprocess.run([size, str(made)], capture_output=True, text=True, check=True).stdout
    return int(said.splitlines()[1].split()[0])


def _sources() -> list[str]:
    """Those of the library, as build systems find them."""
    filters = json.loads((C_SRC / "library.json").read_text())["build"]["srcFilter"]
    return [str(C_SRC / word[2:-1]) for word in filters if word.startswith("+<")]


def _session(folder: Path) -> int:
    """[byte] of the one struct: keys, table, newest readings and all."""
    words = [shutil.which("arm-none-eabi-nm") or "nm", "-S", str(folder / "program")]
    said = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    found = re.search(r"^\w+ (\w+) \w session$", said, re.MULTILINE)
    assert found is not None, said
    return int(found[1], 16)


def _stack(folder: Path) -> int:
    """[byte] of the deepest frames that a WELCOME takes, as the compiler says them."""
    frames: dict[str, int] = {}
    for path in folder.glob("*.su"):
        for name, size in re.findall(r":(\w+)\t(\d+)\t", path.read_text()):
            frames[name] = max(int(size), frames.get(name, 0))
    path = ("vs_session_tcp_in", "on_packet", "on_welcome", "vs_decode_welcome", "vs_table_decode")
    return sum(frames.get(name, 0) for name in (*path, "decode_entry", "append", "vs_table_find"))


def table(report: dict[str, Any]) -> str:
    """The report as text."""
    lines = [
        f"libvsense on a Cortex-M4 ({report['compiler']}), bytes; allowed are"
        f" {report['flash_max']:,} of flash and {report['ram_max']:,} of RAM:",
        f"{'entries':>8} {'params':>7} {'datagram':>9} {'flash':>7} {'RAM':>7} {'stack':>6}",
    ]
    for row in report["rooms"]:
        lines.append(
            f"{row['entries']:>8} {row['params']:>7} {row['datagram']:>9}"
            f" {row['flash']:>7,} {row['ram']:>7,} {row['stack']:>6,}"
        )
    return "\n".join([*lines, "flash with what it takes of the C library; stack while it greets"])
