"""The truth log: where every body was at every capture, in a compact file for the report.

The file is a header, the number of bodies, and one record per timestep, all little endian.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vsense.lab.shared import LabError

_HEADER = struct.Struct("<8sQ")
_MAGIC = b"vstruth2"


def truth_dtype(bodies: int) -> np.dtype[np.void]:
    """One timestep of a truth log.

    Fields:
        timestep: number of the trigger.
        capture_ns: middle of the exposure.
        ready_ns: the last picture was in memory.
        render_ns: how long it took to draw the bodies: the lab's readout of the sensor.
        poses: (bodies, 3) x [m], y [m], yaw [rad] at capture_ns, arena frame.
        leds: (bodies,) LED bits at capture_ns: 0-7 ring, 8 body, 9 front.
    """
    return np.dtype(
        [
            ("timestep", "<i8"),
            ("capture_ns", "<i8"),
            ("ready_ns", "<i8"),
            ("render_ns", "<i8"),
            ("poses", "<f8", (bodies, 3)),
            ("leds", "<u2", (bodies,)),
        ]
    )


class TruthLog:
    """Writes a truth log."""

    def __init__(self, path: Path, bodies: int) -> None:
        """Begins a new file.

        Raises:
            LabError: The file cannot be written.
        """
        self._record = np.zeros(1, dtype=truth_dtype(bodies))
        try:
            self._file = path.open("wb", buffering=0)
            self._file.write(_HEADER.pack(_MAGIC, bodies))
        except OSError as error:
            raise LabError(f"truth log {path}: {error.strerror}") from None

    def append(
        self,
        timestep: int,
        capture_ns: int,
        ready_ns: int,
        render_ns: int,
        poses: NDArray[np.float64],
        leds: NDArray[np.uint16],
    ) -> None:
        """Adds one timestep; see `truth_dtype`."""
        self._record[0] = (timestep, capture_ns, ready_ns, render_ns, poses, leds)
        try:
            self._file.write(self._record.tobytes())
        except OSError as error:
            raise LabError(f"truth log {self._file.name}: {error.strerror}") from None

    def close(self) -> None:
        """Ends the file."""
        try:
            self._file.close()
        except OSError as error:
            raise LabError(f"truth log {self._file.name}: {error.strerror}") from None


def read_truth(path: Path) -> NDArray[np.void]:
    """Reads a truth log, also one whose writer was killed in the middle of a record.

    Returns:
        (timesteps,) `truth_dtype`.

    Raises:
        LabError: The file cannot be read, or is no truth log.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise LabError(f"truth log {path}: {error.strerror}") from None
    if len(content) < _HEADER.size:
        raise LabError(f"truth log {path}: {len(content)} bytes are no truth log")
    magic, bodies = _HEADER.unpack_from(content)
    if magic != _MAGIC:
        raise LabError(f"truth log {path}: begins with {magic!r}, expected {_MAGIC!r}")
    dtype = truth_dtype(bodies)
    whole = (len(content) - _HEADER.size) // dtype.itemsize
    return np.frombuffer(content, dtype=dtype, count=whole, offset=_HEADER.size)
