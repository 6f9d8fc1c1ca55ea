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
        ("capture_ns", "i8"),
        ("age_ns", "i8"),
        ("stale", "?"),
        ("known", "?"),
        ("value", "f8"),
    ]
)
"""One control step of one robot; all times on the host's clock.

`now_ns` is when the controller was called, `rx_ns` when the datagram had come that brought the
newest capture, `capture_ns` the capture time of the value, `age_ns` what the daemon took for the
value's age, `known` whether it held one at all, and `value` the value.
"""


def read_trace(robot: Robot, sensor: str) -> NDArray[np.void]:
    """Reads a robot's trace for one of its virtual sensors.

    Args:
        robot: whose trace, and how wrong its clock is.
        sensor: the sensor's name; its layout is one single.

    Returns:
        (n,) TRACE; empty where the daemon never made a step. A last line that was cut off by the
        daemon's death is left out.

    Raises:
        LabError: a line is no trace line.
    """
    if not robot.trace.is_file():
        return np.empty(0, TRACE)
    lines = robot.trace.read_text().splitlines(keepends=True)
    rows = []
    for number, line in enumerate(lines, 1):
        words = line.split()
        if not line.endswith("\n") or not words or words[0] != "step":
            continue
        rows.append(_row(robot, words, sensor, f"{robot.trace}:{number}"))
    return np.array(rows, TRACE)


def _row(robot: Robot, words: list[str], sensor: str, where: str) -> tuple[object, ...]:
    fields = dict(zip(words[::2], words[1::2]))
    try:
        value = _value(fields["values"], sensor)
        return (
            int(fields["step"]),
            int(fields["timestep"]),
            robot.host_time_ns(int(fields["now_ns"])),
            robot.host_time_ns(int(fields["rx_ns"])),
            int(fields["capture_ns"]),
            min(int(fields["age_ns"]), 2**63 - 1),
            fields["stale"] != "0",
            value is not None,
            0.0 if value is None else value,
        )
    except (KeyError, ValueError) as error:
        raise LabError(f"{where}: not a trace line: {error}") from None


def _value(text: str, sensor: str) -> float | None:
    """The value of a sensor in "name=hex,name=hex", None where it was never measured."""
    held = dict(item.split("=", 1) for item in text.split(","))[sensor]
    return None if held == "-" else float(struct.unpack("<f", bytes.fromhex(held))[0])
