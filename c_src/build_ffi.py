"""Builds `vsense._native`: libvsense and the microcontroller's end, callable from Python.

The declarations that cffi needs are cut out of the real headers, so nothing is typed twice. The
library carries the names and the hash of the files it was made from: `vsense/native.py` compares
them with what it finds in a checkout.
"""

from __future__ import annotations

import hashlib
import re
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cffi import FFI

MODULE = "vsense._native"

HEADERS = [
    "c_src/vs_err.h",
    "c_src/vs_bytes.h",
    "c_src/vs_wire.h",
    "c_src/vs_table.h",
    "c_src/vs_body.h",
    "c_src/vs_peer.h",
    "c_src/vs_clock.h",
    "c_src/vs_session.h",
    "c_src/vs_latest.h",
    "c_src/vs_lens.h",
    "c_src/vs_scan.h",
    "c_src/vs_shape.h",
    "c_src/vs_outline.h",
    "c_src/vs_edges.h",
    "c_src/vs_markers.h",
    "c_src/vs_obstacles.h",
    "c_src/vs_rays.h",
    "c_src/vs_sight.h",
    "c_src/vs_trig.h",
    "c_src/vs_near.h",
    "c_src/vs_contacts.h",
    "c_src/vs_physics.h",
    "c_src/vs_ring.h",
    "c_src/epuck_bytes.h",
    "c_src/epuck_argos.h",
    "c_src/epuck_asercom.h",
    "c_src/epuck_gctronic.h",
    "c_src/epuck_york.h",
    "c_src/epuck_boards.h",
    "firmware_bridge/fw_body.h",
    "firmware_bridge/fw_line.h",
    "firmware_bridge/fw_uart.h",
    "firmware_bridge/fw_i2c.h",
    "firmware_bridge/fw_argos.h",
    "firmware_bridge/fw_asercom.h",
    "firmware_bridge/fw_gctronic.h",
    "firmware_bridge/fw_york.h",
    "firmware_bridge/fw_boards.h",
]
"""Every header that Python sees, each after those that it builds on."""

FLAGS = ["-O2"]
"""Comes after Python's own flags: with its usual -O3 gcc unrolls the picture kernel's short loops
before it sees that they are vectors, and the kernel takes twice as long."""

BUILT_FROM = """
/* What this library was built from: one file name a line, and their common hash. */
const char *vs_built_from(void);
const char *vs_built_hash(void);
"""

CPLUSPLUS = re.compile(r"^#ifdef __cplusplus\n.*?^#endif\n", re.MULTILINE | re.DOTALL)
CONSTANT = re.compile(r"#define\s+\w+\s+(0x[0-9A-Fa-f]+|\d+)\b")


def declarations(header: str) -> str:
    """Cuts out of a header's text what cffi understands.

    Of the preprocessor only plain integer constants stay. An atomic field has the layout of a
    plain one on every machine that vsense runs on; only the C functions may touch it.
    """
    lines = [
        line
        for line in CPLUSPLUS.sub("", header).splitlines()
        if not line.startswith("#") or CONSTANT.match(line)
    ]
    return "\n".join(lines).replace("VS_ATOMIC_U32", "uint32_t") + "\n"


def sources() -> list[str]:
    """The C files that go into the library: one for each header."""
    return [header[:-1] + "c" for header in HEADERS]


def digest(root: Path, names: list[str]) -> str:
    """Hash of files below root, names included."""
    found = hashlib.sha256()
    for name in names:
        found.update(f"{name}\n".encode() + (root / name).read_bytes())
    return found.hexdigest()


def ffibuilder() -> FFI:
    """Describes the extension; setup.py calls this through `cffi_modules`."""
    from cffi import FFI

    root = Path(__file__).resolve().parent.parent
    files = sorted([*HEADERS, *sources(), "c_src/build_ffi.py"])
    includes = "".join(f'#include "{Path(name).name}"\n' for name in HEADERS)
    names = "".join(f'"{name}\\n"\n' for name in files)
    builder = FFI()
    for header in HEADERS:
        builder.cdef(declarations((root / header).read_text()))
    builder.cdef(BUILT_FROM)
    builder.set_source(
        MODULE,
        f"{includes}\n"
        f"static const char *vs_built_from(void)\n{{\n    return {names};\n}}\n"
        f'static const char *vs_built_hash(void)\n{{\n    return "{digest(root, files)}";\n}}\n',
        sources=sources(),
        include_dirs=["c_src", "firmware_bridge"],
        extra_compile_args=FLAGS,
        depends=[name for name in files if name.endswith(".h")],
    )
    return builder
