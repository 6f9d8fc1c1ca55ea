"""Every base's bytes, written from the tables in the sources by hand, without our C code.

The tables are those of `firmware_bridge/README.md`; what follows here is their independent encoder.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from functools import reduce
from operator import xor

RING_SIZES = {
    "extension": 20,
    **dict.fromkeys(("bluetooth", "bluetooth+ground", "epuck2", "epuck2+ground"), 16),
}
"""Bytes that asercom answers to 'N' and 'O'; an e-puck2's is `run_asercom2`.

Source: e-puck2_main-processor d2e0dbb src/main.c:214-218, 541-545, src/epuck1x/Asercom2.c:895-908.
"""

CLIFFS = {"bluetooth+ground": 2, "epuck2+ground": 1}
"""Values behind the three of the ground in the answer to 'M'. Source: e-puck-library 4cb85cb
Asercom.c:419-440; e-puck2_main-processor d2e0dbb src/epuck1x/Asercom2.c:874-889."""


def code(letter: str) -> int:
    """A binary command of asercom."""
    return 256 - ord(letter)


def asercom_poll(mode: str, left: int, right: int, leds: dict[int, int]) -> bytes:
    """Sets speeds and some LEDs, asks for everything, ends.

    An e-puck2 is asked for 'g' and 0x0D, too. Source: e-puck2_main-processor d2e0dbb
    src/epuck1x/Asercom2.c:612, 822.
    """
    packet = bytes([code("D")]) + struct.pack("<hh", left, right)
    for number, state in leds.items():
        packet += bytes([code("L"), number, state])
    letters = "NOQb" + ("g\x0d" if "epuck2" in mode else "")
    letters += ("M" if "ground" in mode else "") + "E"
    return packet + bytes(code(letter) for letter in letters) + b"\x00"


def asercom_reply(
    mode: str,
    prox: Sequence[int],
    light: Sequence[int],
    steps: tuple[int, int],
    battery: int,
    commanded: tuple[int, int],
    ground: Sequence[int] = (),
    rates: Sequence[int] = (0, 0, 0),
    distance: int = 0,
) -> bytes:
    """What comes back for that."""
    pad = bytes(RING_SIZES[mode] - 16)
    reply = struct.pack("<8h", *prox) + pad + struct.pack("<8h", *light) + pad
    reply += struct.pack("<HHH", *steps, battery)
    if "epuck2" in mode:
        reply += struct.pack("<3hH", *rates, distance)
    if ground:
        reply += struct.pack("<3H", *ground) + bytes(2 * CLIFFS[mode])
    return reply + struct.pack("<hh", *commanded)


def checked(packet: bytes) -> bytes:
    """With the XOR of all bytes behind it."""
    return packet + bytes([reduce(xor, packet, 0)])


def gctronic_actuators(
    left: int, right: int, leds: int, colors: Sequence[Sequence[int]] = ((0, 0, 0),) * 4
) -> bytes:
    """20 bytes: LED n of the ring is bit n; the odd ones are RGB, and lit red where no colour is.

    LED2, 4, 6 and 8 have red, green, blue at bytes 6, 9, 12 and 15. Source: e-puck2_main-processor
    517ef07 src/gumstix.c:226-229, the order of src/leds.h:22-28.
    """
    red = sum((leds >> (2 * i) & 1) << i for i in range(4))
    ring = [(100 * (leds >> (2 * i + 1) & 1), 0, 0) for i in range(4)]
    rgb = b"".join(bytes(own if any(own) else dull) for own, dull in zip(colors, ring))
    return checked(struct.pack("<hhBB", left, right, 0, red) + rgb + b"\x00")


def gctronic_sensors(
    prox: Sequence[int],
    light: Sequence[int],
    steps: tuple[int, int],
    volumes: Sequence[int] = (0, 0, 0, 0),
) -> bytes:
    """47 bytes: the remote control says nothing, the selector stands at 10.

    Source: e-puck2_main-processor 517ef07 src/gumstix.c:111-160 (messageProcessor).
    """
    rings = struct.pack("<16h4H", *prox, *light, *volumes)
    return checked(rings + bytes([10]) + struct.pack("<HH", *steps) + b"\x00")


def york_epuck2_read(value: int, size: int, count: int) -> bytes:
    """What an e-puck2 with York's map sends for `count` bytes of an answer of `size`.

    Source: e-puck2_main-processor fcb74b1 src/gumstix.c:126-354 (the answers' sizes),
    ChibiOS_ext/os/hal/ports/STM32/LLD/I2Cv1/i2c_ms_lld.c:1055-1081 (the last byte again).
    """
    answer = struct.pack("<H", value & 0xFFFF)[:size]
    return (answer + count * answer[-1:])[:count]


def york_write(register: int, value: int) -> bytes:
    """Register, low, high."""
    return struct.pack("<BH", register, value & 0xFFFF)


def rab_registers(data: Sequence[int], bearing_e4rad: int, range_raw: int) -> dict[int, int]:
    """What the range-and-bearing board's registers hold of a message."""
    high, low = struct.pack(">h", bearing_e4rad)
    far, near = struct.pack(">H", range_raw)
    return {2: data[0], 1: data[1], 11: data[2], 10: data[3], 3: high, 4: low, 5: far, 6: near}
