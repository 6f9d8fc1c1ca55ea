"""V4L2 devices: their list, their abilities and their controls, asked of the kernel.

Controls can be read and set while another program takes the pictures. Source of all numbers and
layouts: Linux, <linux/videodev2.h> and <asm-generic/ioctl.h>.
"""

from __future__ import annotations

import errno
import fcntl
import os
import re
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any

from vsense.base.terminal import printable

_QUERY, _GET, _SET = 0xC0445624, 0xC008561B, 0xC008561C
"""VIDIOC_QUERYCTRL, VIDIOC_G_CTRL and VIDIOC_S_CTRL. Source: Linux, videodev2.h."""
_VALUE = struct.Struct("Ii")
_LIMITS = struct.Struct("II32siiiiI8x")
_DISABLED = 1

ControlIoctl = Callable[[int, int, bytes], bytes]


class V4l2Control(IntEnum):
    """Numbers of controls. Source: Linux, v4l2-controls.h."""

    AUTOGAIN = 0x00980912
    GAIN = 0x00980913
    EXPOSURE_AUTO = 0x009A0901
    EXPOSURE = 0x009A0902


class V4l2ControlDevice:
    """A device node that stays open as long as the process."""

    def __init__(self, path: str, ioctl: ControlIoctl = fcntl.ioctl) -> None:
        """Opens it; raises OSError where it is missing or not permitted."""
        self._ioctl = ioctl
        self._file = os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)

    def get(self, control: V4l2Control) -> int | None:
        """Reads a control; None: the device does not have it."""
        try:
            answer = self._ioctl(self._file, _GET, _VALUE.pack(control, 0))
        except OSError:
            return None
        return int(_VALUE.unpack(answer)[1])

    def set(self, control: V4l2Control, value: int) -> bool:
        """Sets a control, which may be rounded; returns whether the device took it."""
        try:
            self._ioctl(self._file, _SET, _VALUE.pack(control, value))
        except OSError:
            return False
        return True

    def bounds(self, control: V4l2Control) -> tuple[int, int] | None:
        """Returns the least and the greatest value; None: the device does not have it."""
        try:
            asked = _LIMITS.pack(control, 0, b"", 0, 0, 0, 0, 0)
            answer = _LIMITS.unpack(self._ioctl(self._file, _QUERY, asked))
        except OSError:
            return None
        return None if answer[7] & _DISABLED else (answer[3], answer[4])


Ioctl = Callable[[int, int, bytearray], object]
"""Descriptor, request, and the struct that the kernel fills; OSError where it refuses."""

Struct = tuple[Any, ...]

_CAPABILITY = struct.Struct("=16s32s32s3I12x")
"""driver, card, bus_info, version, capabilities, device_caps."""
_FORMAT = struct.Struct("=3I32s2I12x")
"""index, type, flags, description, pixelformat, mbus_code."""
_SIZE = struct.Struct("=3I6I8x")
"""index, pixel_format, type; width and height, or least, most and step of each."""
_INTERVAL = struct.Struct("=5I6I8x")
"""index, pixel_format, width, height, type; a fraction in s, or the least, most and step."""

_READ, _WRITE = 2, 1


def _request(direction: int, number: int, layout: struct.Struct) -> int:
    return direction << 30 | layout.size << 16 | ord("V") << 8 | number


QUERYCAP = _request(_READ, 0, _CAPABILITY)
ENUM_FMT = _request(_READ | _WRITE, 2, _FORMAT)
ENUM_FRAMESIZES = _request(_READ | _WRITE, 74, _SIZE)
ENUM_FRAMEINTERVALS = _request(_READ | _WRITE, 75, _INTERVAL)

_HAS_DEVICE_CAPS = 0x80000000
_CAPTURES = {0x00000001: 1, 0x00001000: 9}
"""Capability to capture -> its buffer type: in one plane, or in several."""
_DISCRETE = 1
_MOST = 256
"""Limit of formats, sizes or rates, in case a driver never ends its list."""

_NODE = re.compile(r"video([0-9]+)")


@dataclass(frozen=True, slots=True)
class V4l2Device:
    """A camera as the kernel describes it; None and "" are unknown.

    Its formats have four letters each; `bus` is where it is plugged in; `size_px` is (width,
    height) of its largest picture, and `rate_hz` the highest rate at that size. `trouble` is why
    it cannot be used, or "".
    """

    path: str
    name: str
    bus: str
    formats: tuple[str, ...]
    size_px: tuple[int, int] | None
    rate_hz: float | None
    trouble: str


def node(device: str) -> str:
    """Returns the node of a device that may be a number alone: "/dev/video0" of "0"."""
    return f"/dev/video{device}" if device.isdecimal() else device


def devices(folder: Path = Path("/dev"), ioctl: Ioctl = fcntl.ioctl) -> list[V4l2Device]:
    """Lists what can capture; a node that does not open is listed with the reason."""
    try:
        names = os.listdir(folder)
    except OSError:
        return []
    numbers = sorted(int(match[1]) for match in map(_NODE.fullmatch, names) if match)
    asked = (_ask(folder / f"video{number}", ioctl) for number in numbers)
    return [device for device in asked if device is not None]


def _ask(path: Path, ioctl: Ioctl) -> V4l2Device | None:
    """Opens a node and describes it; None where it cannot capture."""
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        return V4l2Device(str(path), "", "", (), None, None, _reason(error))
    try:
        return _Node(descriptor, ioctl).describe(str(path))
    finally:
        os.close(descriptor)


def _reason(error: OSError) -> str:
    if error.errno == errno.EACCES:
        return "no permission: add yourself to the group video"
    return f"does not open: {error.strerror}"


class _Node:
    def __init__(self, descriptor: int, ioctl: Ioctl) -> None:
        self._descriptor = descriptor
        self._ioctl = ioctl

    def describe(self, path: str) -> V4l2Device | None:
        """Describes it; None where it is no V4L2 device, or cannot capture."""
        answer = self._call(QUERYCAP, _CAPABILITY, bytes(16), bytes(32), bytes(32), 0, 0, 0)
        if answer is None:
            return None
        _, card, bus, _, capabilities, own = answer
        # The capabilities are those of all nodes of the camera; its own are this node's.
        can = own if capabilities & _HAS_DEVICE_CAPS else capabilities
        kinds = [kind for flag, kind in _CAPTURES.items() if can & flag]
        if not kinds:
            return None
        rows = self._rows(ENUM_FMT, _FORMAT, kinds[0], 0, bytes(32), 0, 0)
        formats = [row[4] for row in rows]
        size_px, rate_hz = self._best(formats)
        names = tuple(_four_letters(code) for code in formats)
        return V4l2Device(path, _text(card), _text(bus), names, size_px, rate_hz, trouble="")

    def _best(self, formats: list[int]) -> tuple[tuple[int, int] | None, float | None]:
        """Returns the largest picture in any format, and its highest rate."""
        sizes = {code: set(self._sizes(code)) for code in formats}
        all_sizes = set().union(*sizes.values())
        if not all_sizes:
            return None, None
        largest = max(all_sizes, key=lambda size: (size[0] * size[1], size))
        having = [code for code in formats if largest in sizes[code]]
        rates = [rate for code in having for rate in self._rates(code, largest)]
        return largest, max(rates, default=None)

    def _sizes(self, code: int) -> Iterator[tuple[int, int]]:
        for answer in self._rows(ENUM_FRAMESIZES, _SIZE, code, 0, *[0] * 6):
            if answer[2] != _DISCRETE:
                yield answer[4], answer[7]
                return
            yield answer[3], answer[4]

    def _rates(self, code: int, size_px: tuple[int, int]) -> Iterator[float]:
        for answer in self._rows(ENUM_FRAMEINTERVALS, _INTERVAL, code, *size_px, 0, *[0] * 6):
            # A discrete interval, or the least of a range, is in the same place.
            if answer[5] > 0:
                yield answer[6] / answer[5]
            if answer[4] != _DISCRETE:
                return

    def _rows(self, request: int, layout: struct.Struct, *fields: int | bytes) -> Iterator[Struct]:
        """Yields the answers of a list, whose requests begin with an index."""
        for index in range(_MOST):
            answer = self._call(request, layout, index, *fields)
            if answer is None:
                return
            yield answer

    def _call(self, request: int, layout: struct.Struct, *fields: int | bytes) -> Struct | None:
        """Calls one ioctl; None where a list has ended, or the node does not support it."""
        memory = bytearray(layout.pack(*fields))
        try:
            self._ioctl(self._descriptor, request, memory)
        except OSError:
            return None
        return layout.unpack(memory)


def _text(field: bytes) -> str:
    return printable(field.split(b"\0")[0].decode(errors="replace"))


def _four_letters(code: int) -> str:
    """A format's name; the highest bit only means the other byte order."""
    return (code & 0x7FFFFFFF).to_bytes(4, "little").decode("ascii", "replace").rstrip()
