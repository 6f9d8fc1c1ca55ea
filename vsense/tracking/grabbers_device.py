"""A camera: any V4L2 device or URL that OpenCV opens."""

from __future__ import annotations

from dataclasses import dataclass

import cv2

from vsense.tracking.grabbers import GrabberError
from vsense.tracking.grabbers_picture import to_grey
from vsense.tracking.source import Shot

OPEN_TIMEOUT_MS = 5000
READ_TIMEOUT_MS = 3000
"""A stream that says nothing for this long has ended."""

_MANUAL_EXPOSURE = 1
_EXPOSURE_UNIT_US = 100.0
"""V4L2 counts exposure_time_absolute in 100 us. Source: Linux, V4L2_CID_EXPOSURE_ABSOLUTE."""


@dataclass(frozen=True, slots=True)
class Controls:
    """What a camera is asked for; None leaves its own choice.

    Attributes:
        size_px: Width and height.
        rate_hz: Pictures per second.
        exposure_us: Exposure time; switches automatic exposure off.
        gain_raw: Gain in the camera's own unit.
    """

    size_px: tuple[int, int] | None = None
    rate_hz: float | None = None
    exposure_us: float | None = None
    gain_raw: float | None = None


class DeviceSource:
    """A camera behind OpenCV; belongs to one thread."""

    def __init__(self, device: str, controls: Controls) -> None:
        """Notes what to open.

        Args:
            device: "/dev/video0", a number such as "0", or a URL.
            controls: What it is asked for.
        """
        self._device = device
        self._controls = controls
        self._capture: cv2.VideoCapture | None = None

    def open(self) -> list[str]:
        """Opens the camera and sets its controls; see `vsense.tracking.source.Source.open`.

        Raises:
            GrabberError: It does not open.
        """
        self.close()
        capture = self._opened()
        if not capture.isOpened():
            raise GrabberError(f"{self._device} does not open")
        self._capture = capture
        # A picture that has waited in the driver is old; not every backend can do without.
        capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        return [
            f"does not take {what}"
            for what, key, value in self._settings()
            if not capture.set(key, value)
        ]

    def read(self) -> Shot:
        """Waits for the next picture.

        Raises:
            PictureError: The picture cannot be used; the next one may be good.
            GrabberError: The camera is gone.
        """
        if self._capture is None:
            raise GrabberError(f"{self._device} is not open")
        try:
            whole, image = self._capture.read()
        except cv2.error as error:
            raise GrabberError(f"{self._device} has failed: {error.err}") from None
        if not whole or image is None:
            raise GrabberError(f"{self._device} gives no more pictures")
        return Shot(to_grey(image))

    def close(self) -> None:
        """Lets the camera go; can be called again."""
        if self._capture is not None:
            self._capture.release()
            self._capture = None

    def _opened(self) -> cv2.VideoCapture:
        """Opens with the backend that fits: V4L2 for a device, time limits for a stream."""
        device = self._device
        if device.isdecimal() or device.startswith("/dev/"):
            path = f"/dev/video{device}" if device.isdecimal() else device
            return cv2.VideoCapture(path, cv2.CAP_V4L2)
        limits = [
            cv2.CAP_PROP_OPEN_TIMEOUT_MSEC,
            OPEN_TIMEOUT_MS,
            cv2.CAP_PROP_READ_TIMEOUT_MSEC,
            READ_TIMEOUT_MS,
        ]
        capture = cv2.VideoCapture(device, cv2.CAP_FFMPEG, limits)
        return capture if capture.isOpened() else cv2.VideoCapture(device)

    def _settings(self) -> list[tuple[str, int, float]]:
        """The wanted controls: name and value, OpenCV's property, its value."""
        wanted = self._controls
        settings: list[tuple[str, int, float]] = []
        if wanted.size_px is not None:
            width, height = wanted.size_px
            settings.append((f"width {width}", cv2.CAP_PROP_FRAME_WIDTH, width))
            settings.append((f"height {height}", cv2.CAP_PROP_FRAME_HEIGHT, height))
        if wanted.rate_hz is not None:
            name = f"frame_rate {wanted.rate_hz:g}"
            settings.append((name, cv2.CAP_PROP_FPS, wanted.rate_hz))
        if wanted.exposure_us is not None:
            name = f"exposure_time_abs {wanted.exposure_us:g}"
            settings.append((name, cv2.CAP_PROP_AUTO_EXPOSURE, _MANUAL_EXPOSURE))
            units = wanted.exposure_us / _EXPOSURE_UNIT_US
            settings.append((name, cv2.CAP_PROP_EXPOSURE, max(1.0, round(units))))
        if wanted.gain_raw is not None:
            name = f"gain_raw {wanted.gain_raw:g}"
            settings.append((name, cv2.CAP_PROP_GAIN, wanted.gain_raw))
        return settings
