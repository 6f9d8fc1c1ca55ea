"""Real firmware of the e-puck's microcontroller as a process of this machine.

Its sources stay where their authors have put them: `scripts/bench firmware --source FOLDER`
compiles them from a checkout that the user gives. Registers become variables, declared from the
names that the sources use; `process.c` brings timer and serial line, and `argos.c`,
`asercom.c` and `york.c` what lies below the firmware.

Not shown by it: the converter, the wake-up light, a serial line's speed, and `int` of 16 bits.
"""

from __future__ import annotations

import argparse
import math
import os
import re
import socket
import subprocess
import sys
import tty
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, NoReturn

import numpy as np

from tests.conftest import require_tool
from tests.robots.rig import MS, Rig
from tests.robots.stopping import CANARY_NS
from vsense.base.clock import host_ns
from vsense.modes.lab._microcontrollers import Actuation
from vsense.robots.inprocess import AMBIENT_RAW

OURS = Path(__file__).parent
SOURCE = "VSENSE_FIRMWARE"
"""The environment variable that names the user's checkout."""

PAGE = np.dtype(
    [
        ("late_ns", "<i8"), ("stepped_ns", "<i8"),
        ("left_steps", "<i4"), ("right_steps", "<i4"), ("leds", "<i4"),
        ("resets", "<i4"), ("radio_sent", "<i4"), ("radio_inits", "<i4"), ("bus", "<i4"),
        ("reset", "<i4"), ("battery_good", "<i4"), ("proximity", "<i4", 8), ("light", "<i4", 8),
    ],
    align=True,
)  # fmt: skip
"""`struct page` of page.h."""

STILL_NS = 150 * MS
"""A machine that is busy may hold the process up for a while; its steps are made up for."""

HEADER = """\
#ifndef CHIP_H
#define CHIP_H
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
void pic_word(const char *word);
void delay_ms(int ms);
unsigned char *i2c_next(void);
{declarations}
#define I2CTRN (*i2c_next())
#define __delay_ms delay_ms
/* `__asm__ volatile ("reset")` becomes a call, attributes of the other compiler nothing. */
#define __asm__
#define volatile(word) pic_word(word)
#define __attribute__(words)
#endif
"""


@dataclass(frozen=True)
class Firmware:
    """A firmware that this machine can run.

    Attributes:
        name: of ours that brings what lies below it, `NAME.c`; also the kind of base.
        root: its sources, below the checkout.
        sources: what is compiled of them.
        folders: those in which its headers are, relative to `root`.
        headers: files of the other compiler that its sources include.
        timer_hz: steps of its motors are whole periods of this clock.
        dark: what the base takes for darkness of its light sensors.
        leds: those that it lights, bits 0-7 ring, 8 body, 9 front.
        has_battery_pin, counts_steps: whether it says so.
        options: of the daemon's base.
        spread: how far, relatively, its motors' steps may be from that.
        more: periods that a step takes beyond those that the firmware sets.
    """

    name: str
    root: str
    sources: tuple[str, ...]
    folders: tuple[str, ...]
    headers: tuple[str, ...]
    timer_hz: float
    dark: int
    leds: int = 0x3FF
    has_battery_pin: bool = True
    counts_steps: bool = True
    options: str = ""
    spread: float = 0.03
    more: int = 0

    @property
    def is_on_bus(self) -> bool:
        """Whether its line is an I2C bus."""
        return self.name == "york"

    def is_held_up(self) -> bool:
        """Whether rig or firmware was late since the last call: what was measured says nothing."""
        page = self.firmware.page
        late_ns = max(self.held_up_ns, int(page["late_ns"]))
        self.held_up_ns = page["late_ns"] = 0
        return late_ns > CANARY_NS

    def steps_s(self, command: int) -> float:
        """Steps per second that its motors make for a command other than 0."""
        return math.copysign(
            self.timer_hz / (int(self.timer_hz / abs(command)) + self.more), command
        )


FIRMWARES = (
    Firmware(
        "argos",
        "firmware/firmware",
        (
            "firmware/epuck_firmware.c",
            *(f"motor_led/advance_one_timer/e_{part}.c" for part in ("motors", "led", "agenda")),
        ),
        (".", "motor_led", "a_d/advance_ad_scan", "randb", "ircom"),
        ("p30F6014A.h",),
        timer_hz=10_000,
        dark=4096,
        counts_steps=False,
    ),
    Firmware(
        "asercom",
        ".",
        (
            "program/DemoGCtronic-complete/Asercom.c",
            "library/a_d/advance_ad_scan/e_prox.c",
            *(
                f"library/motor_led/advance_one_timer/e_{part}.c"
                for part in ("motors", "led", "agenda")
            ),
        ),
        ("program/DemoGCtronic-complete", "library", "library/motor_led"),
        ("p30F6014A.h",),
        timer_hz=10_000,
        dark=4095,
        leds=0xFF,
        options=",mode=extension",
        # Below 601 steps/s each repetition of a speed begins a step's pause again.
        spread=0.1,
    ),
    Firmware(
        "york",
        "pi-puck-e-puck1.X",
        ("main.c", "i2c_slave.c", "motors.c", "leds.c", "ir_sensors.c"),
        (".",),
        ("xc.h", "i2c.h", "libpic30.h"),
        timer_hz=14_745_600 / 256,
        dark=4095,
        has_battery_pin=False,
        more=1,
    ),
)


def firmware_of(source: Path) -> Firmware | None:
    """The firmware whose checkout this is; None: of none that is known."""
    return next((f for f in FIRMWARES if (source / f.root / f.sources[0]).is_file()), None)


def registers(texts: Iterable[str]) -> str:
    """Declares as variables what these sources use of the chip: pins, registers and their bits."""
    fields: dict[str, set[str]] = {}
    pins: set[str] = set()
    words: set[str] = set()
    constants: set[str] = set()
    for text in texts:
        pins |= set(re.findall(r"\b_(?:LAT|TRIS|R)[A-G]\d+\b", text))
        words |= set(
            re.findall(r"\b(?:T\dCON|TMR\d|PR\d|IFS\d|I2C(?:CON|ADD|RCV)|_SI2CIF)\b", text)
        )
        constants |= set(re.findall(r"\bI2C_[A-Z0-9_]+\b", text))
        for register, bit in re.findall(r"\b([A-Z][A-Z0-9]+bits)\.([A-Z0-9_]+)\b", text):
            fields.setdefault(register, set()).add(bit)
    bits = "".join(f" unsigned {pin} : 1;" for pin in sorted(pins))
    structs = [
        f"struct {{ int {', '.join(sorted(names))}; }} {register};"
        for register, names in sorted(fields.items())
    ]
    return "\n".join(
        (
            *(f"int {word};" for word in sorted(words)),
            f"struct {{{bits} }} pins;",
            *(f"#define {pin} pins.{pin}" for pin in sorted(pins)),
            *structs,
            *(f"#define {name} 0xffff" for name in sorted(constants - {"I2C_SLAVE_H"})),
        )
    )


def compiled(firmware: Firmware, source: Path, folder: Path) -> Path:
    """Compiles a firmware from its checkout into a folder; gives the program.

    Raises:
        RuntimeError: the compiler's words.
    """
    root = source / firmware.root
    used = [root / name for name in firmware.sources]
    used += [path for name in firmware.folders for path in (root / name).glob("*.h")]
    texts = [path.read_text("latin-1") for path in used]
    header = HEADER.format(declarations=registers(texts))
    for name in firmware.headers:
        (folder / name).write_text(header)
    # The other compiler's C: common variables, functions that nobody has declared.
    flags = ["-std=gnu89", "-O0", "-fcommon", "-w", "-Dmain=firmware_main"]
    folders = (folder, OURS, *(root / name for name in firmware.folders))
    included = [word for path in folders for word in ("-I", str(path))]
    compiler = require_tool("cc", "build-essential")
    objects = []
    for path in (
        *(root / name for name in firmware.sources),
        *(OURS / f"{firmware.name}.c", OURS / "process.c"),
    ):
        ours = ["-std=gnu99"] if path.parent == OURS else []
        ours += ["-Umain"] if path.name == "process.c" else []
        objects.append(str(folder / f"{path.stem}.o"))
        _run([compiler, *flags, *ours, *included, "-c", str(path), "-o", objects[-1]])
    program = folder / "firmware"
    link = [compiler, "-o", str(program), *objects]
    done = subprocess.run(link, capture_output=True, text=True, check=False)
    missing = set(re.findall(r"undefined reference to `(\w+)'", done.stderr))
    if not missing:
        return program
    stubs = folder / "stubs.c"
    stubs.write_text("".join(f"int {name}() {{ return 0; }}\n" for name in sorted(missing)))
    _run([*link, "-w", str(stubs)])
    return program


def _run(command: list[str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(done.stderr)


class RealFirmware:
    """A microcontroller that runs a program of `compiled`, in place of `Microcontrollers`.

    Attributes:
        page: what it does and measures: a record of `PAGE`, shared with it.
    """

    due_ns: int | None = None

    def __init__(self, firmware: Firmware, program: Path, folder: Path) -> None:
        """Powers one on that was compiled to a program."""
        file = folder / "page"
        file.write_bytes(bytes(PAGE.itemsize))
        self.page = np.memmap(file, PAGE, "r+", shape=())
        self.page["battery_good"] = 1
        self.page["light"][:] = AMBIENT_RAW
        self._ends: list[IO[Any] | socket.socket] = []
        end = self._bus(folder) if firmware.is_on_bus else self._terminal()
        words = [str(program), str(end), str(file)]
        self._process = subprocess.Popen(words, pass_fds=[end])
        self.bases = [f"{firmware.name}:{self.devices[0]}{firmware.options}"]

    def _bus(self, folder: Path) -> int:
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._ends.append(listener)
        listener.bind(str(folder / "bus"))
        listener.listen()
        listener.setblocking(False)
        self.devices = [f"unix:{folder / 'bus'}"]
        return listener.fileno()

    def _terminal(self) -> int:
        master, slave = os.openpty()
        self._ends += [os.fdopen(master, "rb"), os.fdopen(slave, "rb")]
        tty.setraw(slave)
        self.devices = [os.ttyname(slave)]
        return master

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
        for end in self._ends:
            end.close()


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

    def is_held_up(self) -> bool:
        """Whether rig or firmware was late since the last call: what was measured says nothing."""
        page = self.firmware.page
        late_ns = max(self.held_up_ns, int(page["late_ns"]))
        self.held_up_ns = page["late_ns"] = 0
        return late_ns > CANARY_NS

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
        "--source",
        type=Path,
        required=True,
        metavar="FOLDER",
        help="a checkout of argos3-epuck (IRIDIA), e-puck-library (GCtronic) or pi-puck-e-puck1",
    )
    source: Path = parser.parse_args().source
    if firmware_of(source) is None:
        needed = " or ".join(f"{f.root}/{f.sources[0]}" for f in FIRMWARES)
        parser.error(f"{source}: no checkout of a firmware that is known: expected {needed} in it")
    os.environ[SOURCE] = str(source.resolve())
    tests = OURS.parent / "test_real_firmware.py"
    command = [sys.executable, "-m", "pytest", "-v", "-s", "-m", "campaign", str(tests)]
    os.execv(command[0], command)


if __name__ == "__main__":
    main()
