"""The original virtual sensor protocol: what the host says to a robot that still runs its client.

All integers are big-endian; the robot never says anything. First the table, u32 length and
entries (u8 sensor, u32 payload size); a bare u32 1 when the experiment starts; then at most once
per timestep u32 length and entries (u8 sensor, payload) of what has changed; a bare u32 0 when the
experiment ends. A real number is an i64 mantissa and an i32 exponent.

Source: iridia.md section 1b; black and white location: argos3-tycho's
ci_virtual_black_white_location_sensor.h (white x, y, black x, y).
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from vsense.link.status import LinkError
from vsense.link.table import Direction, Entry

DEFAULT_PORT = 4050

START = struct.pack(">I", 1)
END = struct.pack(">I", 0)

MAX_MANTISSA = float(2**63 - 2)
"""ARGoS's largest SInt64 less one; as a double it is 2^63."""

REAL_SIZE = 12

_REAL = struct.Struct(">qi")
_ROW = struct.Struct(">BI")
_LENGTH = struct.Struct(">I")
_TYPES = {"u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I", "f4": "f"}
_LAYOUT = re.compile(r"(?:(\d+)\*)?(\w\d)")


@dataclass(frozen=True, slots=True)
class LegacySensor:
    """A virtual sensor of the original.

    Attributes:
        id: its number on the wire.
        picks: which of our sensor's numbers travel, in this order.
        reals: they travel as real numbers; False: as one byte each.
    """

    id: int
    picks: tuple[int, ...]
    reals: bool = True

    @property
    def size(self) -> int:
        """Bytes of its payload."""
        return len(self.picks) * (REAL_SIZE if self.reals else 1)


SENSORS = {
    "ground": LegacySensor(1, (0, 1, 2)),
    "light": LegacySensor(2, tuple(range(8))),
    "gps": LegacySensor(3, (0, 1, 2)),
    "destination": LegacySensor(4, (0, 1, 2)),
    "rgb_ground": LegacySensor(5, (0, 1, 2), reals=False),
    "radiation": LegacySensor(6, (0,)),
    "pollutant": LegacySensor(7, (0,)),
    "black_white_location": LegacySensor(8, (2, 3, 0, 1)),
}
"""By the name of ours. The original's robots know no others."""


def encode_real(value: float) -> bytes:
    """Returns a finite number's 12 bytes."""
    if value == 0.0:
        return _REAL.pack(0, 0)
    fraction, exponent = math.frexp(abs(value))
    mantissa = int((fraction - 0.5) * 2.0 * MAX_MANTISSA) + 1
    return _REAL.pack(-mantissa if value < 0.0 else mantissa, exponent)


class Translation:
    """Our readings in the original's words.

    Attributes:
        table: what a robot is told first.
        unknown: names of virtual sensors that the original's robots do not know.
    """

    def __init__(self, entries: Sequence[Entry]) -> None:
        """Prepares it.

        Args:
            entries: the sensor table: of sensors and actuators, in the order of the readings.

        Raises:
            LinkError: not one sensor of it is the original's, or one gives too few numbers.
        """
        sensors = [e for e in entries if e.direction == Direction.SENSOR]
        self._rows: list[tuple[int, LegacySensor, struct.Struct]] = []
        for index, entry in enumerate(sensors):
            known = SENSORS.get(entry.name)
            if known is not None:
                self._rows.append((index, known, _numbers(entry, known)))
        self.unknown = [entry.name for entry in sensors if entry.name not in SENSORS]
        if not self._rows:
            raise LinkError(
                f"robots with the original client know none of this experiment's virtual sensors:"
                f" {', '.join(self.unknown) or 'it has none'}"
            )
        rows = b"".join(_ROW.pack(known.id, known.size) for _, known, _ in self._rows)
        self.table = _LENGTH.pack(len(rows)) + rows

    def payloads(self, values: Sequence[tuple[bytes, int]]) -> dict[int, bytes]:
        """Translates one robot's readings.

        Args:
            values: (value as on our wire, capture time) of each sensor, in the table's order;
                a capture time below 0: not measured yet.

        Returns:
            Payloads by the sensor's number, of those that have been measured.
        """
        found = {}
        for index, known, numbers in self._rows:
            value, capture_ns = values[index]
            if capture_ns >= 0:
                ours = numbers.unpack_from(value)
                found[known.id] = _payload(known, [ours[pick] for pick in known.picks])
        return found


def update(payloads: Iterable[tuple[int, bytes]]) -> bytes:
    """Returns the message of a timestep, b"" where nothing has changed."""
    body = b"".join(bytes([number]) + payload for number, payload in payloads)
    return _LENGTH.pack(len(body)) + body if body else b""


def _numbers(entry: Entry, known: LegacySensor) -> struct.Struct:
    """How our own readings are read."""
    match = _LAYOUT.fullmatch(entry.layout)
    assert match is not None, "the table has checked it"
    count = int(match[1] or 1)
    if count <= max(known.picks):
        raise LinkError(
            f"robots with the original client expect {len(known.picks)} numbers of the sensor"
            f" {entry.name!r}, this experiment's gives {count}"
        )
    return struct.Struct(f"<{count}{_TYPES[match[2]]}")


def _payload(known: LegacySensor, numbers: Sequence[float]) -> bytes:
    if known.reals:
        return b"".join(map(encode_real, numbers))
    return bytes(int(number) for number in numbers)
