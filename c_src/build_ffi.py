"""Builds the two C libraries behind Python: `vsense._native` and `vsense._kernels`.

The first is what robot and host share, with the microcontroller's end; the second is
`c_src/host/`, which only the host runs. The declarations that cffi needs are cut out of the real
headers, so nothing is typed twice. A library carries the names and the hash of the files it was
made from: `vsense/base/native.py` compares them with what it finds in a checkout.
"""

from __future__ import annotations

import hashlib
import re
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from cffi import FFI

ROOT = Path(__file__).resolve().parent.parent

FLAGS = ["-O2", "-g0", "-ffp-contract=off"]
"""Comes after Python's own flags: with its usual -O3 gcc unrolls the picture kernel's short loops
before it sees that they are vectors, and the kernel takes twice as long; what debuggers want would
be two thirds of the file. Multiplications and additions are fused where the source says so and
nowhere else, so that all machines agree."""

BUILT_FROM = """
/* What this library was built from: one file name a line, and their common hash. */
const char *vs_built_from(void);
const char *vs_built_hash(void);
"""

CPLUSPLUS = re.compile(r"^#ifdef __cplusplus\n.*?^#endif\n", re.MULTILINE | re.DOTALL)
CONSTANT = re.compile(r"#define\s+\w+\s+(0x[0-9A-Fa-f]+|\d+)\b")
COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
PROTOTYPE = re.compile(r"^\w[^;{}]*\([^;{}]*\);\n", re.MULTILINE)


class Library(NamedTuple):
    """One extension module.

    Attributes:
        module: its name.
        folders: where its C files are.
        headers: those that Python sees, each after those that it builds on.
        layouts: those of them whose structures only are seen: others embed them, or the functions
            are in what is loaded later (`vsense/robots/inprocess.py`).
        robot_only: sources in the folders that are no part of it.
        besides: further files that it depends on.
    """

    module: str
    folders: tuple[str, ...]
    headers: tuple[str, ...]
    layouts: tuple[str, ...] = ()
    robot_only: tuple[str, ...] = ()
    besides: tuple[str, ...] = ()

    def files(self, pattern: str) -> list[str]:
        """Names its files of a kind, internal headers included, in a fixed order."""
        found = [p for folder in self.folders for p in (ROOT / folder).glob(pattern)]
        return sorted(str(p.relative_to(ROOT)) for p in found if p.stem not in self.robot_only)

    def builder(self) -> FFI:
        """Describes the extension to setuptools."""
        from cffi import FFI

        files = sorted([*self.files("*.[ch]"), *self.besides, "c_src/build_ffi.py"])
        includes = "".join(f'#include "{Path(name).name}"\n' for name in self.headers)
        names = "".join(f'"{name}\\n"\n' for name in files)
        builder = FFI()
        for header in self.headers:
            builder.cdef(declarations((ROOT / header).read_text(), header not in self.layouts))
        builder.cdef(BUILT_FROM)
        builder.set_source(
            self.module,
            f"{includes}\n"
            f"static const char *vs_built_from(void)\n{{\n    return {names};\n}}\n"
            f"static const char *vs_built_hash(void)\n"
            f'{{\n    return "{digest(ROOT, files)}";\n}}\n',
            sources=self.files("*.c"),
            include_dirs=sorted({*self.folders, *(str(Path(h).parent) for h in self.headers)}),
            libraries=["m"],
            extra_compile_args=FLAGS,
            extra_link_args=["-s"],
            depends=[name for name in files if name.endswith(".h")],
        )
        return builder


NATIVE = Library(
    "vsense._native",
    folders=("c_src", "firmware_bridge"),
    headers=(
        "c_src/vs_err.h",
        "c_src/vs_tag.h",
        "c_src/vs_wire.h",
        "c_src/vs_table.h",
        "c_src/vs_shown.h",
        "c_src/vs_body.h",
        "c_src/vs_peer.h",
        "c_src/vs_clock.h",
        "c_src/vs_session.h",
        "c_src/epuck_argos.h",
        "c_src/epuck_asercom.h",
        "c_src/epuck_gctronic.h",
        "c_src/epuck_york.h",
        "c_src/epuck_wifi.h",
        "c_src/epuck_boards.h",
        "c_src/epuck_imu.h",
        "firmware_bridge/fw_watchdog.h",
        "firmware_bridge/fw_body.h",
        "firmware_bridge/fw_uart.h",
        "firmware_bridge/fw_i2c.h",
        "firmware_bridge/fw_argos.h",
        "firmware_bridge/fw_asercom.h",
        "firmware_bridge/fw_gctronic.h",
        "firmware_bridge/fw_york.h",
        "firmware_bridge/fw_wifi.h",
        "firmware_bridge/fw_wheels.h",
        "firmware_bridge/fw_boards.h",
        "firmware_bridge/fw_imu.h",
        "robot/inprocess.h",
    ),
    layouts=(
        "robot/inprocess.h",
        "firmware_bridge/fw_watchdog.h",
        "firmware_bridge/fw_body.h",
        "firmware_bridge/fw_uart.h",
    ),
    robot_only=("vs_posix", "vs_io", "vs_i2c", "vs_i2c_posix", "vs_format"),
    besides=("robot/inprocess.h",),
)

KERNELS = Library(
    "vsense._kernels",
    folders=("c_src/host",),
    headers=(
        "c_src/host/vs_crash.h",
        "c_src/host/vs_latest.h",
        "c_src/host/vs_view.h",
        "c_src/host/vs_search.h",
        "c_src/host/vs_markers.h",
        "c_src/host/vs_words.h",
        "c_src/host/vs_codes.h",
        "c_src/host/vs_rays.h",
        "c_src/host/vs_scene.h",
        "c_src/host/vs_light.h",
        "c_src/host/vs_proximity.h",
        "c_src/host/vs_floor.h",
        "c_src/host/vs_places.h",
        "c_src/host/vs_world.h",
        "c_src/host/vs_field.h",
        "c_src/host/vs_random.h",
        "c_src/host/vs_slip.h",
        "c_src/host/vs_leds.h",
        "c_src/host/vs_noticed.h",
        "c_src/host/vs_hearing.h",
        "c_src/host/vs_camera.h",
        "c_src/host/vs_physics.h",
        "c_src/host/vs_ring.h",
        "c_src/host/vs_sprites.h",
        "c_src/host/vs_cxx.h",
        "c_src/host/vs_sim.h",
    ),
    layouts=("c_src/host/vs_noticed.h",),
    besides=("c_src/vs_err.h",),
)


def declarations(header: str, functions: bool) -> str:
    """Cuts out of a header's text what cffi understands.

    Of the preprocessor only plain integer constants stay. An atomic field has the layout of a
    plain one on every machine that vsense runs on; only the C functions may touch it.

    Args:
        header: the text.
        functions: whether functions are to be seen.
    """
    lines = [
        line
        for line in COMMENT.sub("", CPLUSPLUS.sub("", header)).splitlines()
        if not line.startswith("#") or CONSTANT.match(line)
    ]
    text = "\n".join(lines).replace("_Atomic uint32_t", "uint32_t") + "\n"
    return text if functions else PROTOTYPE.sub("", text)


def digest(root: Path, names: list[str]) -> str:
    """Hash of files below root, names included."""
    found = hashlib.sha256()
    for name in names:
        found.update(f"{name}\n".encode() + (root / name).read_bytes())
    return found.hexdigest()


def native() -> FFI:
    """Describes `vsense._native`; setup.py calls this through `cffi_modules`."""
    return NATIVE.builder()


def kernels() -> FFI:
    """Describes `vsense._kernels`; likewise."""
    return KERNELS.builder()
