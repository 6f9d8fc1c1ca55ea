"""The protocols' bytes against the tables, and that what is written is read again."""

from __future__ import annotations

import struct
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.firmware import tables
from vsense.base.native import ffi, lib

MODES = list(tables.RING_SIZES)

raw = st.lists(st.integers(0, 4095), min_size=8, max_size=8)
word = st.integers(0, 65535)
speed = st.integers(-1000, 1000)
led_bits = st.integers(0, 0x3FF)


def mode_of(name: str) -> Any:
    return ffi.addressof(lib.epuck_asercom_modes, MODES.index(name))


def settable(mode: str) -> int:
    return 0xFF if mode == "extension" else 0x3FF


@pytest.mark.parametrize("mode", MODES)
def test_modes_have_the_links_speeds_and_sizes(mode: str) -> None:
    found = mode_of(mode)
    assert found.baud == (230400 if mode == "extension" else 115200)
    assert found.ring == tables.RING_SIZES[mode]
    ground = (800, 900, 1000) if "ground" in mode else ()
    reply = tables.asercom_reply(mode, [0] * 8, [0] * 8, (0, 0), 0, (0, 0), ground)
    assert lib.epuck_asercom_reply_len(found) == len(reply)


def test_the_examples_of_the_sources() -> None:
    """epuck.md 1.3: set +400/-400, ask for proximity and counters."""
    assert tables.asercom_poll("extension", 400, -400, {})[:5] == bytes.fromhex("BC900170FE")
    assert [tables.code(letter) for letter in "NQE"] == [0xB2, 0xAF, 0xBB]
    assert bytes(lib.epuck_asercom_resync) == bytes(36) + b"\rV\r"
    assert tables.york_write(2, -100) == bytes([2, 0x9C, 0xFF])
    assert tables.gctronic_actuators(0, 0, 0) == bytes(20)


@given(st.sampled_from(MODES), speed, speed, led_bits, led_bits)
def test_asercom_poll(mode: str, left: int, right: int, leds: int, change: int) -> None:
    poll = ffi.new("struct epuck_asercom_poll *", [left, right, leds, change])
    packet = ffi.new("uint8_t[]", lib.EPUCK_ASERCOM_REQUEST_MAX)
    length = lib.epuck_asercom_put_poll(mode_of(mode), poll, packet)
    numbers = [n for n in range(10) if change & settable(mode) & 1 << n]
    states = {n: leds >> n & 1 for n in numbers}
    wanted = tables.asercom_poll(mode, left, right, states)
    assert bytes(ffi.buffer(packet, length)) == wanted


@given(st.sampled_from(MODES), raw, raw, word, word, word, speed, speed, st.data())
def test_asercom_reply(mode, prox, light, left, right, battery, ahead, back, data) -> None:
    count = 3 if "ground" in mode else 0
    ground = data.draw(st.lists(st.integers(0, 1023), min_size=count, max_size=count))
    rates = data.draw(st.lists(st.integers(-32768, 32767), min_size=3, max_size=3))
    distance = data.draw(word)
    said = (prox, light, (left, right), battery, (ahead, back), ground, rates, distance)
    reply = tables.asercom_reply(mode, *said)
    got = ffi.new("struct epuck_asercom_sensors *")
    assert lib.epuck_asercom_get_reply(mode_of(mode), reply, got) == 0
    assert (list(got.prox), list(got.light), list(got.steps)) == (prox, light, [left, right])
    assert (got.battery, got.left_steps_s, got.right_steps_s) == (battery, ahead, back)
    assert list(got.ground)[:count] == ground
    is_epuck2 = "epuck2" in mode
    assert list(got.rates) == (rates if is_epuck2 else [0, 0, 0])
    assert got.distance_mm == (distance if is_epuck2 else 0)


calibrated = st.lists(st.integers(0, 8190), min_size=8, max_size=8)
"""A difference of two readings of 12 bits, minus one that may be negative, and never below 0."""


@given(calibrated)
def test_calibrated_proximity_above_the_converter_is_clamped(prox: list[int]) -> None:
    """Both firmwares may send more than 4095: the stored offset may be negative.

    Source: e-puck-library 4cb85cb library/a_d/advance_ad_scan/e_prox.c:107-138 (e_get_prox has
    no clamp, e_get_calibrated_prox clamps at 0 only), program/DemoGCtronic-complete/Asercom.c:
    441-455 ('N'); e-puck2_main-processor 517ef07 src/sensors/proximity.c:191-193, 346-358,
    src/gumstix.c:122-126.
    """
    clamped = [min(value, 4095) for value in prox]
    reply = tables.asercom_reply("extension", prox, [0] * 8, (0, 0), 0, (0, 0))
    got = ffi.new("struct epuck_asercom_sensors *")
    assert lib.epuck_asercom_get_reply(mode_of("extension"), reply, got) == 0
    assert list(got.prox) == clamped
    packet = tables.gctronic_sensors(prox, [0] * 8, (0, 0))
    read = ffi.new("struct epuck_gctronic_sensors *")
    assert lib.epuck_gctronic_get_sensors(packet, read) == 0
    assert list(read.prox) == clamped


outside = st.sampled_from([-1, -32768, 8191, 32767])


@given(raw, raw, st.integers(0, 7), outside, st.booleans())
def test_asercom_values_that_no_sensor_gives(prox, light, place, value, is_light) -> None:
    (light if is_light else prox)[place] = value
    reply = tables.asercom_reply("extension", prox, light, (0, 0), 0, (0, 0))
    got = ffi.new("struct epuck_asercom_sensors *", {"battery": 77})
    assert lib.epuck_asercom_get_reply(mode_of("extension"), reply, got) == -1
    assert got.battery == 77, "left alone"


@pytest.mark.parametrize("value", [-1, 4096])
def test_light_is_what_the_converter_gives(value: int) -> None:
    """Ambient light is one reading of 12 bits. Source: e_prox.c:147-153, proximity.c:364-370."""
    light = [0] * 7 + [value]
    reply = tables.asercom_reply("extension", [1] * 8, light, (0, 0), 0, (0, 0))
    got = ffi.new("struct epuck_asercom_sensors *")
    assert lib.epuck_asercom_get_reply(mode_of("extension"), reply, got) == -1
    packet = tables.gctronic_sensors([1] * 8, light, (0, 0))
    read = ffi.new("struct epuck_gctronic_sensors *")
    assert lib.epuck_gctronic_get_sensors(packet, read) == -1


@pytest.mark.parametrize(
    ("battery", "mv", "low"),
    [(2560, 4200, 0), (2070, 3400, 0), (2069, 3399, 1), (1, 0, 0), (0, 0, 1)],
)
def test_asercom_battery_of_both_hardwares(battery: int, mv: int, low: int) -> None:
    assert lib.epuck_asercom_battery_mv(battery, 0) == mv
    assert lib.epuck_asercom_battery_low(battery, 0) == low


@pytest.mark.parametrize("volt", [3.0, 3.39, 3.41, 3.7, 4.2])
def test_asercom_battery_of_an_epuck2(volt: float) -> None:
    """The converter's counts of a voltage, whatever hardware it says it is.

    Source: e-puck2_main-processor d2e0dbb src/sensors/battery_level.h:14-15 (220 and 330 kohm),
    battery_level.c:15-20, 102, 127 (raw = volt * 4096 * divider / 3 V);
    src/epuck1x/utility/utility.c:21-23; src/epuck1x/Asercom.c:331-335 ('b');
    src/epuck1x/motor_led/e_init_port.c:43 (always hardware 1.3, so never the fixed pin).
    """
    counts = int(volt * 4096 * (330 / (220 + 330)) / 3.0)
    assert abs(lib.epuck_asercom_battery_mv(counts, 1) - 1000 * volt) < 2
    assert lib.epuck_asercom_battery_low(counts, 1) == (volt < 3.4)


@given(st.integers(-32768, 32767), st.integers(-32768, 32767), st.integers(0, 255))
def test_gctronic_actuators(left: int, right: int, leds: int) -> None:
    fields = ffi.new("struct epuck_gctronic_actuators *", [left, right, leds])
    packet = ffi.new("uint8_t[20]")
    lib.epuck_gctronic_put_actuators(fields, packet)
    assert bytes(packet) == tables.gctronic_actuators(left, right, leds)
    read = ffi.new("struct epuck_gctronic_actuators *")
    assert lib.epuck_gctronic_get_actuators(packet, read) == 0
    assert (read.left_steps_s, read.right_steps_s, read.leds) == (left, right, leds)


percents = st.integers(0, 100)


@given(
    st.integers(0, 255), st.lists(st.tuples(percents, percents, percents), min_size=4, max_size=4)
)
def test_gctronic_colours(leds: int, colors: list[tuple[int, int, int]]) -> None:
    fields = ffi.new("struct epuck_gctronic_actuators *", [1, -1, leds, colors])
    packet = ffi.new("uint8_t[20]")
    lib.epuck_gctronic_put_actuators(fields, packet)
    assert bytes(packet) == tables.gctronic_actuators(1, -1, leds, colors)
    read = ffi.new("struct epuck_gctronic_actuators *")
    assert lib.epuck_gctronic_get_actuators(packet, read) == 0
    assert bytes(ffi.buffer(read.rgb)) == bytes(packet)[6:18]
    shining = sum(any(color) << (2 * i + 1) for i, color in enumerate(colors))
    assert read.leds == leds | shining


volumes = st.lists(st.integers(0, 32767), min_size=4, max_size=4)


@given(raw, raw, word, word, volumes)
def test_gctronic_sensors(
    prox: list[int], light: list[int], left: int, right: int, loud: list[int]
) -> None:
    packet = tables.gctronic_sensors(prox, light, (left, right), loud)
    read = ffi.new("struct epuck_gctronic_sensors *")
    assert lib.epuck_gctronic_get_sensors(packet, read) == 0
    assert (list(read.prox), list(read.light), list(read.steps)) == (prox, light, [left, right])
    assert list(read.microphones) == loud
    again = ffi.new("uint8_t[47]")
    lib.epuck_gctronic_put_sensors(read, again)
    assert bytes(again) == packet


@given(raw, raw, st.integers(0, 47 * 8 - 1))
def test_gctronic_notices_every_flipped_bit(prox: list[int], light: list[int], bit: int) -> None:
    packet = bytearray(tables.gctronic_sensors(prox, light, (1, 2)))
    packet[bit // 8] ^= 1 << bit % 8
    read = ffi.new("struct epuck_gctronic_sensors *")
    assert lib.epuck_gctronic_get_sensors(bytes(packet), read) == -1


@pytest.mark.parametrize("byte", [0x00, 0xFF])
def test_a_bus_that_is_stuck_is_no_answer(byte: int) -> None:
    read = ffi.new("struct epuck_gctronic_sensors *")
    assert lib.epuck_gctronic_get_sensors(bytes([byte]) * 47, read) == -1


@given(st.integers(0, 255), st.integers(-32768, 65535))
def test_york_write(register: int, value: int) -> None:
    out = ffi.new("uint8_t[3]")
    lib.epuck_york_put_write(register, value & 0xFFFF, out)
    assert bytes(out) == tables.york_write(register, value)


def test_york_registers_are_those_of_the_map() -> None:
    assert (lib.EPUCK_YORK_ADDRESS, lib.EPUCK_GCTRONIC_ADDRESS) == (0x1F, 0x1F)
    assert (lib.EPUCK_YORK_RING_LEDS, lib.EPUCK_YORK_OTHER_LEDS) == (0, 1)
    assert (lib.EPUCK_YORK_LEFT_SPEED, lib.EPUCK_YORK_LEFT_STEPS) == (2, 4)
    assert (lib.EPUCK_YORK_SENSING, lib.EPUCK_YORK_PROX, lib.EPUCK_YORK_LIGHT) == (6, 7, 15)


@given(led_bits)
def test_york_leds_are_split_and_joined(leds: int) -> None:
    """Bit 0 of register 1 is the front LED, bit 1 the body."""
    other = lib.epuck_york_other_leds(leds)
    assert other == (leds >> 9 & 1) | (leds >> 8 & 1) << 1
    assert lib.epuck_york_get_leds(leds & 0xFF, other) == leds


@given(st.lists(st.integers(0, 1023), min_size=3, max_size=3))
def test_ground_registers_are_big_endian(ground: list[int]) -> None:
    out = ffi.new("uint8_t[6]")
    lib.epuck_ground_put(ground, out)
    assert bytes(out) == b"".join(value.to_bytes(2, "big") for value in ground)
    read = ffi.new("int16_t[3]")
    assert lib.epuck_ground_get(out, read) == 0
    assert list(read) == ground


def test_ground_that_no_sensor_gives() -> None:
    read = ffi.new("int16_t[3]", [1, 2, 3])
    assert lib.epuck_ground_get(b"\x00\x00\x04\x00\x00\x00", read) == -1
    assert list(read) == [1, 2, 3]


def test_battery_converter_is_asked_for_channel_0_once() -> None:
    """Bits as Adafruit_Python_ADS1x15 caf7520 ADS1x15.py:26-64 names them, of which GCtronic's
    battery/old/read-battery.py:10-13 takes channel 0 and gain 1."""
    once, channel_0, gain_1, per_s_1600, no_comparator = 0x8000 | 0x0100, 4 << 12, 0x0200, 0x80, 3
    assert once | channel_0 | gain_1 | per_s_1600 | no_comparator == lib.EPUCK_ADC_BATTERY
    assert (lib.EPUCK_ADC_ADDRESS, lib.EPUCK_ADC_VALUE, lib.EPUCK_ADC_SETTINGS) == (0x48, 0, 1)


@given(st.integers(0, 2047))
def test_battery_converters_value(raw: int) -> None:
    """gctronic/Pi-puck 73b8913 battery/old/read-battery.py:6-8; the value is left-aligned."""
    volts = raw * (4.096 / 2048) * 2
    value = (raw << 4).to_bytes(2, "big")
    assert lib.epuck_adc_get_battery(value) == round(volts * 1000)
    out = ffi.new("uint8_t[2]")
    lib.epuck_adc_put_battery(round(volts * 1000), out)
    assert bytes(out) == value


def test_battery_converter_below_0() -> None:
    assert lib.epuck_adc_get_battery(b"\xff\xf0") == 0


color = st.lists(st.integers(0, 255), min_size=3, max_size=3)


@given(color, color, color)
def test_rgb_leds_of_iridia(left: list[int], right: list[int], back: list[int]) -> None:
    """argos3-epuck 66cb8d9 real_epuck_rgb_leds_actuator.cpp:16-20, 36-50: the last LED first;
    real_epuck_i2c_device.cpp:159-190 writes nothing before it."""
    assert (lib.EPUCK_RGB_ADDRESS, lib.EPUCK_RGB_LEDS) == (0x61, 3)
    out = ffi.new("uint8_t[9]")
    lib.epuck_rgb_put([left, right, back], out)
    assert bytes(out) == bytes(back + right + left)
    read = ffi.new("uint8_t[3][3]")
    lib.epuck_rgb_get(out, read)
    assert [list(one) for one in read] == [left, right, back]


def test_imus_are_found_and_set_up_as_by_gctronic() -> None:
    """MPU-9250: gctronic/Pi-puck 73b8913 e-puck2/e-puck2_imu.c:21-22, 27; e-puck2_main-processor
    d2e0dbb src/sensors/mpu9250_registers.h:91, 134. ICM-20948: icm20948/ICM_20948_C.h:36-38,
    ICM_20948_REGISTERS.h:24, 51-57 there. LSM330: Pi-puck e-puck1/e-puck1_imu.c:78-89, 164-165."""
    chips = [lib.epuck_imus[i] for i in range(lib.EPUCK_IMUS)]
    found = [(c.address, c.id_register, c.id, c.rates) for c in chips]
    assert found[:2] == [(0x68, 0x75, 0x71, 0x43), (0x69, 0x75, 0x71, 0x43)]
    accelerations = 0x2D
    assert found[2:4] == [(a, 0x00, 0xEA, accelerations + 6) for a in (0x68, 0x69)]
    assert (chips[4].address, chips[4].rates) == (0x6A, 0x28 | 0x80)
    assert [list(one) for one in lib.epuck_imu_settings] == [[0x20, 0xCF], [0x21, 0x20], [0x23, 0]]


raw_rates = st.lists(st.integers(-32768, 32767), min_size=3, max_size=3)


@given(st.integers(0, 4), raw_rates)
def test_rates_of_every_imu(chip: int, rates: list[int]) -> None:
    """Big-endian, 250 / 32768 degrees a second; an LSM330's little-endian, 8.75e-3: Pi-puck 73b8913
    e-puck2/e-puck2_imu.c:143-151, e-puck1/e-puck1_imu.c:171-173; e-puck-library 4cb85cb
    library/acc_gyro/e_lsm330.c:279-283."""
    is_lsm330 = chip == lib.EPUCK_IMU_LSM330
    read = ffi.new("int16_t[3]")
    registers = struct.pack("<3h" if is_lsm330 else ">3h", *rates)
    lib.epuck_imu_get(ffi.addressof(lib.epuck_imus[chip]), registers, read)
    digit = 8.75e-3 / (250 / 32768) if is_lsm330 else 1.0
    for got, sent in zip(read, rates):
        assert abs(got - max(-32768, min(32767, sent * digit))) <= 1 + 0.002 * abs(sent)


message = st.tuples(
    st.lists(st.integers(0, 255), min_size=4, max_size=4), st.integers(-31415, 31415), word
)


@given(message, st.sampled_from([2, 4]))
def test_messages_are_read_register_by_register(said: Any, size: int) -> None:
    data, bearing, distance = said
    held = tables.rab_registers(data, bearing, distance)
    count = ffi.new("size_t *")
    registers = lib.epuck_rab_reads(size, count)
    assert sorted(registers[i] for i in range(count[0])) == sorted(
        {2, 1, 3, 4, 5, 6} | ({10, 11} if size == 4 else set())
    )
    read = ffi.new("struct epuck_rab_message *")
    assert lib.epuck_rab_get(bytes(held[registers[i]] for i in range(count[0])), size, read) == 0
    assert list(read.data) == data[:size] + [0] * (4 - size)
    assert (read.bearing_e4rad, read.range_raw) == (bearing, distance)
    again = ffi.new("uint8_t[]", count[0])
    lib.epuck_rab_put(read, size, again)
    assert bytes(again) == bytes(held[registers[i]] for i in range(count[0]))


def test_a_bearing_beyond_pi_is_no_bearing() -> None:
    read = ffi.new("struct epuck_rab_message *")
    assert lib.epuck_rab_get(bytes([0, 0, 0x80, 0x00, 0, 0]), 2, read) == -1
    for bearing, result in ((31416, 0), (31417, -1), (-31416, 0), (-31417, -1)):
        assert lib.epuck_rab_get(struct.pack(">2xhxx", bearing), 2, read) == result
    assert lib.epuck_rab_get(bytes([0, 0, 0xC2, 0xF0, 0, 0]), 2, read) == 0
    assert read.bearing_e4rad == -15632, "signed: to the right"


def test_messages_are_sent_from_the_highest_byte_on() -> None:
    """A board shifts what it gets; register 14 sends. Source: I2CSlaveDrv.c of argos3-epuck."""
    assert list(lib.epuck_rab_writes(4)[0:4]) == [13, 19, 20, 14]
    assert list(lib.epuck_rab_writes(2)[0:2]) == [13, 14]


def test_a_wifi_command_is_what_the_stand_in_of_webots_reads() -> None:
    """cyberbotics/webots 0bc4549 e-puck2_server.c: places 1, 3 to 7, and 8 to 19."""
    command = ffi.new(
        "struct epuck_wifi_command *",
        {
            "asks": lib.EPUCK_WIFI_STREAM_SENSORS,
            "left_steps_s": -300,
            "right_steps_s": 700,
            "leds": 1 << 0 | 1 << 4 | 1 << 8 | 1 << 9,
            "rgb": [[1, 2, 3], [0, 0, 0], [4, 5, 6], [100, 0, 0]],
        },
    )
    packet = ffi.new("uint8_t[]", lib.EPUCK_WIFI_COMMAND_LEN)
    lib.epuck_wifi_put_command(command, packet)
    colours = [1, 2, 3, 0, 0, 0, 4, 5, 6, 100, 0, 0]
    lamps = 0x01 | 0x04 | 0x10 | 0x20
    assert bytes(packet) == struct.pack("<BBBhhB12BB", 0x80, 2, 0, -300, 700, lamps, *colours, 0)
    back = ffi.new("struct epuck_wifi_command *")
    assert lib.epuck_wifi_get_command(packet, back) == 0
    assert bytes(ffi.buffer(back)) == bytes(ffi.buffer(command))
    command.leds = 1 << 2 | 1 << 9
    lib.epuck_wifi_put_command(command, packet)
    assert packet[7] == 0x02 | 0x20


def test_wifi_sensors_are_where_both_programs_have_them() -> None:
    packet = bytearray(104)
    struct.pack_into("<8H", packet, 37, *range(100, 108))
    struct.pack_into("<8H", packet, 53, *range(200, 208))
    struct.pack_into("<H", packet, 69, 345)
    struct.pack_into("<HH", packet, 79, 65535, 2)
    struct.pack_into("<H", packet, 83, 3300)
    struct.pack_into("<3H", packet, 90, 7, 8, 1023)
    sensors = ffi.new("struct epuck_wifi_sensors *")
    assert lib.epuck_wifi_get_sensors(bytes(packet), sensors) == 0
    assert list(sensors.prox) == [*range(100, 108)] and list(sensors.light) == [*range(200, 208)]
    assert (sensors.distance_mm, *sensors.steps, sensors.battery) == (345, 65535, 2, 3300)
    assert list(sensors.ground) == [7, 8, 1023]
    again = ffi.new("uint8_t[]", 104)
    lib.epuck_wifi_put_sensors(sensors, again)
    assert bytes(again) == bytes(packet)
    packet[54] = 0x20  # a light of 8 thousand
    assert lib.epuck_wifi_get_sensors(bytes(packet), sensors) == -1
