"""The microcontroller's end, as its emulator drives it: states, pace, and the real one's quirks."""

from __future__ import annotations

import struct
import subprocess
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.conftest import require_tool
from tests.rigs.places import ROOT
from vsense.base.native import ffi, lib

BYTE_NS: int = lib.EPUCK_ARGOS_BYTE_NS
BURST: int = lib.EPUCK_ARGOS_SENSOR_LEN
NEVER_US = 2**64 - 1


def frame(
    left: int = 0, right: int = 0, ring: int = 0, other: int = 0, reset: bytes = b"N"
) -> bytes:
    """An actuator frame, written from the original's struct."""
    return struct.pack("<hhHBBBBcx", left, right, 0, ring, other, 0, 0, reset)


def sensor_frame(
    prox: list[int],
    light: list[int],
    battery: int,
    acceleration: list[int],
    micro: list[int],
    received: int = 0,
) -> bytes:
    """A sensor frame, written from the original's struct.

    Source: argos3-epuck 66cb8d9, firmware/firmware/real_epuck_base.h:48-72 (BaseSensorState,
    16-bit words, `Real` a 4-byte float), little-endian as send_data has it in memory.
    """
    rab = struct.pack("<HHf", 0, 0, 0.0)
    own = struct.pack("<8hH3h4h8h", *prox, battery, *acceleration, *micro, 0, *light)
    ircom = struct.pack("<HBxHff", 0, 0, 0, 0.0, 0.0)
    return rab + own + struct.pack("<H", received) + ircom


class Pic:
    """A microcontroller and a clock in us."""

    def __init__(self) -> None:
        self.fw: Any = ffi.new("struct fw_argos *")
        lib.fw_argos_init(self.fw)
        self.now_us = 1000

    def say(self, data: bytes) -> None:
        assert lib.fw_argos_receive(self.fw, data, len(data), self.now_us) == len(data)

    def live(self, duration_us: int) -> bytes:
        """What it sent until then."""
        self.now_us += duration_us
        while lib.fw_argos_advance(self.fw, self.now_us):
            pass
        buf = ffi.new("uint8_t[1024]")
        return bytes(ffi.buffer(buf, lib.fw_argos_transmit(self.fw, buf, 1024, self.now_us)))

    def exchange(self, data: bytes) -> bytes:
        self.say(data)
        return self.live(20_000)

    def wake(self, config: bytes = bytes(4)) -> bytes:
        """Greets it; it looks for that between two steps of its running light only."""
        self.say(b"\x01" + config)
        return self.live(lib.FW_ARGOS_BLINK_US + 20_000)

    @property
    def outputs(self) -> tuple[int, int, int]:
        out = self.fw.body.outputs
        return out.left_steps_s, out.right_steps_s, out.leds


@pytest.fixture
def pic() -> Pic:
    """A microcontroller that waits for a frame."""
    one = Pic()
    assert len(one.wake()) == BURST
    return one


def test_power_on_waits_for_wake_up_and_configuration() -> None:
    pic = Pic()
    assert pic.live(1_000_000) == b""
    for byte in (b"\x01", b"a", b"b", b"c"):
        assert pic.exchange(byte) == b""
    pic.live(lib.FW_ARGOS_BLINK_US)
    assert len(pic.exchange(b"d")) == BURST
    assert pic.outputs == (0, 0, 0)


def test_frame_is_applied_then_answered(pic: Pic) -> None:
    pic.fw.body.inputs.prox = list(range(100, 108))
    pic.fw.body.inputs.light = list(range(3000, 3008))
    pic.fw.body.inputs.battery_mv = 3399
    burst = pic.exchange(frame(500, -500, 0x81, 0x03))
    assert pic.outputs == (500, -500, 0x81 | lib.EPUCK_ARGOS_LED_BODY | lib.EPUCK_ARGOS_LED_FRONT)
    assert struct.unpack_from("<8h", burst, 8) == tuple(range(100, 108))
    assert struct.unpack_from("<H", burst, 24) == (0,)
    assert struct.unpack_from("<8h", burst, 40) == tuple(range(3000, 3008))
    zeros = burst[:8] + burst[26:40] + burst[56:]
    assert zeros == bytes(len(zeros))


def test_bit_0_is_the_front_led_and_bit_1_the_body(pic: Pic) -> None:
    pic.exchange(frame(other=1))
    assert pic.outputs[2] == lib.EPUCK_ARGOS_LED_FRONT
    pic.exchange(frame(other=2))
    assert pic.outputs[2] == lib.EPUCK_ARGOS_LED_BODY


def test_battery_pin_is_active_low(pic: Pic) -> None:
    """`Battery_LOW` is the pin as it stands, and the pin is 0 below 3.4 V.

    Source: argos3-epuck 66cb8d9, firmware/firmware: firmware/epuck_firmware.c:128 (send_data),
    motor_led/e_epuck_ports.h:264-265, battery_level/battery.c:280-294 (drives on while it is 1).
    """
    for battery_mv, pin in ((3400, 1), (3399, 0)):
        pic.fw.body.inputs.battery_mv = battery_mv
        assert struct.unpack_from("<H", pic.exchange(frame()), 24) == (pin,)


def test_accelerometer_and_microphones_of_a_firmware_that_reads_them(pic: Pic) -> None:
    """Accel is at 26 and Micro at 32; the public firmware has both commented out.

    Source: argos3-epuck 66cb8d9, firmware/firmware: real_epuck_base.h:62-72,
    firmware/epuck_firmware.c:129-140.
    """
    pic.fw.body.inputs.acceleration = [2048, -7, 2848]
    pic.fw.body.inputs.microphones = [1990, 2000, 2010, 77]
    burst = pic.exchange(frame())
    assert burst == sensor_frame([0] * 8, [0] * 8, 1, [2048, -7, 2848], [1990, 2000, 2010])


def test_a_frame_after_a_reset_is_the_configuration(pic: Pic) -> None:
    """Its own range-and-bearing stays on until 'R', wake-up and zeros.

    Source: argos3-epuck 66cb8d9, firmware/firmware: firmware/epuck_firmware.c:87-117
    (receive_sensors_configuration), 146-159 (what it hears is sent), 279-315 (main);
    real_epuck_base.h:43-47 (RBRange, RBEnabled, two bytes of padding).
    """
    pic.fw.rab_hears = 1
    lib.fw_argos_reset(pic.fw, pic.now_us)
    pic.say(frame(0x1234, 0x5678))
    burst = pic.live(lib.FW_ARGOS_BLINK_US + 20_000)
    assert bytes(pic.fw.config) == b"\x12\x78\x56\x00"
    assert len(burst) == BURST and struct.unpack_from("<H", burst, 56) == (1,)
    pic.exchange(bytes(5))
    assert pic.exchange(frame(reset=b"R")) == b""
    burst = pic.wake()
    assert bytes(pic.fw.config) == bytes(4) and burst[56:58] == bytes(2)


def test_it_looks_for_the_wake_up_byte_between_two_steps_of_its_light(pic: Pic) -> None:
    """Source: argos3-epuck 66cb8d9, firmware/firmware/firmware/epuck_firmware.c:279-292."""
    pic.exchange(frame(reset=b"R"))
    pic.say(bytes(5))
    assert pic.live(lib.FW_ARGOS_BLINK_US - 21_000) == b""
    assert len(pic.live(21_000)) == BURST


@given(st.integers(-(2**15), 2**15 - 1), st.integers(-(2**15), 2**15 - 1))
def test_motor_library_clamps(left: int, right: int) -> None:
    pic = Pic()
    pic.wake()
    pic.exchange(frame(left, right))
    assert pic.outputs[:2] == (max(-1000, min(1000, left)), max(-1000, min(1000, right)))


def test_leds_are_toggled_by_difference_not_set(pic: Pic) -> None:
    pic.exchange(frame(ring=0x0F))
    pic.exchange(frame(ring=0x3C))
    assert pic.outputs[2] == 0x3C
    pic.exchange(frame(ring=0x3C, reset=b"R"))
    assert pic.outputs[2] == 0, "waiting for the wake-up byte it puts the ring out"
    pic.wake()
    pic.exchange(frame())
    assert pic.outputs[2] == 0x3C, "and the next difference inverts it"


def test_reset_applies_the_frame_and_answers_nothing(pic: Pic) -> None:
    assert pic.exchange(frame(300, 300, reset=b"R")) == b""
    assert pic.outputs == (300, 300, 0)
    assert pic.fw.state == lib.FW_ARGOS_WAKE
    assert len(pic.wake()) == BURST


def test_both_directions_keep_the_lines_pace(pic: Pic) -> None:
    start_us = pic.now_us
    pic.say(frame(1, 1))
    last_in_us = start_us + 12 * BYTE_NS // 1000
    assert pic.live(last_in_us - start_us) == b"" and pic.fw.frames == 0
    assert len(pic.live(1)) == 0 and pic.fw.frames == 1
    assert pic.fw.body.applied_us == last_in_us
    got = b""
    for count in range(1, BURST + 1):
        due_us = (12 * BYTE_NS + count * BYTE_NS) // 1000 + start_us + 1
        got += pic.live(due_us - pic.now_us)
        assert len(got) == count


def test_due_says_when_it_pays_to_look_again(pic: Pic) -> None:
    assert lib.fw_argos_due_us(pic.fw) == NEVER_US
    pic.say(frame())
    pic.live(lib.fw_argos_due_us(pic.fw) - pic.now_us)
    assert pic.fw.frames == 1
    assert len(pic.live(lib.fw_argos_due_us(pic.fw) - pic.now_us)) == BURST
    assert lib.fw_argos_due_us(pic.fw) == NEVER_US


def test_bytes_during_the_answer_wait_in_the_ring(pic: Pic) -> None:
    pic.say(frame(10, 10) + frame(20, 20))
    assert len(pic.live(7350)) == BURST
    assert pic.outputs[:2] == (20, 20)
    assert pic.fw.uart.overlapped == 12


def test_ring_without_overflow_test_loses_everything(pic: Pic) -> None:
    pic.say(frame(10, 10) + bytes(64))
    assert len(pic.live(100_000)) == BURST
    assert (pic.fw.uart.overlapped, pic.fw.uart.overflowed, pic.fw.got) == (64, 64, 0)


def test_answers_that_nobody_takes_are_counted(pic: Pic) -> None:
    """A line of 256 bytes holds three bursts and 40 bytes of the fourth."""
    for _ in range(4):
        pic.say(frame())
        pic.now_us += 20_000
        while lib.fw_argos_advance(pic.fw, pic.now_us):
            pass
    assert pic.fw.uart.unsent == 4 * BURST - lib.FW_LINE_CAPACITY


def test_ircom_word_delays_the_answer(pic: Pic) -> None:
    data = bytearray(frame(10, 10))
    data[8] = 1
    assert pic.exchange(bytes(data)) == b""
    assert len(pic.live(lib.FW_ARGOS_IRCOM_US)) == BURST


def test_line_that_is_full_takes_no_more(pic: Pic) -> None:
    data = bytes(300)
    assert lib.fw_argos_receive(pic.fw, data, len(data), pic.now_us) == lib.FW_LINE_CAPACITY


@given(st.lists(st.binary(max_size=40), max_size=12), st.data())
def test_any_bytes_in_any_pieces_at_any_pace_give_the_same_frames(
    pieces: list[bytes], data: st.DataObject
) -> None:
    """How often its owner looks must not change what the microcontroller does."""
    lazy, busy = Pic(), Pic()
    for piece in pieces:
        pause_us = data.draw(st.integers(0, 20_000))
        lazy.say(piece)
        busy.say(piece)
        got = lazy.live(pause_us)
        looked = data.draw(st.integers(1, 20))
        end_us = busy.now_us + pause_us
        parts = b""
        for look in range(looked):
            parts += busy.live((end_us - busy.now_us) // (looked - look))
        assert parts == got
    assert lazy.live(500_000) == busy.live(500_000)
    for name in ("frames", "got", "state"):
        assert getattr(lazy.fw, name) == getattr(busy.fw, name)
    for name in ("overlapped", "overflowed"):
        assert getattr(lazy.fw.uart, name) == getattr(busy.fw.uart, name)
    assert lazy.fw.body.applied_us == busy.fw.body.applied_us
    assert lazy.outputs == busy.outputs


@given(st.binary(min_size=12, max_size=12))
def test_actuator_frame_read_and_written_is_the_same(data: bytes) -> None:
    fields = ffi.new("struct epuck_argos_actuators *")
    lib.epuck_argos_get_actuators(data, fields)
    out = ffi.new("uint8_t[12]")
    lib.epuck_argos_put_actuators(fields, out)
    known = bytes([255, 255, 255, 255, 0, 0, 255, 3, 255, 0, 255, 0])
    assert bytes(out) == bytes(a & b for a, b in zip(data, known))


@given(
    st.lists(st.integers(-4096, 4096), min_size=8, max_size=8),
    st.lists(st.integers(0, 4096), min_size=8, max_size=8),
    st.integers(0, 1),
    st.lists(st.integers(-4096, 4096), min_size=3, max_size=3),
    st.lists(st.integers(0, 4096), min_size=3, max_size=3),
)
def test_sensor_frame_written_and_read_is_the_same(
    prox: list[int], light: list[int], battery: int, acceleration: list[int], micro: list[int]
) -> None:
    fields = {"prox": prox, "light": light, "battery_good": battery}
    fields |= {"acceleration": acceleration, "microphones": micro, "rab_received": battery}
    sensors = ffi.new("struct epuck_argos_sensors *", fields)
    data = ffi.new("uint8_t[72]")
    lib.epuck_argos_put_sensors(sensors, data)
    assert bytes(data) == sensor_frame(prox, light, battery, acceleration, micro, battery)
    read = ffi.new("struct epuck_argos_sensors *")
    assert lib.epuck_argos_get_sensors(data, read) == 0
    assert [*read.prox, *read.light, read.battery_good] == [*prox, *light, battery]
    assert [*read.acceleration, *read.microphones] == [*acceleration, *micro]
    assert read.rab_received == battery


@pytest.mark.parametrize("place", range(26, 40, 2))
def test_accelerometer_and_microphones_that_no_converter_gives(place: int) -> None:
    """Microphone 3 is padding, and 0 (real_epuck_base.h:67)."""
    worst = -4097 if place < 32 else -1 if place < 38 else 1
    good = sensor_frame([0] * 8, [9] * 8, 1, [-4095, 4095, 800], [0, 4095, 2000])
    data = bytearray(good)
    struct.pack_into("<h", data, place, worst)
    read = ffi.new("struct epuck_argos_sensors *")
    assert lib.epuck_argos_get_sensors(good, read) == 0
    assert lib.epuck_argos_get_sensors(bytes(data), read) == -1


@pytest.mark.parametrize("shift", range(1, 72, 2))
def test_torn_words_in_a_sensor_frame_are_noticed(shift: int) -> None:
    """A lost byte shifts all that follow; values that no sensor gives show it."""
    sensors = ffi.new("struct epuck_argos_sensors *", {"prox": [900] * 8, "light": [3900] * 8})
    data = ffi.new("uint8_t[72]")
    lib.epuck_argos_put_sensors(sensors, data)
    shifted = (bytes(data) * 2)[shift : shift + 72]
    assert lib.epuck_argos_get_sensors(shifted, sensors) == -1


def test_firmware_compiles_freestanding_and_needs_nothing(tmp_path: Path) -> None:
    cc = require_tool("cc", "build-essential")
    target = tmp_path / "firmware.o"
    sources = [*(ROOT / "firmware_bridge").glob("*.c"), *(ROOT / "c_src").glob("epuck_*.c")]
    command = [cc, "-std=c99", "-ffreestanding", "-nostdlib", "-r", "-Os", "-fno-stack-protector"]
    command += ["-pedantic", "-Wall", "-Wextra", "-Wshadow", "-Wconversion", "-Werror"]
    command += ["-I", str(ROOT / "c_src"), "-o", str(target), *map(str, sources)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    nm = [require_tool("nm", "binutils"), str(target)]
    lines = subprocess.run(nm, capture_output=True, text=True, check=True).stdout.splitlines()
    kinds = {line.split()[-1]: line.split()[-2] for line in lines}
    assert {n for n, k in kinds.items() if k == "U"} <= {"memset", "memcpy"}
    assert {n for n, k in kinds.items() if k in "dDbBC"} == set()


@pytest.mark.parametrize(("fault", "got"), [("lose", 11), ("flip", 0), ("twice", 1)])
def test_line_faults_come_once_with_the_byte_they_are_for(pic: Pic, fault: str, got: int) -> None:
    setattr(pic.fw.uart.rx.faults, fault, 3)
    pic.exchange(frame(256, 256))
    assert pic.fw.got == got
    right = {"lose": 0, "flip": 256 + 0x10, "twice": 0}[fault]
    assert pic.outputs[1] == right


def test_reset_loses_everything_but_the_robot(pic: Pic) -> None:
    pic.fw.body.inputs.prox[0] = 77
    pic.exchange(frame(300, 300, ring=3))
    pic.say(frame(400, 400)[:5])
    pic.live(1000)
    lib.fw_argos_reset(pic.fw, pic.now_us)
    assert pic.outputs == (0, 0, 0) and pic.fw.state == lib.FW_ARGOS_WAKE
    burst = pic.wake()
    assert struct.unpack_from("<h", burst, 8) == (77,)
    pic.exchange(frame(300, 300, ring=3))
    assert pic.outputs == (300, 300, 3)


def test_watchdog_stops_a_host_that_falls_silent(pic: Pic) -> None:
    pic.exchange(frame(300, 300))
    pic.live(10_000_000)
    assert pic.outputs[:2] == (300, 300), "stock firmware never stops"
    pic.exchange(frame(0, 0))
    pic.fw.body.watchdog_us = 500_000
    pic.exchange(frame(200, 200))
    pic.live(470_000)
    assert pic.outputs[:2] == (200, 200)
    pic.live(50_000)
    assert pic.outputs[:2] == (0, 0) and pic.fw.body.stops == 1
    pic.exchange(frame(200, 200))
    assert pic.outputs[:2] == (200, 200), "the same speed again counts as another one"
