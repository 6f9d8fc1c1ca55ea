"""From whatever a file or a camera gives to a grey picture, or to one clear reason why not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vsense.tracking.grabbers import GrabberError

Image = NDArray[np.uint8]

_PNG = b"\x89PNG\r\n\x1a\n"
_PNG_END = b"IEND\xaeB`\x82"
_JPEG = b"\xff\xd8"
_JPEG_END = b"\xff\xd9"


class PictureError(GrabberError):
    """A picture that cannot be used; the next one may be good."""


def to_grey(image: NDArray[Any]) -> Image:
    """Gives the grey picture of what OpenCV has read.

    Args:
        image: (h, w) or (h, w, 1) grey, (h, w, 3) BGR or (h, w, 4) BGRA; uint8 or uint16.

    Returns:
        (h, w) uint8.

    Raises:
        PictureError: it is no such picture.
    """
    if image.dtype == np.uint16:
        image = (image >> 8).astype(np.uint8)
    if image.dtype != np.uint8 or image.ndim not in (2, 3) or image.size == 0:
        raise PictureError(f"is no picture: {image.dtype} of shape {image.shape}")
    channels = 1 if image.ndim == 2 else image.shape[2]
    if channels == 1:
        return np.ascontiguousarray(image.reshape(image.shape[:2]), dtype=np.uint8)
    if channels not in (3, 4):
        raise PictureError(f"has {channels} channels, expected 1, 3 or 4")
    code = cv2.COLOR_BGR2GRAY if channels == 3 else cv2.COLOR_BGRA2GRAY
    return np.asarray(cv2.cvtColor(image, code), dtype=np.uint8)


def read_picture(path: Path) -> Image:
    """Reads a picture file as grey.

    Returns:
        (h, w) uint8.

    Raises:
        PictureError: it cannot be read, is cut off, or is no picture.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise PictureError(f"{path.name} cannot be read: {error.strerror}") from None
    return decode(data, path.name)


def decode(data: bytes, name: str) -> Image:
    """Decodes a picture file's bytes.

    Returns:
        (h, w) uint8.

    Raises:
        PictureError: it is cut off, or is no picture; the message begins with `name`.
    """
    if not data:
        raise PictureError(f"{name} is empty")
    # Some versions of OpenCV fill the missing part of a picture with grey and say nothing.
    if not _is_whole(data):
        raise PictureError(f"{name} is cut off after {len(data)} bytes")
    try:
        image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_GRAYSCALE)
    except cv2.error:
        image = None
    if image is None or image.size == 0:
        raise PictureError(f"{name} is no picture, or a damaged one")
    return to_grey(image)


def _is_whole(data: bytes) -> bool:
    """Whether a PNG or JPEG has its end; other formats are taken as they are."""
    if data.startswith(_PNG):
        return _PNG_END in data[-64:]
    if data.startswith(_JPEG):
        return data.rstrip(b"\0").endswith(_JPEG_END)
    return True
