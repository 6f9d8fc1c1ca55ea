"""A V4L2 device's controls, read and set beside whatever program takes its pictures."""

from __future__ import annotations

import fcntl
import os
import struct
from collections.abc import Callable
from enum import IntEnum

_QUERY, _GET, _SET = 0xC0445624, 0xC008561B, 0xC008561C
"""VIDIOC_QUERYCTRL, VIDIOC_G_CTRL and VIDIOC_S_CTRL. Source: Linux, videodev2.h."""
_VALUE = struct.Struct("Ii")
_LIMITS = struct.Struct("II32siiiiI8x")
_DISABLED = 1

Ioctl = Callable[[int, int, bytes], bytes]


class Control(IntEnum):
    """Numbers of controls. Source: Linux, v4l2-controls.h."""

    AUTOGAIN = 0x00980912
    GAIN = 0x00980913
    EXPOSURE_AUTO = 0x009A0901
    EXPOSURE = 0x009A0902


class Device:
    """A device node, open as long as the process: a command looks through few of them."""

    def __init__(self, path: str, ioctl: Ioctl = fcntl.ioctl) -> None:
        """Opens it.

        Raises:
            OSError: it is not there, or not ours to open.
        """
        self._ioctl = ioctl
        self._file = os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)

    def get(self, control: Control) -> int | None:
        """Reads a control; None: the device does not have it."""
        try:
            answer = self._ioctl(self._file, _GET, _VALUE.pack(control, 0))
        except OSError:
            return None
        return int(_VALUE.unpack(answer)[1])

    def set(self, control: Control, value: int) -> bool:
        """Sets a control, which may be rounded; whether the device took it."""
        try:
            self._ioctl(self._file, _SET, _VALUE.pack(control, value))
        except OSError:
            return False
        return True

    def bounds(self, control: Control) -> tuple[int, int] | None:
        """Gives the least and the greatest value; None: the device does not have it."""
        try:
            asked = _LIMITS.pack(control, 0, b"", 0, 0, 0, 0, 0)
            answer = _LIMITS.unpack(self._ioctl(self._file, _QUERY, asked))
        except OSError:
            return None
        return None if answer[7] & _DISABLED else (answer[3], answer[4])
