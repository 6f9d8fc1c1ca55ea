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
        ("age_ns", "i8"),
        ("capture_ns", "i8"),
        ("stale", "?"),
        ("known", "?"),
        ("value", "f8"),
    ]
)
"""One control step of one robot; all times on the host's clock.

`now_ns` is when the controller was called, `rx_ns` when the datagram had come that brought the
newest capture, `newest_ns` the time of that capture, `age_ns` what the daemon took for its age,
`known` whether the controller held a value at all, `value` the value, `capture_ns` when that was
measured, and `stale` whether it is too old to act on.
"""


STALE_TIMESTEPS = 2.5
"""A value older than this is stale: `VS_STALE_TENTHS` in `robot/robot.h`."""


def read_trace(robot: Robot, sensor: str, dt_ns: int) -> NDArray[np.void]:
    """Reads a robot's trace for one of its virtual sensors.

    Args:
        robot: whose trace, and how wrong its clock is.
        sensor: the sensor's name; its layout is one single.
        dt_ns: length of a timestep.

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
    trace = np.array(rows, TRACE)
    # As the daemon told the controller: by its own idea of the value's age.
    age_ns = trace["age_ns"] + trace["newest_ns"] - trace["capture_ns"]
    trace["stale"] = ~trace["known"] | (age_ns > STALE_TIMESTEPS * dt_ns)
    return trace


def _row(robot: Robot, words: list[str], sensor: str, where: str) -> tuple[object, ...]:
    fields = dict(zip(words[::2], words[1::2]))
    try:
        value, capture_ns = _value(fields["values"], sensor)
        return (
            int(fields["step"]),
            int(fields["timestep"]),
            robot.host_time_ns(int(fields["now_ns"])),
            robot.host_time_ns(int(fields["rx_ns"])),
            int(fields["capture_ns"]),
            int(fields["age_ns"]),
            capture_ns,
            False,
            value is not None,
            0.0 if value is None else value,
        )
    except (KeyError, ValueError) as error:
        raise LabError(f"{where}: not a trace line: {error}") from None


def _value(text: str, sensor: str) -> tuple[float | None, int]:
    """Value and capture time of a sensor in "name=hex@ns,..."; None and 0 if never measured."""
    held = dict(item.split("=", 1) for item in text.split(","))[sensor]
    if held == "-":
        return None, 0
    digits, capture = held.split("@")
    return float(struct.unpack("<f", bytes.fromhex(digits))[0]), int(capture)
