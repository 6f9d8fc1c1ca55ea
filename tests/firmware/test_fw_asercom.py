"""The emulated advanced sercom against a model of its parser, written from the sources by hand."""

from __future__ import annotations

from collections.abc import Generator
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.firmware import tables
from tests.firmware.tables import code
from vsense.base.native import ffi, lib

VERSION = b"v,Version 1.2.2 August 2008 GCtronic\r\nHW version: 1\r\n"
MODES = {"extension": 0, "bluetooth": 1, "bluetooth+ground": 2}
EPUCK2 = {"epuck2": 3, "epuck2+ground": 4}
SLOW_US = 100_000
"""Longer than any answer takes: whatever a byte causes is over."""


class Pic:
    """A microcontroller and a clock in us."""

    def __init__(self, mode: str = "extension") -> None:
        self.fw: Any = ffi.new("struct fw_asercom *")
        lib.fw_asercom_init(self.fw, {**MODES, **EPUCK2}[mode])
        self.now_us = 1000

    def say(self, data: bytes) -> None:
        assert lib.fw_asercom_receive(self.fw, data, len(data), self.now_us) == len(data)

    def live(self, duration_us: int) -> bytes:
        """What it sent until then."""
        self.now_us += duration_us
        while lib.fw_asercom_advance(self.fw, self.now_us):
            pass
        buf = ffi.new("uint8_t[1024]")
        return bytes(ffi.buffer(buf, lib.fw_asercom_transmit(self.fw, buf, 1024, self.now_us)))

    def ask(self, data: bytes) -> bytes:
        self.say(data)
        return self.live(SLOW_US)

    @property
    def wheels(self) -> tuple[int, int]:
        out = self.fw.body.outputs
        return out.left_steps_s, out.right_steps_s


def signed(low: int, high: int) -> int:
    return int.from_bytes(bytes([low, high]), "little", signed=True)


SIZES = {"a": 6, "A": 12, "b": 2, "E": 4, "g": 6, "N": 16, "O": 16, "Q": 4, "t": 1, "u": 6}
"""Bytes that the binary commands answer over Bluetooth."""


class Model:
    """The parser as a generator: yields to ask for a byte."""

    def __init__(self, mode: str) -> None:
        self.extension = mode == "extension"
        self.ground = {"extension": 0, "bluetooth": 6, "bluetooth+ground": 10}[mode]
        self.speeds = [0, 0]
        self.lengths: list[int] = []
        self.reader = self._run()
        next(self.reader)

    def feed(self, data: bytes) -> None:
        for byte in data:
            self.reader.send(byte)

    def _payload(self, letter: str) -> int:
        fixed = {"D": 4, "P": 4, "L": 2}
        return fixed.get(letter, 0 if self.extension else {"W": 3, "w": 35}.get(letter, 0))

    def _answer(self, letter: str) -> int:
        if letter == "M":
            return self.ground
        more = 4 if self.extension and letter in ("N", "O") else 0
        return SIZES.get(letter, 0) + more

    def _run(self) -> Generator[None, int, None]:
        while True:
            byte = yield
            if byte >= 0x80:
                length = 0
                while True:
                    letter = chr(256 - byte) if byte > 0x80 else ""
                    payload = []
                    for _ in range(self._payload(letter)):
                        payload.append((yield))
                    if letter == "D":
                        self.speeds = [signed(*payload[:2]), signed(*payload[2:])]
                    length += self._answer(letter)
                    byte = yield
                    if byte == 0:
                        break
                if length:
                    self.lengths.append(length)
            elif byte:
                while byte in b"\r\n":
                    byte = yield
                line = bytes([byte])
                while byte not in b"\r\n":
                    byte = yield
                    line += bytes([byte])
                self._obey(line[:-1])

    def _obey(self, line: bytes) -> None:
        letter = chr(line[0]) if line[0] in b"bg" else chr(line[0]).upper()
        if self.extension and letter in "IJMWYZ":
            return
        if letter == "V":
            self.lengths.append(len(VERSION))
        elif letter in "bg" or (letter.isascii() and letter.isupper() and letter not in "GX"):
            self.lengths.append(3)
        else:
            self.lengths.append(len("z,Command not found\r\n"))
        if letter == "S":
            self.speeds = [0, 0]


LETTERS = "abADELMNOPQgtuwW"
pieces = st.one_of(
    st.binary(min_size=1, max_size=6),
    st.sampled_from([bytes([code(letter)]) for letter in LETTERS]),
    st.sampled_from([b"\0", b"\r", b"\n", b"V\r", b"S\n", b"E\r", b"q", b"\0\0\0"]),
)
streams = st.lists(pieces, max_size=14).map(b"".join).filter(lambda data: len(data) <= 60)


def is_text_of_speeds(data: bytes) -> bool:
    """Lines that begin with D or R do what the model leaves out: scanf, and a reset."""
    return any(letter in data for letter in b"DdRr")


@settings(max_examples=300)
@given(st.sampled_from(list(MODES)), streams.filter(lambda data: not is_text_of_speeds(data)))
def test_parser_does_what_the_sources_say(mode: str, data: bytes) -> None:
    pic, model = Pic(mode), Model(mode)
    sent = []
    for byte in data:
        answer = pic.ask(bytes([byte]))
        if answer:
            sent.append(len(answer))
        model.feed(bytes([byte]))
    assert sent == [min(length, lib.FW_ASERCOM_REPLY_MAX) for length in model.lengths]
    assert pic.wheels == tuple(max(-1000, min(1000, speed)) for speed in model.speeds)


@settings(max_examples=300)
@given(st.sampled_from(list(MODES)), streams)
def test_from_any_prefix_the_resync_string_leads_to_idle(mode: str, data: bytes) -> None:
    pic = Pic(mode)
    for byte in data:
        pic.ask(bytes([byte]))
    answer = pic.ask(bytes(lib.epuck_asercom_resync)) + pic.live(2 * SLOW_US)
    assert answer.endswith(VERSION) or b"WELCOME" in answer
    assert pic.fw.state == lib.FW_ASERCOM_IDLE
    answer = pic.ask(tables.asercom_poll(mode, 400, -400, {}))
    assert pic.wheels == (400, -400)
    assert answer[-4:] == bytes.fromhex("900170FE")


@given(st.lists(streams, max_size=5), st.data())
def test_any_pieces_at_any_pace_give_the_same(parts: list[bytes], data: st.DataObject) -> None:
    """How often its owner looks must not change what the microcontroller does."""
    lazy, busy = Pic(), Pic()
    for part in parts:
        pause_us = data.draw(st.integers(0, 20_000))
        lazy.say(part)
        busy.say(part)
        whole = lazy.live(pause_us)
        end_us = busy.now_us + pause_us
        looks = data.draw(st.integers(1, 12))
        pieces_sent = b""
        for look in range(looks):
            pieces_sent += busy.live((end_us - busy.now_us) // (looks - look))
        assert pieces_sent == whole
    assert lazy.live(900_000) == busy.live(900_000)
    assert lazy.wheels == busy.wheels
    assert lazy.fw.body.outputs.leds == busy.fw.body.outputs.leds


def test_cr_lf_swallows_the_next_binary_byte() -> None:
    pic = Pic()
    assert pic.ask(b"V\r\n").endswith(VERSION)
    assert pic.ask(tables.asercom_poll("extension", 400, -400, {})) == b""
    assert pic.wheels == (0, 0)


def test_commands_act_before_the_packet_ends() -> None:
    pic = Pic()
    assert pic.ask(bytes([code("D"), 0x90, 1, 0x70, 0xFE])) == b""
    assert pic.wheels == (400, -400)


def test_leds_are_set_cleared_toggled_and_all_at_once() -> None:
    def led(number: int, state: int) -> bytes:
        return bytes([code("L"), number, state, 0])

    pic = Pic("bluetooth")
    pic.ask(led(0, 1) + led(8, 1) + led(9, 2))
    assert pic.fw.body.outputs.leds == 0b11_0000_0001
    pic.ask(led(9, 2) + led(8, 0) + led(77, 1))
    assert pic.fw.body.outputs.leds == 0xFF
    other = Pic("extension")
    other.ask(led(8, 1) + led(9, 1) + led(3, 1))
    assert other.fw.body.outputs.leds == 8, "body and front are taken, and ignored"


def test_ascii_speeds_are_scanned_as_scanf_does() -> None:
    pic = Pic()
    assert pic.ask(b"D,100,-200\r") == b"d\r\n"
    assert pic.wheels == (100, -200)
    pic.ask(b"d,7\n")
    assert pic.wheels == (7, -200), "what is missing leaves the old value"
    pic.ask(b"S\r")
    assert pic.wheels == (0, 0)


def test_power_on_resets_twice_and_greets_twice() -> None:
    pic = Pic()
    pic.ask(tables.asercom_poll("extension", 100, 100, {0: 1}))
    lib.fw_asercom_reset(pic.fw, 1, pic.now_us)
    assert pic.wheels == (0, 0) and pic.fw.body.outputs.leds == 0
    text = pic.live(lib.FW_ASERCOM_BOOT_US + 20_000)
    assert text.startswith(b"\x0c\x07WELCOME") and text.endswith(b"for help\r\n")
    again = pic.live(2 * lib.FW_ASERCOM_BOOT_US)
    assert again == text
    assert pic.live(SLOW_US) == b"" and pic.fw.state == lib.FW_ASERCOM_IDLE


def test_reset_by_command() -> None:
    pic = Pic()
    assert pic.ask(b"R\r").startswith(b"r\r\n")
    assert b"WELCOME" in pic.live(2 * SLOW_US)


@pytest.mark.parametrize("mode", MODES)
def test_its_answer_is_what_its_sensors_measure(mode: str) -> None:
    pic = Pic(mode)
    inputs = pic.fw.body.inputs
    inputs.prox, inputs.light = list(range(8)), list(range(3000, 3008))
    inputs.ground, inputs.battery_mv = [700, 800, 900], 3400
    ground = (700, 800, 900) if "ground" in mode else ()
    answer = pic.ask(tables.asercom_poll(mode, 0, 0, {}))
    wanted = tables.asercom_reply(mode, range(8), range(3000, 3008), (0, 0), 2070, (0, 0), ground)
    assert answer == wanted


@pytest.mark.parametrize("mode", EPUCK2)
def test_an_epuck2_knows_its_gyroscope_and_its_distance(mode: str) -> None:
    """Source of the battery's value: `test_asercom_battery_of_an_epuck2`."""
    pic = Pic(mode)
    inputs = pic.fw.body.inputs
    inputs.prox, inputs.light, inputs.battery_mv = list(range(8)), list(range(3000, 3008)), 5000
    inputs.ground, inputs.rates, inputs.distance_mm = [700, 800, 900], [-1, 32767, 5], 8190
    ground = (700, 800, 900) if "ground" in mode else ()
    said = (range(8), range(3000, 3008), (0, 0), 4096, (0, 0), ground, (-1, 32767, 5), 8190)
    assert pic.ask(tables.asercom_poll(mode, 0, 0, {})) == tables.asercom_reply(mode, *said)
    assert Pic().ask(bytes([code("\x0d"), code("g"), 0])) == bytes(6), "an e-puck knows no distance"


def test_counters_count_what_the_motors_really_do() -> None:
    """900 steps/s are 10000 / floor(10000 / 900) = 909. Source: epuck.md 1.6."""
    pic = Pic()
    pic.ask(tables.asercom_poll("extension", 900, -100, {}))
    before = pic.ask(bytes([code("Q"), 0]))
    pic.live(10_000_000 - SLOW_US)
    after = pic.ask(bytes([code("Q"), 0]))
    left, right = (signed(*after[i : i + 2]) - signed(*before[i : i + 2]) for i in (0, 2))
    assert (left, right) == (9091, -1000) or (left, right) == (9090, -1000)


def test_watchdog_stops_a_host_that_falls_silent() -> None:
    pic = Pic()
    pic.fw.body.watchdog_us = 500_000
    pic.ask(tables.asercom_poll("extension", 300, 300, {}))
    applied_us = pic.fw.body.applied_us
    pic.live(499_000 - SLOW_US)
    assert pic.wheels == (300, 300)
    assert lib.fw_asercom_due_us(pic.fw) == applied_us + 500_000
    pic.live(2_000)
    assert pic.wheels == (0, 0) and pic.fw.body.stops == 1
    answer = pic.ask(bytes([code("E"), 0]))
    assert answer == bytes(4), "it says that it stands"
    pic.ask(tables.asercom_poll("extension", 300, 300, {}))
    assert pic.wheels == (300, 300)
