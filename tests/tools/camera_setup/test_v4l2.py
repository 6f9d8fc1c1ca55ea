"""The list of V4L2 cameras, from a kernel that the test plays with the real layouts."""

from __future__ import annotations

import errno
import os
import struct
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import require_tool
from vsense.vision.cameras import _v4l2
from vsense.vision.cameras._v4l2 import V4l2Device, devices

CAPTURE, CAPTURE_PLANES, METADATA, STREAMING = 0x1, 0x1000, 0x00800000, 0x04000000
OWN = 0x80000000
DISCRETE, CONTINUOUS, STEPWISE = 1, 2, 3


def fourcc(name: str) -> int:
    return int.from_bytes(name.encode(), "little")


class Kernel:
    """Answers ioctls for the nodes that it has been given; all of them are files in a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.nodes: dict[str, dict[str, Any]] = {}

    def add(self, name: str, **has: Any) -> None:
        (self.folder / name).write_bytes(b"")
        self.nodes[name] = has

    def ioctl(self, descriptor: int, request: int, memory: bytearray) -> int:
        node = self.nodes[Path(os.readlink(f"/proc/self/fd/{descriptor}")).name]
        answers: dict[int, Callable[[dict[str, Any], bytearray], None]] = {
            0x80685600: self.capability,
            0xC0405602: self.format,
            0xC02C564A: self.size,
            0xC034564B: self.interval,
        }
        answers[request](node, memory)
        return 0

    def capability(self, node: dict[str, Any], memory: bytearray) -> None:
        if "can" not in node:
            raise OSError(errno.ENOTTY, "Inappropriate ioctl for device")
        struct.pack_into("16s32s32s", memory, 0, b"uvcvideo", node["card"], b"usb-0000:00-1.2")
        struct.pack_into("III", memory, 80, 0x060800, node["can"], node.get("own", 0))

    def format(self, node: dict[str, Any], memory: bytearray) -> None:
        index, kind = struct.unpack_from("II", memory)
        assert kind == node.get("kind", 1)
        code = fourcc(self.at(list(node["formats"]), index))
        struct.pack_into("32sII", memory, 12, b"Motion-JPEG", code, 0)

    def size(self, node: dict[str, Any], memory: bytearray) -> None:
        index, code = struct.unpack_from("II", memory)
        fields, _ = self.at(self.modes(node, code), index)
        struct.pack_into(f"{len(fields)}I", memory, 8, *fields)

    def interval(self, node: dict[str, Any], memory: bytearray) -> None:
        index, code, *size_px = struct.unpack_from("IIII", memory)
        for fields, intervals in self.modes(node, code):
            if list(fields[1:3] if fields[0] == DISCRETE else fields[2::3]) == size_px:
                answer = self.at(intervals, index)
                struct.pack_into(f"{len(answer)}I", memory, 16, *answer)
                return
        raise OSError(errno.EINVAL, "Invalid argument")

    @staticmethod
    def modes(node: dict[str, Any], code: int) -> list[Any]:
        """The sizes of a format, each with its intervals, as the kernel has the fields."""
        return {fourcc(name): modes for name, modes in node["formats"].items()}[code]

    @staticmethod
    def at(things: list[Any], index: int) -> Any:
        if index >= len(things):
            raise OSError(errno.EINVAL, "Invalid argument")
        return things[index]


def webcam(width: int = 1920, height: int = 1080) -> dict[str, Any]:
    large, small = (DISCRETE, width, height), (DISCRETE, 640, 480)
    return {
        "card": b"HD Pro Webcam C920",
        "can": OWN | CAPTURE | METADATA | STREAMING,
        "own": CAPTURE | STREAMING,
        "formats": {
            "YUYV": [(small, [(DISCRETE, 1, 30)]), (large, [(DISCRETE, 1, 5)])],
            "MJPG": [
                (large, [(DISCRETE, 1, 15), (DISCRETE, 1001, 30000)]),
                (small, [(DISCRETE, 1, 90)]),
            ],
        },
    }


@pytest.fixture
def kernel(tmp_path: Path) -> Kernel:
    return Kernel(tmp_path)


def listed(kernel: Kernel) -> list[V4l2Device]:
    return devices(kernel.folder, kernel.ioctl)


def only(kernel: Kernel, **node: Any) -> V4l2Device:
    kernel.add("video0", **node)
    (device,) = listed(kernel)
    return device


def test_a_camera_has_its_largest_picture_and_the_highest_rate_of_that(kernel: Kernel) -> None:
    assert only(kernel, **webcam()) == V4l2Device(
        path=str(kernel.folder / "video0"),
        name="HD Pro Webcam C920",
        bus="usb-0000:00-1.2",
        formats=("YUYV", "MJPG"),
        size_px=(1920, 1080),
        rate_hz=pytest.approx(29.97, abs=0.001),
        trouble="",
    )


def test_cameras_come_in_the_order_of_their_numbers(kernel: Kernel) -> None:
    for name in ("video10", "video2", "video0"):
        kernel.add(name, **webcam())
    for name in ("video", "videos1", "vbi0", "media0"):
        (kernel.folder / name).write_bytes(b"")
    assert [Path(each.path).name for each in listed(kernel)] == ["video0", "video2", "video10"]


def test_nodes_that_cannot_capture_are_left_out(kernel: Kernel) -> None:
    kernel.add("video0", **webcam())
    kernel.add("video1", **{**webcam(), "own": METADATA | STREAMING})
    kernel.add("video2", card=b"codec", can=0x8000 | STREAMING)
    kernel.add("video3")
    assert [Path(each.path).name for each in listed(kernel)] == ["video0"]


def test_an_old_driver_has_one_set_of_capabilities(kernel: Kernel) -> None:
    assert only(kernel, **{**webcam(), "can": CAPTURE, "own": 0}).size_px == (1920, 1080)


def test_a_camera_of_several_planes_is_asked_as_one(kernel: Kernel) -> None:
    device = only(kernel, **{**webcam(), "own": CAPTURE_PLANES, "kind": 9})
    assert device.formats == ("YUYV", "MJPG")


@pytest.mark.parametrize(
    ("size", "intervals", "size_px", "rate_hz"),
    [
        ((STEPWISE, 16, 2592, 8, 16, 1944, 2), [(DISCRETE, 1, 12)], (2592, 1944), 12.0),
        (
            (CONTINUOUS, 1, 800, 1, 1, 600, 1),
            [(CONTINUOUS, 1, 60, 1, 1, 1, 1)],
            (800, 600),
            60.0,
        ),
        ((DISCRETE, 800, 600), [(STEPWISE, 2, 50, 1, 1, 1, 50)], (800, 600), 25.0),
        ((DISCRETE, 800, 600), [(DISCRETE, 0, 1)], (800, 600), None),
        ((DISCRETE, 800, 600), [], (800, 600), None),
    ],
)
def test_sizes_and_rates_may_be_ranges(
    kernel: Kernel,
    size: tuple[int, ...],
    intervals: list[tuple[int, ...]],
    size_px: tuple[int, int],
    rate_hz: float | None,
) -> None:
    device = only(kernel, **{**webcam(), "formats": {"GREY": [(size, intervals)]}})
    assert (device.size_px, device.rate_hz) == (size_px, rate_hz)


def test_a_camera_that_tells_nothing_of_itself_is_listed(kernel: Kernel) -> None:
    device = only(kernel, **{**webcam(), "formats": {}, "card": b"\xff" * 32})
    assert (device.formats, device.size_px, device.rate_hz, device.trouble) == ((), None, None, "")
    assert device.name == "\ufffd" * 32


def test_a_list_without_an_end_is_ended(kernel: Kernel) -> None:
    class Endless(list[Any]):
        def __len__(self) -> int:
            return 10**9

        def __getitem__(self, index: Any) -> Any:
            return (DISCRETE, 640, 480), [(DISCRETE, 1, 30)]

        def __iter__(self) -> Any:
            return iter([self[0]])

    device = only(kernel, **{**webcam(), "formats": {"Y16 ": Endless()}})
    assert (device.formats, device.size_px, device.rate_hz) == (("Y16",), (640, 480), 30.0)


def test_a_node_that_does_not_open_is_listed_with_the_reason(
    kernel: Kernel, monkeypatch: pytest.MonkeyPatch
) -> None:
    kernel.add("video0", **webcam())
    (kernel.folder / "video1").mkdir()
    true_open = os.open

    def refuse(path: Path, flags: int) -> int:
        if path.name == "video0":
            raise PermissionError(errno.EACCES, "Permission denied")
        return true_open(path, flags)

    monkeypatch.setattr(_v4l2.os, "open", refuse)
    assert [(each.name, each.trouble) for each in listed(kernel)] == [
        ("", "no permission: add yourself to the group video"),
        ("", "does not open: Is a directory"),
    ]


def test_no_cameras_are_no_error(tmp_path: Path) -> None:
    assert devices(tmp_path) == []
    assert devices(tmp_path / "nothing") == []
    (tmp_path / "video0").write_bytes(b"")
    assert devices(tmp_path) == [], "a file answers no ioctl"


def test_no_descriptor_is_left_open(kernel: Kernel) -> None:
    kernel.add("video0", **webcam())
    kernel.add("video1")
    before = len(os.listdir("/proc/self/fd"))
    listed(kernel)
    assert len(os.listdir("/proc/self/fd")) == before


def test_requests_and_layouts_are_those_of_the_kernels_header(tmp_path: Path) -> None:
    """The played kernel has these numbers written out; this is where they are from."""
    compiler = require_tool("cc", "gcc")
    names = ("QUERYCAP", "ENUM_FMT", "ENUM_FRAMESIZES", "ENUM_FRAMEINTERVALS")
    prints = "".join(f'printf("%lu ", (unsigned long)VIDIOC_{name});' for name in names)
    source = tmp_path / "requests.c"
    source.write_text(
        "#include <stdio.h>\n#include <linux/videodev2.h>\n"
        f"int main(void) {{ {prints} return 0; }}\n"
    )
    subprocess.run([compiler, source, "-o", tmp_path / "requests"], check=True)
    printed = subprocess.run([tmp_path / "requests"], check=True, capture_output=True, text=True)
    ours = [getattr(_v4l2, name) for name in names]
    assert [int(word) for word in printed.stdout.split()] == ours
    assert ours == [0x80685600, 0xC0405602, 0xC02C564A, 0xC034564B]
