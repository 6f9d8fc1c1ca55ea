"""What OpenCV must be told before it opens a camera: to keep silent, and not to wait for long."""

from __future__ import annotations

import os
from typing import Any

import cv2

_SILENT = 0
"""OpenCV's level for no messages at all."""

_SETTINGS = {
    # FFmpeg says on the terminal what ails every single packet; -8 is its level for silence.
    "OPENCV_FFMPEG_LOGLEVEL": "-8",
    # A V4L2 camera that says nothing for this long [s] has ended; by default ten.
    "OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT": "3",
}
"""OpenCV reads these once, when it first opens a camera. Source: OpenCV, the sources of videoio."""


def teach_opencv() -> None:
    """Keeps OpenCV and FFmpeg off the terminal: what matters is told as an event of the camera.

    What the user has set in the environment stays. libjpeg writes a line about each damaged
    picture all the same: nothing in OpenCV keeps it from that.
    """
    for name, value in _SETTINGS.items():
        os.environ.setdefault(name, value)
    # OpenCV 4 has it under another name than OpenCV 5.
    module: Any = cv2 if hasattr(cv2, "setLogLevel") else cv2.utils.logging
    module.setLogLevel(_SILENT)
