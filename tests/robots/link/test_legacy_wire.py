"""The original virtual sensor protocol's numbers and messages, against a reader of its own."""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.robots.link.legacy_rig import real
from vsense.robots.link.legacy.protocol import LEGACY_SENSORS, Translation, encode_real, update
from vsense.robots.link.status import LinkError
from vsense.robots.link.table import Direction, Entry

SIZES = {1: 36, 2: 96, 3: 36, 4: 36, 5: 3, 6: 12, 7: 12, 8: 48}
"""Source: iridia.md section 1b; 8: four reals."""

LAYOUTS = {
    "ground": "3*f4",
    "light": "16*f4",
    "gps": "3*f4",
    "destination": "5*f4",
    "rgb_ground": "4*u1",
    "radiation": "f4",
    "pollutant": "f4",
    "black_white_location": "4*f4",
}


def entries(*names: str) -> list[Entry]:
    return [Entry(100 + k, name, LAYOUTS[name]) for k, name in enumerate(names)]


@pytest.mark.parametrize(
    ("value", "mantissa", "exponent"),
    [
        (0.0, 0, 0),
        (0.5, 1, 0),
        (1.0, 1, 1),
        (-1.0, -1, 1),
        (0.75, 2**62 + 1, 0),
        (-3.0, -(2**62) - 1, 2),
    ],
)
def test_golden_numbers(value: float, mantissa: int, exponent: int) -> None:
    assert encode_real(value) == struct.pack(">qi", mantissa, exponent)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_numbers_arrive_as_they_were(value: float) -> None:
    data = encode_real(value)
    assert len(data) == 12
    assert math.isclose(real(data), value, rel_tol=2**-52, abs_tol=5e-324)
    assert math.copysign(1, real(data)) == math.copysign(1, value) or value == 0.0


@given(st.floats(width=32, allow_nan=False, allow_infinity=False))
def test_singles_arrive_exactly(value: float) -> None:
    assert real(encode_real(value)) == value


def test_every_sensor_of_the_original_has_its_size() -> None:
    assert {sensor.id: sensor.size for sensor in LEGACY_SENSORS.values()} == SIZES
    table = Translation(entries(*LAYOUTS)).table
    (length,) = struct.unpack(">I", table[:4])
    assert length == len(table) - 4 == 5 * len(SIZES)
    assert dict(struct.iter_unpack(">BI", table[4:])) == SIZES


def test_readings_are_picked_and_put_in_the_originals_order() -> None:
    translation = Translation(entries("black_white_location", "rgb_ground", "destination"))
    values = [
        (struct.pack("<4f", 1, 2, 3, 4), 7),
        (bytes([10, 20, 30, 255]), 7),
        (struct.pack("<5f", 0.5, -0.25, 3.0, 8.0, 9.0), -1),
    ]
    payloads = translation.payloads(values)
    assert payloads[5] == bytes([30, 20, 10]), "blue first"
    assert [real(payloads[8][at : at + 12]) for at in range(0, 48, 12)] == [3, 4, 1, 2]
    assert set(payloads) == {5, 8}, "what was never measured is not told"


def test_what_is_no_number_is_not_told_and_bytes_keep_to_their_range() -> None:
    """A user's own sensor of the original's name may give anything."""
    rows = [Entry(1, "pollutant", "f4"), Entry(2, "rgb_ground", "3*f4"), Entry(3, "gps", "3*f4")]
    values = [
        (struct.pack("<f", math.nan), 7),
        (struct.pack("<3f", -5.0, 1e9, 20.0), 7),
        (struct.pack("<3f", 1.0, math.inf, 2.0), 7),
    ]
    assert Translation(rows).payloads(values) == {5: bytes([20, 255, 0])}


def test_update_holds_what_it_is_given() -> None:
    assert update([]) == b""
    assert update([(5, b"abc"), (7, b"x" * 12)]) == b"\0\0\0\x11\x05abc\x07" + b"x" * 12


def test_what_the_original_does_not_know_is_left_out_and_named() -> None:
    others = [
        Entry(1, "pheromone", "3*f4"),
        Entry(2, "gps", "3*f4"),
        Entry(3, "leds", "u1", Direction.ACTUATOR),
    ]
    translation = Translation(others)
    assert translation.unknown == ["pheromone"]
    values = [(struct.pack("<3f", 9, 9, 9), 7), (struct.pack("<3f", 1, 2, 3), 7)]
    assert [real(translation.payloads(values)[3][at : at + 12]) for at in (0, 12, 24)] == [1, 2, 3]


def test_an_experiment_without_any_of_its_sensors_is_refused() -> None:
    with pytest.raises(LinkError, match=r"pheromone$"):
        Translation([Entry(1, "pheromone", "3*f4")])
    with pytest.raises(LinkError, match=r"it has none$"):
        Translation([])


def test_a_sensor_with_too_few_numbers_is_refused() -> None:
    with pytest.raises(LinkError, match=r"8.*'light'.*4"):
        Translation([Entry(1, "light", "4*f4")])
