"""The original virtual sensor protocol, sans-I/O: host to robots that still run its client.

LEGACY.md specifies the bytes. Source: iridia.md section 1b; black and white location:
argos3-tycho's ci_virtual_black_white_location_sensor.h (white x, y, black x, y).

Of readings only the newest wait: a robot that is slow to take them misses those between, as with
the original, but holds up no other robot and grows no queue.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from vsense.robots.link.status import LinkError
from vsense.robots.link.table import Direction, Entry

START_MESSAGE = struct.pack(">I", 1)
END_MESSAGE = struct.pack(">I", 0)

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


LEGACY_SENSORS = {
    "ground": LegacySensor(1, (0, 1, 2)),
    "light": LegacySensor(2, tuple(range(8))),
    "gps": LegacySensor(3, (0, 1, 2)),
    "destination": LegacySensor(4, (0, 1, 2)),
    # Blue first, as its reader expects; see LEGACY.md.
    "rgb_ground": LegacySensor(5, (2, 1, 0), reals=False),
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
    """Readings in the order of the sensor table's `entries`, in the original's encoding.

    Attributes:
        table: what a robot is sent first.
        unknown: names of virtual sensors that the original's robots do not know.

    Raises:
        LinkError: not one sensor of it is the original's, or one gives too few numbers.
    """

    def __init__(self, entries: Sequence[Entry]) -> None:
        sensors = [e for e in entries if e.direction == Direction.SENSOR]
        self._rows: list[tuple[int, LegacySensor, struct.Struct]] = []
        for index, entry in enumerate(sensors):
            sensor = LEGACY_SENSORS.get(entry.name)
            if sensor is not None:
                self._rows.append((index, sensor, _numbers(entry, sensor)))
        self.unknown = [entry.name for entry in sensors if entry.name not in LEGACY_SENSORS]
        if not self._rows:
            raise LinkError(
                f"robots with the original client know none of this experiment's virtual sensors:"
                f" {', '.join(self.unknown) or 'it has none'}"
            )
        rows = b"".join(_ROW.pack(sensor.id, sensor.size) for _, sensor, _ in self._rows)
        self.table = _LENGTH.pack(len(rows)) + rows

    def payloads(self, values: Sequence[tuple[bytes, int]]) -> dict[int, bytes]:
        """Translates one robot's readings that have been measured; gives them by sensor number.

        `values` are (value as on our wire, capture time) in the table's order; a time below 0
        means that it was never measured. What is no number cannot be said either.
        """
        by_number = {}
        for index, sensor, numbers in self._rows:
            value, capture_ns = values[index]
            if capture_ns >= 0:
                ours = numbers.unpack_from(value)
                picked = [ours[pick] for pick in sensor.picks]
                if all(map(math.isfinite, picked)):
                    by_number[sensor.id] = _payload(sensor, picked)
        return by_number


def translations(entries: Mapping[int, Sequence[Entry]]) -> dict[int, Translation]:
    """Translates the sensor tables of robots, by tag; those of which nothing is known are left out.

    Raises:
        LinkError: that is all of them, or see `Translation`.
    """
    tables = {tag: tuple(rows) for tag, rows in entries.items()}
    served = {tag: rows for tag, rows in tables.items() if any(map(_is_known, rows))}
    translated = {rows: Translation(rows) for rows in (served or tables).values()}
    return {tag: translated[rows] for tag, rows in served.items()}


def _is_known(entry: Entry) -> bool:
    return entry.direction == Direction.SENSOR and entry.name in LEGACY_SENSORS


def update(payloads: Iterable[tuple[int, bytes]]) -> bytes:
    """Returns the message of a timestep, b"" where nothing has changed."""
    body = b"".join(bytes([number]) + payload for number, payload in payloads)
    return _LENGTH.pack(len(body)) + body if body else b""


def _numbers(entry: Entry, sensor: LegacySensor) -> struct.Struct:
    match = _LAYOUT.fullmatch(entry.layout)
    assert match is not None, "the table has checked it"
    count = int(match[1] or 1)
    if count <= max(sensor.picks):
        raise LinkError(
            f"robots with the original client expect {len(sensor.picks)} numbers of the sensor"
            f" {entry.name!r}, this experiment's gives {count}"
        )
    return struct.Struct(f"<{count}{_TYPES[match[2]]}")


def _payload(sensor: LegacySensor, numbers: Sequence[float]) -> bytes:
    if sensor.reals:
        return b"".join(map(encode_real, numbers))
    return bytes(min(max(int(number), 0), 255) for number in numbers)


OCTET_MAX = 254


class LegacyRobot:
    """One connection's state; in `updates` timesteps the robot was sent something."""

    def __init__(self, tag: int, name: str, table: bytes) -> None:
        self.tag = tag
        self.name = name
        self.updates = 0
        self._out = table
        self._running = False
        self._ended = False
        self._newest: Mapping[int, bytes] = {}
        self._sent: dict[int, bytes] = {}

    def start(self) -> None:
        """The experiment starts, or has started before this robot came."""
        if not self._running and not self._ended:
            self._running = True
            self._out += START_MESSAGE

    def end(self) -> None:
        """The experiment ends: nothing follows, as the original's robots expect nothing more."""
        self._ended = self._ended or self._running

    def sense(self, payloads: Mapping[int, bytes]) -> None:
        """Takes the newest readings, by the sensor's number; after the end none."""
        if not self._ended:
            self._newest = payloads

    @property
    def pending(self) -> bool:
        return bool(self.chunk())

    def chunk(self) -> bytes:
        """The bytes to write next; empty if there are none.

        What has begun to leave is finished first. Only then is the next message made, of all that
        differs from what this robot was sent last; the end comes after the newest readings.
        """
        if not self._out and self._running:
            changed = {k: p for k, p in self._newest.items() if self._sent.get(k) != p}
            self._out = update(changed.items())
            self._sent |= changed
            self.updates += bool(changed)
            if self._ended and not changed:
                self._running, self._out = False, END_MESSAGE
        return self._out

    def wrote(self, count: int) -> None:
        """See `PendingOutput.wrote`."""
        self._out = self._out[count:]


class LegacySwarm:
    """The robots of an experiment that are connected, and what all are sent.

    `translations` has that of each robot by its tag, those without one cannot come; `numbers` has
    tag and name of each robot, `robots` those that are connected, by the last octet of their
    addresses.
    """

    def __init__(
        self, translations: Mapping[int, Translation], numbers: Mapping[int, tuple[int, str]]
    ) -> None:
        self.translations = dict(translations)
        self.robots: dict[int, LegacyRobot] = {}
        self._numbers = dict(numbers)
        self._payloads: dict[int, Mapping[int, bytes]] = {}
        self._running = False

    def join(self, octet: int) -> LegacyRobot | None:
        """Adds a robot, anew if it comes again; None: it cannot come, see `why_not`."""
        if not self.expects(octet):
            return None
        tag, name = self._numbers[octet]
        robot = LegacyRobot(tag, name, self.translations[tag].table)
        robot.sense(self._payloads.get(tag, {}))
        if self._running:
            robot.start()
        self.robots[octet] = robot
        return robot

    def leave(self, octet: int, robot: LegacyRobot) -> bool:
        """Forgets a robot; False if it had come again meanwhile."""
        if self.robots.get(octet) is not robot:
            return False
        del self.robots[octet]
        return True

    def start(self) -> None:
        self._running = True
        for robot in self.robots.values():
            robot.start()

    def end(self) -> None:
        self._running = False
        for robot in self.robots.values():
            robot.end()

    def sense(self, tag: int, payloads: Mapping[int, bytes]) -> None:
        self._payloads[tag] = payloads
        for robot in self.robots.values():
            if robot.tag == tag:
                robot.sense(payloads)

    def expects(self, octet: int) -> bool:
        """Whether a robot with this number may come."""
        return self._numbers.get(octet, (-1, ""))[0] in self.translations

    def why_not(self, octet: int) -> str:
        """Why a robot with this number cannot come, for people."""
        if octet in self._numbers:
            name = self._numbers[octet][1]
            return f"{name} has none of the virtual sensors that the original client knows"
        numbers = ", ".join(map(str, sorted(self._numbers))) or "none"
        return f"no robot's number is {octet}; expected: {numbers}"

    @property
    def unknown(self) -> tuple[str, ...]:
        """Names of virtual sensors that the original's robots do not know, each once."""
        every = (name for translation in self.translations.values() for name in translation.unknown)
        return tuple(dict.fromkeys(every))


def by_octet(robots: Mapping[int, tuple[str, int]]) -> dict[int, tuple[int, str]]:
    """Sorts an experiment's robots by the last octet of their addresses.

    `robots` has name and number of each by tag; the number is the last part of its id
    (NAME_TAG_NUMBER). Robots whose number is no octet of an address are left out.

    Raises:
        LinkError: two have the same number, or none has one.
    """
    by_number: dict[int, tuple[int, str]] = {}
    for tag, (name, number) in robots.items():
        if not 1 <= number <= OCTET_MAX:
            continue
        if number in by_number:
            raise LinkError(
                f"{by_number[number][1]} and {name} have the same number {number}: with the"
                " original client a robot is known by it, the last octet of its address"
            )
        by_number[number] = (tag, name)
    if not by_number:
        raise LinkError(
            "no robot's id ends with the last octet of an address (NAME_TAG_OCTET, such as"
            " epuck_23_30): so robots with the original client are known"
        )
    return by_number
