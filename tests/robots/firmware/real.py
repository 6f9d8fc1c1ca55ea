"""Real firmware of the e-puck's microcontroller as a process of this machine.

Its sources stay where their authors have put them: `scripts/bench firmware --source FOLDER`
compiles them from a checkout that the user gives. Registers become variables, declared from the
names that the sources use; `process.c` brings timer and serial line, and `argos.c` what lies below
the firmware.

Not shown by it: the converter, I2C, the wake-up light, the line's speed, and `int` of 16 bits.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tty
from collections.abc import Iterable
from pathlib import Path
from typing import NoReturn

import numpy as np

from tests.conftest import require_tool
from tests.robots.rig import MS, Rig
from vsense.base.clock import host_ns
from vsense.modes.lab._microcontrollers import Actuation

OURS = Path(__file__).parent
SOURCE = "VSENSE_FIRMWARE"
"""The environment variable that names the user's checkout of argos3-epuck."""

PAGE = np.dtype(
    [
        ("stepped_ns", "<i8"), ("left_steps", "<i4"), ("right_steps", "<i4"), ("ring", "<i4"),
        ("resets", "<i4"), ("radio_sent", "<i4"), ("radio_inits", "<i4"), ("reset", "<i4"),
        ("battery_good", "<i4"), ("proximity", "<i4", 8), ("light", "<i4", 8),
    ],
    align=True,
)  # fmt: skip
"""`struct page` of page.h."""

PARTS = ("e_motors.c", "e_led.c", "e_agenda.c")
"""What is compiled with the firmware: its motor, LED and timer library."""

STILL_NS = 60 * MS
"""Slowest wheels make a step every 50 ms or so."""

HEADER = """\
#ifndef P30F6014A_H
#define P30F6014A_H
#include <stdlib.h>
#include <string.h>
#include <time.h>
void pic_word(const char *word);
{declarations}
/* `__asm__ volatile ("reset")` becomes a call, attributes of the other compiler nothing. */
#define __asm__
#define volatile(word) pic_word(word)
#define __attribute__(words)
#endif
"""


def registers(texts: Iterable[str]) -> str:
    """Declares as variables what these sources use of the chip: pins, registers and their bits."""
    fields: dict[str, set[str]] = {}
    words: set[str] = set()
    for text in texts:
        words |= set(re.findall(r"\b_(?:LAT|TRIS|R)[A-G]\d+\b", text))
        words |= set(re.findall(r"\b(?:T\dCON|TMR\d|PR\d)\b", text))
        for register, bit in re.findall(r"\b([A-Z][A-Z0-9]+bits)\.([A-Z0-9]+)\b", text):
            fields.setdefault(register, set()).add(bit)
    plain = [f"int {word};" for word in sorted(words)]
    structs = [
        f"struct {{ int {', '.join(sorted(bits))}; }} {register};"
        for register, bits in sorted(fields.items())
    ]
    return "\n".join((*plain, *structs))


def compile_argos(source: Path, folder: Path) -> Path:
    """Compiles IRIDIA's firmware from a checkout of argos3-epuck; gives the program.

    Raises:
        FileNotFoundError: the checkout lacks a file that is needed.
        RuntimeError: the compiler's words.
    """
    root = source / "firmware" / "firmware"
    library = root / "motor_led" / "advance_one_timer"
    theirs = [root / "firmware" / "epuck_firmware.c", *(library / part for part in PARTS)]
    headers = [root / "motor_led" / "e_epuck_ports.h"]
    texts = [path.read_text("latin-1") for path in (*theirs, *headers)]
    (folder / "p30F6014A.h").write_text(HEADER.format(declarations=registers(texts)))
    program = folder / "firmware"
    folders = (folder, OURS, root, root / "a_d/advance_ad_scan", root / "randb", root / "ircom")
    # The other compiler's C: common variables, functions that nobody has declared.
    flags = ["-std=gnu89", "-O0", "-fcommon", "-w", "-Dmain=firmware_main"]
    included = [word for path in folders for word in ("-I", str(path))]
    compiler = [require_tool("cc", "build-essential"), *flags, *included]
    objects = []
    for path in (*theirs, OURS / "argos.c", OURS / "process.c"):
        objects.append(str(folder / f"{path.stem}.o"))
        ours = ["-std=gnu99", "-Umain"] if path.name == "process.c" else []
        _run([*compiler, *ours, "-c", str(path), "-o", objects[-1]])
    _run([compiler[0], "-o", str(program), *objects])
    return program


def _run(command: list[str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(done.stderr)


class RealFirmware:
    """A microcontroller that runs a program of `compile_argos`, in place of `Microcontrollers`.

    Attributes:
        page: what it does and measures: a record of `PAGE`, shared with it.
    """

    due_ns: int | None = None

    def __init__(self, program: Path, folder: Path) -> None:
        """Powers it on."""
        file = folder / "page"
        file.write_bytes(bytes(PAGE.itemsize))
        self.page = np.memmap(file, PAGE, "r+", shape=())
        self.page["battery_good"] = 1
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        words = [str(program), str(self._master), str(file)]
        self._process = subprocess.Popen(words, pass_fds=[self._master])
        self.devices = [os.ttyname(self._slave)]
        self.bases = [f"argos:{self.devices[0]}"]

    def readable(self) -> list[int]:
        """None: it reads its line itself."""
        return []

    def receive(self, descriptors: Iterable[int], now_ns: int) -> None:
        """Nothing to do."""

    def advance(self, now_ns: int) -> list[Actuation]:
        """None: `page` says what it does."""
        return []

    def close(self) -> None:
        """Powers it off."""
        self._process.kill()
        self._process.wait()
        os.close(self._master)
        os.close(self._slave)


class FirmwareRig(Rig):
    """A rig whose base is real firmware."""

    def __init__(self, program: Path, firmware: RealFirmware) -> None:
        super().__init__(program)
        self.base.close()
        self.firmware = firmware
        self.base = firmware  # type: ignore[assignment]

    @property
    def moving(self) -> bool:
        """Whether its motors have made a step just now."""
        return host_ns() - int(self.firmware.page["stepped_ns"]) < STILL_NS

    def steps_s(self, duration_ns: int) -> tuple[float, float]:
        """Steps per second of both motors, counted by the firmware's motor library."""
        page = self.firmware.page
        began_ns, left, right = host_ns(), int(page["left_steps"]), int(page["right_steps"])
        self.live_for(duration_ns)
        elapsed_s = (host_ns() - began_ns) / 1e9
        return (
            (int(page["left_steps"]) - left) / elapsed_s,
            (int(page["right_steps"]) - right) / elapsed_s,
        )


def main() -> NoReturn:
    """Holds the daemon against the firmware of a checkout."""
    about = (__doc__ or "").partition("\n\n")[2]
    parser = argparse.ArgumentParser(prog="scripts/bench firmware", description=about)
    parser.add_argument(
        "--source", type=Path, required=True, metavar="FOLDER", help="a checkout of argos3-epuck"
    )
    source: Path = parser.parse_args().source
    needed = source / "firmware/firmware/firmware/epuck_firmware.c"
    if not needed.is_file():
        parser.error(f"{source}: no checkout of argos3-epuck: {needed} is not there")
    os.environ[SOURCE] = str(source.resolve())
    tests = OURS.parent / "test_real_firmware.py"
    command = [sys.executable, "-m", "pytest", "-v", "-s", "-m", "campaign", str(tests)]
    os.execv(command[0], command)


if __name__ == "__main__":
    main()
