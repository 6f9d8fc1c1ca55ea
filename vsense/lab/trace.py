"""Reads the trace that `vsensed --trace` writes: what each controller held at every step."""

from __future__ import annotations

import struct
from collections.abc import Sequence

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
        ("left", "i8"),
        ("right", "i8"),
    ]
)
"""One control step of one robot; all times on the host's clock.

`now_ns` is when the controller was called, `rx_ns` when the datagram had come that brought the
newest capture, `newest_ns` the time of that capture. `known` says whether the controller held a
value of every virtual sensor, `value` that of the one that is judged, `capture_ns` when it was
measured (the oldest one, where none is judged); `age_ns` (-1: unknown) and `stale` are what the
daemon told the controller about it. `left` and `right` are the wheels' speeds [steps/s] that the
step commanded.
"""

UNKNOWN_AGE = -1


def read_trace(robot: Robot, sensors: Sequence[str], judged: str | None) -> NDArray[np.void]:
    """Reads a robot's trace.

    Args:
        robot: whose trace, and how wrong its clock is.
        sensors: its virtual sensors.
        judged: the one of them whose value is read, one single; None: no value is read.

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
            rows.append(_row(robot, words, sensors, judged, f"{robot.trace}:{number}"))
    return np.array(rows, TRACE)


def _row(
    robot: Robot, words: list[str], sensors: Sequence[str], judged: str | None, where: str
) -> tuple[object, ...]:
    fields = dict(zip(words[::2], words[1::2]))
    try:
        return (
            int(fields["step"]),
            int(fields["timestep"]),
            robot.host_time_ns(int(fields["now_ns"])),
            robot.host_time_ns(int(fields["rx_ns"])),
            int(fields["capture_ns"]),
            *_held(fields["values"], sensors, judged),
            int(fields["left"]),
            int(fields["right"]),
        )
    except (KeyError, ValueError) as error:
        raise LabError(f"{where}: not a trace line: {error}") from None


def _held(
    text: str, sensors: Sequence[str], judged: str | None
) -> tuple[bool, float, int, int, bool]:
    """Known, value, capture, age and stale out of "name=hex@capture:age:stale,...".

    The times are those of the judged sensor; without one the oldest counts, so that no fresh
    sensor hides another's age.
    """
    found = dict(item.split("=", 1) for item in text.split(",")) if sensors else {}
    held = [found[name] for name in sensors]
    if not held or "-" in held:
        return False, 0.0, 0, UNKNOWN_AGE, True
    told = held if judged is None else [found[judged]]
    times = [item.split("@")[1].split(":") for item in told]
    capture, age, stale = min(times, key=lambda time: int(time[0]))
    value = 0.0
    if judged is not None:
        (value,) = struct.unpack("<f", bytes.fromhex(found[judged].split("@")[0]))
    return True, value, int(capture), int(age), stale != "0"
