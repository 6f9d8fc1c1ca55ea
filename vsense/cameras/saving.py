"""One picture of a camera, into a file."""

from __future__ import annotations

from pathlib import Path

import cv2

from vsense.cameras.opening import Camera
from vsense.errors import UsageError, VsenseError
from vsense.tracking.grabbers_picture import Image

SUFFIXES = (".png", ".jpg", ".jpeg", ".pgm")
WARM_UP = 3
"""So many pictures go by first: the first ones may still have the exposure of before."""


def check(path: Path) -> None:
    """Refuses a file of another kind.

    Raises:
        UsageError: its name has another ending.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise UsageError(f"{path}: expected a name that ends in {', '.join(SUFFIXES)}")


def settled(camera: Camera) -> Image:
    """Takes a picture once exposure and gain have settled.

    Raises:
        GrabberError: the camera is gone.
    """
    for _ in range(WARM_UP):
        camera.picture()
    return camera.picture().image


def save(image: Image, path: Path) -> None:
    """Writes an (h, w) uint8 picture.

    Raises:
        VsenseError: it cannot be written.
    """
    data = cv2.imencode(path.suffix.lower(), image)[1].tobytes()
    try:
        path.write_bytes(data)
    except OSError as error:
        raise VsenseError(f"{path}: cannot be written: {error.strerror}") from None
