"""The emulated I2C devices: transactions at the bus's pace, and the real ones' quirks."""

from __future__ import annotations

import struct
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.firmware import tables
from vsense.base.native import ffi, lib

MS = 1000
BYTE_US: int = lib.FW_I2C_BYTE_US
MOTOR_MAX = {"gctronic": 1100, "york": 1000}


class Bus:
    """A bus with one microcontroller and the boards, and a clock in us."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.wires: Any = ffi.new("struct fw_i2c *")
        self.fw: Any = ffi.new(f"struct fw_{name} *")
        self.ground: Any = ffi.new("struct fw_ground *")
        self.rab: Any = ffi.new("struct fw_rab *")
        lib.fw_i2c_init(self.wires)
        getattr(lib, f"fw_{name}_init")(self.fw)
        lib.fw_ground_init(self.ground)
        lib.fw_rab_init(self.rab)
        for chip in (self.fw, self.ground, self.rab):
            assert lib.fw_i2c_add(self.wires, ffi.addressof(chip, "device")) == 0
        self.now_us = 10 * MS

    def transfer(self, address: int, out: bytes, count: int = 0) -> bytes | None:
        """One transaction: what was read; None if it was not acknowledged."""
        buf = ffi.new("uint8_t[]", 64)
        result = lib.fw_i2c_transfer(self.wires, address, out, len(out), buf, count, self.now_us)
        self.live(max(self.wires.free_us - self.now_us, 0))
        return bytes(ffi.buffer(buf, count)) if result == lib.FW_I2C_ACK else None

    def live(self, duration_us: int) -> int:
        """How often the outputs changed until then."""
        self.now_us += duration_us
        changes = 0
        while getattr(lib, f"fw_{self.name}_advance")(self.fw, self.now_us):
            changes += 1
        return changes

    def reset(self) -> None:
        getattr(lib, f"fw_{self.name}_reset")(self.fw, self.now_us)

    @property
    def wheels(self) -> tuple[int, int]:
        out = self.fw.body.outputs
        return out.left_steps_s, out.right_steps_s


class GCtronic(Bus):
    """An e-puck2."""

    def __init__(self) -> None:
        super().__init__("gctronic")

    def exchange(self, left: int, right: int, leds: int = 0) -> bytes | None:
        return self.transfer(0x1F, tables.gctronic_actuators(left, right, leds), 47)


class York(Bus):
    """An e-puck on a Pi-puck."""

    def __init__(self) -> None:
        super().__init__("york")

    def set(self, register: int, value: int) -> bool:
        return self.transfer(0x1F, tables.york_write(register, value)) == b""

    def get(self, register: int, count: int = 2) -> bytes | None:
        return self.transfer(0x1F, bytes([register]), count)


def test_transactions_take_their_time_one_after_the_other() -> None:
    bus = GCtronic()
    began_us = bus.now_us
    bus.exchange(0, 0)
    assert bus.now_us - began_us == (1 + 20 + 1 + 47) * BYTE_US + 3 * lib.FW_I2C_EDGE_US
    buf = ffi.new("uint8_t[]", 64)
    for _ in range(3):
        lib.fw_i2c_transfer(bus.wires, 0x60, b"\0", 1, buf, 6, bus.now_us)
    assert bus.wires.free_us - bus.now_us == 3 * ((2 + 7) * BYTE_US + 3 * lib.FW_I2C_EDGE_US)


def test_nobody_there_and_a_stuck_bus() -> None:
    bus = GCtronic()
    assert bus.transfer(0x55, b"x") is None
    bus.wires.stuck = 1
    assert bus.exchange(5, 5) is None
    assert (bus.wires.transactions, bus.wires.failed) == (2, 2)
    bus.wires.stuck = 0
    assert bus.exchange(5, 5) is not None


@pytest.mark.parametrize("fault", ["refuse", "flip_write", "flip_read"])
def test_faults_come_once_with_the_transaction_they_are_for(fault: str) -> None:
    bus = GCtronic()
    setattr(bus.wires.faults, fault, 3)
    good = [bus.exchange(7, 7) for _ in range(2)]
    assert good[0] == good[1] is not None
    odd = bus.exchange(9, 9)
    assert (odd is None) == (fault == "refuse")
    assert (bus.wheels == (7, 7)) == (fault != "flip_read")
    assert bus.exchange(9, 9) is not None


def test_gctronic_says_nothing_before_the_first_packet() -> None:
    bus = GCtronic()
    assert bus.transfer(0x1F, b"", 47) == bytes(47)


@given(
    st.integers(-3000, 3000),
    st.integers(-3000, 3000),
    st.integers(0, 255),
    st.lists(st.integers(0, 4095), min_size=8, max_size=8),
)
def test_gctronic_exchange(left: int, right: int, leds: int, prox: list[int]) -> None:
    bus = GCtronic()
    bus.fw.body.inputs.prox = prox
    bus.fw.body.inputs.light = prox[::-1]
    assert bus.exchange(left, right, leds) == tables.gctronic_sensors(prox, prox[::-1], (0, 0))
    assert bus.wheels == tuple(max(-1100, min(1100, speed)) for speed in (left, right))
    assert bus.fw.body.outputs.leds == leds


def test_gctronic_drops_what_is_damaged_and_answers_all_the_same() -> None:
    bus = GCtronic()
    bus.exchange(100, 100)
    bad = bytearray(tables.gctronic_actuators(200, 200, 0))
    bad[0] ^= 1
    assert bus.transfer(0x1F, bytes(bad), 47) is not None
    assert bus.wheels == (100, 100) and bus.fw.dropped == 1
    assert bus.transfer(0x1F, b"\x07", 47) is not None
    assert bus.wheels == (100, 100) and bus.fw.dropped == 2, "a short write keeps the old tail"


def test_gctronic_drops_the_packet_after_an_error() -> None:
    bus = GCtronic()
    bus.wires.faults.refuse = 1
    assert bus.exchange(100, 100) is None
    assert bus.exchange(200, 200) is not None
    assert bus.wheels == (0, 0)
    bus.exchange(300, 300)
    assert bus.wheels == (300, 300)


@pytest.mark.parametrize("name", ["gctronic", "york"])
def test_a_reset_stops_everything_and_nobody_answers_for_a_while(name: str) -> None:
    bus = GCtronic() if name == "gctronic" else York()
    drive(bus, 100)
    assert bus.wheels == (100, 100)
    bus.reset()
    assert bus.wheels == (0, 0)
    assert bus.transfer(0x1F, bytes([2]), 2) is None
    bus.live(600 * MS)
    assert bus.transfer(0x1F, bytes([2]), 2) is not None


def drive(bus: Bus, speed: int) -> None:
    if isinstance(bus, York):
        bus.set(2, speed)
        bus.set(3, speed)
    else:
        assert isinstance(bus, GCtronic)
        bus.exchange(speed, speed)
    bus.live(2 * MS)


@pytest.mark.parametrize("name", ["gctronic", "york"])
def test_watchdog_stops_a_host_that_falls_silent(name: str) -> None:
    bus = GCtronic() if name == "gctronic" else York()
    drive(bus, 100)
    bus.live(3_000 * MS)
    assert bus.wheels == (100, 100), "stock firmware never stops"
    drive(bus, 0)
    bus.fw.body.watchdog_us = 400 * MS
    drive(bus, 90)
    bus.live(390 * MS)
    assert bus.wheels == (90, 90)
    assert bus.live(20 * MS) == 1
    assert bus.wheels == (0, 0) and bus.fw.body.stops == 1
    drive(bus, 90)
    assert bus.wheels == (90, 90)


@given(st.integers(-32768, 32767), st.integers(0, 3))
def test_york_speeds_are_clamped_and_read_back(value: int, wait_ms: int) -> None:
    bus = York()
    bus.set(2, value)
    bus.live(2 * MS + wait_ms)
    clamped = max(-1000, min(1000, value))
    assert bus.wheels == (clamped, 0)
    assert bus.get(2) == struct.pack("<h", clamped)


def test_york_speeds_may_be_torn_for_a_millisecond() -> None:
    """The low byte counts before the high one has come: -100 is +156 for a moment."""
    seen = set()
    for phase_us in range(0, 1000, 10):
        bus = York()
        bus.live(phase_us)
        bus.set(2, -100)
        for _ in range(30):
            bus.live(100)
            seen.add(bus.wheels[0])
        assert bus.wheels[0] == -100
    assert seen == {0, 156, -100}


def test_york_senses_only_when_switched_on() -> None:
    """Light that was not yet measured is 4095 - 0; two sensors after the other are measured.

    Source: pi-puck-e-puck1 0041716 pi-puck-e-puck1.X: ir_sensors.c:9-37 (four pairs), 53, 77
    (times), 138-160; main.c:83-112.
    """
    bus = York()
    bus.fw.body.inputs.prox = list(range(100, 108))
    bus.fw.body.inputs.light = [1000] * 8
    bus.fw.body.inputs.prox = list(range(100, 108))
    assert bus.get(7) == b"\0\0" and bus.get(15) == b"\xff\x0f"
    bus.set(6, 1)
    bus.live(2 * MS)
    assert bus.get(15) != b"\xff\x0f" and bus.get(18) == b"\xff\x0f"
    bus.live(8 * MS)
    assert [bus.get(7 + i) for i in range(8)] == [struct.pack("<H", 100 + i) for i in range(8)]
    assert bus.get(15) == struct.pack("<H", 4095 - 1000), "higher is brighter"


def test_york_leds_and_counters() -> None:
    bus = York()
    bus.set(0, 0x1A5)
    bus.set(1, 0xFF)
    bus.live(2 * MS)
    assert bus.fw.body.outputs.leds == 0x3A5
    assert bus.get(0) == b"\xa5\0" and bus.get(1) == b"\x03\0"
    bus.set(3, -500)
    bus.live(1_000 * MS)
    (steps,) = struct.unpack("<h", bus.get(5) or b"")
    assert -510 <= steps <= -495


@pytest.mark.parametrize(("kind", "real"), [("york", 57600 // 65), ("gctronic", 50000 // 55)])
def test_motors_count_their_own_ticks(kind: str, real: int) -> None:
    """A speed of 900 steps/s is what a whole number of ticks gives.

    Source: pi-puck-e-puck1 0041716 pi-puck-e-puck1.X/motors.c:187-193 with system.h:6-8 (57600 Hz,
    counted from 0); e-puck2_main-processor 517ef07 src/motors.c:6, 193-229 (100 kHz, half steps).
    """
    bus = GCtronic() if kind == "gctronic" else York()
    drive(bus, 900)
    before, began_us = steps(bus), bus.now_us
    bus.live(5_000 * MS)
    passed_us = bus.now_us - began_us
    assert abs(steps(bus) - before - real * passed_us / 1e6) < 12


def steps(bus: Bus) -> int:
    """The left wheel's counter."""
    if isinstance(bus, York):
        return int.from_bytes(bus.get(4) or b"", "little")
    assert isinstance(bus, GCtronic)
    answer = bus.exchange(900, 900)
    assert answer is not None
    return int.from_bytes(answer[41:43], "little")


def test_york_hangs_the_bus_on_a_third_byte_until_it_is_reset() -> None:
    bus = York()
    assert bus.get(4, 3) is None
    assert bus.wires.stuck == 1
    assert bus.get(4) is None


def test_york_leaves_a_byte_over_and_refuses_a_fourth() -> None:
    bus = York()
    bus.set(2, 0x0201)
    bus.live(2 * MS)
    assert bus.get(2, 1) == b"\x01"
    assert bus.get(2) == b"\x02\x01", "the partner of the byte before comes first"
    assert bus.transfer(0x1F, bytes([2, 1, 0, 0])) is None


def epuck2() -> York:
    """An e-puck2 with York's map."""
    bus = York()
    bus.fw.is_epuck2 = 1
    return bus


def test_york_on_an_epuck2_answers_one_byte_of_its_leds() -> None:
    """Source: e-puck2_main-processor fcb74b1 src/gumstix.c:126-152."""
    bus = epuck2()
    bus.set(0, 0x1A5)
    bus.set(1, 0x03)
    assert bus.fw.body.outputs.leds == 0x3A5
    assert bus.get(0) == tables.york_epuck2_read(0xA5, 1, 2) == b"\xa5\xa5"
    assert bus.get(1) == tables.york_epuck2_read(0x03, 1, 2) == b"\x03\x03"
    assert bus.get(0, 1) == b"\xa5"


@given(st.integers(-32768, 32767), st.integers(1, 5))
def test_york_on_an_epuck2_takes_a_speed_as_a_whole(value: int, count: int) -> None:
    """Clamped when it comes, never torn, and any number of bytes may be read.

    Source: e-puck2_main-processor fcb74b1 src/gumstix.c:153-190, 425-435.
    """
    bus = epuck2()
    bus.set(3, value)
    clamped = max(-1000, min(1000, value))
    assert bus.wheels == (0, clamped)
    assert bus.get(3, count) == tables.york_epuck2_read(clamped, 2, count)
    assert bus.wires.stuck == 0


def test_york_on_an_epuck2_drops_what_is_written_after_an_error() -> None:
    """It reads back all the same. Source: the same file, 83-99 and 408-414."""
    bus = epuck2()
    bus.set(2, 100)
    bus.wires.faults.refuse = 1
    assert bus.get(2) is None
    assert bus.get(2) == struct.pack("<h", 100), "a question changes nothing"
    bus.set(2, 0)
    assert bus.get(2) == b"\0\0" and bus.wheels == (100, 0)
    bus.set(2, 0)
    assert bus.wheels == (0, 0) and bus.fw.dropped == 1


def test_york_on_an_epuck2_always_senses_and_light_is_as_measured() -> None:
    """Proximity is never below 0; light is higher where it is darker, unlike York's e-puck.

    Source: e-puck2_main-processor fcb74b1 src/gumstix.c:209-354, src/sensors/proximity.c:
    191-197 (lit is lower than ambient: what is brighter is lower), 342-370; York's e-puck:
    pi-puck-e-puck1 0041716 pi-puck-e-puck1.X/ir_sensors.c:155-161.
    """
    bus = epuck2()
    bus.fw.body.inputs.prox = [-5, *range(101, 108)]
    bus.fw.body.inputs.light = [1000] * 8
    assert bus.get(7) == b"\0\0" and bus.get(8) == struct.pack("<H", 101)
    assert bus.get(15) == bus.get(22) == struct.pack("<H", 1000)
    answer = bus.get(22)
    bus.set(6, 1)
    assert bus.get(6) == answer, "register 6 answers nothing: the answer before it stays"


def test_york_proximity_of_an_epuck_is_signed() -> None:
    """Source: pi-puck-e-puck1 0041716 pi-puck-e-puck1.X: ir_sensors.c:44, 175; main.c:96-103."""
    bus = York()
    bus.fw.body.inputs.prox = [-4, 0, 0, 0, 0, 0, 0, 4095]
    bus.set(6, 1)
    bus.live(10 * MS)
    assert bus.get(7) == b"\xfc\xff" and bus.get(14) == b"\xff\x0f"


def test_range_and_bearing_stores_the_light() -> None:
    """Source: argos3-epuck 66cb8d9 erab_firmware/e-RandB_firmware_parametric/I2CSlaveDrv.c:319."""
    bus = York()
    bus.transfer(0x20, bytes([16, 0]))
    assert bus.rab.light_stored == 1


def test_ground_registers_count_on() -> None:
    bus = York()
    bus.ground.ground = [1, 513, 1023]
    assert bus.transfer(0x60, b"\0", 6) == bytes([0, 1, 2, 1, 3, 255])
    assert bus.transfer(0x60, b"\2", 2) == bytes([2, 1])


def hear(bus: Bus, number: int) -> None:
    lib.fw_rab_hear(bus.rab, ffi.new("struct epuck_rab_message *", [[number, 2, 3, 4], -5, 600]))


def test_range_and_bearing_takes_messages_one_by_one() -> None:
    bus = York()
    assert bus.transfer(0x20, b"\0", 1) == b"\0"
    for number in range(12):
        hear(bus, number)
    assert bus.rab.overflowed == 2
    for number in range(10):
        assert bus.transfer(0x20, b"\0", 1) == b"\1"
        held = tables.rab_registers([number, 2, 3, 4], -5, 600)
        for register, value in held.items():
            assert bus.transfer(0x20, bytes([register]), 1) == bytes([value])
    assert bus.transfer(0x20, b"\0", 1) == b"\0"
    assert bus.transfer(0x20, b"\2", 1) == bytes([9]), "what was taken stays"


def test_range_and_bearing_repeats_the_first_register() -> None:
    bus = York()
    hear(bus, 7)
    bus.transfer(0x20, b"\0", 1)
    assert bus.transfer(0x20, b"\1", 2) == bytes([2, 2])


def test_range_and_bearing_sends_what_was_shifted_in() -> None:
    bus = York()
    bus.transfer(0x20, bytes([21, 32]))
    for register, byte in zip((13, 19, 20, 14), (4, 3, 2, 1)):
        bus.transfer(0x20, bytes([register, byte]))
    assert (bus.rab.sent, bus.rab.sent_number) == (1, 0x04030201)
    bus.transfer(0x20, bytes([21, 16]))
    bus.transfer(0x20, bytes([14, 9]))
    assert bus.rab.sent_number == 0x0109
    bus.transfer(0x20, bytes([21, 99]))
    assert bus.rab.bits == 16


def test_iridias_leds_take_nine_bytes() -> None:
    bus = York()
    rgb = ffi.new("struct fw_rgb *")
    lib.fw_rgb_init(rgb)
    assert lib.fw_i2c_add(bus.wires, ffi.addressof(rgb, "device")) == 0
    assert bus.transfer(0x61, bytes(range(1, 10))) == b""
    assert [list(one) for one in rgb.rgb] == [[7, 8, 9], [4, 5, 6], [1, 2, 3]]
    assert bus.transfer(0x61, b"\1") == b"" and rgb.writes == 1
    assert bus.transfer(0x61, b"", 1) is None, "nobody reads them"


def test_an_lsm330_measures_when_it_is_switched_on() -> None:
    """Source: gctronic/Pi-puck 73b8913 e-puck1/e-puck1_imu.c:78-89, 164-165."""
    bus = York()
    imu = ffi.new("struct fw_imu *")
    lib.fw_imu_init(imu, lib.EPUCK_IMU_LSM330)
    imu.rates = [1, -2, 300]
    assert lib.fw_i2c_add(bus.wires, ffi.addressof(imu, "device")) == 0
    assert bus.transfer(0x6A, b"\xa8", 6) == bytes(6)
    bus.transfer(0x6A, b"\x20\xcf")
    assert bus.transfer(0x6A, b"\xa8", 6) == struct.pack("<3h", 1, -2, 300)
    assert bus.transfer(0x6A, b"\x28", 3) == b"\1\1\1", "without 0x80 it does not count on"


def test_an_mpu9250_counts_on() -> None:
    """Source: gctronic/Pi-puck 73b8913 e-puck2/e-puck2_imu.c:79, 136-137."""
    bus = York()
    imu = ffi.new("struct fw_imu *")
    lib.fw_imu_init(imu, lib.EPUCK_IMU_MPU9250)
    imu.rates = [1, -2, 300]
    assert lib.fw_i2c_add(bus.wires, ffi.addressof(imu, "device")) == 0
    assert bus.transfer(0x68, b"\x43", 6) == struct.pack(">3h", 1, -2, 300)
    assert bus.transfer(0x68, b"\x75", 1) == b"\x71"


def test_stock_range_and_bearing_knows_two_bytes() -> None:
    bus = York()
    bus.rab.is_stock = 1
    for register, byte in ((21, 32), (13, 4), (19, 3), (20, 2), (14, 1)):
        bus.transfer(0x20, bytes([register, byte]))
    assert bus.rab.sent_number == 0x0401
    hear(bus, 1)
    bus.transfer(0x20, b"\0", 1)
    assert bus.transfer(0x20, b"\x0a", 1) == b"\0"
