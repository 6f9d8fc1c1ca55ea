"""Reads the trace that `vsensed --trace` writes: what each controller held at every step."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from vsense.lab.shared import LabError
from vsense.lab.swarm import Robot

TRACE = np.dtype(
    [
        ("step", "i8"),
        ("timestep", "i8"),
        ("now_ns", "i8"),
        ("rx_ns", "i8"),
        ("newest_ns", "i8"),
        ("known", "?"),
        ("value", "f8"),
        ("capture_ns", "i8"),
        ("age_ns", "i8"),
        ("stale", "?"),
    ]
)
"""One control step of one robot; all times on the host's clock.

`now_ns` is when the controller was called, `rx_ns` when the datagram had come that brought the
newest capture, `newest_ns` the time of that capture. `known` says whether the controller held a
value at all, `value` which, `capture_ns` when that was measured; `age_ns` (-1: unknown) and
`stale` are what the daemon told the controller about it.
"""

UNKNOWN_AGE = -1


def read_trace(robot: Robot, sensor: str | None) -> NDArray[np.void]:
    """Reads a robot's trace for one of its virtual sensors.

    Args:
        robot: whose trace, and how wrong its clock is.
        sensor: the sensor's name, whose layout is one single; None: no value is read.

    Returns:
        (n,) TRACE; empty where the daemon never made a step. A last line that was cut off by the
        daemon's death is left out.

    Raises:
        LabError: a line is no trace line.
    """
    if not robot.trace.is_file():
        return np.empty(0, TRACE)
    rows = []
    for number, line in enumerate(robot.trace.read_text().splitlines(keepends=True), 1):
        words = line.split()
        if line.endswith("\n") and words and words[0] == "step":
            rows.append(_row(robot, words, sensor, f"{robot.trace}:{number}"))
    return np.array(rows, TRACE)


def _row(robot: Robot, words: list[str], sensor: str | None, where: str) -> tuple[object, ...]:
    fields = dict(zip(words[::2], words[1::2]))
    try:
        return (
            int(fields["step"]),
            int(fields["timestep"]),
            robot.host_time_ns(int(fields["now_ns"])),
            robot.host_time_ns(int(fields["rx_ns"])),
            int(fields["capture_ns"]),
            *_value(fields["values"], sensor),
        )
    except (KeyError, ValueError) as error:
        raise LabError(f"{where}: not a trace line: {error}") from None


def _value(text: str, sensor: str | None) -> tuple[bool, float, int, int, bool]:
    """Known, value, capture, age and stale of a sensor in "name=hex@capture:age:stale,..."."""
    if sensor is None:
        return False, 0.0, 0, UNKNOWN_AGE, True
    held = dict(item.split("=", 1) for item in text.split(","))[sensor]
    if held == "-":
        return False, 0.0, 0, UNKNOWN_AGE, True
    digits, times = held.split("@")
    capture, age, stale = times.split(":")
    (value,) = struct.unpack("<f", bytes.fromhex(digits))
    return True, float(value), int(capture), int(age), stale != "0"
