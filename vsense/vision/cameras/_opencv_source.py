"""A camera behind OpenCV: any V4L2 device or URL that it opens."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.base.arena import Image
from vsense.base.errors import GrabberError
from vsense.vision.cameras.picture import PictureError, decode, is_jpeg, to_grey
from vsense.vision.cameras.source import Controls, Shot, absent, refused, said

_SILENT = 0
"""OpenCV's level for no messages at all."""

_SETTINGS = {
    # FFmpeg's level for silence; it prints a line about every damaged packet otherwise.
    "OPENCV_FFMPEG_LOGLEVEL": "-8",
    # Silence after which a V4L2 camera has ended [s]; ten by default.
    "OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT": "3",
}
"""OpenCV reads these once, when it first opens a camera. Source: OpenCV, the sources of videoio."""


def teach_opencv() -> None:
    """Keeps OpenCV and FFmpeg off the terminal: what matters is an event of the camera.

    The user's own settings in the environment stay. OpenCV cannot stop libjpeg from writing a line
    about each damaged picture.
    """
    for name, value in _SETTINGS.items():
        os.environ.setdefault(name, value)
    # OpenCV 4 has it under another name than OpenCV 5.
    module: Any = cv2 if hasattr(cv2, "setLogLevel") else cv2.utils.logging
    module.setLogLevel(_SILENT)


OPEN_TIMEOUT_MS = 2000
READ_TIMEOUT_MS = 3000
"""Silence after which a stream has ended."""
CAPTURE_BUFFERS = 2
"""One is filled while the other is read. With one, every second picture of a camera that sends
without pause is lost; with more, a late reader gets old ones."""

_AUTOMATIC_EXPOSURE = (0, 3)
_MANUAL_EXPOSURE = 1
"""Source: Linux, V4L2_CID_EXPOSURE_AUTO."""
EXPOSURE_UNIT_US = 100.0
"""V4L2 counts exposure_time_absolute in 100 us. Source: Linux, V4L2_CID_EXPOSURE_ABSOLUTE."""
_MJPEG = cv2.VideoWriter.fourcc(*"MJPG")
_YUYV = cv2.VideoWriter.fourcc(*"YUYV")
_BLACK, _PER_STEP = 16.0, 255.0 / 219.0
"""Of a luma: its black, and how many greys a step of it is. Source: ITU-R BT.601."""
_PACKETS = -1
"""Value of CAP_PROP_FORMAT at which OpenCV hands over a stream's packets as they came."""


@dataclass(frozen=True, slots=True)
class _Setting:
    """A wanted value: its name and value as the user wrote them, and OpenCV's property."""

    name: str
    wanted: float
    key: int

    @property
    def unit(self) -> float:
        """The property's unit in the user's."""
        return EXPOSURE_UNIT_US if self.key == cv2.CAP_PROP_EXPOSURE else 1.0

    @property
    def value(self) -> float:
        """The value for OpenCV: a whole number of units where they are not the user's."""
        return self.wanted if self.unit == 1.0 else max(1.0, round(self.wanted / self.unit))


class DeviceSource:
    """A camera behind OpenCV; belongs to one thread."""

    def __init__(self, device: str, controls: Controls) -> None:
        """Notes the device: "/dev/video0", a number such as "0", or a URL."""
        self._device = f"/dev/video{device}" if device.isdecimal() else device
        self._is_v4l2 = self._device.startswith("/dev/")
        self._in_packets = self._is_luma = False
        self._controls = controls
        self._capture: cv2.VideoCapture | None = None

    def open(self) -> list[str]:
        """See `Source.open`."""
        self.close()
        capture = self._opened()
        if not capture.isOpened():
            raise GrabberError(f"{self._device} does not open")
        self._capture = capture
        try:
            return self._set_up(capture)
        except cv2.error as error:
            raise GrabberError(f"{self._device} does not open: {error.err}") from None

    def read(self) -> Shot:
        """See `Source.read`."""
        if self._capture is None:
            raise GrabberError(f"{self._device} is not open")
        try:
            ok = self._capture.grab()
        except cv2.error as error:
            raise GrabberError(f"{self._device} has failed: {error.err}") from None
        if not ok:
            raise GrabberError(f"{self._device} gives no more pictures")
        try:
            ok, image = self._capture.retrieve()
        except cv2.error:
            ok, image = False, None
        if not ok or image is None:
            raise PictureError("a picture cannot be decoded")
        if self._in_packets:
            grey = _unpack(image.tobytes())
        else:
            grey = grey_of_yuyv(image) if self._is_luma else to_grey(image)
        return Shot(grey, self._stamp_ns(self._capture))

    def close(self) -> None:
        """See `Source.close`."""
        if self._capture is not None:
            self._capture.release()
            self._capture = None

    def _opened(self) -> cv2.VideoCapture:
        """Opens with the fitting backend: V4L2 for a device, time limits for a stream."""
        if self._is_v4l2:
            return cv2.VideoCapture(self._device, cv2.CAP_V4L2)
        limits = [
            cv2.CAP_PROP_OPEN_TIMEOUT_MSEC,
            OPEN_TIMEOUT_MS,
            cv2.CAP_PROP_READ_TIMEOUT_MSEC,
            READ_TIMEOUT_MS,
        ]
        capture = cv2.VideoCapture(self._device, cv2.CAP_FFMPEG, limits)
        if capture.isOpened() or "://" in self._device:
            # OpenCV's other backends have no time limit for a URL.
            return capture
        return cv2.VideoCapture(self._device)

    def _set_up(self, capture: cv2.VideoCapture) -> list[str]:
        """Sets what is wanted, reads it back, and returns the differences."""
        if self._is_v4l2:
            capture.set(cv2.CAP_PROP_BUFFERSIZE, CAPTURE_BUFFERS)
            if self._controls.exposure_us is not None:
                capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, _MANUAL_EXPOSURE)
        # Set in this order and read back after the last: a rate depends on the size, and an
        # exposure time on the rate.
        settings = self._settings()
        taken = [capture.set(setting.key, setting.value) for setting in settings]
        messages = [self._compare(capture, setting, took) for setting, took in zip(settings, taken)]
        # FFmpeg mends and stretches damaged JPEGs silently, and colours take most of the time: what
        # the camera sends is decoded here.
        raw = (cv2.CAP_PROP_CONVERT_RGB, 0) if self._is_v4l2 else (cv2.CAP_PROP_FORMAT, _PACKETS)
        code = int(capture.get(cv2.CAP_PROP_FOURCC))
        is_known = code == _MJPEG or (code == _YUYV and self._is_v4l2)
        is_raw = is_known and bool(capture.set(*raw))
        self._in_packets, self._is_luma = is_raw and code == _MJPEG, is_raw and code == _YUYV
        return [text for text in messages if text is not None]

    def _compare(self, capture: cv2.VideoCapture, item: _Setting, took: bool) -> str | None:
        """Describes how a setting differs from what is wanted; None: it does not."""
        got = capture.get(item.key) * item.unit
        is_valid = math.isfinite(got) and (got > 0.0 or (got == 0.0 and self._is_v4l2))
        if not is_valid:
            # Every camera has sizes and rates.
            control = item.key in (cv2.CAP_PROP_EXPOSURE, cv2.CAP_PROP_GAIN)
            missing = control and self._is_v4l2 and not took
            return absent(item.name) if missing else refused(item.name, item.wanted, None)
        text = said(item.name, item.wanted, got)
        if item.key == cv2.CAP_PROP_EXPOSURE and self._is_v4l2:
            automatic = capture.get(cv2.CAP_PROP_AUTO_EXPOSURE) in _AUTOMATIC_EXPOSURE
            return refused(item.name, item.wanted, "automatic exposure") if automatic else text
        if text is None or took:
            return text
        # FFmpeg often guesses a stream's rate.
        guess = item.key == cv2.CAP_PROP_FPS and not self._is_v4l2
        return refused(item.name, item.wanted, None if guess else got)

    def _settings(self) -> list[_Setting]:
        """The wanted controls, in the order in which they are set."""
        wanted = self._controls
        width, height = wanted.size_px or (None, None)
        rows: tuple[tuple[str, float | None, int], ...] = (
            ("width", width, cv2.CAP_PROP_FRAME_WIDTH),
            ("height", height, cv2.CAP_PROP_FRAME_HEIGHT),
            ("frame_rate", wanted.rate_hz, cv2.CAP_PROP_FPS),
            ("exposure_time_abs", wanted.exposure_us, cv2.CAP_PROP_EXPOSURE),
            ("gain_raw", wanted.gain_raw, cv2.CAP_PROP_GAIN),
        )
        return [_Setting(name, value, key) for name, value, key in rows if value is not None]

    def _stamp_ns(self, capture: cv2.VideoCapture) -> int | None:
        """Returns when the kernel got the last picture, by its own clock; None: unknown.

        With V4L2 the position in the "film" is the buffer's stamp, to the microsecond. With a
        stream it is the presentation time; JPEGs over HTTP have none, and FFmpeg counts them at 25
        Hz or gives nothing: only V4L2 has a clock that can be used. Source:
        OpenCV 4.11 and 5.0, CAP_PROP_POS_MSEC of its backends.
        """
        if not self._is_v4l2:
            return None
        position_ms = capture.get(cv2.CAP_PROP_POS_MSEC)
        if not math.isfinite(position_ms) or position_ms <= 0.0:
            return None
        return round(1000.0 * position_ms) * 1000


def grey_of_yuyv(image: NDArray[Any]) -> Image:
    """Returns the (h, w) grey of an (h, w, 2) YUYV picture, as OpenCV has it by way of BGR.

    Raises PictureError for another shape.
    """
    if image.ndim != 3 or image.shape[2] != 2:
        raise PictureError(f"is no YUYV picture: shape {image.shape}")
    luma = cv2.extractChannel(image, 0)
    grey = cv2.addWeighted(luma, _PER_STEP, luma, 0.0, -_BLACK * _PER_STEP)
    return np.asarray(grey, dtype=np.uint8)


def _unpack(packet: bytes) -> Image:
    """Decodes a packet of a stream of JPEGs; raises PictureError where it is not a good one."""
    if not is_jpeg(packet):
        raise PictureError("a picture is no JPEG, in a stream of JPEGs")
    return decode(packet, "a picture")
