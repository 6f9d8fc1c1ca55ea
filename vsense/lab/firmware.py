"""The programs of the lab's microcontrollers: the C code of `firmware_bridge/`, one per robot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsense.native import ffi, lib

LIGHT_RAW = 3000
"""What every light sensor reads, higher is darker: the lab's rooms are evenly lit."""

GROUND_RAW = 800
"""What every ground sensor reads, higher is brighter: the lab's floor is a light one."""

NEVER_US = 2**64 - 1
"""In C: nothing happens by itself."""


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of base that the lab can emulate.

    Attributes:
        prefix: what the program's functions in C begin with.
        arguments: for its init, after the struct.
        byte_ns: what one byte takes on its serial line; 0 if it is on a bus.
        count: the field that counts the commands that reached it.
    """

    prefix: str
    arguments: tuple[int, ...] = ()
    byte_ns: int = 0
    count: str = "packets"


PROGRAMS: dict[str, Kind] = {
    "argos": Kind("fw_argos", (), lib.EPUCK_ARGOS_BYTE_NS, "frames"),
    "asercom": Kind("fw_asercom", (lib.EPUCK_ASERCOM_EXTENSION,), 43403),
    "gctronic": Kind("fw_gctronic"),
    "york": Kind("fw_york", count="writes"),
}
"""By the names of `vsense.lab.bases`."""


class Outputs(NamedTuple):
    """What motors and LEDs do from `time_ns` on: speeds in steps/s, lit LEDs as bits."""

    time_ns: int
    left_steps_s: int
    right_steps_s: int
    leds: int


class Program:
    """One microcontroller's program and its state.

    Attributes:
        state: its C struct; tests make its faults there.
        proximity: (8,) int16, what its sensors measure, raw, ps0..ps7.
    """

    def __init__(self, kind: Kind) -> None:
        self.kind = kind
        self.state: Any = ffi.new(f"struct {kind.prefix} *")
        self._advance = getattr(lib, f"{kind.prefix}_advance")
        self._due_us = getattr(lib, f"{kind.prefix}_due_us")
        getattr(lib, f"{kind.prefix}_init")(self.state, *kind.arguments)
        inputs = self.state.body.inputs
        for i in range(8):
            inputs.light[i] = LIGHT_RAW
        for i in range(3):
            inputs.ground[i] = GROUND_RAW
        self.proximity: NDArray[np.int16] = np.frombuffer(ffi.buffer(inputs.prox), dtype=np.int16)

    def advance(self, now_ns: int) -> list[Outputs]:
        """Lets it live on to `now_ns`: what motors and LEDs did since the last call, in order."""
        done = []
        while self._advance(self.state, now_ns // 1000):
            body = self.state.body
            out = body.outputs
            done.append(
                Outputs(body.applied_us * 1000, out.left_steps_s, out.right_steps_s, out.leds)
            )
        return done

    def due_us(self) -> int:
        """When it has something to do again, `NEVER_US` if only a host can wake it."""
        due: int = self._due_us(self.state)
        return due
