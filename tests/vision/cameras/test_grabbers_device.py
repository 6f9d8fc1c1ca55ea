"""Cameras behind OpenCV: what was set is read back and told; stamps; pictures that are damaged.

There is no V4L2 camera here: a scripted object stands in for OpenCV's, with that backend's
answers as they are in its sources.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from vsense.base.errors import GrabberError
from vsense.vision.cameras import _opencv_source
from vsense.vision.cameras._opencv_source import CAPTURE_BUFFERS, DeviceSource
from vsense.vision.cameras.picture import PictureError
from vsense.vision.cameras.source import Controls

SIZE = (640, 480)
MJPEG = float(cv2.VideoWriter.fourcc(*"MJPG"))
YUYV = float(cv2.VideoWriter.fourcc(*"YUYV"))
BAD, GONE, BROKEN = "bad", "gone", "broken"
STREAM = "http://camera/arena.mjpg"


def picture() -> np.ndarray:
    return np.tile(np.arange(SIZE[0], dtype=np.uint8), (SIZE[1], 1))


def failure(text: str) -> cv2.error:
    """An error as OpenCV raises it."""
    error = cv2.error(text)
    error.err = text
    return error


class Device:
    """Stands in for cv2.VideoCapture.

    Attributes:
        has: Its properties.
        takes: How it answers to a new value: with the one that it then has, or None for no.
        comes: What comes next: a picture; None or BAD for one that cannot be decoded, which OpenCV
            tells in either way; GONE or BROKEN for the end of the camera, likewise.
    """

    def __init__(
        self,
        has: dict[int, float],
        takes: dict[int, Callable[[float], float | None]] = {},  # noqa: B006
        unknown: float = -1.0,
    ) -> None:
        self.has = {cv2.CAP_PROP_FOURCC: YUYV, **has}
        self.takes = takes
        self.unknown = unknown
        self.asked: list[tuple[int, float]] = []
        self.comes: list[np.ndarray | str | None] = []
        self.opened_with: tuple[object, ...] = ()

    def isOpened(self) -> bool:
        return True

    def set(self, key: int, value: float) -> bool:
        self.asked.append((key, value))
        got = self.takes[key](value) if key in self.takes else None
        if got is not None:
            self.has[key] = got
        return got is not None

    def get(self, key: int) -> float:
        return self.has.get(key, self.unknown)

    def grab(self) -> bool:
        first = self.comes[0]
        if isinstance(first, str) and first == BROKEN:
            raise failure("the cable")
        return not (isinstance(first, str) and first == GONE)

    def retrieve(self) -> tuple[bool, np.ndarray | None]:
        thing = self.comes.pop(0)
        if isinstance(thing, str):
            raise failure("no conversion")
        return thing is not None, thing

    def release(self) -> None:
        pass


def same(value: float) -> float:
    return value


def within(least: float, most: float) -> Callable[[float], float]:
    return lambda value: min(max(round(value), least), most)


def webcam(**changes: Callable[[float], float | None] | None) -> Device:
    """A V4L2 camera that takes all; `changes` by the property's name, None: it has none such."""
    takes = {
        "FRAME_WIDTH": same,
        "FRAME_HEIGHT": same,
        "FPS": lambda value: float(round(value)),
        "EXPOSURE": within(1, 5000),
        "AUTO_EXPOSURE": same,
        "GAIN": within(0, 255),
        "BUFFERSIZE": same,
        **changes,
    }
    has = {name: 3.0 if name == "AUTO_EXPOSURE" else 1.0 for name, take in takes.items() if take}
    keys = {name: getattr(cv2, f"CAP_PROP_{name}") for name in takes}
    return Device(
        {keys[name]: value for name, value in has.items()},
        {keys[name]: take for name, take in takes.items() if take},
    )


def opened(
    monkeypatch: pytest.MonkeyPatch, device: Device, controls: Controls, name: str = "0"
) -> tuple[DeviceSource, list[str]]:
    def open_it(*how: object) -> Device:
        device.opened_with = how
        return device

    monkeypatch.setattr(cv2, "VideoCapture", open_it)
    source = DeviceSource(name, controls)
    return source, source.open()


ALL = Controls(SIZE, 30.0, 8000.0, 12.0)


def test_a_camera_that_takes_all_has_nothing_said_about_it(monkeypatch: pytest.MonkeyPatch) -> None:
    device = webcam()
    _, said = opened(monkeypatch, device, ALL)
    assert said == []
    assert device.opened_with == ("/dev/video0", cv2.CAP_V4L2)
    assert device.asked == [
        (cv2.CAP_PROP_BUFFERSIZE, CAPTURE_BUFFERS),
        (cv2.CAP_PROP_AUTO_EXPOSURE, 1),
        (cv2.CAP_PROP_FRAME_WIDTH, 640),
        (cv2.CAP_PROP_FRAME_HEIGHT, 480),
        (cv2.CAP_PROP_FPS, 30.0),
        (cv2.CAP_PROP_EXPOSURE, 80.0),
        (cv2.CAP_PROP_GAIN, 12.0),
        (cv2.CAP_PROP_CONVERT_RGB, 0),
    ]


def test_a_camera_is_left_its_own_choices(monkeypatch: pytest.MonkeyPatch) -> None:
    device = webcam()
    assert opened(monkeypatch, device, Controls())[1] == []
    keys = [key for key, _ in device.asked]
    assert keys == [cv2.CAP_PROP_BUFFERSIZE, cv2.CAP_PROP_CONVERT_RGB]


@pytest.mark.parametrize(
    ("changes", "controls", "said"),
    [
        ({}, Controls(exposure_us=8040.0), ["takes 8000 for exposure_time_abs 8040"]),
        ({}, Controls(exposure_us=20.0), ["takes 100 for exposure_time_abs 20"]),
        ({}, Controls(exposure_us=1e6), ["takes 500000 for exposure_time_abs 1000000"]),
        ({}, Controls(gain_raw=999.0), ["takes 255 for gain_raw 999"]),
        ({}, Controls(gain_raw=0.0), []),
        ({}, Controls(rate_hz=29.97), ["takes 30 for frame_rate 29.97"]),
        ({"EXPOSURE": None}, Controls(exposure_us=8000.0), ["has no exposure_time_abs"]),
        ({"GAIN": None}, Controls(gain_raw=3.0), ["has no gain_raw"]),
        ({"FPS": None}, Controls(rate_hz=10.0), ["does not take frame_rate 10"]),
        ({"FPS": lambda v: np.inf}, Controls(rate_hz=10.0), ["does not take frame_rate 10"]),
        ({"FPS": lambda v: np.nan}, Controls(rate_hz=10.0), ["does not take frame_rate 10"]),
        ({"GAIN": lambda v: None}, Controls(gain_raw=3.0), ["does not take gain_raw 3: keeps 1"]),
        ({"AUTO_EXPOSURE": None}, Controls(exposure_us=8000.0), []),
        (
            {"AUTO_EXPOSURE": lambda v: None},
            Controls(exposure_us=8000.0),
            ["does not take exposure_time_abs 8000: keeps automatic exposure"],
        ),
        (
            {"FRAME_WIDTH": lambda v: 1600.0, "FRAME_HEIGHT": lambda v: 1200.0},
            Controls(size_px=(1620, 1220)),
            ["takes 1600 for width 1620", "takes 1200 for height 1220"],
        ),
    ],
)
def test_what_a_v4l2_camera_made_of_its_settings_is_told(
    monkeypatch: pytest.MonkeyPatch,
    changes: dict[str, Callable[[float], float | None] | None],
    controls: Controls,
    said: list[str],
) -> None:
    assert opened(monkeypatch, webcam(**changes), controls)[1] == said


def test_a_setting_that_another_one_changed_afterwards_is_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    device = webcam()

    def slower(units: float) -> float:
        device.has[cv2.CAP_PROP_FPS] = 15.0
        return units

    device.takes[cv2.CAP_PROP_EXPOSURE] = slower
    said = opened(monkeypatch, device, Controls(rate_hz=30.0, exposure_us=60_000.0))[1]
    assert said == ["takes 15 for frame_rate 30"]


@pytest.mark.parametrize("unknown", [-1.0, 0.0])
def test_a_stream_says_honestly_that_it_takes_nothing(
    monkeypatch: pytest.MonkeyPatch, unknown: float
) -> None:
    """OpenCV 5 answers -1 where it knows nothing, OpenCV 4 answers 0."""
    has = {cv2.CAP_PROP_FRAME_WIDTH: 640.0, cv2.CAP_PROP_FRAME_HEIGHT: 360.0, cv2.CAP_PROP_FPS: 25}
    device = Device(has, unknown=unknown)
    _, said = opened(monkeypatch, device, ALL, STREAM)
    assert said == [
        "does not take height 480: keeps 360",
        "does not take frame_rate 30",
        "does not take exposure_time_abs 8000",
        "does not take gain_raw 12",
    ]
    assert device.opened_with[:2] == (STREAM, cv2.CAP_FFMPEG)


def test_pictures_of_a_v4l2_camera_have_the_stamp_of_the_kernel(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    device = webcam()
    source, _ = opened(monkeypatch, device, Controls())
    coloured = cv2.merge([picture()] * 3)
    device.comes = [coloured] * 4
    stamps = []
    for position_ms in (86_400_123.457, 0.0, -3.7e20, 1.7e12 + 0.001):
        device.has[cv2.CAP_PROP_POS_MSEC] = position_ms
        shot = source.read()
        assert np.array_equal(shot.image, picture())
        stamps.append(shot.stamp_ns)
    assert stamps == [86_400_123_457_000, None, None, 1_700_000_000_000_001_000]


def test_pictures_of_a_stream_have_no_stamp(monkeypatch: pytest.MonkeyPatch) -> None:
    device = Device({cv2.CAP_PROP_POS_MSEC: 40.0})
    source, _ = opened(monkeypatch, device, Controls(), STREAM)
    device.comes = [picture()]
    assert source.read().stamp_ns is None


def test_a_picture_that_cannot_be_decoded_is_not_the_end_of_the_camera(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    device = webcam()
    source, _ = opened(monkeypatch, device, Controls())
    device.comes = [None, BAD, picture(), GONE]
    for _ in range(2):
        with pytest.raises(PictureError, match=r"decoded$"):
            source.read()
    assert source.read().image.shape == SIZE[::-1]
    with pytest.raises(GrabberError, match=r"^/dev/video0.*pictures$"):
        source.read()
    device.comes = [BROKEN]
    with pytest.raises(GrabberError, match=r"^/dev/video0.*cable$"):
        source.read()


def test_an_error_while_it_is_set_up_is_one_of_opening(monkeypatch: pytest.MonkeyPatch) -> None:
    device = webcam()

    def fail(key: int, value: float) -> bool:
        raise failure("busy")

    monkeypatch.setattr(device, "set", fail)
    with pytest.raises(GrabberError, match=r"^/dev/video0.*busy$"):
        opened(monkeypatch, device, Controls())


def packet(data: bytes) -> np.ndarray:
    return np.frombuffer(data, np.uint8)[np.newaxis]


def test_the_jpegs_of_a_stream_are_decoded_here_and_damage_is_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    device = Device({cv2.CAP_PROP_FOURCC: MJPEG}, {cv2.CAP_PROP_FORMAT: same})
    source, _ = opened(monkeypatch, device, Controls(), STREAM)
    assert device.has[cv2.CAP_PROP_FORMAT] == -1
    whole = bytes(cv2.imencode(".jpg", picture())[1])
    small = bytes(cv2.imencode(".jpg", np.zeros((12, 16), np.uint8))[1])
    png = bytes(cv2.imencode(".png", picture())[1])
    device.comes = [packet(each) for each in (whole, whole[:500], png, small)]
    assert source.read().image.shape == SIZE[::-1]
    with pytest.raises(PictureError, match=r"500 bytes$"):
        source.read()
    with pytest.raises(PictureError, match="no JPEG"):
        source.read()
    # A camera that has another size all of a sudden shows it: FFmpeg would stretch it.
    assert source.read().image.shape == (12, 16)


def test_a_stream_whose_packets_are_not_to_be_had_is_read_as_it_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    device = Device({cv2.CAP_PROP_FOURCC: MJPEG})
    source, _ = opened(monkeypatch, device, Controls(), STREAM)
    device.comes = [picture()]
    assert np.array_equal(source.read().image, picture())


@pytest.mark.parametrize("names", ["OpenCV 4", "OpenCV 5"])
def test_opencv_keeps_off_the_terminal(monkeypatch: pytest.MonkeyPatch, names: str) -> None:
    levels: list[int] = []
    has = SimpleNamespace(setLogLevel=levels.append)
    module = has if names == "OpenCV 4" else SimpleNamespace(utils=SimpleNamespace(logging=has))
    monkeypatch.setattr(_opencv_source, "cv2", module)
    monkeypatch.delenv("OPENCV_FFMPEG_LOGLEVEL", raising=False)
    monkeypatch.setenv("OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT", "7")
    _opencv_source.teach_opencv()
    assert levels == [0]
    assert os.environ["OPENCV_FFMPEG_LOGLEVEL"] == "-8"
    assert os.environ["OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT"] == "7"


def raw_webcam(code: float) -> Device:
    """A V4L2 camera whose backend leaves pictures as they come where that is asked for."""
    device = webcam(CONVERT_RGB=same)
    device.has[cv2.CAP_PROP_FOURCC] = code
    return device


def test_the_greys_of_a_yuyv_camera_are_those_of_opencvs_colours(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng = np.random.default_rng(3)
    raw = rng.integers(0, 256, (SIZE[1], SIZE[0], 2)).astype(np.uint8)
    raw[:240, :, 1] = 128  # without colour, and with little
    raw[240:, :, 1] = rng.integers(120, 137, (240, SIZE[0]))
    device = raw_webcam(YUYV)
    source, _ = opened(monkeypatch, device, Controls())
    assert (cv2.CAP_PROP_CONVERT_RGB, 0) in device.asked
    device.comes = [raw]
    expected = cv2.cvtColor(cv2.cvtColor(raw, cv2.COLOR_YUV2BGR_YUY2), cv2.COLOR_BGR2GRAY)
    off = np.abs(source.read().image.astype(int) - expected)
    assert off[:240].max() <= 1
    # Colours that clip change OpenCV's grey by a little.
    assert np.median(off[240:]) <= 1 and off[240:].max() <= 12


def test_the_jpegs_of_a_webcam_are_decoded_to_grey_with_their_stamp(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    device = raw_webcam(MJPEG)
    device.has[cv2.CAP_PROP_POS_MSEC] = 1234.567
    source, _ = opened(monkeypatch, device, Controls())
    packet = cv2.imencode(".jpg", picture(), (cv2.IMWRITE_JPEG_QUALITY, 95))[1]
    device.comes = [packet.reshape(1, -1), packet.reshape(1, -1)[:, :-600]]
    shot = source.read()
    assert shot.stamp_ns == 1_234_567_000 and np.abs(shot.image.astype(int) - picture()).max() < 9
    with pytest.raises(PictureError, match="cut off"):
        source.read()


def test_a_webcam_that_only_gives_colours_is_read_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    device = webcam()
    source, _ = opened(monkeypatch, device, Controls())
    device.comes = [np.stack([picture()] * 3, axis=-1)]
    assert np.array_equal(source.read().image, picture())
