"""A video file as a recording of one camera."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2

from vsense.tracking.grabbers import GrabberError
from vsense.tracking.grabbers_directory import DEFAULT_RATE_HZ
from vsense.tracking.grabbers_picture import Image, PictureError, to_grey
from vsense.tracking.grabbers_times import Taken, at_rate, read_timestamps

_MOST_PICTURES = 2_000_000
"""More than a day at 20 per second; a damaged header may claim any number."""


class VideoRecording:
    """The pictures of a video file.

    Attributes:
        taken: When each was taken.
    """

    def __init__(
        self,
        path: Path,
        timestamps: Path | None = None,
        start_ns: int = 0,
        rate_hz: float | None = None,
    ) -> None:
        """Opens the file.

        Args:
            path: The video.
            timestamps: Table of when its pictures were taken, in order; see `grabbers_times`.
            start_ns: Without a table: when the first was taken.
            rate_hz: Without a table: pictures per second, by default what the video says.

        Raises:
            GrabberError: It is no video that OpenCV opens, or holds no pictures.
            ConfigError: The table of timestamps cannot be used.
        """
        self._path = path
        self._video = cv2.VideoCapture(str(path))
        self._next = 0
        if not self._video.isOpened():
            raise GrabberError(f"{path}: is no video that OpenCV opens")
        self.taken: Sequence[Taken]
        if timestamps is not None:
            self.taken = read_timestamps(timestamps, named=False)
        else:
            count = self._video.get(cv2.CAP_PROP_FRAME_COUNT)
            pictures = [""] * int(count if 0 < count < _MOST_PICTURES else 0)
            self.taken = at_rate(pictures, start_ns, rate_hz or self._own_rate_hz())
        if not self.taken:
            raise GrabberError(f"{path}: holds no pictures")

    def read(self, place: int) -> Image:
        """Reads a picture; places count from 0 and are fast in rising order.

        Raises:
            PictureError: The video ends before it, or it cannot be decoded.
        """
        if place < self._next:
            self._video.release()
            self._video = cv2.VideoCapture(str(self._path))
            self._next = 0
        while self._next <= place:
            if not self._video.grab():
                raise PictureError(f"{self._path.name} ends after {self._next} pictures")
            self._next += 1
        whole, image = self._video.retrieve()
        if not whole:
            raise PictureError(f"picture {place} of {self._path.name} cannot be decoded")
        return to_grey(image)

    def close(self) -> None:
        """Closes the file; can be called again."""
        self._video.release()

    def _own_rate_hz(self) -> float:
        rate_hz = float(self._video.get(cv2.CAP_PROP_FPS))
        return rate_hz if 0.01 <= rate_hz <= 10_000.0 else DEFAULT_RATE_HZ
